"""Balls and blocks as Pinocchio models, for tests of the rigid engine's contact mechanics against known solutions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import check_array, check_number
from hexakin.dynamics import pin
from hexakin.engines.shapes import Cuboid, Sphere
from hexakin.robot.model import GRAVITY


class Ball(NamedTuple):
    """A solid ball with ``mass`` [kg] and ``radius`` [m]."""

    mass: float
    radius: float


class Block(NamedTuple):
    """A solid block with ``mass`` [kg] and edge lengths ``size`` (3,) [m]."""

    mass: float
    size: tuple[float, float, float]


def free_bodies(*bodies: Ball | Block) -> tuple[pin.Model, tuple[Sphere | Cuboid, ...]]:
    """Return a Pinocchio model of free ``bodies`` and their shapes, the first two arguments of ``MoreauStepper``.

    The bodies touch the ground and each other.
    The configuration of body k is q[7 k:7 k + 7]: position [m] of its centre and unit quaternion (xyzw). Its velocity
    is v[6 k:6 k + 6]: linear [m/s] and angular [rad/s], both in the frame of the body. Its group is k. Raises
    InvalidInputError for a mass or radius that is not positive and for a size that is not three finite numbers.
    """
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    shapes: list[Sphere | Cuboid] = []
    for number, body in enumerate(bodies):
        check_number(f"body {number + 1}: mass", body.mass, above=0.0, unit="kg")
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), f"body_{number + 1}")
        if isinstance(body, Ball):
            check_number(f"body {number + 1}: radius", body.radius, above=0.0, unit="m")
            inertia = pin.Inertia.FromSphere(body.mass, body.radius)
            shapes.append(Sphere(joint, np.zeros(3), body.radius, number))
        else:
            size = check_array(f"body {number + 1}: size", body.size, (3,))
            inertia = pin.Inertia.FromBox(body.mass, *size)
            shapes.append(Cuboid(joint, np.eye(4), size, number))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return model, tuple(shapes)
