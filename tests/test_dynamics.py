"""The Pinocchio model against the description, the URDF, PyBullet, and physics with known answers."""

import numpy as np
import pinocchio as pin
import pytest

import hexakin as hk
from hexakin import dynamics
from hexakin.exceptions import InvalidInputError
from hexakin.transforms import pose, rpy_rotation


@pytest.fixture(params=["athena", "athena_physical", "hwr", "phantomx"])
def robot(request):
    return hk.load_robot(request.param)


@pytest.fixture
def state(robot, rng):
    """A random configuration and velocity."""
    T = pose(rpy_rotation(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
    configuration = dynamics.configuration(robot, T, rng.uniform(robot.q_min, robot.q_max))
    return configuration, rng.normal(size=24)


def test_the_model_has_the_papers_bodies_and_joints():
    robot = hk.load_robot("athena")
    locked, sprung = dynamics.build_model(robot), dynamics.build_model(robot, foot_springs=True)
    assert (locked.nv, sprung.nv) == (24, 30)
    revolute = [name for name in sprung.names if name.startswith("theta")]
    prismatic = [name for name in sprung.names if name.startswith("spring")]
    assert (len(revolute), len(prismatic)) == (18, 6)
    for model in (locked, sprung):
        assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(2.1334, abs=1e-12)


def test_feet_are_where_the_kinematics_puts_them(robot, state):
    configuration, _ = state
    model = dynamics.build_model(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    T = pin.XYZQUATToSE3(configuration[:7]).homogeneous
    expected = hk.transforms.transform_points(T, hk.forward_kinematics(robot, configuration[7:].reshape(6, 3)))
    feet = [data.oMf[model.getFrameId(f"foot_{leg + 1}")].translation for leg in range(6)]
    assert np.array(feet) == pytest.approx(expected, abs=1e-12)


def test_the_springs_at_rest_do_not_move_the_feet():
    robot = hk.load_robot("athena")
    model = dynamics.build_model(robot, foot_springs=True)
    data, q = model.createData(), pin.neutral(model)
    for leg in range(6):
        for k, name in enumerate(robot.table.joints):
            q[model.joints[model.getJointId(f"{name}_{leg + 1}")].idx_q] = robot.standing_q[leg, k]
    pin.framesForwardKinematics(model, data, q)
    feet = [data.oMf[model.getFrameId(f"foot_{leg + 1}")].translation.copy() for leg in range(6)]
    assert np.array(feet) == pytest.approx(hk.forward_kinematics(robot, robot.standing_q), abs=1e-12)
    q[model.joints[model.getJointId("spring_1")].idx_q] = 0.01
    pin.framesForwardKinematics(model, data, q)
    moved = data.oMf[model.getFrameId("foot_1")].translation - feet[0]
    assert moved == pytest.approx([0, 0, -0.01], abs=1e-12), "along the vertical tibia"


def test_maximal_coordinates_reduce_to_the_mass_matrix(robot, state):
    """A(1): J^T M_150 J, with the bodies' inertias from the description."""
    configuration, velocity = state
    maximal = dynamics.maximal_model(robot, configuration)
    assert maximal.mass.shape == (150, 150) and len(maximal.names) == 25
    M = dynamics.mass_matrix(robot, configuration)
    assert maximal.jacobian.T @ maximal.mass @ maximal.jacobian == pytest.approx(M, abs=1e-12)
    assert np.linalg.eigvalsh(M).min() > 0.0
    rates = maximal.jacobian @ velocity
    assert dynamics.energies(robot, configuration, velocity).kinetic == pytest.approx(
        0.5 * rates @ maximal.mass @ rates
    )


def test_the_mass_matrix_is_the_urdfs():
    robot, rng = hk.load_robot("athena"), np.random.default_rng(0)
    model = pin.buildModelFromXML(hk.urdf.to_urdf(robot), pin.JointModelFreeFlyer())
    configuration = dynamics.configuration(robot, np.eye(4), rng.uniform(robot.q_min, robot.q_max))
    M = pin.crba(model, model.createData(), configuration)
    assert dynamics.mass_matrix(robot, configuration) == pytest.approx(np.triu(M) + np.triu(M, 1).T, abs=1e-12)


@pytest.mark.pybullet
@pytest.mark.parametrize("name", ["athena", "athena_physical"])
def test_pybullet_has_the_same_mass_matrix_and_inverse_dynamics(name, tmp_path, rng):
    import pybullet

    robot = hk.load_robot(name)
    path = tmp_path / "robot.urdf"
    path.write_text(hk.urdf.to_urdf(robot))
    q, rate, acceleration = rng.uniform(robot.q_min, robot.q_max), rng.normal(size=18), rng.normal(size=18)
    configuration = dynamics.configuration(robot, np.eye(4), q)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, -dynamics.GRAVITY, physicsClientId=client)
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        floating = pybullet.loadURDF(str(path), flags=flags, physicsClientId=client)
        fixed = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
        theirs = np.array(pybullet.calculateMassMatrix(floating, q.ravel().tolist(), physicsClientId=client))
        torque = pybullet.calculateInverseDynamics(
            fixed, q.ravel().tolist(), rate.tolist(), acceleration.tolist(), physicsClientId=client
        )
    finally:
        pybullet.disconnect(client)
    order = [3, 4, 5, 0, 1, 2, *range(6, 24)]  # Bullet puts the base's angular part first
    M = dynamics.mass_matrix(robot, configuration)[np.ix_(order, order)]
    assert theirs[6:, 6:] == pytest.approx(M[6:, 6:], abs=1e-12)
    if name == "athena":  # otherwise Bullet turns the base frame into the torso's principal axes
        assert theirs == pytest.approx(M, abs=1e-12)
    still = np.zeros(6)
    ours = dynamics.inverse_dynamics(robot, configuration, np.r_[still, rate], np.r_[still, acceleration])
    assert np.array(torque) == pytest.approx(ours[6:], abs=1e-12)


def test_foot_jacobians_are_finite_differences(robot, state):
    configuration, velocity = state
    model = dynamics.build_model(robot)
    h = 1e-6

    def feet(at):
        T = pin.XYZQUATToSE3(at[:7]).homogeneous
        return hk.transforms.transform_points(T, hk.forward_kinematics(robot, at[7:].reshape(6, 3)))

    ahead, behind = (feet(pin.integrate(model, configuration, s * h * velocity)) for s in (1, -1))
    assert dynamics.foot_jacobians(robot, configuration) @ velocity == pytest.approx(
        (ahead - behind) / (2 * h), abs=1e-8
    )


def test_the_delassus_matrix_is_what_impulses_at_the_feet_do(robot, state):
    configuration, _ = state
    W = dynamics.delassus(robot, configuration)
    assert W == pytest.approx(W.T, abs=1e-9)
    assert np.linalg.eigvalsh(W).min() > 0.0
    impulse = np.zeros(18)
    impulse[4] = 1.0
    J = dynamics.foot_jacobians(robot, configuration).reshape(18, 24)
    change = J @ np.linalg.solve(dynamics.mass_matrix(robot, configuration), J.T @ impulse)
    assert W[:, 4] == pytest.approx(change, abs=1e-9)


def test_gravity_is_the_weight_on_the_base(robot, state):
    configuration, _ = state
    g = dynamics.gravity(robot, configuration)
    R = pin.XYZQUATToSE3(configuration[:7]).rotation
    assert R @ g[:3] == pytest.approx([0, 0, robot.mass * dynamics.GRAVITY])
    assert dynamics.bias(robot, configuration, np.zeros(24)) == pytest.approx(g)


def test_energy_is_conserved_in_free_flight(robot, state):
    """A tumbling robot with loose joints: what drifts is the integrator's error, which falls at least with its square.

    The Runge-Kutta stages' velocities belong to differently turned body frames; their plain average is of second order.
    """
    configuration, velocity = state
    model = dynamics.build_model(robot)
    data = model.createData()

    def drift(h):
        q, v = configuration.copy(), velocity.copy()
        total = sum(dynamics.energies(robot, q, v))
        for _ in range(round(0.1 / h)):
            rates = []
            for part in (0.0, 0.5, 0.5, 1.0):
                at = pin.integrate(model, q, part * h * rates[-1][0]) if rates else q
                speed = v + part * h * rates[-1][1] if rates else v
                rates.append((speed, pin.aba(model, data, at, speed, np.zeros(24)).copy()))
            mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(*rates, strict=True)]
            q, v = pin.integrate(model, q, h * mean[0]), v + h * mean[1]
        return abs(sum(dynamics.energies(robot, q, v)) - total)

    coarse, fine = drift(2e-3), drift(1e-3)
    assert fine < 1e-5 * dynamics.energies(robot, configuration, velocity).kinetic
    assert fine < coarse / 3.0


def test_bad_configurations_and_velocities_are_named():
    robot = hk.load_robot("athena")
    at = dynamics.configuration(robot, np.eye(4), robot.standing_q)
    with pytest.raises(InvalidInputError, match=r"configuration: expected shape \(25,\), got \(24,\)"):
        dynamics.mass_matrix(robot, at[:-1])
    with pytest.raises(InvalidInputError, match="its quaternion has norm 2, expected 1"):
        dynamics.mass_matrix(robot, np.r_[at[:6], 2.0, at[7:]])
    with pytest.raises(InvalidInputError, match=r"velocity: index .* is nan"):
        dynamics.bias(robot, at, np.full(24, np.nan))


def test_table_1_is_the_physical_robots_tibia_and_foot_together():
    """The assumed split gives back the printed tensor about the common centre of mass."""
    robot = hk.load_robot("athena_physical")
    tibia, foot = robot.segments["tibia"], robot.foot
    places = [tibia.center_of_mass, np.array([0.084, 0, 0])]
    center = (tibia.mass * places[0] + foot.mass * places[1]) / (tibia.mass + foot.mass)
    total = np.zeros((3, 3))
    for body, place in zip((tibia, foot), places, strict=True):
        d = place - center
        total += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    printed = np.array([[9.00, 2.77, -0.03], [2.77, 26.58, 0.01], [-0.03, 0.01, 34.49]])
    assert 1e6 * total == pytest.approx(printed, abs=0.005)
    assert tibia.mass + foot.mass == pytest.approx(0.0219)
