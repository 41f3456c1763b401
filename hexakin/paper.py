"""What paper A reports, and verdicts on it computed from repeated runs."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.robot_file import DATA
from hexakin.transforms import check_array

KINDS = ("change_percent", "direction", "unchanged")

MIN_AGREEMENT = 0.9
"""Share of the repeats that must go the paper's way for a direction to count as found."""


@dataclass(frozen=True)
class Statement:
    """One thing that the paper says of posture control against simple control.

    ``kind`` is ``"change_percent"`` (``value`` is the change in percent), ``"direction"`` (``value`` is its sign)
    or ``"unchanged"`` (within ``tolerance`` percent, our reading of "negligible").
    """

    id: str
    figure: str
    scenario: str
    measure: str
    statistic: str
    kind: str
    value: float
    tolerance: float | None
    wording: str


@dataclass(frozen=True)
class Verdict:
    """A statement beside what was measured, and what follows.

    ``median``, ``low`` and ``high`` (5th and 95th percentile) are changes in percent over the repeats;
    ``agreement`` is the share of repeats that go the paper's way.
    """

    statement: Statement
    median: float
    low: float
    high: float
    agreement: float
    verdict: str


def statements(name: str = "athena", path: Path | None = None) -> dict[str, Statement]:
    """Statements of ``data/paper/<name>.csv`` by their id."""
    file = path or DATA / "paper" / f"{name}.csv"
    if not file.is_file():
        raise UnknownNameError("paper", name, sorted(p.stem for p in (DATA / "paper").glob("*.csv")))
    found: dict[str, Statement] = {}
    with open(file, newline="", encoding="utf-8") as stream:
        for line, row in enumerate(csv.DictReader(stream), start=2):
            try:
                tolerance = float(row["tolerance"]) if row["tolerance"] else None
                value = float(row.pop("value"))
                del row["tolerance"]
                statement = Statement(**row, value=value, tolerance=tolerance)
            except (TypeError, ValueError, KeyError) as error:
                raise InvalidInputError(f"{file}: line {line}: {error}") from error
            if statement.kind not in KINDS or (statement.kind == "unchanged") != (tolerance is not None):
                raise InvalidInputError(f"{file}: line {line}: kind {statement.kind!r} with tolerance {tolerance}")
            found[statement.id] = statement
    return found


def change_percent(before: ArrayLike, after: ArrayLike) -> np.ndarray:
    """Change in percent, paired by repeat: (n,), (n,) -> (n,)."""
    a, b = check_array("before", before, ()), check_array("after", after, ())
    if a.shape != b.shape or (a == 0.0).any():
        raise InvalidInputError(f"before, after: shapes {a.shape} and {b.shape} must be equal, and no before zero")
    return 100.0 * (b - a) / a


def judge(statement: Statement, before: ArrayLike, after: ArrayLike) -> Verdict:
    """Compare a statement with paired repeats of a statistic (n,) without and with posture control.

    - *reproduced*: at least 90 % of the repeats go the paper's way (or, where it says unchanged, stay within
      the tolerance) and the paper's number, if it gives one, lies between their 5th and 95th percentiles.
    - *same direction*: at least 90 % have the number's sign, but the number lies outside.
    - *not reproduced*: neither.
    """
    change = change_percent(before, after)
    if change.size < 2:
        raise InvalidInputError(f"{statement.id}: a verdict needs at least two repeats, got {change.size}")
    low, high = (float(bound) for bound in np.percentile(change, [5, 95]))
    if statement.kind == "unchanged":
        agreement = float(np.mean(np.abs(change) <= (statement.tolerance or 0.0)))
    else:
        agreement = float(np.mean(np.sign(change) == np.sign(statement.value)))
    if agreement < MIN_AGREEMENT:
        verdict = "not reproduced"
    elif statement.kind == "change_percent" and not low <= statement.value <= high:
        verdict = "same direction"
    else:
        verdict = "reproduced"
    return Verdict(statement, float(np.median(change)), low, high, agreement, verdict)
