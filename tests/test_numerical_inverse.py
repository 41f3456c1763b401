"""The numerical inverse: against the closed form of a leg that has one, and on a skewed leg that has none."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnreachableError
from hexakin.kinematics import numerical, path_inverse_kinematics, posed_inverse_kinematics, standing_branch
from hexakin.kinematics.leg_functions import closed_form, reach


@pytest.fixture
def skewed(edited):
    """ATHENA with axes that are neither parallel nor at right angles, and an offset between them."""

    def change(tree):
        rows = tree["leg_table"]["rows"]
        rows[1]["alpha"], rows[2]["alpha"], rows[2]["d"] = "tilt_1", "tilt_2", "offset"
        tree["leg_table"]["parameters"].update(tilt_1_deg=80, tilt_2_deg=15, offset_mm=12)

    return edited("athena", change)


@pytest.fixture
def random_q(athena, rng):
    return rng.uniform(athena.q_min, athena.q_max, (100, 6, 3))


def turned(a, b):
    """Largest difference of two triples of angles."""
    return np.abs(hk.transforms.wrapped(a - b)).max(axis=-1)


@pytest.mark.parametrize("name", ["athena", "hwr", "phantomx"])
def test_it_finds_the_same_solutions_as_the_closed_form(name, rng):
    robot = hk.load_robot(name)
    q = rng.uniform(robot.q_min, robot.q_max, (100, 6, 3))
    foot = hk.forward_kinematics(robot, q)
    known = hk.inverse_kinematics(robot, foot, branch="all")
    found = numerical.solve_numerically(robot, foot).q
    gap = turned(known.q[..., :, None, :], found[..., None, :, :])
    assert (np.nanmin(np.nan_to_num(gap, nan=9.0), axis=-1)[known.reachable] < 1e-6).all()
    assert np.array_equal(np.isfinite(found).all(axis=-1).sum(axis=-1), known.reachable.sum(axis=-1))


def test_every_solution_of_a_skewed_leg_brings_the_foot_to_its_target(skewed, random_q):
    assert not closed_form(skewed.table)
    foot = hk.forward_kinematics(skewed, random_q)
    every = hk.inverse_kinematics(skewed, foot, branch="all")
    assert every.numerical and every.reachable.any(axis=-1).all()
    for branch in range(4):
        there = every.reachable[..., branch]
        back = hk.forward_kinematics(skewed, np.where(there[..., None], every.q[..., branch, :], 0.0))
        assert np.abs(back - foot)[there].max() < 1e-10
    assert np.isnan(every.q[~every.reachable]).all() and every.reachable[..., 1].all()


def test_the_solution_nearest_to_the_angles_returns_the_angles(skewed, random_q):
    solution = hk.inverse_kinematics(skewed, hk.forward_kinematics(skewed, random_q), near=random_q)
    assert turned(solution.q, random_q).max() < 1e-9 and solution.within_limits.all()


def test_branches_are_ordered_by_their_distance_from_the_standing_pose(skewed, random_q):
    foot = hk.forward_kinematics(skewed, random_q)
    every = hk.inverse_kinematics(skewed, foot, branch="all")
    gap = np.nan_to_num(turned(every.q, skewed.standing_q[:, None]), nan=9.0)
    assert (np.diff(gap, axis=-1) >= -1e-9).all()
    assert np.array_equal(hk.inverse_kinematics(skewed, foot).q, every.q[..., 0, :])
    assert (standing_branch(skewed) == 0).all()
    standing = hk.forward_kinematics(skewed, skewed.standing_q)
    assert hk.inverse_kinematics(skewed, standing).q == pytest.approx(skewed.standing_q, abs=1e-9)


def test_feet_out_of_reach_are_marked_or_named(skewed):
    foot = hk.forward_kinematics(skewed, np.stack([skewed.standing_q] * 3))
    foot[1, 4] *= 2.0
    solution = hk.inverse_kinematics(skewed, foot)
    assert np.argwhere(~solution.reachable).tolist() == [[1, 4]] and np.isnan(solution.q[1, 4]).all()
    with pytest.raises(UnreachableError, match=r"leg 5: .* exceeds its reach 0\.164\d+ m \(at index 1\)"):
        hk.inverse_kinematics(skewed, foot, on_unreachable="raise")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("count", [1, 2, 300])
def test_a_coordinate_that_is_not_finite_is_named(skewed, bad, count):
    foot = hk.forward_kinematics(skewed, np.stack([skewed.standing_q] * count))
    foot[-1, 2, 1] = bad
    for options in ({}, {"branch": "all"}, {"near": skewed.standing_q}):
        with pytest.raises(InvalidInputError, match=rf"leg 3, coordinate 2 is {bad}.*\(at index {count - 1}\)"):
            hk.inverse_kinematics(skewed, foot, **options)


def test_a_stretched_leg_is_solved(skewed):
    q = skewed.standing_q.copy()
    _, outer = reach(skewed)[0]
    sweep = np.linspace(-np.pi, np.pi, 721)
    distances = [np.linalg.norm(_from_second_joint(skewed, angle)) for angle in sweep]
    q[:, 2] = sweep[np.argmax(distances)]
    assert outer == pytest.approx(max(distances), rel=1e-5)
    assert hk.inverse_kinematics(skewed, hk.forward_kinematics(skewed, q)).reachable.all()


def _from_second_joint(robot, third):
    fixed = robot.fixed_poses(0)
    turn = np.eye(4)
    turn[:3, :3] = hk.transforms.axis_rotation([0, 0, 1], third)
    return (fixed[2] @ turn @ fixed[3])[:3, 3]


def test_a_path_is_followed_without_a_jump(skewed):
    middle = hk.forward_kinematics(skewed, skewed.standing_q)
    circle = np.linspace(0.0, 2.0 * np.pi, 60)
    path = middle + 0.02 * np.stack([np.cos(circle), np.sin(circle), 0.5 * np.sin(circle)], axis=-1)[:, None]
    for near in (None, skewed.standing_q):
        solution = path_inverse_kinematics(skewed, path, near)
        assert solution.reachable.all() and np.abs(np.diff(solution.q, axis=0)).max() < 0.1
        assert np.abs(hk.forward_kinematics(skewed, solution.q) - path).max() < 1e-10


def test_shapes_are_those_of_the_closed_form(athena, skewed):
    foot = np.zeros((2, 3, 6, 3))
    for name in ("q", "reachable", "within_limits", "branch", "distance", "reach"):
        for branch in ("all", "standing"):
            shapes = {getattr(hk.inverse_kinematics(r, foot, branch=branch), name).shape for r in (athena, skewed)}
            assert len(shapes) == 1
    assert posed_inverse_kinematics(skewed, np.eye(4), np.zeros((0, 6, 3))).q.shape == (0, 6, 3)


def test_a_robot_without_a_closed_form_walks(skewed):
    walk = hk.simulate(
        skewed, hk.terrain.Plane(), hk.PostureController(skewed), engine="rigid", max_cycles=1, time_step=0.002
    )
    assert not (walk.torso_force > 0.0).any()
    assert (walk.T_world_body[-1, :3, 3] - walk.T_world_body[0, :3, 3]) @ skewed.forward > 0.06
