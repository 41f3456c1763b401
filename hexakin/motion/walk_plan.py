"""A planned walk, the result of paper B's planner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, checked
from hexakin.motion.short_repr import short_repr


@checked
@dataclass(frozen=True, eq=False)
class WalkPlan:
    """A planned walk of L legs and k steps, at n samples of time (B section 3).

    Parameters
    ----------
    time
        Times (n,) [s] of the samples.
    T_world_body
        Poses (n, 4, 4) of the body in the world.
    p_world_foot
        Positions (n, L, 3) [m] of the feet in the world; for a spherical foot, of its centre.
    q
        Joint angles (n, L, 3) [rad], NaN where a foot is not reachable.
    stance
        Whether each leg is in stance, (n, L) bool.
    reachable
        Whether each foot can be reached, (n, L) bool.
    within_limits
        Whether the angles of each leg are within the joint limits, (n, L) bool.
    footholds
        Points (k + 1, L, 3) [m] at which the feet touch the ground, at the start and after each step.
    ground_height
        Height (n, L) [m] of the ground at the horizontal position of each foot.
    arch
        Factor (k, L), a number without unit, on the height of the paper's cycloid, for each swing.
    foot_radius
        Radius [m] of the feet; 0 for feet that are points.
    parameters
        The parameters of ``plan_walk``, by name.
    """

    time: Array
    T_world_body: Array
    p_world_foot: Array
    q: Array
    stance: NDArray[np.bool_]
    reachable: NDArray[np.bool_]
    within_limits: NDArray[np.bool_]
    footholds: Array
    ground_height: Array
    arch: Array
    foot_radius: float
    parameters: Mapping[str, Any]

    __repr__ = short_repr

    @property
    def clearance(self) -> Array:
        """Height (n, L) [m] of each foot's lowest point above the ground; negative where a foot is in the ground."""
        return self.p_world_foot[..., 2] - self.foot_radius - self.ground_height
