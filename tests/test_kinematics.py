"""Numeric kinematics: round trips, branches, limits, Jacobians, reach, bad input."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnknownNameError, UnreachableError
from hexakin.kinematics import path_inverse_kinematics, standing_branch, standing_height, within_limits


@pytest.fixture(scope="module")
def random_q(athena):
    return np.random.default_rng(1).uniform(athena.q_min, athena.q_max, (10_000, 6, 3))


def test_inverse_returns_the_foot_on_every_branch(athena, random_q):
    foot = hk.forward_kinematics(athena, random_q)
    solution = hk.inverse_kinematics(athena, foot, branch="all")
    for branch in range(4):
        reached = solution.reachable[:, :, branch]
        back = hk.forward_kinematics(athena, np.where(reached[..., None], solution.q[:, :, branch], 0.0))
        assert reached.sum() > 1000
        assert np.abs(back - foot)[reached].max() < 1e-12
    assert solution.within_limits[:, :, 1].sum() > 10_000
    assert (solution.within_limits.sum(axis=(0, 1)) > 50).all(), "every branch occurs inside the limits"


def test_the_branch_nearest_to_the_angles_returns_the_angles(athena, random_q):
    solution = hk.inverse_kinematics(athena, hk.forward_kinematics(athena, random_q), near=random_q)
    # A nearly straight leg amplifies rounding in its angles, though not in its foot.
    assert np.abs(solution.q - random_q).max() < 1e-9
    assert solution.within_limits.all()


def test_without_a_hint_the_standing_poses_branch_is_chosen(athena):
    solution = hk.inverse_kinematics(athena, hk.forward_kinematics(athena, athena.standing_q))
    assert np.abs(solution.q - athena.standing_q).max() < 1e-12
    assert (solution.branch == standing_branch(athena)).all()


def test_jacobian_equals_finite_differences(athena, random_q):
    q, h = random_q[:500], 1e-6
    numeric = np.stack(
        [
            (hk.forward_kinematics(athena, q + h * e) - hk.forward_kinematics(athena, q - h * e)) / (2 * h)
            for e in np.eye(3)
        ],
        axis=-1,
    )
    assert np.abs(hk.jacobian(athena, q) - numeric).max() < 1e-9


def test_functions_broadcast_over_any_leading_axes(athena):
    q = np.zeros((2, 3, 4, 6, 3))
    foot = hk.forward_kinematics(athena, q)
    assert foot.shape == (2, 3, 4, 6, 3)
    assert hk.jacobian(athena, q).shape == (2, 3, 4, 6, 3, 3)
    assert hk.inverse_kinematics(athena, foot).reachable.shape == (2, 3, 4, 6)
    assert hk.inverse_kinematics(athena, foot, branch="all").q.shape == (2, 3, 4, 6, 4, 3)


def test_standing_height_is_tibia_plus_foot(athena):
    assert standing_height(athena) == pytest.approx(0.104, abs=1e-12)


def test_reach_flags_agree_with_distances_computed_independently(athena, rng):
    """A foot is reachable iff its distance from the CTr joint lies in [|l3 - l4|, l3 + l4]."""
    foot = rng.uniform(-0.4, 0.4, (20_000, 6, 3))
    solution = hk.inverse_kinematics(athena, foot)
    theta_1, l_1 = athena.parameters[:, 0], athena.parameters[:, 1]
    hip = np.stack([l_1 * np.cos(theta_1), l_1 * np.sin(theta_1), 0 * l_1], axis=-1)
    radius = np.linalg.norm((foot - hip)[..., :2], axis=-1)
    distance = np.hypot(radius - 0.064, foot[..., 2])
    assert solution.distance == pytest.approx(distance, abs=1e-14)
    assert np.array_equal(solution.reachable, (distance >= 0.004) & (distance <= 0.164))
    assert np.array_equal(np.isnan(solution.q).any(axis=-1), ~solution.reachable)
    assert not solution.within_limits[~solution.reachable].any()


def test_an_unreachable_foot_raises_an_error_with_leg_distance_and_reach(athena):
    foot = hk.forward_kinematics(athena, np.stack([athena.standing_q] * 5))
    foot[3, 1] *= 2.0
    with pytest.raises(
        UnreachableError, match=r"leg 2: foot target .* exceeds its reach 0.164 m \(at index 3\)"
    ) as caught:
        hk.inverse_kinematics(athena, foot, on_unreachable="raise")
    assert caught.value.leg == 2
    assert caught.value.distance > caught.value.reach[1] == pytest.approx(0.164)
    solution = hk.inverse_kinematics(athena, foot)
    assert np.argwhere(~solution.reachable).tolist() == [[3, 1]]


def test_a_foot_inside_the_inner_reach_is_named_as_such(athena):
    hip_and_coxa = hk.forward_kinematics(athena, athena.standing_q)
    hip_and_coxa[0] = [0.06 + 0.064, 0.0, 0.001]
    with pytest.raises(UnreachableError, match=r"leg 1: .* is inside its inner reach 0\.004 m"):
        hk.inverse_kinematics(athena, hip_and_coxa, on_unreachable="raise")


def test_singular_feet_are_solved(athena):
    """A straight leg, and a foot on the TC axis, whose first angle is free."""
    q = athena.standing_q.copy()
    q[:, 2] = 0.0
    solution = hk.inverse_kinematics(athena, hk.forward_kinematics(athena, q))
    assert solution.reachable.all()
    assert np.abs(solution.q - q).max() < 1e-7
    foot = hk.forward_kinematics(athena, athena.standing_q)
    foot[0] = [0.06, 0.0, -0.1]
    solution = hk.inverse_kinematics(athena, foot)
    assert solution.q[0, 0] == 0.0
    assert hk.forward_kinematics(athena, solution.q)[0] == pytest.approx(foot[0], abs=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_angles_that_are_not_finite_are_named(athena, bad):
    q = athena.standing_q.copy()
    q[2, 1] = bad
    for call in (hk.forward_kinematics, hk.jacobian, within_limits):
        with pytest.raises(InvalidInputError, match=f"q: leg 3, joint 2 is {bad}"):
            call(athena, q)
    with pytest.raises(InvalidInputError, match="p_body_foot: leg 3, coordinate 2"):
        hk.inverse_kinematics(athena, q)


def test_wrong_shapes_and_options_are_named(athena):
    with pytest.raises(InvalidInputError, match=r"q: expected shape \(..., 6, 3\), got \(4, 3\)"):
        hk.forward_kinematics(athena, np.zeros((4, 3)))
    with pytest.raises(InvalidInputError, match="q: expected numbers"):
        hk.forward_kinematics(athena, [["a"] * 3] * 6)
    foot = np.zeros((6, 3))
    with pytest.raises(UnknownNameError, match="unknown branch 'best'"):
        hk.inverse_kinematics(athena, foot, branch="best")
    with pytest.raises(UnknownNameError, match="on_unreachable"):
        hk.inverse_kinematics(athena, foot, on_unreachable="ignore")
    with pytest.raises(InvalidInputError, match="near"):
        hk.inverse_kinematics(athena, foot, near=foot, branch="all")


def test_a_leg_type_that_is_not_shipped_is_derived_when_used(tmp_path, athena, rng):
    import yaml

    from hexakin.installation import DATA

    tree = yaml.safe_load((DATA / "robots" / "athena.yaml").read_text())
    tree["leg_table"]["rows"][1]["d"] = "h"
    tree["leg_table"]["parameters"]["h"] = 0.01
    path = tmp_path / "raised.yaml"
    path.write_text(yaml.safe_dump(tree))
    raised = hk.load_robot(path)
    q = rng.uniform(athena.q_min, athena.q_max, (100, 6, 3))
    foot = hk.forward_kinematics(raised, q)
    assert foot - hk.forward_kinematics(athena, q) == pytest.approx(
        np.broadcast_to([0, 0, 0.01], foot.shape), abs=1e-15
    )
    assert np.abs(hk.inverse_kinematics(raised, foot, near=q).q - q).max() < 1e-9


def test_each_leg_has_the_branch_of_its_own_standing_pose(edited):
    """One leg stands with its knee the other way."""

    def change(tree):
        tree["legs"][3]["standing"] = {"theta_3": -1.4, "theta_4": 1.4}

    mixed = edited("athena", change)
    assert len(set(standing_branch(mixed))) == 2
    assert hk.inverse_kinematics(mixed, hk.forward_kinematics(mixed, mixed.standing_q)).q == pytest.approx(
        mixed.standing_q
    )


def test_links_of_opposite_sign_are_solved(edited, rng):
    flipped = edited("athena", lambda tree: tree["leg_table"]["parameters"].update(l_3_mm=-80))
    q = rng.uniform(flipped.q_min, flipped.q_max, (500, 6, 3))
    foot = hk.forward_kinematics(flipped, q)
    solution = hk.inverse_kinematics(flipped, foot, near=q)
    assert solution.reachable.all() and (solution.reach[..., 0] < solution.reach[..., 1]).all()
    assert np.abs(hk.forward_kinematics(flipped, solution.q) - foot).max() < 1e-12


def test_a_leg_without_a_closed_form_still_has_its_forward_kinematics(edited):
    spatial = edited("athena", lambda tree: tree["leg_table"]["rows"][2].update(alpha="pi/2"))
    foot = hk.forward_kinematics(spatial, spatial.standing_q)
    assert np.isfinite(foot).all() and np.isfinite(hk.jacobian(spatial, spatial.standing_q)).all()
    assert hk.inverse_kinematics(spatial, foot).numerical


def test_a_path_prefers_the_branch_that_reaches_all_of_it(athena):
    """One sample in a thousand is out of reach of the branches that face the foot."""
    path = np.tile(hk.forward_kinematics(athena, athena.standing_q), (1000, 1, 1))
    path[:, 0] = [0.124, 0.0, 0.02]
    path[500, 0] = [0.124, 0.0, 0.001]
    assert path_inverse_kinematics(athena, path).reachable.all()


def test_a_name_is_no_robot_and_a_hint_must_fit(athena):
    for call in (hk.forward_kinematics, hk.jacobian, hk.inverse_kinematics):
        with pytest.raises(InvalidInputError, match=r"robot: expected a Robot, .*, got 'athena'"):
            call("athena", athena.standing_q)
    feet = np.zeros((2, 6, 3))
    with pytest.raises(InvalidInputError, match="near: shape"):
        hk.inverse_kinematics(athena, feet, near=np.zeros((5, 6, 3)))
    one = hk.forward_kinematics(athena, athena.standing_q)
    hints = np.stack([athena.standing_q] * 4)
    assert hk.inverse_kinematics(athena, one, near=hints).q.shape == (4, 6, 3)
    with pytest.raises(InvalidInputError, match="complex"):
        hk.forward_kinematics(athena, athena.standing_q + 1j)


def test_joints_and_segments_of_many_poses_are_those_of_each(athena, rng):
    q = rng.uniform(athena.q_min, athena.q_max, (2, 3, 6, 3))
    poses, axes = hk.kinematics.segment_poses(athena, q), hk.kinematics.joint_axes(athena, q)
    assert poses.shape == (2, 3, 6, 3, 4, 4) and axes.shape == (2, 3, 6, 3, 3)
    np.testing.assert_array_equal(poses[1, 2], hk.kinematics.segment_poses(athena, q[1, 2]))
    np.testing.assert_array_equal(axes[1, 2], hk.kinematics.joint_axes(athena, q[1, 2]))
    ends = np.concatenate([poses[..., 1:, :3, 3], hk.forward_kinematics(athena, q)[..., None, :]], axis=-2)
    along = (ends - poses[..., :3, 3]) / np.linalg.norm(ends - poses[..., :3, 3], axis=-1, keepdims=True)
    np.testing.assert_allclose(poses[..., :3, 0], along, atol=1e-12)
