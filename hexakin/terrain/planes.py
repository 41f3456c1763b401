"""Level ground and ramps (A Fig. 9a)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_angle, check_number, checked, read_only
from hexakin.terrain.base import FARTHEST, HalfSpace, check_points, check_rays


class _Planes:
    """A terrain that is a union of half spaces: its height is the largest height of its planes."""

    def shapes(self) -> tuple[HalfSpace, ...]:
        raise NotImplementedError

    @cached_property
    def _planes(self) -> tuple[Array, Array]:
        shapes = self.shapes()
        return read_only([s.point for s in shapes]), read_only([s.normal for s in shapes])

    def _heights(self, x: ArrayLike, y: ArrayLike) -> Array:
        point, normal = self._planes
        px, py = check_points(x, y)
        dx, dy = px[..., None] - point[:, 0], py[..., None] - point[:, 1]
        return point[:, 2] - (normal[:, 0] * dx + normal[:, 1] * dy) / normal[:, 2]

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the height (...) [m] of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""
        return self._heights(x, y).max(axis=-1)

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the unit normal (..., 3) out of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""
        return np.take(self._planes[1], self._heights(x, y).argmax(axis=-1), axis=0)

    def distance_along(self, origin: ArrayLike, direction: ArrayLike) -> Array:
        """Return the distance (...) [m] along a ray from ``origin`` (..., 3) [m] to the ground.

        ``direction`` (..., 3) is the ray's unit vector. The distance is inf if the ray misses the ground, and negative
        for an origin under the ground.
        """
        point, normal = self._planes
        p, d = check_rays(origin, direction)
        gap = np.einsum("...pi,pi->...p", p[..., None, :] - point, normal)
        speed = -np.einsum("...i,pi->...p", d, normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(speed > 0.0, gap / speed, np.where(gap >= 0.0, np.inf, -np.inf))
        return distance.min(axis=-1)


@checked
@dataclass(frozen=True)
class Plane(_Planes):
    """Level ground at ``z`` [m]."""

    z: float = 0.0

    def __post_init__(self) -> None:
        check_number("Plane: z", self.z, at_least=-FARTHEST, at_most=FARTHEST, unit="m")

    def shapes(self) -> tuple[HalfSpace, ...]:
        """Return the half space below ``z``."""
        return (HalfSpace((0.0, 0.0, self.z), (0.0, 0.0, 1.0)),)


@checked
@dataclass(frozen=True)
class Ramp(_Planes):
    """A ramp that rises with ``slope`` [rad] in the direction ``heading`` [rad] (from the x axis; pi/2 is +y).

    With ``start`` [m] the ground is level up to that distance from the origin and rises from there. With None it is
    inclined everywhere and passes through the origin. The defaults are paper A's 10 degrees along its walking
    direction (A Fig. 9a). Raises InvalidInputError for a slope beyond 60 degrees or
    below 0 with ``start``, and for a heading of more than one turn.
    """

    slope: float = np.pi / 18.0
    start: float | None = None
    heading: float = np.pi / 2.0

    def __post_init__(self) -> None:
        check_number("Ramp: slope", self.slope, at_least=-np.pi / 3, at_most=np.pi / 3, unit="rad")
        check_angle("Ramp: heading", self.heading)
        if self.start is not None:
            check_number("Ramp: start", self.start, at_least=-FARTHEST, at_most=FARTHEST, unit="m")
            check_number("Ramp: slope", self.slope, at_least=0.0, unit="rad")

    def shapes(self) -> tuple[HalfSpace, ...]:
        """Return the inclined half space and, with ``start``, the level half space before it."""
        along = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        x, y, _ = (float(value) for value in along)
        begin, rise = self.start or 0.0, float(np.sin(self.slope))
        inclined = HalfSpace((begin * x, begin * y, 0.0), (-rise * x, -rise * y, float(np.cos(self.slope))))
        return (inclined,) if self.start is None else (HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), inclined)
