"""A planned walk: what paper B's planner makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array


@dataclass(frozen=True, eq=False)
class WalkPlan:
    """A planned walk of n samples, L legs and k steps.

    ``time`` (n,) [s]; ``T_world_body`` (n, 4, 4); ``p_world_foot`` (n, L, 3) [m], the feet that the leg's kinematics
    moves (the centre of a spherical foot); ``q`` (n, L, 3) [rad], NaN where not ``reachable`` (n, L);
    ``within_limits`` (n, L); ``stance`` (n, L); ``footholds`` (k + 1, L, 3) [m], where the feet touch the ground;
    ``ground_height`` (n, L) [m] of the terrain below (or above) each foot; ``arch`` (k, L), the height of each swing
    in heights of the paper's cycloid; ``foot_radius`` [m]; ``parameters`` of ``plan_walk``.
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

    @property
    def clearance(self) -> Array:
        """Height (n, L) [m] of each foot's lowest point above the ground; negative where a swing cuts through it."""
        return self.p_world_foot[..., 2] - self.foot_radius - self.ground_height
