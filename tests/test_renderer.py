"""The renderer of GIF and MP4 files: which triangle a pixel shows, at what depth, and where shadows fall."""

import numpy as np
import pytest

from hexakin.animation.renderer import box, looking_at, nearest, picture, sphere

SIZE = (80, 60)
BACKGROUND = np.array([0.2, 0.4, 0.6])


def camera(place=(0.0, -3.0, 1.0), size=SIZE):
    return looking_at(np.zeros(3), np.array(place, dtype=float), np.radians(40.0), size)


def rays(view):
    """Directions (height, width, 3) of the rays through the pixels, in the camera's frame."""
    width, height = view.size
    x, y = np.meshgrid(np.arange(width) - 0.5 * (width - 1), np.arange(height) - 0.5 * (height - 1))
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def ray_by_ray(corners, size):
    """The same as ``nearest``, with one ray and one triangle at a time: Moeller and Trumbore's intersection."""
    index, closeness = np.full(size[::-1], -1), np.zeros(size[::-1])
    directions = rays(camera(size=size))
    for pixel in np.ndindex(index.shape):
        for k, (a, b, c) in enumerate(corners):
            if np.linalg.det([a, b, c]) > -1e-9:
                continue
            depth, u, v = np.linalg.solve(np.column_stack([directions[pixel], a - b, a - c]), a)
            if min(u, v, 1.0 - u - v) >= 0.0 and depth > 0.0 and 1.0 / depth > closeness[pixel]:
                index[pixel], closeness[pixel] = k, 1.0 / depth
    return index, closeness


def test_pixels_show_the_triangle_that_a_ray_meets_first(rng):
    """Also where triangles reach behind the camera, beyond the picture, or cross each other."""
    corners = rng.uniform([-30.0, -30.0, -0.5], [30.0, 30.0, 2.0], (40, 3, 3))
    index, closeness = nearest(corners, (24, 18))
    expected, depth = ray_by_ray(corners, (24, 18))
    assert (corners[..., 2] < 0.0).any(axis=1).sum() > 5 and len(np.unique(index)) > 5
    assert (index == expected).all()
    assert closeness == pytest.approx(depth, rel=1e-9)


def test_a_sphere_looks_round_and_a_box_hides_what_is_behind_it():
    view = camera((0.0, -3.0, 0.0), (200, 200))
    ball = sphere(1.0, 2000)
    index, closeness = nearest(view.local(ball), view.size)
    # A sphere of radius r at the distance d covers the cone of the angle asin(r / d).
    radius = 100.0 / np.tan(np.radians(20.0)) * np.tan(np.arcsin(0.5 / 3.0))
    assert (index >= 0).sum() == pytest.approx(np.pi * radius**2, rel=0.02)
    assert 1.0 / closeness.max() == pytest.approx(2.5, abs=1e-3)
    hidden = np.concatenate([ball, box(np.array([2.0, 0.1, 2.0])) - [0.0, 1.0, 0.0]])
    assert nearest(view.local(hidden), view.size)[0].min(where=index >= 0, initial=9999) >= len(ball)


def test_boxes_and_spheres_are_closed_and_face_outwards():
    for solid, volume in ((box(np.array([1.0, 2.0, 3.0])), 6.0), (sphere(2.0, 3000), 4.0 / 3.0 * np.pi)):
        assert np.linalg.det(solid).sum() / 6.0 == pytest.approx(volume, rel=2e-3)
        assert (np.linalg.det(solid) > 0.0).all()


def test_the_shadow_lies_where_the_ray_to_the_light_meets_the_box():
    """The light comes from (0.6, -0.4, 2): a box at the height h darkens the ground at -h (0.3, -0.2) from it."""
    floor = 5.0 * np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]], dtype=float)
    corners = np.concatenate([floor, box(np.array([0.4, 0.4, 0.02])) + [0.0, 0.0, 1.0]])
    casts = np.arange(len(corners)) >= 2
    view = camera((0.0, -6.0, 4.0), (320, 240))
    image, index = picture(view, corners, np.ones((len(corners), 3)), casts, BACKGROUND)
    ground = (index >= 0) & (index < 2)
    depth = 1.0 / nearest(view.local(corners), view.size)[1][ground]
    points = view.place + (depth[:, None] * rays(view)[ground]) @ np.linalg.inv(view.axes).T
    away = np.abs(points[:, :2] - [-0.3, 0.2]).max(axis=1)
    dark = image[ground, 0] < 0.7 * image[ground, 0].max()
    assert dark[away < 0.18].all() and not dark[away > 0.22].any() and dark.sum() > 50
    assert (image[index < 0] == np.round(255.0 * BACKGROUND)).all()
    bright, _ = picture(view, corners, np.ones((len(corners), 3)), np.zeros_like(casts), BACKGROUND)
    assert (bright[ground] == image[ground].max()).all()
