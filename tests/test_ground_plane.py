"""Contact detection (A Fig. 6), the plane A(24) and the signed angles A(25)-(26)."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.control.ground_plane import (
    MIN_SLENDERNESS,
    ground_plane,
    slenderness,
    slope_angles,
    supporting_feet,
    usable_triples,
)
from hexakin.transforms import axis_rotation


@pytest.fixture
def standing_feet(athena):
    return hk.forward_kinematics(athena, athena.standing_q)


def test_a_foot_supports_when_its_force_is_positive():
    assert supporting_feet([0.0, 1e-9, 5.0]).tolist() == [False, True, True]


def test_three_feet_of_one_side_are_rejected_and_every_other_triple_is_used(athena, standing_feet):
    triples = usable_triples(standing_feet, np.ones(6, dtype=bool))
    assert len(triples) == 18
    assert (0, 1, 5) not in triples and (2, 3, 4) not in triples
    assert slenderness(standing_feet[[0, 1, 5]]) < MIN_SLENDERNESS
    assert MIN_SLENDERNESS < min(slenderness(standing_feet[list(t)]) for t in triples)


@pytest.mark.parametrize("pitch, roll", [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.2), (0.0, -0.2), (0.15, -0.1)])
def test_the_plane_of_tilted_ground_has_the_right_signed_angles(athena, standing_feet, rng, pitch, roll):
    """Feet on ground that rises ahead by ``pitch`` and falls to the right by ``roll``."""
    normal = np.array([np.tan(roll), -np.tan(pitch), 1.0])
    feet = standing_feet.copy()
    feet[:, 2] = -0.1 - feet[:, :2] @ normal[:2]
    plane = ground_plane(feet, np.ones(6, dtype=bool), rng)
    assert slope_angles(athena, plane.normal) == pytest.approx((pitch, roll), abs=1e-12)
    assert plane.misfit < 1e-12
    assert plane.normal[2] > 0


def test_turning_the_feet_with_the_torso_shows_the_torsos_own_tilt(athena, standing_feet, rng):
    """A torso pitched nose-up by 0.1 over level ground sees ground that falls ahead."""
    R_world_body = axis_rotation(athena.right, 0.1)
    plane = ground_plane(standing_feet @ R_world_body, np.ones(6, dtype=bool), rng)
    delta_alpha, delta_beta = slope_angles(athena, plane.normal)
    assert (delta_alpha, delta_beta) == pytest.approx((-0.1, 0.0), abs=1e-12)


def test_exactly_three_feet_are_used_and_have_no_misfit(standing_feet, rng):
    support = np.array([True, False, True, False, True, False])
    plane = ground_plane(standing_feet, support, rng)
    assert plane.legs == (0, 2, 4)
    assert np.isnan(plane.misfit)


def test_more_than_three_feet_give_a_random_triple_that_the_seed_decides(standing_feet):
    support = np.ones(6, dtype=bool)

    def triples(seed):
        generator = np.random.default_rng(seed)
        return [ground_plane(standing_feet, support, generator).legs for _ in range(30)]

    assert triples(1) == triples(1) != triples(2)
    assert len(set(triples(1))) > 5


def test_fewer_than_three_feet_or_a_line_of_feet_give_no_plane(standing_feet, rng):
    assert ground_plane(standing_feet, np.array([1, 1, 0, 0, 0, 0], dtype=bool), rng) is None
    assert ground_plane(standing_feet, np.array([1, 1, 0, 0, 0, 1], dtype=bool), rng) is None


def test_the_misfit_is_the_distance_of_a_foot_that_hangs(standing_feet):
    feet = standing_feet.copy()
    feet[3, 2] += 0.01
    support = np.array([1, 0, 1, 1, 1, 0], dtype=bool)
    misfits = [ground_plane(feet, support, np.random.default_rng(seed)).misfit for seed in range(20)]
    assert min(misfits) > 0.002
