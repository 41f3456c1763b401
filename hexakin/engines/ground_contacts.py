"""Search for contacts of spheres and boxes with a ground of half spaces, boxes and triangles, compiled.

A contact is a point where the distance between a body and the ground has a local minimum. With this rule a body in a
corner has contacts with both walls, and there are no contacts with inner edges of a surface that consists of several
pieces, such as the common edge of two level blocks or of two triangles. The method is hexakin's own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.engines.field_contacts import (
    Scratch,
    empty_scratch,
    extent,
    field_near,
    field_sphere,
    field_vertices,
    keep_closest,
    keep_deepest,
)
from hexakin.engines.ground_grid import SAME, Ground, cells_within, lies_on, nearest_point, point_under_triangle
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, no_new_arrays, part


class Contacts(NamedTuple):
    """Contacts that the search has found, in arrays of a fixed capacity c.

    Parameters
    ----------
    bodies
        Joints (c, 2), as indices, of the two bodies; -1 is the ground.
    point
        Contact points (c, 3) [m] in the world.
    normal
        Unit vectors (c, 3) from the second body to the first, in the world.
    gap
        Distances (c,) [m] between the bodies, negative if they penetrate.
    group
        Group (c,), as an index, of the first body's shape.
    key
        A number (c,) that identifies the contact from step to step as long as it lasts, or -1.
    scratch
        Arrays that the search overwrites.
    """

    bodies: Whole
    point: Array
    normal: Array
    gap: Array
    group: Whole
    key: Whole
    scratch: Scratch

    def __repr__(self) -> str:
        return short_repr(self)


def empty_contacts(capacity: int) -> Contacts:
    """Return arrays for ``capacity`` contacts, filled with zeros."""
    whole = np.zeros(capacity, dtype=np.int64)
    vectors = np.zeros((capacity, 3))
    bodies, gap = np.zeros((capacity, 2), dtype=np.int64), np.zeros(capacity)
    return Contacts(bodies, vectors, vectors.copy(), gap, whole, whole.copy(), empty_scratch())


@part
def _append(contacts: Contacts, count: int, body: int, group: int, row: Array, radius: float, key: int) -> int:
    """Append the contact of a sphere with the closest point in ``row`` (7,); return the new number of contacts."""
    if count == contacts.gap.size:
        return count
    contacts.bodies[count, 0], contacts.bodies[count, 1] = body, -1
    for a in range(3):
        contacts.point[count, a], contacts.normal[count, a] = row[a], row[3 + a]
    contacts.gap[count], contacts.group[count], contacts.key[count] = row[6] - radius, group, key
    return count + 1


@no_new_arrays
def sphere_contacts(
    ground: Ground,
    body: int,
    group: int,
    number: int,
    x: float,
    y: float,
    z: float,
    radius: float,
    margin: float,
    contacts: Contacts,
    count: int,
) -> int:
    """Append the contacts of a sphere with gaps of up to ``margin`` [m]; return the new number of contacts.

    ``contacts`` holds ``count`` contacts before. ``body`` and ``group`` are the joint and the group of the sphere, and
    ``number`` the number of the sphere, for the contacts' keys; (``x``, ``y``, ``z``) [m] is its centre and ``radius``
    [m] its radius. A corner of a box is a sphere of radius 0, for which the boxes of ``ground`` are left out.
    """
    shapes, field = ground.boxes.shape[0] + ground.triangles.shape[0], ground.field
    numbers = shapes + 2 * field.z.size + 16  # more than there are triangles of the field, and planes
    for k in range(ground.planes.shape[0]):
        P = ground.planes[k]
        gap = (x - P[0]) * P[3] + (y - P[1]) * P[4] + (z - P[2]) * P[5] - radius
        if gap <= margin and count < contacts.gap.size:
            contacts.bodies[count, 0], contacts.bodies[count, 1] = body, -1
            for a in range(3):
                contacts.normal[count, a] = P[3 + a]
            contacts.point[count, 0] = x - (radius + gap) * P[3]
            contacts.point[count, 1] = y - (radius + gap) * P[4]
            contacts.point[count, 2] = z - (radius + gap) * P[5]
            contacts.gap[count], contacts.group[count] = gap, group
            contacts.key[count] = number * numbers + numbers - 1 - k
            count += 1
    if shapes == 0 and field.z.size == 0:
        return count
    rows, which, row, found = contacts.scratch.rows, contacts.scratch.items, contacts.scratch.row, 0
    if field.z.size > 0:
        on_field = field_sphere(field, x, y, z, radius, margin, contacts.scratch)
        for k in range(on_field):
            count = _append(contacts, count, body, group, rows[k], radius, number * numbers + shapes + which[k])
    if radius == 0.0 and ground.triangles.shape[0] == 0:
        return count
    i0, i1, j0, j1 = cells_within(ground, x, y, radius + margin)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            c = i * ground.shape[1] + j
            for index in range(ground.start[c], ground.start[c + 1]):
                item = ground.items[index]
                if item >= shapes or (radius == 0.0 and item < ground.boxes.shape[0]):
                    continue
                seen = False
                for k in range(found):
                    seen = seen or which[k] == item
                if seen:
                    continue
                if radius == 0.0:
                    point_under_triangle(ground.triangles[item - ground.boxes.shape[0]], x, y, z, row)
                else:
                    nearest_point(ground, item, x, y, z, row)
                if row[6] - radius <= margin:
                    found = keep_closest(row, item, contacts.scratch, found)
    for k in range(found):
        keep = True
        for other in range(found):
            if other == k or not keep:
                continue
            closer = rows[other, 6] < rows[k, 6] - SAME or (rows[other, 6] <= rows[k, 6] + SAME and other < k)
            if closer and lies_on(ground, which[other], rows[k, 0], rows[k, 1], rows[k, 2]):
                keep = False
        if keep:
            count = _append(contacts, count, body, group, rows[k], radius, number * numbers + which[k])
    return count


@no_new_arrays
def vertex_contacts(
    ground: Ground,
    body: int,
    group: int,
    R: Array,
    center: Array,
    half: Array,
    margin: float,
    contacts: Contacts,
    count: int,
) -> int:
    """Append contacts of a body's box with vertices of ``ground`` that are in it; return the new number of contacts.

    ``R`` (3, 3) and ``center`` (3,) [m] are rotation and centre of the box in the world, and ``half`` (3,) [m] its half
    edge lengths. ``body`` and ``group`` are its joint and group. Vertices outside the box by up to ``margin`` [m] count
    too. ``contacts`` holds ``count`` contacts before. Of all vertices in a quarter of a face only the deepest is used,
    because four points support a box as well as a hundred.
    """
    shapes = ground.boxes.shape[0] + ground.triangles.shape[0]
    scratch, best, deepest = contacts.scratch, contacts.scratch.best, contacts.scratch.deepest
    reach = max(extent(R, half, 1.0, 0.0, 0.0), extent(R, half, 0.0, 1.0, 0.0)) + margin
    height = extent(R, half, 0.0, 0.0, 1.0) + margin
    for k in range(24):
        deepest[k] = -margin
    if ground.field.z.size > 0:
        field_vertices(ground.field, R, center, half, margin, scratch)
    i0, i1, j0, j1 = cells_within(ground, center[0], center[1], reach)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            c = i * ground.shape[1] + j
            for index in range(ground.start[c], ground.start[c + 1]):
                item = ground.items[index] - shapes
                if item < 0 or abs(ground.vertices[item, 2] - center[2]) > height:
                    continue
                for a in range(3):
                    scratch.point[a] = ground.vertices[item, a]
                keep_deepest(R, center, half, scratch)
    for k in range(24):
        if deepest[k] > -margin and count < contacts.gap.size:
            axis = k // 8
            sign = 1.0 if (k % 8) & (1 << axis) else -1.0
            contacts.bodies[count, 0], contacts.bodies[count, 1] = body, -1
            for b in range(3):
                contacts.point[count, b] = best[k, b]
                contacts.normal[count, b] = -sign * R[b, axis]
            contacts.gap[count], contacts.group[count], contacts.key[count] = -deepest[k], group, -1
            count += 1
    return count


@no_new_arrays
def box_near(ground: Ground, R: Array, center: Array, half: Array, margin: float) -> bool:
    """Whether ``ground`` may penetrate a box or be within ``margin`` [m] of it; the box as for ``vertex_contacts``.

    ``R`` (3, 3), ``center`` (3,) [m] and ``half`` (3,) [m] are its rotation, centre and half edge lengths.
    """
    for k in range(ground.planes.shape[0]):
        P = ground.planes[k]
        gap = (center[0] - P[0]) * P[3] + (center[1] - P[1]) * P[4] + (center[2] - P[2]) * P[5]
        if gap <= extent(R, half, P[3], P[4], P[5]) + margin:
            return True
    if ground.field.z.size > 0 and field_near(ground.field, R, center, half, margin):
        return True
    if ground.items.size > 0:
        reach = max(extent(R, half, 1.0, 0.0, 0.0), extent(R, half, 0.0, 1.0, 0.0)) + margin
        low = center[2] - extent(R, half, 0.0, 0.0, 1.0) - margin
        i0, i1, j0, j1 = cells_within(ground, center[0], center[1], reach)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                if ground.top[i * ground.shape[1] + j] >= low:
                    return True
    return False
