"""Terrain from elevation data: a grid of heights, with two triangles in each cell."""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_path, read_only
from hexakin.exceptions import InvalidInputError, TerrainFileError
from hexakin.terrain.base import MOST_POINTS, TriangleMesh, check_points, check_positions, check_rays
from hexakin.terrain.elevation_file import read_elevation


class GridMesh(TriangleMesh):
    """The triangle mesh of a height field, which engines may also read as the grid that it is.

    ``x`` (nx,), ``y`` (ny,) and ``z`` (nx, ny) [m] are read-only arrays, as in ``HeightField``. ``vertices`` and
    ``triangles`` are made anew at each access, because they take ten times the memory of ``z``. The triangles of cell
    (i, j) have the numbers i * (ny - 1) + j, with its corners (i, j), (i + 1, j) and (i, j + 1), and
    (nx - 1) * (ny - 1) more, with its other three corners.
    """

    def __init__(self, x: Array, y: Array, z: Array):
        for name, values in (("x", x), ("y", y), ("z", z)):
            object.__setattr__(self, name, values)

    x: Array
    y: Array
    z: Array

    def __repr__(self) -> str:
        return f"GridMesh({self.z.shape[0]} x {self.z.shape[1]} points)"

    @property
    def vertices(self) -> Array:
        """Points (nx * ny, 3) [m]; that of grid point (i, j) has the number i * ny + j."""
        X, Y = np.meshgrid(self.x, self.y, indexing="ij")
        return np.stack([X, Y, self.z], axis=-1).reshape(-1, 3)

    @property
    def triangles(self) -> NDArray[np.int_]:
        """Indices (t, 3) of the points of each triangle, counter-clockwise seen from above."""
        index = np.arange(self.z.size).reshape(self.z.shape)
        a, b, c, d = index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]
        return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights ``z`` (nx, ny) [m] over an evenly spaced grid ``x`` (nx,), ``y`` (ny,) [m].

    Between the grid points the ground consists of flat triangles, the same for heights, normals and engines. A
    descending axis, as in images and elevation data, is turned round together with ``z``, so that ``x`` and ``y`` of
    the terrain ascend. An axis of single precision is evenly spaced if it is so up to its rounding. Raises
    InvalidInputError for a grid that is not evenly spaced, for values that are not finite or beyond 1e9 m, and for more
    than 5 million points. Its functions raise InvalidInputError for points outside the grid.
    """

    x: Array
    y: Array
    z: Array

    def __post_init__(self) -> None:
        x, y = (_axis(f"HeightField: {name}", getattr(self, name)) for name in ("x", "y"))
        if len(x) * len(y) > MOST_POINTS:
            raise InvalidInputError(f"HeightField: {len(x)} x {len(y)} points, expected at most {MOST_POINTS}")
        z = check_positions("HeightField: z", self.z, (len(x), len(y)))
        if z.ndim != 2:
            raise InvalidInputError(f"HeightField: z: expected shape {(len(x), len(y))}, got {z.shape}")
        ways = [-1 if axis[0] > axis[1] else 1 for axis in (x, y)]
        for name, values in (("x", x[:: ways[0]]), ("y", y[:: ways[1]]), ("z", z[:: ways[0], :: ways[1]])):
            object.__setattr__(self, name, read_only(values))

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        *,
        scale: float | None = None,
        pixel: float | tuple[float, float] | None = None,
        heights: tuple[float, float] | None = None,
        missing: float | Literal["nearest"] | None = None,
        origin: tuple[float, float] | Literal["centre"] | None = None,
        window: tuple[float, float, float, float] | None = None,
    ) -> HeightField:
        """Read elevation data from a file; its ending says what it is.

        - ``.tif``, ``.tiff``: GeoTIFF, with one band; ``.asc``: ESRI ASCII grid. The package rasterio reads them.
        - ``.npz``: NumPy archive of the arrays ``x`` (nx,) and ``y`` (ny,) [m], and ``z`` (nx, ny) [m] or in units of
          ``scale``.
        - ``.png``: grey image of 8 or 16 bit. The centre of its lower left pixel is at x = y = 0.

        North is up in all of them but ``.npz``: the first row has the largest y. A point of the grid is the centre of a
        pixel. Coordinates are those of the file, in metres, and have double precision. A file without coordinate system
        is taken to be in metres.

        Raises InvalidInputError for an argument out of its range, and MissingPackageError without rasterio. Raises
        TerrainFileError, which names the file and the fault, if it cannot be read, has more than 5 million points (in
        the ``window``), missing heights, coordinates in degrees or another unit than metres, or a rotated grid.

        Parameters
        ----------
        path
            Path of the file.
        scale
            Metres per unit of the stored heights: 0.001 for millimetres, 0.3048 for feet; with None 1. It is needed if
            the file states another unit than metres, and is not for ``.png``.
        pixel
            Width of a pixel [m], or width and height. It is needed for files without coordinates: ``.png``, and
            ``.tif`` without georeference.
        heights
            Heights [m] of black and of white in a ``.png``.
        missing
            What replaces missing heights, NaN or the file's "no data": a height [m], or ``"nearest"`` for the height of
            the nearest point that has one. With None, missing heights are an error that names the first.
        origin
            Point (x, y) [m], in the file's coordinates, that becomes x = y = 0, where walks begin; ``"centre"`` is the
            middle of the grid. With None, coordinates stay as they are. Maps have coordinates of 500 km and more.
        window
            Part (x_min, x_max, y_min, y_max) [m] to read, in the file's coordinates; None reads all.
        """
        file = check_path("path", path)
        x, y, z = read_elevation(file, scale, pixel, heights, missing, origin, window)
        try:
            return cls(x, y, z)
        except InvalidInputError as error:
            raise TerrainFileError(f"{file}: {error}") from error

    @cached_property
    def _digest(self) -> str:
        return hashlib.sha256(self.z.tobytes()).hexdigest()[:12]

    def __repr__(self) -> str:
        grid = f"{self.z.shape[0]} x {self.z.shape[1]} points"
        span = f"x {self.x[0]:g} to {self.x[-1]:g} m, y {self.y[0]:g} to {self.y[-1]:g} m"
        return f"HeightField({grid}, {span}, {self._digest})"

    def _checked(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        px, py = check_points(x, y)
        outside = ~((px >= self.x[0]) & (px <= self.x[-1]) & (py >= self.y[0]) & (py <= self.y[-1]))
        if outside.any():
            at = tuple(np.argwhere(outside)[0])
            raise InvalidInputError(f"({px[at]:.4g}, {py[at]:.4g}) m lies outside the {self!r}")
        return px, py

    def _cell(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return height and slopes (per cell) of the triangle under each point, and the position in its cell."""
        u, v = (x - self.x[0]) / (self.x[1] - self.x[0]), (y - self.y[0]) / (self.y[1] - self.y[0])
        i, j = np.minimum(u.astype(int), len(self.x) - 2), np.minimum(v.astype(int), len(self.y) - 2)
        u, v = u - i, v - j
        z00, z10, z01, z11 = self.z[i, j], self.z[i + 1, j], self.z[i, j + 1], self.z[i + 1, j + 1]
        near = u + v <= 1.0
        du, dv = np.where(near, z10 - z00, z11 - z01), np.where(near, z01 - z00, z11 - z10)
        corner = np.where(near, z00, z10 + z01 - z11)
        return corner, du, dv, u, v

    def _height(self, x: Array, y: Array) -> Array:
        corner, du, dv, u, v = self._cell(x, y)
        return corner + du * u + dv * v

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the height (...) [m] of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""
        return self._height(*self._checked(x, y))

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the unit normal (..., 3) out of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""
        _, du, dv, _, _ = self._cell(*self._checked(x, y))
        slope_x, slope_y = du / (self.x[1] - self.x[0]), dv / (self.y[1] - self.y[0])
        normal = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def distance_along(self, origin: ArrayLike, direction: ArrayLike) -> Array:
        """Return the distance (...) [m] along a ray from ``origin`` (..., 3) [m] to the ground.

        ``direction`` (..., 3) is the ray's unit vector. The distance is inf if the ray leaves the grid. From an origin
        on or under the ground it is the vertical gap, which is zero or negative. The origin must lie inside the grid.
        """
        p, d = check_rays(origin, direction)
        gap = p[..., 2] - self.height(p[..., 0], p[..., 1])
        flat = [
            float(above) if above <= 0.0 else self._ray(o.tolist(), r.tolist())
            for above, o, r in zip(gap.flat, p.reshape(-1, 3), d.reshape(-1, 3), strict=True)
        ]
        return np.array(flat).reshape(gap.shape)

    @cached_property
    def _range(self) -> tuple[float, float]:
        return float(self.z.min()), float(self.z.max())

    def _ray(self, origin: list[float], direction: list[float]) -> float:
        """Return the distance to the ground along a ray from above it.

        Between two lines of the mesh, along x, y or a diagonal, ground and ray are straight. The first such piece at
        whose end the ray is under the ground contains the point where it enters it.
        """
        lowest, highest = self._range
        # The part of the ray over the grid, not above the highest point, and at most one metre below the lowest.
        begin, end = 0.0, math.inf
        slabs = ((self.x[0], self.x[-1]), (self.y[0], self.y[-1]), (lowest - 1.0, highest))
        for p, d, (low, high) in zip(origin, direction, slabs, strict=True):
            if d == 0.0:
                if p > high:
                    return math.inf
                continue
            first, last = sorted(((float(low) - p) / d, (float(high) - p) / d))
            begin, end = max(begin, first), min(end, last)
        if begin > end:
            return math.inf
        at = [np.array([begin, end])]
        u, du, v, dv = (
            number
            for axis, p, d in ((self.x, origin[0], direction[0]), (self.y, origin[1], direction[1]))
            for number in ((p - axis[0]) / (axis[1] - axis[0]), d / (axis[1] - axis[0]))
        )
        for place, speed in ((u, du), (v, dv), (u + v, du + dv)):
            if abs(speed) * (end - begin) > 0.0:
                low, high = sorted((place + begin * speed, place + end * speed))
                at.append((np.arange(math.ceil(low), math.floor(high) + 1) - place) / speed)
        t = np.sort(np.concatenate(at).clip(begin, end))
        x = (origin[0] + t * direction[0]).clip(self.x[0], self.x[-1])
        y = (origin[1] + t * direction[1]).clip(self.y[0], self.y[-1])
        gap = origin[2] + t * direction[2] - self._height(x, y)
        k = int(np.argmax(gap < 0.0))
        if gap[k] >= 0.0:
            return math.inf
        return float(t[k] if k == 0 else t[k - 1] + (t[k] - t[k - 1]) * gap[k - 1] / (gap[k - 1] - gap[k]))

    @cached_property
    def _mesh(self) -> GridMesh:
        return GridMesh(self.x, self.y, self.z)

    def shapes(self) -> tuple[GridMesh, ...]:
        """Return the surface as one triangle mesh, the same one in each call."""
        return (self._mesh,)


def _axis(name: str, values: ArrayLike) -> Array:
    """Return an axis of the grid (n,) [m] as float64; raise InvalidInputError if it is not evenly spaced."""
    axis = check_positions(name, values)
    if axis.ndim != 1 or len(axis) < 2:
        raise InvalidInputError(f"{name}: expected at least two evenly spaced values, got shape {axis.shape}")
    even = np.linspace(axis[0], axis[-1], len(axis))
    step = abs(even[1] - even[0])
    given = np.asarray(values).dtype
    single = given.kind == "f" and given.itemsize < axis.itemsize
    rounding = 2.0 * float(np.finfo(given).eps) * np.abs(axis).max() if single else 0.0
    off = np.abs(axis - even)
    # Rounding is as large as the spacing if a fine grid has large coordinates: such an axis has lost its values.
    if step == 0.0 or off.max() > max(1e-6 * step, min(rounding, 0.25 * step)):
        at = int(np.argmax(off)) if step > 0.0 else 0
        raise InvalidInputError(
            f"{name} must be at least two evenly spaced values, ascending or descending; value {at + 1} is "
            f"{axis[at]:.7g}, expected {even[at]:.7g}"
        )
    return even if single else axis
