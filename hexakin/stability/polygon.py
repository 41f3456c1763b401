"""Support polygon, zero-moment point and stability margin (A(32)-(33))."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from hexakin.checks import Array, check_array
from hexakin.exceptions import InvalidInputError


def support_polygon(p: ArrayLike) -> Array | None:
    """Convex hull of feet (k, 2 or 3) [m] seen from above: vertices (m, 2), counter-clockwise.

    None with fewer than three feet, or with feet on one line: there is no polygon.
    """
    points = np.asarray(p, dtype=float)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InvalidInputError(f"p: expected shape (k, 2) or (k, 3), got {points.shape}")
    points = check_array("p", points, (points.shape[1],), ("coordinate",))[:, :2]
    if len(points) < 3:
        return None
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    # In two dimensions "volume" is the area; a sliver of rounding is no polygon.
    return points[hull.vertices] if hull.volume > 1e-9 * np.ptp(points, axis=0).max() ** 2 else None


def centroid(polygon: ArrayLike) -> Array:
    """Centroid (2,) [m] of the area of a counter-clockwise polygon (m, 2)."""
    a = np.asarray(polygon, dtype=float)
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    return ((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())


def margin(point: ArrayLike, polygon: ArrayLike | None) -> float:
    """A(33), signed: distance [m] of ``point`` (2,) to the nearest edge, negative outside; NaN without a polygon.

    ``polygon`` (m, 2) is convex and counter-clockwise, as ``support_polygon`` returns it.
    """
    if polygon is None:
        return float("nan")
    p = check_array("point", point, (2,), ("coordinate",))
    corners = check_array("polygon", polygon, (2,), ("coordinate",))
    if p.shape != (2,) or corners.ndim != 2 or len(corners) < 3:
        raise InvalidInputError(f"point, polygon: expected shapes (2,) and (m, 2), got {p.shape} and {corners.shape}")
    return float(margins_in(p[None], corners)[0])


def margins_in(points: Array, polygon: Array) -> Array:
    """Margins (n,) of points (n, 2) in one polygon (m, 2)."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    offset = points[:, None, :] - polygon
    along = np.clip(np.einsum("nij,ij->ni", offset, edge) / np.einsum("ij,ij->i", edge, edge), 0.0, 1.0)
    # A(33)
    distance = np.linalg.norm(offset - along[..., None] * edge, axis=-1).min(axis=-1)
    inside = (edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0] >= 0.0).all(axis=-1)
    return np.where(inside, distance, -distance)


def polygon_margins(point: ArrayLike, p_foot: ArrayLike, carrying: ArrayLike) -> Array:
    """A(33) at many instants: signed distance (n,) [m] of points to the edge of the carrying feet's polygon.

    ``point`` (n, 2) [m], ``p_foot`` (n, L, 2) [m] seen from above, ``carrying`` (n, L). NaN where fewer than three feet
    carry, or feet in line, or the point is NaN.
    """
    feet = check_array("p_foot", p_foot, (2,), ("coordinate",))
    where, carry = np.asarray(point, dtype=float), np.asarray(carrying, dtype=bool)
    if feet.ndim != 3 or where.shape != (len(feet), 2) or carry.shape != feet.shape[:2]:
        shapes = f"point {where.shape}, p_foot {feet.shape}, carrying {carry.shape}"
        raise InvalidInputError(f"expected shapes (n, 2), (n, L, 2) and (n, L); got {shapes}")
    return centroid_distance_and_margin(where, feet, carry)[1]


def centroid_distance_and_margin(point: Array, feet: Array, carrying: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Distance (n,) from points (n, 2) to the centroid of the hull of the carrying (n, L) feet (n, L, 2), and A(33).

    NaN where support_polygon has none, or the point is NaN. With a handful of feet it is faster to try every pair as an
    edge of the hull, at all instants at once, than to build the hulls one by one.
    """
    start, way = feet[:, :, None], feet[:, None] - feet[:, :, None]  # the edge i -> j
    offset = (feet[:, None] - feet[:, :, None])[:, :, None]  # from i to k
    side = way[..., None, 0] * offset[..., 1] - way[..., None, 1] * offset[..., 0]
    along = np.einsum("nijc,nimkc->nijk", way, offset)
    squared = np.einsum("nijc,nijc->nij", way, way)[..., None]
    # Counter-clockwise, every other foot lies to the left of an edge, or between its ends.
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
