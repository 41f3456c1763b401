"""Blocks on 3D axes, and solids that the blocks hide.

Whenever the axes are drawn, faces are sorted and cut for the point from which they are seen then, the eye. All lengths
are in the unit of the axes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from hexakin.checks import Array
from hexakin.figures.occlusion import cut_hidden, hiding_planes

_LOWEST, _HIGHEST = np.array([0.63, 0.57, 0.46]), np.array([0.98, 0.96, 0.90])  # colours of tops
_SIDE_X, _SIDE_Y = 0.62, 0.78  # brightness of the sides, as a share of the top's
_FAR = 1e4  # distance of the eye in an orthographic view, as a multiple of the size of the axes


def eye_of(ax: Any) -> Array:
    """Return the eye (3,) of 3D axes: the point from which they are seen, which their projection maps to no place."""
    projection = ax.get_proj()
    *place, weight = np.linalg.svd(projection[[0, 1, 3]])[2][-1]
    if abs(weight) > 1e-12 * np.abs(place).max():
        return np.array(place) / weight
    center = np.mean([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], axis=1)
    depth = np.array(place) / np.linalg.norm(place)
    size = np.ptp([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    return center - np.sign(projection[2, :3] @ depth) * _FAR * size * depth


class BlockFaces(PolyCollection):
    """Tops and sides of upright blocks that stand side by side, drawn from the farthest to the nearest.

    ``lower`` (b, 3) and ``upper`` (b, 3) are opposite corners of the blocks. The top of a higher block is lighter;
    sides are darker than tops.
    """

    def __init__(self, lower: Array, upper: Array, **options: Any):
        super().__init__([], edgecolors=(0.25, 0.22, 0.17), linewidths=0.35, joinstyle="round", **options)
        self.set(clip_on=False, in_layout=False)  # corners may leave the panel; the layout only works for 2D points
        self.lower, self.upper = lower, upper
        (x0, y0, z0), (x1, y1, z1) = lower.T, upper.T
        rings = [
            [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
            [(x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1)],
            [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
            [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
            [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)],
        ]
        #: Faces (b, 5, 4, 3): top, then the sides towards -x, +x, -y and +y.
        self.faces = np.moveaxis(np.array(rings), -1, 0)
        span = np.ptp(z1)
        share = (z1 - z1.min()) / span if span > 0.0 else np.ones_like(z1)
        top = _LOWEST + share[:, None] * (_HIGHEST - _LOWEST)
        brightness = np.array([1.0, _SIDE_X, _SIDE_X, _SIDE_Y, _SIDE_Y])
        self._colours = top[:, None] * brightness[:, None]  # (b, 5, 3)

    @property
    def corners(self) -> Array:
        """Lower and upper corners of all blocks, (2 b, 3)."""
        return np.concatenate([self.lower, self.upper])

    def do_3d_projection(self) -> float:
        """Sort the faces that the eye sees, and project them."""
        eye = eye_of(self.axes)
        (x0, y0, _), (x1, y1, z1) = self.lower.T, self.upper.T
        seen = np.column_stack([eye[2] > z1, eye[0] < x0, eye[0] > x1, eye[1] < y0, eye[1] > y1])
        # Along a ray to the eye, the distances in x and in y both become smaller. Therefore no block hides another one
        # whose sum of both distances is smaller.
        away = np.maximum(np.maximum(self.lower - eye, eye - self.upper), 0.0)[:, :2].sum(axis=1)
        order = np.argsort(-away, kind="stable")
        faces, colours = self.faces[order][seen[order]], self._colours[order][seen[order]]
        projection = self.axes.get_proj()  # type: ignore[union-attr]
        x, y, _ = proj3d.proj_transform(*faces.reshape(-1, 3).T, projection)
        self.set_verts(list(np.stack([x, y], axis=-1).reshape(-1, 4, 2)))
        self.set_facecolor(colours)
        return 0.0


class SolidFaces(Poly3DCollection):
    """Shaded convex faces (m, k, 3) of solids; the parts that lie behind blocks on the same axes are not drawn."""

    def __init__(self, faces: Array, colours: ArrayLike, **options: Any):
        super().__init__(faces, facecolors=colours, shade=True, **options)
        self._whole, self._shaded = faces, np.asarray(PolyCollection.get_facecolor(self))

    def do_3d_projection(self) -> float:
        """Cut away the hidden parts, and project the rest."""
        faces, origin = self._whole, np.arange(len(self._whole))
        for blocks in (artist for artist in self.axes.collections if isinstance(artist, BlockFaces)):
            faces, kept = cut_hidden(faces, hiding_planes(blocks.lower, blocks.upper, eye_of(self.axes)))
            origin = origin[kept]
        self.set_verts(faces)
        self.set_facecolor(self._shaded[origin])
        return super().do_3d_projection()
