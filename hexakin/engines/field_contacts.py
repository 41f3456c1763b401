"""Search for contacts of spheres and boxes with a height field, compiled.

The rules are those of ``hexakin.engines.ground_contacts``. Blocks of cells are left out whose bounds exclude a contact,
so that the time of a search hardly depends on the number of points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.engines.field_grid import Field, block_cells, field_cells, field_triangle, first_block, next_block
from hexakin.engines.ground_grid import SAME, nearest_on_triangle, point_under_triangle
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, part

_CANDIDATES = 64  # largest number of boxes and triangles near one sphere that are compared; the closest of more


class Scratch(NamedTuple):
    """Arrays that the search for contacts overwrites; made once, because this takes as long as a search.

    Parameters
    ----------
    rows, items
        Up to n closest points of a sphere (n, 7), as in ``field_sphere``, and the numbers of their items (n,).
    row, triangle
        One closest point (7,) and one triangle (12,).
    best, deepest
        The deepest vertices (24, 3) [m] in a box, as in ``keep_deepest``, and their depths (24,) [m].
    point, center, rotation
        A point (3,) [m], and centre (3,) [m] and rotation (3, 3) of a box.
    """

    rows: Array
    items: Whole
    row: Array
    triangle: Array
    best: Array
    deepest: Array
    point: Array
    center: Array
    rotation: Array

    def __repr__(self) -> str:
        return short_repr(self)


def empty_scratch() -> Scratch:
    """Return arrays for a search."""
    items = np.zeros(_CANDIDATES, dtype=np.int64)
    sizes = ((_CANDIDATES, 7), 7, 12, (24, 3), 24, 3, 3, (3, 3))
    rows, *others = (np.zeros(size) for size in sizes)
    return Scratch(rows, items, *others)


@part
def field_sphere(field: Field, x: float, y: float, z: float, radius: float, margin: float, scratch: Scratch) -> int:
    """Find the contacts of a sphere with a height field that have gaps of up to ``margin`` [m]; return their number.

    (``x``, ``y``, ``z``) [m] is the centre of the sphere and ``radius`` [m] its radius, 0 for a corner of a box.
    ``scratch.rows`` (n, 7) is overwritten with the closest point (3), the unit vector from there to the centre (3) and
    the signed distance [m] of each contact, and ``scratch.items`` (n,) with the numbers of their triangles. Of more
    than n contacts the closest are kept.
    """
    found, T, row = 0, scratch.triangle, scratch.row
    reach = SAME if radius == 0.0 else radius + margin
    i0, i1 = field_cells(field.x, x, reach)
    j0, j1 = field_cells(field.y, y, reach)
    if radius == 0.0:
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for far in range(2):
                    field_triangle(field, i, j, far, T)
                    _set_normal(T)
                    point_under_triangle(T, x, y, z, row)
                    if row[6] <= margin:
                        found = _added(row, _number(field, i, j, far), scratch, found)
        return found
    window = (i0, i1, j0, j1)
    level, i, j, top = first_block(field, window)
    while level >= 0:
        near, around_x, around_y = _contact_places(field, level, i, j, x, y, z, reach)
        if near and level == 0:
            a0, a1, b0, b1 = block_cells(window, level, i, j)
            c0, c1 = field_cells(field.x, around_x[0], around_x[1])
            d0, d1 = field_cells(field.y, around_y[0], around_y[1])
            for a in range(max(a0, c0), min(a1, c1) + 1):
                for b in range(max(b0, d0), min(b1, d1) + 1):
                    for far in range(2):
                        if _is_contact(field, a, b, far, x, y, z, reach, T, row):
                            found = _added(row, _number(field, a, b, far), scratch, found)
        level, i, j = next_block(window, top, level, i, j, near and level > 0)
    return found


@part
def _number(field: Field, i: int, j: int, far: int) -> int:
    """Number of a triangle, as in GridMesh."""
    return (far * (field.x.size - 1) + i) * (field.y.size - 1) + j


@part
def _added(row: Array, item: int, scratch: Scratch, found: int) -> int:
    """Append a contact unless its point is one of the ``found`` points before it; return the new number."""
    rows = scratch.rows
    for k in range(found):
        if (rows[k, 0] - row[0]) ** 2 + (rows[k, 1] - row[1]) ** 2 + (rows[k, 2] - row[2]) ** 2 <= SAME * SAME:
            return found
    return keep_closest(row, item, scratch, found)


@part
def keep_closest(row: Array, item: int, scratch: Scratch, found: int) -> int:
    """Append ``row`` (7,) to ``scratch.rows``, and ``item`` to ``scratch.items``; return the new number of rows.

    They hold ``found`` rows before. If they are full, the one with the largest distance is left out.
    """
    rows, place = scratch.rows, found
    if found == rows.shape[0]:
        place = 0
        for k in range(found):
            if rows[k, 6] > rows[place, 6]:
                place = k
        if rows[place, 6] <= row[6]:
            return found
    for a in range(7):
        rows[place, a] = row[a]
    scratch.items[place] = item
    return max(found, place + 1)


@part
def _contact_places(
    field: Field, level: int, i: int, j: int, x: float, y: float, z: float, reach: float
) -> tuple[bool, tuple[float, float], tuple[float, float]]:
    """Where a block may have points whose distance to (``x``, ``y``, ``z``) [m], up to ``reach`` [m], is a minimum.

    Such a point is some distance w under the centre and, with the slope s of the ground there, s * w beside it: the
    line from it to the centre is normal to a triangle, or at an edge or a vertex between the normals of its triangles.
    Where this is beyond the end of the field, the point is at the end. Returns whether there may be such points, and
    the middle and half the width [m] of their range in x and in y.
    """
    block, bounds = field.levels[level, 0] + i * field.levels[level, 2] + j, field.bounds
    low, high = z - bounds[block, 1], min(z - bounds[block, 0], reach)
    a = _range(field.x, x, bounds[block, 2], bounds[block, 3], low, high)
    b = _range(field.y, y, bounds[block, 4], bounds[block, 5], low, high)
    size = 4 << 2 * level
    near = (
        low <= reach
        and a[0] + a[1] >= field.x[i * size]
        and a[0] - a[1] <= field.x[min((i + 1) * size, field.x.size - 1)]
        and b[0] + b[1] >= field.y[j * size]
        and b[0] - b[1] <= field.y[min((j + 1) * size, field.y.size - 1)]
    )
    return near, a, b


@part
def _range(axis: Array, place: float, low: float, high: float, w_low: float, w_high: float) -> tuple[float, float]:
    """Middle and half the width [m] of the range of place + s * w on an axis, with s and w in the given ranges."""
    p, q, r, s = low * w_low, low * w_high, high * w_low, high * w_high
    least = min(max(place + min(min(p, q), min(r, s)), axis[0]), axis[axis.size - 1])
    most = min(max(place + max(max(p, q), max(r, s)), axis[0]), axis[axis.size - 1])
    return 0.5 * (least + most), 0.5 * (most - least) + SAME + 1e-9 * (most - least)


@part
def _is_contact(
    field: Field, i: int, j: int, far: int, x: float, y: float, z: float, reach: float, T: Array, row: Array
) -> bool:
    """Whether the distance between a triangle and the point (``x``, ``y``, ``z``) [m] is a minimum up to ``reach`` [m].

    The triangle is that of ``field_triangle``, written to ``T`` (12,). ``row`` (7,) is overwritten with one row of
    ``field_sphere``.
    """
    field_triangle(field, i, j, far, T)
    cx, cy, cz, inside = nearest_on_triangle(T, x, y, z)
    dx, dy, dz = x - cx, y - cy, z - cz
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    if distance > reach and not inside:
        return False
    if inside or distance <= SAME:
        _set_normal(T)
        row[3], row[4], row[5] = T[9], T[10], T[11]
        distance = np.copysign(distance, dx * T[9] + dy * T[10] + dz * T[11])
    elif dz <= 0.0 or not _is_closest_around(field, x, y, z, cx, cy, cz):
        # A centre under the ground has contacts with the closest points inside triangles only.
        return False
    else:
        row[3], row[4], row[5] = dx / distance, dy / distance, dz / distance
    row[0], row[1], row[2], row[6] = cx, cy, cz, distance
    return distance <= reach


@part
def _set_normal(T: Array) -> None:
    """Write the unit normal of a triangle of a height field to the last three numbers of ``T`` (12,)."""
    ux, uy, uz, wx, wy, wz = T[3] - T[0], T[4] - T[1], T[5] - T[2], T[6] - T[0], T[7] - T[1], T[8] - T[2]
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    size = np.sqrt(nx * nx + ny * ny + nz * nz)
    T[9], T[10], T[11] = nx / size, ny / size, nz / size


@part
def _is_closest_around(field: Field, x: float, y: float, z: float, cx: float, cy: float, cz: float) -> bool:
    """Whether (``cx``, ``cy``, ``cz``) [m], a point on edges of triangles, is their closest point to (x, y, z) [m].

    It is if the line from it to that point makes no acute angle with the line to any of their vertices.
    """
    i0, i1 = field_cells(field.x, cx, SAME)
    j0, j1 = field_cells(field.y, cy, SAME)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            size_x, size_y = field.x[i + 1] - field.x[i], field.y[j + 1] - field.y[j]
            u, v, rounding = (cx - field.x[i]) / size_x, (cy - field.y[j]) / size_y, SAME / min(size_x, size_y)
            if min(u, v) < -rounding or max(u, v) > 1.0 + rounding:
                continue
            for k in range(4):  # corner (a, b) of the cell; the diagonal joins (1, 0) and (0, 1)
                a, b = k >> 1, k & 1
                if (a == b == 0 and u + v > 1.0 + rounding) or (a == b == 1 and u + v < 1.0 - rounding):
                    continue
                vx, vy, vz = field.x[i + a] - cx, field.y[j + b] - cy, field.z[i + a, j + b] - cz
                if (x - cx) * vx + (y - cy) * vy + (z - cz) * vz > SAME * (size_x + size_y):
                    return False
    return True


@part
def field_near(field: Field, R: Array, center: Array, half: Array, margin: float) -> bool:
    """Whether a height field may penetrate a box or be within ``margin`` [m] of it.

    ``R`` (3, 3), ``center`` (3,) [m] and ``half`` (3,) [m] are its rotation, centre and half edge lengths.
    """
    window = _window(field, R, center, half, margin)
    low = center[2] - extent(R, half, 0.0, 0.0, 1.0) - margin
    level, i, j, top = first_block(field, window)
    while level >= 0:
        near = _block_meets(field, level, i, j, R, center, half, margin)
        if near and level == 0:
            a0, a1, b0, b1 = block_cells(window, level, i, j)
            for a in range(a0, a1 + 2):
                for b in range(b0, b1 + 2):
                    if field.z[a, b] >= low:
                        return True
        level, i, j = next_block(window, top, level, i, j, near and level > 0)
    return False


@part
def field_vertices(field: Field, R: Array, center: Array, half: Array, margin: float, scratch: Scratch) -> None:
    """Find the deepest vertex of a height field in each quarter of each face of a box, with ``keep_deepest``.

    The box is that of ``field_near``.
    """
    point = scratch.point
    window = _window(field, R, center, half, margin)
    level, i, j, top = first_block(field, window)
    while level >= 0:
        near = _block_meets(field, level, i, j, R, center, half, margin)
        if near and level == 0:
            a0, a1, b0, b1 = block_cells(window, level, i, j)
            # The last point of a cell belongs to the next cell, except at the end of the window.
            for a in range(a0, a1 + (2 if a1 == window[1] else 1)):
                for b in range(b0, b1 + (2 if b1 == window[3] else 1)):
                    point[0], point[1], point[2] = field.x[a], field.y[b], field.z[a, b]
                    keep_deepest(R, center, half, scratch)
        level, i, j = next_block(window, top, level, i, j, near and level > 0)


@part
def keep_deepest(R: Array, center: Array, half: Array, scratch: Scratch) -> None:
    """Keep ``scratch.point`` (3,) [m] if it is the deepest in its quarter of a face of a box.

    Quarter ``8 * axis + octant`` has the face along ``axis``, and the corner with the signs in ``octant``: 1 for +x, 2
    for +y, 4 for +z. ``scratch.best`` (24, 3) [m] and ``scratch.deepest`` (24,) [m] are the deepest points and their
    depths.
    """
    point = scratch.point
    depth, axis, octant = np.inf, 0, 0
    for a in range(3):
        local = 0.0
        for b in range(3):
            local += R[b, a] * (point[b] - center[b])
        if half[a] - abs(local) < depth:
            depth, axis = half[a] - abs(local), a
        octant += (1 << a) if local > 0.0 else 0
    quarter = 8 * axis + octant
    if depth > scratch.deepest[quarter]:
        scratch.deepest[quarter] = depth
        for b in range(3):
            scratch.best[quarter, b] = point[b]


@part
def extent(R: Array, half: Array, x: float, y: float, z: float) -> float:
    """Half the extent [m] of a box along the direction (x, y, z); rotation and size as for ``field_near``."""
    reach = 0.0
    for a in range(3):
        reach += abs(R[0, a] * x + R[1, a] * y + R[2, a] * z) * half[a]
    return reach


@part
def _window(field: Field, R: Array, center: Array, half: Array, margin: float) -> tuple[int, int, int, int]:
    """First and last i, first and last j of the cells under a box and within ``margin`` [m] beside it."""
    i0, i1 = field_cells(field.x, center[0], extent(R, half, 1.0, 0.0, 0.0) + margin)
    j0, j1 = field_cells(field.y, center[1], extent(R, half, 0.0, 1.0, 0.0) + margin)
    return i0, i1, j0, j1


@part
def _block_meets(field: Field, level: int, i: int, j: int, R: Array, center: Array, half: Array, margin: float) -> bool:
    """Whether the bounds of a block meet a box or come within ``margin`` [m] of one of its faces."""
    block, bounds = field.levels[level, 0] + i * field.levels[level, 2] + j, field.bounds
    size = 4 << 2 * level
    x0, x1 = field.x[i * size], field.x[min((i + 1) * size, field.x.size - 1)]
    y0, y1 = field.y[j * size], field.y[min((j + 1) * size, field.y.size - 1)]
    dx, dy, dz = (
        0.5 * (x0 + x1) - center[0],
        0.5 * (y0 + y1) - center[1],
        0.5 * (bounds[block, 0] + bounds[block, 1]) - center[2],
    )
    ex, ey, ez = 0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (bounds[block, 1] - bounds[block, 0])
    for a in range(3):
        away = abs(R[0, a] * dx + R[1, a] * dy + R[2, a] * dz)
        if away > half[a] + margin + abs(R[0, a]) * ex + abs(R[1, a]) * ey + abs(R[2, a]) * ez + SAME:
            return False
    return True
