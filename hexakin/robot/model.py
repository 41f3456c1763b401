"""The frozen description of a legged robot: legs as Denavit-Hartenberg tables, masses, limits, servos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from hexakin.checks import Array, check_number, check_shape, check_whole, checked, read_only
from hexakin.exceptions import InvalidInputError, shown
from hexakin.numerics.display import html_table, short_repr, spread
from hexakin.robot.leg_table import NUM_JOINTS, LegTable
from hexakin.transforms import pose, rotation_between

GRAVITY = 9.81
"""Gravitational acceleration [m/s^2]."""

SEGMENT_NAMES = ("coxa", "femur", "tibia")
"""Names of a leg's three rigid segments, one after each joint; the foot is fixed to the last one."""


@checked
@dataclass(frozen=True)
class Body:
    """A rigid body: ``mass`` [kg], ``center_of_mass`` (3,) [m], ``inertia`` (3, 3) [kg m^2] about the centre of mass.

    ``size`` (3,) [m] are the edges of its box; for a foot, all three are the diameter of its sphere. The torso uses
    the axes of the body frame. A segment uses its own frame: origin at its joint, x towards the next joint. Raises
    InvalidInputError for other shapes, and if the mass is not positive or an edge negative.
    """

    mass: float
    center_of_mass: Array
    inertia: Array
    size: Array

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", check_number("mass", self.mass, above=0.0, unit="kg"))
        for name, shape in (("center_of_mass", (3,)), ("inertia", (3, 3)), ("size", (3,))):
            object.__setattr__(self, name, read_only(check_shape(name, getattr(self, name), shape)))
        if self.size.min() < 0.0:
            raise InvalidInputError(f"size: {shown(self.size)} m, expected no negative edge")

    @cached_property
    def corners(self) -> Array:
        """Corners (8, 3) [m] of the box, which is centred on the centre of mass; x changes slowest, z fastest."""
        sides = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return read_only(self.center_of_mass + sides * self.size)


@checked
@dataclass(frozen=True)
class Leg:
    """One leg: its ``name`` and the ``values`` [m, rad] of the leg table's parameters by name.

    Raises InvalidInputError for a value that is not finite.
    """

    name: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        values = {name: check_number(f"values: {name}", value) for name, value in self.values.items()}
        object.__setattr__(self, "values", MappingProxyType(values))

    def __reduce__(self) -> tuple:
        """Pickle with plain dicts, because read-only mappings cannot be pickled."""
        return Leg, (self.name, dict(self.values))


@checked
@dataclass(frozen=True)
class Servo:
    """A velocity servo: it drives its joint at the speed ``rate`` [1/s] * (command - angle).

    Its torque is at most ``max_torque`` [N m]. ``max_speed`` [rad/s] is the largest joint speed that feasibility checks
    allow, None if it is not known; the engines do not use it. Raises InvalidInputError unless all are positive.
    """

    max_torque: float
    rate: float
    max_speed: float | None = None

    def __post_init__(self) -> None:
        for name, unit in (("max_torque", "N m"), ("rate", "1/s"), ("max_speed", "rad/s")):
            if getattr(self, name) is not None:
                value = check_number(f"servo: {name}", getattr(self, name), above=0.0, unit=unit)
                object.__setattr__(self, name, value)


