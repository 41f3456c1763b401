"""Statements of paper A, and tables of verdicts on them, computed from repeated runs.

The words of the paper are interpreted as follows:

- "Variation", "variance" and "oscillation" mean the interquartile range. "Stability" without a number means both the
  median and the interquartile range, as in the paper's text on Fig. 10(b); there is one statement for each.
- "No significant effect", "identical" and "negligible" allow a median to change by 10 % and an interquartile range by
  50 %. The interquartile ranges of two samples of 24 cycles from one normal distribution differ by more than 50 % in
  one case of seven.
- "Most" and "least" refer to all six levels of a gain, including simple control.
- "The ZMP is within the support polygon" is judged with the polygon of the feet that are commanded to be in stance. The
  zero-moment point of A(32) cannot leave the polygon of the loaded feet, so that with that polygon the statement would
  always be true (A-E18).
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from hexakin.checks import check_columns, check_path, checked
from hexakin.checks.files import read_bytes
from hexakin.exceptions import HexakinError, InvalidInputError, UnknownNameError, renamed, shown
from hexakin.installation import DATA
from hexakin.papers.gains import CHOSEN, GAIN_LEVELS
from hexakin.papers.verdicts import (
    MIN_AGREEMENT,
    UNITS,
    Statement,
    Verdict,
    change_percent,
    check_runs,
    judge,
    judge_checked,
)

__all__ = [
    "CHOSEN",
    "GAIN_LEVELS",
    "MIN_AGREEMENT",
    "Statement",
    "Verdict",
    "change_percent",
    "claim",
    "counts",
    "finding",
    "judge",
    "reported",
    "robustness",
    "statements",
    "verdict_table",
    "verdicts",
]

VERDICTS = ("reproduced", "same direction", "not reproduced", "no data")

_LARGEST = 2**20  # [bytes] eighty times the size of paper A's file
_FIELDS = tuple(Statement.__dataclass_fields__)


@checked
def statements(name: str = "athena", path: str | os.PathLike[str] | None = None) -> dict[str, Statement]:
    """Statements of ``data/paper/<name>.csv``, or of the file ``path``, by their id.

    Raises UnknownNameError for an unknown ``name``, InvalidInputError if ``path`` is no path, FileError if the file
    cannot be read, and InvalidInputError, with the line, for an invalid row.
    """
    if path is not None:
        return _read(check_path("path", path))
    known = sorted(file.stem for file in (DATA / "paper").glob("*.csv"))
    if name not in known:
        raise UnknownNameError("paper", name, known)
    return _read(DATA / "paper" / f"{name}.csv")


@checked
def reported(figure: str) -> dict[str, list[tuple[float, float]]]:
    """Numbers that paper A reports for a figure, as lists of (gain level, value [SI unit]) by measure.

    ``figure`` is the name of the figure, such as ``"A 10"``.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for s in statements().values():
        if s.kind == "value" and s.at and s.figure.rstrip("abc") == figure:
            found.setdefault(s.measure, []).append((s.at[0], s.value))
    return found


def _read(file: Path) -> dict[str, Statement]:
    found: dict[str, Statement] = {}
    try:
        reader = csv.DictReader(io.StringIO(read_bytes(file, _LARGEST).decode(), newline=""), strict=True)
        if tuple(reader.fieldnames or ()) != _FIELDS:
            raise InvalidInputError(f"{file}: line 1: expected the columns {', '.join(_FIELDS)}")
        for row in reader:
            try:
                statement = _statement(row)
                if statement.id in found:
                    raise ValueError(f"id {statement.id!r} is given twice")
            except (HexakinError, ValueError) as error:
                raise InvalidInputError(f"{file}: line {reader.line_num}: {error}") from error
            found[statement.id] = statement
    except (UnicodeDecodeError, csv.Error) as error:
        raise InvalidInputError(f"{file}: not a table in UTF-8 ({error})") from error
    return found


def _statement(row: dict[str, str]) -> Statement:
    """Statement of one row of the file; raises HexakinError or ValueError if it cannot be judged."""
    if None in row or None in row.values():  # the csv module marks rows that are too long or too short with None
        raise ValueError(f"expected {len(_FIELDS)} fields")
    at = tuple(float(level) for level in row["at"].split())
    value, tolerance = (float(row[name]) if row[name] else math.nan for name in ("value", "tolerance"))
    return Statement(**{**row, "at": at, "value": value, "tolerance": tolerance})  # type: ignore[arg-type]


