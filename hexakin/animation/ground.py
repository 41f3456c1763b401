"""The ground around a walk as coloured triangles: parts of planes, blocks and elevation data."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.figures.solids_3d import BlockFaces
from hexakin.numerics.display import short_repr
from hexakin.terrain.base import Terrain, TriangleMesh
from hexakin.terrain.columns import block_columns

TILE = 0.1  # [m], edge of a tile of plane ground; the tiles show lengths

_LIGHT, _SHADE = np.array([0.93, 0.91, 0.85]), np.array([0.85, 0.82, 0.74])  # as in the figures
_LOW, _HIGH = np.array([0.63, 0.57, 0.46]), np.array([0.98, 0.96, 0.90])
_BANDS = 12  # number of colours between the lowest and the highest ground
_MOST_TILES = 10_000


class Surface(NamedTuple):
    """Triangles of one colour: ``vertices`` (v, 3) [m], ``triangles`` (t, 3) indices, ``colour`` ``#rrggbb``.

    The vertices of a triangle are counter-clockwise seen from outside. Faces do not share vertices, so that edges are
    drawn sharp. ``tile`` [m] is the edge of a tile, 0 if the surface is not made of tiles.
    """

    vertices: Array
    triangles: NDArray[np.int_]
    colour: str
    tile: float = 0.0

    def __repr__(self) -> str:
        return short_repr(self)


def ground_surfaces(terrain: Terrain, p_foot: Array) -> tuple[Surface, ...]:
    """Return the ground below the feet ``p_foot`` (n, L, 3) [m] and around them, up to 0.6 of the spread of the feet.

    Blocks and triangle meshes are shown as they are, in lighter colours where they are higher. Other ground is shown as
    tiles. Their edges are parallel to the terrain's ``heading``, if it has one, so that the lower edge of a ramp lies
    between two tiles.
    """
    points = p_foot.reshape(-1, 3)[:, :2]
    spread = np.ptp(p_foot.reshape(-1, *p_foot.shape[-2:])[0, :, :2], axis=0).max()
    low, high = points.min(axis=0) - 0.6 * spread, points.max(axis=0) + 0.6 * spread
    columns = block_columns(terrain, low, high)
    if columns is not None:
        faces = BlockFaces(*columns).faces.copy()  # (b, 5, 4, 3)
        faces[:, [1, 4]] = faces[:, [1, 4], ::-1]  # reverse the faces towards -x and +y: now all are counter-clockwise
        return _banded(faces, columns[1][:, 2])
    meshes = [shape for shape in terrain.shapes() if isinstance(shape, TriangleMesh)]
    if meshes:
        return tuple(surface for mesh in meshes for surface in _cropped(mesh, low, high))
    return _tiles(terrain, points, 0.6 * spread)


def _quads(corners: Array, colour: Array, tile: float = 0.0) -> Surface:
    """Return quadrilaterals (m, 4, 3) [m] as a surface with two triangles for each."""
    first = 4 * np.arange(len(corners))[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return Surface(corners.reshape(-1, 3), triangles, to_hex(tuple(colour)), tile)


def _band(height: Array) -> tuple[NDArray[np.int_], Array]:
    """Return the index of the colour band of each height, and the colours (_BANDS, 3) of the bands."""
    span = max(float(np.ptp(height)), 1e-12)
    band = np.minimum((_BANDS * (height - height.min()) / span).astype(int), _BANDS - 1)
    return band, _LOW + np.linspace(0.0, 1.0, _BANDS)[:, None] * (_HIGH - _LOW)


def _banded(faces: Array, height: Array) -> tuple[Surface, ...]:
    band, colours = _band(height)
    return tuple(_quads(faces[band == k].reshape(-1, 4, 3), colours[k]) for k in np.unique(band))


def _cropped(mesh: TriangleMesh, low: Array, high: Array) -> tuple[Surface, ...]:
    """Return the triangles of a mesh that reach into the window from low to high (x, y) [m], by bands of height."""
    corners = mesh.vertices[mesh.triangles]  # (t, 3, 3)
    inside = ((corners[..., :2].max(axis=1) >= low) & (corners[..., :2].min(axis=1) <= high)).all(axis=-1)
    corners = corners[inside]
    if len(corners) == 0:
        return ()
    band, colours = _band(corners[..., 2].mean(axis=-1))
    return tuple(
        Surface(
            corners[band == k].reshape(-1, 3),
            np.arange(3 * (band == k).sum()).reshape(-1, 3),
            to_hex(tuple(colours[k])),
        )
        for k in np.unique(band)
    )


def _tiles(terrain: Terrain, points: Array, margin: float) -> tuple[Surface, ...]:
    """Return tiles in two colours below the points (k, 2) [m] and up to ``margin`` [m] around them."""
    heading, start = float(getattr(terrain, "heading", 0.0)), getattr(terrain, "start", None) or 0.0
    along = np.array([np.cos(heading), np.sin(heading)])
    axes = np.stack([along, [-along[1], along[0]]])
    places = points @ axes.T
    low, high = places.min(axis=0) - margin - [start, 0.0], places.max(axis=0) + margin - [start, 0.0]
    tile = TILE
    while np.prod((high - low) / tile) > _MOST_TILES:
        tile *= 2.0
    first, last = np.floor(low / tile).astype(int), np.ceil(high / tile).astype(int)
    i, j = np.meshgrid(np.arange(first[0], last[0]), np.arange(first[1], last[1]), indexing="ij")
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    cells = np.stack([i, j], axis=-1).reshape(-1, 1, 2)
    xy = ((cells + corner) * tile + [start, 0.0]) @ axes
    corners = np.concatenate([xy, terrain.height(xy[..., 0], xy[..., 1])[..., None]], axis=-1)
    light = (cells.sum(axis=-1) % 2 == 0).ravel()
    return _quads(corners[light], _LIGHT, tile), _quads(corners[~light], _SHADE, tile)
