"""A motion of body and legs over time: what checks and animations read of plans, recordings and commanded walks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.exceptions import InvalidInputError
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.transforms import inverse_pose, transform_points


@dataclass(frozen=True, eq=False)
class Motion:
    """Body and legs at n instants.

    ``time`` (n,) [s]; ``T_world_body`` (n, 4, 4); ``p_body_foot`` (n, L, 3) [m], where the feet's centres should be;
    ``q`` (n, L, 3) [rad], NaN where no angles lead there; ``carrying`` (n, L), the feet that the ground carries;
    ``clipped`` (n, L), targets that were out of reach or limits and were left; ``ground_height`` (n, L) [m] below each
    foot, or None if the terrain says it; ``touch`` [m], how deep a foot in the air may be in the ground.
    """

    time: Array
    T_world_body: Array
    p_body_foot: Array
    q: Array
    carrying: NDArray[np.bool_]
    clipped: NDArray[np.bool_]
    ground_height: Array | None = None
    touch: float = 1e-6


def motion_of(motion: Motion | WalkPlan | Recording) -> Motion:
    """Return what is checked of a plan, or of a recording: there, what the robot did, on the feet that were loaded."""
    if isinstance(motion, Motion):
        return motion
    if isinstance(motion, WalkPlan):
        return Motion(
            motion.time,
            motion.T_world_body,
            transform_points(inverse_pose(motion.T_world_body), motion.p_world_foot),
            motion.q,
            motion.stance,
            np.zeros_like(motion.stance),
            motion.ground_height,
        )
    if isinstance(motion, Recording):
        loaded = motion.foot_force > 0.0  # mean over a tick: a foot that has just lost the ground may still touch it
        return Motion(
            motion.time, motion.T_world_body, motion.p_body_foot, motion.q, loaded, motion.limited, touch=2e-3
        )
    raise InvalidInputError(f"motion: expected a Motion, WalkPlan or Recording, got {motion!r:.80}")
