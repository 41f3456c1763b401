"""The pyramid inside a friction cone, by its faces and by its edges; one edge points uphill.

It contains the cone of the friction coefficient mu cos(pi / facets), and holds a vertical force exactly up to the
friction angle.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array


def contact_frames(normal: Array) -> Array:
    """Axes uphill, across and along the normal as columns, (..., 3, 3); on level ground x is uphill."""
    uphill = np.array([0.0, 0.0, 1.0]) - normal[..., 2:] * normal
    level = np.linalg.norm(uphill, axis=-1, keepdims=True) < 1e-9
    across_x = np.array([1.0, 0.0, 0.0]) - normal[..., :1] * normal
    uphill = np.where(level, across_x, uphill)
    uphill = uphill / np.linalg.norm(uphill, axis=-1, keepdims=True)
    return np.stack([uphill, np.cross(normal, uphill), normal], axis=-1)


def pyramid_faces(friction: Array, facets: int) -> Array:
    """Rows (n, facets, 3) of inscribed pyramids: row @ (uphill, across, normal force) <= 0; an edge points uphill."""
    angle = (2.0 * np.arange(facets) + 1.0) * np.pi / facets
    height = np.broadcast_to(friction[:, None] * np.cos(np.pi / facets), (len(friction), facets))
    sides = np.broadcast_to([np.cos(angle), np.sin(angle)], (len(friction), 2, facets))
    return np.stack([sides[:, 0], sides[:, 1], -height], axis=-1)


def pyramid_edges(friction: Array, facets: int) -> Array:
    """Edges (n, facets, 3), of unit normal force, as (uphill, across, normal force); the first points uphill."""
    angle = 2.0 * np.pi * np.arange(facets) / facets
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    edges = np.ones((len(friction), facets, 3))
    edges[..., :2] = friction[:, None, None] * around
    return edges
