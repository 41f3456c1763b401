"""Paper A's studies: which walks, how often, on which engine and at which step (A Figs 10-19)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from hexakin.experiments import SCENARIOS, walk
from hexakin.study import Scalar, Study, grid
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


def steps(scenario: str, *, count: int = 5, time_steps: tuple[float, ...] = (0.004, 0.002, 0.001, 0.0005)) -> Study:
    """Simple control and the chosen gains at several time steps [s], on both engines: a check of convergence."""
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": engine, "time_step": time_step, **repeat}
        for engine in ENGINES
        for time_step in time_steps
        for gains in compared(scenario)
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_steps", walk, tuple(runs))


def gain_grid(scenario: str, *, count: int = 5, time_step: float = 0.002) -> Study:
    """Every combination of the six levels of the three gains, on the rigid engine."""
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": "rigid", "time_step": time_step, **repeat}
        for gains in grid(**dict.fromkeys(GAINS, LEVELS))
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_grid", walk, tuple(runs))


_MAKERS: dict[str, Callable[[str], Study]] = {"sweeps": sweeps, "steps": steps, "grid": gain_grid}
STUDIES: dict[str, Callable[[], Study]] = {
    f"{scenario}_{kind}": partial(make, scenario) for kind, make in _MAKERS.items() for scenario in SCENARIOS
}
"""Paper A's studies by name, whose results are in data/results; ``python -m hexakin study NAME`` makes one."""
