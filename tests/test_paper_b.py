"""HWR's kinematics against the equations of paper B, and its step geometry and cycloids."""

import numpy as np
import pytest
import sympy as sp

import hexakin as hk
from hexakin.kinematics import path_inverse_kinematics, posed_inverse_kinematics
from hexakin.transforms import inverse_pose, pose, rotation_between, rpy_rotation, transform_points
from hexakin.walking.swing import adapted_cycloid, step_geometry


@pytest.fixture(scope="module")
def hwr():
    return hk.load_robot("hwr")


@pytest.fixture(scope="module")
def leg(hwr):
    return hk.symbolic.derive(hwr.table)


def test_the_tables_rows_give_the_papers_four_matrices(leg):
    t1, t2, t3 = leg.joints
    l2, l3, r1 = (leg.symbol(name) for name in ("l_2", "l_3", "r_1"))
    c, s = sp.cos, sp.sin
    printed = [
        [[c(t1), -s(t1), 0, 0], [s(t1), c(t1), 0, 0], [0, 0, 1, r1]],
        [[c(t2), -s(t2), 0, 0], [0, 0, 1, 0], [-s(t2), -c(t2), 0, 0]],
        [[c(t3), -s(t3), 0, l2], [s(t3), c(t3), 0, 0], [0, 0, 1, 0]],
        [[1, 0, 0, l3], [0, 1, 0, 0], [0, 0, 1, 0]],
    ]
    for k, matrix in enumerate(printed):
        assert leg.transform(k, k + 1) == sp.Matrix([*matrix, [0, 0, 0, 1]])


def test_the_foot_is_the_papers_closed_form(leg):
    t1, t2, t3 = leg.joints
    x0, y0, r1, l2, l3 = (leg.symbol(name) for name in ("x_0", "y_0", "r_1", "l_2", "l_3"))
    reach = l2 * sp.cos(t2) + l3 * sp.cos(t2 + t3)
    height = r1 - l2 * sp.sin(t2) - l3 * sp.sin(t2 + t3)
    assert sp.expand(leg.foot - sp.Matrix([x0 + sp.cos(t1) * reach, y0 + sp.sin(t1) * reach, height])) == sp.zeros(3, 1)


