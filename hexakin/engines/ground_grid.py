"""A terrain as shapes in the cells of a grid, and the search for its closest point, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.engines.field_grid import Field, compile_field, no_field
from hexakin.exceptions import InvalidInputError, shown
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, part
from hexakin.terrain.base import Box, HalfSpace, Terrain, TriangleMesh
from hexakin.terrain.height_field import GridMesh

SAME = 1e-9  # [m] points that are closer count as the same point


class Ground(NamedTuple):
    """A terrain for the compiled search.

    Boxes, triangles and vertices are items with consecutive numbers, in this order. Each square cell of a horizontal
    grid has a list of the items whose projection meets it. A height field needs no lists, because the place of a
    triangle in its grid gives its number; its triangles are numbered after the others.

    Parameters
    ----------
    planes
        A point [m] and the unit normal of each plane (k, 6).
    boxes
        Lower and upper corner (b, 6) [m] of each box.
    triangles
        Three vertices [m] and the unit normal of each triangle (t, 12).
    vertices
        Vertices (w, 3) [m] of the triangles.
    corner
        Smallest x and y (2,) [m] of the grid.
    cell
        Edge length [m] of a cell.
    shape
        Numbers (2,) of cells in x and y. Cell (i, j) has the number c = i * shape[1] + j.
    start, items
        The items of cell c are ``items[start[c]:start[c + 1]]``.
    top
        Greatest height (cells,) [m] of the items of each cell; -inf for a cell without items.
    field
        The height field, or a field without points.
    highest
        Greatest height [m] of all but the planes; -inf if there are only planes.
    """

    planes: Array
    boxes: Array
    triangles: Array
    vertices: Array
    corner: Array
    cell: float
    shape: Whole
    start: Whole
    items: Whole
    top: Array
    field: Field
    highest: float

    def __repr__(self) -> str:
        return short_repr(self)


def compile_ground(terrain: Terrain) -> Ground:
    """Return the shapes of ``terrain`` in a grid, as a Ground.

    Raises InvalidInputError for a type of shape that this engine does not support and for a triangle without area.
    """
    planes, boxes, meshes, field = [], [], [], no_field()
    for shape in terrain.shapes():
        if isinstance(shape, HalfSpace):
            planes.append([*shape.point, *shape.normal])
        elif isinstance(shape, Box):
            boxes.append([*shape.lower, *shape.upper])
        elif isinstance(shape, GridMesh) and field.z.size == 0:
            field = compile_field(shape)
        elif isinstance(shape, TriangleMesh):
            meshes.append(shape)
        else:
            raise InvalidInputError(f"terrain: shape {shown(shape)} is not supported by engine 'rigid'")
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes] or [np.zeros((0, 3, 3))])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1, keepdims=True)
    if (areas <= 0.0).any():
        raise InvalidInputError(f"terrain: triangle {int(np.argmin(areas)) + 1} of its mesh has no area")
    triangles = np.concatenate([corners.reshape(-1, 9), normals / areas], axis=1)
    vertices = np.concatenate([mesh.vertices for mesh in meshes] or [np.zeros((0, 3))])
    solid = np.array(boxes, dtype=float).reshape(-1, 6)
    low = np.concatenate([solid[:, :2], corners[:, :, :2].min(axis=1), vertices[:, :2]])
    high = np.concatenate([solid[:, 3:5], corners[:, :, :2].max(axis=1), vertices[:, :2]])
    heights = np.concatenate([solid[:, 5], corners[:, :, 2].max(axis=1), vertices[:, 2]])
    areal = (high - low).max(axis=1)
    areal = areal[areal > 0.0]
    corner = low.min(axis=0) if len(low) else np.zeros(2)
    span = high.max(axis=0) - corner if len(low) else np.zeros(2)
    # About one shape per cell, and at most a million cells.
    cell = float(max(np.median(areal) if len(areal) else 1.0, np.sqrt(span[0] * span[1] / 1e6), 1e-6))
    cells = np.floor(span / cell).astype(np.int64) + 1
    first, last = np.floor((low - corner) / cell).astype(np.int64), np.floor((high - corner) / cell).astype(np.int64)
    sizes = last - first + 1
    counts = sizes.prod(axis=1)
    owner = np.repeat(np.arange(len(low)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    i, j = first[owner].T + np.divmod(place, sizes[owner, 1])
    number, total = i * cells[1] + j, int(cells.prod())
    start = np.concatenate([[0], np.cumsum(np.bincount(number, minlength=total))]).astype(np.int64)
    items = owner[np.argsort(number, kind="stable")].astype(np.int64)
    top = np.full(total, -np.inf)
    np.maximum.at(top, number, heights[owner])
    half_spaces = np.array(planes, dtype=float).reshape(-1, 6)
    highest = float(max(top.max(), field.bounds[:, 1].max(initial=-np.inf)))
    return Ground(half_spaces, solid, triangles, vertices, corner, cell, cells, start, items, top, field, highest)


@part
def nearest_on_triangle(T: Array, px: float, py: float, pz: float) -> tuple[float, float, float, bool]:
    """Closest point of a triangle to a point, and whether it is in the triangle's interior, not on its border.

    ``T`` (12,) is the triangle, as in ``Ground``, and (``px``, ``py``, ``pz``) [m] the point.

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
    """
    ax, ay, az = T[0], T[1], T[2]
    ux, uy, uz = T[3] - ax, T[4] - ay, T[5] - az
    wx, wy, wz = T[6] - ax, T[7] - ay, T[8] - az
    qx, qy, qz = px - ax, py - ay, pz - az
    d1, d2 = ux * qx + uy * qy + uz * qz, wx * qx + wy * qy + wz * qz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, False
    uu, uw, ww = ux * ux + uy * uy + uz * uz, ux * wx + uy * wy + uz * wz, wx * wx + wy * wy + wz * wz
    d3, d4 = d1 - uu, d2 - uw
    if d3 >= 0.0 and d4 <= d3:
        return T[3], T[4], T[5], False
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3)
        return ax + s * ux, ay + s * uy, az + s * uz, False
    d5, d6 = d1 - uw, d2 - ww
    if d6 >= 0.0 and d5 <= d6:
        return T[6], T[7], T[8], False
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s = d2 / (d2 - d6)
        return ax + s * wx, ay + s * wy, az + s * wz, False
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        s = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return T[3] + s * (wx - ux), T[4] + s * (wy - uy), T[5] + s * (wz - uz), False
    total = 1.0 / (va + vb + vc)
    s, t = vb * total, vc * total
    return ax + s * ux + t * wx, ay + s * uy + t * wy, az + s * uz + t * wz, True


@part
def _box_distance(B: Array, x: float, y: float, z: float) -> float:
    """Distance [m] from a point to a box; 0 inside the box."""
    dx, dy, dz = max(B[0] - x, 0.0, x - B[3]), max(B[1] - y, 0.0, y - B[4]), max(B[2] - z, 0.0, z - B[5])
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@part
def nearest_point(ground: Ground, item: int, x: float, y: float, z: float, row: Array) -> None:
    """Find the closest point of a box or triangle to the point (``x``, ``y``, ``z``) [m].

    ``item`` is the number of the box or triangle of ``ground``. ``row`` (7,) is overwritten with the closest point (3),
    the unit vector from there to the given point (3) and the signed distance, negative inside.
    """
    if item < ground.boxes.shape[0]:
        B = ground.boxes[item]
        cx, cy, cz = min(max(x, B[0]), B[3]), min(max(y, B[1]), B[4]), min(max(z, B[2]), B[5])
        dx, dy, dz = x - cx, y - cy, z - cz
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        if distance > 0.0:
            row[3], row[4], row[5] = dx / distance, dy / distance, dz / distance
        else:
            # The point is inside the box: the direction is that to the nearest face other than the bottom.
            distance, row[3], row[4], row[5] = z - B[5], 0.0, 0.0, 1.0
            cz = B[5]
            for axis in range(2):
                c = x if axis == 0 else y
                for side in range(2):
                    depth = B[axis] - c if side == 0 else c - B[3 + axis]
                    if depth > distance:
                        sign = -1.0 if side == 0 else 1.0
                        distance, row[3], row[4], row[5] = depth, 0.0, 0.0, 0.0
                        row[3 + axis] = sign
            cx, cy, cz = x - distance * row[3], y - distance * row[4], z - distance * row[5]
    else:
        T = ground.triangles[item - ground.boxes.shape[0]]
        cx, cy, cz, inside = nearest_on_triangle(T, x, y, z)
        dx, dy, dz = x - cx, y - cy, z - cz
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        below = dx * T[9] + dy * T[10] + dz * T[11] < 0.0
        if inside or distance <= SAME:
            row[3], row[4], row[5] = T[9], T[10], T[11]
            distance = -distance if below else distance
        elif below:
            distance = np.inf  # below the triangle's plane and beyond its edge: left to the adjacent triangle
        else:
            row[3], row[4], row[5] = dx / distance, dy / distance, dz / distance
    row[0], row[1], row[2], row[6] = cx, cy, cz, distance


@part
def point_under_triangle(T: Array, x: float, y: float, z: float, row: Array) -> None:
    """Find the closest point of the plane of a triangle, for a point that may be in the ground.

    ``T`` (12,) is the triangle, and ``row`` (7,) as for ``nearest_point``. The distance in it is inf unless the point
    (``x``, ``y``, ``z``) [m] is vertically above or below the triangle.
    """
    row[6] = np.inf
    for k in range(3):
        a, b = 3 * k, 3 * ((k + 1) % 3)
        if (T[b] - T[a]) * (y - T[a + 1]) - (T[b + 1] - T[a + 1]) * (x - T[a]) < 0.0:
            return
    distance = (x - T[0]) * T[9] + (y - T[1]) * T[10] + (z - T[2]) * T[11]
    row[0], row[1], row[2] = x - distance * T[9], y - distance * T[10], z - distance * T[11]
    row[3], row[4], row[5], row[6] = T[9], T[10], T[11], distance


@part
def lies_on(ground: Ground, item: int, x: float, y: float, z: float) -> bool:
    """Whether the point (``x``, ``y``, ``z``) [m] is on or in box or triangle number ``item`` of ``ground``."""
    if item < ground.boxes.shape[0]:
        return _box_distance(ground.boxes[item], x, y, z) <= SAME
    cx, cy, cz, _ = nearest_on_triangle(ground.triangles[item - ground.boxes.shape[0]], x, y, z)
    return (cx - x) ** 2 + (cy - y) ** 2 + (cz - z) ** 2 <= SAME * SAME


@part
def cells_within(ground: Ground, x: float, y: float, reach: float) -> tuple[int, int, int, int]:
    """First and last i, then first and last j, of the cells of ``ground`` within ``reach`` [m] of a point.

    The point is (``x``, ``y``) [m]. The ranges are empty if the point is farther than that from the grid.
    """
    i0 = max(int(np.floor((x - reach - ground.corner[0]) / ground.cell)), 0)
    i1 = min(int(np.floor((x + reach - ground.corner[0]) / ground.cell)), ground.shape[0] - 1)
    j0 = max(int(np.floor((y - reach - ground.corner[1]) / ground.cell)), 0)
    j1 = min(int(np.floor((y + reach - ground.corner[1]) / ground.cell)), ground.shape[1] - 1)
    return i0, i1, j0, j1
