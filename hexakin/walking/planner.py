"""Paper B's walking algorithm: footholds on the terrain, cycloids between them, and the body's path (B section 3).

A step of the walk is one period. Each group of legs of the gait swings in its share of the period, and the body
advances by the mean step of the legs (B(24), whose half period is half a step).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_angle, check_array, check_number, check_whole, checked
from hexakin.exceptions import InvalidInputError, UnknownNameError, shown
from hexakin.kinematics.forward import forward_kinematics, standing_height
from hexakin.kinematics.inverse import path_inverse_kinematics, raise_if_impossible
from hexakin.motion.motion import motion_of
from hexakin.motion.recording import MOST_TICKS
from hexakin.motion.walk_plan import WalkPlan
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain
from hexakin.terrain.leg_curves import LegCurves
from hexakin.transforms import inverse_pose, transform_points
from hexakin.walking.body_path import body_poses
from hexakin.walking.foot_tracks import START_OFFSETS, Course, swing_arches
from hexakin.walking.gait import LONGEST_PHASE, Gait, tripod
from hexakin.walking.swing import adapted_cycloid

BODY_MOTIONS = ("fixed", "sinusoidal")
HEIGHT_REFERENCES = ("footholds", "start")
ORIENTATIONS = ("level", "parallel")


@checked
@dataclass(frozen=True)
class WalkReport:
    """Measures of a plan, as ``check_plan`` returns them.

    Parameters
    ----------
    stance_drift
        Largest distance [m] that a foot in stance moves in the world between two samples.
    largest_foot_step, largest_joint_step
        Largest change of a foot position [m] and of a joint angle [rad] between two samples. If the paths are
        continuous, they halve when the number of samples doubles.
    lowest_clearance, clearance_leg, clearance_time
        Smallest height [m] of a swinging foot above the terrain, with its leg (1-based) and time [s].
    limit_margin
        Smallest distance [rad] of a joint angle from its limit; negative beyond the limit.
    closure
        Largest distance [m] between the planned feet and the feet computed from the joint angles.
    advance_error
        Largest difference [m] between the advance of the body in a step and the mean step of the legs.
    fewest_standing
        Smallest number of feet in stance. With fewer than three there is no static balance.
    """

    stance_drift: float
    largest_foot_step: float
    largest_joint_step: float
    lowest_clearance: float
    clearance_leg: int
    clearance_time: float
    limit_margin: float
    closure: float
    advance_error: float
    fewest_standing: int


@checked
def plan_walk(
    robot: Robot,
    terrain: Terrain | LegCurves,
    num_steps: int = 7,
    step_length: float = 0.05,
    heading: float = 0.0,
    samples_per_step: int = 100,
    body_height: float | None = None,
    body_motion: Literal["fixed", "sinusoidal"] = "fixed",
    *,
    amplitude: float = 0.01,
    period: float = 0.5,
    height_reference: Literal["footholds", "start"] = "footholds",
    height_along: Literal["vertical", "normal"] = "vertical",
    body_orientation: Literal["level", "parallel"] | ArrayLike = "level",
    start: tuple[float, float] = (0.0, 0.0),
    yaw: float = 0.0,
    start_offsets: Literal["stable", "B15", "B16"] = "stable",
    first_group: int = 0,
    arch: float | Literal["clear"] = 1.0,
    step_duration: float = 2.0,
    gait: Gait | None = None,
    on_failure: Literal["raise", "mark"] = "raise",
) -> WalkPlan:
    """Plan a walk over a terrain (B Steps 1-17).

    Returns a ``WalkPlan`` with n = num_steps * samples_per_step + 1 samples. Raises UnreachableError or JointLimitError
    for a target out of reach or beyond a joint limit, ClearanceError for a swing that cannot clear the terrain,
    UnknownNameError for an unknown option, and InvalidInputError for any other argument that cannot be used.

    Parameters
    ----------
    robot, terrain
        A robot with the gait's number of legs; a terrain with heights and normals, or the curves of paper B.
    num_steps, step_length, samples_per_step
        Number of steps, their length [m], and the number of samples in each step, at least two per swing.
    heading
        Direction of walking [rad] relative to the body's forward axis; the body does not turn.
    body_height
        Height [m] of the body's origin; None is that of the standing pose.
    body_motion, amplitude, period
        The height of the body is ``"fixed"``, or ``"sinusoidal"`` with this amplitude [m] and period [steps].
    height_reference
        The body height is measured from the mean of the current ``"footholds"``, or from their mean at the ``"start"``.
    height_along
        Direction of the height of a body that is ``"parallel"`` to the ground: ``"vertical"`` over the mean of the
        footholds, as in B(24)-(25), or along the body's ``"normal"``. With the latter the legs keep their pose, but
        the body moves downhill.
    body_orientation
        ``"level"``, ``"parallel"`` to the plane that fits the footholds best, or roll, pitch and yaw (3,) or
        (n, 3) [rad] about the body's x, y and z axes, for the n samples.
    start, yaw
        Horizontal position (2,) [m] around which the standing footholds lie, and rotation of the body about the
        vertical [rad]. The body itself starts over the mean of the first footholds, which lie up to a quarter step
        further ahead, depending on ``start_offsets``.
    start_offsets
        ``"stable"``: legs that swing later start further ahead, so that all strokes are centred. ``"B15"`` and
        ``"B16"`` are as printed in the paper: legs 2, 4, 6 start half a step behind, or leg 2 ahead and legs 4, 6
        behind (B-E2).
    first_group
        Index (from 0) of the group of the gait that swings first.
    arch
        Height of a swing as a multiple of the height of the paper's cycloid. ``"clear"`` uses for each swing the
        smallest of 1, 1.25, 1.5, ... that clears the terrain.
    step_duration
        Duration of a step [s].
    gait
        The gait; None is the tripod.
    on_failure
        ``"raise"`` raises an error with leg and time if a target is out of reach or an angle beyond its limit;
        ``"mark"`` returns the plan with flags for these samples.
    """
    arguments = dict(locals())
    gait = _check(arguments)
    course = Course(
        robot,
        terrain,
        gait,
        step_length,
        heading=heading,
        start=start,
        yaw=yaw,
        start_offsets=start_offsets,
        first_group=first_group,
    )

    num_samples = num_steps * samples_per_step + 1
    sample = np.arange(num_samples)
    progress = sample / samples_per_step  # in steps
    step = np.minimum(sample // samples_per_step, num_steps - 1)
    # Completed part of each leg's swing, in whole numbers until the end, so that swings begin and end exactly.
    done = (sample - step * samples_per_step)[:, None] * gait.phases_per_cycle - course.order * samples_per_step
    phase = np.clip(done, 0, samples_per_step) / samples_per_step

    ground = course.ground(np.arange(num_steps + 1))
    centers = ground + robot.foot_radius * course.normal(ground)
    arches = swing_arches(course, centers, num_steps, arch)
    p_world_foot = adapted_cycloid(centers[step], centers[step + 1], phase, arches[step])
    # At the ends of a swing, use the foothold itself, so that a foot in stance has exactly one position.
    p_world_foot = np.where((phase == 0.0)[..., None], centers[step], p_world_foot)
    p_world_foot = np.where((phase == 1.0)[..., None], centers[step + 1], p_world_foot)
    stance = (phase == 0.0) | (phase == 1.0)

    height = standing_height(robot) if body_height is None else body_height
    sway = amplitude * np.sin(2.0 * np.pi * progress / period) if body_motion == "sinusoidal" else np.zeros(num_samples)
    T_world_body = body_poses(
        course,
        ground,
        progress,
        step,
        height=height + sway,
        height_reference=height_reference,
        height_along=height_along,
        orientation=body_orientation,
        yaw=yaw,
    )

    solution = path_inverse_kinematics(robot, transform_points(inverse_pose(T_world_body), p_world_foot))
    time = step_duration * progress
    if on_failure == "raise":
        raise_if_impossible(robot, solution, time)
    return WalkPlan(
        time=time,
        T_world_body=T_world_body,
        p_world_foot=p_world_foot,
        q=solution.q,
        stance=stance,
        reachable=solution.reachable,
        within_limits=solution.within_limits,
        footholds=ground,
        ground_height=course.ground_under(p_world_foot, centers, step),
        arch=arches,
        foot_radius=robot.foot_radius,
        parameters=arguments
        | {"robot": robot.name, "terrain": repr(terrain), "body_height": height, "gait": gait.name},
    )


@checked
def check_plan(robot: Robot, plan: WalkPlan) -> WalkReport:
    """Measure the accuracy, continuity and limits of a ``plan`` of paper B for its robot; see ``WalkReport``.

    Measures of joint angles are NaN if no target of the plan is reachable.
    """
    body_foot = motion_of(robot, plan).p_body_foot
    held = plan.stance[1:] & plan.stance[:-1]
    moved = np.linalg.norm(np.diff(plan.p_world_foot, axis=0), axis=-1)
    swung = np.where(plan.stance, np.inf, plan.clearance)
    at, leg = np.unravel_index(int(np.argmin(swung)), swung.shape)
    usable = np.where(plan.reachable[..., None], plan.q, 0.0)
    gap = np.linalg.norm(forward_kinematics(robot, usable) - body_foot, axis=-1)[plan.reachable]
    margin = np.minimum(plan.q - robot.q_min, robot.q_max - plan.q)[plan.reachable]
    turned = np.abs(np.diff(plan.q, axis=0))
    turned = turned[np.isfinite(turned)]
    per_step = (len(plan.time) - 1) // plan.parameters["num_steps"]
    mean_step = np.diff(plan.footholds.mean(axis=1)[:, :2], axis=0)
    advance = np.diff(plan.T_world_body[::per_step, :2, 3], axis=0)
    return WalkReport(
        stance_drift=float(moved[held].max(initial=0.0)),
        largest_foot_step=float(moved.max()),
        largest_joint_step=_largest(turned),
        lowest_clearance=float(swung[at, leg]),
        clearance_leg=int(leg) + 1,
        clearance_time=float(plan.time[at]),
        limit_margin=-_largest(-margin),
        closure=_largest(gap),
        advance_error=float(np.abs(advance - mean_step).max()),
        fewest_standing=int(plan.stance.sum(axis=1).min()),
    )


def _largest(values: Array) -> float:
    return float(values.max()) if values.size else float("nan")


def _check(arguments: dict[str, Any]) -> Gait:
    """Return the gait; raise InvalidInputError or UnknownNameError for an argument that cannot be used."""
    a = arguments
    robot = a["robot"]
    if isinstance(a["terrain"], LegCurves) and a["terrain"].num_legs != robot.num_legs:
        raise InvalidInputError(f"terrain: curves for {a['terrain'].num_legs} legs, {robot.name} has {robot.num_legs}")
    if a["gait"] is not None and not isinstance(a["gait"], Gait):
        raise InvalidInputError(f"gait: expected a hexakin.gait.Gait, got {shown(a['gait'])}")
    gait: Gait = tripod(robot) if a["gait"] is None else a["gait"]
    if gait.num_legs != robot.num_legs:
        raise InvalidInputError(f"gait: {gait.name} is for {gait.num_legs} legs, {robot.name} has {robot.num_legs}")
    if not gait.has_equal_phases:
        raise InvalidInputError(
            f"gait: swings of {gait.name} overlap or leave pauses; in B's walk one group swings after the other "
            "(hexakin.steering.SteeringController accepts any gait)"
        )
    check_whole("num_steps", a["num_steps"], at_least=1)
    check_whole("samples_per_step", a["samples_per_step"], at_least=2 * gait.phases_per_cycle)
    samples = a["num_steps"] * a["samples_per_step"]
    if samples > MOST_TICKS:
        raise InvalidInputError(f"num_steps, samples_per_step: {samples} samples, expected at most {MOST_TICKS}")
    if check_whole("first_group", a["first_group"]) >= gait.phases_per_cycle:
        raise InvalidInputError(f"first_group: {a['first_group']}, but {gait.name} has {gait.phases_per_cycle} groups")
    check_number("step_length", a["step_length"], at_least=0.0, unit="m")
    for name in ("heading", "yaw"):
        check_angle(name, a[name])
    check_number("amplitude", a["amplitude"], unit="m")
    check_number("period", a["period"], above=0.0, unit="steps")
    check_number("step_duration", a["step_duration"], above=0.0, at_most=LONGEST_PHASE, unit="s")
    if a["body_height"] is not None:
        check_number("body_height", a["body_height"], above=0.0, unit="m")
    if not isinstance(a["arch"], str) or a["arch"] != "clear":
        check_number("arch", a["arch"], above=0.0)
    check_array("start", a["start"], (2,), ("coordinate",))
    choices: dict[str, tuple[str, ...]] = {
        "body_motion": BODY_MOTIONS,
        "height_reference": HEIGHT_REFERENCES,
        "height_along": ("vertical", "normal"),
        "start_offsets": START_OFFSETS,
        "on_failure": ("raise", "mark"),
    }
    for name, choice in choices.items():
        if not isinstance(a[name], str) or a[name] not in choice:
            raise UnknownNameError(name, a[name], list(choice))
    if isinstance(a["body_orientation"], str):
        if a["body_orientation"] not in ORIENTATIONS:
            raise UnknownNameError("body_orientation", a["body_orientation"], [*ORIENTATIONS, "an array of angles"])
    else:
        n = samples + 1
        rpy = check_array("body_orientation", a["body_orientation"], (3,), ("angle",))
        if rpy.shape not in ((3,), (n, 3)):
            raise InvalidInputError(f"body_orientation: expected shape (3,) or ({n}, 3), got {rpy.shape}")
    return gait
