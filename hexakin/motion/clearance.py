"""Gaps between a robot and the ground, the same for plans, checks, sliders, simulations and summaries."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain, gaps
from hexakin.transforms import transform_points

_ACROSS = 5  # points across the torso's underside at which uneven ground below it is looked at


def foot_gaps(robot: Robot, terrain: Terrain, p_world_foot: ArrayLike) -> Array:
    """Gap (..., L) [m] between each foot and the ground, for feet's centres (..., L, 3) [m]; negative in the ground."""
    return gaps(terrain, p_world_foot) - robot.foot_radius


def torso_gaps(robot: Robot, terrain: Terrain, T_world_body: ArrayLike) -> Array:
    """Smallest gap (...) [m] between the torso's box and the ground, for poses (..., 4, 4); negative in the ground.

    It is taken over the box's corners and 25 points of its underside.
    """
    return gaps(terrain, transform_points(T_world_body, _torso_points(robot))).min(axis=-1)


def _torso_points(robot: Robot) -> Array:
    """Points (29, 3) [m] of the torso's box in the body frame: 25 of the underside, the four corners of the top."""
    below, above = np.moveaxis(robot.torso_corners.reshape(2, 2, 2, 3), 2, 0)  # each by the side in x and in y
    share = np.linspace(0.0, 1.0, _ACROSS)
    weight = np.stack([1.0 - share, share], axis=-1)
    underside = np.einsum("ia,jb,abk->ijk", weight, weight, below)
    return np.concatenate([underside.reshape(-1, 3), above.reshape(-1, 3)])
