"""Contacts of two convex shapes, spheres or boxes, compiled.

Two boxes are separated most, or penetrate least, along a normal of a face or along a normal of two edges, one of each
box (S. Gottschalk, M. C. Lin and D. Manocha, "OBBTree: a hierarchical structure for rapid interference detection",
1996). Faces that lie on each other touch in a polygon: the face of one box, clipped by the sides of the other (C.
Ericson, "Real-Time Collision Detection", 2005, section 8.3.4). Its corners are the contacts.

A box is an array (15,): its three axes, its centre [m] and its half edge lengths [m]. Contacts are written to ``rows``
(16, 7): a point half-way between the surfaces (3) [m], the unit vector from the second shape to the first (3) and the
gap [m], negative if the shapes penetrate.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.engines.ground_grid import SAME
from hexakin.numerics.numba_cache import inlined, no_new_arrays, part
from hexakin.numerics.vectors import Vector, cross, dot, entries, minus, plus, times, write_vector

MOST_POINTS = 16  # contacts of two shapes: eight corners of a polygon, or all corners of both boxes
_FLUSH = 1e-3  # [m] height above the deepest point up to which points of two faces are contacts
_PARALLEL = 1e-10  # squared sine of the angle of two edges below which they have no common normal


@no_new_arrays
def box_box(A: Array, B: Array, margin: float, polygon: Array, rows: Array) -> int:
    """Write the contacts of boxes ``A`` and ``B`` with gaps of up to ``margin`` [m] to ``rows``; return their number.

    ``polygon`` (2, 8, 3) is overwritten. Contacts have one normal, unless a corner of a box that does not penetrate the
    other is closest to an edge or a corner.
    """
    between = minus(entries(B, 9), entries(A, 9))
    widest, kind, n = -np.inf, 0, between
    for k in range(15):
        if k < 3:
            axis = entries(A, 3 * k)
        elif k < 6:
            axis = entries(B, 3 * (k - 3))
        else:
            axis = cross(entries(A, 3 * ((k - 6) // 3)), entries(B, 3 * ((k - 6) % 3)))
            square = dot(axis, axis)
            if square < _PARALLEL:
                continue
            axis = times(1.0 / np.sqrt(square), axis)
        along = dot(between, axis)
        gap = abs(along) - _half_width(A, axis) - _half_width(B, axis)
        if gap > margin:
            return 0
        if gap > widest + SAME:
            widest, kind, n = gap, k, axis if along >= 0.0 else times(-1.0, axis)
    count = 0
    if kind < 3 or (kind >= 6 and _lies_flat(A, n)):
        count = _faces(A, B, n, widest, margin, polygon, rows)
    elif kind < 6 or _lies_flat(B, n):
        count = _faces(B, A, times(-1.0, n), widest, margin, polygon, rows)
        for k in range(count):
            for a in range(3, 6):
                rows[k, a] = -rows[k, a]
    closest = np.inf
    for k in range(count):
        closest = min(closest, rows[k, 6])
    if count == 0 or (widest > 0.0 and closest > widest + SAME):
        # The faces are not above each other where the boxes are closest.
        count = _edges(A, B, (kind - 6) // 3, (kind - 6) % 3, n, widest, rows) if kind >= 6 else 0
        if count == 0 and widest > 0.0:
            count = _corners(A, B, margin, rows)
    return count


@part
def _half_width(box: Array, n: Vector) -> float:
    """Half the width [m] of a box along the unit vector ``n``."""
    return (
        box[12] * abs(dot(entries(box, 0), n))
        + box[13] * abs(dot(entries(box, 3), n))
        + box[14] * abs(dot(entries(box, 6), n))
    )


@part
def _steepest(box: Array, n: Vector) -> int:
    """Return the number of the axis of a box that makes the smallest angle with the line along ``n``."""
    axis, most = 0, -1.0
    for k in range(3):
        share = abs(dot(entries(box, 3 * k), n))
        if share > most:
            axis, most = k, share
    return axis


@part
def _lies_flat(box: Array, n: Vector) -> bool:
    """Whether all corners of a face of a box are as deep as the deepest along ``n``, to ``_FLUSH``."""
    axis = _steepest(box, n)
    rise = _half_width(box, n) - box[12 + axis] * abs(dot(entries(box, 3 * axis), n))
    return 2.0 * rise <= _FLUSH


@part
def _faces(A: Array, B: Array, n: Vector, least: float, margin: float, polygon: Array, rows: Array) -> int:
    """Write the contacts of a face of box ``A`` with a face of box ``B`` to ``rows``; return their number.

    The unit vector ``n`` points from A to B, nearly along the normal of A's face. Points of B's face are contacts if
    they are above A's face, not more than ``_FLUSH`` above the deepest and not more than ``margin`` [m] above A. The
    gaps are at least ``least`` [m], the gap of the boxes along n.
    """
    axis = _steepest(A, n)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    normal, u, v = entries(A, 3 * axis), entries(A, 3 * first), entries(A, 3 * second)
    if dot(normal, n) < 0.0:
        normal = times(-1.0, normal)
    facing = _steepest(B, normal)
    e, f, g = entries(B, 3 * facing), entries(B, 3 * ((facing + 1) % 3)), entries(B, 3 * ((facing + 2) % 3))
    up = 1.0 if dot(e, normal) < 0.0 else -1.0
    middle = plus(minus(entries(B, 9), entries(A, 9)), times(up * B[12 + facing], e))
    f, g = times(B[12 + (facing + 1) % 3], f), times(B[12 + (facing + 2) % 3], g)
    for k in range(4):
        p = plus(middle, times(1.0 if k == 0 or k == 3 else -1.0, f))
        p = plus(p, times(1.0 if k < 2 else -1.0, g))
        polygon[0, k, 0], polygon[0, k, 1], polygon[0, k, 2] = dot(p, u), dot(p, v), dot(p, normal) - A[12 + axis]
    count = 4
    for side in range(4):
        sign = 1.0 if side < 2 else -1.0
        size = A[12 + first] if side % 2 == 0 else A[12 + second]
        count = _clipped(polygon, side % 2, count, side % 2, sign, size)
    slope = dot(normal, n)
    deepest = margin
    for k in range(count):
        polygon[0, k, 2] /= slope
        deepest = min(deepest, max(polygon[0, k, 2], least))
    kept = 0
    for k in range(count):
        gap = max(polygon[0, k, 2], least)
        if gap <= min(deepest + _FLUSH, margin):
            p = plus(times(polygon[0, k, 0], u), times(polygon[0, k, 1], v))
            p = plus(plus(entries(A, 9), p), times(A[12 + axis], normal))
            write_vector(plus(p, times(0.5 * gap, n)), rows, kept, 0)
            write_vector(times(-1.0, n), rows, kept, 3)
            rows[kept, 6] = gap
            kept += 1
    return kept


@part
def _clipped(polygon: Array, source: int, count: int, axis: int, sign: float, size: float) -> int:
    """Clip a polygon of ``count`` corners by sign * x <= size, with x its coordinate ``axis``; return the new count.

    The corners are in ``polygon[source]``, the new ones in the other half of ``polygon`` (2, 8, 3).

    I. E. Sutherland and G. W. Hodgman, "Reentrant polygon clipping", 1974.
    """
    kept, target = 0, 1 - source
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        here, there = sign * polygon[source, k, axis] - size, sign * polygon[source, after, axis] - size
        if here <= SAME and kept < 8:
            for a in range(3):
                polygon[target, kept, a] = polygon[source, k, a]
            kept += 1
        # An edge that begins or ends on the border has a corner there already.
        if (here < -SAME and there > SAME) or (here > SAME and there < -SAME):
            share = here / (here - there)
            if kept < 8:
                for a in range(3):
                    step = polygon[source, after, a] - polygon[source, k, a]
                    polygon[target, kept, a] = polygon[source, k, a] + share * step
                kept += 1
    return kept


@part
def _edges(A: Array, B: Array, i: int, j: int, n: Vector, gap: float, rows: Array) -> int:
    """Write the contact of an edge along axis ``i`` of box ``A`` with one along axis ``j`` of box ``B`` to ``rows``.

    The unit vector ``n`` from A to B is perpendicular to both edges, and ``gap`` [m] is their distance along it.
    Returns the number of contacts, which is 0 if the closest points of the two lines are beyond the ends of the edges.
    """
    u, v = entries(A, 3 * i), entries(B, 3 * j)
    p, q = entries(A, 9), entries(B, 9)
    for k in range(3):
        mine, other = entries(A, 3 * k), entries(B, 3 * k)
        if k != i:
            p = plus(p, times(A[12 + k] if dot(mine, n) > 0.0 else -A[12 + k], mine))
        if k != j:
            q = plus(q, times(-B[12 + k] if dot(other, n) > 0.0 else B[12 + k], other))
    across = minus(q, p)
    b, c, d = dot(u, v), dot(u, across), dot(v, across)
    s, t = (c - b * d) / (1.0 - b * b), (b * c - d) / (1.0 - b * b)
    if abs(s) > A[12 + i] + SAME or abs(t) > B[12 + j] + SAME:
        return 0
    p, q = plus(p, times(s, u)), plus(q, times(t, v))
    write_vector(times(0.5, plus(p, q)), rows, 0, 0)
    write_vector(times(-1.0, n), rows, 0, 3)
    rows[0, 6] = gap
    return 1


@part
def _corners(A: Array, B: Array, margin: float, rows: Array) -> int:
    """Write the corners of each box that are closest to the other to ``rows``; return their number.

    The boxes do not penetrate each other. Corners count up to ``_FLUSH`` farther than the closest, and up to ``margin``
    [m].
    """
    count, closest = 0, margin
    for k in range(16):
        box, other, sign = (A, B, 1.0) if k < 8 else (B, A, -1.0)
        corner = entries(box, 9)
        for a in range(3):
            corner = plus(corner, times(box[12 + a] if k & (1 << a) else -box[12 + a], entries(box, 3 * a)))
        point, n, gap = _nearest(other, corner)
        write_vector(times(0.5, plus(point, corner)), rows, count, 0)
        write_vector(times(sign, n), rows, count, 3)
        rows[count, 6] = gap
        closest = min(closest, gap)
        count += 1
    kept = 0
    for k in range(count):
        if rows[k, 6] <= min(closest + _FLUSH, margin):
            for a in range(7):
                rows[kept, a] = rows[k, a]
            kept += 1
    return kept


@part
def _nearest(box: Array, x: Vector) -> tuple[Vector, Vector, float]:
    """Return the point of a box's surface that is closest to ``x`` [m], the unit vector from there and the distance.

    The distance is negative, and the vector points out of the box, if ``x`` is in the box.
    """
    away, out = minus(x, entries(box, 9)), (0.0, 0.0, 0.0)
    depth, nearest_face = -np.inf, (0.0, 0.0, 1.0)
    for a in range(3):
        along = dot(away, entries(box, 3 * a))
        beyond, normal = abs(along) - box[12 + a], times(1.0 if along >= 0.0 else -1.0, entries(box, 3 * a))
        if beyond > 0.0:
            out = plus(out, times(beyond, normal))
        if beyond > depth:
            depth, nearest_face = beyond, normal
    if depth > 0.0:
        distance = np.sqrt(dot(out, out))
        return minus(x, out), times(1.0 / distance, out), distance
    return minus(x, times(depth, nearest_face)), nearest_face, depth


@no_new_arrays
def sphere_box(S: Array, B: Array, margin: float, rows: Array) -> int:
    """Write the contact of a sphere with box ``B`` to ``rows`` if its gap is at most ``margin`` [m].

    ``S`` (4,) is the sphere's centre [m] and radius [m]. Returns the number of contacts, 0 or 1.
    """
    point, n, distance = _nearest(B, entries(S, 0))
    gap = distance - S[3]
    return _written(plus(point, times(0.5 * gap, n)), n, gap, margin, rows)


@no_new_arrays
def sphere_sphere(S: Array, other: Array, margin: float, rows: Array) -> int:
    """Write the contact of two spheres as for ``sphere_box``; spheres with one centre touch along the vertical."""
    n = minus(entries(S, 0), entries(other, 0))
    distance = np.sqrt(dot(n, n))
    n = times(1.0 / distance, n) if distance > 0.0 else (0.0, 0.0, 1.0)
    gap = distance - S[3] - other[3]
    return _written(plus(entries(other, 0), times(other[3] + 0.5 * gap, n)), n, gap, margin, rows)


@inlined
def _written(point: Vector, n: Vector, gap: float, margin: float, rows: Array) -> int:
    if gap > margin:
        return 0
    write_vector(point, rows, 0, 0)
    write_vector(n, rows, 0, 3)
    rows[0, 6] = gap
    return 1
