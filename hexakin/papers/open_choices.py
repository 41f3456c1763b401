"""Effects of the choices that paper A leaves open on its results: Morris' elementary effects (SALib).

Each choice has a range of plausible values. The method of Morris (1991) uses trajectories through the box of all ranges
that change one choice at a time. The mean of the changes that a choice causes shows how much the choice matters, and
their spread whether it interacts with others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from hexakin.checks import Array
from hexakin.exceptions import InvalidInputError, MissingPackageError, UnknownNameError
from hexakin.papers.gains import GAINS, compared
from hexakin.papers.scenarios import walk
from hexakin.study.runner import Study
from hexakin.study.tables import Scalar

try:
    from SALib.analyze import morris as analyze
    from SALib.sample import morris as sample
except ImportError as error:
    raise MissingPackageError("SALib", "a sensitivity study", "pip install SALib") from error

GRID_LEVELS = 4  # Morris' grid: a choice is at 0, 1/3, 2/3 or 1 of its range


def _between(low: float, high: float) -> Callable[[float], float]:
    return lambda share: round(low + share * (high - low), 6)


def _either(first: Scalar, second: Scalar) -> Callable[[float], Scalar]:
    return lambda share: first if share < 0.5 else second


CHOICES: dict[str, Callable[[float], Scalar]] = {
    "stride": _between(0.030, 0.060),  # [m]; the corner legs reach strides of about 65 mm
    "apex": _between(0.020, 0.050),  # [m]
    "servo_rate": _between(10.0, 40.0),  # [1/s]: a lag of two ticks to half a tick
    "start_from": _either("actual", "command"),
    "force_sampling": _either("mean", "last"),
    "reference_offset": _between(-0.010, 0.010),  # [m]
    "num_cycles": lambda share: 12 + 4 * round(3 * share),  # 12 to 24
    "foot_radius": _between(0.010, 0.025),  # [m]
    "mount_scale": _between(0.85, 1.15),  # of l_1
    "friction": _between(0.5, 1.1),
    "time_step": lambda share: (0.0005, 0.001, 0.002, 0.0025)[round(3 * share)],  # [s]
}
"""Function of each choice that returns its value for a share in [0, 1] of its range."""

_PROBLEM = {"num_vars": len(CHOICES), "names": list(CHOICES), "bounds": [[0.0, 1.0]] * len(CHOICES)}


def points(trajectories: int, seed: int = 0) -> Array:
    """Sample of Morris' method, spread out by SALib: (trajectories * (choices + 1), choices) shares in [0, 1].

    ``trajectories`` is their number, and ``seed`` draws them.
    """
    return np.asarray(
        sample.sample(_PROBLEM, 10 * trajectories, num_levels=GRID_LEVELS, optimal_trajectories=trajectories, seed=seed)
    )


def sensitivity(scenario: str, *, trajectories: int = 10, seed: int = 0) -> Study:
    """Simple control and the chosen gains at every point of a Morris sample, on the rigid engine, from one start.

    ``scenario`` is ``"ramp"`` or ``"testbed"``; ``trajectories`` and ``seed`` are those of ``points``.
    """
    runs: list[dict[str, Scalar]] = []
    for shares in points(trajectories, seed):
        choices = {name: at(share) for (name, at), share in zip(CHOICES.items(), shares, strict=True)}
        runs += [
            {"scenario": scenario, **gains, "engine": "rigid", "seed": 0, "layout": 0, **choices}
            for gains in compared(scenario)
        ]
    return Study(f"{scenario}_sensitivity", walk, tuple(runs))


def elementary_effects(
    table: pd.DataFrame, scenario: str, outcome: Callable[[Mapping[str, Any], Mapping[str, Any]], float],
    *, trajectories: int = 10, seed: int = 0,
) -> pd.DataFrame:  # fmt: skip
    """Measures of Morris' method: one row per choice, with ``mu``, ``mu_star``, ``sigma`` and ``mu_star_conf``.

    ``table`` holds the runs of ``sensitivity`` for a ``scenario``, with the same ``trajectories`` and ``seed``.
    ``outcome`` is a function of two rows of one point, those of simple control and of the chosen gains. ``mu_star`` is
    the mean size of the change that a choice causes over its range, in the unit of the outcome; ``mu_star_conf`` is
    half of its 95 % interval. A trajectory with a failed run is left out. Raises InvalidInputError if fewer than two
    trajectories are left.
    """
    shares = points(trajectories, seed)
    simple, chosen = (_rows(table, gains, shares) for gains in compared(scenario))
    values = np.full(len(shares), np.nan)
    for k, ends in enumerate(zip(simple, chosen, strict=True)):
        if ends[0] is not None and ends[1] is not None:
            values[k] = outcome(ends[0], ends[1])
    whole = np.isfinite(values.reshape(trajectories, -1)).all(axis=1)
    if whole.sum() < 2:
        raise InvalidInputError(f"table: {whole.sum()} trajectories without a failed run, expected at least 2")
    used = np.repeat(whole, len(CHOICES) + 1)
    found = analyze.analyze(_PROBLEM, shares[used], values[used], num_levels=GRID_LEVELS, seed=seed)
    columns = {name: np.asarray(found[name]) for name in ("mu", "mu_star", "sigma", "mu_star_conf")}
    return pd.DataFrame(columns, index=pd.Index(list(CHOICES), name="choice"))


def changes_of_one(
    table: pd.DataFrame, scenario: str, choice: str, measures: Sequence[str], *, trajectories: int = 10, seed: int = 0
) -> pd.DataFrame:
    """Measures of simple control at the two ends of the one step of each trajectory that changes ``choice`` alone.

    ``table``, ``scenario``, ``trajectories`` and ``seed`` are those of ``elementary_effects``; ``measures`` are names
    of columns. The result has one row per trajectory, with the columns (measure, "low") and (measure, "high") at the
    lower and the higher share of the choice's range. NaN where a run failed. Raises UnknownNameError for a choice that
    is not varied.
    """
    if choice not in CHOICES:
        raise UnknownNameError("choice", choice, list(CHOICES))
    column = list(CHOICES).index(choice)
    shares = points(trajectories, seed).reshape(trajectories, len(CHOICES) + 1, len(CHOICES))
    found = []
    for trajectory in shares:
        first = int(np.flatnonzero(np.diff(trajectory[:, column]))[0])
        ends = sorted(trajectory[first : first + 2], key=lambda point: float(point[column]))
        rows = _rows(table, compared(scenario)[0], ends)
        found.append([np.nan if row is None else row[name] for name in measures for row in rows])
    return pd.DataFrame(found, columns=pd.MultiIndex.from_product([measures, ["low", "high"]]))


def _rows(table: pd.DataFrame, gains: Mapping[str, float], shares: Iterable[Array]) -> list[Mapping[str, Any] | None]:
    """Rows of the runs with these gains at points of the sample; None where a run failed or is missing."""
    keyed = {_key(row): row for row in table[table["status"] == "ok"].to_dict("records")}
    chosen = [{name: at(share) for (name, at), share in zip(CHOICES.items(), point, strict=True)} for point in shares]
    return [keyed.get(_key({**gains, **choices})) for choices in chosen]


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(row[name] if isinstance(row[name], str) else round(float(row[name]), 9) for name in (*GAINS, *CHOICES))
