"""Checks of the arguments of public functions, and the type ``Array``."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Sized
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.exceptions import InvalidInputError, shown

Array = NDArray[np.float64]

_BLOCK = 2048  # poses whose columns fit into the cache
_ROTATION_ERROR = 1e-6  # rounding in single precision, or in a long product of rotations, is below it


def check_array(
    name: str,
    value: ArrayLike,
    trailing: tuple[int | None, ...],
    labels: tuple[str, ...] = (),
    *,
    finite: bool = True,
) -> Array:
    """Convert ``value`` to a float array with the last axes ``trailing``, and check that all elements are finite.

    ``name`` is the argument's name in the message. ``labels`` are names of the last axes, such as ``("leg", "joint")``;
    the message counts along them from 1. A size None in ``trailing`` stands for any. With ``finite`` = False, NaN and
    infinite elements are allowed. Raises InvalidInputError, which names the argument and the first bad element.
    """
    array = _as_floats(name, value)
    last = array.shape[max(array.ndim - len(trailing), 0) :]
    if last != trailing and not _fits(last, trailing):
        expected = "(..., " + ", ".join("n" if size is None else str(size) for size in trailing) + ")"
        raise InvalidInputError(f"{name}: expected shape {expected}, got {array.shape}")
    if finite and not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        last = index[len(index) - len(trailing) :]
        place = ", ".join(f"{label} {i + 1}" for label, i in zip(labels, last, strict=False)) or f"index {index}"
        leading = index[: len(index) - len(trailing)]
        at = f" (at index {', '.join(map(str, leading))})" if leading else ""
        raise InvalidInputError(f"{name}: {place} is {array[index]}, expected a finite number{at}")
    return array


def _fits(shape: tuple[int, ...], trailing: tuple[int | None, ...]) -> bool:
    return len(shape) == len(trailing) and all(m in (n, None) for n, m in zip(shape, trailing, strict=True))


def check_arrays(*named: tuple[str, ArrayLike, tuple[int | None, ...]], finite: bool = True) -> list[Array]:
    """Check several arrays as ``check_array`` does, and that their leading axes broadcast against each other.

    Each of ``named`` is an argument's name, its value and its last axes. The arrays keep their shapes. Raises
    InvalidInputError, which names the argument, or all arguments and their shapes.
    """
    arrays = [check_array(name, value, trailing, finite=finite) for name, value, trailing in named]
    try:
        np.broadcast_shapes(*(a.shape[: a.ndim - len(t)] for a, (_, _, t) in zip(arrays, named, strict=True)))
    except ValueError as error:
        names = ", ".join(name for name, _, _ in named)
        raise InvalidInputError(f"{names}: shapes {', '.join(str(a.shape) for a in arrays)} do not fit") from error
    return arrays


def _as_floats(name: str, value: ArrayLike) -> Array:
    """Convert ``value`` to a float array, if it consists of real numbers; texts of numbers are no numbers."""
    if type(value) is np.ndarray and value.dtype.kind == "f":
        return np.asarray(value, dtype=float)
    try:
        given = np.asarray(value)
        array = np.asarray(given, dtype=float) if given.dtype.kind in "biufO" else None
    except Exception as error:  # an object may raise anything when it is converted
        raise InvalidInputError(f"{name}: expected numbers, got {shown(value)} ({error})") from error
    if given.dtype.kind == "c":
        raise InvalidInputError(f"{name}: expected real numbers, got complex ones")
    if array is None or (given.dtype.kind == "O" and any(isinstance(item, (str, bytes)) for item in given.flat)):
        raise InvalidInputError(f"{name}: expected numbers, got {shown(value)}")
    if np.ma.is_masked(value):
        raise InvalidInputError(f"{name}: expected numbers, but elements are masked")
    return array


def check_poses(name: str, value: ArrayLike) -> Array:
    """Return ``value`` (..., 4, 4) as a float array if each matrix is a pose; otherwise raise InvalidInputError.

    A pose consists of a rotation, a position [m] and the row (0, 0, 0, 1). Zeros, shears, scales and reflections are no
    rotations. ``name`` is the argument's name in the message.
    """
    T = check_array(name, value, (4, 4))
    flat = T.reshape(-1, 4, 4)
    for first in range(0, len(flat), _BLOCK):
        # One pose in Python's floats, many in columns of NumPy: both are several times faster than matrix products.
        rows = flat[first : first + _BLOCK].transpose(1, 2, 0).copy() if len(flat) > 1 else flat[0].tolist()
        for bad, text in _pose_faults(rows):
            if np.any(bad):
                index = np.unravel_index(first + int(np.argmax(bad)), T.shape[:-2])
                at = f" (at index {', '.join(map(str, index))})" if index else ""
                raise InvalidInputError(f"{name}: expected poses, but {text}{at}")
    return T


def _pose_faults(rows: Any) -> tuple[tuple[Any, str], ...]:
    """Return flags of the poses with a fault, and its text; ``rows`` are 4 x 4 numbers or arrays (n,)."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), (j, k, m, n) = rows
    with np.errstate(over="ignore", invalid="ignore"):
        # Two orthonormal rows, and the third row is their cross product.
        off = (
            *(a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, a * d + b * e + c * f),
            *(b * f - c * e - g, c * d - a * f - h, a * e - b * d - i),
        )
        rotation = sum(x * x for x in off) <= _ROTATION_ERROR**2
        row = j * j + k * k + m * m + (n - 1.0) * (n - 1.0) == 0.0
    return (
        (np.logical_not(rotation), "the first three rows and columns are no rotation"),
        (np.logical_not(row), "the last row is not (0, 0, 0, 1)"),
    )


