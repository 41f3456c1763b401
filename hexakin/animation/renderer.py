"""Pictures of triangles: a pinhole camera, hidden surfaces, shading and shadows, in NumPy.

All triangles of a picture are treated together. A ray through a pixel has the direction d in the camera's frame; it
meets the triangle with the corners v1, v2, v3 where d = b1 v1 + b2 v2 + b3 v3 with b1, b2, b3 >= 0, at the depth
1 / (b1 + b2 + b3). This needs no clipping: it holds for a triangle that reaches behind the camera too (M. Olano and
T. Greer, Triangle scan conversion using 2D homogeneous coordinates, Graphics Hardware 1997). Along a row of pixels each
b is linear, so that the pixels of a triangle are one span per row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from hexakin.checks import Array
from hexakin.numerics.display import short_repr

_AMBIENT, _DIFFUSE = 0.55, 0.5  # shares of a colour on a face in shadow, and added where light meets it at right angles
_LIGHT = np.array([0.6, -0.4, 2.0])  # direction to the light, in the world frame
_LIGHT_DISTANCE = 200.0  # times the radius of what casts shadows: the rays of the light are almost parallel
_SHADOW_PIXELS = 800  # pixels of the light's view along each side


class Camera(NamedTuple):
    """A pinhole camera: its ``place`` (3,) [m], its scaled axes ``axes`` (3, 3), and its ``size`` (width, height) [px].

    The rows of ``axes`` point to the right, down and forwards in the picture; the first two are multiplied by the focal
    length [px]. A point then has the place (x / z, y / z) [px] from the picture's middle, with x, y, z from ``local``.
    """

    place: Array
    axes: Array
    size: tuple[int, int]

    def __repr__(self) -> str:
        return short_repr(self)

    def local(self, points: Array) -> Array:
        """Return points (..., 3) [m] of the world in the camera's frame; z (last) is the depth [m]."""
        return (points - self.place) @ self.axes.T


def looking_at(target: Array, place: Array, field_of_view: float, size: tuple[int, int]) -> Camera:
    """Return a camera at ``place`` (3,) [m] with ``target`` (3,) [m] in its middle; the world's z axis points up.

    ``field_of_view`` [rad] is the angle from the lower to the upper edge of the picture; ``size`` (width, height) [px].
    """
    forward = (target - place) / np.linalg.norm(target - place)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    focal = 0.5 * size[1] / np.tan(0.5 * field_of_view)
    return Camera(place, np.array([focal * right, focal * np.cross(forward, right), forward]), size)


