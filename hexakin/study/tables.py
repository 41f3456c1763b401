"""A study's table as a file: comma-separated, every value read back as it was, of the same kind."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping

import pandas as pd

from hexakin.exceptions import StudyError

Scalar = bool | int | float | str | None

NOT_COMPARED = ("wall_time",)
"""Columns that differ between equal runs."""

RESERVED = ("status", *NOT_COMPARED)
"""Columns that neither an argument nor a measure may be called."""


def read_table(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a table that ``run`` wrote: equal values of the same kinds, but that None among numbers is NaN.

    Raises StudyError if it is missing or not a study's table.
    """
    try:
        with open(path, encoding="utf-8", newline="") as stream:
            names, *rows = csv.reader(stream, strict=True)
        table = pd.DataFrame([[_value(text) for text in row] for row in rows], columns=names)
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ValueError, csv.Error) as error:  # no line, lines of different lengths, no text
        raise StudyError(f"{path}: not readable as a study's table ({error})") from error
    if missing := [name for name in RESERVED if name not in table]:
        raise StudyError(f"{path}: not a study's table (no column {', '.join(missing)})")
    return table


def table_text(rows: Iterable[Mapping[str, Scalar]]) -> str:
    """Rows as a table: arguments, status, values, wall time; nothing where a row has no value or None."""
    names = [*dict.fromkeys(name for row in rows for name in row if name not in NOT_COMPARED), *NOT_COMPARED]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([names, *([_text(row.get(name)) for name in names] for row in rows)])
    return stream.getvalue()


def _text(value: Scalar) -> str:
    """A value in the table; a string that would be read as something else, or has line breaks, is quoted as in JSON."""
    if not isinstance(value, str):
        return "" if value is None else repr(value)
    return value if value.isprintable() and _value(value) == value else json.dumps(value)


def _value(text: str) -> Scalar:
    """The value that ``_text`` wrote."""
    if text in ("", "True", "False"):
        return text == "True" if text else None
    try:
        if text.startswith('"'):
            return json.loads(text)
        return int(text) if text.lstrip("-").isdecimal() else float(text)
    except ValueError:
        return text
