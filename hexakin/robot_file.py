"""Reading robot descriptions: YAML with units in the field names and a source beside each value.

Anywhere in the file a value may be written as ``{value: ..., source: "Table 2"}``; a ``source`` in a
mapping holds for everything below it. Fields whose names end in ``_mm`` or ``_deg`` are converted to
metres and radians, and angles may be written as multiples of pi (``-pi/2``).
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from hexakin.exceptions import RobotFileError, UnknownNameError
from hexakin.robot import SEGMENT_NAMES, Body, DHRow, Leg, LegTable, Robot, Servo
from hexakin.robot_schema import BodyFields, InertiaFields, RobotFields

_SHORTEST, _LONGEST = 1e-6, 1e3  # [m]: of a segment; beyond, a unit has gone wrong

_PACKAGE = Path(__file__).resolve().parent
# A wheel carries data/ inside the package; a checkout has it beside the package.
DATA = _PACKAGE / "data" if (_PACKAGE / "data").is_dir() else _PACKAGE.parent / "data"


def load_robot(name: str | os.PathLike[str]) -> Robot:
    """Load a robot by its name (``"athena"``) or from a path to a YAML file.

    Raises UnknownNameError for a name that does not exist and RobotFileError, which names the file, the
    field, its value and what was expected, for a file that does not describe a possible robot.
    """
    if not isinstance(name, (str, os.PathLike)) or "\0" in str(name):
        raise RobotFileError(f"expected a robot's name or the path of its file, got {name!r:.80}")
    path = Path(name)
    if path.suffix not in (".yaml", ".yml") and path.name == str(name):
        known = sorted(p.stem for p in (DATA / "robots").glob("*.yaml"))
        if str(name) not in known:
            raise UnknownNameError("robot", str(name), [*known, "a path to a .yaml file"])
        path = DATA / "robots" / f"{name}.yaml"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotFileError(f"{path}: cannot be read ({error})") from error
    try:
        tree = yaml.load(text, Loader=_StrictLoader)
    except _YAML_FAULTS as error:
        raise RobotFileError(f"{path}: not valid YAML ({_short(error)})") from error
    if not isinstance(tree, dict):
        raise RobotFileError(f"{path}: expected a mapping of fields, got {type(tree).__name__}")
    sources: dict[str, str] = {}
    try:
        values = _strip(tree, "", "", sources)
        return _build(RobotFields.model_validate(values), sources)
    except ValidationError as error:
        raise RobotFileError(f"{path}: " + "; ".join(_describe(item) for item in error.errors()[:5])) from error
    except _FieldError as error:
        raise RobotFileError(f"{path}: {error}") from error


class _FieldError(Exception):
    """A field's value is impossible; the message starts with the field's path."""


# What PyYAML raises for malformed text, for impossible tags and for nesting beyond Python's stack.
_YAML_FAULTS = (yaml.YAMLError, ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)


class _StrictLoader(yaml.SafeLoader):
    """YAML without what a robot file has no use for: fields given twice, keys that are no text, and aliases."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.composer.ComposerError(None, None, "aliases (*) are not allowed", self.peek_event().start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a field's name must be text", key.start_mark)
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"field {key.value!r} is given twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _short(value: object) -> str:
    """Text of a value, short enough for a message."""
    try:
        text = str(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits has no text
        text = f"a huge {type(value).__name__}"
    return text if len(text) <= 200 else text[:200] + " ..."


_EXPONENT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)[eE][+-]?\d+")
_UNITS = {"_mm": 1e-3, "_deg": math.pi / 180.0}


