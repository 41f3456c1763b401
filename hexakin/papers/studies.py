"""Paper A's studies: which walks, how often, on which engine and at which step (A Figs 10-19)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from hexakin.papers.gains import GAIN_LEVELS, GAINS, compared, settings
from hexakin.papers.scenarios import SCENARIOS, walk
from hexakin.study.runner import Study, grid
from hexakin.study.tables import Scalar

ENGINES = ("rigid", "pybullet")


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
        for gains in grid(**dict.fromkeys(GAINS, GAIN_LEVELS))
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
    """What the paper leaves open, varied (``hexakin.papers.open_choices``)."""
    from hexakin.papers.open_choices import sensitivity

    return sensitivity(scenario)


def near_limits() -> Study:
    """Walks up ramps near what friction, torque and balance allow (``hexakin.papers.near_limits``)."""
    from hexakin.papers.near_limits import study

    return study()


def manoeuvres() -> Study:
    """Gaits and directions of steering (``hexakin.papers.steering_trials``), on the rigid engine."""
    from hexakin.papers.steering_trials import study

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
