"""Physics with known answers on the PyBullet engine, and ATHENA standing."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.engines import engine_class
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.robot.model import GRAVITY
from hexakin.simulation.closed_loop import starting_pose, torso_height
from hexakin.transforms import pose

pytestmark = pytest.mark.pybullet


def bullet(*arguments, **options):
    return engine_class("pybullet")(*arguments, **options)


def lopsided(tree):
    """A torso whose centre of mass and principal axes are not those of the body frame."""
    tree["torso"]["center_of_mass_mm"] = [5, -10, 20]
    tree["torso"]["inertia"].update(xy=3e-4, xz=-2e-4)


@pytest.fixture(scope="module")
def standing(athena):
    """Readings over ten seconds of standing on level ground, two a second, after one second of settling."""
    q, plane = athena.standing_q, hk.terrain.Plane()
    with bullet(athena, plane) as engine:
        engine.place(starting_pose(athena, plane, q), q)
        engine.advance(q, 1000)
        return [engine.advance(q, 500) for _ in range(21)]


def test_standing_forces_sum_to_the_weight(athena, standing):
    for reading in standing:
        assert reading.foot_force.sum() == pytest.approx(athena.mass * GRAVITY, rel=0.01)
        assert (reading.foot_force > 0.0).all()
        assert reading.torso_force == reading.limb_force == 0.0


def test_standing_height_is_104_mm(standing):
    for reading in standing:
        assert torso_height(hk.terrain.Plane(), reading.T_world_body) == pytest.approx(0.104, abs=1e-3)


def test_standing_feet_do_not_drift(athena, standing):
    feet = np.array(
        [hk.forward_kinematics(athena, r.q) @ r.T_world_body[:3, :3].T + r.T_world_body[:3, 3] for r in standing]
    )
    assert np.linalg.norm(feet - feet[0], axis=-1).max() < 1e-3


def test_a_servo_closes_its_error_at_its_rate(athena):
    """In free fall the legs carry no load: the error falls by exp(-rate t)."""
    q = athena.standing_q
    target = q + [0.0, 0.1, 0.0]
    with bullet(athena, hk.terrain.Plane()) as engine:
        engine.place(pose(np.eye(3), [0, 0, 5.0]), q)
        reading = engine.advance(target, 50)
    error = target[:, 1] - reading.q[:, 1]
    assert error == pytest.approx(np.full(6, 0.1 * (1 - athena.servo.rate * 1e-3) ** 50), rel=0.02)


def test_a_falling_robot_accelerates_by_gravity(athena):
    with bullet(athena, hk.terrain.Plane()) as engine:
        engine.place(pose(np.eye(3), [0, 0, 5.0]), athena.standing_q)
        reading = engine.advance(athena.standing_q, 200)
    assert reading.body_velocity == pytest.approx([0, 0, -GRAVITY * 0.2], abs=1e-6)
    assert reading.foot_force.sum() == 0.0


@pytest.mark.parametrize("slope_deg, holds", [(38.0, True), (46.0, False)])
def test_a_robot_on_a_slope_holds_up_to_the_friction_angle(athena, slope_deg, holds):
    """Friction 0.9 holds up to atan(0.9) = 42 degrees; joints are held, so that only the feet can give."""
    ramp, q = hk.terrain.Ramp(slope=np.radians(slope_deg)), athena.standing_q
    with bullet(athena, ramp) as engine:
        engine.place(starting_pose(athena, ramp, q), q)
        before = engine.advance(q, 500).T_world_body[:3, 3]
        after = engine.advance(q, 500).T_world_body[:3, 3]
    assert (np.linalg.norm(after - before) < 2e-3) == holds


def test_servo_torques_keep_their_limit(short_walk, athena):
    assert np.abs(short_walk.joint_torque).max() <= athena.servo.max_torque + 1e-9


def test_readings_place_the_body_frame_not_its_centre_of_mass(edited):
    robot = edited("athena", lopsided)
    T = pose(hk.transforms.axis_rotation([0, 1, 0], 0.3), [1.0, 2.0, 3.0])
    with bullet(robot, hk.terrain.Plane(), time_step=1e-6) as engine:
        engine.place(T, robot.standing_q)
        reading = engine.advance(robot.standing_q, 1)
    assert reading.T_world_body == pytest.approx(T, abs=1e-8)


def test_an_unknown_engine_is_named():
    with pytest.raises(UnknownNameError, match="unknown engine 'gazebo'; known: mujoco, pybullet, rigid"):
        engine_class("gazebo")


@pytest.mark.parametrize("option", [{"time_step": 0.0}, {"friction": -1.0}, {"restitution": 2.0}])
def test_impossible_options_are_named(athena, option):
    with pytest.raises(InvalidInputError, match=next(iter(option))):
        bullet(athena, hk.terrain.Plane(), **option)


def test_the_imu_turns_with_the_body_and_velocities_are_of_its_origin(edited):
    """A spun, lopsided robot in free fall: rates in the body frame, velocity of the origin."""
    import pybullet

    robot = edited("athena", lopsided)
    R = hk.transforms.rpy_rotation([0.4, -0.3, 1.1])
    omega_world = np.array([0.3, -0.8, 0.5])
    with bullet(robot, hk.terrain.Plane(), time_step=1e-5) as engine:
        engine.place(pose(R, [0.0, 0.0, 3.0]), robot.standing_q)
        pybullet.resetBaseVelocity(engine._body, [0.0] * 3, omega_world.tolist(), physicsClientId=engine._client)
        reading = engine.advance(robot.standing_q, 1)
    # In one step of 10 us the rate changes by less than 1e-3 of itself through gyroscopic and servo torques.
    assert reading.body_angular_velocity == pytest.approx(R.T @ omega_world, abs=5e-3)
    expected = -np.cross(reading.T_world_body[:3, :3] @ reading.body_angular_velocity, R @ robot.torso.center_of_mass)
    assert reading.body_velocity == pytest.approx(expected, abs=2e-3)


def drop(athena, q, height, steps=1000, **options):
    with bullet(athena, hk.terrain.Plane(), **options) as engine:
        engine.place(pose(np.eye(3), [0, 0, height]), q)
        return [engine.advance(q, 10) for _ in range(steps // 10)]


def test_a_robot_on_its_torso_is_told_from_one_on_its_limbs(athena):
    raised = athena.standing_q.copy()
    raised[:, 1], raised[:, 2] = 1.2, -0.3
    on_torso = drop(athena, raised, 0.03)[-1]
    assert on_torso.torso_force == pytest.approx(athena.mass * GRAVITY, rel=0.05)
    assert on_torso.limb_force == on_torso.foot_force.sum() == 0.0
    kneeling = athena.standing_q.copy()
    kneeling[:, 1], kneeling[:, 2] = -1.2, 1.4
    on_knees = drop(athena, kneeling, 0.12)[-1]
    assert on_knees.limb_force > 5.0 and on_knees.torso_force == 0.0


def test_restitution_sends_a_dropped_robot_up_again_and_the_contact_is_seen(athena):
    """Dropped flat on its torso by 200 mm; legs and servos take much of the rebound, without restitution all of it."""
    raised, speeds = athena.standing_q.copy(), {}
    raised[:, 1], raised[:, 2] = 1.2, -0.3
    for restitution in (0.0, 0.5):
        readings = drop(athena, raised, 0.228, steps=400, restitution=restitution)
        speeds[restitution] = max(reading.body_velocity[2] for reading in readings)
        assert max(reading.penetration for reading in readings) > 0.0
    assert speeds[0.0] < 0.05 < 0.25 < speeds[0.5] < 1.0


def test_a_failed_start_leaves_no_simulator_behind(athena):
    import pybullet

    before = pybullet.connect(pybullet.DIRECT)
    pybullet.disconnect(before)
    for _ in range(3):
        with pytest.raises(InvalidInputError, match="solver_iterations"):
            bullet(athena, hk.terrain.Plane(), solver_iterations=-5)
        with pytest.raises(InvalidInputError, match=r"foot\.radius"):
            bullet(hk.load_robot("hwr"), hk.terrain.Plane())
    after = pybullet.connect(pybullet.DIRECT)
    pybullet.disconnect(after)
    assert after == before


# Large height fields -------------------------------------------------------------------------------------------


def heights_in(engine, xy, around):
    """Heights (n,) [m] at which vertical rays of PyBullet meet the ground at ``xy`` (n, 2) [m]; NaN where none is.

    The rays are one metre above and below the height ``around`` [m]. The robot is moved out of their way.
    """
    import pybullet

    pybullet.resetBasePositionAndOrientation(
        engine._body, [0, 0, around + 9], [0, 0, 0, 1], physicsClientId=engine._client
    )
    ends = [np.column_stack([xy, np.full(len(xy), z)]).tolist() for z in (around + 1.0, around - 1.0)]
    found = pybullet.rayTestBatch(*ends, physicsClientId=engine._client)
    return np.array([ray[3][2] if ray[0] >= 0 else np.nan for ray in found])


@pytest.mark.parametrize("offset", [0.0, 400.0])
def test_a_large_field_has_the_triangles_of_its_terrain_where_the_robot_is(athena, rng, offset):
    """Cells of 4 mm x 5 mm, at a height at which single precision rounds to 0.03 mm; no whole number of tiles."""
    x, y = np.arange(333) * 0.004 - 0.5, np.arange(301) * 0.005 - 0.7
    waves = 0.01 * np.sin(9.0 * x[:, None]) + 0.01 * np.cos(7.0 * y)
    field = hk.terrain.HeightField(x, y, offset + waves + rng.uniform(0.0, 0.003, (333, 301)))
    xy = rng.uniform(-0.15, 0.15, (200, 2))
    with bullet(athena, field) as engine:
        assert np.isnan(heights_in(engine, xy, offset)).all()  # nothing is made before the robot is there
        for place in ([0.0, 0.0], [0.55, -0.5]):
            T = pose(np.eye(3), [*place, offset + 0.15])
            engine.place(T, athena.standing_q)
            here = np.clip(xy + place, [x[0], y[0]], [x[-1], y[-1]])
            np.testing.assert_allclose(heights_in(engine, here, offset), field.height(*here.T), atol=1e-7)


def test_a_robot_walks_on_a_large_field_as_on_the_same_coarse_field(athena):
    """A mesh of 50 mm cells and tiles of 2 mm cells, of which the robot needs more while it walks: the same slope."""
    distances = []
    for points in (41, 1001):
        grid = np.linspace(-1.0, 1.0, points)
        field = hk.terrain.HeightField(grid, grid, 0.1 * grid[:, None] + 0.05 * grid)
        walk = hk.simulate(athena, field, hk.PostureController(athena), engine="pybullet", duration=5.0)
        distances.append(walk.T_world_body[-1, :3, 3] - walk.T_world_body[0, :3, 3])
    assert np.linalg.norm(distances[0]) > 0.15
    np.testing.assert_allclose(distances[0], distances[1], atol=0.01)