@checked
def verdicts(
    table: pd.DataFrame, statements: Mapping[str, Statement] | Sequence[Statement] | None = None
) -> pd.DataFrame:
    """Judge every statement for every engine and time step of its scenario: one row each.

    Parameters
    ----------
    table
        One row per run: the factors ``scenario``, ``k_z``, ``k_alpha``, ``k_beta``, ``engine``, ``time_step`` [s],
        ``seed``, ``layout``; ``status`` (``"ok"`` or an error message); and the measures, as ``<measure>_min``,
        ``_lower``, ``_median``, ``_upper``, ``_max`` or as one column.
    statements
        The statements to judge; by default all statements of paper A.

    Returns
    -------
    A table in the order of the statements, with the columns ``id``, ``figure``, ``scenario``, ``factor``, ``measure``,
    ``statistic``, ``kind``, ``paper`` (the value), ``engine``, ``time_step``, the fields of ``Verdict``, ``wording``
    and ``claim``.

    Raises
    ------
    InvalidInputError
        For missing columns or a run that is given twice; the message names them.
    """
    if statements is None:
        statements = _read(DATA / "paper" / "athena.csv")
    chosen = list(statements.values() if isinstance(statements, Mapping) else statements)
    check_runs(table, chosen)
    cases = {key: runs for key, runs in table.groupby(["scenario", "engine", "time_step"], sort=True)}
    rows = []
    for s in chosen:
        for (scenario, engine, time_step), runs in cases.items():
            if scenario == s.scenario:
                v = judge_checked(s, runs)
                rows.append(
                    (s.id, s.figure, s.scenario, s.factor, s.measure, s.statistic, s.kind, s.value, engine, time_step)
                    + (v.repeats, v.left_out, v.effect, v.low, v.high, v.unit, v.agreement, v.verdict, s.wording)
                    + (claim(s),)
                )
    columns = "id figure scenario factor measure statistic kind paper engine time_step repeats left_out effect low high"
    return pd.DataFrame(rows, columns=[*columns.split(), "unit", "agreement", "verdict", "wording", "claim"])


