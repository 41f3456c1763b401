"""Gaps between a robot and the ground; plans, checks, sliders, simulations and summaries all use them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_poses, check_shape, checked
from hexakin.exceptions import InvalidInputError
from hexakin.kinematics.forward import forward_kinematics
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain, gaps
from hexakin.transforms import transform_points

_MOST_MOVES, _SAME_GAP = 200, 1e-9  # [m]
_ACROSS = 5  # points per direction at which the gap between the torso's underside and uneven ground is computed


@checked
def foot_gaps(robot: Robot, terrain: Terrain, p_world_foot: ArrayLike) -> Array:
    """Gap (..., L) [m] between each foot and the ground of ``terrain``, negative if the foot is in the ground.

    ``p_world_foot`` (..., L, 3) [m] are the centres of the feet in the world frame.
    """
    return gaps(terrain, p_world_foot) - robot.foot_radius


@checked
def torso_gaps(robot: Robot, terrain: Terrain, T_world_body: ArrayLike) -> Array:
    """Smallest gap (...) [m] between the torso's box and the ground of ``terrain``, negative if it is in the ground.

    ``T_world_body`` (..., 4, 4) are the poses of the body in the world. The gap is computed at the corners of the box
    and at 25 points of its underside. Raises InvalidInputError for what is no pose.
    """
    return gaps(terrain, transform_points(check_poses("T_world_body", T_world_body), _torso_points(robot))).min(axis=-1)


@checked
def way_to_ground(
    robot: Robot, terrain: Terrain, T_world_body: Array, q: Array, direction: Array, *, gap: float, torso: bool = True
) -> float:
    """How far [m] to move the body along ``direction`` until its lowest part is ``gap`` [m] above ``terrain``.

    ``T_world_body`` (4, 4) is the pose of the body before, ``q`` (L, 3) [rad] are the joint angles and ``direction``
    (3,) is a unit vector upwards. The lowest part is a foot, or the torso unless ``torso`` is false. Raises
    InvalidInputError if no distance of up to some metres leads there.
    """
    check_number("gap", gap, unit="m")
    T_world_body = check_poses("T_world_body", check_shape("T_world_body", T_world_body, (4, 4)))
    direction = check_shape("direction", direction, (3,))
    feet, distance = transform_points(T_world_body, forward_kinematics(robot, q)), 0.0
    for _ in range(_MOST_MOVES):
        moved = np.array(T_world_body)
        moved[:3, 3] += distance * direction
        lowest = float(foot_gaps(robot, terrain, feet + distance * direction).min())
        if torso:
            lowest = min(lowest, float(torso_gaps(robot, terrain, moved)))
        # On a plane the first move is exact; on other ground the gap changes by less than the body moves.
        if distance != 0.0 and abs(gap - lowest) <= _SAME_GAP:
            return distance
        distance += gap - lowest
    raise InvalidInputError(
        f"terrain: no place for {robot.name} over ({T_world_body[0, 3]:g}, {T_world_body[1, 3]:g}) m"
    )


def _torso_points(robot: Robot) -> Array:
    """Points (29, 3) [m] of the torso's box in the body frame: 25 of the underside and the four corners of the top."""
    # (2, 2, 3) each; the first two axes are the sides in x and in y.
    below, above = np.moveaxis(robot.torso_corners.reshape(2, 2, 2, 3), 2, 0)
    share = np.linspace(0.0, 1.0, _ACROSS)
    weight = np.stack([1.0 - share, share], axis=-1)
    underside = np.einsum("ia,jb,abk->ijk", weight, weight, below)
    return np.concatenate([underside.reshape(-1, 3), above.reshape(-1, 3)])
