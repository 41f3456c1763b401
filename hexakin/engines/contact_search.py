"""Search for the contacts of all shapes of a scene, with the ground and with each other, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.engines.field_contacts import extent
from hexakin.engines.ground_contacts import Contacts, box_near, sphere_contacts, vertex_contacts
from hexakin.engines.ground_grid import Ground, cells_within
from hexakin.engines.shape_pairs import MOST_POINTS, box_box, sphere_box, sphere_sphere
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, inlined, part


class Shapes(NamedTuple):
    """Collision shapes of bodies; joints are those of the Pinocchio model, as indices.

    Parameters
    ----------
    sphere_joint, sphere_group
        Joint and group (s,) of each sphere, as indices.
    sphere
        Centre in the joint's frame and radius (s, 4) [m] of each sphere.
    box_joint, box_group
        Joint and group (b,) of each box, as indices.
    box_rotation
        Rotation (b, 3, 3) of each box in the joint's frame.
    box
        Centre in the joint's frame and half edge lengths (b, 6) [m] of each box.
    """

    sphere_joint: Whole
    sphere_group: Whole
    sphere: Array
    box_joint: Whole
    box_group: Whole
    box_rotation: Array
    box: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Posed(NamedTuple):
    """Memory of the search: the shapes where they are, and contacts of two of them.

    Parameters
    ----------
    sphere
        Centre in the world and radius (s, 4) [m] of each sphere.
    box
        Axes, centre and half edge lengths (b, 15) of each box, as in ``hexakin.engines.shape_pairs``.
    ground_box
        One box (15,) of the ground.
    polygon, rows
        Memory (2, 8, 3) of ``box_box``, and the contacts (16, 7) of two shapes.
    """

    sphere: Array
    box: Array
    ground_box: Array
    polygon: Array
    rows: Array

    def __repr__(self) -> str:
        return short_repr(self)


def posed_memory(shapes: Shapes) -> Posed:
    """Return memory for the search for contacts of ``shapes``."""
    ground_box = np.zeros(15)
    ground_box[:9] = np.eye(3).ravel()
    sizes = ((len(shapes.sphere), 4), (len(shapes.box), 15), (2, 8, 3), (MOST_POINTS, 7))
    sphere, box, polygon, rows = (np.zeros(size) for size in sizes)
    return Posed(sphere, box, ground_box, polygon, rows)


@part
def _center(P: Array, x: Array, out: Array) -> None:
    """Write point ``x`` of a joint's frame, in world coordinates, to ``out``.

    ``P`` (12,) is the joint's pose: its rotation, column by column, and its translation.
    """
    for a in range(3):
        out[a] = P[a] * x[0] + P[3 + a] * x[1] + P[6 + a] * x[2] + P[9 + a]


@part
def _rotation(P: Array, R_joint: Array, out: Array) -> None:
    for a in range(3):
        for b in range(3):
            out[a, b] = P[a] * R_joint[0, b] + P[3 + a] * R_joint[1, b] + P[6 + a] * R_joint[2, b]


@part
def find_contacts(
    poses: Array,
    shapes: Shapes,
    ground: Ground,
    meeting: Whole | None,
    margin: float,
    contacts: Contacts,
    posed: Posed,
) -> int:
    """Find the contacts that have gaps of up to ``margin`` [m]; return how many were written to ``contacts``.

    They are the contacts of ``shapes`` with ``ground`` and with each other. ``poses`` (joints, 12) are the joints'
    poses, each as a rotation, column by column, and a translation [m]. ``meeting`` (k, 2) are the pairs of shapes that
    can meet, as numbers: spheres come first, then boxes; None if no shapes can meet.
    """
    none = 0 * shapes.sphere_joint.size  # with a literal 0, numba would compile the search a second time
    count, number, x = none, none, contacts.scratch.point
    for k in range(shapes.sphere_joint.size):
        joint, S = shapes.sphere_joint[k], posed.sphere[k]
        _center(poses[joint], shapes.sphere[k], S)
        S[3] = shapes.sphere[k, 3]
        count = sphere_contacts(
            ground, joint, shapes.sphere_group[k], number, S[0], S[1], S[2], S[3], margin, contacts, count
        )
        number += 1
    R, center = contacts.scratch.rotation, contacts.scratch.center
    for k in range(shapes.box_joint.size):
        P, B, joint, group = poses[shapes.box_joint[k]], shapes.box[k], shapes.box_joint[k], shapes.box_group[k]
        _center(P, B, center)
        if meeting is None and _is_far(ground, center, np.sqrt(B[3] * B[3] + B[4] * B[4] + B[5] * B[5]) + margin):
            number += 8
            continue
        _rotation(P, shapes.box_rotation[k], R)
        for a in range(3):
            posed.box[k, 9 + a], posed.box[k, 12 + a] = center[a], B[3 + a]
            for b in range(3):
                posed.box[k, 3 * b + a] = R[a, b]
        if box_near(ground, R, center, B[3:], margin):
            for corner in range(8):
                for a in range(3):
                    x[a] = center[a]
                    for b in range(3):
                        x[a] += R[a, b] * (B[3 + b] if corner & (1 << b) else -B[3 + b])
                count = sphere_contacts(
                    ground, joint, group, number + corner, x[0], x[1], x[2], 0.0, margin, contacts, count
                )
            if ground.vertices.shape[0] > 0 or ground.field.z.size > 0:
                count = vertex_contacts(ground, joint, group, R, center, B[3:], margin, contacts, count)
            if ground.boxes.shape[0] > 0:
                count = _on_boxes(ground, joint, group, R, posed.box[k], margin, posed, contacts, count)
        number += 8
    return _of_bodies(meeting, shapes, margin, posed, contacts, count)


@inlined
def _is_far(ground: Ground, center: Array, reach: float) -> bool:
    """Whether ``ground`` is surely farther than ``reach`` [m] from ``center`` (3,) [m]."""
    for k in range(ground.planes.shape[0]):
        P = ground.planes[k]
        if (center[0] - P[0]) * P[3] + (center[1] - P[1]) * P[4] + (center[2] - P[2]) * P[5] <= reach:
            return False
    return center[2] - reach > ground.highest


@part
def _on_boxes(
    ground: Ground,
    body: int,
    group: int,
    R: Array,
    box: Array,
    margin: float,
    posed: Posed,
    contacts: Contacts,
    count: int,
) -> int:
    """Append the contacts of a body's ``box`` (15,) with the boxes of ``ground``; return the new number of contacts.

    ``R`` (3, 3) is the rotation of the box; ``body`` and ``group`` are its joint and group.
    """
    x, half, other = box[9:12], box[12:], posed.ground_box
    dx, dy, dz = (
        extent(R, half, 1.0, 0.0, 0.0) + margin,
        extent(R, half, 0.0, 1.0, 0.0) + margin,
        extent(R, half, 0.0, 0.0, 1.0) + margin,
    )
    i0, i1, j0, j1 = cells_within(ground, x[0], x[1], max(dx, dy))
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            c = i * ground.shape[1] + j
            if ground.top[c] < x[2] - dz:
                continue
            for index in range(ground.start[c], ground.start[c + 1]):
                item = ground.items[index]
                if item >= ground.boxes.shape[0]:
                    continue
                B = ground.boxes[item]
                # A box in several cells is taken in the first of these.
                first_i = int(np.floor((B[0] - ground.corner[0]) / ground.cell))
                first_j = int(np.floor((B[1] - ground.corner[1]) / ground.cell))
                if i != max(i0, first_i) or j != max(j0, first_j):
                    continue
                if (
                    abs(x[0] - 0.5 * (B[0] + B[3])) > dx + 0.5 * (B[3] - B[0])
                    or abs(x[1] - 0.5 * (B[1] + B[4])) > dy + 0.5 * (B[4] - B[1])
                    or abs(x[2] - 0.5 * (B[2] + B[5])) > dz + 0.5 * (B[5] - B[2])
                ):
                    continue
                for a in range(3):
                    other[9 + a], other[12 + a] = 0.5 * (B[a] + B[3 + a]), 0.5 * (B[3 + a] - B[a])
                found = box_box(box, other, margin, posed.polygon, posed.rows)
                count = _append(posed.rows, found, body, -1, group, 1.0, contacts, count)
    return count


@part
def _of_bodies(
    meeting: Whole | None, shapes: Shapes, margin: float, posed: Posed, contacts: Contacts, count: int
) -> int:
    """Append the contacts of the shapes that can meet each other; return the new number of contacts."""
    if meeting is None:
        return count
    spheres, rows = shapes.sphere_joint.size, posed.rows
    for k in range(meeting.shape[0]):
        one, two, sign = meeting[k, 0], meeting[k, 1], 1.0
        body, group = _owner(shapes, one)
        other, _ = _owner(shapes, two)
        if one >= spheres and two < spheres:
            one, two, sign = two, one, -1.0
        if one >= spheres:
            found = box_box(posed.box[one - spheres], posed.box[two - spheres], margin, posed.polygon, rows)
        elif two >= spheres:
            found = sphere_box(posed.sphere[one], posed.box[two - spheres], margin, rows)
        else:
            found = sphere_sphere(posed.sphere[one], posed.sphere[two], margin, rows)
        count = _append(rows, found, body, other, group, sign, contacts, count)
    return count


@inlined
def _owner(shapes: Shapes, item: int) -> tuple[int, int]:
    """Return joint and group of a shape."""
    spheres = shapes.sphere_joint.size
    if item < spheres:
        return shapes.sphere_joint[item], shapes.sphere_group[item]
    return shapes.box_joint[item - spheres], shapes.box_group[item - spheres]


@part
def _append(
    rows: Array, found: int, body: int, other: int, group: int, sign: float, contacts: Contacts, count: int
) -> int:
    """Append the first ``found`` contacts in ``rows``, their normals times ``sign``; return the new number."""
    for k in range(min(found, contacts.gap.size - count)):
        contacts.bodies[count, 0], contacts.bodies[count, 1] = body, other
        for a in range(3):
            contacts.point[count, a], contacts.normal[count, a] = rows[k, a], sign * rows[k, 3 + a]
        contacts.gap[count], contacts.group[count], contacts.key[count] = rows[k, 6], group, -1
        count += 1
    return count
