"""Contacts of spheres and boxes with each other: against coal, another library, and against known answers."""

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hexakin.engines.shape_pairs import MOST_POINTS, box_box, sphere_box, sphere_sphere

FLUSH = 1e-3  # [m] within this height of the deepest point points belong to a contact of faces


def box(turn, center, size):
    return np.concatenate([turn.as_matrix().T.ravel(), center, 0.5 * np.asarray(size)])


def touch(A, B, margin=0.0):
    """Points (k, 3), normals (k, 3) and gaps (k,) of two boxes."""
    rows = np.zeros((MOST_POINTS, 7))
    count = box_box(A, B, margin, np.zeros((2, 8, 3)), rows)
    return rows[:count, :3], rows[:count, 3:6], rows[:count, 6]


def by_coal(A, B, margin=0.0):
    """Normal, gap and patch (k, 3) of two boxes by coal; None if they are farther apart than the margin."""
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = margin
    boxes = [(coal.Box(*(2.0 * C[12:])), coal.Transform3s(C[:9].reshape(3, 3).T, C[9:12])) for C in (A, B)]
    (mine, pose), (other, its_pose) = boxes
    if not coal.collide(mine, pose, other, its_pose, request, result):
        return None
    wanted = coal.ContactPatchRequest()
    wanted.setPatchTolerance(FLUSH)
    patches = coal.ContactPatchResult(wanted)
    coal.computeContactPatch(mine, pose, other, its_pose, result, wanted, patches)
    patch = patches.getContactPatch(0)
    points = np.array([patch.getPoint(k) for k in range(patch.size())])
    return -patch.getNormal(), patch.penetration_depth, points


def random_box(rng, spread=0.0, sizes=(0.02, 0.3)):
    return box(Rotation.random(random_state=rng), spread * rng.normal(size=3), rng.uniform(*sizes, 3))


