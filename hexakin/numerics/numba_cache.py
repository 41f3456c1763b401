"""Compiled loops: numba's decorators with a cache on disk, and a message to the user during the first compilation.

This is the only module that imports numba. The compiled code is the inner loops of contact time stepping, where a
Python loop would take longer than the calculations in it, and of kinematics in large batches.

The machine code is stored beside the source, or in the user's cache folder if the first folder cannot be written. If
neither can be written, each process compiles again. Files are written under another name and then renamed, so that two
processes may compile at the same time. A damaged file is treated as missing.
"""
# numba compares a cached function only with its own source file; source_stamp also has the modules that it imports.

from __future__ import annotations

import contextlib
import hashlib
import pickle
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hexakin import installation
from hexakin.exceptions import MissingPackageError

try:
    import numba
    from numba.core.caching import FunctionCache, IndexDataCacheFile
except ImportError as error:
    raise MissingPackageError("numba", "contact mechanics", "pip install numba") from error

Whole = NDArray[np.int64]
_Function = TypeVar("_Function", bound=Callable[..., Any])
_CHECKSUM_SIZE = hashlib.sha256().digest_size
_PATIENCE = 1.0  # [s] loading from the cache takes less than this


@cache
def source_stamp(module: str) -> str | None:
    """Return a checksum of a module's source files and of all that it imports; None for a module outside hexakin."""
    if module not in installation.modules():
        return None
    files = installation.sources([module]).values()
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


class _CheckedFiles(IndexDataCacheFile):
    """Machine code with a checksum in front, because damaged machine code could crash the process."""

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest() + content)

    def _load_data(self, name: str) -> Any:
        stored = Path(self._data_path(name)).read_bytes()
        checksum, content = stored[:_CHECKSUM_SIZE], stored[_CHECKSUM_SIZE:]
        if hashlib.sha256(content).digest() != checksum:
            raise ValueError(f"{self._data_path(name)} is damaged")
        return pickle.loads(content)  # safe: the checksum shows that this class wrote it


class _Cache(FunctionCache):
    """numba's cache on disk; a damaged file is deleted and compiled again, and a full disk is ignored."""

    def __init__(self, function: Callable[..., Any]):
        super().__init__(function)
        files = self._cache_file
        # Machine code with another stamp is not used: it was made of other sources.
        stamp = source_stamp(function.__module__) or files._source_stamp
        self._cache_file = _CheckedFiles(files._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling a damaged file may raise any error
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def compiled(function: _Function) -> _Function:
    """Compile ``function`` at its first call and store the machine code, if a folder can be written."""
    dispatcher: Any = numba.njit(error_model="numpy")(function)
    with contextlib.suppress(RuntimeError):  # no folder can be written
        dispatcher._cache = _Cache(function)
    return cast(_Function, dispatcher)


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
        dispatcher: Any = numba.njit(nogil=True, error_model="numpy", fastmath={"contract"})(function)
        dispatcher._cache = _Cache(function)
        dispatcher.compile(signature)
        dispatcher.disable_compile()
        return cast(Callable[..., Any], dispatcher)

    return decorated


@contextlib.contextmanager
def announced(what: str) -> Iterator[None]:
    """Print on stderr that ``what`` is being compiled, if the block takes longer than loading from the cache."""

    def say() -> None:
        print(f"hexakin: compiling {what}, once for this installation (up to two minutes) ...", file=sys.stderr)

    timer = threading.Timer(_PATIENCE, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
