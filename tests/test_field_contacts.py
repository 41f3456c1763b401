"""The search for contacts with a height field finds what the comparison of all its triangles and vertices finds."""

import gc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hexakin as hk
from hexakin.engines import field_grid
from hexakin.engines.field_grid import compile_field
from hexakin.engines.ground_contacts import box_near, empty_contacts, sphere_contacts, vertex_contacts
from hexakin.engines.ground_grid import compile_ground
from hexakin.terrain.base import TriangleMesh

SAME = 1e-9  # [m] points that are closer count as the same point
TIE = 1e-13  # [m] distances that differ by less are equal up to rounding
MARGIN = 0.0025  # [m]


def nearest(a, b, c, p):
    """Closest points (t, 3) of triangles to a point, and whether they are inside, from faces and edges in turn."""
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    foot = p - ((p - a) * normal).sum(axis=1, keepdims=True) * normal
    inside = np.ones(len(a), dtype=bool)
    edges = []
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(end - start, foot - start) * normal).sum(axis=1) > 0.0
        share = ((p - start) * (end - start)).sum(axis=1) / ((end - start) ** 2).sum(axis=1)
        edges.append(start + share.clip(0.0, 1.0)[:, None] * (end - start))
    edge = np.array(edges)
    best = np.linalg.norm(edge - p, axis=2).argmin(axis=0)
    return np.where(inside[:, None], foot, edge[best, np.arange(len(a))]), inside, normal


def compared(mesh, p, radius):
    """Contacts (point, normal, gap) of a sphere by comparing all triangles near it with each other."""
    corners = mesh.vertices[mesh.triangles]
    reach = radius + MARGIN
    close = ((corners[..., :2].max(axis=1) >= p[:2] - reach) & (corners[..., :2].min(axis=1) <= p[:2] + reach)).all(
        axis=1
    )
    a, b, c = np.moveaxis(corners[close], 1, 0)
    point, inside, normal = nearest(a, b, c, p)
    away = p - point
    distance = np.linalg.norm(away, axis=1)
    below = (away * normal).sum(axis=1) < 0.0
    signed = np.where(inside, np.where(below, -distance, distance), np.where(below, np.inf, distance))
    found = []
    for k in np.flatnonzero(signed <= reach):
        closer = (signed < signed[k] - TIE) | ((signed <= signed[k] + TIE) & (np.arange(len(a)) < k))
        there = np.linalg.norm(nearest(a, b, c, point[k])[0] - point[k], axis=1) <= SAME
        if not (closer & there & (signed <= reach)).any():
            unit = normal[k] if inside[k] else away[k] / distance[k]
            found.append((*point[k], *unit, signed[k] - radius))
    return np.array(found).reshape(-1, 7)


def hidden(field, p, point):
    """Whether the line from the centre of a sphere to a contact point passes through the ground."""
    along = np.linspace(0.0, 0.999, 300)[:, None]
    x, y, z = (p + along * (point - p)).T
    return ((z - field.height(x, y)) < -1e-9).any()


def searched(ground, p, radius):
    contacts = empty_contacts(256)
    count = sphere_contacts(ground, 1, 0, 0, *p, radius, MARGIN, contacts, 0)
    return np.column_stack([contacts.point, contacts.normal, contacts.gap])[:count]


def in_order(contacts):
    return contacts[np.lexsort(contacts[:, :3].round(6).T)]


def random_field(rng, nx, ny, rough, even=False):
    x, y = np.arange(nx) * 0.02 - 3.0, np.arange(ny) * (0.02 if even else 0.031) + 7.0
    waves = 0.03 * np.sin(40.0 * x[:, None] + 1.0) * np.cos(30.0 * y)
    return hk.terrain.HeightField(x, y, waves + rng.uniform(0.0, rough, (nx, ny)))


def inner(field, rng, border):
    return np.array([rng.uniform(axis[0] + border, axis[-1] - border) for axis in (field.x, field.y)])


sizes, seeds = st.integers(6, 70), st.integers(0, 2**32 - 1)


