"""Paper A's studies: the walks, their repeats, engines and time steps (A Figs 10-19)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

from hexakin.checks import check_number, check_whole, checked
from hexakin.papers.gains import GAIN_LEVELS, GAINS, compared, settings
from hexakin.papers.scenarios import SCENARIOS, scenario_of, walk
from hexakin.study.runner import Study, grid
from hexakin.study.tables import Scalar

Engine = Literal["rigid", "pybullet"]
ENGINES: tuple[Engine, ...] = ("rigid", "pybullet")

_MOST_REPEATS = 500  # over a hundred thousand walks of gain_grid, weeks of computing


@checked
def repeats(scenario: str, count: int) -> list[dict[str, int]]:
    """``count`` repeats in a ``scenario``: starts on the ramp; layouts, each with its own start, on the testbed.

    Raises UnknownNameError for an unknown scenario, and InvalidInputError unless ``count`` is from 1 to 500.
    """
    layouts = scenario_of(scenario).has_layouts
    check_whole("count", count, at_least=1, at_most=_MOST_REPEATS)
    return [{"seed": k, "layout": k if layouts else 0} for k in range(count)]


@checked
def sweeps(
    scenario: str,
    *,
    count: int = 10,
    engines: Sequence[Engine] = ENGINES,
    time_steps: Sequence[float] = (0.002,),
) -> Study:
    """A Figs 10-12, 16 and 18 (ramp), or 13-15, 17 and 19 (testbed): all gains, each with ``count`` repeats.

    ``scenario`` is ``"ramp"`` or ``"testbed"``; the walks are made on all ``engines`` and with all ``time_steps`` [s].
    Raises the errors of ``repeats``, UnknownNameError for an unknown engine, and InvalidInputError for a time step that
    is not positive.
    """
    for time_step in time_steps:
        check_number("time_steps", time_step, above=0.0, unit="s")
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": engine, "time_step": time_step, **repeat}
        for engine in engines
        for time_step in time_steps
        for gains in settings(scenario)
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_sweeps", walk, tuple(runs))


FINER_STEPS = {"rigid": (0.001, 0.0005), "pybullet": (0.001,)}
"""Time steps [s], besides that of ``sweeps``, with which the comparison of A Figs 16-19 is repeated."""


@checked
def steps(scenario: str, *, count: int = 10) -> Study:
    """Simple control and the chosen gains with finer time steps than in ``sweeps``, as a check of convergence.

    ``scenario`` and ``count`` are those of ``sweeps``. Raises the errors of ``repeats``.
    """
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": engine, "time_step": time_step, **repeat}
        for engine, time_steps in FINER_STEPS.items()
        for time_step in time_steps
        for gains in compared(scenario)
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_steps", walk, tuple(runs))


@checked
def turned(scenario: str, *, count: int = 10, time_step: float = 0.002) -> Study:
    """``sweeps`` on the rigid engine with the other reading of A(28)-(31), which rotates the footholds themselves.

    ``scenario`` and ``count`` are those of ``sweeps``, with one ``time_step`` [s]. Raises the errors of ``sweeps``.
    """
    check_number("time_step", time_step, above=0.0, unit="s")
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


@checked
def gain_grid(scenario: str, *, count: int = 5, time_step: float = 0.002) -> Study:
    """All combinations of the six levels of the three gains, on the rigid engine.

    ``scenario`` and ``count`` are those of ``sweeps``, with one ``time_step`` [s]. Raises the errors of ``sweeps``.
    """
    check_number("time_step", time_step, above=0.0, unit="s")
    runs: list[dict[str, Scalar]] = [
        {"scenario": scenario, **gains, "engine": "rigid", "time_step": time_step, **repeat}
        for gains in grid(**dict.fromkeys(GAINS, GAIN_LEVELS))
        for repeat in repeats(scenario, count)
    ]
    return Study(f"{scenario}_grid", walk, tuple(runs))


@checked
def rougher(*, count: int = 10, time_step: float = 0.002) -> Study:
    """Simple control and the chosen gains on testbeds with smaller blocks and higher steps, on the rigid engine.

    Each testbed has ``count`` repeats, with one ``time_step`` [s]. Raises the errors of ``sweeps``.
    """
    check_number("time_step", time_step, above=0.0, unit="s")
    # [m]; a step of 0.09 is the whole range of heights
    beds = [{"block_size": size, "max_step": step} for size in (0.2, 0.1) for step in (0.03, 0.06, 0.09)]
    runs: list[dict[str, Scalar]] = [
        {"scenario": "testbed", **gains, "engine": "rigid", "time_step": time_step, **repeat, **bed}
        for bed in beds
        for gains in compared("testbed")
        for repeat in repeats("testbed", count)
    ]
    return Study("testbed_rougher", walk, tuple(runs))


@checked
def open_choices(scenario: str) -> Study:
    """Variation of the choices that the paper leaves open in a ``scenario`` (``hexakin.papers.open_choices``).

    Raises UnknownNameError for an unknown scenario.
    """
    from hexakin.papers.open_choices import sensitivity

    return sensitivity(scenario)


def near_limits() -> Study:
    """Walks up ramps near the limits of friction, torque and balance (``hexakin.papers.near_limits``)."""
    from hexakin.papers.near_limits import study

    return study()


def manoeuvres() -> Study:
    """Steering with all gaits in all directions, on the rigid engine (``hexakin.papers.steering_trials``)."""
    from hexakin.papers.steering_trials import study

    return study()


_MAKERS: dict[str, Callable[[str], Study]] = {
    "sweeps": sweeps, "steps": steps, "turned": turned, "sensitivity": open_choices, "grid": gain_grid,
}  # fmt: skip
STUDIES: dict[str, Callable[[], Study]] = {
    f"{scenario}_{kind}": partial(make, scenario) for kind, make in _MAKERS.items() for scenario in SCENARIOS
}
"""Studies by name. ``python -m hexakin study NAME`` runs one; the stored results are in data/results."""
STUDIES["testbed_rougher"] = rougher
STUDIES["ramp_limits"] = near_limits
STUDIES["manoeuvres"] = manoeuvres


@checked
def fresh(scenario: str, *, count: int = 2) -> Study:
    """Part of ``sweeps`` that the notebooks repeat: all gains on the rigid engine, and one comparison on PyBullet.

    ``scenario`` is that of ``sweeps``; on the rigid engine there are ``count`` repeats, on PyBullet there is one.
    Raises the errors of ``repeats``.
    """
    rigid = sweeps(scenario, count=count, engines=("rigid",)).runs
    pybullet = sweeps(scenario, count=1, engines=("pybullet",)).runs
    ends = [tuple(gains.values()) for gains in compared(scenario)]
    few = tuple(run for run in pybullet if tuple(run[gain] for gain in GAINS) in ends)
    return Study(f"{scenario}_fresh", walk, rigid + few)
