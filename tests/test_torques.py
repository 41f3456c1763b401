"""Forces that torques tell of: the opposite way to the force programmes, and the forces of feet against each other."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility import distribute, forces_from_torques, internal_forces, torques_from_forces
from hexakin.kinematics import standing_height
from hexakin.robot.model import GRAVITY

N = 40


@pytest.fixture(params=["athena", "hwr"])
def robot(request):
    return hk.load_robot(request.param)


def tilted(robot, rng, n=N):
    turns = [hk.transforms.rpy_rotation(rpy) for rpy in rng.uniform(-0.4, 0.4, (n, 3))]
    T = np.array([hk.transforms.pose(R, [0.0, 0.0, standing_height(robot)]) for R in turns])
    return T, robot.standing_q + rng.uniform(-0.3, 0.3, (n, robot.num_legs, 3))


def test_torques_of_a_force_distribution_give_its_forces_back(robot):
    rng = np.random.default_rng(1)
    T, q = tilted(robot, rng)
    normals = T[:, None, :3, 2] + 0.2 * rng.normal(size=(N, robot.num_legs, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    carrying = np.ones((N, robot.num_legs), dtype=bool)
    carrying[::2, ::2] = False
    found = distribute(robot, T, q, carrying, normals, max_torque=np.inf)
    held = found.feasible
    assert held.sum() > N / 2
    forces = forces_from_torques(robot, T[held], q[held], found.torque[held], normals[held])
    np.testing.assert_allclose(forces, found.force[held], atol=1e-8)
    torque = torques_from_forces(robot, T[held], q[held], found.force[held], normals[held])
    np.testing.assert_allclose(torque, found.torque[held], atol=1e-10)
    np.testing.assert_allclose(forces.sum(axis=1) - [0.0, 0.0, robot.mass * GRAVITY], 0.0, atol=1e-7)


def test_internal_forces_have_no_resultant_and_no_moment_and_the_rest_is_the_smallest():
    rng = np.random.default_rng(2)
    points, force = rng.normal(size=(N, 6, 3)), rng.normal(size=(N, 6, 3))
    carrying = rng.random((N, 6)) < 0.7
    inner = internal_forces(points, force, carrying)
    assert not inner[~carrying].any()
    np.testing.assert_allclose(inner.sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(points, inner).sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(internal_forces(points, inner, carrying), inner, atol=1e-12)
    rest = np.where(carrying[..., None], force, 0.0) - inner
    np.testing.assert_allclose((rest * inner).sum(axis=(1, 2)), 0.0, atol=1e-10)
    assert np.abs(inner).max() > 0.1


def test_two_feet_pressed_together_are_internal_and_a_weight_is_not():
    points = np.array([[[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]]])
    along = points[:, 1] - points[:, 0]
    both = np.ones((1, 2), dtype=bool)
    pressed = np.stack([along, -along], axis=1)
    np.testing.assert_allclose(internal_forces(points, pressed, both), pressed, atol=1e-12)
    weight = np.broadcast_to([0.0, 0.0, 5.0], (1, 2, 3))
    np.testing.assert_allclose(internal_forces(points, weight, both), 0.0, atol=1e-12)
    np.testing.assert_allclose(internal_forces(points, pressed, [[True, False]]), 0.0, atol=1e-12)
    np.testing.assert_allclose(internal_forces(points, pressed, [[False, False]]), 0.0, atol=1e-12)


def test_what_cannot_be_used_is_named(robot):
    T, q = tilted(robot, np.random.default_rng(3), n=2)
    for function in (forces_from_torques, torques_from_forces):
        with pytest.raises(InvalidInputError, match="expected shapes"):
            function(robot, T, q, q[:1])
    with pytest.raises(InvalidInputError, match="expected shapes"):
        internal_forces(q, q, np.ones((2, 5), dtype=bool))


def test_a_straight_leg_is_refused():
    robot = hk.load_robot("hwr")  # its feet are points, so that a straight leg leads to its contact
    T, q = tilted(robot, np.random.default_rng(3), n=2)
    q[1, 3, 2] = 0.0
    with pytest.raises(InvalidInputError, match="leg 4 is stretched straight at instant 1"):
        forces_from_torques(robot, T, q, np.zeros_like(q))
