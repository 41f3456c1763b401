"""Standing up from the ground: how a robot lies, and where its feet go to lift it."""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array, check_number
from hexakin.kinematics.forward import forward_kinematics
from hexakin.kinematics.inverse import inverse_kinematics, raise_if_impossible
from hexakin.kinematics.leg_functions import reach
from hexakin.robot.model import Robot, check_robot

_WIDER = 5e-3  # [m]
_LYING = 1e-2  # [m] between the torso and the ground, below which the robot lies, perhaps on its coxae


def lying_q(robot: Robot, lift: float = 0.01) -> Array:
    """Angles (L, 3) [rad] of a robot that lies on its torso, its feet ``lift`` [m] above where it can stand up.

    For ``hexakin.simulate(..., q_start=...)``. Raises UnreachableError or JointLimitError, naming the leg.
    """
    check_robot(robot)
    check_number("lift", lift, at_least=0.0, unit="m")
    ground = robot.foot_radius - underside(robot)
    standing = forward_kinematics(robot, robot.standing_q)
    return inverse_kinematics(robot, footholds_to_rise_on(robot, standing, ground, lift) + [0.0, 0.0, lift]).q


def underside(robot: Robot) -> float:
    """How far [m] the torso's underside is below the body's origin."""
    return -float(robot.torso_corners[:, 2].min())


def footholds_to_rise_on(robot: Robot, home: Array, ground: float, lift: float = 0.0) -> Array:
    """Where feet (L, 3) are put on the ground, at the height ``ground`` [m] in the body frame, to stand up there.

    As little as possible further out than ``home`` (L, 3), where thighs cannot be raised enough; they step home later.
    """
    hips = np.array([robot.fixed_poses(leg)[0, :3, 3] for leg in range(robot.num_legs)])
    outward = (home - hips) * [1.0, 1.0, 0.0]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)  # 0 for a foot right below its hip
    heights = np.linspace(ground + lift, home[:, 2].max(), 8)
    solutions = []
    for wider in np.arange(0.0, reach(robot).max(), _WIDER):
        feet = home + wider * outward
        path = np.repeat(feet[None], len(heights), axis=0)
        path[..., 2] = heights[:, None]
        solutions.append(inverse_kinematics(robot, path))
        if solutions[-1].within_limits.all():
            feet[:, 2] = ground
            return feet
    raise_if_impossible(robot, solutions[0], np.zeros(len(heights)))
    raise AssertionError("one of them was within the limits")


def lies(robot: Robot, height: float) -> bool:
    """Whether a robot whose body's origin is ``height`` [m] above the ground lies on it."""
    return height < underside(robot) + _LYING
