"""Terrain from elevation data: a grid of heights, with two triangles in each cell."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, read_only
from hexakin.exceptions import InvalidInputError
from hexakin.terrain.base import TriangleMesh, check_points


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights ``z`` (nx, ny) [m] over an evenly spaced grid ``x`` (nx,), ``y`` (ny,) [m].

    Between the grid points the ground consists of flat triangles, the same for heights, normals and engines. A
    descending axis, as in images and elevation data, is turned round together with ``z``, so that ``x`` and ``y`` of
    the terrain ascend. An axis of single precision is evenly spaced if it is so up to its rounding. Raises
    InvalidInputError for a grid that is not evenly spaced and for values that are not finite. Its functions raise
    InvalidInputError for points outside the grid.
    """

    x: Array
    y: Array
    z: Array

    def __post_init__(self) -> None:
        x, y = (_axis(f"HeightField: {name}", getattr(self, name)) for name in ("x", "y"))
        z = check_array("HeightField: z", self.z, (len(x), len(y)))
        ways = [-1 if axis[0] > axis[1] else 1 for axis in (x, y)]
        for name, values in (("x", x[:: ways[0]]), ("y", y[:: ways[1]]), ("z", z[:: ways[0], :: ways[1]])):
            object.__setattr__(self, name, read_only(values))

    def __repr__(self) -> str:
        digest = hashlib.sha256(self.z.tobytes()).hexdigest()[:12]
        grid = f"{self.z.shape[0]} x {self.z.shape[1]} points"
        return (
            f"HeightField({grid}, x {self.x[0]:g} to {self.x[-1]:g} m, y {self.y[0]:g} to {self.y[-1]:g} m, {digest})"
        )

    def _cell(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array, Array, Array, Array]:
        """Return height and slopes (per cell) of the triangle under each point, and the position in its cell."""
        px, py = check_points(x, y)
        u, v = (px - self.x[0]) / (self.x[1] - self.x[0]), (py - self.y[0]) / (self.y[1] - self.y[0])
        outside = ~((px >= self.x[0]) & (px <= self.x[-1]) & (py >= self.y[0]) & (py <= self.y[-1]))
        if outside.any():
            at = tuple(np.argwhere(outside)[0])
            raise InvalidInputError(f"({px[at]:.4g}, {py[at]:.4g}) m lies outside the {self!r}")
        i, j = np.minimum(u.astype(int), len(self.x) - 2), np.minimum(v.astype(int), len(self.y) - 2)
        u, v = u - i, v - j
        z00, z10, z01, z11 = self.z[i, j], self.z[i + 1, j], self.z[i, j + 1], self.z[i + 1, j + 1]
        near = u + v <= 1.0
        du, dv = np.where(near, z10 - z00, z11 - z01), np.where(near, z01 - z00, z11 - z10)
        corner = np.where(near, z00, z10 + z01 - z11)
        return corner, du, dv, u, v

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the height (...) [m] of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""
        corner, du, dv, u, v = self._cell(x, y)
        return corner + du * u + dv * v

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the unit normal (..., 3) out of the ground at ``x`` (...) [m] and ``y`` (...) [m]."""
        _, du, dv, _, _ = self._cell(x, y)
        slope_x, slope_y = du / (self.x[1] - self.x[0]), dv / (self.y[1] - self.y[0])
        normal = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def distance_along(self, origin: ArrayLike, direction: ArrayLike) -> Array:
        """Return the distance (...) [m] along a ray from ``origin`` (..., 3) [m] to the ground.

        ``direction`` (..., 3) is the ray's unit vector. The distance is inf if the ray leaves the grid. From an origin
        under the ground it is the vertical gap, which is negative. The origin must lie inside the grid.
        """
        p, d = np.broadcast_arrays(check_array("origin", origin, (3,)), check_array("direction", direction, (3,)))
        flat = [self._ray(o, r) for o, r in zip(p.reshape(-1, 3), d.reshape(-1, 3), strict=True)]
        return np.array(flat).reshape(p.shape[:-1])

    def _ray(self, origin: Array, direction: Array) -> float:
        gap = float(origin[2] - self.height(origin[0], origin[1]))
        if gap <= 0.0:
            return gap
        if direction[2] >= 0.0 and origin[2] > self.z.max():
            return np.inf
        cell = min(self.x[1] - self.x[0], self.y[1] - self.y[0])
        longest = np.hypot(np.ptp(self.x), np.ptp(self.y)) + np.ptp(self.z) + abs(origin[2] - self.z.min())
        # Sample the ray every quarter of a cell, then bisect the first interval in which it crosses the ground.
        at = np.arange(0.0, longest, cell / 4.0)
        points = origin + at[:, None] * direction
        inside = (points[:, 0] >= self.x[0]) & (points[:, 0] <= self.x[-1])
        inside &= (points[:, 1] >= self.y[0]) & (points[:, 1] <= self.y[-1])
        count = len(at) if inside.all() else int(np.argmin(inside))
        below = points[:count, 2] < self.height(points[:count, 0], points[:count, 1])
        if not below.any():
            return np.inf
        low, high = at[np.argmax(below) - 1], at[np.argmax(below)]
        for _ in range(50):
            middle = 0.5 * (low + high)
            x, y, z = origin + middle * direction
            low, high = (low, middle) if z < self.height(x, y) else (middle, high)
        return float(high)

    def shapes(self) -> tuple[TriangleMesh, ...]:
        """Return the surface as one triangle mesh."""
        X, Y = np.meshgrid(self.x, self.y, indexing="ij")
        vertices = np.stack([X, Y, self.z], axis=-1).reshape(-1, 3)
        index = np.arange(self.z.size).reshape(self.z.shape)
        a, b, c, d = index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]
        triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])
        return (TriangleMesh(vertices, triangles),)


def _axis(name: str, values: ArrayLike) -> Array:
    """Return an axis of the grid (n,) [m] as float64; raise InvalidInputError if it is not evenly spaced."""
    axis = check_array(name, values, ())
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
