import numpy as np
import pytest

import hexakin as hk
from hexakin.walking.swing import bezier, stance_line, swing_control_points


def test_every_leg_swings_once_a_cycle_and_neighbours_alternate(athena):
    gait = hk.gait.tripod(athena)
    swings = np.array([gait.swinging(phase) for phase in range(4)])
    assert (swings[:2].sum(axis=0) == 1).all()
    assert np.array_equal(swings[:2], swings[2:])
    assert np.flatnonzero(swings[0]).tolist() == [0, 2, 4], "legs 1, 3, 5"


def test_a_swing_starts_ends_and_peaks_where_it_should(rng):
    start = rng.normal(size=(6, 3))
    control = swing_control_points(start, [0, 0.05, 0], [0, 1, 0], stride=0.05, apex=0.03)
    path = bezier(control, np.linspace(0, 1, 101)[:, None])
    assert path.shape == (101, 6, 3)
    assert path[0] == pytest.approx(start)
    assert path[-1] == pytest.approx(start + [0, 0.05, 0])
    assert (path[..., 2] - start[:, 2]).max(axis=0) == pytest.approx(0.03)
    assert (np.diff(path[..., 1], axis=0) > 0).all()


def test_printed_control_heights_of_a_third_give_an_apex_of_a_quarter():
    h = 0.12
    control = np.array([[0, 0, 0], [0, 0.0125, h / 3], [0, 0.0375, h / 3], [0, 0.05, 0]])
    assert bezier(control, np.linspace(0, 1, 1001))[:, 2].max() == pytest.approx(h / 4)


def test_the_formula_as_printed_does_not_start_at_its_first_point():
    """A(19) without binomial coefficients, with t_g = 1: at mid-swing its weights sum to a half instead of 1."""
    t = 0.5
    assert sum((1 - t) ** (3 - j) * t**j for j in range(4)) == pytest.approx(0.5)


def test_stance_is_a_straight_line(rng):
    start = rng.normal(size=(6, 3))
    path = stance_line(start, np.array([0, -0.05, 0.01]), np.array([[0.0], [0.5], [1.0]]))
    assert path[1] == pytest.approx((path[0] + path[2]) / 2)
    assert path[2] - path[0] == pytest.approx(np.broadcast_to([0, -0.05, 0.01], (6, 3)))
