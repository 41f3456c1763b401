"""Balls and blocks as Pinocchio models, to try the contact mechanics of the rigid engine on what is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import check_array, check_number
from hexakin.dynamics import pin
from hexakin.engines.shapes import Cuboid, Sphere
from hexakin.robot.model import GRAVITY


class Ball(NamedTuple):
    """A solid ball: ``mass`` [kg], ``radius`` [m]."""

    mass: float
    radius: float


class Block(NamedTuple):
    """A solid block: ``mass`` [kg], ``size`` (3,) [m]."""

    mass: float
    size: tuple[float, float, float]


def free_bodies(*bodies: Ball | Block) -> tuple[pin.Model, tuple[Sphere | Cuboid, ...]]:
    """Return a model of floating bodies and their shapes, the arguments of ``MoreauStepper``.

    Body k has the configuration q[7 k:7 k + 7], position and quaternion xyzw of its centre, the velocity
    v[6 k:6 k + 6], linear and angular in its own frame, and the group k.
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
