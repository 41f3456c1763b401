"""Pyramids inscribed in friction cones, described by their faces or by their edges.

One edge of each pyramid points uphill. A pyramid of ``facets`` sides contains the cone of the friction coefficient
mu cos(pi / facets), and it holds a vertical force exactly up to the friction angle.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array


def contact_frames(normal: Array) -> Array:
    """Axes of the contact frames (..., 3, 3) as columns: uphill, across, and along the unit ``normal`` (..., 3).

    On level ground the x axis takes the place of the uphill axis.
    """
    uphill = np.array([0.0, 0.0, 1.0]) - normal[..., 2:] * normal
    level = np.linalg.norm(uphill, axis=-1, keepdims=True) < 1e-9
    across_x = np.array([1.0, 0.0, 0.0]) - normal[..., :1] * normal
    uphill = np.where(level, across_x, uphill)
    uphill = uphill / np.linalg.norm(uphill, axis=-1, keepdims=True)
    return np.stack([uphill, np.cross(normal, uphill), normal], axis=-1)


def pyramid_faces(friction: Array, facets: int) -> Array:
    """Faces (n, facets, 3) of the pyramids inscribed in the cones with the coefficients ``friction`` (n,).

    A contact force f = (uphill, across, normal) lies in the pyramid if ``row @ f <= 0`` for each of its rows. One edge
    points uphill.
    """
    angle = (2.0 * np.arange(facets) + 1.0) * np.pi / facets
    height = np.broadcast_to(friction[:, None] * np.cos(np.pi / facets), (len(friction), facets))
    sides = np.broadcast_to([np.cos(angle), np.sin(angle)], (len(friction), 2, facets))
    return np.stack([sides[:, 0], sides[:, 1], -height], axis=-1)


def pyramid_edges(friction: Array, facets: int) -> Array:
    """Edges (n, facets, 3) of the pyramids inscribed in the cones with the coefficients ``friction`` (n,).

    Each edge is a force (uphill, across, normal) with the normal part 1. The first edge points uphill.
    """
    angle = 2.0 * np.pi * np.arange(facets) / facets
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    edges = np.ones((len(friction), facets, 3))
    edges[..., :2] = friction[:, None, None] * around
    return edges