def _strip(node: Any, path: str, source: str, sources: dict[str, str]) -> Any:
    """Drop ``value``/``source`` wrappers and unit suffixes; collect each leaf's source under its path."""
    if isinstance(node, dict):
        source = str(node.get("source", source))
        if "value" in node and set(node) <= {"value", "source"}:
            return _strip(node["value"], path, source, sources)
        result: dict[str, Any] = {}
        for key, child in node.items():
            if key == "source":
                continue
            name, factor = str(key), 1.0
            for suffix, unit in _UNITS.items():
                if name.endswith(suffix):
                    name, factor = name.removesuffix(suffix), unit
            if name in result:
                raise _FieldError(f"{path}{name}: given twice, in different units")
            value = _strip(child, f"{path}{name}.", source, sources)
            result[name] = _scaled(value, factor, f"{path}{key}") if factor != 1.0 else value
        return result
    if isinstance(node, list) and any(isinstance(child, (dict, list)) for child in node):
        return [_strip(child, f"{path}{i + 1}.", source, sources) for i, child in enumerate(node)]
    sources[path.removesuffix(".")] = source
    # YAML 1.1 reads 1e-3 (no dot) as text.
    return float(node) if isinstance(node, str) and _EXPONENT.fullmatch(node) else node


def _scaled(value: Any, factor: float, path: str) -> Any:
    if isinstance(value, list):
        return [_scaled(item, factor, path) for item in value]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise _FieldError(f"{path}: expected a number, got {_short(value)!r}")
    try:
        return float(value) * factor
    except OverflowError as error:
        raise _FieldError(f"{path}: number too large") from error


def _describe(item: Any) -> str:
    location = ".".join(str(part + 1) if isinstance(part, int) else part for part in item["loc"])
    given = item["input"]
    shown = "" if item["type"] == "missing" or isinstance(given, dict) else f", got {_short(given)!r}"
    return f"{location or 'file'}: {item['msg'].removeprefix('Value error, ')}{shown}"


def _build(file: RobotFields, sources: dict[str, str]) -> Robot:
    if len(file.legs) != file.num_legs:
        raise _FieldError(f"legs: {len(file.legs)} given, expected num_legs = {file.num_legs}")
    table = LegTable(
        file.leg_table.convention,
        tuple(DHRow(row.theta, row.d, row.a, row.alpha) for row in file.leg_table.rows),
        tuple(file.leg_table.joints),
        tuple(file.leg_table.mount or ()),
    )
    _check_joints(table)
    forward = np.array(file.forward)
    if abs(np.linalg.norm(forward) - 1.0) > 1e-9 or abs(forward[2]) > 1e-12:
        raise _FieldError(f"forward: expected a horizontal unit vector, got {file.forward}")
    legs = tuple(_leg(file, table, index) for index in range(file.num_legs))
    limits, standing = zip(*(_joint_values(file, table, index) for index in range(file.num_legs)), strict=True)
    names = [leg.name for leg in legs]
    if len(set(names)) != len(names):
        raise _FieldError(f"legs: names must differ, got {', '.join(names)}")
    lengths = np.array([np.linalg.norm(table.fixed_poses(leg.values)[1:, :3, 3], axis=-1) for leg in legs])
    if not np.isfinite(lengths).all() or lengths.max() > _LONGEST:
        raise _FieldError(f"legs: a segment is {lengths.max():g} m long; are the units right?")
    short = np.argwhere(lengths[:, 1:] < _SHORTEST)
    if len(short):
        leg, segment = short[0]
        raise _FieldError(
            f"legs.{leg + 1}: its {SEGMENT_NAMES[segment + 1]} has no length ({lengths[leg, segment + 1]:g} m)"
        )
    segments = {}
    for index, name in enumerate(SEGMENT_NAMES):
        # Without a given centre of mass a limb is taken as uniform between its joints.
        reach = float(lengths[0, index])
        if np.ptp(lengths[:, index]) > 1e-9 and getattr(file.segments, name).center_of_mass is None:
            raise _FieldError(f"segments.{name}.center_of_mass: needed, since the legs' lengths differ")
        segments[name] = _body(getattr(file.segments, name), f"segments.{name}", [reach / 2.0, 0.0, 0.0])
    foot_size = [2.0 * file.foot.radius] * 3
    foot = Body(file.foot.mass, np.zeros(3), _inertia(file.foot.inertia, "foot"), np.array(foot_size))
    return Robot(
        name=file.name,
        reference=file.reference,
        forward=forward,
        table=table,
        legs=legs,
        torso=_body(file.torso, "torso", [0.0, 0.0, 0.0]),
        segments=segments,
        foot=foot,
        joint_limits=np.array(limits),
        standing_q=np.array(standing),
        servo=Servo(file.servo.max_torque, file.servo.rate, file.servo.max_speed),
        sources=sources,
    )


