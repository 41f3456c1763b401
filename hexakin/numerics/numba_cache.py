"""Compiled loops: numba's decorators with a cache on disk, and a message to the user during the first compilation.

This is the only module that imports numba. The compiled code is the inner loops of contact time stepping, where a
Python loop would take longer than the calculations in it, and of kinematics in large batches.

The machine code is stored in the first of these folders that can be written and is trusted
(``hexakin.numerics.cache_folders``): the one that ``NUMBA_CACHE_DIR`` names, ``__pycache__/machine_code`` beside the
source, and the user's cache. If there is none, each process compiles again. Files are written under another name and
then renamed, so that two processes may compile at the same time. A damaged file is treated as missing.
"""
# numba's cache compares a function with its own source file only, and trusts every file that it finds. The classes here
# are built on classes of numba.core.caching that are not part of numba's documented interface; pyproject.toml therefore
# bounds numba's version, and tests/test_numba_cache.py tests what is used of them.

from __future__ import annotations

import contextlib
import hashlib
import pickle
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hexakin import installation
from hexakin.exceptions import MissingPackageError
from hexakin.numerics.cache_folders import tell_once, usable, user_folder
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.numerics.messages import messages

try:
    import numba
    from numba.core import event
    from numba.core.caching import CompileResultCacheImpl, FunctionCache
    from numba.core.serialize import dumps
except ImportError as error:
    raise MissingPackageError("numba", "contact mechanics", "pip install numba") from error

Whole = NDArray[np.int64]
_config: Any = numba.config

# Runs the handlers of signals that have arrived; -1 if one has raised an exception. It is a function of Python's C
# interface, and does nothing outside the main thread. A compiled loop that can be long calls it in each round and then
# raises ``Interrupted``; without it, Ctrl-C would wait for the loop's end.
signals_raise: Any = numba.types.ExternalFunction("PyErr_CheckSignals", numba.types.int32())
if _config.DISABLE_JIT:  # loops run in Python, which runs the handlers itself
    signals_raise = int  # int() is 0


class Interrupted(Exception):
    """The handler of a signal has raised an exception in a compiled loop.

    numba cannot raise KeyboardInterrupt itself. ``hexakin.numerics.interrupts.interrupts_kept`` puts the handler's
    exception in the place of this one.
    """


_Function = TypeVar("_Function", bound=Callable[..., Any])


@cache
def source_stamp(module: str) -> str | None:
    """Return a checksum of a module's source files and of all that it imports; None for a module outside hexakin."""
    if module not in installation.modules():
        return None
    files = installation.sources([module]).values()
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


class _Place:
    """The folder of a function's machine code, and the stamp of its sources: what numba calls a cache locator."""

    def __init__(self, function: Callable[..., Any], file: str, folder: Path):
        self._py_file = file
        self._folder, self._line = folder, function.__code__.co_firstlineno
        # Machine code with another stamp is not used: it was made of other sources.
        self._stamp = source_stamp(function.__module__) or hashlib.sha256(Path(file).read_bytes()).hexdigest()

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Place | None:
        """Return the first place that may be used, None if there is none."""
        source = Path(file).absolute()
        name = f"{source.parent.name}_{hashlib.sha256(bytes(source.parent)).hexdigest()[:16]}"
        with contextlib.suppress(OSError):
            if _config.CACHE_DIR and usable(chosen := Path(_config.CACHE_DIR).absolute() / name):
                return cls(function, file, chosen)
            beside = source.parent / "__pycache__" / "machine_code"
            if source.parent.is_dir() and usable(beside, tell=False):  # else there is still the user's cache
                return cls(function, file, beside)
            if usable(last := user_folder("machine_code") / name):
                return cls(function, file, last)
        return None

    def ensure_cache_path(self) -> None:
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Checked(CompileResultCacheImpl):
    """Machine code with a checksum, because damaged machine code could crash the process."""

    _locator_classes: Any = (_Place,)

    def reduce(self, compiled: Any) -> tuple[bytes, bytes]:
        content = dumps(super().reduce(compiled))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, stored: tuple[bytes, bytes]) -> Any:
        checksum, content = stored
        if hashlib.sha256(content).digest() != checksum:
            raise ValueError("the machine code is damaged")
        return super().rebuild(target_context, pickle.loads(content))


class _Cache(FunctionCache):
    """numba's cache on disk; a damaged file is deleted and compiled again, and a full disk is no error."""

    _impl_class = _Checked

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling a damaged file may raise any error
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            tell_once(f"the machine code cannot be kept in {self.cache_path}: {error.strerror}")


