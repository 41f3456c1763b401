"""What every terrain provides: height, normal, distance along a ray, and the shapes that an engine needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, checked
from hexakin.exceptions import InvalidInputError


@checked
@dataclass(frozen=True)
class HalfSpace:
    """All points below a plane: ``point`` (3,) [m] lies on it, ``normal`` (3,) is its unit normal out of the ground."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@checked
@dataclass(frozen=True)
class Box:
    """A box parallel to the world's axes, from its corner ``lower`` (3,) [m] to its corner ``upper`` (3,) [m]."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


class TriangleMesh(NamedTuple):
    """A surface of triangles.

    ``vertices`` (v, 3) [m] are its points; ``triangles`` (t, 3) are indices of three points each, counter-clockwise
    seen from above.
    """

    vertices: Array
    triangles: NDArray[np.int_]


@runtime_checkable
class Terrain(Protocol):
    """The functions of every terrain. Arrays broadcast against each other; the world's z axis points up."""

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the height (...) [m] of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the unit normal (..., 3) out of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""

    def distance_along(self, origin: ArrayLike, direction: ArrayLike) -> Array:
        """Return the distance (...) [m] along a ray from ``origin`` (..., 3) [m] to the ground; inf if it misses.

        ``direction`` (..., 3) is the ray's unit vector.
        """

    def shapes(self) -> tuple[HalfSpace | TriangleMesh | Box, ...]:
        """Return the shapes for an engine; their union is the ground."""


def check_points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return ``x`` (...) and ``y`` (...) [m] as finite float arrays of the same shape.

    Raises InvalidInputError if they are not finite numbers or do not broadcast.
    """
    px, py = check_array("x", x, ()), check_array("y", y, ())
    try:
        px, py = np.broadcast_arrays(px, py)
    except ValueError as error:
        raise InvalidInputError(f"x, y: shapes {px.shape} and {py.shape} do not broadcast") from error
    return px, py


def gaps(terrain: Terrain, points: ArrayLike) -> Array:
    """Return the distances (...) [m] of ``points`` (..., 3) [m] from the ground of ``terrain``.

    They are measured along the ground's normal below each point, and are negative for points under the ground.
    """
    x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return (z - terrain.height(x, y)) * terrain.normal(x, y)[..., 2]