def check_number(
    name: str,
    value: float,
    *,
    above: float = -np.inf,
    at_least: float = -np.inf,
    at_most: float = np.inf,
    unit: str = "",
) -> float:
    """Return ``value`` as a float if it is finite and within its bounds; otherwise raise InvalidInputError.

    The bounds are ``above`` (exclusive), ``at_least`` and ``at_most`` (inclusive). ``name`` and ``unit`` are for the
    message.
    """
    if not is_number(value):
        raise InvalidInputError(f"{name}: expected a number, got {shown(value)}")
    number = float(value)
    if not (np.isfinite(number) and number > above and at_least <= number <= at_most):
        bounds = []
        if np.isfinite(above):
            bounds.append(f"above {above:g}")
        if np.isfinite(at_least):
            bounds.append(f"at least {at_least:g}")
        if np.isfinite(at_most):
            bounds.append(f"at most {at_most:g}")
        wanted = " and ".join(bounds) or "finite"
        raise InvalidInputError(f"{name}: {number:g}{' ' + unit if unit else ''}, expected {wanted}")
    return number


def check_whole(name: str, value: object, *, at_least: int = 0, at_most: int | None = None) -> int:
    """Return ``value`` as an int if it is a whole number within its bounds; otherwise raise InvalidInputError.

    The bounds ``at_least`` and ``at_most`` are inclusive. ``name`` is the argument's name in the message.
    """
    if not is_whole(value) or value < at_least or (at_most is not None and value > at_most):
        bounds = f"of at least {at_least}" if at_most is None else f"from {at_least} to {at_most}"
        raise InvalidInputError(f"{name}: {shown(value)}, expected a whole number {bounds}")
    return int(value)


def check_angle(name: str, value: float) -> float:
    """Return ``value`` as a float if it is an angle [rad] of at most one turn; otherwise raise InvalidInputError.

    A larger angle was rather meant in degrees. ``name`` is the argument's name in the message.
    """
    return check_number(name, value, at_least=-2.0 * np.pi, at_most=2.0 * np.pi, unit="rad")


def is_number(value: object) -> TypeGuard[float]:
    """Return whether ``value`` is a real number in the range of floats; a flag or a text is none."""
    if type(value) is float:
        return True
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    try:
        float(value)
    except (OverflowError, ValueError):
        return False
    return True


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether ``value`` is a whole number of a size that arrays can hold; a flag is none."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        return False
    return -(2**63) <= int(value) < 2**63


def read_only(value: ArrayLike, name: str = "value") -> Array:
    """Return a read-only copy of ``value`` as a float array.

    Raises InvalidInputError, which names the argument ``name``, for what are no numbers.
    """
    array = np.array(_as_floats(name, value))
    array.setflags(write=False)
    return array


