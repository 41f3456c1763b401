"""Support polygon, ZMP A(32) and margin A(33) against hand-made cases."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.stability.polygon import centroid, centroid_distance_and_margin, margin, support_polygon
from hexakin.stability.time_series import series, zero_moment_point

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])


def test_the_polygon_is_the_hull_counter_clockwise():
    polygon = support_polygon(np.vstack([SQUARE[::-1], [[1.0, 0.5]]]))
    assert len(polygon) == 4
    following = np.roll(polygon, -1, axis=0)
    assert (polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]).sum() == pytest.approx(2 * 2.0)


def test_heights_of_the_feet_do_not_matter():
    feet = np.column_stack([SQUARE, [0.0, 0.1, -0.3, 0.2]])
    assert np.array_equal(support_polygon(feet), support_polygon(SQUARE))


@pytest.mark.parametrize("feet", [np.zeros((0, 2)), SQUARE[:2], [[0, 0], [1, 1], [2, 2]], np.zeros((4, 3))])
def test_fewer_than_three_feet_or_feet_in_line_have_no_polygon_and_no_margin(feet):
    assert support_polygon(feet) is None
    assert np.isnan(margin([0.0, 0.0], support_polygon(feet)))


def test_margin_is_signed_and_measured_to_the_nearest_edge():
    assert margin([0.5, 0.4], SQUARE) == pytest.approx(0.4)
    assert margin([1.9, 0.5], SQUARE) == pytest.approx(0.1)
    assert margin([0.0, 0.5], SQUARE) == 0.0
    assert margin([-0.3, 0.5], SQUARE) == pytest.approx(-0.3)
    assert margin([2.3, 1.4], SQUARE) == pytest.approx(-0.5), "beyond a corner the corner is nearest"


def test_centroid_of_area_not_of_corners():
    polygon = support_polygon([[0, 0], [1, 0], [2, 0.0], [0, 1.0], [2, 1.0]])
    assert centroid(polygon) == pytest.approx([1.0, 0.5])
    assert centroid(support_polygon([[0, 0], [3, 0], [0, 3]])) == pytest.approx([1.0, 1.0])


def test_zmp_is_the_force_weighted_mean_of_the_feet():
    result = zero_moment_point(SQUARE, [1.0, 3.0, 0.0, 0.0])
    assert result.xy == pytest.approx([1.5, 0.0])
    assert result.defined
    both = zero_moment_point(np.stack([SQUARE, SQUARE]), [[1.0, 1, 1, 1], [0, 0, 0, 0]])
    assert both.xy[0] == pytest.approx([1.0, 0.5])
    assert both.defined.tolist() == [True, False]
    assert np.isnan(both.xy[1]).all()


def test_negative_and_nan_forces_are_named():
    with pytest.raises(InvalidInputError, match="foot_force: -1 N"):
        zero_moment_point(SQUARE, [1, -1, 0, 0])
    with pytest.raises(InvalidInputError, match="foot_force: leg 2 is nan"):
        zero_moment_point(SQUARE, [1, np.nan, 0, 0])


def test_the_zmp_of_a32_cannot_leave_the_hull_of_loaded_feet(rng):
    """Whatever the feet and forces: the paper's finding that it lies within is no finding."""
    for _ in range(500):
        feet, force = rng.normal(size=(6, 2)), rng.exponential(size=6) * (rng.random(6) < 0.7)
        polygon = support_polygon(feet[force > 0])
        if polygon is not None:
            assert margin(zero_moment_point(feet, force).xy, polygon) > -1e-12


def test_series_says_where_it_is_undefined(short_walk):
    import dataclasses

    force = short_walk.foot_force.copy()
    force[10:20] = 0.0
    force[20:30] = [1, 1, 0, 0, 0, 0]
    result = series(dataclasses.replace(short_walk, foot_force=force))
    assert not result.defined[10:30].any()
    assert np.isnan(result.margin[10:30]).all() and np.isnan(result.centroid_distance[10:30]).all()
    assert result.defined[:10].all()
    assert (result.margin[result.defined] > -1e-12).all()


def test_the_polygon_of_commanded_stance_feet_can_lose_the_zmp(short_walk):
    import dataclasses

    force = np.tile([1.0, 0, 0, 0, 0, 0], (120, 1))
    result = series(dataclasses.replace(short_walk, foot_force=force), feet="stance")
    stance_without_leg_1 = ~np.vstack([short_walk.stance[:1], short_walk.stance[:-1]])[:, 0]
    assert (result.margin[stance_without_leg_1] < 0.0).all()
    with pytest.raises(UnknownNameError, match="feet"):
        series(short_walk, feet="all")


def test_public_names(short_walk):
    assert hk.stability.zmp(short_walk).xy.shape == (120, 2)


def test_feet_almost_in_line_have_no_polygon_and_bad_points_are_named():
    assert support_polygon([[0, 0], [1, 1e-14], [2, 0]]) is None
    for point in ([np.nan, 0.0], [1.0], [[0.0, 0.0], [1.0, 1.0]]):
        with pytest.raises(InvalidInputError, match="point"):
            margin(point, SQUARE)
    with pytest.raises(InvalidInputError, match="p_foot: leg 1, coordinate 1 is nan"):
        zero_moment_point(np.full((4, 2), np.nan), np.ones(4))


def test_one_set_of_forces_serves_many_feet():
    result = zero_moment_point(np.stack([SQUARE] * 5), [1, 1, 1, 1])
    assert result.xy.shape == (5, 2) and result.defined.shape == (5,)


def test_many_hulls_at_once_are_those_built_one_by_one(rng):
    feet, carrying = rng.normal(size=(400, 6, 2)), rng.random((400, 6)) < 0.7
    feet[:40, 2] = 0.5 * (feet[:40, 0] + feet[:40, 1])  # on the line between two others
    feet[40:60] = feet[40:60, :1] + np.arange(6)[None, :, None] * [1.0, 2.0]  # all on one line
    point = rng.normal(size=(400, 2))
    distance, edge = centroid_distance_and_margin(point, feet, carrying)
    for k in range(400):
        polygon = support_polygon(feet[k, carrying[k]])
        assert edge[k] == pytest.approx(margin(point[k], polygon), abs=1e-12, nan_ok=True)
        if polygon is not None:
            assert distance[k] == pytest.approx(np.linalg.norm(point[k] - centroid(polygon)), abs=1e-9)
        else:
            assert np.isnan(distance[k])
