"""Paper A's experiment: a walk on the ramp or the testbed, and what is measured of it (A section 5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array
from hexakin.control.ground_plane import slope_angles
from hexakin.control.posture import PostureController
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.kinematics.forward import standing_height
from hexakin.motion.measures import per_cycle
from hexakin.motion.recording import Recording
from hexakin.robot.file import load_robot
from hexakin.robot.model import Leg, Robot
from hexakin.simulation.closed_loop import simulate
from hexakin.stability.time_series import series
from hexakin.terrain import Blocks, Ramp, Terrain

NUM_CYCLES = 24
"""Gait cycles of a run: with t_g = 1 s they give simple control the paper's median height."""

DIGITS = 6  # significant ones that a table keeps

_SUMMARY = {"min": 0, "lower": 25, "median": 50, "upper": 75, "max": 100}


@dataclass(frozen=True)
class Scenario:
    """Where ATHENA walks: the terrain of each layout, whether there are several, and the apex of a swing [m]."""

    terrain: Callable[[int], Terrain]
    has_layouts: bool
    apex: float


# As far as 24 cycles of 50 mm strokes lead, and room to drift.
_EXTENT = (-0.7, 0.7, -0.5, 3.1)

SCENARIOS: dict[str, Scenario] = {
    # The apex h/4 of A(20)-(21) with h = 120 mm, assumed.
    "ramp": Scenario(lambda layout: Ramp(), has_layouts=False, apex=0.03),
    # The apex clears the step to the block across a corner, two steps of 30 mm; assumed.
    "testbed": Scenario(
        lambda layout: Blocks(size=0.2, max_step=0.03, extent=_EXTENT, seed=layout),
        has_layouts=True,
        apex=0.075,
    ),
}


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
    """Walk once and measure: the trial of paper A's studies. Arguments and result are columns of their tables.

    ``unsaid`` are arguments of ``simulate_walk`` that the paper leaves open.
    """
    num_cycles = unsaid.get("num_cycles", NUM_CYCLES)
    gains = {"k_z": k_z, "k_alpha": k_alpha, "k_beta": k_beta}
    recording, ground = simulate_walk(
        scenario, gains, engine=engine, time_step=time_step, seed=seed, layout=layout, **unsaid
    )
    return measure(recording, ground, num_cycles)


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
    """Walk ATHENA over a scenario; returns the recording and the ground.

    ``seed`` draws the start and the controller's triples of feet, ``layout`` the testbed's blocks. What the paper
    leaves open: ``stride``, ``apex`` (None is the scenario's), ``foot_radius`` and ``reference_offset`` [m], which is
    added to the standing height that k_z pulls to; ``servo_rate`` [1/s]; ``mount_scale``, a factor on l_1, the distance
    of the legs' mounts from the body's centre; ``max_step`` and ``block_size`` [m] of the testbed, None the scenario's;
    and the arguments of ``PostureController`` and ``simulate`` of the same names.
    """
    if scenario not in SCENARIOS:
        raise UnknownNameError("scenario", scenario, list(SCENARIOS))
    place = SCENARIOS[scenario]
    if layout != 0 and not place.has_layouts:
        raise InvalidInputError(f"layout: {layout}, but scenario {scenario!r} has one layout only, 0")
    ground = place.terrain(layout)
    if isinstance(ground, Blocks):
        ground = replace(ground, max_step=ground.max_step if max_step is None else max_step)
        ground = replace(ground, size=ground.size if block_size is None else block_size)
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
        # Feet that reach for lost ground make a cycle longer.
        duration=2.0 * num_cycles * controller.phases_per_cycle * controller.phase_duration,
        time_step=time_step,
        control_rate=control_rate,
        friction=friction,
        seed=seed,
        force_sampling=force_sampling,
    )
    return recording, ground