@checked
def robustness(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Whether the verdict on each statement is the same for all engines and time steps: one row per id.

    ``verdicts`` is a table of the function ``verdicts``. The column ``engines`` compares the engines at each time step,
    and ``steps`` the time steps of each engine: ``"agree"``, ``"differ"``, or ``"one"`` if there is nothing to compare.
    The column ``verdict`` has the verdict if all agree, and is empty otherwise. Rows without data are ignored. Raises
    InvalidInputError for missing columns.
    """
    check_columns("verdicts", verdicts, ["id", "engine", "time_step", "verdict"])
    judged = verdicts[verdicts["verdict"] != "no data"]
    rows = []
    for name in verdicts["id"].unique():
        own = judged[judged["id"] == name]
        found = own["verdict"].unique()
        rows.append((name, _agree(own, "time_step"), _agree(own, "engine"), found[0] if len(found) == 1 else ""))
    return pd.DataFrame(rows, columns=["id", "engines", "steps", "verdict"]).set_index("id")


def _agree(judged: pd.DataFrame, within: str) -> str:
    groups = [group["verdict"] for _, group in judged.groupby(within) if len(group) > 1]
    if not groups:
        return "one"
    return "agree" if all(group.nunique() == 1 for group in groups) else "differ"


@checked
def counts(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Number of statements with each verdict (rows) for each engine (columns).

    ``verdicts`` is a table of the function ``verdicts``. The columns are named as in ``verdict_table``. Raises
    InvalidInputError for missing columns.
    """
    check_columns("verdicts", verdicts, ["verdict"])
    named, cases = _cases(verdicts)
    table = pd.crosstab(named["verdict"], named["case"])
    return table.reindex(index=list(VERDICTS), columns=cases, fill_value=0)


@checked
def verdict_table(verdicts: pd.DataFrame) -> str:
    """Return verdicts as a GitHub-markdown table with one row per statement.

    ``verdicts`` is a table of the function ``verdicts``. There is one column for each engine, or for each time step of
    an engine that ran with several time steps. The cells contain the effect with its 5th and 95th percentile, each to
    three significant digits, and the verdict. Raises InvalidInputError for missing columns.
    """
    numbers = ["effect", "low", "high"]
    check_columns("verdicts", verdicts, ["id", "figure", "scenario", "claim", "verdict", "unit", *numbers], numbers)
    named, cases = _cases(verdicts)
    lines = [f"| figure | the paper says | {' | '.join(cases)} |", "|" + " --- |" * (2 + len(cases))]
    for _, group in named.groupby("id", sort=False):
        cells = {row.case: _cell(row) for row in group.itertuples(index=False)}
        first = group.iloc[0]
        words = [f"{first['figure']}, {first['scenario']}", first["claim"], *(cells.get(case, "") for case in cases)]
        lines.append(f"| {' | '.join(words)} |")
    return "\n".join(lines) + "\n"


def _cases(verdicts: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Add the column ``case``: the engine, with the time step if there are several; also return all cases in order."""
    check_columns("verdicts", verdicts, ["engine", "time_step"], ["time_step"])
    if verdicts[["engine", "time_step"]].isna().any(axis=None):
        raise InvalidInputError("verdicts: engine or time_step is missing in a row")
    steps = verdicts.groupby("engine")["time_step"].nunique()
    names = {
        (engine, step): engine if steps[engine] == 1 else f"{engine}, {1e3 * step:.6g} ms"
        for engine, step in sorted(set(zip(verdicts["engine"], verdicts["time_step"], strict=True)))
    }
    case = [names[key] for key in zip(verdicts["engine"], verdicts["time_step"], strict=True)]
    return verdicts.assign(case=case), list(names.values())


def _cell(row: Any) -> str:
    return "no data" if row.verdict == "no data" else f"{finding(row)} {row.verdict}"


_SHOWN = ("verdict", "unit", "effect", "low", "high")


def finding(row: Any) -> str:
    """Effect of a ``row`` of ``verdicts`` with its 5th and 95th percentile, such as ``"+47.6 % [45.8, 48.7]"``.

    Raises InvalidInputError if ``row`` is none.
    """
    if any(not hasattr(row, name) for name in _SHOWN):
        raise InvalidInputError(f"row: expected one with {', '.join(_SHOWN)}, got {shown(row)}")
    if row.verdict == "no data":
        return ""
    unit = f" {row.unit}" if row.unit else ""
    effect, low, high = (_three_digits(x) for x in (row.effect, row.low, row.high))
    sign = "+" if row.unit == "%" and not effect.startswith(("-", "0")) else ""
    return f"{sign}{effect}{unit} [{low}, {high}]"


def _three_digits(x: float) -> str:
    """Write ``x`` to three significant digits, without an exponent; numbers below 1e-6 are written as 0."""
    rounded = float(f"{x:.2e}")
    if abs(rounded) < 1e-6:
        return "0"
    return f"{rounded:.{max(0, 2 - math.floor(math.log10(abs(rounded))))}f}"


_GAIN_NAMES = {"k_z": "k_z", "k_alpha": "k_α", "k_beta": "k_β"}
_WHICH = {"": "", "_all": " (all ticks)", "_stance": " (stance polygon)", "_stance_all": " (stance polygon, all ticks)"}
_MEASURE_NAMES = {
    **{f"zmp_distance{which}": f"ZMP distance{said}" for which, said in _WHICH.items()},
    **{f"stability_margin{which}": f"stability margin{said}" for which, said in _WHICH.items()},
    "zmp_outside_loaded": "ZMP outside the loaded polygon",
    "zmp_outside_loaded_all": "ZMP outside the loaded polygon (all ticks)",
    "zmp_outside_stance": "ZMP outside the stance polygon",
    "zmp_outside_stance_all": "ZMP outside the stance polygon (all ticks)",
}
_STATISTIC_NAMES = {"median": " median", "iqr": " IQR", "range": " range", "max": " maximum", "mean": ""}


@checked
def claim(statement: Statement) -> str:
    """Short form of a ``statement``, such as ``"k_z > 0: height median +58.42 % on average"``."""
    s = statement
    what = _MEASURE_NAMES.get(s.measure, s.measure.replace("_", " ")) + _STATISTIC_NAMES[s.statistic]
    if s.factor == "chosen":
        where = "chosen gains"
    elif s.at == (0.0,):
        where = "simple control"
    elif s.at == GAIN_LEVELS[1:]:
        where = f"{_GAIN_NAMES[s.factor]} > 0"
    else:
        where = f"{_GAIN_NAMES[s.factor]} = {', '.join(f'{level:g}' for level in s.at)}"
    said = {
        "change_percent": f"{s.value:+g} %{' on average' if len(s.at) > 1 else ''}",
        "direction": "rises" if s.value > 0.0 else "falls",
        "unchanged": f"unchanged (± {s.tolerance:g} %)",
        "value": f"{s.value:g} {UNITS[s.measure]}".strip(),
        "never": "at no tick",
        "occurs": "at some ticks",
    }
    return f"{where}: {what} {said.get(s.kind, s.kind)}"


if not TYPE_CHECKING:  # type checkers know the new names only
    __getattr__ = renamed(__name__, {"summary": ("verdict_table", verdict_table)})
