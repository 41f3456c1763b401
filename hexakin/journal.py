"""A journal that survives its writer: one record a line, each with a checksum, appended and flushed to the disk."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hexakin.exceptions import StudyError

_FORMAT = "hexakin-journal-1"


class Journal:
    """Records (JSON objects) in a file that only grows.

    ``records`` are those the file held when it was opened. A line that is not whole (its writer was killed, or the disk
    was full) or not what was written is dropped and counted in ``dropped``. One process at a time may have a journal
    open. Use as a context manager.

    Raises StudyError for a file of another kind, or when another process has it open.
    """

    def __init__(self, path: Path):
        from filelock import FileLock, Timeout

        self.path = path
        self._lock = FileLock(path.with_name(path.name + ".lock"))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire(timeout=0)
        except Timeout as error:
            raise StudyError(f"{path}: another process is writing it") from error
        except OSError as error:
            raise StudyError(f"{path}: cannot be written ({error})") from error
        try:
            self.records, self.dropped = read(path)
            if self.dropped:
                _rewrite(path, self.records)
            self._file = open(path, "ab", buffering=0)
            if self._file.tell() == 0:
                self._write(_line({"format": _FORMAT}))
        except BaseException:
            self._lock.release()
            raise

    def append(self, record: Mapping[str, Any]) -> None:
        """Add a record; it is on the disk when this returns, or nothing of it is and StudyError is raised."""
        self._write(_line(record))

    def _write(self, line: bytes) -> None:
        end = os.fstat(self._file.fileno()).st_size
        try:
            written = self._file.write(line)
            if written != len(line):
                raise OSError(f"only {written} of {len(line)} bytes were written")
            os.fsync(self._file.fileno())
        except OSError as error:
            os.ftruncate(self._file.fileno(), end)
            kept = "what was finished is kept, and the same call goes on from there"
            raise StudyError(f"{self.path}: {error.strerror or error}; {kept}") from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()
        self._lock.release()


def read(path: Path) -> tuple[list[dict[str, Any]], int]:
    """Records of a journal and the number of lines that are not whole; none of either if there is no file.

    Raises StudyError for a file that is no journal.
    """
    try:
        lines = path.read_bytes().splitlines(keepends=True)
    except FileNotFoundError:
        return [], 0
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error})") from error
    found = [_record(line) for line in lines]
    records = [record for record in found if record is not None]
    header = _line({"format": _FORMAT})
    # A writer killed at once leaves the beginning of the first line and nothing else.
    if lines and lines[0] != header and not (len(lines) == 1 and header.startswith(lines[0])):
        raise StudyError(f"{path}: not a hexakin journal (expected format {_FORMAT})")
    return records[1:], len(found) - len(records)


def _line(record: Mapping[str, Any]) -> bytes:
    text = json.dumps(record, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _record(line: bytes) -> dict[str, Any] | None:
    checksum, _, text = line.partition(b" ")
    if not text.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text[:-1]):
        return None
    return json.loads(text)


def _rewrite(path: Path, records: list[dict[str, Any]]) -> None:
    """Write the whole lines alone; the file is replaced when all of them are on the disk."""
    temporary = path.with_name(path.name + ".part")
    with open(temporary, "wb") as stream:
        stream.writelines(_line(record) for record in [{"format": _FORMAT}, *records])
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(temporary, path)