@given(seed=seeds, nx=sizes, ny=sizes, rough=st.sampled_from([0.0, 0.002, 0.01, 0.04]))
@settings(max_examples=25, deadline=None)
def test_spheres_have_the_contacts_that_a_comparison_of_all_triangles_finds(seed, nx, ny, rough):
    rng = np.random.default_rng(seed)
    field = random_field(rng, nx, ny, rough)
    (mesh,), ground = field.shapes(), compile_ground(field)
    for _ in range(10):
        radius = rng.uniform(0.004, 0.03)
        xy = inner(field, rng, radius + MARGIN)
        p = np.array([*xy, field.height(*xy) + rng.uniform(-0.2, 1.5) * radius])
        mine, all_found = searched(ground, p, radius), compared(mesh, p, radius)
        seen = np.array([not hidden(field, p, contact[:3]) for contact in all_found], dtype=bool)
        expected = all_found[seen]
        visible = np.array([not hidden(field, p, contact[:3]) for contact in mine], dtype=bool)
        np.testing.assert_allclose(in_order(mine[visible]), in_order(expected), atol=1e-8)
        for contact in mine[~visible]:
            assert np.linalg.norm(all_found - contact, axis=1).min() < 1e-7


@given(seed=seeds, nx=sizes, ny=sizes, rough=st.sampled_from([0.0, 0.01]))
@settings(max_examples=20, deadline=None)
def test_corners_touch_the_triangle_under_them(seed, nx, ny, rough):
    rng = np.random.default_rng(seed)
    field = random_field(rng, nx, ny, rough)
    ground = compile_ground(field)
    for _ in range(10):
        xy = inner(field, rng, 0.0)
        p = np.array([*xy, field.height(*xy) + rng.uniform(-0.01, 0.004)])
        normal = field.normal(*xy)
        gap = (p[2] - field.height(*xy)) * normal[2]
        mine = searched(ground, p, 0.0)
        assert len(mine) == (gap <= MARGIN)
        for contact in mine:
            assert contact == pytest.approx([*(p - gap * normal), *normal, gap], abs=1e-12)


def test_a_corner_on_the_edges_of_level_triangles_has_one_contact():
    grid = np.linspace(0.0, 1.0, 11)
    ground = compile_ground(hk.terrain.HeightField(grid, grid, np.zeros((11, 11))))
    for x, y in ((0.5, 0.5), (0.55, 0.5), (0.55, 0.55), (0.0, 1.0)):
        assert searched(ground, np.array([x, y, -0.001]), 0.0) == pytest.approx(np.array([[x, y, 0, 0, 0, 1, -0.001]]))


def test_a_sphere_over_edges_of_level_triangles_has_one_contact():
    grid = np.linspace(0.0, 1.0, 11)
    ground = compile_ground(hk.terrain.HeightField(grid, grid, np.zeros((11, 11))))
    for x, y in ((0.5, 0.5), (0.55, 0.5), (0.55, 0.55), (0.0, 1.0), (1.01, 0.5)):
        found = searched(ground, np.array([x, y, 0.02]), 0.025)
        assert len(found) == 1 and found[0, :3] == pytest.approx([min(x, 1.0), y, 0.0])


