"""A motion of body and legs over time: the common form in which plans, recordings and commanded walks are checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_array, checked
from hexakin.exceptions import InvalidInputError
from hexakin.motion.recording import Recording
from hexakin.motion.short_repr import short_repr
from hexakin.motion.walk_plan import WalkPlan
from hexakin.transforms import inverse_pose, transform_points


@checked
@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of the body and of L legs at n instants.

    Parameters
    ----------
    time
        Instants (n,) [s].
    T_world_body
        Poses (n, 4, 4) of the body in the world.
    p_body_foot
        Positions (n, L, 3) [m] of the feet's centres in the body frame, as planned, commanded or recorded.
    q
        Joint angles (n, L, 3) [rad], NaN where the foot's position cannot be reached.
    carrying
        Which feet carry load, (n, L) bool.
    clipped
        Which foot targets were out of reach or beyond the joint limits and were clipped, (n, L) bool.
    ground_height
        Height (n, L) [m] of the ground below each foot; None means that it is taken from the terrain.
    touch
        Largest depth [m] at which a foot that carries no load may be in the ground.
    """

    time: Array
    T_world_body: Array
    p_body_foot: Array
    q: Array
    carrying: NDArray[np.bool_]
    clipped: NDArray[np.bool_]
    ground_height: Array | None = None
    touch: float = 1e-6

    __repr__ = short_repr


def motion_of(motion: Motion | WalkPlan | Recording) -> Motion:
    """Return a plan or a recording as a Motion.

    ``motion`` is a WalkPlan, a Recording, or a Motion, which is returned unchanged. For a recording the result is the
    recorded motion, with the feet that carried load; a foot in the air may then be up to 2 mm in the ground. Raises
    InvalidInputError for another type, for times that do not ascend, and for shapes that do not go together.
    """
    if isinstance(motion, Motion):
        given = motion
    elif isinstance(motion, WalkPlan):
        given = Motion(
            motion.time,
            motion.T_world_body,
            transform_points(inverse_pose(motion.T_world_body), motion.p_world_foot),
            motion.q,
            motion.stance,
            np.zeros_like(motion.stance),
            motion.ground_height,
        )
    elif isinstance(motion, Recording):
        # This force is a mean over the tick before, so that a foot that has just lifted off still counts as loaded.
        loaded = motion.foot_force > 0.0
        given = Motion(
            motion.time, motion.T_world_body, motion.p_body_foot, motion.q, loaded, motion.limited, touch=2e-3
        )
    else:
        raise InvalidInputError(f"motion: expected a Motion, WalkPlan or Recording, got {motion!r:.80}")
    _check_shapes(given)
    return given


def _check_shapes(motion: Motion) -> None:
    time = check_array("motion: time", motion.time, ())
    if time.ndim != 1 or not len(time):
        raise InvalidInputError(f"motion: time has shape {time.shape}, expected (n,) with at least one instant")
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        at = int(late[0]) + 1
        raise InvalidInputError(f"motion: time must ascend, but {time[at]:g} s follows {time[at - 1]:g} s (index {at})")
    legs = np.shape(motion.p_body_foot)[1] if np.ndim(motion.p_body_foot) == 3 else "L"
    expected = {
        "T_world_body": (4, 4),
        "p_body_foot": (legs, 3),
        "q": (legs, 3),
        "carrying": (legs,),
        "clipped": (legs,),
    }
    for name, row in expected.items():
        shape = np.shape(getattr(motion, name))
        if shape != (len(time), *row):
            wanted = ", ".join(map(str, (len(time), *row)))
            raise InvalidInputError(f"motion: {name} has shape {shape}, expected ({wanted})")
