"""The MJCF agrees with the description and with Pinocchio's model."""

import numpy as np
import pytest

import hexakin as hk
from hexakin import dynamics
from hexakin.transforms import pose, rpy_rotation

pytestmark = pytest.mark.mujoco


def compiled(robot):
    import mujoco

    model = mujoco.MjModel.from_xml_string(hk.mjcf.to_mjcf(robot))
    return model, mujoco.MjData(model)


def placed(robot, rng):
    """MuJoCo's model and data at a random configuration, and Pinocchio's configuration."""
    import mujoco

    model, data = compiled(robot)
    T = pose(rpy_rotation(rng.uniform(-3, 3, 3)), rng.uniform(-1, 1, 3))
    configuration = dynamics.configuration(robot, T, rng.uniform(robot.q_min, robot.q_max))
    data.qpos[:] = configuration[[0, 1, 2, 6, 3, 4, 5, *range(7, model.nq)]]  # the quaternion's w comes first
    mujoco.mj_forward(model, data)
    return model, data, configuration, T


@pytest.fixture(params=["athena", "athena_physical", "hwr", "phantomx", "lopsided"])
def robot(request, edited):
    def lopsided(tree):
        tree["torso"]["center_of_mass_mm"] = [5, -10, 20]
        tree["torso"]["inertia"].update(xy=3e-4, xz=-2e-4)

    return edited("athena", lopsided) if request.param == "lopsided" else hk.load_robot(request.param)


def test_mass_matrix_and_centre_of_mass_are_pinocchios(robot, rng):
    import mujoco

    for _ in range(20):
        model, data, configuration, T = placed(robot, rng)
        M = np.zeros((model.nv, model.nv))
        for column in range(model.nv):
            mujoco.mj_mulM(model, data, M[column], np.eye(model.nv)[column])
        turn = np.eye(model.nv)
        turn[:3, :3] = T[:3, :3]  # Pinocchio's velocity of the base is in its own axes, MuJoCo's in the world's
        ours = dynamics.mass_matrix(robot, configuration)
        scale = np.sqrt(np.diag(ours))
        assert np.abs((turn.T @ M @ turn - ours) / np.outer(scale, scale)).max() < 1e-9
        assert data.subtree_com[1] == pytest.approx(dynamics.center_of_mass(robot, configuration), abs=1e-9)
        assert model.body_subtreemass[1] == pytest.approx(robot.mass, rel=1e-9)


def test_gravity_and_bias_are_pinocchios(robot, rng):
    """At rest, where the frames of the base's velocities do not matter."""
    _, data, configuration, T = placed(robot, rng)
    ours = dynamics.gravity(robot, configuration)
    theirs = np.r_[T[:3, :3].T @ data.qfrc_bias[:3], data.qfrc_bias[3:]]
    assert theirs == pytest.approx(ours, abs=1e-9 * robot.weight)


def test_feet_and_geoms_are_where_the_description_puts_them(robot, rng):
    model, data, configuration, T = placed(robot, rng)
    expected = hk.transforms.transform_points(T, hk.forward_kinematics(robot, configuration[7:].reshape(-1, 3)))
    for leg in range(robot.num_legs):
        assert data.body(f"foot_{leg + 1}").xpos == pytest.approx(expected[leg], abs=1e-12)
        assert model.geom(f"tibia_{leg + 1}").size == pytest.approx(robot.segments["tibia"].size / 2)
    torso = T[:3, :3] @ robot.torso.center_of_mass + T[:3, 3]
    assert data.geom("torso").xpos == pytest.approx(torso, abs=1e-12)


def test_joints_have_the_limits_and_motors_the_torque(robot):
    model, _ = compiled(robot)
    names = [f"{joint}_{leg + 1}" for leg in range(robot.num_legs) for joint in robot.table.joints]
    assert [model.joint(index).name for index in range(model.njnt)] == ["base", *names]
    assert [model.actuator(index).name for index in range(model.nu)] == names
    assert model.jnt_limited[1:].all() and model.actuator_ctrllimited.all()
    assert model.jnt_range[1:] == pytest.approx(robot.joint_limits.reshape(-1, 2))
    limits = np.array([-1.0, 1.0]) * robot.servo.max_torque
    assert model.actuator_ctrlrange == pytest.approx(np.tile(limits, (model.nu, 1)))


def test_point_feet_and_flat_bodies_have_no_geom(edited):
    def flat(tree):
        tree["foot"]["radius_mm"]["value"] = 0

    model, _ = compiled(edited("athena", flat))
    assert model.ngeom == 19 and model.nbody == 26
    assert model.body_subtreemass[1] == pytest.approx(hk.load_robot("athena").mass)


def test_the_robot_touches_a_ground_of_the_users_own_but_not_itself(athena):
    import mujoco

    spec = mujoco.MjSpec.from_string(hk.mjcf.to_mjcf(athena))
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = 0, 0, 0.02, 1, 0, 0, 0
    mujoco.mj_forward(model, data)
    pairs = {frozenset(model.geom(int(geom)).name for geom in pair) for pair in data.contact.geom}
    assert frozenset({"ground", "torso"}) in pairs
    assert all("ground" in pair for pair in pairs)