@checked
@dataclass(frozen=True, eq=False)
class Robot:
    """A legged robot with L legs. Load one with ``hexakin.load_robot``.

    Parameters
    ----------
    name
        The robot's name.
    reference
        Where the robot is described.
    forward
        Direction of walking (3,) in the body frame, a horizontal unit vector; z of the body frame points up.
    table
        The Denavit-Hartenberg table that all legs share.
    legs
        The L legs, in order around the body.
    torso
        The body that carries the legs.
    segments
        The coxa, femur and tibia of every leg, by name.
    foot
        The sphere at the end of every leg.
    joint_limits
        Lower and upper joint limits (L, 3, 2) [rad].
    standing_q
        Joint angles (L, 3) [rad] of the standing pose.
    servo
        The servo of every joint.
    sources
        The source of each value, by the path of its field in the file.

    Raises
    ------
    InvalidInputError
        For other shapes, a segment or a value of a leg that is missing, a forward axis that is no horizontal unit
        vector, limits that do not ascend, and a standing pose beyond them.
    """

    made_by: ClassVar[str] = "hexakin.load_robot"

    name: str
    reference: str
    forward: Array
    table: LegTable
    legs: tuple[Leg, ...]
    torso: Body
    segments: Mapping[str, Body]
    foot: Body
    joint_limits: Array
    standing_q: Array
    servo: Servo
    sources: Mapping[str, str] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        joints = (len(self.legs), NUM_JOINTS)
        for name, shape in (("forward", (3,)), ("joint_limits", (*joints, 2)), ("standing_q", joints)):
            object.__setattr__(self, name, read_only(check_shape(name, getattr(self, name), shape)))
        self._check_parts()
        self._check_angles()
        for name in ("segments", "sources"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def _check_parts(self) -> None:
        if not self.legs:
            raise InvalidInputError("legs: expected at least one")
        if missing := [name for name in SEGMENT_NAMES if name not in self.segments]:
            raise InvalidInputError(f"segments: no {', '.join(missing)}")
        for leg in self.legs:
            if missing := [name for name in self.table.parameters if name not in leg.values]:
                raise InvalidInputError(f"legs: {leg.name} has no value for {', '.join(missing)}")

    def _check_angles(self) -> None:
        if not abs(np.linalg.norm(self.forward) - 1.0) <= 1e-6 or abs(self.forward[2]) > 1e-6:
            raise InvalidInputError(f"forward: expected a horizontal unit vector, got {shown(self.forward)}")
        for wrong, text in (
            (self.q_min >= self.q_max, "joint_limits: {}: the lower limit is not below the upper limit"),
            ((self.standing_q < self.q_min) | (self.standing_q > self.q_max), "standing_q: {} is beyond its limits"),
        ):
            if wrong.any():
                leg, joint = np.argwhere(wrong)[0]
                raise InvalidInputError(text.format(f"leg {leg + 1}, joint {joint + 1}"))

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.num_legs} legs, {self.mass:.4g} kg)"

    def _repr_html_(self) -> str:
        """Return a table of masses, sizes, joint limits and servo, for a notebook."""
        rows = [("legs", ", ".join(leg.name for leg in self.legs), "")]
        for name, body in {"torso": self.torso, **self.segments, "foot": self.foot}.items():
            rows.append((f"{name}: mass", f"{body.mass:.4g}", "kg"))
            rows.append((f"{name}: box", " x ".join(f"{edge:.4g}" for edge in body.size), "m"))
        for joint, low, high in zip(self.table.joints, self.q_min.T, self.q_max.T, strict=True):
            rows.append((f"{joint}: limits", f"{spread(low)} ... {spread(high)}", "rad"))
        rows.append(("servo: torque, at most", f"{self.servo.max_torque:g}", "N m"))
        if self.servo.max_speed is not None:
            rows.append(("servo: speed, at most", f"{self.servo.max_speed:g}", "rad/s"))
        return html_table(repr(self), ("", "value", "unit"), rows)

    def __reduce__(self) -> tuple:
        """Pickle with plain dicts, because read-only mappings cannot be pickled."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        values |= {"segments": dict(self.segments), "sources": dict(self.sources)}
        return _rebuild, (values,)

    @property
    def num_legs(self) -> int:
        """Number of legs L."""
        return len(self.legs)

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        limb = sum(body.mass for body in self.segments.values()) + self.foot.mass
        return self.torso.mass + self.num_legs * limb

    @property
    def weight(self) -> float:
        """Weight m g [N]."""
        return self.mass * GRAVITY

    @property
    def torso_corners(self) -> Array:
        """Corners (8, 3) [m] of the torso's box in the body frame; those with even index are on its underside."""
        return self.torso.corners

    @property
    def foot_radius(self) -> float:
        """Radius of the spherical foot [m]."""
        return float(self.foot.size[0]) / 2.0

    @property
    def q_min(self) -> Array:
        """Lower joint limits (L, 3) [rad]."""
        return self.joint_limits[..., 0]

    @property
    def q_max(self) -> Array:
        """Upper joint limits (L, 3) [rad]."""
        return self.joint_limits[..., 1]

    @property
    def right(self) -> Array:
        """Unit vector (3,) to the right of the forward axis, in the body frame: the pitch axis of paper A."""
        return np.cross(self.forward, [0.0, 0.0, 1.0])

    @cached_property
    def parameters(self) -> Array:
        """Values (L, n) [m, rad] of the table's n parameters, in the order of ``table.canonical()``."""
        return read_only([[leg.values[name] for name in self.table.parameters] for leg in self.legs])

    def description(self) -> dict[str, Any]:
        """Return all values of the description, except the sources, as plain data that JSON can store."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self) if f.name != "sources"}

    @checked
    def fixed_poses(self, leg: int) -> Array:
        """Return the constant poses (4, 4, 4) of leg ``leg`` (index from 0); see ``LegTable.fixed_poses``.

        Raises InvalidInputError if the robot does not have the leg.
        """
        check_whole("leg", leg, at_most=self.num_legs - 1)
        return self._fixed_poses[leg]

    @cached_property
    def _fixed_poses(self) -> Array:
        # Cached, because a walk uses it in every control step.
        return read_only([self.table.fixed_poses(leg.values) for leg in self.legs])

    @checked
    def segment_poses(self, leg: int) -> Array:
        """Return the pose (3, 4, 4) of each segment's frame, x towards the next joint, in the frame of its joint.

        ``leg`` is the index of the leg, from 0. Raises InvalidInputError if the robot does not have it.
        """
        check_whole("leg", leg, at_most=self.num_legs - 1)
        return self._segment_poses[leg].copy()

    @cached_property
    def _segment_poses(self) -> Array:
        # Cached, because each engine uses it.
        ends = self._fixed_poses[:, 1:, :3, 3]
        turns = [[rotation_between([1.0, 0.0, 0.0], end) if end.any() else np.eye(3) for end in leg] for leg in ends]
        return read_only([[pose(turn, np.zeros(3)) for turn in leg] for leg in turns])


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _rebuild(values: dict) -> Robot:
    return Robot(**values)
