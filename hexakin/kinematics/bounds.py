"""The bounds with which the inverse kinematics compares its solutions: reach and joint limits.

``Bounds`` is the only place that says which bounds there are. ``hexakin.kinematics.evaluation`` and the code that
``hexakin.symbolic.generate`` writes read them by the names of its fields.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from hexakin.checks import Array
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot

LIMIT_TOLERANCE = 1e-9
"""[rad]: an angle may be this far out of its limits, because rounding may push out an angle on a limit."""

REACH_TOLERANCE = 1e-12
"""Relative to the square of the outer reach: a squared distance may be this far out of reach, because rounding may push
out the foot of a stretched leg. A foot within about 1e-13 m of the boundary is reached."""


class Bounds(NamedTuple):
    """Bounds of n leg poses.

    ``tolerance`` (n,) [m^2] is how far a squared distance may be out of reach. ``middle`` (3, n) [rad] are the middles
    of the joint limits: each angle is returned within half a turn of it. ``low`` and ``high`` (3, n) [rad] are the
    joint limits, moved outwards by ``LIMIT_TOLERANCE``.

    The fields are arrays, or for ``inverse_scalar`` lists with a number or three numbers for each leg pose.
    """

    tolerance: Any
    middle: Any
    low: Any
    high: Any

    def __repr__(self) -> str:
        return short_repr(self)

    def each(self, function: Callable[[Any], Any]) -> Bounds:
        """Return bounds with the fields ``function(field)``."""
        return Bounds(*map(function, self))

    def first(self, count: int) -> Bounds:
        """Return the bounds of the first ``count`` leg poses, as views of these arrays."""
        return Bounds(*[values[..., :count] for values in self])


def bounds_of(robot: Robot, outer_reach: Array) -> Bounds:
    """Return the bounds of a robot's L legs, as arrays.

    ``outer_reach`` (L,) [m] is each foot's largest distance from its leg's second joint.
    """
    return Bounds(
        tolerance=REACH_TOLERANCE * outer_reach**2,
        middle=(0.5 * (robot.q_min + robot.q_max)).T,
        low=(robot.q_min - LIMIT_TOLERANCE).T,
        high=(robot.q_max + LIMIT_TOLERANCE).T,
    )
