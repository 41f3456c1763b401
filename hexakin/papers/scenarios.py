"""Paper A's experiments: walks on the ramp or the testbed, and their measures (A section 5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_function, check_number, check_shape, check_whole, checked
from hexakin.control.ground_plane import slope_angles
from hexakin.control.posture import PostureController
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError, renamed
from hexakin.kinematics.forward import standing_height
from hexakin.motion.measures import per_cycle
from hexakin.motion.recording import Recording
from hexakin.papers.gains import GAINS
from hexakin.robot.file import load_robot
from hexakin.robot.model import Leg, Robot
from hexakin.simulation.closed_loop import simulate
from hexakin.stability.time_series import series
from hexakin.terrain import Blocks, Ramp, Terrain

NUM_CYCLES = 24
"""Gait cycles of a walk. With t_g = 1 s, this number gives the paper's median height under simple control."""

_MOST_CYCLES = 200  # a testbed ends after about 30

DIGITS = 6  # significant digits of the numbers in a table

_PERCENTILES = {"min": 0, "lower": 25, "median": 50, "upper": 75, "max": 100}


@checked
@dataclass(frozen=True)
class Scenario:
    """Where ATHENA walks, and how high it lifts its feet.

    ``terrain`` is a function that returns the terrain of a layout (a whole number). ``has_layouts`` is True if there is
    more than one layout. ``apex`` [m] is the height of a swing. Raises InvalidInputError if it is not positive.
    """

    terrain: Callable[[int], Terrain]
    has_layouts: bool
    apex: float

    def __post_init__(self) -> None:
        check_function("terrain", self.terrain, "layout")
        check_number("apex", self.apex, above=0.0, unit="m")


# [m] Large enough for 24 cycles of 50 mm strokes and for drift.
_EXTENT = (-0.7, 0.7, -0.5, 3.1)

SCENARIOS: dict[str, Scenario] = {
    # The apex h/4 of A(20)-(21) with h = 120 mm, assumed.
    "ramp": Scenario(lambda layout: Ramp(), has_layouts=False, apex=0.03),
    # The apex clears the step to the diagonally opposite block, up to twice 30 mm; assumed.
    "testbed": Scenario(
        lambda layout: Blocks(size=0.2, max_step=0.03, extent=_EXTENT, seed=layout),
        has_layouts=True,
        apex=0.075,
    ),
}


@checked
def scenario_of(name: str) -> Scenario:
    """Return the scenario called ``name``. Raises UnknownNameError."""
    if name not in SCENARIOS:
        raise UnknownNameError("scenario", name, list(SCENARIOS))
    return SCENARIOS[name]


@checked
def walk(
    scenario: str,
    k_z: float,
    k_alpha: float,
    k_beta: float,
    engine: str,
    time_step: float,
    seed: int,
    layout: int,
    **unsaid: Any,
) -> dict[str, float]:
    """Simulate one walk and measure it: the trial of paper A's studies.

    ``scenario`` is ``"ramp"`` or ``"testbed"``, ``k_z``, ``k_alpha`` and ``k_beta`` are the gains, ``engine`` is the
    name of the engine and ``time_step`` [s] its step. ``seed``, ``layout`` and ``unsaid``, the choices that the paper
    leaves open, are arguments of ``simulate_walk``. The arguments and the result (see ``measure``) are columns of the
    tables of the studies. Raises the errors of ``simulate_walk`` and ``measure``.
    """
    num_cycles = unsaid.get("num_cycles", NUM_CYCLES)
    gains = {"k_z": k_z, "k_alpha": k_alpha, "k_beta": k_beta}
    recording, ground = simulate_walk(
        scenario, gains, engine=engine, time_step=time_step, seed=seed, layout=layout, **unsaid
    )
    return measure(recording, ground, num_cycles)


