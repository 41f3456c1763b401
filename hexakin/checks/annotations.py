"""The decorator ``checked``: the annotations of a public function hold, or the error names the argument.

The annotations are read once, at the first call. They decide what kind of object an argument is: a robot, a flag, a
number, a name of a few. Arrays, and the ranges of numbers, are checked by the functions themselves, since an annotation
does not say a shape or a range (``hexakin.checks.values``).
"""

from __future__ import annotations

import functools
import inspect
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeVar, Union

import numpy as np

from hexakin.checks.values import is_number, is_whole
from hexakin.exceptions import InvalidInputError, UnknownNameError, shown

_Public = TypeVar("_Public", bound=Callable[..., Any])


class _Kind(NamedTuple):
    """A kind of argument: whether a value is of this kind, and how a message calls it."""

    holds: Callable[[Any], bool]
    text: str
    names: tuple[Any, ...] = ()


def checked(public: _Public) -> _Public:
    """Return the function, which first checks the kinds of its arguments by their annotations.

    A class is returned itself; its constructor checks. A call then raises InvalidInputError, which names the argument,
    its value and the expected kind, or UnknownNameError for a name that is none of a ``Literal``. Default values are
    not checked.
    """
    if isinstance(public, type):
        constructor = checked(vars(public)["__init__"])
        setattr(public, "__init__", constructor)  # noqa: B010, a type checker refuses the plain assignment
        return public
    names = list(inspect.signature(public).parameters)

    @functools.cache
    def kinds() -> tuple[list[tuple[str, _Kind | None]], dict[str, _Kind | None]]:
        hints = typing.get_type_hints(public)
        by_name = {name: _kind(hints[name]) if name in hints else None for name in names}
        return list(by_name.items()), by_name

    @functools.wraps(public)
    def call(*args: Any, **named: Any) -> Any:
        in_order, by_name = kinds()
        for (name, kind), value in zip(in_order, args, strict=False):
            if kind is not None and not kind.holds(value):
                raise _fault(name, value, kind)
        for name, value in named.items():
            kind = by_name.get(name)
            if kind is not None and not kind.holds(value):
                raise _fault(name, value, kind)
        return public(*args, **named)

    return typing.cast(_Public, call)


def _fault(name: str, value: object, kind: _Kind) -> InvalidInputError | UnknownNameError:
    if kind.names:
        return UnknownNameError(name, value, [str(known) for known in kind.names])
    return InvalidInputError(f"{name}: expected {kind.text}, got {shown(value)}")


_NUMBER = _Kind(is_number, "a number")
_BASIC: dict[Any, _Kind] = {
    bool: _Kind(lambda value: isinstance(value, (bool, np.bool_)), "True or False"),
    int: _Kind(is_whole, "a whole number"),
    float: _NUMBER,
    str: _Kind(lambda value: isinstance(value, str), "text"),
    type(None): _Kind(lambda value: value is None, "None"),
}


def _kind(hint: Any) -> _Kind | None:
    """Return the kind that an annotation stands for; None for Any, for ``ArrayLike`` and for what is not known."""
    if hint in _BASIC:
        return _BASIC[hint]
    if hint in (Any, object):
        return None
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hasattr(origin, "__value__"):  # an alias with arguments, as NDArray is since NumPy 2.5
        return _kind(origin.__value__[arguments])
    if origin is Literal:
        return _Kind(lambda value: isinstance(value, str) and value in arguments, "a name", arguments)
    if origin in (Union, types.UnionType):
        return _one_of(arguments)
    if origin is tuple or (inspect.isclass(origin) and issubclass(origin, Sequence)):
        return _sequence(origin, arguments)
    if inspect.isclass(origin) and issubclass(origin, Mapping):
        return _mapping(arguments)
    if origin is np.ndarray:
        return _array(arguments)
    if inspect.isclass(origin or hint) and _can_be_checked(hint):
        return _instance(origin or hint)
    return None