def deepest_vertices(mesh, R, center, half):
    """Contacts (point, normal, gap) with the deepest vertex in each quarter of each face of a box."""
    local = (mesh.vertices - center) @ R
    depths = half - np.abs(local)
    axis, depth = depths.argmin(axis=1), depths.min(axis=1)
    quarter = 8 * axis + (local > 0.0) @ [1, 2, 4]
    found = []
    for k in np.unique(quarter[depth > -MARGIN]):
        best = np.flatnonzero(quarter == k)[depth[quarter == k].argmax()]
        sign = 1.0 if local[best, k // 8] > 0.0 else -1.0
        found.append((*mesh.vertices[best], *(-sign * R[:, k // 8]), -depth[best]))
    return np.array(found).reshape(-1, 7)


@given(seed=seeds, nx=sizes, ny=sizes, rough=st.sampled_from([0.0, 0.01, 0.04]))
@settings(max_examples=25, deadline=None)
def test_boxes_have_the_deepest_of_all_vertices(seed, nx, ny, rough):
    rng = np.random.default_rng(seed)
    field = random_field(rng, nx, ny, rough)
    (mesh,), ground = field.shapes(), compile_ground(field)
    for _ in range(10):
        half = rng.uniform(0.005, 0.2, 3)
        R = np.ascontiguousarray(np.linalg.qr(rng.normal(size=(3, 3)))[0])
        xy = inner(field, rng, -0.1)
        under = field.height(np.clip(xy[0], field.x[0], field.x[-1]), np.clip(xy[1], field.y[0], field.y[-1]))
        center = np.array([*xy, under + rng.uniform(-0.05, 0.3)])
        contacts = empty_contacts(256)
        count = vertex_contacts(ground, 1, 0, R, center, half, MARGIN, contacts, 0)
        mine = np.column_stack([contacts.point, contacts.normal, contacts.gap])[:count]
        expected = deepest_vertices(mesh, R, center, half)
        np.testing.assert_allclose(in_order(mine), in_order(expected), atol=1e-12)
        assert box_near(ground, R, center, half, MARGIN) or not len(expected)


def test_boxes_far_above_or_beside_a_field_are_not_near(rng):
    field = random_field(rng, 60, 60, 0.01)
    ground, R, half = compile_ground(field), np.eye(3), np.full(3, 0.05)
    middle = np.array([field.x.mean(), field.y.mean(), field.z.max() + 0.06])
    assert not box_near(ground, R, middle, half, MARGIN)
    assert box_near(ground, R, middle - [0, 0, 0.08], half, MARGIN)
    assert not box_near(ground, R, np.array([field.x[-1] + 1.0, field.y[0], 0.0]), half, MARGIN)
    for x in (np.nan, np.inf, -1e300):
        assert not box_near(ground, R, np.array([x, x, 0.0]), half, MARGIN)
        assert len(searched(ground, np.array([x, x, 0.0]), 0.02)) == 0


def test_a_sphere_above_a_step_does_not_touch_the_floor_through_it():
    """The edge at the foot of a low step is closer than the floor around it, but hidden from a sphere on the step."""
    x = np.linspace(0.0, 1.0, 201)
    step = hk.terrain.HeightField(x, x, np.where(x > 0.5, 0.002, 0.0)[:, None] + np.zeros(201))
    found = searched(compile_ground(step), np.array([0.5075, 0.5012, 0.0121]), 0.01)
    assert len(found) == 1 and found[0, 2] == pytest.approx(0.002)


def test_a_mesh_of_the_same_triangles_has_the_same_contacts(rng):
    """The lists of a mesh and the places in a grid lead to the same answers, also side by side."""
    field = random_field(rng, 20, 20, 0.002, even=True)
    (mesh,) = field.shapes()

    class Meshed:
        def shapes(self):
            return (TriangleMesh(mesh.vertices, mesh.triangles),)

    grid, lists = compile_ground(field), compile_ground(Meshed())
    assert lists.field.z.size == 0 and grid.triangles.size == 0
    for _ in range(200):
        xy = inner(field, rng, 0.0)
        p = np.array([*xy, field.height(*xy) + rng.uniform(0.005, 0.025)])
        mine, other = searched(grid, p, 0.02), searched(lists, p, 0.02)
        other = other[[not hidden(field, p, contact[:3]) for contact in other]] if len(other) else other
        np.testing.assert_allclose(in_order(mine), in_order(other), atol=1e-9)


def test_of_too_many_contacts_the_closest_are_kept(rng):
    grid = np.arange(36) * 0.01
    rough = hk.terrain.HeightField(grid, grid, rng.uniform(0.0, 0.001, (36, 36)))
    p, radius = np.array([0.17, 0.17, 20.001]), 20.0
    found, every = searched(compile_ground(rough), p, radius), compared(*rough.shapes(), p, radius)
    every = every[np.argsort(every[:, 6])]
    assert len(every) > 1.2 * len(found)
    assert np.sort(found[:, 6]) == pytest.approx(every[: len(found), 6])


def test_a_field_is_compiled_once_and_freed_with_its_terrain():
    grid = np.linspace(0.0, 1.0, 50)
    field = hk.terrain.HeightField(grid, grid, np.zeros((50, 50)))
    first = compile_ground(field).field
    assert compile_ground(field).field is first and first.z is field.z
    held = len(field_grid._FIELDS)
    del field, first
    gc.collect()
    assert len(field_grid._FIELDS) < held


def test_bounds_hold_the_heights_and_slopes_of_their_blocks(rng):
    field = random_field(rng, 31, 22, 0.05)
    compiled = compile_field(*field.shapes())
    slopes_x, slopes_y = np.diff(field.z, axis=0) / 0.02, np.diff(field.z, axis=1) / 0.031
    for level, (first, rows, columns) in enumerate(compiled.levels):
        size = 4 ** (level + 1)
        for i in range(rows):
            for j in range(columns):
                bounds = compiled.bounds[first + i * columns + j]
                here, there = slice(i * size, (i + 1) * size + 1), slice(j * size, (j + 1) * size + 1)
                heights, along_x, along_y = (
                    field.z[here, there],
                    slopes_x[i * size :, there],
                    slopes_y[here, j * size :],
                )
                for k, values in enumerate((heights, along_x[:size], along_y[:, :size])):
                    assert bounds[2 * k] <= values.min() + 1e-12 and bounds[2 * k + 1] >= values.max() - 1e-12
    assert compiled.bounds[-1, :2] == pytest.approx([field.z.min(), field.z.max()])
