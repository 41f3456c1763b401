"""A motion of body and legs over time: the common form in which plans, recordings and commanded walks are checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_array, checked
from hexakin.exceptions import InvalidInputError
from hexakin.kinematics.forward import forward_kinematics
from hexakin.motion.columns import column, columns_table, dataframe, described
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot
from hexakin.transforms import inverse_pose, transform_points

if TYPE_CHECKING:
    import pandas as pd

_SAME_FOOT = 1e-5  # [m] files in single precision, and angles that were computed iteratively, differ by less


@described("n")
@checked
@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of the body and of L legs at n instants.

    ``touch`` is the largest depth [m] at which a foot that carries no load may be in the ground. ``carrying_since``
    tells whether ``carrying`` marks the feet that carried load at some time since the instant before, as in a
    recording (True), or those that carry it at the instant (False).
    """

    time: Array = field(metadata=column("", "s", "instant"))
    T_world_body: Array = field(metadata=column("pose", "m", "pose of the body in the world"))
    p_body_foot: Array = field(
        metadata=column("leg axis", "m", "foot centres in the body frame, as planned, commanded or recorded")
    )
    q: Array = field(metadata=column("leg joint", "rad", "joint angles; NaN where the foot's position is out of reach"))
    carrying: NDArray[np.bool_] = field(metadata=column("leg", "bool", "whether the foot carries load", "b"))
    clipped: NDArray[np.bool_] = field(
        metadata=column("leg", "bool", "whether the target was clipped (reach or joint limits)", "b")
    )
    ground_height: Array | None = field(
        default=None, metadata=column("leg", "m", "height of the ground below the foot; None: that of the terrain")
    )
    touch: float = 1e-6
    carrying_since: bool = False

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        return columns_table(self, f"Motion, {len(self.time)} instants")

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns as a DataFrame with the index ``time`` [s]; angles of feet out of reach are NaN.

        Names and units are those of ``Recording.to_dataframe``: ``p_body_foot_leg1_x`` [m], ``q_leg1_coxa`` [rad],
        ``carrying_leg1``. Raises InvalidInputError for arrays whose shapes do not go together.
        """
        return dataframe(self)


def motion_of(robot: Robot, motion: Motion | WalkPlan | Recording) -> Motion:
    """Return a plan or a recording of ``robot`` as a Motion.

    ``motion`` is a WalkPlan, a Recording, or a Motion, which is returned unchanged. For a recording the result is the
    recorded motion, with the feet that carried load; a foot in the air may then be up to 2 mm in the ground. Raises
    InvalidInputError for times that do not ascend, for shapes that do not go together, and for another robot's motion:
    the joint angles must put the feet where they are, except where a foot is out of reach or its target was clipped.
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
    else:
        # This force is a mean over the tick before, so that a foot that has just lifted off still counts as loaded.
        given = Motion(
            motion.time,
            motion.T_world_body,
            motion.p_body_foot,
            motion.q,
            motion.foot_force > 0.0,
            motion.limited,
            touch=2e-3,
            carrying_since=True,
        )
    _check_shapes(given)
    _check_robot(robot, given)
    return given


def _check_robot(robot: Robot, motion: Motion) -> None:
    legs = motion.q.shape[1]
    if legs != robot.num_legs:
        raise InvalidInputError(f"motion: for {legs} legs, but {robot.name} has {robot.num_legs}")
    compared = np.isfinite(motion.q).all(axis=-1) & ~motion.clipped
    feet = forward_kinematics(robot, np.where(compared[..., None], motion.q, robot.standing_q))
    away = np.where(compared, np.linalg.norm(feet - motion.p_body_foot, axis=-1), 0.0)
    at, leg = np.unravel_index(int(np.argmax(away)), away.shape)
    if not away[at, leg] <= _SAME_FOOT:
        raise InvalidInputError(
            f"motion: not of {robot.name}, whose leg {leg + 1} has its foot {away[at, leg]:.3g} m elsewhere at these "
            f"joint angles (t = {motion.time[at]:g} s)"
        )


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
