"""Cut faces along the outlines of upright boxes that hide them, so that no drawing order is needed.

The eye is the point from which the boxes are seen. All lengths have one unit, which the caller chooses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array

_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
_NORMALS = np.concatenate([-np.eye(3), np.eye(3)])  # of a box's faces: towards -x, -y, -z, +x, +y, +z
# Each edge's two corners and the two faces that meet in it.
_EDGES = np.array([(a, b) for a in range(8) for b in range(a) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1])
_FACES_OF_EDGE = np.array(
    [[axis + 3 * _CORNERS[a][axis] for axis in range(3) if _CORNERS[a][axis] == _CORNERS[b][axis]] for a, b in _EDGES]
)


def hiding_planes(lower: ArrayLike, upper: ArrayLike, eye: ArrayLike) -> Array:
    """Return the planes that bound the space behind each box, seen from the eye; the box itself is included.

    Parameters
    ----------
    lower, upper
        Opposite corners of the boxes, (b, 3).
    eye
        The point from which the boxes are seen, (3,), outside the boxes.

    Returns
    -------
    Array
        Planes (n, d), (b, 18, 4): a box hides a point p if n·p < d for all its planes. Entries that are not needed are
        (0, 0, 0, 1), for which this always holds.
    """
    low, high, e = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float), np.asarray(eye, dtype=float)
    to_face = np.concatenate([-low, high], axis=-1)  # (b, 6)
    faces = np.concatenate([np.broadcast_to(_NORMALS, (len(low), 6, 3)), to_face[..., None]], axis=-1)
    seen = _NORMALS @ e > to_face  # (b, 6)
    corners = low[:, None] + _CORNERS * (high - low)[:, None]
    begin, end = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    normal = np.cross(end - begin, e - begin)  # (b, 12, 3): the plane through the edge and the eye
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), np.finfo(float).tiny)
    center = ((low + high) / 2.0)[:, None]
    normal *= np.where(np.einsum("bij,bij->bi", normal, center - begin) > 0.0, -1.0, 1.0)[..., None]
    edges = np.concatenate([normal, np.einsum("bij,bij->bi", normal, begin)[..., None]], axis=-1)
    outline = seen[:, _FACES_OF_EDGE[:, 0]] != seen[:, _FACES_OF_EDGE[:, 1]]
    bounds = np.concatenate([seen, outline], axis=-1)[..., None]
    return np.where(bounds, np.concatenate([faces, edges], axis=1), [0.0, 0.0, 0.0, 1.0])


def _split(polygon: Array, plane: Array) -> tuple[Array, Array]:
    """Split a convex polygon (k, 3) into its parts behind and before a plane (4,); an empty part has shape (0, 3)."""
    side = polygon @ plane[:3] - plane[3]
    if not (side < 0.0).any():
        return polygon[:0], polygon
    if not (side > 0.0).any():
        return polygon, polygon[:0]
    behind, before = [], []
    for k, point in enumerate(polygon):
        if side[k - 1] * side[k] < 0.0:
            crossing = polygon[k - 1] + (point - polygon[k - 1]) * side[k - 1] / (side[k - 1] - side[k])
            behind.append(crossing)
            before.append(crossing)
        if side[k] <= 0.0:
            behind.append(point)
        if side[k] >= 0.0:
            before.append(point)
    return np.array(behind), np.array(before)


def cut_hidden(polygons: ArrayLike, planes: Array, *, tolerance: float = 1e-6) -> tuple[Array, NDArray[np.int_]]:
    """Cut away the hidden parts of polygons.

    Parameters
    ----------
    polygons
        Convex plane polygons, (m, k, 3).
    planes
        Planes as `hiding_planes` returns them, (b, p, 4).
    tolerance
        A point that is behind a plane by less than this length is not hidden.

    Returns
    -------
    tuple
        The visible parts (n, l, 3), whose last corner is repeated so that all have the same number of corners, and for
        each part the index (n,) of its polygon. A polygon that is not hidden stays whole.
    """
    inner = planes - [0.0, 0.0, 0.0, tolerance]
    parts, origin = [], []
    for index, polygon in enumerate(np.asarray(polygons, dtype=float)):
        pieces = [polygon]
        # A box hides no part of this polygon if one of its planes has no corner of the polygon behind it.
        near = ((inner[..., :3] @ polygon.T < inner[..., 3:]).any(axis=-1)).all(axis=-1)
        for box in inner[near]:
            pieces = [part for piece in pieces for part in _outside(piece, box)]
        parts += pieces
        origin += [index] * len(pieces)
    length = max((len(part) for part in parts), default=3)
    filled = [part[np.minimum(np.arange(length), len(part) - 1)] for part in parts]
    return np.array(filled).reshape(-1, length, 3), np.array(origin, dtype=int)


def _outside(polygon: Array, planes: Array) -> list[Array]:
    """Return the parts of a convex polygon (k, 3) that are before at least one of the planes (p, 4)."""
    rest, outside = polygon, []
    for plane in planes:
        rest, before = _split(rest, plane)
        if len(before):
            outside.append(before)
        if not len(rest):
            return [polygon]
    return outside
