"""Feet, Jacobians, segments and joint axes of all legs from joint angles, broadcasting over leading axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array
from hexakin.kinematics.evaluation import fits, forward_of, jacobian_of
from hexakin.robot.model import Robot, check_robot


def forward_kinematics(robot: Robot, q: ArrayLike) -> Array:
    """Foot positions in the body frame (A(12)).

    ``q`` (..., L, 3) [rad] -> (..., L, 3) [m], to four units in the last place of the length of the leg's whole
    chain, for angles of any size. Raises InvalidInputError for a wrong shape or an angle that is not finite, naming leg
    and joint.
    """
    return _of_angles(forward_of, robot, q)


def jacobian(robot: Robot, q: ArrayLike) -> Array:
    """Derivative of each foot's position in the body frame by its leg's angles.

    ``q`` (..., L, 3) [rad] -> (..., L, 3, 3) [m/rad]. Raises InvalidInputError as ``forward_kinematics``.
    """
    return _of_angles(jacobian_of, robot, q)


def _of_angles(function_of: Callable[[Robot], Callable[[Array], Array | None]], robot: Robot, q: ArrayLike) -> Array:
    check_robot(robot)
    # The generated code finds infinities and NaN itself; an array is looked through only if it has.
    angles = cast(Array, q) if fits(robot, q) else check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    result = function_of(robot)(angles)
    if result is None:
        check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
        # Finite, but too large for the polynomials of a batch.
        result = function_of(robot)(np.arctan2(np.sin(angles), np.cos(angles)))
    assert result is not None
    return result


def standing_height(robot: Robot) -> float:
    """Height [m] of the body's origin above the ground when the robot stands: its reference height."""
    feet = forward_kinematics(robot, robot.standing_q)
    return float(robot.foot_radius - feet[:, 2].min())


def segment_poses(robot: Robot, q: ArrayLike) -> Array:
    """Pose in the body frame of each segment's frame (origin at its joint, x towards the next joint).

    ``q`` (..., L, 3) [rad] -> (..., L, 3, 4, 4), the segments in the order coxa, femur, tibia.
    """
    return _joint_poses(robot, q) @ np.array([robot.segment_poses(leg) for leg in range(robot.num_legs)])


def joint_axes(robot: Robot, q: ArrayLike) -> Array:
    """Unit vectors along the joints' axes in the body frame, as columns: the angular Jacobian of each foot.

    ``q`` (..., L, 3) [rad] -> (..., L, 3, 3).
    """
    return np.swapaxes(_joint_poses(robot, q)[..., :3, 2], -1, -2)


def contact_jacobian(jacobian: Any, axes: Any, cross_lever: Any) -> Any:
    """Derivative (..., 3, 3) [m/rad] by the joint angles of the point of a foot that touches the ground.

    The point turns with the foot. ``jacobian`` is that of the foot's centre, ``axes`` those of ``joint_axes``, and
    ``cross_lever`` (..., 3, 3) [m] the matrix that takes v to lever x v, with the lever from the centre to the point
    (``hexakin.transforms.cross_matrix``); all in one frame. They are arrays, or CasADi's matrices of one leg.
    """
    return jacobian - cross_lever @ axes


def _joint_poses(robot: Robot, q: ArrayLike) -> Array:
    """Pose (..., L, 3, 4, 4) in the body frame of each joint's frame, turned with the joint, whose axis is its z."""
    check_robot(robot)
    angles = check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    fixed = np.array([robot.fixed_poses(leg) for leg in range(robot.num_legs)])
    turns = np.zeros((*angles.shape, 4, 4))
    turns[..., 0, 0] = turns[..., 1, 1] = np.cos(angles)
    turns[..., 1, 0] = np.sin(angles)
    turns[..., 0, 1] = -turns[..., 1, 0]
    turns[..., 2, 2] = turns[..., 3, 3] = 1.0
    poses = fixed[:, :3] @ turns
    for joint in (1, 2):
        poses[..., joint, :, :] = poses[..., joint - 1, :, :] @ poses[..., joint, :, :]
    return poses
