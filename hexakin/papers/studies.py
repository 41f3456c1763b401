"""Paper A's studies: which walks, how often, on which engine and at which step (A Figs 10-19)."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.experiments import SCENARIOS, walk
from hexakin.installation import DATA
from hexakin.paper import summary, verdicts
from hexakin.study import Study, grid
from hexakin.tables import Scalar, read_table
from hexakin.transforms import Array
from hexakin.verdicts import CHOSEN, GAINS, LEVELS, SIMPLE

ENGINES = ("rigid", "pybullet")


def settings(scenario: str) -> list[dict[str, float]]:
    """Gains of A Figs 10-19 in a scenario: each swept alone, and the chosen ones; simple control once."""
    swept = [tuple(level if gain == name else 0.0 for gain in GAINS) for name in GAINS for level in LEVELS]
    return [dict(zip(GAINS, gains, strict=True)) for gains in dict.fromkeys([*swept, CHOSEN[scenario]])]


def compared(scenario: str) -> list[dict[str, float]]:
    """Simple control and the paper's chosen gains (A Figs 16-19)."""
    return [dict(zip(GAINS, gains, strict=True)) for gains in (SIMPLE, CHOSEN[scenario])]


def repeats(scenario: str, count: int) -> list[dict[str, int]]:
    """Perturbed starts on the ramp; layouts, each with a start of its own, on the testbed."""
    layouts = SCENARIOS[scenario].has_layouts
    return [{"seed": k, "layout": k if layouts else 0} for k in range(count)]


def sweeps(
    scenario: str, *, count: int = 10, engines: tuple[str, ...] = ENGINES, time_steps: tuple[float, ...] = (0.002,)
) -> Study:
    """A Figs 10-12 and 16, 18 (ramp), or 13-15 and 17, 19 (testbed): every setting, repeated ``count`` times."""
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": engine, "time_step": time_step, **repeat}
        for engine in engines
        for time_step in time_steps
        for gains in settings(scenario)
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_sweeps", walk, tuple(runs))


FINER_STEPS = {"rigid": (0.001, 0.0005), "pybullet": (0.001,)}
"""Time steps [s] at which the comparison of A Figs 16-19 is repeated, beside that of ``sweeps``."""


def steps(scenario: str, *, count: int = 10) -> Study:
    """Simple control and the chosen gains at finer time steps than those of ``sweeps``: a check of convergence."""
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": engine, "time_step": time_step, **repeat}
        for engine, time_steps in FINER_STEPS.items()
        for time_step in time_steps
        for gains in compared(scenario)
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_steps", walk, tuple(runs))


