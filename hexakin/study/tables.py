"""A study's table as a CSV file from which every value is read back with the same type."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping

import pandas as pd

from hexakin.checks import check_path
from hexakin.checks.files import read_bytes
from hexakin.exceptions import FileError, StudyError

_LARGEST = 2**30  # [bytes] the tables of paper A's studies have less than a hundredth of it

Scalar = bool | int | float | str | None

NOT_COMPARED = ("wall_time",)
"""Columns whose values differ between equal runs."""

RESERVED = ("status", *NOT_COMPARED)
"""Names of columns that arguments and measures may not have."""


def read_table(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read the table ``path`` that ``run`` wrote: values and types are equal, except that None among numbers is NaN.

    Raises InvalidInputError if ``path`` is no path, and StudyError if the file is missing or not a study's table.
    """
    file = check_path("path", path)
    try:
        text = read_bytes(file, _LARGEST).decode()
        names, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
        table = pd.DataFrame([[_value(text) for text in row] for row in rows], columns=names)
    except FileError as error:
        raise StudyError(str(error)) from error
    except (ValueError, csv.Error) as error:  # the file is empty, its lines have different lengths, or it is not text
        raise StudyError(f"{path}: not readable as a study's table ({error})") from error
    if missing := [name for name in RESERVED if name not in table]:
        raise StudyError(f"{path}: not a study's table (no column {', '.join(missing)})")
    return table


def table_text(rows: Iterable[Mapping[str, Scalar]]) -> str:
    """Return ``rows`` as the text of a CSV table: arguments, status, values, wall time.

    A cell is empty where a row has no value or None.
    """
    names = [*dict.fromkeys(name for row in rows for name in row if name not in NOT_COMPARED), *NOT_COMPARED]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([names, *([_text(row.get(name)) for name in names] for row in rows)])
    return stream.getvalue()


def _text(value: Scalar) -> str:
    """Return the text of a cell; a string with line breaks, or that looks like another type, is quoted as in JSON."""
    if not isinstance(value, str):
        return "" if value is None else repr(value)
    return value if value.isprintable() and _value(value) == value else json.dumps(value)


def _value(text: str) -> Scalar:
    """Return the value of a cell that ``_text`` wrote."""
    if text in ("", "True", "False"):
        return text == "True" if text else None
    try:
        if text.startswith('"'):
            return json.loads(text)
        return int(text) if text.lstrip("-").isdecimal() else float(text)
    except ValueError:
        return text