def _one_of(arguments: tuple[Any, ...]) -> _Kind | None:
    kinds = [_kind(argument) for argument in arguments]
    if any(kind is None for kind in kinds):
        return None
    known = [kind for kind in kinds if kind is not None]
    names = tuple(name for kind in known for name in kind.names)
    texts = [*(kind.text for kind in known if not kind.names), *([f"one of {', '.join(names)}"] if names else [])]
    only_names = names if len(texts) == 1 else ()
    text = " or ".join(filter(None, [", ".join(texts[:-1]), texts[-1]]))
    return _Kind(lambda value: any(kind.holds(value) for kind in known), text, only_names)


def _sequence(origin: type, arguments: tuple[Any, ...]) -> _Kind:
    """Lists, tuples and arrays (n,) stand for each other; a text is no sequence."""
    fixed = origin is tuple and arguments and arguments[-1] is not Ellipsis
    count = len(arguments) if fixed else None
    items = [_kind(argument) for argument in arguments if argument is not Ellipsis]

    def holds(value: Any) -> bool:
        if isinstance(value, (str, bytes)) or not isinstance(value, (Sequence, np.ndarray)):
            return False
        if isinstance(value, np.ndarray) and value.ndim == 0:
            return False
        if count is not None and len(value) != count:
            return False
        expected = items if fixed else items[:1] * len(value)
        return all(kind is None or kind.holds(item) for kind, item in zip(expected, value, strict=False))

    item = next((kind.text for kind in items if kind is not None), "values")
    text = f"{count} values" if count is not None else "a sequence"
    return _Kind(holds, f"{text}, each {item}" if item != "values" else text)


def _mapping(arguments: tuple[Any, ...]) -> _Kind:
    key, item = [_kind(argument) for argument in arguments] or [None, None]

    def holds(value: Any) -> bool:
        return isinstance(value, Mapping) and all(
            (key is None or key.holds(k)) and (item is None or item.holds(v)) for k, v in value.items()
        )

    return _Kind(holds, "a mapping" + (f" to {item.text}" if item is not None else ""))


def _instance(cls: Any) -> _Kind:
    """An instance of a class or of a protocol; the class itself is none. ``made_by`` of a class says how to get one."""
    if cls is Callable:
        return _Kind(callable, "a function")
    made_by = getattr(cls, "made_by", None)
    text = f"a {cls.__name__}" + (f", as {made_by} returns it" if isinstance(made_by, str) else "")
    return _Kind(lambda value: isinstance(value, cls) and not isinstance(value, type), text)


def _array(arguments: tuple[Any, ...]) -> _Kind:
    """An array, or what NumPy makes an array of, with elements that NumPy converts without a loss."""
    element = (*(typing.get_args(arguments[1]) if len(arguments) == 2 else ()), None)[0]
    letters, text = "biufcUSmMO", "values"
    for cls, its_letters, its_text in _ELEMENTS:
        if inspect.isclass(element) and issubclass(element, cls):
            letters, text = its_letters, its_text

    def holds(value: Any) -> bool:
        if type(value) is np.ndarray and value.dtype.kind in letters:
            return True
        try:
            array = np.asarray(value)
            return array.dtype.kind in letters or array.size == 0
        except Exception:  # an object may raise anything when it is converted
            return False

    return _Kind(holds, f"an array of {text}")


_ELEMENTS = (
    (np.bool_, "b", "True and False"),
    (np.integer, "iu", "whole numbers"),
    (np.floating, "biuf", "numbers"),
    (np.str_, "U", "texts"),
)


def _can_be_checked(cls: Any) -> bool:
    """Return False for NumPy's protocols of arrays, and for protocols whose functions check an object themselves."""
    of_numpy = str(getattr(cls, "__module__", "")).startswith("numpy._typing")
    return not of_numpy and getattr(cls, "_is_runtime_protocol", not getattr(cls, "_is_protocol", False))
