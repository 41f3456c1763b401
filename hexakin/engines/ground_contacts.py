"""Where bodies touch the ground: spheres and box corners against half spaces, boxes and triangles, compiled.

A contact is a point where the distance between a body and the ground has a local minimum. That rule keeps
both walls of a corner and drops the inner edges of a surface that is made of pieces: the seam between two level
blocks or two triangles is no edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.engines.ground_grid import SAME, Ground, cells_within, lies_on, nearest_point, point_under_triangle
from hexakin.numerics.numba_cache import Whole, compiled

_CANDIDATES = 64  # shapes looked at around one sphere


class Bodies(NamedTuple):
    """Shapes on bodies and the tree that moves them.

    ``moves`` (joint, coordinate) tells whether the coordinate moves the joint's body; ``floating`` and ``hinges``
    (k, 2) where the coordinates of free and revolute joints begin in q and v. ``meeting`` is true if bodies can meet
    each other.
    """

    sphere_joint: Whole
    sphere_group: Whole
    sphere: Array  # (s, 4) centre and radius
    box_joint: Whole
    box_group: Whole
    box_rotation: Array  # (b, 3, 3)
    box: Array  # (b, 6) centre and half sizes
    moves: NDArray[np.bool_]
    floating: Whole
    hinges: Whole
    servo: Whole
    servo_q: Whole
    meeting: bool


class Contacts(NamedTuple):
    """Contacts found.

    ``bodies`` (c, 2) that touch (-1 is the ground), ``point`` and ``normal`` (c, 3) from the second to the first in the
    world, ``gap`` (c,) [m], ``group`` (c,) that the first belongs to, and ``key`` (c,), the same from step to step as
    long as the contact lasts, or -1.
    """

    bodies: Whole
    point: Array
    normal: Array
    gap: Array
    group: Whole
    key: Whole


def empty_contacts(capacity: int) -> Contacts:
    """Return room for ``capacity`` contacts."""
    whole = np.zeros(capacity, dtype=np.int64)
    vectors = np.zeros((capacity, 3))
    return Contacts(
        np.zeros((capacity, 2), dtype=np.int64), vectors, vectors.copy(), np.zeros(capacity), whole, whole.copy()
    )


@compiled
def _extent(R: Array, half: Array, x: float, y: float, z: float) -> float:
    """How far a box reaches from its centre along a direction."""
    reach = 0.0
    for a in range(3):
        reach += abs(R[0, a] * x + R[1, a] * y + R[2, a] * z) * half[a]
    return reach


@compiled
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
    """Append the contacts of a sphere with gaps up to ``margin``; returns the new count.

    A box corner is a sphere of radius 0; it looks at planes and triangles only.
    """
    shapes = ground.boxes.shape[0] + ground.triangles.shape[0]
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
            contacts.key[count] = number * (shapes + 16) + shapes + k
            count += 1
    if shapes == 0:
        return count
    rows, which, found = np.empty((_CANDIDATES, 7)), np.empty(_CANDIDATES, dtype=np.int64), 0
    reach = radius + margin
    i0, i1, j0, j1 = cells_within(ground, x, y, reach)
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
                if seen or found == _CANDIDATES:
                    continue
                if radius == 0.0:
                    point_under_triangle(ground.triangles[item - ground.boxes.shape[0]], x, y, z, rows[found])
                else:
                    nearest_point(ground, item, x, y, z, rows[found])
                if rows[found, 6] - radius <= margin:
                    which[found] = item
                    found += 1
    for k in range(found):
        keep = True
        for other in range(found):
            if other == k or not keep:
                continue
            closer = rows[other, 6] < rows[k, 6] - SAME or (rows[other, 6] <= rows[k, 6] + SAME and other < k)
            if closer and lies_on(ground, which[other], rows[k, 0], rows[k, 1], rows[k, 2]):
                keep = False
        if keep and count < contacts.gap.size:
            contacts.bodies[count, 0], contacts.bodies[count, 1] = body, -1
            for a in range(3):
                contacts.point[count, a], contacts.normal[count, a] = rows[k, a], rows[k, 3 + a]
            contacts.gap[count], contacts.group[count] = rows[k, 6] - radius, group
            contacts.key[count] = number * (shapes + 16) + which[k]
            count += 1
    return count


@compiled
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
    """Append the ground's peaks that poke into a body's box of half sizes ``half`` (3,), posed in the world.

    Of all peaks in a quarter of a face only the deepest counts: four points hold a box as well as a hundred.
    """
    shapes = ground.boxes.shape[0] + ground.triangles.shape[0]
    spread, local = np.empty(3), np.empty(3)
    for a in range(3):
        spread[a] = abs(R[a, 0]) * half[0] + abs(R[a, 1]) * half[1] + abs(R[a, 2]) * half[2] + margin
    best, deepest = np.full(24, -1, dtype=np.int64), np.full(24, -margin)
    i0, i1, j0, j1 = cells_within(ground, center[0], center[1], max(spread[0], spread[1]))
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            c = i * ground.shape[1] + j
            for index in range(ground.start[c], ground.start[c + 1]):
                item = ground.items[index] - shapes
                if item < 0 or abs(ground.vertices[item, 2] - center[2]) > spread[2]:
                    continue
                depth, axis = np.inf, 0
                for a in range(3):
                    local[a] = 0.0
                    for b in range(3):
                        local[a] += R[b, a] * (ground.vertices[item, b] - center[b])
                    if half[a] - abs(local[a]) < depth:
                        depth, axis = half[a] - abs(local[a]), a
                # The octant tells the side of the face and the quarter of it.
                octant = (local[0] > 0.0) + 2 * (local[1] > 0.0) + 4 * (local[2] > 0.0)
                if depth > deepest[8 * axis + octant]:
                    best[8 * axis + octant], deepest[8 * axis + octant] = item, depth
    for k in range(24):
        if best[k] >= 0 and count < contacts.gap.size:
            axis = k // 8
            sign = 1.0 if (k % 8) & (1 << axis) else -1.0
            contacts.bodies[count, 0], contacts.bodies[count, 1] = body, -1
            for b in range(3):
                contacts.point[count, b] = ground.vertices[best[k], b]
                contacts.normal[count, b] = -sign * R[b, axis]
            contacts.gap[count], contacts.group[count], contacts.key[count] = -deepest[k], group, -1
            count += 1
    return count


@compiled
def box_near(ground: Ground, R: Array, center: Array, half: Array, margin: float) -> bool:
    """Whether the ground may reach into a box or come within ``margin`` of it."""
    for k in range(ground.planes.shape[0]):
        P = ground.planes[k]
        gap = (center[0] - P[0]) * P[3] + (center[1] - P[1]) * P[4] + (center[2] - P[2]) * P[5]
        if gap <= _extent(R, half, P[3], P[4], P[5]) + margin:
            return True
    if ground.items.size > 0:
        reach = max(_extent(R, half, 1.0, 0.0, 0.0), _extent(R, half, 0.0, 1.0, 0.0)) + margin
        low = center[2] - _extent(R, half, 0.0, 0.0, 1.0) - margin
        i0, i1, j0, j1 = cells_within(ground, center[0], center[1], reach)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                if ground.top[i * ground.shape[1] + j] >= low:
                    return True
    return False


@compiled
def box_pairs(
    ground: Ground, box: int, R: Array, center: Array, half: Array, margin: float, pairs: Whole, count: int
) -> int:
    """Append (box, ground's box) for every box of the ground that meets the bounding box of a body's box."""
    spread = np.empty(3)
    for a in range(3):
        spread[a] = abs(R[a, 0]) * half[0] + abs(R[a, 1]) * half[1] + abs(R[a, 2]) * half[2] + margin
    i0, i1, j0, j1 = cells_within(ground, center[0], center[1], max(spread[0], spread[1]))
    first = count
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            c = i * ground.shape[1] + j
            for index in range(ground.start[c], ground.start[c + 1]):
                item = ground.items[index]
                if item >= ground.boxes.shape[0] or count >= pairs.shape[0]:
                    continue
                B = ground.boxes[item]
                near = True
                for a in range(3):
                    near = near and B[a] <= center[a] + spread[a] and center[a] - spread[a] <= B[3 + a]
                for old in range(first, count):
                    near = near and pairs[old, 1] != item
                if near:
                    pairs[count, 0], pairs[count, 1] = box, item
                    count += 1
    return count


@compiled
def _center(P: Array, x: Array, out: Array) -> None:
    """Point x of a joint's frame in the world; a pose's row is its rotation, column by column, and its translation."""
    for a in range(3):
        out[a] = P[a] * x[0] + P[3 + a] * x[1] + P[6 + a] * x[2] + P[9 + a]


@compiled
def _rotation(P: Array, R_joint: Array, out: Array) -> None:
    for a in range(3):
        for b in range(3):
            out[a, b] = P[a] * R_joint[0, b] + P[3 + a] * R_joint[1, b] + P[6 + a] * R_joint[2, b]


@compiled
def find_contacts(
    poses: Array, bodies: Bodies, ground: Ground, margin: float, contacts: Contacts, pairs: Whole
) -> tuple[int, int]:
    """Seek contacts of spheres and boxes with the ground.

    Returns how many, and how many ``pairs`` (body's box, ground's box) are near; these are left to a library.
    """
    count, near, number, x = 0, 0, 0, np.empty(3)
    for k in range(bodies.sphere_joint.size):
        S = bodies.sphere[k]
        _center(poses[bodies.sphere_joint[k]], S, x)
        count = sphere_contacts(
            ground,
            bodies.sphere_joint[k],
            bodies.sphere_group[k],
            number,
            x[0],
            x[1],
            x[2],
            S[3],
            margin,
            contacts,
            count,
        )
        number += 1
    R, center = np.empty((3, 3)), np.empty(3)
    for k in range(bodies.box_joint.size):
        P, B, joint, group = poses[bodies.box_joint[k]], bodies.box[k], bodies.box_joint[k], bodies.box_group[k]
        _center(P, B, center)
        _rotation(P, bodies.box_rotation[k], R)
        if box_near(ground, R, center, B[3:], margin):
            for corner in range(8):
                for a in range(3):
                    x[a] = center[a]
                    for b in range(3):
                        x[a] += R[a, b] * (B[3 + b] if corner & (1 << b) else -B[3 + b])
                count = sphere_contacts(
                    ground, joint, group, number + corner, x[0], x[1], x[2], 0.0, margin, contacts, count
                )
            if ground.vertices.shape[0] > 0:
                count = vertex_contacts(ground, joint, group, R, center, B[3:], margin, contacts, count)
            if ground.boxes.shape[0] > 0:
                near = box_pairs(ground, k, R, center, B[3:], margin, pairs, near)
        number += 8
    return count, near
