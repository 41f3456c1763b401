"""A journal that is safe if its writer is killed: one record per line with a checksum, written to disk at once."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from hexakin.checks.files import parse_json, read_bytes, whole_file
from hexakin.exceptions import FileError, StudyError

_FORMAT = "hexakin-journal-1"
_LARGEST = 2**30  # [bytes] the journals of paper A's studies have less than a hundredth of it

KEPT = "finished runs are kept; repeat the same call to continue"


class Journal:
    """Records (JSON objects) in a file that only grows.

    ``path`` is the file. The attribute ``records`` has all records of the file. A line that is incomplete (its writer
    was killed, or the disk was full) or damaged is deleted on opening; ``dropped`` counts these lines. Use a journal as
    a context manager, inside ``alone``.

    Raises StudyError for a file of another kind, which is not changed, and for a file that cannot be written.
    """

    def __init__(self, path: Path):
        self.path = path
        self.records, self.dropped = read(path)
        if self.dropped:
            lines = [_line(record) for record in [{"format": _FORMAT}, *self.records]]
            write_whole(path, b"".join(lines))
        try:
            self._file = open(path, "ab", buffering=0)
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            if self._file.tell() == 0:
                self._write(_line({"format": _FORMAT}))
        except BaseException:
            self._file.close()
            raise

    def append(self, record: Mapping[str, Any]) -> None:
        """Write ``record`` to the disk; if this fails, nothing of it is in the file and StudyError is raised."""
        self._write(_line(record))
        self.records.append(dict(record))

    def _write(self, line: bytes) -> None:
        end = os.fstat(self._file.fileno()).st_size
        try:
            while line:  # a full disk first accepts a part of a line; the next write raises the error
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):  # the next reader drops the rest of the line
                os.ftruncate(self._file.fileno(), end)
            raise StudyError(f"{self.path}: {error.strerror or error}; {KEPT}") from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()


@contextlib.contextmanager
def alone(path: Path) -> Iterator[None]:
    """Lock the file ``path`` (and the study's files beside it) against other processes; create its folder if missing.

    Raises StudyError if another process holds the lock, or if the folder cannot be written. When a process is killed,
    its lock ends.
    """
    lock = FileLock(path.with_name(path.name + ".lock"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
    except Timeout as error:
        raise StudyError(f"{path}: another process is writing it") from error
    except (FileExistsError, NotADirectoryError) as error:
        raise StudyError(f"{path}: cannot be written ({path.parent} is not a folder)") from error
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        yield
    finally:
        lock.release()


def read(path: Path) -> tuple[list[dict[str, Any]], int]:
    """Return the records of the journal ``path`` and the number of incomplete or damaged lines.

    If there is no file, there are no records and no such lines. Raises StudyError for a file that is not a journal.
    """
    if not path.exists():
        return [], 0
    try:
        data = read_bytes(path, _LARGEST)
    except FileError as error:
        raise StudyError(str(error)) from error
    *lines, rest = data.split(b"\n")
    found = [_record(line) for line in lines]
    records = [record for record in found if record is not None]
    is_journal = records and records[0].get("format", _FORMAT) == _FORMAT
    # If the writer was killed at once, the file has only the beginning of the first line.
    if not is_journal and not _line({"format": _FORMAT}).startswith(data):
        raise StudyError(f"{path}: not a hexakin journal (expected format {_FORMAT})")
    dropped = len(found) - len(records) + bool(rest)
    return [record for record in records if "format" not in record], dropped


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` to the file ``path``, completely or not at all; raises StudyError if it cannot be written."""
    try:
        with whole_file(path) as temporary:
            temporary.write_bytes(data)
    except FileError as error:
        raise StudyError(str(error)) from error


def set_aside(paths: Sequence[Path]) -> None:
    """Rename the files ``paths``, which belong together, so that none is overwritten.

    The new names end in ``.1.old``, or in the next number for which no file exists. Raises StudyError if a file cannot
    be renamed.
    """
    for number in itertools.count(1):
        aside = [path.with_name(f"{path.name}.{number}.old") for path in paths]
        if not any(path.exists() for path in aside):
            break
    try:
        for old, new in zip(paths, aside, strict=True):
            if old.exists():
                os.replace(old, new)
    except OSError as error:
        raise StudyError(f"{old}: cannot be renamed ({error.strerror or error})") from error


def _unwritable(path: Path, error: OSError) -> StudyError:
    return StudyError(f"{path}: cannot be written ({error.strerror or error})")


def _line(record: Mapping[str, Any]) -> bytes:
    text = json.dumps(record, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _record(line: bytes) -> dict[str, Any] | None:
    """Return the record of a line; None if the line is incomplete or damaged."""
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return None
    try:
        record = parse_json(text)
    except ValueError:
        return None
    return record if isinstance(record, dict) else None
