"""Support polygon and stability margin (A(33))."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from hexakin.checks import Array, check_array, check_flags, check_shape
from hexakin.exceptions import InvalidInputError


def support_polygon(p: ArrayLike) -> Array | None:
    """Support polygon: the convex hull of the feet, seen from above.

    ``p`` (k, 2) or (k, 3) [m] are the positions of the feet. Returns the vertices (m, 2) [m], counter-clockwise, or
    None if there is no polygon: with fewer than three feet, or with all feet on one line. Raises InvalidInputError for
    another shape or a value that is not finite.
    """
    points = check_array("p", p, (None,), ("coordinate",))
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InvalidInputError(f"p: expected shape (k, 2) or (k, 3), got {points.shape}")
    points = points[:, :2]
    if len(points) < 3:
        return None
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    # In two dimensions "volume" is the area. An area as small as rounding errors counts as no polygon.
    return points[hull.vertices] if hull.volume > 1e-9 * np.ptp(points, axis=0).max() ** 2 else None


def centroid(polygon: ArrayLike) -> Array:
    """Centroid (2,) [m] of the area of a ``polygon`` (m, 2) [m], whose vertices are in counter-clockwise order.

    Raises InvalidInputError for fewer than three vertices.
    """
    a = check_shape("polygon", polygon, (None, 2))
    if len(a) < 3:
        raise InvalidInputError(f"polygon: expected three vertices or more, got {len(a)}")
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    return ((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())


def margin(point: ArrayLike, polygon: ArrayLike | None) -> float:
    """Stability margin A(33): the signed distance [m] of a point to the nearest edge of a polygon.

    ``point`` (2,) [m] is usually the zero-moment point or the projection of the centre of mass. ``polygon`` (m, 2) [m]
    is convex and counter-clockwise, as ``support_polygon`` returns it. The margin is negative outside the polygon, and
    NaN if ``polygon`` is None. Raises InvalidInputError for another shape or a value that is not finite.
    """
    if polygon is None:
        return float("nan")
    p = check_array("point", point, (2,), ("coordinate",))
    corners = check_array("polygon", polygon, (2,), ("coordinate",))
    if p.shape != (2,) or corners.ndim != 2 or len(corners) < 3:
        raise InvalidInputError(f"point, polygon: expected shapes (2,) and (m, 2), got {p.shape} and {corners.shape}")
    return float(margins_in(p[None], corners)[0])


def margins_in(points: Array, polygon: Array) -> Array:
    """Stability margins A(33), (n,) [m], of ``points`` (n, 2) [m] in one ``polygon`` (m, 2) [m]."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    offset = points[:, None, :] - polygon
    along = np.clip(np.einsum("nij,ij->ni", offset, edge) / np.einsum("ij,ij->i", edge, edge), 0.0, 1.0)
    # A(33)
    distance = np.linalg.norm(offset - along[..., None] * edge, axis=-1).min(axis=-1)
    inside = (edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0] >= 0.0).all(axis=-1)
    return np.where(inside, distance, -distance)


def polygon_margins(point: ArrayLike, p_foot: ArrayLike, carrying: ArrayLike) -> Array:
    """Stability margins A(33) at n instants: signed distances (n,) [m] of points to the edge of the support polygon.

    ``point`` (n, 2) [m] and ``p_foot`` (n, L, 2) [m] are seen from above. ``carrying`` (n, L) bool marks the feet that
    carry load; they span the polygon. The margin is negative outside the polygon. It is NaN where fewer than three feet
    carry load, where all of them are on one line, and where the point is NaN. Raises InvalidInputError for shapes that
    do not fit together and for feet that are not finite.
    """
    feet = check_array("p_foot", p_foot, (2,), ("coordinate",))
    where, carry = check_array("point", point, (2,), finite=False), check_flags("carrying", carrying, (None, None))
    if feet.ndim != 3 or where.shape != (len(feet), 2) or carry.shape != feet.shape[:2]:
        shapes = f"point {where.shape}, p_foot {feet.shape}, carrying {carry.shape}"
        raise InvalidInputError(f"expected shapes (n, 2), (n, L, 2) and (n, L); got {shapes}")
    return centroid_distance_and_margin(where, feet, carry)[1]


def centroid_distance_and_margin(point: Array, feet: Array, carrying: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Distances of points from the centroid of the support polygon, and stability margins A(33); both (n,) [m].

    ``point`` (n, 2) [m], ``feet`` (n, L, 2) [m], ``carrying`` (n, L) bool, as for ``polygon_margins``. Both results are
    NaN where ``support_polygon`` would return None or the point is NaN. For six to eight feet it is faster to test
    every pair of feet as an edge of the hull, at all instants at once, than to build one hull after the other.
    """
    start, way = feet[:, :, None], feet[:, None] - feet[:, :, None]  # the edge i -> j
    offset = (feet[:, None] - feet[:, :, None])[:, :, None]  # from i to k
    side = way[..., None, 0] * offset[..., 1] - way[..., None, 1] * offset[..., 0]
    along = np.einsum("nijc,nimkc->nijk", way, offset)
    squared = np.einsum("nijc,nijc->nij", way, way)[..., None]
    # A pair of feet is an edge, taken counter-clockwise, if every other foot lies to its left or between its ends.
    between = (np.abs(side) <= 1e-12 * squared) & (along >= 0.0) & (along <= squared)
    pairs = carrying[:, :, None] & carrying[:, None] & ~np.eye(feet.shape[1], dtype=bool)
    edges = pairs & ((side > 1e-12 * squared) | between | ~carrying[:, None, None]).all(axis=-1)
    end = start + way
    twice = np.where(edges, start[..., 0] * end[..., 1] - end[..., 0] * start[..., 1], 0.0)
    twice_area = twice.sum(axis=(1, 2))
    low, high = (np.where(carrying[..., None], feet, far) for far in (np.inf, -np.inf))
    extent = (high.max(axis=1) - low.min(axis=1)).max(axis=-1)
    defined = (carrying.sum(axis=1) >= 3) & (0.5 * twice_area > 1e-9 * extent**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        center = ((start + end) * twice[..., None]).sum(axis=(1, 2)) / (3.0 * twice_area[:, None])
        reach = point[:, None, None] - start
        share = np.clip(np.einsum("nijc,nijc->nij", reach, way) / squared[..., 0], 0.0, 1.0)
        gap = np.where(edges, np.linalg.norm(reach - share[..., None] * way, axis=-1), np.inf).min(axis=(1, 2))
    inside = (~edges | (way[..., 0] * reach[..., 1] - way[..., 1] * reach[..., 0] >= 0.0)).all(axis=(1, 2))
    distance = np.linalg.norm(point - center, axis=-1)
    defined &= np.isfinite(point).all(axis=-1)
    return np.where(defined, distance, np.nan), np.where(defined, np.where(inside, gap, -gap), np.nan)
