"""Terrains: height and normal as functions, ranges along a ray, and the shapes that an engine needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array
from hexakin.exceptions import InvalidInputError, UnknownNameError


@dataclass(frozen=True)
class HalfSpace:
    """Everything behind a plane: ``point`` (3,) [m] on it, unit ``normal`` (3,) out of the ground."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """A box along the world's axes between its ``lower`` and ``upper`` corners, (3,) [m] each."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


class TriangleMesh(NamedTuple):
    """A surface: ``vertices`` (v, 3) [m] and ``triangles`` (t, 3), indices counter-clockwise seen from above."""

    vertices: Array
    triangles: NDArray[np.int_]


@runtime_checkable
class Terrain(Protocol):
    """What every terrain offers; ``x``, ``y`` [m] broadcast."""

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Height of the ground [m]."""

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Unit normal out of the ground, (..., 3)."""

    def distance_along(self, origin: ArrayLike, direction: ArrayLike) -> Array:
        """Distance [m] from ``origin`` (..., 3) to the ground along the unit ``direction`` (..., 3); inf if none."""

    def shapes(self) -> tuple[HalfSpace | TriangleMesh | Box, ...]:
        """Shapes whose union is the ground, for an engine."""


def check_points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Coerce coordinates [m] to finite arrays of one shape; else raise InvalidInputError."""
    px, py = check_array("x", x, ()), check_array("y", y, ())
    try:
        px, py = np.broadcast_arrays(px, py)
    except ValueError as error:
        raise InvalidInputError(f"x, y: shapes {px.shape} and {py.shape} do not go together") from error
    return px, py


def check_terrain(terrain: object, *, also: tuple[type, ...] = ()) -> None:
    """Raise UnknownNameError unless ``terrain`` is one, or a value of the classes ``also``: a class must be called."""
    if isinstance(terrain, type) or not isinstance(terrain, (Terrain, *also)):
        names = ["Plane", "Ramp", "Blocks", "HeightField", *(kind.__name__ for kind in also)]
        raise UnknownNameError("terrain", terrain, [f"hexakin.terrain.{name}(...)" for name in names])


def gaps(terrain: Terrain, points: ArrayLike) -> Array:
    """Distances [m] of points (..., 3) from the ground, along its normal below each; negative in the ground."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return (z - terrain.height(x, y)) * terrain.normal(x, y)[..., 2]
