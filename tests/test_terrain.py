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
