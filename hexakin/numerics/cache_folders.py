"""Folders for generated and compiled code: where they are, and whether the code in them may be run.

Whoever can write to such a folder can run code as the user who reads it. A folder is therefore used only if nobody
else can write to it or to its files, or has done so. Folders are created so that only their owner can open them.
"""

from __future__ import annotations

import contextlib
import os
import stat
from functools import cache
from pathlib import Path

from hexakin.numerics.messages import messages


def user_folder(kind: str) -> Path:
    """Return the user's folder for code of a ``kind``, as an absolute path; it need not exist.

    It is in the folder that the environment variable ``HEXAKIN_CACHE`` names, or in the platform's place for caches.
    Raises OSError if the platform has no such place, as for a user without a home directory.
    """
    if chosen := os.environ.get("HEXAKIN_CACHE"):
        return Path(chosen).absolute() / kind
    import platformdirs  # here, since most processes need no cache

    base = platformdirs.user_cache_path("hexakin", appauthor=False)
    if not base.is_absolute():  # a home directory that is not known stays "~"
        raise OSError(f"no folder for caches: {base}")
    return base / kind


def usable(folder: Path, *, tell: bool = True) -> bool:
    """Create ``folder`` if it is missing, and return whether code may be written to it and run from it.

    With ``tell``, stderr says once why a folder is not trusted.
    """
    try:
        folder.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)
        reason = distrust(folder)
    except OSError:
        return False
    if reason and tell:
        tell_once(f"no code is stored in a cache folder or run from it: {reason}")
    return not reason and os.access(folder, os.W_OK | os.X_OK)


@cache
def tell_once(message: str) -> None:
    """Print ``message`` on stderr, unless this process has printed it before."""
    print(f"hexakin: {message}", file=messages)


def distrust(folder: Path) -> str:
    """Return why code in ``folder`` is not trusted, as a sentence that names the folder or file at fault; else empty.

    It is trusted if it and its files belong to this user or to the administrator, if no other user may write to them,
    and if nobody may replace it: a folder above it to which all may write must be sticky, as /tmp is. Only POSIX
    systems tell who may write. Raises OSError if a folder or file cannot be examined.
    """
    if os.name != "posix":
        return ""
    real = folder.resolve()
    status = real.stat()
    if reason := _distrust_entry(str(real), status):
        return reason
    # Others may have written files while the folder was open to them.
    closed = not status.st_mode & (stat.S_IXGRP | stat.S_IXOTH)  # nobody else reaches the files
    with os.scandir(real) as entries:
        for entry in entries:
            with contextlib.suppress(FileNotFoundError):  # another process has renamed or deleted it
                if reason := _distrust_entry(entry.path, entry.stat(), closed):
                    return reason
    for parent in real.parents:
        mode = parent.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return f"all users may write to {parent}, and may replace what is in it"
    return ""


def _distrust_entry(path: str, status: os.stat_result, closed: bool = False) -> str:
    if status.st_uid not in (0, os.geteuid()):
        return f"{path} belongs to another user"
    if not closed and status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"other users may write to {path} (chmod go-w forbids it)"
    return ""
