"""Compiled loops: numba's decorator with a cache on disk, and a word to the user while it compiles for the first time.

This is the only module that imports numba; it carries the inner loops of contact time stepping, where a Python
loop would cost more than the physics, and of kinematics in large batches.

The machine code lies beside the source, or in the user's cache if that folder cannot be written; if neither can, each
process compiles anew. Files are renamed into place, so that two processes may compile at once, and one that is damaged
counts as missing.
"""
# numba checks a cached function against its own file, not against those that it imports; _drop_stale does.

from __future__ import annotations

import contextlib
import hashlib
import pickle
import sys
import threading
from collections.abc import Callable, Iterator
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
_PATIENCE = 1.0  # [s] a cached start is faster than this


def _drop_stale() -> None:
    """Delete cached machine code that is older than any source that it may have been made of."""
    changed = {module: source.stat().st_mtime for module, source in installation.modules().items()}
    newest = max(changed.values(), default=0.0)
    for index in installation.PACKAGE.rglob("__pycache__/*.nbi"):
        with contextlib.suppress(OSError, KeyError):  # read-only, another process was faster, or no module any more
            made = index.stat().st_mtime
            if made < newest:  # else its imports need not be looked at
                place = index.parent.parent.relative_to(installation.PACKAGE.parent).parts
                module = ".".join([*place, index.name.partition(".")[0]])
                if any(changed[name] > made for name in installation.sources([module])):
                    index.unlink()


_drop_stale()


class _CheckedFiles(IndexDataCacheFile):
    """Machine code behind its checksum: a flipped bit in it would crash the process."""

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest() + content)

    def _load_data(self, name: str) -> Any:
        stored = Path(self._data_path(name)).read_bytes()
        checksum, content = stored[:_CHECKSUM_SIZE], stored[_CHECKSUM_SIZE:]
        if hashlib.sha256(content).digest() != checksum:
            raise ValueError(f"{self._data_path(name)} is damaged")
        return pickle.loads(content)  # our own, by the checksum


class _Cache(FunctionCache):
    """numba's cache on disk, for which a damaged file is an error, and so is a disk that is full."""

    def __init__(self, function: Callable[..., Any]):
        super().__init__(function)
        files = self._cache_file
        self._cache_file = _CheckedFiles(files._cache_path, self._impl.filename_base, files._source_stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever unpickling garbage may raise
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def compiled(function: _Function) -> _Function:
    """Compile at the first call and keep the machine code, if there is a place for it."""
    dispatcher: Any = numba.njit(error_model="numpy")(function)
    with contextlib.suppress(RuntimeError):  # there is none
        dispatcher._cache = _Cache(function)
    return cast(_Function, dispatcher)


def contracted(function: _Function) -> _Function:
    """Compile as a part of a ``kernel``: products and sums may be fused; no cache of its own."""
    # What is not inlined is a symbol of its own, and the process that compiles it calls the version that was optimised
    # without the callees, at a third of the speed; only the next process has the kernel's own from the cache.
    jit: Any = numba.njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
    return cast(_Function, jit(function))


def kernel(*arguments: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Compile for the given types of ``arguments``, or load the machine code, at once; to be called without the GIL.

    An array is written as its dimension, with ``r`` if it is only read (``"2r"``), or ``"b"`` behind it for flags.
    Raises RuntimeError where there is no place for machine code.
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
    """Say on stderr that ``what`` is being compiled, if the block takes longer than a cached start does."""

    def say() -> None:
        print(f"hexakin: compiling {what}, once for this installation (up to two minutes) ...", file=sys.stderr)

    timer = threading.Timer(_PATIENCE, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
