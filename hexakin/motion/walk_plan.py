"""A planned walk, the result of paper B's planner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, checked
from hexakin.motion.columns import column, columns_table, dataframe, described
from hexakin.numerics.display import short_repr

if TYPE_CHECKING:
    import pandas as pd


@described("n")
@checked
@dataclass(frozen=True, eq=False)
class WalkPlan:
    """A planned walk of L legs and k steps, at n samples of time (B section 3).

    Parameters
    ----------
    footholds
        Points (k + 1, L, 3) [m] at which the feet touch the ground, at the start and after each step.
    arch
        Factor (k, L), a number without unit, on the height of the paper's cycloid, for each swing.
    foot_radius
        Radius [m] of the feet; 0 for feet that are points.
    parameters
        The parameters of ``plan_walk``, by name.
    """

    time: Array = field(metadata=column("", "s", "time of the sample"))
    T_world_body: Array = field(metadata=column("pose", "m", "pose of the body in the world"))
    p_world_foot: Array = field(metadata=column("leg axis", "m", "feet in the world; for a spherical foot, its centre"))
    q: Array = field(metadata=column("leg joint", "rad", "joint angles; NaN where the foot is not reachable"))
    stance: NDArray[np.bool_] = field(metadata=column("leg", "bool", "whether the leg is in stance", "b"))
    reachable: NDArray[np.bool_] = field(metadata=column("leg", "bool", "whether the foot can be reached", "b"))
    within_limits: NDArray[np.bool_] = field(
        metadata=column("leg", "bool", "whether the leg's angles are within the joint limits", "b")
    )
    footholds: Array
    ground_height: Array = field(
        metadata=column("leg", "m", "height of the ground at the horizontal position of the foot")
    )
    arch: Array
    foot_radius: float
    parameters: Mapping[str, Any]

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        gait, terrain = (self.parameters.get(name, "unknown") for name in ("gait", "terrain"))
        steps, samples = len(self.arch), len(self.time)
        return columns_table(self, f"WalkPlan, gait {gait}, {terrain}, {steps} steps, {samples} samples")

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns of samples as a DataFrame with the index ``time`` [s]; unreachable legs' angles are NaN.

        Names and units are those of ``Recording.to_dataframe``: ``p_world_foot_leg1_x`` [m], ``q_leg1_coxa`` [rad],
        ``stance_leg1``. Raises InvalidInputError for arrays whose shapes do not go together.
        """
        return dataframe(self)

    @property
    def clearance(self) -> Array:
        """Height (n, L) [m] of each foot's lowest point above the ground; negative where a foot is in the ground."""
        return self.p_world_foot[..., 2] - self.foot_radius - self.ground_height