def _stored(dispatcher: Any, function: _Function) -> _Function:
    with contextlib.suppress(RuntimeError):  # no folder can be written
        dispatcher._cache = _Cache(function)
    return cast(_Function, dispatcher)


def compiled(function: _Function) -> _Function:
    """Compile ``function`` at its first call and store the machine code, if a folder can be written."""
    # It is said that references are counted: a function would take over from its first caller that they are not.
    jit: Any = numba.njit
    return _stored(jit(error_model="numpy", _nrt=True, no_cfunc_wrapper=True)(function), function)


def no_new_arrays(function: _Function) -> _Function:
    """Compile ``function`` like ``compiled``, without counting the references to arrays.

    The function must neither make nor return arrays; numba refuses to compile one that makes them. Counting takes most
    of the time of a short function whose arguments are named tuples with many arrays.
    """
    jit: Any = numba.njit
    return _stored(jit(error_model="numpy", _nrt=False, no_cfunc_wrapper=True)(function), function)


# Options of functions that are called by compiled functions alone.
_INNER: dict[str, Any] = {
    "error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True
}  # fmt: skip


def part(function: _Function) -> _Function:
    """Compile ``function`` like ``no_new_arrays``, to be called by compiled functions alone.

    It cannot be called from Python; code for such calls takes a good part of the time to compile.
    """
    return _stored(numba.njit(**_INNER)(function), function)


def inlined(function: _Function) -> _Function:
    """Compile ``function``, which makes no arrays, as a part of each function that calls it; it has no own cache."""
    jit: Any = numba.njit(**_INNER, forceinline=True)
    return cast(_Function, jit(function))


def entry(function: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """Return what ``function`` runs for arguments of these types; it is called once with them.

    numba looks for it in each call, which takes 30 microseconds for named tuples of many arrays. The function returned
    does not check what it is called with.
    """
    function(*arguments)
    if _config.DISABLE_JIT:  # set by NUMBA_DISABLE_JIT: loops run in Python, to be debugged
        return function
    dispatcher: Any = function
    return cast(Callable[..., Any], dispatcher.get_overload(tuple(numba.typeof(a) for a in arguments)))


def contracted(function: _Function) -> _Function:
    """Compile ``function`` as part of a ``kernel``: products and sums may be fused; it has no own cache."""
    # Without inlining, the process that compiles the kernel calls a version of this function that was optimised on its
    # own, at a third of the speed. Only later processes load the kernel's optimised version from the cache.
    jit: Any = numba.njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
    return cast(_Function, jit(function))


def kernel(*arguments: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that at once compiles a function, or loads its machine code; it runs without the GIL.

    ``arguments`` are the types of the function's arguments: for each array the number of dimensions, followed by ``r``
    if it is only read (``"2r"``), or by ``b`` for flags (bool). Raises RuntimeError if no folder for machine code can
    be written.
    """

    def array(code: str) -> Any:
        element = numba.types.boolean if code.endswith("b") else numba.types.float64
        return numba.types.Array(element, int(code[0]), "C", readonly=code.endswith("r"))

    signature = tuple(array(code) for code in arguments)

    def decorated(function: Callable[..., Any]) -> Callable[..., Any]:
        if _config.DISABLE_JIT:  # set by NUMBA_DISABLE_JIT: loops run in Python, to be debugged
            return function
        dispatcher: Any = numba.njit(nogil=True, error_model="numpy", fastmath={"contract"})(function)
        dispatcher._cache = _Cache(function)
        dispatcher.compile(signature)
        dispatcher.disable_compile()
        return cast(Callable[..., Any], dispatcher)

    return decorated


class _Announcement(event.Listener):
    """Says on stderr that ``what`` is being compiled, when numba begins to compile.

    The compilation ends with the first of ``interrupts``, before numba begins to compile the next function.
    """

    def __init__(self, what: str, interrupts: list[BaseException]):
        self._what, self._said, self._interrupts = what, False, interrupts

    def on_start(self, event: Any) -> None:
        if self._interrupts:
            raise self._interrupts[0]
        function = event.data["dispatcher"]
        if self._said or not function.__module__.startswith("hexakin."):
            return
        self._said = True
        folder = function.stats.cache_path
        kept = f"once; it is kept in {folder}" if folder else "in each process, since no folder for it can be used"
        print(f"hexakin: compiling {self._what} (up to two minutes), {kept}", file=messages)

    def on_end(self, event: Any) -> None:
        pass


@contextlib.contextmanager
def announced(what: str) -> Iterator[None]:
    """Print on stderr that ``what`` is being compiled, if the block compiles it, and where the code is kept."""
    with interrupts_kept() as raised, event.install_listener("numba:compile", _Announcement(what, raised)):
        yield
