"""Build a ``Robot`` from the fields of a robot description, with the checks that need more than one field."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hexakin.checks import Array
from hexakin.robot.leg_table import DHRow, LegTable, pi_multiple
from hexakin.robot.model import SEGMENT_NAMES, Body, Leg, Robot, Servo
from hexakin.robot.plausibility import check_body, check_foot
from hexakin.robot.schema import ANGLE, LENGTH, OFFSET, BodyFields, FieldError, InertiaFields, RobotFields

_RESERVED = ("ankle", "foot", "spring")  # with a leg's number, these are names in the URDF and the multibody model


def build(file: RobotFields, sources: Mapping[str, str], written: Mapping[str, str]) -> Robot:
    """Build the robot that ``file`` describes.

    ``sources`` maps the path of each field to the source of its value, and ``written`` to its key as written in the
    file, with the unit. Raises FieldError, which names the field, its value and the expected values.
    """
    if len(file.legs) != file.num_legs:
        raise FieldError(f"legs: {len(file.legs)} given, expected num_legs = {file.num_legs}")
    table = LegTable(
        file.leg_table.convention,
        tuple(DHRow(row.theta, row.d, row.a, row.alpha) for row in file.leg_table.rows),
        tuple(file.leg_table.joints),
        tuple(file.leg_table.mount or ()),
    )
    _check_joints(table)
    forward = np.array(file.forward)
    if not abs(np.linalg.norm(forward) - 1.0) <= 1e-9 or abs(forward[2]) > 1e-12:
        raise FieldError(f"forward: expected a horizontal unit vector, got {file.forward}")
    legs = tuple(_leg(file, table, index, written) for index in range(file.num_legs))
    limits, standing = zip(*(_joint_values(file, table, index) for index in range(file.num_legs)), strict=True)
    names = [leg.name for leg in legs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FieldError(f"legs: names must differ, got {twice[0]!r} more than once")
    lengths = _lengths(table, legs)
    segments = {}
    for index, name in enumerate(SEGMENT_NAMES):
        # If no centre of mass is given, a segment is assumed to be uniform between its joints.
        length = float(lengths[0, index])
        if np.ptp(lengths[:, index]) > 1e-9 and getattr(file.segments, name).center_of_mass is None:
            raise FieldError(f"segments.{name}.center_of_mass: needed, since the legs' lengths differ")
        segments[name] = _body(getattr(file.segments, name), f"segments.{name}", [length / 2.0, 0.0, 0.0], length)
    foot = Body(file.foot.mass, np.zeros(3), _tensor(file.foot.inertia), np.full(3, 2.0 * file.foot.radius))
    check_foot(foot)
    return Robot(
        name=file.name,
        reference=file.reference,
        forward=forward,
        table=table,
        legs=legs,
        torso=_body(file.torso, "torso", [0.0, 0.0, 0.0], 0.0),
        segments=segments,
        foot=foot,
        joint_limits=np.array(limits),
        standing_q=np.array(standing),
        servo=Servo(file.servo.max_torque, file.servo.rate, file.servo.max_speed),
        sources=sources,
    )


def _check_joints(table: LegTable) -> None:
    if len(set(table.joints)) != len(table.joints):
        raise FieldError(f"leg_table.joints: names must differ, got {', '.join(table.joints)}")
    for joint in table.joints:
        if joint in _RESERVED:
            raise FieldError(
                f"leg_table.joints: {joint} is already the name of a part of every leg; choose another name"
            )
        uses = [motion for motion, entry in table.motions if entry == joint]
        if uses != ["rz"] or pi_multiple(joint) is not None:
            raise FieldError(
                f"leg_table.rows: joint {joint} must be the theta of exactly one row, found {len(uses)} uses"
            )
    order = [entry for _, entry in table.motions if entry in table.joints]
    if order != list(table.joints):
        raise FieldError(f"leg_table.joints: must be in the order of the rows, {', '.join(map(str, order))}")


def _leg(file: RobotFields, table: LegTable, index: int, written: Mapping[str, str]) -> Leg:
    own = file.legs[index].parameters
    given = file.leg_table.parameters | own
    missing = [name for name in table.parameters if name not in given]
    if missing:
        raise FieldError(
            f"legs.{index + 1}.parameters: no value for {', '.join(missing)} (nor in leg_table.parameters)"
        )
    unused = [name for name in given if name not in table.parameters]
    if unused:
        raise FieldError(f"legs.{index + 1}.parameters: {', '.join(unused)} does not occur in leg_table.rows")
    for name, value in given.items():
        kinds = {motion[0] for motion, entry in table.motions if entry == name}
        if len(kinds) > 1:
            raise FieldError(f"leg_table.rows: {name} is both a length and an angle")
        bounds = ANGLE if kinds == {"r"} else OFFSET
        if bounds.outside(value):
            path = f"legs.{index + 1}.parameters.{name}" if name in own else f"leg_table.parameters.{name}"
            hint = bounds.hint(written.get(path, name), value)
            raise FieldError(f"{path}: {value:g} {bounds.unit}, expected {bounds.low:g} to {bounds.high:g}; {hint}")
    return Leg(file.legs[index].name, dict(given))


def _lengths(table: LegTable, legs: tuple[Leg, ...]) -> Array:
    """Return the distances (L, 3) [m] from each joint to the next, and from the last joint to the foot."""
    lengths = np.array([np.linalg.norm(table.fixed_poses(leg.values)[1:, :3, 3], axis=-1) for leg in legs])
    for leg, segment in np.argwhere((lengths > LENGTH.high) | (lengths < LENGTH.low)):
        length, name = lengths[leg, segment], SEGMENT_NAMES[segment]
        units = "are the units right?"
        if length > LENGTH.high:
            raise FieldError(
                f"legs.{leg + 1}: its {name} is {length:g} m long, expected at most {LENGTH.high:g}; {units}"
            )
        if name != "coxa":  # a coxa may have no length: its two axes then intersect
            least = f"expected at least {LENGTH.low:g}; {units}"
            raise FieldError(f"legs.{leg + 1}: its {name} has no length ({length:g} m), {least}")
    return lengths


def _joint_values(file: RobotFields, table: LegTable, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return limits (3, 2) and standing angles (3,) [rad] of a leg: its own values or those for all legs."""
    leg = file.legs[index]
    ranges, angles = file.joint_limits | leg.joint_limits, file.standing | leg.standing
    for field, given in (("joint_limits", set(ranges)), ("standing", set(angles))):
        if given != set(table.joints):
            names = ", ".join(sorted(given)) or "none"
            raise FieldError(f"{field} of leg {index + 1}: expected the joints {', '.join(table.joints)}, got {names}")
    limits = np.array([ranges[joint] for joint in table.joints])
    standing = np.array([angles[joint] for joint in table.joints])
    for joint, (low, high), angle in zip(table.joints, limits, standing, strict=True):
        where = f"of leg {index + 1}"
        if not low < high:
            raise FieldError(f"joint_limits.{joint} {where}: lower limit {low:g} is not below upper limit {high:g}")
        if not low <= angle <= high:
            raise FieldError(f"standing.{joint} {where}: {angle:g} rad is outside its limits [{low:g}, {high:g}]")
    return limits, standing


def _tensor(f: InertiaFields) -> Array:
    return np.array([[f.xx, f.xy, f.xz], [f.xy, f.yy, f.yz], [f.xz, f.yz, f.zz]])


def _body(fields: BodyFields, where: str, center: list[float], length: float) -> Body:
    center_of_mass = fields.center_of_mass if fields.center_of_mass is not None else center
    body = Body(fields.mass, np.array(center_of_mass), _tensor(fields.inertia), np.array(fields.size))
    check_body(body, where, length)
    return body