def check_path(name: str, value: object, ending: str = "") -> Path:
    """Return ``value``, a text or an ``os.PathLike`` of text, as a path; otherwise raise InvalidInputError.

    A number is no path: Python would take it for an open file. With ``ending``, such as ".npz", the path must name a
    file, and the ending is added if it is missing. ``name`` is the argument's name in the message.
    """
    try:
        text = os.fspath(value) if isinstance(value, os.PathLike) else value
    except Exception as error:  # an object may raise anything
        raise InvalidInputError(f"{name}: expected a path, got {shown(value)} ({error})") from error
    if not isinstance(text, str) or text == "" or "\0" in text:
        raise InvalidInputError(f"{name}: expected a path, got {shown(value)}")
    try:
        os.fsencode(text)
    except UnicodeEncodeError as error:
        raise InvalidInputError(f"{name}: expected a path, got {shown(value)} ({error})") from error
    path = Path(text)
    if not ending:
        return path
    if path.name in ("", ".."):
        raise InvalidInputError(f"{name}: expected the path of a file, got the folder {shown(value)}")
    return path if path.suffix.lower() == ending else path.with_name(path.name + ending)


def check_shape(name: str, value: ArrayLike, shape: tuple[int | None, ...], labels: tuple[str, ...] = ()) -> Array:
    """Convert ``value`` to a float array of just this ``shape``, and check that all elements are finite.

    A size None stands for any. ``name`` and ``labels`` are as in ``check_array``. Raises InvalidInputError.
    """
    if type(value) is np.ndarray and value.dtype == float and value.shape == shape and np.isfinite(value).all():
        return value
    array = _as_floats(name, value)
    _check_sizes(name, array, shape)
    return check_array(name, array, array.shape, labels)


def check_flags(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.bool_]:
    """Return ``value`` as an array of flags of just this ``shape``; a size None stands for any.

    The numbers 0 and 1 are flags, as they are in tables; other numbers and texts are none. ``name`` is the argument's
    name in the message. Raises InvalidInputError.
    """
    array = _as_floats(name, value)
    _check_sizes(name, array, shape)
    if not np.isin(array, (0.0, 1.0)).all():
        raise InvalidInputError(f"{name}: expected True or False for each element, got {shown(value)}")
    return array.astype(bool)


def _check_sizes(name: str, array: Array, shape: tuple[int | None, ...]) -> None:
    fits = len(array.shape) == len(shape) and all(n in (m, None) for m, n in zip(array.shape, shape, strict=True))
    if not fits:
        sizes = ", ".join("n" if size is None else str(size) for size in shape)
        expected = f"({sizes},)" if len(shape) == 1 else f"({sizes})"
        raise InvalidInputError(f"{name}: expected shape {expected}, got {array.shape}")


def check_same_length(**given: Sized) -> int:
    """Return the common length of arguments that belong together, given by name; raise InvalidInputError if it differs.

    ``given`` are the arguments.
    """
    lengths = [len(value) for value in given.values()]
    if len(set(lengths)) > 1:
        raise InvalidInputError(f"{', '.join(given)}: {', '.join(map(str, lengths))} values, expected equally many")
    return lengths[0]


def check_function(name: str, function: Callable[..., Any], *arguments: str) -> None:
    """Raise InvalidInputError unless ``function`` can be called with values for ``arguments``, in this order.

    Nothing is known of the arguments of some functions that are written in C; they pass. ``name`` is the argument's
    name in the message.
    """
    try:
        inspect.signature(function).bind(*arguments)
    except ValueError:
        fits = not isinstance(function, type)
    except TypeError:
        fits = False
    else:
        fits = True
    if not fits:
        raise InvalidInputError(f"{name}: expected a function of {', '.join(arguments)}, got {shown(function)}")


def check_columns(name: str, table: Any, columns: Iterable[str], numbers: Iterable[str] = ()) -> None:
    """Raise InvalidInputError, which names the columns, if the DataFrame ``table`` lacks some of ``columns``.

    The columns ``numbers`` must consist of numbers, unless the table has no rows. ``name`` is the argument's name in
    the message.
    """
    missing = [column for column in dict.fromkeys(columns) if column not in table.columns]
    if missing:
        raise InvalidInputError(f"{name}: missing columns {', '.join(missing)}")
    for column in numbers if len(table) else ():
        if table[column].dtype.kind not in "biuf":
            raise InvalidInputError(f"{name}: column {column}: expected numbers, got {shown(table[column].iloc[0])}")