def turned(scenario: str, *, count: int = 10, time_step: float = 0.002) -> Study:
    """``sweeps`` on rigid with the other reading of A(28)-(31), which turns the footholds themselves."""
    settings_that_turn = [gains for gains in settings(scenario) if gains["k_alpha"] or gains["k_beta"]]
    runs: list[dict[str, Scalar]] = [
        {
            "scenario": scenario,
            **gains,
            "engine": "rigid",
            "time_step": time_step,
            **repeat,
            "reading": "rotate_foothold",
        }
        for gains in settings_that_turn
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_turned", walk, tuple(runs))


def gain_grid(scenario: str, *, count: int = 5, time_step: float = 0.002) -> Study:
    """Every combination of the six levels of the three gains, on the rigid engine."""
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": "rigid", "time_step": time_step, **repeat}
        for gains in grid(**dict.fromkeys(GAINS, LEVELS))
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_grid", walk, tuple(runs))


def rougher(*, count: int = 10, time_step: float = 0.002) -> Study:
    """Simple control and the chosen gains on testbeds of smaller blocks and higher steps, on the rigid engine."""
    # [m]; 0.09 is the whole range of heights
    beds = [{"block_size": size, "max_step": step} for size in (0.2, 0.1) for step in (0.03, 0.06, 0.09)]
    runs: list[dict[str, Scalar]] = [
        {"scenario": "testbed", **gains, "engine": "rigid", "time_step": time_step, **repeat, **bed}
        for bed in beds
        for gains in compared("testbed")
        for repeat in repeats("testbed", count)
    ]
    return Study("testbed_rougher", walk, tuple(runs))


def open_choices(scenario: str) -> Study:
    """What the paper leaves open, varied (``hexakin.sensitivity``)."""
    from hexakin.sensitivity import sensitivity

    return sensitivity(scenario)


def near_limits() -> Study:
    """Walks up ramps near what friction, torque and balance allow (``hexakin.limits``)."""
    from hexakin.limits import study

    return study()


def manoeuvres() -> Study:
    """Gaits and directions of steering (``hexakin.manoeuvres``), on the rigid engine."""
    from hexakin.manoeuvres import study

    return study()


_MAKERS: dict[str, Callable[[str], Study]] = {
    "sweeps": sweeps, "steps": steps, "turned": turned, "sensitivity": open_choices, "grid": gain_grid,
}  # fmt: skip
STUDIES: dict[str, Callable[[], Study]] = {
    f"{scenario}_{kind}": partial(make, scenario) for kind, make in _MAKERS.items() for scenario in SCENARIOS
}
"""Studies by name; ``python -m hexakin study NAME`` makes one. Their results are in data/results."""
STUDIES["testbed_rougher"] = rougher
STUDIES["ramp_limits"] = near_limits
STUDIES["manoeuvres"] = manoeuvres


def fresh(scenario: str, *, count: int = 2) -> Study:
    """What the notebooks repeat of ``sweeps``: all of it with fewer starts on rigid, one comparison on PyBullet."""
    rigid = sweeps(scenario, count=count, engines=("rigid",)).runs
    pybullet = sweeps(scenario, count=1, engines=("pybullet",)).runs
    ends = [tuple(gains.values()) for gains in compared(scenario)]
    few = tuple(run for run in pybullet if tuple(run[gain] for gain in GAINS) in ends)
    return Study(f"{scenario}_fresh", walk, rigid + few)


def results(name: str) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Table of a full study in data/results and what made it (call, versions, code). Raises UnknownNameError."""
    folder = DATA / "results"
    if not (folder / f"{name}.csv").is_file():
        raise UnknownNameError("results", name, sorted(path.stem for path in folder.glob("*.csv")))
    about = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return read_table(folder / f"{name}.csv"), about


def swept(gain: str) -> list[dict[str, float]]:
    """The six settings of one gain's sweep, the other two zero."""
    if gain not in GAINS:
        raise UnknownNameError("gain", gain, list(GAINS))
    return [{**dict.fromkeys(GAINS, 0.0), gain: level} for level in LEVELS]


def five_numbers(table: pd.DataFrame, measure: str, gains: Sequence[Mapping[str, float]]) -> Array:
    """Minimum, quartiles and maximum of a measure in runs of one engine: (settings, repeats, 5).

    Repeats (starts, layouts) in which a setting is missing or failed are left out. Raises InvalidInputError if none is
    left.
    """
    columns = [f"{measure}_{statistic}" for statistic in ("min", "lower", "median", "upper", "max")]
    per_setting = []
    for setting in gains:
        chosen = table[np.logical_and.reduce([np.isclose(table[name], setting[name]) for name in GAINS])]
        per_setting.append(chosen[chosen["status"] == "ok"].set_index(["seed", "layout"])[columns].dropna())
    common = per_setting[0].index
    for runs in per_setting[1:]:
        common = common.intersection(runs.index)
    if len(common) == 0:
        raise InvalidInputError(f"table: no start or layout has {measure} at all of the {len(gains)} settings")
    return np.array([runs.loc[common.sort_values()].to_numpy() for runs in per_setting])


def panels(tables: Mapping[str, pd.DataFrame], gains: Sequence[Mapping[str, float]]) -> dict[str, dict[str, Array]]:
    """``five_numbers`` of height, pitch rate and roll rate in several tables, as ``figures.draw_sweep`` takes them.

    A table without any of the ``gains``' runs is left out.
    """
    held = {n: t for n, t in tables.items() if all(len(t.merge(pd.DataFrame([setting]))) for setting in gains)}
    measures = ("height", "pitch_rate", "roll_rate")
    return {m: {name: five_numbers(table, m, gains) for name, table in held.items()} for m in measures}


def statement_verdicts() -> pd.DataFrame:
    """Every statement of paper A judged from the committed sweeps, as ``hexakin.paper.verdicts`` does."""
    return verdicts(pd.concat([results(f"{scenario}_sweeps")[0] for scenario in SCENARIOS]))


def statements_table() -> str:
    """Every statement of paper A beside what the committed sweeps found, as the README's markdown table."""
    return summary(statement_verdicts())
