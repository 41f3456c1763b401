"""The PhantomX AX: its file against its own sources, its kinematics, and that it stands and walks."""

import numpy as np
import pytest

import hexakin as hk
from hexakin import dynamics
from hexakin.engines.rigid_engine import RigidEngine
from hexakin.generated import MODULES
from hexakin.kinematics import standing_height
from hexakin.simulation.closed_loop import starting_pose


@pytest.fixture(scope="module")
def phantomx():
    return hk.load_robot("phantomx")


def test_its_mass_is_that_of_eighteen_servos_and_a_frame(phantomx):
    """AX-12A servos weigh 54.6 g each (ROBOTIS); a robot of this kind with its battery 2.0 to 2.6 kg."""
    assert 2.0 < phantomx.mass < 2.6
    assert phantomx.segments["coxa"].mass == pytest.approx(0.0546 + 2 * 0.0244)
    assert phantomx.segments["tibia"].mass + phantomx.foot.mass == pytest.approx(0.0546 + 0.0244)


def test_its_hips_and_feet_are_where_the_public_models_have_them(phantomx):
    hips = np.array([phantomx.fixed_poses(leg)[0, :3, 3] for leg in range(6)])
    assert 1e3 * np.abs(hips[[0, 3]]) == pytest.approx(np.array([[0, 103.4, 0]] * 2), abs=1e-9)
    assert 1e3 * np.abs(hips[[1, 2, 4, 5]]) == pytest.approx(np.array([[122, 61, 0]] * 4), abs=1e-9)
    feet = hk.forward_kinematics(phantomx, phantomx.standing_q) - hips
    assert 1e3 * np.hypot(feet[:, 0], feet[:, 1]) == pytest.approx(np.full(6, 141.0), abs=0.05)
    assert np.rad2deg(np.arctan2(feet[:, 1], feet[:, 0])) == pytest.approx([-90, -45, 45, 90, 135, -135], abs=1e-9)
    assert standing_height(phantomx) == pytest.approx(0.090, abs=1e-4)


def test_its_leg_is_athenas_type_so_that_nothing_new_is_generated(phantomx, athena):
    assert phantomx.table.type_key == athena.table.type_key and phantomx.table.type_key in MODULES


def test_forward_undoes_inverse_kinematics_on_every_branch(phantomx, rng):
    foot = hk.forward_kinematics(phantomx, rng.uniform(phantomx.q_min, phantomx.q_max, (2000, 6, 3)))
    every = hk.inverse_kinematics(phantomx, foot, branch="all")
    for branch in range(4):
        there = every.reachable[..., branch]
        back = hk.forward_kinematics(phantomx, np.where(there[..., None], every.q[..., branch, :], 0.0))
        assert there.sum() > 1000 and np.abs(back - foot)[there].max() < 1e-12


def test_its_mass_matrix_is_positive_definite_in_any_pose(phantomx, rng):
    for q in rng.uniform(phantomx.q_min, phantomx.q_max, (20, 6, 3)):
        M = dynamics.mass_matrix(phantomx, dynamics.configuration(phantomx, np.eye(4), q))
        assert np.linalg.eigvalsh(M)[0] > 1e-5 and M[0, 0] == pytest.approx(phantomx.mass)


def test_it_stands_at_its_height(phantomx):
    plane = hk.terrain.Plane()
    engine = RigidEngine(phantomx, plane, time_step=0.002)
    engine.place(starting_pose(phantomx, plane, phantomx.standing_q), phantomx.standing_q)
    engine.advance(phantomx.standing_q, 900)
    reading = engine.advance(phantomx.standing_q, 100)
    assert reading.T_world_body[2, 3] == pytest.approx(0.090, abs=2e-3)
    assert reading.foot_force.sum() == pytest.approx(phantomx.mass * 9.81, rel=1e-3)
    assert np.abs(reading.joint_torque).max() < 0.5 * phantomx.servo.max_torque


def test_it_walks_forwards_without_its_torso_touching(phantomx):
    walk = hk.simulate(
        phantomx, hk.terrain.Plane(), hk.PostureController(phantomx), engine="rigid", max_cycles=2, time_step=0.002
    )
    way = walk.T_world_body[-1, :3, 3] - walk.T_world_body[0, :3, 3]
    assert way[0] > 0.15 and np.abs(way[1:]).max() < 0.02  # of 0.2 m commanded, along x
    assert not (walk.torso_force > 0.0).any() and not walk.limited.any()
