"""The frozen description of a legged robot: legs as Denavit-Hartenberg tables, masses, limits, servos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from hexakin.checks import Array, read_only
from hexakin.exceptions import InvalidInputError
from hexakin.robot.leg_table import LegTable
from hexakin.transforms import pose, rotation_between

GRAVITY = 9.81
"""Gravitational acceleration [m/s^2]."""

SEGMENT_NAMES = ("coxa", "femur", "tibia")
"""One rigid segment behind each joint; the foot is fixed to the last."""


@dataclass(frozen=True)
class Body:
    """A rigid body: ``mass`` [kg], ``center_of_mass`` (3,) [m] and ``inertia`` (3, 3) [kg m^2] about it.

    ``size`` (3,) [m] are the edges of its box (or three times the diameter of a foot's sphere). Axes are
    those of the body frame for the torso and those of the segment frame for a limb: origin at the
    segment's joint, x towards the next joint.
    """

    mass: float
    center_of_mass: Array
    inertia: Array
    size: Array

    def __post_init__(self) -> None:
        for name in ("center_of_mass", "inertia", "size"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @cached_property
    def corners(self) -> Array:
        """Corners (8, 3) [m] of the box, which stands around the centre of mass; x changes slowest, z fastest."""
        sides = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return read_only(self.center_of_mass + sides * self.size)


@dataclass(frozen=True)
class Leg:
    """One leg: its name and the values of the table's parameters [m, rad]."""

    name: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __reduce__(self) -> tuple:
        """Pickle by value: read-only mappings cannot be pickled themselves."""
        return Leg, (self.name, dict(self.values))


@dataclass(frozen=True)
class Servo:
    """A velocity servo: the joint is driven at ``rate`` * (command - angle) [1/s], at most ``max_torque`` [N m].

    ``max_speed`` [rad/s] is what feasibility checks allow a joint, None if it is not known; the engines do not use it.
    """

    max_torque: float
    rate: float
    max_speed: float | None = None


@dataclass(frozen=True, eq=False)
class Robot:
    """A legged robot. Build one with ``hexakin.load_robot``.

    ``forward`` is the unit vector of walking in the body frame (z is up). ``joint_limits`` (L, 3, 2)
    [rad] are the lower and upper limits, ``standing_q`` (L, 3) [rad] the angles of the standing pose.
    ``sources`` maps a field's path in the file to where its value comes from.
    """

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
        for name in ("forward", "joint_limits", "standing_q"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("segments", "sources"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple:
        """Pickle by value: read-only mappings cannot be pickled themselves."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
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
        """Corners (8, 3) [m] of the torso's box in the body frame; those at even places are its underside's."""
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
        """Values of the table's parameters, (L, n), in the order of ``table.canonical()``."""
        return read_only([[leg.values[name] for name in self.table.parameters] for leg in self.legs])

    def description(self) -> dict[str, Any]:
        """Every value of the description as plain data, fit for JSON; sources are left out."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self) if f.name != "sources"}

    def fixed_poses(self, leg: int) -> Array:
        """Return the constant poses of leg ``leg`` (index from 0) around its joints; see ``LegTable.fixed_poses``."""
        return self._fixed_poses[leg]

    @cached_property
    def _fixed_poses(self) -> Array:
        # Asked for at every tick of a walk.
        return read_only([self.table.fixed_poses(leg.values) for leg in self.legs])

    def segment_poses(self, leg: int) -> Array:
        """Pose (3, 4, 4) of each segment's frame (x towards the next joint) in the frame of its joint."""
        ends = self.fixed_poses(leg)[1:, :3, 3]
        return np.array(
            [pose(rotation_between([1.0, 0.0, 0.0], end) if end.any() else np.eye(3), np.zeros(3)) for end in ends]
        )


def check_robot(robot: object) -> None:
    """Raise InvalidInputError unless ``robot`` is a Robot: a name or a path has to be loaded first."""
    if not isinstance(robot, Robot):
        raise InvalidInputError(f"robot: expected what hexakin.load_robot returns, got {robot!r:.80}")


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
