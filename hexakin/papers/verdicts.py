"""One statement of a paper, judged from repeated simulation runs."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_columns, check_whole, checked
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.papers.gains import CHOSEN, GAIN_LEVELS, GAINS, SIMPLE

MIN_AGREEMENT = 0.9
"""Share of the repeats that must agree with a statement so that it counts as reproduced."""

KEY = ("scenario", *GAINS, "engine", "time_step", "seed", "layout")
"""Columns that together identify one run."""

_NUMBERS = (*GAINS, "time_step", "seed", "layout")

STATISTICS = {
    "median": ("median",),
    "iqr": ("lower", "upper"),
    "range": ("min", "max"),
    "max": ("max",),
    "mean": ("",),
}
"""Endings of the columns of a statistic; with two columns, the statistic is the second minus the first."""

UNITS = {
    "height": "m",
    "pitch_rate": "rad/s",
    "roll_rate": "rad/s",
    "pitch_angle": "rad",
    "roll_angle": "rad",
    **{
        f"{name}{which}": "m"
        for name in ("zmp_distance", "stability_margin")
        for which in ("", "_all", "_stance", "_stance_all")
    },
    "torso_contact": "",  # a share of the ticks
    "limb_contact": "",
    **{f"zmp_outside{which}": "" for which in ("_loaded", "_loaded_all", "_stance", "_stance_all")},
    "distance": "m",
}
"""Unit of each measure."""

CHANGES = ("change_percent", "direction", "unchanged", "inconclusive")
EXTREMES = ("highest", "lowest")
_WITH_VALUE = ("change_percent", "direction", "value")
_WITH_TOLERANCE = ("change_percent", "unchanged", "value")


Word = Literal["reproduced", "same direction", "not reproduced", "no data"]


@checked
@dataclass(frozen=True)
class Statement:
    """One statement of the paper about one statistic of one measure.

    Parameters
    ----------
    id, figure, scenario, wording
        Name of the statement, figure of the paper, ``"ramp"`` or ``"testbed"``, and the words of the paper.
    factor, at
        A gain and its levels that the statement is about; or ``"chosen"`` for the paper's chosen gains.
    measure, statistic
        ``statistic`` is ``"median"``, ``"iqr"``, ``"range"`` (max - min) or ``"max"`` of ``measure`` over a run;
        ``"mean"`` is the column of the measure itself, one number per run.
    kind, value, tolerance
        Kind of the statement, which defines when a repeat agrees with it. Changes are relative to simple control, in
        percent.

        - ``"change_percent"``: the change, averaged over ``at``, is ``value``; a repeat agrees if the sign is the same.
        - ``"direction"``: the change has the sign ``value``, at every level of ``at``.
        - ``"unchanged"``: no change exceeds ``tolerance`` percent. This is how "no significant effect" is interpreted.
        - ``"inconclusive"``: the repeats do not agree on the sign of the change at any level of ``at``.
        - ``"highest"``, ``"lowest"``: the m levels in ``at`` are the m most extreme of the gain's six levels.
        - ``"value"``: the statistic itself is ``value``; a repeat agrees within ``tolerance``.
        - ``"never"``, ``"occurs"``: the statistic, a share of time, is zero, or above zero.

        ``tolerance`` of a number is half a unit of its last printed digit. Fields that a kind does not use
        are NaN.

    Raises
    ------
    UnknownNameError
        For an unknown scenario, factor, measure, statistic or kind.
    InvalidInputError
        For levels, a value or a tolerance that do not fit the kind.
    """

    id: str
    figure: str
    scenario: Literal["ramp", "testbed"]
    factor: Literal["k_z", "k_alpha", "k_beta", "chosen"]
    at: tuple[float, ...]
    measure: str
    statistic: Literal["median", "iqr", "range", "max", "mean"]
    kind: Literal[
        "change_percent", "direction", "unchanged", "inconclusive", "highest", "lowest", "value", "never", "occurs"
    ]
    value: float
    tolerance: float
    wording: str

    def __post_init__(self) -> None:
        if self.measure not in UNITS:
            raise UnknownNameError("measure", self.measure, list(UNITS))
        at = tuple(float(level) for level in self.at)
        object.__setattr__(self, "at", at)
        self._check_levels(at)
        self._check_numbers()

    def _check_levels(self, at: tuple[float, ...]) -> None:
        if (self.factor == "chosen") != (not at) or not set(at) <= set(GAIN_LEVELS) or len(set(at)) < len(at):
            expected = "none" if self.factor == "chosen" else f"different levels of {GAIN_LEVELS}"
            raise InvalidInputError(f"at: {at} with factor {self.factor!r}, expected {expected}")
        if self.kind in CHANGES and 0.0 in at:
            raise InvalidInputError(f"at: {at} with kind {self.kind!r}, expected levels above 0, where changes begin")
        if self.kind in EXTREMES and not 0 < len(at) < len(GAIN_LEVELS):
            raise InvalidInputError(f"at: {at} with kind {self.kind!r}, expected some of the levels {GAIN_LEVELS}")

    def _check_numbers(self) -> None:
        signed = self.kind != "direction" or abs(self.value) == 1.0
        if (self.kind in _WITH_VALUE) != isfinite(self.value) or not signed:
            expected = {"direction": "1 or -1"}.get(self.kind, "a number" if self.kind in _WITH_VALUE else "nan")
            raise InvalidInputError(f"value: {self.value:g} with kind {self.kind!r}, expected {expected}")
        if (self.kind in _WITH_TOLERANCE) != (isfinite(self.tolerance) and self.tolerance >= 0.0):
            expected = "at least 0" if self.kind in _WITH_TOLERANCE else "nan"
            raise InvalidInputError(f"tolerance: {self.tolerance:g} with kind {self.kind!r}, expected {expected}")


@checked
@dataclass(frozen=True)
class Verdict:
    """Verdict on a statement, with the measured effect.

    Parameters
    ----------
    statement
        The statement that was judged.
    repeats, left_out
        Number of repeats used, and of repeats left out. A repeat is left out if a run that it needs is missing, failed
        or not finite, or if a change in percent would start from zero.
    effect, low, high
        Median, 5th and 95th percentile over the repeats, in ``unit``: of the statistic itself (``"value"``,
        ``"never"``, ``"occurs"``), of the mean change (``"change_percent"``), of the difference between the mean of
        the named and of the other levels (``"highest"``, ``"lowest"``), else of the change at the level that
        contradicts the paper most. NaN with fewer than two repeats.
    agreement
        Share of the repeats that agree with the statement. For ``"inconclusive"`` it is the share of levels at which
        the repeats do not agree on a sign.
    verdict
        ``"reproduced"``, ``"same direction"``, ``"not reproduced"`` or ``"no data"``.

    Raises
    ------
    UnknownNameError
        For another verdict.
    InvalidInputError
        For a negative number of repeats.
    """

    statement: Statement
    repeats: int
    left_out: int
    effect: float
    low: float
    high: float
    unit: str
    agreement: float
    verdict: Word

    def __post_init__(self) -> None:
        for name in ("repeats", "left_out"):
            check_whole(name, getattr(self, name))


def columns_of(statement: Statement) -> list[str]:
    """Columns of a table of runs that the statistic of the ``statement`` is computed from."""
    return [f"{statement.measure}_{end}" if end else statement.measure for end in STATISTICS[statement.statistic]]


def check_runs(runs: pd.DataFrame, statements: list[Statement]) -> None:
    """Raise InvalidInputError if columns are missing, a run is not identified completely, or a run is given twice."""
    check_columns("runs", runs, [*KEY, "status", *(column for s in statements for column in columns_of(s))], _NUMBERS)
    for column in KEY:
        if runs[column].isna().any():
            raise InvalidInputError(f"runs: {column} is missing in {int(runs[column].isna().sum())} rows")
    # Computed gains may differ in the last bit.
    keys = runs[list(KEY)].round(dict.fromkeys(GAINS, 6))
    repeated = keys[keys.duplicated()]
    if len(repeated):
        first = ", ".join(f"{name} {value}" for name, value in repeated.iloc[0].items())
        raise InvalidInputError(f"runs: {len(repeated)} runs are given twice; the first: {first}")


def change_percent(before: ArrayLike, after: ArrayLike) -> Array:
    """Change in percent, (...), element by element.

    ``before`` (...) and ``after`` (...) are in any common unit. The change is divided by the absolute value of
    ``before``, so that a rise is positive even if ``before`` is negative, as a stability margin may be. Raises
    InvalidInputError for shapes that differ, and if an element of ``before`` is zero.
    """
    a, b = check_array("before", before, ()), check_array("after", after, ())
    if a.shape != b.shape or (a == 0.0).any():
        raise InvalidInputError(f"before, after: shapes {a.shape} and {b.shape} must be equal, and no before zero")
    return 100.0 * (b - a) / np.abs(a)


@checked
def judge(statement: Statement, runs: pd.DataFrame) -> Verdict:
    """Judge a ``statement`` from the runs of one engine with one time step.

    ``runs`` has one row per run. Runs are paired by seed and layout: a repeat is one start on one layout, run with all
    gains that the statement needs, each with the status ``"ok"``. The verdict is one of:

    - *reproduced*: at least 90 % of the repeats agree (see ``Statement``). If the paper gives a number, it also lies
      between their 5th and 95th percentiles, to the printed digits. A ``"value"`` needs the latter only. An
      ``"inconclusive"`` statement needs that the repeats disagree at every level.
    - *same direction*: at least 90 % of the repeats have the sign of a ``"change_percent"``, but its number lies
      outside the percentiles.
    - *not reproduced*: neither of these.
    - *no data*: there are fewer than two repeats.

    Raises InvalidInputError for missing columns, for a run given twice, and for several engines or time steps.
    """
    check_runs(runs, [statement])
    runs = runs[runs["scenario"] == statement.scenario]
    cases = runs[["engine", "time_step"]].drop_duplicates()
    if len(cases) > 1:
        found = "; ".join(f"{engine} at {step:g} s" for engine, step in cases.itertuples(index=False))
        raise InvalidInputError(f"runs: expected one engine and one time step, got {found}")
    return judge_checked(statement, runs)


def judge_checked(statement: Statement, runs: pd.DataFrame) -> Verdict:
    """Judge as ``judge`` does, without its checks: runs of the statement's scenario, one engine and one time step."""
    started = _repeats(statement, runs)
    values = started[np.isfinite(started).all(axis=1)]
    if statement.kind in CHANGES:
        values = values[values[:, 0] != 0.0]
    elif statement.kind in EXTREMES:
        values = values[values[:, len(statement.at) :].mean(axis=1) != 0.0]
    relative = statement.kind in CHANGES + EXTREMES
    repeats, left_out = len(values), len(started) - len(values)
    unit = "%" if relative else UNITS[statement.measure]
    if repeats < 2:
        return Verdict(statement, repeats, left_out, np.nan, np.nan, np.nan, unit, np.nan, "no data")
    effect, agreement = _effect(statement, values)
    low, high = (float(bound) for bound in np.percentile(effect, [5, 95]))
    tolerance = 0.0 if np.isnan(statement.tolerance) else statement.tolerance
    inside = low - tolerance <= statement.value <= high + tolerance
    verdict: Word
    if statement.kind == "value":
        verdict = "reproduced" if inside else "not reproduced"
    elif agreement < (1.0 if statement.kind == "inconclusive" else MIN_AGREEMENT):
        verdict = "not reproduced"
    else:
        verdict = "same direction" if statement.kind == "change_percent" and not inside else "reproduced"
    return Verdict(statement, repeats, left_out, float(np.median(effect)), low, high, unit, agreement, verdict)


