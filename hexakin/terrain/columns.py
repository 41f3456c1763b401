"""Convert a terrain of boxes to columns that do not overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array
from hexakin.terrain.base import Box, HalfSpace, Terrain


def block_columns(terrain: Terrain, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array] | None:
    """Return the columns that fill a terrain of boxes inside a window; None for a terrain of other shapes.

    Parameters
    ----------
    terrain
        A terrain of boxes, with or without level ground around them.
    low, high
        Corners of the window (x, y), (2,) [m].

    Returns
    -------
    tuple
        Lower and upper corners (b, 3) [m] of the columns, which do not overlap. They begin at the level ground, or, if
        there is none, at the lowest underside of the boxes.
    """
    shapes = terrain.shapes()
    boxes = [shape for shape in shapes if isinstance(shape, Box)]
    ground = [shape.point[2] for shape in shapes if isinstance(shape, HalfSpace) and shape.normal == (0.0, 0.0, 1.0)]
    if not boxes or len(boxes) + len(ground) < len(shapes):
        return None
    corners = np.array([(box.lower, box.upper) for box in boxes])
    bottom = max(ground) if ground else corners[..., 2].min()
    edges = []
    for axis, (begin, end) in enumerate(np.transpose([low, high])):
        inside = corners[..., axis][(corners[..., axis] > begin) & (corners[..., axis] < end)]
        edges.append(np.unique(np.concatenate([[begin], np.round(inside, 9), [end]])))
    x0, y0 = (e.ravel() for e in np.meshgrid(edges[0][:-1], edges[1][:-1], indexing="ij"))
    x1, y1 = (e.ravel() for e in np.meshgrid(edges[0][1:], edges[1][1:], indexing="ij"))
    top = np.fmax(terrain.height((x0 + x1) / 2.0, (y0 + y1) / 2.0), bottom)
    return np.column_stack([x0, y0, np.full_like(x0, bottom)]), np.column_stack([x1, y1, top])
