import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
    (mesh,) = hills.shapes()
    vertices, triangles = mesh.vertices, mesh.triangles
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


def first_triangle(mesh, origin, direction):
    """Distances along rays to the first triangle of a mesh, by Möller and Trumbore (1997)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    found = []
    for o, d in zip(origin, direction, strict=True):
        side = np.cross(d, c - a)
        determinant = np.einsum("ti,ti->t", b - a, side)
        ok = np.abs(determinant) > 1e-14
        scale = np.where(ok, determinant, 1.0)
        u = np.einsum("ti,ti->t", o - a, side) / scale
        other = np.cross(o - a, b - a)
        v = other @ d / scale
        t = np.einsum("ti,ti->t", c - a, other) / scale
        hit = ok & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (t >= 0.0)
        found.append(t[hit].min(initial=np.inf))
    return np.array(found)


@given(seed=st.integers(0, 2**32 - 1), nx=st.integers(2, 12), ny=st.integers(2, 12), rough=st.floats(0.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_a_ray_ends_at_the_first_triangle_that_it_meets(seed, nx, ny, rough):
    rng = np.random.default_rng(seed)
    x, y = np.linspace(-1.0, 1.0, nx) + rng.uniform(-9, 9), np.linspace(0.0, 1.5, ny)
    field = hk.terrain.HeightField(x, y, rng.uniform(0.0, rough, (nx, ny)))
    origin = np.column_stack([rng.uniform(x[0], x[-1], 40), rng.uniform(0.0, 1.5, 40), rng.uniform(-0.1, 1.2, 40)])
    direction = rng.normal(size=(40, 3))
    direction[:8] = np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.8, 0.0], [0.0, -0.6, -0.8]]])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    gap = origin[:, 2] - field.height(origin[:, 0], origin[:, 1])
    above = gap > 1e-6  # closer to the ground it depends on rounding which of its triangles is the first
    distance = field.distance_along(origin, direction)
    expected = first_triangle(field.shapes()[0], origin[above], direction[above])
    grazes = np.isfinite(expected) != np.isfinite(distance[above])  # an edge of the grid, or of a triangle
    assert distance[above][~grazes] == pytest.approx(expected[~grazes], abs=1e-7)
    assert grazes.sum() <= 1
    assert np.array_equal(distance[gap <= 0.0], gap[gap <= 0.0])


def test_the_work_for_a_ray_does_not_grow_with_its_length(hills, monkeypatch):
    looked_up = []
    height = hk.terrain.HeightField._height
    monkeypatch.setattr(
        hk.terrain.HeightField, "_height", lambda self, x, y: looked_up.append(x.size) or height(self, x, y)
    )
    for distance in (1e1, 1e6, 1e9):
        tilt = 0.5 / distance
        direction = np.array([tilt, 0.0, -np.sqrt(1.0 - tilt * tilt)])
        end = hills.distance_along([0.0, 0.0, distance], direction)
        assert end == pytest.approx(distance, rel=0.02)
    assert max(looked_up) <= 2 * (len(hills.x) + len(hills.y)) + 2


EVERY = [*TERRAINS, hk.terrain.Blocks(), hk.terrain.HeightField([-1, 1], [-1, 1], np.zeros((2, 2)))]


@pytest.mark.parametrize("terrain", EVERY, ids=lambda terrain: type(terrain).__name__)
@pytest.mark.parametrize(
    "origin, direction, message",
    [
        ([0, 0, np.nan], [0, 0, -1], "origin: .* is nan"),
        ([0, 0, 1e10], [0, 0, -1], r"origin: 1e\+10 m, expected within 1e\+09 m"),
        ([0, 0], [0, 0, -1], "origin: expected shape"),
        ("up", [0, 0, -1], "origin: expected numbers"),
        ([0, 0, 1], [0, 0, 0], "direction: expected unit vectors, got one of length 0"),
        ([0, 0, 1], [0, 0, -2], "direction: expected unit vectors, got one of length 2"),
        ([0, 0, 1], [0, 0, -1e300], "direction: expected unit vectors"),
        ([0, 0, 1], [0, np.inf, -1], "direction: .* is inf"),
        (np.zeros((2, 3)), np.tile([0, 0, -1], (3, 1)), "origin, direction: shapes .* do not broadcast"),
    ],
)
def test_what_is_no_ray_is_named_by_every_terrain(terrain, origin, direction, message):
    with pytest.raises(InvalidInputError, match=message):
        terrain.distance_along(origin, direction)


@pytest.mark.parametrize("terrain", EVERY, ids=lambda terrain: type(terrain).__name__)
@pytest.mark.parametrize(
    "x, y, message",
    [
        (np.nan, 0.0, "x: .* nan"),
        (0.0, -1e300, r"y: -1e\+300 m, expected within 1e\+09 m"),
        (np.zeros(2), np.zeros(3), "x, y: shapes .* do not broadcast"),
        (None, 0.0, "x: "),
    ],
)
def test_what_is_no_point_is_named_by_every_terrain(terrain, x, y, message):
    for function in (terrain.height, terrain.normal):
        with pytest.raises(InvalidInputError, match=message):
            function(x, y)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda t: t.HeightField([0, 1], [0, 1], np.zeros((5, 2, 2))), r"z: expected shape \(2, 2\), got \(5, 2, 2\)"),
        (lambda t: t.HeightField([0, 1], [0, 1], np.full((2, 2), 1e300)), r"z: 1e\+300 m, expected within"),
        (lambda t: t.HeightField([0, 1e300], [0, 1], np.zeros((2, 2))), r"x: 1e\+300 m, expected within"),
        (
            lambda t: t.HeightField(np.arange(3000), np.arange(3000), np.broadcast_to(0.0, (3000, 3000))),
            "3000 x 3000 points, expected at most 5000000",
        ),
        (lambda t: t.Blocks(extent=(-3e4, 3e4, -3e4, 3e4)), "about 9e.10 blocks"),
        (lambda t: t.Blocks(extent=(0, 1e300, 0, 1)), r"extent: 1e\+300 m, expected within"),
        (lambda t: t.Blocks(size=1e-300), "blocks of the extent"),
        (lambda t: t.Plane(z=1e300), "Plane: z: "),
        (lambda t: t.Box((0, 0, 0), (1, 1, -1)), r"Box: upper: \(1.0, 1.0, -1.0\), expected above lower"),
        (lambda t: t.Box((0, 0, 0), (1, 1, 0)), "Box: upper: "),
        (lambda t: t.Box((0, 0, np.nan), (1, 1, 1)), "Box: lower: .* nan"),
        (lambda t: t.Box((0, 0), (1, 1)), "lower: expected 3 values"),
        (lambda t: t.HalfSpace((0, 0, 0), (0, 0, 0)), "HalfSpace: normal: expected unit vectors, got one of length 0"),
        (lambda t: t.HalfSpace((0, 0, 0), (0, 0, 2)), "HalfSpace: normal: expected unit vectors"),
        (lambda t: t.HalfSpace(np.zeros((2, 3)), (0, 0, 1)), "point: expected 3 values"),
        (lambda t: t.TriangleMesh(np.zeros((3, 3)), [[0, 1, 3]]), "triangles: 3, expected indices of 3 vertices"),
        (lambda t: t.TriangleMesh(np.zeros((3, 3)), [[0, 1, -1]]), "triangles: -1, expected indices"),
        (lambda t: t.TriangleMesh(np.zeros((3, 3)), [[0.0, 1.0, 2.0]]), "of whole numbers, got .* float64"),
        (lambda t: t.TriangleMesh(np.zeros((3, 2)), [[0, 1, 2]]), "vertices: expected shape"),
        (lambda t: t.TriangleMesh(np.zeros((3, 3)), [0, 1, 2]), r"triangles \(t, 3\) .*got .* and \(3,\)"),
    ],
)
def test_impossible_terrains_and_shapes_are_refused(make, message):
    with pytest.raises(InvalidInputError, match=message):
        make(hk.terrain)


def test_shapes_are_values_that_cannot_change():
    box = hk.terrain.Box(np.zeros(3), np.ones(3))
    assert box == hk.terrain.Box((0, 0, 0), (1, 1, 1)) and box.lower == (0.0, 0.0, 0.0)
    mesh = hk.terrain.TriangleMesh(np.eye(3), np.array([[0, 1, 2]]))
    assert not mesh.vertices.flags.writeable and not mesh.triangles.flags.writeable


@pytest.mark.parametrize(
    "references, message",
    [
        ({"reference_y": lambda: 0.0}, "LegCurves: reference_y: expected a function of s, got"),
        ({"reference_z": lambda s: s}, "LegCurves: reference_z: expected a function of s, y, got"),
        ({"reference_y": 1.0}, "reference_y: expected a function, got 1.0"),
        ({"reference_y": lambda s: np.zeros(7)}, "reference_y must return numbers of its argument's shape"),
        ({"reference_y": lambda s: [[1], [1, 2]]}, "reference_y must return numbers of its argument's shape"),
        ({"reference_y": lambda s: "0.1"}, "reference_y must return numbers of its argument's shape"),
        ({"reference_y": lambda s: s + 1j}, "reference_y must return numbers of its argument's shape"),
        ({"reference_y": lambda s: None}, "reference_y must return numbers of its argument's shape"),
        ({"reference_z": lambda s, y: s * np.nan}, "reference_z is not finite everywhere"),
        ({"num_legs": 10**9}, "num_legs: 1000000000, expected at most 100"),
    ],
)
def test_curves_that_are_none_are_named(references, message):
    with pytest.raises(InvalidInputError, match=message):
        hk.terrain.LegCurves(**references).displacement(np.zeros((3, 6)))


def test_the_text_of_curves_that_end_does_not_fail():
    curves = hk.terrain.LegCurves(lambda s: np.where(s < 0.5, 0.0, np.nan))
    assert "not finite everywhere" in repr(curves)
    assert hk.terrain.LegCurves(np.sin).displacement(np.zeros((1, 6))).shape == (1, 6, 3)


@pytest.mark.parametrize("terrain", [hk.terrain.Plane(), hk.terrain.Ramp(), hk.terrain.Blocks()], ids=repr)
def test_one_ray_in_arrays_is_checked_like_many(terrain):
    origin, down = np.array([0.01, 0.02, 1.0]), np.array([0.0, 0.0, -1.0])
    assert terrain.distance_along(origin, down) == terrain.distance_along([[0.01, 0.02, 1.0]], [[0.0, 0.0, -1.0]])[0]
    for index in range(3):
        for bad, message in ((np.nan, "origin: .* expected a finite number"), (-2e9, "origin: -2e.09 m")):
            wrong = origin.copy()
            wrong[index] = bad
            with pytest.raises(InvalidInputError, match=message):
                terrain.distance_along(wrong, down)
    for wrong in (1.1 * down, np.array([0.0, np.nan, -1.0]), np.full(3, 1e300)):
        with pytest.raises(InvalidInputError, match="direction"):
            terrain.distance_along(origin, wrong)


def test_a_returned_normal_may_be_written():
    for ramp in (hk.terrain.Ramp(), hk.terrain.Ramp(start=1.0)):
        normal = ramp.normal(0.0, 2.0)
        before = normal.copy()
        normal *= 2.0
        assert np.array_equal(ramp.normal(0.0, 2.0), before)
