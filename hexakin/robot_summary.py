"""A page of text about a robot: its description, values that follow from it, and remarks on unusual values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from hexakin.exceptions import renamed
from hexakin.kinematics.forward import forward_kinematics, standing_height
from hexakin.kinematics.leg_functions import closed_form, reach
from hexakin.motion.clearance import torso_gaps
from hexakin.robot.model import SEGMENT_NAMES, Body, Robot
from hexakin.robot.plausibility import most_inertia, principal_moments
from hexakin.stability.polygon import margin as edge_distance
from hexakin.stability.polygon import support_polygon
from hexakin.terrain.planes import Plane
from hexakin.transforms import pose
from hexakin.walking.gait import tripod

_LEVEL = 1e-3  # [m] largest height difference between feet of the standing pose that counts as level
_MARGIN = np.deg2rad(1.0)  # [rad] smallest limit margin of a joint in the standing pose that gets no remark
_SAME = 1e-3  # [m] first joints of two legs that are closer than this count as one place
_TINY = 1e-4  # [m] a length above 0 and below this may be in another unit
# Servo torque divided by the torque with which one stretched leg carries the robot; 0.4 for paper A's servos.
_STRENGTH = (0.02, 20.0)
_SHARE = 0.2  # of a uniform box's largest moment: a body below this has its mass almost in one point


def summarise(robot: Robot) -> str:
    """Return the page of text that ``python -m hexakin robot`` prints; lengths in mm, angles in degrees.

    For every body it gives the principal moments of inertia beside those of a full uniform box of the same size and
    mass; for every leg type, the smallest and largest distance of the foot from the second joint. Its last lines are
    those of ``remarks``.
    """
    lines = [f"{robot.name}: {robot.num_legs} legs, {robot.mass:.4g} kg"]
    if robot.reference:
        lines.append(f"  {' '.join(robot.reference.split())}")
    for part in (_masses, _inertias, _reach, _standing, _limits, _rest):
        lines += ["", *part(robot)]
    found = remarks(robot)
    return "\n".join([*lines, "", *(f"remark: {remark}" for remark in found)] if found else lines) + "\n"


def remarks(robot: Robot) -> tuple[str, ...]:
    """Return remarks on unusual but allowed values of a robot; each is a sentence that starts with the field's name."""
    return tuple(remark for part in (_body_remarks, _standing_remarks, _leg_remarks) for remark in part(robot))


def _parts(robot: Robot) -> dict[str, tuple[Body, int]]:
    """Return each body and how many of it the robot has, by the path of its field."""
    limbs = {f"segments.{name}": (robot.segments[name], robot.num_legs) for name in SEGMENT_NAMES}
    return {"torso": (robot.torso, 1), **limbs, "foot": (robot.foot, robot.num_legs)}


def _masses(robot: Robot) -> Iterator[str]:
    yield "masses"
    for where, (body, count) in _parts(robot).items():
        total = f"{count} x {body.mass:.4g} kg" if count > 1 else f"{body.mass:.4g} kg"
        yield f"  {where:15} {total:>15} {100.0 * count * body.mass / robot.mass:5.1f} %"


def _inertias(robot: Robot) -> Iterator[str]:
    yield "principal moments of inertia, positive and within the triangle inequality, and those of a full uniform box"
    for where, (body, _) in _parts(robot).items():
        moments = " ".join(f"{moment:9.3g}" for moment in principal_moments(body))
        box = "" if where == "foot" else " ".join(f"{moment:9.3g}" for moment in np.sort(most_inertia(body) / 3.0))
        yield f"  {where:15} {moments} kg m^2   {box}".rstrip()


def _reach(robot: Robot) -> Iterator[str]:
    yield "reach of the foot from the second joint, and within the joint limits"
    widest, limited = reach(robot), reach(robot, limited=True)
    kinds: dict[tuple[float, ...], list[int]] = {}
    for leg, values in enumerate(np.hstack([widest, limited])):
        kinds.setdefault(tuple(np.round(values, 7)), []).append(leg + 1)
    for (inner, outer, low, high), legs in kinds.items():
        which = "all legs" if len(legs) == robot.num_legs else f"legs {', '.join(map(str, legs))}"
        yield f"  {which}: {1e3 * inner:.1f} to {1e3 * outer:.1f} mm, {1e3 * low:.1f} to {1e3 * high:.1f} mm"


def _torso_clearance(robot: Robot) -> float:
    """Gap [m] between torso and ground in the standing pose."""
    return float(torso_gaps(robot, Plane(), pose(np.eye(3), [0.0, 0.0, standing_height(robot)])))


def _standing(robot: Robot) -> Iterator[str]:
    limit_margins = np.minimum(robot.standing_q - robot.q_min, robot.q_max - robot.standing_q).min(axis=-1)
    yield f"standing, the body's origin {1e3 * standing_height(robot):.1f} mm above the ground"
    yield f"  torso's underside {1e3 * _torso_clearance(robot):.1f} mm above the ground"
    feet = forward_kinematics(robot, robot.standing_q)
    for leg, foot, limit_margin in zip(robot.legs, feet, np.rad2deg(limit_margins), strict=True):
        place = ", ".join(f"{1e3 * coordinate + 0.0:.1f}" for coordinate in foot)
        yield f"  {leg.name:15} foot at ({place}) mm, {limit_margin:.1f} deg from the nearest joint limit"