@checked
def simulate_walk(
    scenario: str,
    gains: Mapping[str, float],
    *,
    engine: str = "rigid",
    time_step: float = 0.001,
    seed: int = 0,
    layout: int = 0,
    num_cycles: int = NUM_CYCLES,
    stride: float = 0.05,
    apex: float | None = None,
    start_from: str = "actual",
    reference_offset: float = 0.0,
    servo_rate: float | None = None,
    foot_radius: float | None = None,
    mount_scale: float = 1.0,
    friction: float = 0.9,
    control_rate: float = 20.0,
    force_sampling: Literal["mean", "last"] = "mean",
    reading: str = "as_printed",
    max_step: float | None = None,
    block_size: float | None = None,
) -> tuple[Recording, Terrain]:
    """Simulate a walk of ATHENA in a scenario of paper A; returns the recording and the terrain.

    Raises UnknownNameError for an unknown scenario, InvalidInputError for a layout or blocks that the scenario does not
    have, for a gain that is missing and a number out of its range, and the errors of ``PostureController`` and
    ``simulate``.

    Parameters
    ----------
    scenario
        ``"ramp"`` or ``"testbed"``.
    gains
        The gains by name: ``k_z``, ``k_alpha`` and ``k_beta``.
    engine, time_step
        Name of the engine, and its time step [s].
    seed, layout
        ``seed`` draws the start and the triples of feet of the controller; ``layout`` draws the blocks of the testbed.
    num_cycles
        Number of gait cycles, at most 200.
    stride, apex
        Stride [m] and height of a swing [m]; None is the scenario's apex.
    start_from, reading
        As in ``PostureController``.
    reference_offset
        Added to the standing height [m], which is the reference height of k_z.
    servo_rate, foot_radius, mount_scale
        Changes of the robot: rate of the servos [1/s], radius of the feet [m] (None keeps either), and a factor on l_1,
        the distance of the legs' mounts from the body's centre.
    friction, control_rate, force_sampling
        As in ``simulate``; the control rate is in [1/s].
    max_step, block_size
        Largest step between blocks and size of the blocks [m] of the testbed; None is the scenario's value.
    """
    place = scenario_of(scenario)
    if missing := [name for name in GAINS if name not in gains]:
        raise InvalidInputError(f"gains: no value for {', '.join(missing)}")
    check_whole("num_cycles", num_cycles, at_least=1, at_most=_MOST_CYCLES)
    check_number("reference_offset", reference_offset, at_least=-1.0, at_most=1.0, unit="m")
    if layout != 0 and not place.has_layouts:
        raise InvalidInputError(f"layout: {layout}, but scenario {scenario!r} has one layout only, 0")
    ground = place.terrain(layout)
    if isinstance(ground, Blocks):
        ground = replace(ground, max_step=ground.max_step if max_step is None else max_step)
        ground = replace(ground, size=ground.size if block_size is None else block_size)
    elif max_step is not None or block_size is not None:
        raise InvalidInputError(f"max_step, block_size: scenario {scenario!r} has no blocks")
    robot = _changed(load_robot("athena"), servo_rate, foot_radius, mount_scale)
    controller = PostureController(
        robot,
        k_z=gains["k_z"],
        k_alpha=gains["k_alpha"],
        k_beta=gains["k_beta"],
        stride=stride,
        apex=place.apex if apex is None else apex,
        start_from=start_from,
        reading=reading,
        reference_height=standing_height(robot) + reference_offset,
        seed=seed,
    )
    recording = simulate(
        robot,
        ground,
        controller,
        engine=engine,
        max_cycles=num_cycles,
        # A cycle takes longer when feet search for the ground.
        duration=2.0 * num_cycles * controller.phases_per_cycle * controller.phase_duration,
        time_step=time_step,
        control_rate=control_rate,
        friction=friction,
        seed=seed,
        force_sampling=force_sampling,
    )
    return recording, ground


