"""What every terrain provides: height, normal, distance along a ray, and the shapes that an engine needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, checked, read_only
from hexakin.exceptions import InvalidInputError
from hexakin.numerics.display import short_repr

FARTHEST = 1e9
"""Largest coordinate [m] of a terrain or a point; assumed: a hundred times those of maps, and rounded to 0.1 um."""

MOST_POINTS = 5_000_000
"""Largest number of points of a height field; assumed: its heights take 40 MB, and its triangle mesh 0.4 GB."""

_UNIT_ERROR = 1e-6  # allowed error of a unit vector's length; rounding in single precision is below it


@checked
@dataclass(frozen=True)
class HalfSpace:
    """All points below a plane: ``point`` (3,) [m] lies on it, ``normal`` (3,) is its unit normal out of the ground.

    Raises InvalidInputError for other shapes, a normal that is no unit vector, and coordinates beyond 1e9 m.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _triple("HalfSpace: point", self.point))
        object.__setattr__(self, "normal", _triple("HalfSpace: normal", self.normal))
        _check_unit("HalfSpace: normal", np.array(self.normal))


@checked
@dataclass(frozen=True)
class Box:
    """A box parallel to the world's axes, from its corner ``lower`` (3,) [m] to its corner ``upper`` (3,) [m].

    Raises InvalidInputError for other shapes, corners of which one is not below the other along all axes, and
    coordinates beyond 1e9 m.
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            object.__setattr__(self, name, _triple(f"Box: {name}", getattr(self, name)))
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise InvalidInputError(f"Box: upper: {self.upper}, expected above lower {self.lower} along each axis")


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles.

    ``vertices`` (v, 3) [m] are its points; ``triangles`` (t, 3) are indices of three points each, counter-clockwise
    seen from above. Raises InvalidInputError for other shapes, indices without a point, and coordinates beyond 1e9 m.
    """

    vertices: Array
    triangles: NDArray[np.int_]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        vertices = read_only(check_positions("TriangleMesh: vertices", self.vertices, (3,)))
        check_array("TriangleMesh: triangles", self.triangles, ())
        triangles = np.array(self.triangles)
        if vertices.ndim != 2 or triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            raise InvalidInputError(
                "TriangleMesh: expected vertices (v, 3) and triangles (t, 3) of whole numbers, got "
                f"{vertices.shape} and {triangles.shape} of {triangles.dtype}"
            )
        outside = (triangles < 0) | (triangles >= len(vertices))
        if outside.any():
            raise InvalidInputError(
                f"TriangleMesh: triangles: {triangles[outside][0]}, expected indices of {len(vertices)} vertices"
            )
        triangles.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)


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


def check_positions(name: str, value: ArrayLike, trailing: tuple[int, ...] = (), labels: tuple[str, ...] = ()) -> Array:
    """Return coordinates ``value`` (..., *trailing) [m] as a float array.

    ``name`` and ``labels`` are for the message, as in ``check_array``. Raises InvalidInputError unless the coordinates
    are finite numbers within 1e9 m of zero.
    """
    array = check_array(name, value, trailing, labels)
    if array.size and np.abs(array).max() > FARTHEST:
        raise InvalidInputError(f"{name}: {array.flat[np.abs(array).argmax()]:g} m, expected within {FARTHEST:g} m")
    return array


def check_points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return ``x`` (...) and ``y`` (...) [m] as float arrays of the same shape.

    Raises InvalidInputError if they are not finite numbers within 1e9 m, or do not broadcast.
    """
    px, py = check_positions("x", x), check_positions("y", y)
    try:
        px, py = np.broadcast_arrays(px, py)
    except ValueError as error:
        raise InvalidInputError(f"x, y: shapes {px.shape} and {py.shape} do not broadcast") from error
    return px, py


def check_rays(origin: ArrayLike, direction: ArrayLike) -> tuple[Array, Array]:
    """Return ``origin`` (..., 3) [m] and ``direction`` (..., 3), unit vectors, as float arrays of the same shape.

    Raises InvalidInputError for origins beyond 1e9 m, directions that are no unit vectors, and shapes that do not
    broadcast.
    """
    if _is_point(origin) and _is_point(direction):
        x, y, z = direction.tolist()
        within = all(abs(coordinate) <= FARTHEST for coordinate in origin.tolist())
        # The square of the length is checked more strictly than the length below.
        if within and abs(x * x + y * y + z * z - 1.0) <= _UNIT_ERROR:
            return origin, direction
    p, d = check_positions("origin", origin, (3,)), check_array("direction", direction, (3,))
    _check_unit("direction", d)
    try:
        p, d = np.broadcast_arrays(p, d)
    except ValueError as error:
        raise InvalidInputError(f"origin, direction: shapes {p.shape} and {d.shape} do not broadcast") from error
    return p, d


def _is_point(value: ArrayLike) -> TypeGuard[Array]:
    """Whether ``value`` is an array (3,) of floats, as in each control tick; it can then be checked without NumPy."""
    return type(value) is np.ndarray and value.dtype == float and value.shape == (3,)


def _check_unit(name: str, vectors: Array) -> None:
    with np.errstate(over="ignore"):
        lengths = np.sqrt((vectors * vectors).sum(axis=-1))
    if not (np.abs(lengths - 1.0) <= _UNIT_ERROR).all():
        worst = lengths.flat[np.argmax(np.abs(lengths - 1.0))]
        raise InvalidInputError(f"{name}: expected unit vectors, got one of length {worst:.7g}")


def _triple(name: str, value: ArrayLike) -> tuple[float, ...]:
    array = check_positions(name, value, (3,))
    if array.ndim != 1:
        raise InvalidInputError(f"{name}: expected three numbers, got shape {array.shape}")
    return tuple(array.tolist())


def gaps(terrain: Terrain, points: ArrayLike) -> Array:
    """Return the distances (...) [m] of ``points`` (..., 3) [m] from the ground of ``terrain``.

    They are measured along the ground's normal below each point, and are negative for points under the ground.
    """
    x, y, z = np.moveaxis(check_positions("points", points, (3,)), -1, 0)
    return (z - terrain.height(x, y)) * terrain.normal(x, y)[..., 2]
