"""Standing up from the ground: the pose of a robot that lies on its torso, and footholds from which it can rise.

The method is hexakin's own.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array, check_number, check_shape, checked
from hexakin.kinematics.forward import forward_kinematics
from hexakin.kinematics.inverse import inverse_kinematics, raise_if_impossible
from hexakin.kinematics.leg_functions import reach
from hexakin.robot.model import Robot

_WIDER = 5e-3  # [m] by which the footholds are moved outwards in each trial
# [m] A robot lies if the gap between its torso and the ground is smaller. It may lie on its coxae, so the gap is not 0.
_LYING = 1e-2


@checked
def lying_q(robot: Robot, lift: float = 0.01) -> Array:
    """Joint angles (L, 3) [rad] of a robot that lies on its torso, with its feet above footholds to stand up on.

    The feet are ``lift`` [m] above these footholds. The angles are meant for ``hexakin.simulate(..., q_start=...)``.
    Raises UnreachableError or JointLimitError, which name the leg, if there are no such angles.
    """
    check_number("lift", lift, at_least=0.0, unit="m")
    ground = robot.foot_radius - underside(robot)
    standing = forward_kinematics(robot, robot.standing_q)
    return inverse_kinematics(robot, footholds_to_rise_on(robot, standing, ground, lift) + [0.0, 0.0, lift]).q


@checked
def underside(robot: Robot) -> float:
    """Distance [m] from the body's origin down to the underside of the torso of ``robot``."""
    return -float(robot.torso_corners[:, 2].min())


@checked
def footholds_to_rise_on(robot: Robot, home: Array, ground: float, lift: float = 0.0) -> Array:
    """Footholds (L, 3) [m] in the body frame from which a lying robot can rise to its standing height.

    ``home`` (L, 3) [m] are the standing footholds in the body frame. ``ground`` [m] is the z coordinate of the centre
    of a foot on the ground, and ``lift`` [m] the height above it at which the feet begin.

    The footholds are moved outwards from ``home``, because a lying robot often cannot raise its femora enough to put
    the feet there; it steps to ``home`` later. The distance is the smallest multiple of 5 mm at which the feet can move
    up and down between the ground and their standing height within the joint limits. Raises UnreachableError or
    JointLimitError, which name the leg, if there are no such footholds.
    """
    home = check_shape("home", home, (robot.num_legs, 3), ("leg", "coordinate"))
    check_number("ground", ground, unit="m")
    check_number("lift", lift, at_least=0.0, unit="m")
    hips = np.array([robot.fixed_poses(leg)[0, :3, 3] for leg in range(robot.num_legs)])
    outward = (home - hips) * [1.0, 1.0, 0.0]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)  # 0 for a foot directly below its hip
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
    raise AssertionError("the first footholds are within the limits, but were not returned")


@checked
def lies(robot: Robot, height: float) -> bool:
    """Whether ``robot`` lies on the ground; ``height`` [m] is that of the body's origin above the ground."""
    return height < underside(robot) + _LYING
