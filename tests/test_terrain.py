import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError

TERRAINS = [hk.terrain.Plane(), hk.terrain.Plane(z=0.1), hk.terrain.Ramp(), hk.terrain.Ramp(start=0.3, heading=0.4)]


@pytest.mark.parametrize("terrain", TERRAINS, ids=repr)
def test_normal_is_the_gradient_of_height(terrain, rng):
    x, y, h = *rng.uniform(-1, 1, (2, 200)), 1e-7
    gradient = [
        (terrain.height(x + h, y) - terrain.height(x - h, y)) / (2 * h),
        (terrain.height(x, y + h) - terrain.height(x, y - h)) / (2 * h),
    ]
    normal = np.stack([-gradient[0], -gradient[1], np.ones_like(x)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    assert terrain.normal(x, y) == pytest.approx(normal, abs=1e-7)


@pytest.mark.parametrize("terrain", TERRAINS, ids=repr)
def test_a_ray_ends_on_the_ground(terrain, rng):
    origin = np.column_stack([rng.uniform(-1, 1, (200, 2)), np.full(200, 1.0)])
    direction = np.column_stack([rng.uniform(-0.3, 0.3, (200, 2)), np.full(200, -1.0)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = terrain.distance_along(origin, direction)
    end = origin + distance[:, None] * direction
    assert terrain.height(end[:, 0], end[:, 1]) == pytest.approx(end[:, 2], abs=1e-12)


def test_a_ray_away_from_the_ground_never_ends():
    assert hk.terrain.Ramp().distance_along([0, 0, 1], [0, 0, 1]) == np.inf


def test_the_ramp_rises_by_ten_degrees_along_y_and_a_start_leaves_level_ground_before_it():
    ramp, stepped = hk.terrain.Ramp(), hk.terrain.Ramp(start=0.5)
    assert ramp.height(3.0, 2.0) == pytest.approx(2.0 * np.tan(np.radians(10)))
    assert stepped.height(0.0, 0.5) == pytest.approx(0.0)
    assert stepped.height(0.0, 0.2) == 0.0
    assert stepped.height(0.0, 1.5) == pytest.approx(np.tan(np.radians(10)))


@pytest.mark.parametrize(
    "arguments", [{"slope": np.nan}, {"slope": 1.5}, {"start": np.inf}, {"slope": -0.1, "start": 0.1}]
)
def test_impossible_ramps_are_refused(arguments):
    with pytest.raises(InvalidInputError, match="Ramp: "):
        hk.terrain.Ramp(**arguments)


@pytest.fixture(scope="module")
def hills():
    x, y = np.linspace(-1, 1, 41), np.linspace(-0.8, 1.2, 61)
    X, Y = np.meshgrid(x, y, indexing="ij")
    return hk.terrain.HeightField(x, y, 0.1 * np.sin(3 * X) * np.cos(2 * Y))


def test_a_height_field_passes_through_its_points_and_is_flat_between(hills, rng):
    assert hills.height(hills.x[:, None], hills.y[None, :]) == pytest.approx(hills.z, abs=1e-15)
    vertices, triangles = hills.shapes()[0]
    corners = vertices[triangles[rng.integers(len(triangles), size=300)]]
    weights = rng.dirichlet(np.ones(3), size=300)
    points = np.einsum("nk,nki->ni", weights, corners)
    assert hills.height(points[:, 0], points[:, 1]) == pytest.approx(points[:, 2], abs=1e-12)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert (normal[:, 2] > 0).all()
    assert hills.normal(points[:, 0], points[:, 1]) == pytest.approx(normal, abs=1e-9)


def test_a_ray_onto_a_height_field_ends_on_it(hills, rng):
    origin = np.column_stack([rng.uniform(-0.5, 0.5, (50, 2)), np.full(50, 0.5)])
    direction = np.column_stack([rng.uniform(-0.3, 0.3, (50, 2)), np.full(50, -1.0)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    end = origin + hills.distance_along(origin, direction)[:, None] * direction
    assert hills.height(end[:, 0], end[:, 1]) == pytest.approx(end[:, 2], abs=1e-9)
    assert hills.distance_along([0, 0, 1], [0, 0, 1]) == np.inf
    assert hills.distance_along([0, 0, -1], [0, 0, -1]) < 0


def test_a_point_outside_a_height_field_is_named(hills):
    with pytest.raises(
        InvalidInputError, match=r"\(1\.1, 0\) m lies outside the HeightField\(41 x 61 points, x -1 to 1 m"
    ):
        hills.height(1.1, 0.0)


@pytest.mark.parametrize(
    "x, z, message",
    [
        ([0, 1, 3], np.zeros((3, 2)), "x must be at least two evenly spaced .* value 2 is 1, expected 1.5"),
        ([0], np.zeros((1, 2)), "x: expected at least two evenly spaced values"),
        (0.0, np.zeros((1, 2)), "x: expected at least two evenly spaced values"),
        ([1, 1], np.zeros((2, 2)), "x must be at least two evenly spaced"),
        ([0, 1, 0], np.zeros((3, 2)), "x must be at least two evenly spaced"),
        (np.float32([5e5, 5e5 + 0.02, 5e5 + 0.1]), np.zeros((3, 2)), "x must be at least two evenly spaced"),
        ([0, 1], np.full((2, 2), np.nan), "z: index .* is nan"),
        ([0, 1], np.zeros((3, 2)), "z: expected shape"),
    ],
)
def test_bad_height_fields_are_refused(x, z, message):
    with pytest.raises(InvalidInputError, match=message):
        hk.terrain.HeightField(x, [0, 1], z)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_an_axis_of_any_precision_may_ascend_or_descend(hills, kind):
    """The grid's spacing is that of its ends, so that single precision moves no point by more than its rounding."""
    x, y = np.linspace(-1, 1, 41).astype(kind), np.linspace(-2, 1, 61).astype(kind)
    X, Y = np.meshgrid(np.linspace(-0.99, 0.99, 12), np.linspace(-1.9, 0.9, 12))
    expected = hk.terrain.HeightField(hills.x, np.linspace(-2, 1, 61), hills.z).height(X, Y)
    for across, along in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        field = hk.terrain.HeightField(x[::across], y[::along], hills.z[::across, ::along])
        assert field.x[0] < field.x[-1] and field.y[0] < field.y[-1]
        np.testing.assert_allclose(field.height(X, Y), expected, atol=1e-12)


def test_athena_stands_on_a_height_field_as_on_the_plane_it_is(athena):
    x = np.linspace(-1, 1, 21)
    flat = hk.terrain.HeightField(x, x, np.zeros((21, 21)))
    recording = hk.simulate(
        athena, flat, hk.PostureController(athena, stride=0.0, apex=0.0), duration=1.0, time_step=0.005
    )
    assert recording.height == pytest.approx(np.full(20, 0.104), abs=2e-3)