def _check_joints(table: LegTable) -> None:
    if len(set(table.joints)) != len(table.joints):
        raise _FieldError(f"leg_table.joints: names must differ, got {', '.join(table.joints)}")
    for joint in table.joints:
        uses = [motion for motion, entry in table.motions if entry == joint]
        if uses != ["rz"]:
            raise _FieldError(
                f"leg_table.rows: joint {joint} must be the theta of exactly one row, found {len(uses)} uses"
            )
    order = [entry for _, entry in table.motions if entry in table.joints]
    if order != list(table.joints):
        raise _FieldError(f"leg_table.joints: must be in the order of the rows, {', '.join(map(str, order))}")


def _leg(file: RobotFields, table: LegTable, index: int) -> Leg:
    given = file.leg_table.parameters | file.legs[index].parameters
    missing = [name for name in table.parameters if name not in given]
    if missing:
        raise _FieldError(
            f"legs.{index + 1}.parameters: no value for {', '.join(missing)} (nor in leg_table.parameters)"
        )
    unused = [name for name in given if name not in table.parameters]
    if unused:
        raise _FieldError(f"legs.{index + 1}.parameters: {', '.join(unused)} does not occur in leg_table.rows")
    return Leg(file.legs[index].name, dict(given))


def _joint_values(file: RobotFields, table: LegTable, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Limits (3, 2) and standing angles (3,) of a leg: its own, or else those of the file."""
    leg = file.legs[index]
    ranges, angles = file.joint_limits | leg.joint_limits, file.standing | leg.standing
    for field, given in (("joint_limits", set(ranges)), ("standing", set(angles))):
        if given != set(table.joints):
            names = ", ".join(sorted(given)) or "none"
            raise _FieldError(f"{field} of leg {index + 1}: expected the joints {', '.join(table.joints)}, got {names}")
    limits = np.array([ranges[joint] for joint in table.joints])
    standing = np.array([angles[joint] for joint in table.joints])
    for joint, (low, high), angle in zip(table.joints, limits, standing, strict=True):
        where = f"of leg {index + 1}"
        if not low < high:
            raise _FieldError(f"joint_limits.{joint} {where}: lower limit {low:g} is not below upper limit {high:g}")
        if not low <= angle <= high:
            raise _FieldError(f"standing.{joint} {where}: {angle:g} rad is outside its limits [{low:g}, {high:g}]")
    return limits, standing


def _inertia(fields: InertiaFields, where: str) -> np.ndarray:
    f = fields
    tensor = np.array([[f.xx, f.xy, f.xz], [f.xy, f.yy, f.yz], [f.xz, f.yz, f.zz]])
    moments = np.linalg.eigvalsh(tensor)
    if moments[0] <= 0.0:
        raise _FieldError(f"{where}.inertia: not positive definite, principal moments {moments} kg m^2")
    if moments[0] + moments[1] < moments[2] * (1.0 - 1e-9):
        raise _FieldError(f"{where}.inertia: violates the triangle inequality, principal moments {moments} kg m^2")
    return tensor


def _body(fields: BodyFields, where: str, center: list[float]) -> Body:
    center_of_mass = fields.center_of_mass if fields.center_of_mass is not None else center
    return Body(fields.mass, np.array(center_of_mass), _inertia(fields.inertia, where), np.array(fields.size))
