"""PyBullet, imported without the line that it prints, or an error that says what to install."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import sys
from collections.abc import Iterator

from hexakin.exceptions import MissingPackageError

__all__ = ["pybullet", "wheel"]


@contextlib.contextmanager
def _quiet_import() -> Iterator[None]:
    """Suppress the build time that PyBullet prints on import, not to sys.stdout but to the process's own streams."""
    saved = {stream: os.dup(stream) for stream in (1, 2)}
    try:
        with open(os.devnull, "w") as null:
            for stream in saved:
                os.dup2(null.fileno(), stream)
        yield
    finally:
        if os.name == "posix":
            ctypes.CDLL(None).fflush(None)  # the line may still be in C's buffer
        for stream, copy in saved.items():
            os.dup2(copy, stream)
            os.close(copy)


def wheel(python: tuple[int, int], system: str, machine: str) -> str:
    """Return the name of the package on PyPI that has PyBullet as a wheel; empty if there is none.

    ``python`` is the version (major, minor), ``system`` and ``machine`` are those of the module platform. The fork
    pybullet-arm64 has the same sources and the same module, and wheels for more versions and platforms.
    """
    intel = machine.lower() in ("x86_64", "amd64")
    if (python, system, intel) == ((3, 11), "Linux", True):
        return "pybullet"
    forked = {"Linux": intel, "Windows": intel, "Darwin": not intel or python < (3, 13)}
    return "pybullet-arm64" if (3, 11) <= python <= (3, 13) and forked.get(system, False) else ""


try:
    with _quiet_import():
        import pybullet
except ImportError as error:
    _wheel = wheel(sys.version_info[:2], platform.system(), platform.machine())
    raise MissingPackageError(
        "pybullet", 'engine "pybullet"', f"pip install {_wheel}" if _wheel else "", 'use engine="rigid"'
    ) from error