def _limits(robot: Robot) -> Iterator[str]:
    yield "joint limits"
    for joint, ranges in zip(robot.table.joints, np.rad2deg(robot.joint_limits).swapaxes(0, 1), strict=True):
        kinds = {tuple(np.round(limits, 3)): None for limits in ranges}
        yield f"  {joint:15} " + ", ".join(f"{low:g} to {high:g}" for low, high in kinds) + " deg"


def _rest(robot: Robot) -> Iterator[str]:
    servo = robot.servo
    speed = "no speed limit given" if servo.max_speed is None else f"at most {servo.max_speed:g} rad/s"
    yield f"servo: {servo.max_torque:g} N m, {speed}, {servo.rate:g} rad/s per rad of lag"
    known = "in closed form" if closed_form(robot.table) else "not known in closed form: found numerically"
    yield f"inverse kinematics: {known}"


def _body_remarks(robot: Robot) -> Iterator[str]:
    for where, (body, _) in _parts(robot).items():
        if where == "foot":
            continue
        most = most_inertia(body)
        over = np.diag(body.inertia) / most
        if over.max() > 1.0 + 1e-9:
            axis = "xyz"[int(over.argmax())]
            yield f"{where}.inertia.{axis * 2}: {over.max():.3g} times the largest that mass within its box can have"
        elif principal_moments(body)[2] < _SHARE * most.max() / 3.0:
            yield f"{where}.inertia: less than {_SHARE:g} of a uniform box's, as if all mass were in one point"
    if robot.foot_radius == 0.0:
        yield "foot.radius: 0, a point: enough for kinematics, but a simulation needs a radius"


def _standing_remarks(robot: Robot) -> Iterator[str]:
    heights = forward_kinematics(robot, robot.standing_q)[:, 2]
    if np.ptp(heights) > _LEVEL:
        leg = int(heights.argmax()) + 1
        yield f"standing: the feet are not level, leg {leg}'s is {1e3 * np.ptp(heights):.3g} mm above the lowest"
    torso_clearance = _torso_clearance(robot)
    if torso_clearance <= 0.0:
        yield f"standing: the torso's underside is {-1e3 * torso_clearance:.3g} mm below the ground"
    limit_margins = np.minimum(robot.standing_q - robot.q_min, robot.q_max - robot.standing_q)
    if limit_margins.min() < _MARGIN:
        leg, joint = (int(index) for index in np.unravel_index(int(limit_margins.argmin()), limit_margins.shape))
        limit_margin = np.rad2deg(limit_margins.min())
        yield f"standing.{robot.table.joints[joint]} of leg {leg + 1}: {limit_margin:.2g} deg from its limit"


def _leg_remarks(robot: Robot) -> Iterator[str]:
    lengths = {entry for motion, entry in robot.table.motions if motion[0] == "t"}
    for name in robot.table.parameters:
        values = np.array([abs(leg.values[name]) for leg in robot.legs if leg.values[name] != 0.0])
        if name in lengths and len(values) and values.min() < _TINY:
            yield f"parameters.{name}: {values.min():g} m; is it in m?"
    hips = np.array([robot.fixed_poses(leg)[0, :3, 3] for leg in range(robot.num_legs)])
    gaps = np.linalg.norm(hips[:, None] - hips[None], axis=-1) + np.diag(np.full(robot.num_legs, np.inf))
    if gaps.min() < _SAME:
        one, other = (int(index) for index in np.unravel_index(int(gaps.argmin()), gaps.shape))
        yield f"legs: legs {one + 1} and {other + 1} start at the same place"
    yield from _tripod_remarks(robot)
    stretched = float(np.linalg.norm(robot.fixed_poses(0)[1:, :3, 3], axis=-1).sum())
    strength = robot.servo.max_torque / (robot.weight * stretched)
    if not _STRENGTH[0] <= strength <= _STRENGTH[1]:
        need = f"{strength:.3g} times what one stretched leg needs to carry the robot"
        yield f"servo.max_torque: {robot.servo.max_torque:g} N m is {need}; is it in N m?"
    if robot.servo.max_speed is None:
        yield "servo.max_speed: not given; feasibility checks then do not check joint speeds"


def _tripod_remarks(robot: Robot) -> Iterator[str]:
    """Return a remark if six legs are not listed around the body.

    The tripod gait then stands on three legs that do not surround the centre of mass.
    """
    if robot.num_legs != 6:
        return
    feet = forward_kinematics(robot, robot.standing_q)
    for group in tripod(robot).groups:
        if not edge_distance(robot.torso.center_of_mass[:2], support_polygon(feet[list(group)])) > 0.0:
            legs = ", ".join(str(leg + 1) for leg in group)
            yield f"legs: the tripod gait stands on legs {legs}, which cannot support the body; list legs in order"
            return


if not TYPE_CHECKING:  # type checkers know the new names only
    __getattr__ = renamed(__name__, {"summary": ("summarise", summarise)})