def measure(recording: Recording, ground: Terrain, num_cycles: int = NUM_CYCLES) -> dict[str, float]:
    """Measures of a walk over its first ``num_cycles`` gait cycles, by column name.

    A ``quantity`` of which there are many values has five columns, ``quantity_min``, ``_lower`` (quartile),
    ``_median``, ``_upper`` and ``_max``. Per gait cycle: ``height`` [m], ``pitch_rate`` and ``roll_rate`` [rad/s], root
    mean squares over every physics step (``..._tick`` over control ticks alone). Per control tick: ``pitch_angle``
    and ``roll_angle`` [rad] of the torso against the ground's mean plane (A Fig. 8); ``zmp_distance`` from the ZMP to
    the centroid of the loaded feet's polygon and ``stability_margin`` [m], without ticks in which the torso or a limb
    touches the ground; with ``_all``, over all ticks; with ``_stance``, for the polygon of the commanded stance feet;
    and with ``_stance_all``.

    Single columns: ``cycles`` measured; ``torso_contact`` and ``limb_contact``, shares of ticks; ``distance`` [m]
    forward along the ground and ``drift`` [m] to the right; ``zmp_used``, the share of ticks behind ``zmp_distance``;
    ``zmp_outside_loaded`` and ``zmp_outside_stance`` (with ``_all`` likewise), shares of ticks in which the ZMP leaves
    the polygon; ``extending`` and ``limited``, shares of ticks in which feet reach for lost ground or are clipped at a
    limit; ``penetration`` [m], the deepest; ``solver_residual``, the largest.

    Raises SimulationError if the recording holds fewer whole cycles.
    """
    cycles, ticks = per_cycle(recording), per_cycle(recording, rates="ticks")
    if len(cycles.height) < num_cycles:
        raise SimulationError(f"only {len(cycles.height)} of {num_cycles} gait cycles in {recording.time[-1]:.0f} s")
    first = slice(num_cycles)
    used = recording.cycle < num_cycles
    values: dict[str, float] = {"cycles": num_cycles}
    for name in ("height", "pitch_rate", "roll_rate"):
        values |= summary(name, getattr(cycles, name)[first])
    for name in ("pitch_rate", "roll_rate"):
        values |= summary(f"{name}_tick", getattr(ticks, name)[first])
    pitch, roll = _tilt(recording, ground)
    values |= summary("pitch_angle", pitch[used]) | summary("roll_angle", roll[used])
    loaded, stance = series(recording, "loaded"), series(recording, "stance")
    free = used & ~loaded.body_touches
    for polygon, stability in (("", loaded), ("_stance", stance)):
        for ticks_used, mask in (("", free), ("_all", used)):
            counted = mask & stability.defined
            values |= summary(f"zmp_distance{polygon}{ticks_used}", stability.centroid_distance[counted])
            values |= summary(f"stability_margin{polygon}{ticks_used}", stability.margin[counted])
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


_ROUNDING = 1e-9  # [m] A(32) puts the ZMP of two loaded feet onto an edge


def summary(name: str, values: ArrayLike) -> dict[str, float]:
    """Smallest, quartiles and largest of a sample as columns ``<name>_min`` ...; NaN of an empty sample."""
    sample = np.asarray(values, dtype=float)
    found = np.percentile(sample, list(_SUMMARY.values())) if sample.size else np.full(len(_SUMMARY), np.nan)
    return {f"{name}_{statistic}": float(value) for statistic, value in zip(_SUMMARY, found, strict=True)}


def _tilt(recording: Recording, ground: Terrain) -> tuple[Array, Array]:
    """Pitch and roll (n,) [rad] of the mean ground seen from the torso; blocks are level on average."""
    robot = load_robot("athena")
    normal = ground.normal(0.0, 0.0) @ recording.T_world_body[:, :3, :3]
    pitch, roll = np.array([slope_angles(robot, n) for n in normal]).T
    return pitch, roll


def _changed(robot: Robot, servo_rate: float | None, foot_radius: float | None, mount_scale: float) -> Robot:
    if servo_rate is not None:
        robot = replace(robot, servo=replace(robot.servo, rate=servo_rate))
    if foot_radius is not None:
        size = np.full(3, 2.0 * foot_radius)
        inertia = 0.4 * robot.foot.mass * foot_radius**2 * np.eye(3)  # a solid sphere
        robot = replace(robot, foot=replace(robot.foot, size=size, inertia=inertia))
    if mount_scale != 1.0:
        legs = tuple(Leg(leg.name, {**leg.values, "l_1": mount_scale * leg.values["l_1"]}) for leg in robot.legs)
        robot = replace(robot, legs=legs)
    return robot
