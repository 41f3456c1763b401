"""Feet, Jacobians, segments and joint axes of all legs from joint angles (A(11)-(12), B(1)-(11)).

All functions take angles with any number of leading axes. L is the number of the robot's legs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_arrays, checked
from hexakin.kinematics.evaluation import OutOfRangeError, fits, forward_of, jacobian_of
from hexakin.kinematics.leg_functions import within_half_turn
from hexakin.robot.model import Robot


@checked
def forward_kinematics(robot: Robot, q: ArrayLike) -> Array:
    """Return the foot positions (..., L, 3) [m] of ``robot`` in the body frame (A(12)).

    ``q`` (..., L, 3) [rad] are the joint angles, of any size. The error is at most four units in the last place of the
    length of the leg's whole chain. Raises InvalidInputError if ``robot`` is not a robot, and for a wrong shape or an
    angle that is not finite; the message names leg and joint.
    """
    return _of_angles(forward_of, robot, q)


@checked
def jacobian(robot: Robot, q: ArrayLike) -> Array:
    """Return the derivatives (..., L, 3, 3) [m/rad] of the foot positions of ``robot`` by the angles of their legs.

    Rows are the coordinates of the foot in the body frame, columns the joints. ``q`` (..., L, 3) [rad] are the joint
    angles, of any size. Raises InvalidInputError as ``forward_kinematics`` does.
    """
    return _of_angles(jacobian_of, robot, q)


def _of_angles(function_of: Callable[[Robot], Callable[[Array], Array]], robot: Robot, q: ArrayLike) -> Array:
    """Check the arguments and evaluate ``function_of(robot)``."""
    angles = q if fits(q, robot) else _angles(robot, q)
    function = function_of(robot)
    try:
        return function(angles)
    except OutOfRangeError:
        pass  # the angles are checked below: an error raised here would be shown together with this one
    finite = _angles(robot, angles)
    return function(within_half_turn(finite))  # one of them is too large for the polynomials of a batch


def _angles(robot: Robot, q: ArrayLike) -> Array:
    return check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))


@checked
def standing_height(robot: Robot) -> float:
    """Return the height [m] of the body's origin above the ground when ``robot`` is in its standing pose.

    Raises InvalidInputError if ``robot`` is not a robot.
    """
    feet = forward_kinematics(robot, robot.standing_q)
    return float(robot.foot_radius - feet[:, 2].min())


@checked
def segment_poses(robot: Robot, q: ArrayLike) -> Array:
    """Return the poses (..., L, 3, 4, 4) of the frames of the segments of ``robot`` in the body frame.

    The segments are coxa, femur and tibia, in this order. The origin [m] of a segment's frame is its joint, and x is
    the direction to the next joint. ``q`` (..., L, 3) [rad] are the joint angles. Raises InvalidInputError as
    ``forward_kinematics`` does.
    """
    return _joint_poses(robot, q) @ np.array([robot.segment_poses(leg) for leg in range(robot.num_legs)])


@checked
def joint_axes(robot: Robot, q: ArrayLike) -> Array:
    """Return unit vectors (..., L, 3, 3) along the joint axes of ``robot`` in the body frame, as columns.

    They are the angular Jacobian of each foot. ``q`` (..., L, 3) [rad] are the joint angles. Raises InvalidInputError
    as ``forward_kinematics`` does.
    """
    return np.swapaxes(_joint_poses(robot, q)[..., :3, 2], -1, -2)


@checked
def contact_jacobian(jacobian: ArrayLike, axes: ArrayLike, cross_lever: ArrayLike) -> Array:
    """Return the derivative (..., 3, 3) [m/rad] by the joint angles of the point of a foot that touches the ground.

    The point turns with the foot. ``jacobian`` (..., 3, 3) [m/rad] is that of the foot's centre. ``axes`` (..., 3, 3)
    are the joint axes as columns (``joint_axes``). ``cross_lever`` (..., 3, 3) [m] is the cross-product matrix of the
    lever, which leads from the centre to the point (``hexakin.transforms.cross_matrix``). All three are in the same
    frame.
    """
    named = (("jacobian", jacobian, (3, 3)), ("axes", axes, (3, 3)), ("cross_lever", cross_lever, (3, 3)))
    return at_contact(*check_arrays(*named, finite=False))


def at_contact(jacobian: Any, axes: Any, cross_lever: Any) -> Any:
    """Return ``contact_jacobian`` without checks, of arrays or of CasADi's matrices of one leg."""
    return jacobian - cross_lever @ axes


def _joint_poses(robot: Robot, q: ArrayLike) -> Array:
    """Return the pose (..., L, 3, 4, 4) of each joint's frame in the body frame; z is the axis, x turns with q."""
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