def _gains(statement: Statement) -> list[tuple[float, ...]]:
    """Gains that the statement needs: first the reference of a change, then the named levels, then the other levels."""

    def swept(level: float) -> tuple[float, ...]:
        return tuple(level if name == statement.factor else 0.0 for name in GAINS)

    named: list[tuple[float, ...]]
    if statement.factor == "chosen":
        named = [CHOSEN[statement.scenario]]
    else:
        named = [swept(level) for level in statement.at]
    if statement.kind in CHANGES:
        return [SIMPLE, *named]
    if statement.kind in EXTREMES:
        return [*named, *(swept(level) for level in GAIN_LEVELS if level not in statement.at)]
    return named


def _repeats(statement: Statement, runs: pd.DataFrame) -> Array:
    """Statistic (n, gains) of every repeat with at least one run; NaN where a run is missing or failed."""
    data = runs[columns_of(statement)]
    try:
        data = data.astype(float)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"runs: {', '.join(data.columns)}: {error}") from error
    data = data.where(runs["status"] == "ok")
    statistic = data.iloc[:, -1] - data.iloc[:, 0] if data.shape[1] == 2 else data.iloc[:, 0]
    statistic = statistic.set_axis(pd.MultiIndex.from_frame(runs[["seed", "layout"]]))
    gains = runs[list(GAINS)].to_numpy(dtype=float)
    columns = [
        statistic[np.isclose(gains, wanted, rtol=0.0, atol=1e-6).all(axis=1)].rename(i)
        for i, wanted in enumerate(_gains(statement))
    ]
    return pd.concat(columns, axis=1).to_numpy(dtype=float)


