"""Files are read within limits and written whole; an error names the file."""

from __future__ import annotations

import contextlib
import json
import math
import os
import uuid
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import format as npy

from hexakin.exceptions import FileError, shown

DEEPEST = 32
"""Allowed levels of nesting in YAML and JSON; robot files and parameters of recordings have about six."""

_MOST_MEMBERS = 1000  # arrays in one archive; a recording has about 30


def check_file(path: Path) -> None:
    """Raise FileError unless ``path`` is a regular file."""
    try:
        if not path.exists():
            raise FileError(f"{path}: no such file")
        if not path.is_file():
            raise FileError(f"{path}: cannot be read (not a file)")
    except OSError as error:
        raise _unreadable(path, error) from error


def read_bytes(path: Path, most: int) -> bytes:
    """Return the contents of a regular file.

    Raises FileError if ``path`` is missing, is not a regular file, cannot be read or is longer than ``most`` [bytes].
    """
    check_file(path)
    try:
        with open(path, "rb") as stream:
            data = stream.read(most + 1)
    except OSError as error:
        raise _unreadable(path, error) from error
    if len(data) > most:
        raise FileError(f"{path}: longer than {most} bytes, the most that is allowed")
    return data


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file beside ``path``, which becomes ``path`` when the block has ended.

    If the block fails, no file is left, and a file that was there before stays as it was. Raises FileError, before the
    block is entered, if the folder of ``path`` does not exist or cannot be written, or if ``path`` is not a regular
    file; and for any OSError in the block, such as a full disk.
    """
    try:
        if not path.parent.is_dir():
            raise FileError(f"{path}: cannot be written (the folder {path.parent} does not exist)")
    except OSError as error:
        raise _not_written(path, error) from error
    # The name is short, so that it is not too long where that of the file is not.
    temporary = path.with_name(f".{path.stem[:40]}.{uuid.uuid4().hex[:8]}.part{path.suffix}")
    try:
        if path.exists() and not path.is_file():
            raise FileError(f"{path}: cannot be written (not a file)")
        open(temporary, "xb").close()
        yield temporary
        with open(temporary, "rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise _not_written(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _not_written(path: Path, error: OSError) -> FileError:
    if isinstance(error, FileError):
        return error
    return FileError(f"{path}: cannot be written ({error.strerror or error})")


def parse_json(text: str | bytes) -> Any:
    """Return the value of a JSON text; raises ValueError if it is malformed or nested in more than 32 levels."""
    try:
        value = json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    level = [value]
    for _ in range(DEEPEST):
        level = [
            child
            for node in level
            if isinstance(node, (dict, list))
            for child in (node.values() if isinstance(node, dict) else node)
        ]
    if level:
        raise ValueError("nested too deeply")
    return value


class Header(NamedTuple):
    """What an archive says of one of its arrays: ``shape`` and ``dtype``."""

    shape: tuple[int, ...]
    dtype: np.dtype


class Arrays(NamedTuple):
    """An open ``.npz`` archive: the ``headers`` of its arrays by their names; ``read`` reads one array."""

    path: Path
    archive: zipfile.ZipFile
    headers: Mapping[str, Header]

    def read(self, name: str) -> np.ndarray:
        """Return the array ``name``. Raises FileError if it is missing or damaged."""
        if name not in self.headers:
            raise FileError(f"{self.path}: {name} is missing")
        with _damage(self.path), self.archive.open(f"{name}.npy") as stream:
            array = npy.read_array(stream, allow_pickle=False)
            stream.read(1)  # at its end the member is compared with its checksum
            return array


@contextlib.contextmanager
def opened_arrays(path: Path, most: int) -> Iterator[Arrays]:
    """Open a ``.npz`` archive; nothing but the headers of its arrays is unpacked before ``read`` is called.

    ``most`` is the largest allowed size [bytes] of all arrays together. Raises FileError if ``path`` cannot be read,
    is not such an archive, or if its arrays are larger, contradict the sizes in the archive's directory, or do not
    consist of numbers, flags or text.
    """
    check_file(path)
    try:
        stream = open(path, "rb")
    except OSError as error:
        raise _unreadable(path, error) from error
    with stream:
        with _damage(path):
            archive = zipfile.ZipFile(stream)
            headers = _headers(archive, most)
        with archive:
            yield Arrays(path, archive, headers)


@contextlib.contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Any error while an archive is read becomes a FileError: a damaged one can raise nearly all that there are."""
    try:
        yield
    except _Refused as error:
        raise FileError(f"{path}: {error}") from error
    except Exception as error:
        raise FileError(f"{path}: truncated or damaged, or no .npz archive ({error})") from error


class _Refused(Exception):
    """What an archive contains is not allowed."""


def _headers(archive: zipfile.ZipFile, most: int) -> dict[str, Header]:
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS:
        raise _Refused(f"{len(members)} arrays, expected at most {_MOST_MEMBERS}")
    size = sum(member.file_size for member in members)
    if size > most:
        raise _Refused(f"{size} bytes when unpacked, expected at most {most}")
    headers: dict[str, Header] = {}
    for member in members:
        name = member.filename.removesuffix(".npy")
        if name == member.filename or name in headers:
            raise _Refused(f"{shown(member.filename)} is no array, or is contained twice")
        with archive.open(member) as stream:
            if (version := npy.read_magic(stream)) != (1, 0):  # a header of version 1 has at most 64 kB
                raise _Refused(f"{name}: format {version} of arrays, expected (1, 0)")
            shape, _, dtype = npy.read_array_header_1_0(stream)
            if dtype.hasobject or dtype.kind not in "biufU":
                raise _Refused(f"{name}: elements of {dtype!s:.40}, expected numbers, flags or text")
            if not all(0 <= length <= most for length in shape):
                raise _Refused(f"{name}: impossible shape {shown(shape)}")
            if stream.tell() + math.prod(shape) * dtype.itemsize != member.file_size:
                raise _Refused(f"{name}: shape {shape} of {dtype} contradicts its size of {member.file_size} bytes")
        headers[name] = Header(shape, dtype)
    return headers


def _unreadable(path: Path, error: OSError) -> FileError:
    if isinstance(error, FileError):
        return error
    if isinstance(error, FileNotFoundError):
        return FileError(f"{path}: no such file")
    return FileError(f"{path}: cannot be read ({error.strerror or error})")