def nearest(corners: Array, size: tuple[int, int]) -> tuple[NDArray[np.int_], Array]:
    """Return for each pixel the index of the nearest triangle, -1 for none, and 1 / its depth [1/m], 0 for none.

    Both results are (height, width).

    ``corners`` (t, 3, 3) are in the camera's frame (``Camera.local``); ``size`` (width, height) [px] is the picture's.
    A triangle is seen from the side from which its corners are in counter-clockwise order.
    """
    width, height = size
    # Pixels at the places (x, y) from the middle have the direction d = (x, y, 1). With M = (v1, v2, v3), d = M b and
    # b = M^-1 d, whose rows are cross products of two corners, divided by the determinant. The triangle is seen from
    # its front if the determinant is negative.
    normals = np.cross(corners[:, [1, 2, 0]], corners[:, [2, 0, 1]])
    determinant = np.einsum("ti,ti->t", corners[:, 0], normals[:, 0])
    facing = determinant < -1e-12 * np.abs(normals).max(axis=(1, 2))
    front = np.flatnonzero(facing & np.any(corners[..., 2] > 0.0, axis=1))
    b = normals[front] / determinant[front, None, None]  # (f, corner, coefficient of x, y, 1)
    # One span for each triangle and row.
    z = corners[front, :, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = np.where(z.min(axis=1, keepdims=True) > 0.0, corners[front, :, 1] / z, [-np.inf, np.inf, np.inf])
    first = np.ceil(np.clip(rows.min(1) + 0.5 * (height - 1), 0, height)).astype(int)
    last = np.floor(np.clip(rows.max(1) + 0.5 * (height - 1), -1, height - 1)).astype(int)
    triangle, row = _ranges(first, last)
    slope, start = b[triangle, :, 0], b[triangle, :, 1] * (row - 0.5 * (height - 1))[:, None] + b[triangle, :, 2]
    start -= 0.5 * (width - 1) * slope  # b = start + slope * column
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -start / slope
    low = np.where(slope > 0.0, zero, np.where((slope == 0.0) & (start < 0.0), np.inf, 0.0)).max(axis=1)
    high = np.where(slope < 0.0, zero, np.inf).min(axis=1)
    left = np.ceil(np.clip(low, 0, width)).astype(int)
    span, column = _ranges(left, np.floor(np.clip(high, -1, width - 1)).astype(int))
    # One entry for each pixel of each span; the largest 1 / depth of a pixel wins.
    pixel = (width * row)[span] + column
    closeness = start.sum(axis=1)[span] + slope.sum(axis=1)[span] * column
    closest = np.zeros(width * height)
    np.maximum.at(closest, pixel, closeness)
    wins = closeness == closest[pixel]
    index = np.full(width * height, -1)
    index[pixel[wins]] = front[triangle[span[wins]]]
    return index.reshape(height, width), closest.reshape(height, width)


def _ranges(first: NDArray[np.int_], last: NDArray[np.int_]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the whole numbers from first[i] to last[i] for all i, one after another, with the i of each."""
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) + (first - np.cumsum(count) + count)[owner]


def picture(
    camera: Camera, corners: Array, colours: Array, casts: NDArray[np.bool_], background: Array
) -> tuple[NDArray[np.uint8], NDArray[np.int_]]:
    """Return a picture (height, width, 3) of triangles, and the index of the triangle at each pixel, -1 for none.

    ``corners`` (t, 3, 3) [m] are in the world frame, counter-clockwise seen from outside; ``colours`` (t, 3) and
    ``background`` (3,) are in [0, 1]. Triangles that ``casts`` (t,) marks cast shadows; they belong to closed surfaces.
    """
    index, closeness = nearest(camera.local(corners), camera.size)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
    shine = _DIFFUSE * np.maximum(normal @ _LIGHT / np.linalg.norm(_LIGHT), 0.0)
    # Colours in the light and in shadow; the last one of each, which the index -1 selects, is the background.
    shades = [np.vstack([colours * light, background]) for light in (_AMBIENT + shine[:, None], _AMBIENT)]
    lit, dark = np.round(255.0 * np.minimum(shades, 1.0)).astype(np.uint8)
    image, shadow = lit[index], _in_shadow(camera, closeness, corners[casts])
    image[shadow] = dark[index[shadow]]
    return image, index


def _in_shadow(camera: Camera, closeness: Array, casting: Array) -> NDArray[np.bool_]:
    """Return which pixels (height, width) show a point that the light does not reach.

    The triangles ``casting`` (t, 3, 3) [m] stand in its way. ``closeness`` (height, width) [1/m] is 1 / depth of the
    points.
    """
    shadow = np.zeros(closeness.shape, dtype=bool)
    if len(casting) == 0:
        return shadow
    # The light is a camera that sees all that casts shadows.
    middle = 0.5 * (casting.min(axis=(0, 1)) + casting.max(axis=(0, 1)))
    radius = np.linalg.norm(casting - middle, axis=-1).max()
    place = middle + _LIGHT_DISTANCE * radius * _LIGHT / np.linalg.norm(_LIGHT)
    view = 2.0 * np.arcsin(1.0 / _LIGHT_DISTANCE)
    light = looking_at(middle, place, view, (_SHADOW_PIXELS, _SHADOW_PIXELS))
    # The sides away from the light cast the shadow: the lit sides are then never in their own.
    _, first = nearest(light.local(casting[:, ::-1]), light.size)
    # A point at the depth z along the ray d has the place z turn d + shift in the light's frame, and so its pixel there
    # is that of turn d + shift / z.
    turn, shift = light.axes @ np.linalg.inv(camera.axes), light.local(camera.place)
    row, column = (np.arange(count) - 0.5 * (count - 1) for count in closeness.shape)
    x, y, z = (np.add.outer(a[1] * row + a[2], a[0] * column) + s * closeness for a, s in zip(turn, shift, strict=True))
    half = 0.5 * (_SHADOW_PIXELS - 1)
    seen = (closeness > 0.0) & (np.maximum(np.abs(x), np.abs(y)) <= half * z)
    u, v = (np.round(values[seen] / z[seen] + half).astype(int) for values in (x, y))
    shadow[seen] = first[v, u] > closeness[seen] / z[seen]
    return shadow


def box(size: Array) -> Array:
    """Return the triangles (12, 3, 3) [m] of a box with edges ``size`` (3,) [m] around the origin."""
    corner = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return _hull(corner) * size


def sphere(diameter: float, count: int = 150) -> Array:
    """Return triangles (t, 3, 3) [m] around the origin whose ``count`` corners lie on a sphere; ``diameter`` [m]."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, k * np.pi * (3.0 - np.sqrt(5.0))  # a spiral by the golden angle: evenly spread
    ring = np.sqrt(1.0 - z**2)
    return 0.5 * diameter * _hull(np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z]))


def _hull(points: Array) -> Array:
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("ti,ti->t", normal, hull.equations[:, :3]) < 0.0
    corners[inwards] = corners[inwards, ::-1]
    return corners