def _effect(statement: Statement, values: Array) -> tuple[Array, float]:
    """Effect (n,) of each repeat, and the agreement, from the statistic (n, gains) in the order of ``_gains``."""
    kind = statement.kind
    if kind in EXTREMES:
        named, others = values[:, : len(statement.at)], values[:, len(statement.at) :]
        effect = change_percent(others.mean(axis=1), named.mean(axis=1))
        sign = 1.0 if kind == "highest" else -1.0
        return effect, float(np.mean((sign * named).min(axis=1) > (sign * others).max(axis=1)))
    if kind not in CHANGES:
        effect = values.mean(axis=1)
        if kind == "value":
            return effect, float(np.mean(np.abs(effect - statement.value) <= statement.tolerance))
        return effect, float(np.mean(effect == 0.0 if kind == "never" else effect > 0.0))
    change = change_percent(np.broadcast_to(values[:, :1], values[:, 1:].shape), values[:, 1:])
    if kind == "change_percent":
        effect = change.mean(axis=1)
        return effect, float(np.mean(np.sign(effect) == np.sign(statement.value)))
    if kind == "direction":
        weakest = (statement.value * change).min(axis=1)
        return statement.value * weakest, float(np.mean(weakest > 0.0))
    if kind == "unchanged":
        largest = np.take_along_axis(change, np.abs(change).argmax(axis=1)[:, None], axis=1)[:, 0]
        return largest, float(np.mean(np.abs(largest) <= statement.tolerance))
    majority = np.maximum(np.mean(change > 0.0, axis=0), np.mean(change < 0.0, axis=0))
    return change[:, majority.argmax()], float(np.mean(majority < MIN_AGREEMENT))