@checked
def measure(recording: Recording, ground: Terrain, num_cycles: int = NUM_CYCLES) -> dict[str, float]:
    """Measures of a walk over its first ``num_cycles`` gait cycles, by column name.

    ``recording`` is the walk and ``ground`` its terrain. Raises SimulationError if the recording contains fewer whole
    cycles, and InvalidInputError unless ``num_cycles`` is at least 1.

    A quantity with many values has five columns: ``<quantity>_min``, ``_lower`` (quartile), ``_median``, ``_upper`` and
    ``_max``. These quantities are:

    - per gait cycle: ``height`` [m], and ``pitch_rate`` and ``roll_rate`` [rad/s], which are root mean squares over
      every physics step (``pitch_rate_tick`` and ``roll_rate_tick``: over control ticks only);
    - per control tick: ``pitch_angle`` and ``roll_angle`` [rad] of the torso relative to the mean plane of the ground
      (A Fig. 8);
    - per control tick without contact of the torso or a limb: ``zmp_distance`` [m], from the ZMP to the centroid of the
      loaded feet's polygon, and ``stability_margin`` [m]. The ending ``_all`` stands for all ticks, ``_stance`` for the
      polygon of the feet that are commanded to be in stance, and ``_stance_all`` for both.

    These have one column each:

    - ``cycles``, the number of measured cycles;
    - ``torso_contact`` and ``limb_contact``, shares of ticks with such a contact;
    - ``distance`` [m] forward along the ground, and ``drift`` [m] to the right;
    - ``zmp_used``, the share of ticks that ``zmp_distance`` is computed from;
    - ``zmp_outside_loaded`` and ``zmp_outside_stance`` (and both with ``_all``), shares of ticks with the ZMP outside
      the polygon;
    - ``extending`` and ``limited``, shares of ticks in which feet search for the ground, or are clipped at a limit;
    - ``penetration`` [m] and ``solver_residual``, the largest values.
    """
    check_whole("num_cycles", num_cycles, at_least=1)
    cycles, ticks = per_cycle(recording), per_cycle(recording, rates="ticks")
    if len(cycles.height) < num_cycles:
        raise SimulationError(f"only {len(cycles.height)} of {num_cycles} gait cycles in {recording.time[-1]:.0f} s")
    first = slice(num_cycles)
    used = recording.cycle < num_cycles
    values: dict[str, float] = {"cycles": num_cycles}
    for name in ("height", "pitch_rate", "roll_rate"):
        values |= five_columns(name, getattr(cycles, name)[first])
    for name in ("pitch_rate", "roll_rate"):
        values |= five_columns(f"{name}_tick", getattr(ticks, name)[first])
    pitch, roll = _tilt(recording, ground)
    values |= five_columns("pitch_angle", pitch[used]) | five_columns("roll_angle", roll[used])
    loaded, stance = series(recording, "loaded"), series(recording, "stance")
    free = used & ~loaded.body_touches
    for polygon, stability in (("", loaded), ("_stance", stance)):
        for ticks_used, mask in (("", free), ("_all", used)):
            counted = mask & stability.defined
            values |= five_columns(f"zmp_distance{polygon}{ticks_used}", stability.centroid_distance[counted])
            values |= five_columns(f"stability_margin{polygon}{ticks_used}", stability.margin[counted])
            outside = np.mean(stability.margin[counted] < -_ROUNDING) if counted.any() else np.nan
            values[f"zmp_outside{polygon or '_loaded'}{ticks_used}"] = float(outside)
    values["zmp_used"] = float(np.mean(loaded.defined[used] & free[used]))
    values["torso_contact"] = float(np.mean(recording.torso_force[used] > 0.0))
    values["limb_contact"] = float(np.mean(recording.limb_force[used] > 0.0))
    start, last = recording.T_world_body[0], recording.T_world_body[np.flatnonzero(used)[-1]]
    way = start[:3, :3].T @ (last[:3, 3] - start[:3, 3])
    values["distance"], values["drift"] = float(way @ recording.forward), float(way @ recording.right)
    values["extending"] = float(np.mean(recording.extending[used]))
    values["limited"] = float(np.mean(recording.limited[used].any(axis=-1)))
    values["penetration"] = float(recording.penetration[used].max())
    values["solver_residual"] = float(recording.solver_residual[used].max())
    return {name: float(f"{value:.{DIGITS}g}") for name, value in values.items()}


_ROUNDING = 1e-9  # [m] with two loaded feet, the ZMP of A(32) lies exactly on an edge


@checked
def five_columns(name: str, values: ArrayLike) -> dict[str, float]:
    """Minimum, quartiles and maximum of a sample as the columns ``<name>_min``, ``_lower``, ``_median``, ...

    ``values`` (n,), in any unit, are the sample. All columns of an empty sample are NaN. Raises InvalidInputError for
    another shape and for values that are not finite.
    """
    sample = check_shape("values", values, (None,))
    found = np.percentile(sample, list(_PERCENTILES.values())) if sample.size else np.full(len(_PERCENTILES), np.nan)
    return {f"{name}_{statistic}": float(value) for statistic, value in zip(_PERCENTILES, found, strict=True)}


def _tilt(recording: Recording, ground: Terrain) -> tuple[Array, Array]:
    """Pitch and roll (n,) [rad] of the mean ground plane relative to the torso; blocks are level on average."""
    robot = load_robot("athena")
    normal = ground.normal(0.0, 0.0) @ recording.T_world_body[:, :3, :3]
    pitch, roll = np.array([slope_angles(robot, n) for n in normal]).T
    return pitch, roll


def _changed(robot: Robot, servo_rate: float | None, foot_radius: float | None, mount_scale: float) -> Robot:
    """Return the robot with the changes that ``simulate_walk`` describes."""
    if servo_rate is not None:
        check_number("servo_rate", servo_rate, at_least=0.1, at_most=1e4, unit="1/s")
        robot = replace(robot, servo=replace(robot.servo, rate=servo_rate))
    if foot_radius is not None:
        check_number("foot_radius", foot_radius, above=0.0, at_most=1.0, unit="m")
        size = np.full(3, 2.0 * foot_radius)
        inertia = 0.4 * robot.foot.mass * foot_radius**2 * np.eye(3)  # a solid sphere
        robot = replace(robot, foot=replace(robot.foot, size=size, inertia=inertia))
    if check_number("mount_scale", mount_scale, at_least=0.1, at_most=10.0) != 1.0:
        legs = tuple(Leg(leg.name, {**leg.values, "l_1": mount_scale * leg.values["l_1"]}) for leg in robot.legs)
        robot = replace(robot, legs=legs)
    return robot


if not TYPE_CHECKING:  # type checkers know the new names only
    __getattr__ = renamed(__name__, {"summary": ("five_columns", five_columns)})