def separation(A, B):
    """Largest gap of the boxes' projections, over the normals of faces and of pairs of edges."""
    mine, its = A[:9].reshape(3, 3), B[:9].reshape(3, 3)
    axes = np.concatenate([mine, its, np.cross(mine[:, None], its).reshape(-1, 3)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    widths = np.abs(axes @ mine.T) @ A[12:] + np.abs(axes @ its.T) @ B[12:]
    return (np.abs(axes @ (B - A)[9:12]) - widths).max()


def test_random_boxes_have_coals_gap_and_normal(rng):
    margin, seen = 0.05, []
    for _ in range(2000):
        A, B = random_box(rng), random_box(rng, spread=0.15)
        theirs, (_, normals, gaps) = by_coal(A, B, margin), touch(A, B, margin)
        assert (theirs is None) == (len(gaps) == 0)
        if theirs is None:
            continue
        deepest = np.argmin(gaps)
        assert gaps[deepest] == pytest.approx(theirs[1], abs=1e-9)
        assert normals[deepest] == pytest.approx(theirs[0], abs=1e-7)
        seen.append((gaps[deepest] > 0.0, separation(A, B) < gaps[deepest] - 1e-9))
    # Boxes that penetrate, boxes closest at a face or two edges, and boxes closest at a corner are all there.
    apart, at_corners = np.array(seen).T
    assert (~apart).sum() > 300 and (apart & ~at_corners).sum() > 100 and at_corners.sum() > 20


def test_faces_that_lie_on_each_other_touch_in_coals_polygon(rng):
    corners = []
    for _ in range(600):
        turn, sizes = Rotation.random(random_state=rng), rng.uniform(0.02, 0.3, (2, 3))
        place = [*rng.uniform(-0.15, 0.15, 2), 0.5 * sizes[:, 2].sum() + rng.uniform(-1e-3, 5e-4)]
        A = box(turn * Rotation.from_euler("z", rng.uniform(0.0, 2.0 * np.pi)), turn.apply(place), sizes[0])
        B = box(turn, np.zeros(3), sizes[1])
        theirs, (points, _, gaps) = by_coal(A, B, 2e-3), touch(A, B, 2e-3)
        assert (theirs is None) == (len(gaps) == 0)
        if theirs is None or np.abs(theirs[0] @ turn.as_matrix()[:, 2]) < 0.5:
            continue
        apart = np.linalg.norm(points[:, None] - theirs[2], axis=-1)
        assert apart.shape[0] == apart.shape[1]
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-9
        assert gaps == pytest.approx(np.full(len(gaps), theirs[1]), abs=1e-9)
        corners.append(len(gaps))
    assert len(corners) > 300 and set(corners) >= {3, 4, 5, 6, 7}


def test_a_square_on_a_square_turned_by_45_degrees_touches_in_an_octagon():
    A = box(Rotation.from_euler("z", 45, degrees=True), [0, 0, 0.1], [0.1, 0.1, 0.1])
    points, _, gaps = touch(A, box(Rotation.identity(), np.zeros(3), [0.1, 0.1, 0.1]))
    angle = np.arctan2(points[:, 1], points[:, 0])
    assert np.sort(angle) == pytest.approx(np.radians(np.arange(-157.5, 180, 45)), abs=1e-9)
    assert gaps == pytest.approx(np.zeros(8), abs=1e-15)


def test_tilted_faces_touch_where_they_are_at_most_a_millimetre_above_the_deepest_point():
    ground = box(Rotation.identity(), [0, 0, -0.5], [1, 1, 1])
    for tilt, count in ((0.0, 4), (0.009, 4), (0.011, 2), (-0.3, 2)):
        turn = Rotation.from_euler("y", tilt)
        block = box(turn, turn.apply([0, 0, 0.02]), [0.1, 0.06, 0.04])
        points, normals, gaps = touch(block, ground, 0.01)
        assert len(gaps) == count and normals == pytest.approx(np.tile([0, 0, 1.0], (count, 1)), abs=1e-12)
        lowest = turn.apply([0.05 * np.sign(tilt), 0, 0])
        assert gaps.min() == pytest.approx(lowest[2], abs=1e-12)
        assert points[:, 2] == pytest.approx(0.5 * gaps, abs=1e-12)


def test_crossed_edges_touch_in_one_point_and_the_order_of_the_boxes_does_not_matter(rng):
    upper = Rotation.from_euler("x", 45, degrees=True)
    lower = Rotation.from_euler("ZX", [90, 45], degrees=True)
    height = 0.1 * np.sqrt(2.0) - 1e-4
    A, B = box(upper, [0.03, 0, height], [0.3, 0.1, 0.1]), box(lower, [0, 0.02, 0], [0.3, 0.1, 0.1])
    points, normals, gaps = touch(A, B)
    assert points == pytest.approx(np.array([[0.0, 0.0, 0.5 * height]]), abs=1e-12)
    assert gaps == pytest.approx([-1e-4], abs=1e-12)
    assert normals == pytest.approx(np.array([[0.0, 0.0, 1.0]]), abs=1e-12)
    for _ in range(200):
        A, B = random_box(rng), random_box(rng, spread=0.1)
        one, other = touch(A, B, 0.02), touch(B, A, 0.02)
        assert len(one[2]) == len(other[2])
        if len(one[2]) == 1:
            assert one[0] == pytest.approx(other[0], abs=1e-9) and one[1] == pytest.approx(-other[1], abs=1e-9)
        assert one[2].min(initial=1.0) == pytest.approx(other[2].min(initial=1.0), abs=1e-9)


def test_a_sphere_touches_a_box_at_its_closest_point_inside_and_outside(rng):
    rows = np.zeros((MOST_POINTS, 7))
    for _ in range(200):
        B, radius = random_box(rng), rng.uniform(0.01, 0.05)
        turn = Rotation.from_matrix(B[:9].reshape(3, 3).T)
        local, away = B[12:].copy(), np.array([0.0, 0.0, 1.0])
        local[:2] *= rng.uniform(-0.5, 0.5, 2) * B[12:].min() / B[12:15][:2]
        depth = rng.uniform(-0.3 * B[12:].min(), 0.05)
        local[2] += depth
        expected = depth - radius
        count = sphere_box(np.array([*turn.apply(local), radius]), B, 0.02, rows)
        assert count == (expected <= 0.02)
        if count:
            assert rows[0, 6] == pytest.approx(expected, abs=1e-12)
            assert rows[0, 3:6] == pytest.approx(turn.apply(away), abs=1e-12)
            assert turn.inv().apply(rows[0, :3])[2] == pytest.approx(B[14] + 0.5 * expected, abs=1e-12)
    corner = box(Rotation.identity(), np.zeros(3), [0.2, 0.2, 0.2])
    assert sphere_box(np.array([0.13, 0.14, 0.1, 0.05]), corner, 1e-3, rows) == 1
    assert rows[0] == pytest.approx([0.1, 0.1, 0.1, 0.6, 0.8, 0.0, 0.0], abs=1e-12)


def test_spheres_touch_on_the_line_of_their_centres():
    rows = np.zeros((MOST_POINTS, 7))
    one, other = np.array([0.3, 0.4, 1.0, 0.2]), np.array([0.0, 0.0, 1.0, 0.29])
    assert sphere_sphere(one, other, 0.005, rows) == 0
    assert sphere_sphere(one, other, 0.02, rows) == 1
    assert rows[0] == pytest.approx([0.177, 0.236, 1.0, 0.6, 0.8, 0.0, 0.01], abs=1e-12)
    assert sphere_sphere(one, one, 0.0, rows) == 1
    assert rows[0] == pytest.approx([0.3, 0.4, 1.0, 0.0, 0.0, 1.0, -0.4], abs=1e-12)