def test_every_branch_returns_random_targets_in_reach(hwr, rng):
    direction = rng.normal(size=(10_000, 6, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    second_joint = hwr.parameters[:, :3]  # x_0, y_0, r_1
    p = second_joint + direction * rng.uniform(0.001, 0.1999, (10_000, 6, 1))
    solution = hk.inverse_kinematics(hwr, p, branch="all")
    assert solution.reachable.all(), "without an offset all four branches reach the whole ball"
    back = np.stack([hk.forward_kinematics(hwr, solution.q[:, :, b]) for b in range(4)], axis=2)
    assert np.abs(back - p[:, :, None]).max() < 1e-12


def test_standing_is_on_the_printed_root(hwr):
    feet = hk.forward_kinematics(hwr, hwr.standing_q)
    assert feet[:, 2] == pytest.approx(np.full(6, -0.15))
    assert np.abs(feet[:, 1]) == pytest.approx(np.full(6, 0.22))
    assert feet[:, 0] == pytest.approx([0.18, 0, -0.18, -0.18, 0, 0.18], abs=1e-12)
    assert hk.inverse_kinematics(hwr, feet).q == pytest.approx(hwr.standing_q, abs=1e-12)


def test_a_body_moves_in_six_degrees_of_freedom_on_fixed_feet(hwr, rng):
    feet = hk.forward_kinematics(hwr, hwr.standing_q) + [0, 0, 0.15]
    rpy, shift = rng.uniform(-0.15, 0.15, (50, 3)), rng.uniform(-0.03, 0.03, (50, 3))
    T = np.array([pose(rpy_rotation(angles), [0, 0, 0.15] + move) for angles, move in zip(rpy, shift, strict=True)])
    solution = posed_inverse_kinematics(hwr, T, np.broadcast_to(feet, (50, 6, 3)), on_unreachable="raise")
    assert transform_points(T, hk.forward_kinematics(hwr, solution.q)) == pytest.approx(
        np.broadcast_to(feet, (50, 6, 3))
    )


def test_rpy_is_rz_ry_rx(rng):
    for roll, pitch, yaw in rng.uniform(-3, 3, (20, 3)):
        rx, ry, rz = (
            hk.transforms.axis_rotation(axis, angle) for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True)
        )
        assert rpy_rotation([roll, pitch, yaw]) == pytest.approx(rz @ ry @ rx)


def test_inverse_poses_and_smallest_rotations(rng):
    a, b = rng.normal(size=(2, 200, 3))
    rotation = rotation_between(a, b)
    turned = np.einsum("nij,nj->ni", rotation, a) / np.linalg.norm(a, axis=1, keepdims=True)
    assert turned == pytest.approx(b / np.linalg.norm(b, axis=1, keepdims=True), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(np.ones(200))
    T = np.array([pose(r, p) for r, p in zip(rotation, a, strict=True)])
    assert T @ inverse_pose(T) == pytest.approx(np.broadcast_to(np.eye(4), (200, 4, 4)), abs=1e-12)
    for opposed in ([0, 0, 1.0], [1.0, 2.0, -3.0]):
        half_turn = rotation_between(opposed, -np.array(opposed))
        assert half_turn @ opposed == pytest.approx(-np.array(opposed))
        assert np.linalg.det(half_turn) == pytest.approx(1.0)


def test_a_path_stays_on_one_branch_even_if_the_standing_one_runs_out_of_limits(hwr):
    """A path that starts in another branch is followed there when the start says so."""
    q = hwr.standing_q.copy()
    q[:, 1], q[:, 2] = 1.2, -0.9
    path = hk.forward_kinematics(hwr, np.linspace(q, q + [0.0, 0.1, 0.2], 50))
    solution = path_inverse_kinematics(hwr, path, near=q)
    assert np.unique(solution.branch, axis=0).shape == (1, 6)
    assert np.abs(np.diff(solution.q, axis=0)).max() < 0.02
    inside = path_inverse_kinematics(hwr, path)
    assert inside.within_limits.all(), "without a start the branch inside the limits is chosen"


def test_step_geometry_is_b17_to_b21():
    step = step_geometry([0, 0, 0], [0.03, 0.04, 0.12])
    assert step.plan_length == pytest.approx(0.05)
    assert step.length == pytest.approx(0.13)
    assert step.slope == pytest.approx(np.arctan2(0.12, 0.05))
    assert step.yaw == pytest.approx(np.arctan2(0.04, 0.03))
    assert step.radius == pytest.approx(0.13 / (2 * np.pi))


def test_the_cycloid_in_row_and_in_column_vectors_is_the_same_curve(rng):
    """B(23) as printed, rows times Ry(theta) Rz(-atan2), against our columns."""
    start, end = rng.uniform(-0.1, 0.1, (2, 3))
    phase = np.linspace(0, 1, 21)
    step, t = step_geometry(start, end), 2 * np.pi * phase
    rows = np.column_stack([step.radius * (t - np.sin(t)), 0 * t, step.radius * (1 - np.cos(t))])
    turn_y = hk.transforms.axis_rotation([0, 1, 0], float(step.slope))
    turn_z = hk.transforms.axis_rotation([0, 0, 1], -float(step.yaw))
    assert adapted_cycloid(start, end, phase) == pytest.approx(rows @ turn_y @ turn_z + start, abs=1e-15)


def test_a_cycloid_joins_its_footholds_and_rises_by_its_diameter():
    path = adapted_cycloid([0, 0, 0], [0.1, 0, 0], np.linspace(0, 1, 101))
    assert path[0] == pytest.approx([0, 0, 0]) and path[-1] == pytest.approx([0.1, 0, 0])
    assert path[:, 2].max() == pytest.approx(0.1 / np.pi)
    assert adapted_cycloid([0, 0, 0], [0.1, 0, 0], 0.5, arch=2.0)[2] == pytest.approx(0.2 / np.pi)


def test_leg_curves_are_b16_and_scale_each_leg():
    k = np.array([[1, 1, 1, 1, 1, 2.0], [1, 0, 1, 1, 1, 1], [0, 1, 2, 1, 1, 1]])
    curves = hk.terrain.LegCurves(lambda s: s**2, lambda s, y: 3 * s + y, k=k)
    move = curves.displacement([0.1])
    assert move[:, 0] == pytest.approx(0.1 * k[0])
    assert move[:, 1] == pytest.approx(0.01 * k[1])
    assert move[:, 2] == pytest.approx(0.31 * k[2])
    with pytest.raises(hk.exceptions.InvalidInputError, match="k: expected shape"):
        hk.terrain.LegCurves(k=np.ones((2, 6)))
    with pytest.raises(hk.exceptions.InvalidInputError, match="not finite"), np.errstate(divide="ignore"):
        hk.terrain.LegCurves(lambda s: 1 / s).displacement(np.array([[0.0], [1.0]]))


def test_a_point_foot_is_refused_by_a_simulation(hwr):
    with pytest.raises(hk.exceptions.InvalidInputError, match=r"foot\.radius is 0"):
        hk.urdf.to_urdf(hwr)
