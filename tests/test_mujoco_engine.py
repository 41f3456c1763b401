"""Physics with known answers on the engine "mujoco", its contact parameters, and walks against engine "rigid"."""

from functools import cache

import numpy as np
import pytest

import hexakin as hk
from hexakin.engines import TorqueLaw, engine_class
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.robot.model import GRAVITY
from hexakin.simulation.closed_loop import starting_pose, torso_height
from hexakin.transforms import pose, transform_points

pytestmark = pytest.mark.mujoco


def mujoco_engine(*arguments, **options):
    return engine_class("mujoco")(*arguments, **options)


def standing(robot, terrain, seconds=1.0, **options):
    engine = mujoco_engine(robot, terrain, **options)
    engine.place(starting_pose(robot, terrain, robot.standing_q), robot.standing_q)
    engine.advance(robot.standing_q, round(1e3 * seconds))
    return engine


# Contacts --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["athena", "athena_physical", "phantomx"])
def test_standing_forces_sum_to_the_weight(name):
    robot = hk.load_robot(name)
    reading = standing(robot, hk.terrain.Plane()).advance(robot.standing_q, 500)
    assert reading.foot_force.sum() == pytest.approx(robot.weight, rel=1e-6)
    assert (reading.foot_force > 0.0).all()
    assert reading.foot_force_last.sum() == pytest.approx(robot.weight, rel=1e-6)
    assert reading.torso_force == reading.limb_force == 0.0


# The candidates of the criterion in the docstring of MujocoEngine, from soft to stiff.
IMPEDANCES, RATIOS, SMALLEST = (0.9, 0.95), (10.0, 100.0), 1e-4  # [m]


@cache
def yielding(name, **options):
    """Penetration and creep [m] of a standing robot in 7 s on a slope of 20 degrees, at 1 ms."""
    robot = hk.load_robot(name)
    engine = standing(robot, hk.terrain.Ramp(slope=np.radians(20.0)), **options)
    readings = [engine.advance(robot.standing_q, steps) for steps in (1, 7000, 1)]
    feet = [transform_points(r.T_world_body, hk.forward_kinematics(robot, r.q)) for r in readings]
    return readings[-1].penetration, np.linalg.norm(feet[1] - feet[0], axis=-1).max()


@pytest.mark.parametrize("name", ["athena", "athena_physical", "phantomx"])
def test_standing_feet_neither_sink_nor_creep_by_a_tenth_of_a_millimetre(name):
    assert max(yielding(name)) < SMALLEST


@pytest.mark.parametrize("soft", [{"impedance": 0.9}, {"impratio": 10.0}], ids=str)
def test_the_next_softer_contacts_sink_or_creep_more(soft):
    assert max(yielding("athena", **soft)) > SMALLEST


def test_standing_feet_do_not_creep_on_level_ground(athena):
    engine = standing(athena, hk.terrain.Plane())
    first, last = (engine.advance(athena.standing_q, steps) for steps in (1, 7000))
    feet = [transform_points(r.T_world_body, hk.forward_kinematics(athena, r.q)) for r in (first, last)]
    assert np.linalg.norm(feet[1] - feet[0], axis=-1).max() < 2e-6


@pytest.mark.parametrize(
    "friction, slope_deg, holds",
    [(0.1, 5.0, True), (0.1, 6.5, False), (0.9, 41.0, True), (0.9, 43.0, False), (1.5, 53.0, True), (1.5, 57.0, False)],
)
def test_a_robot_on_a_slope_holds_up_to_the_friction_angle(athena, friction, slope_deg, holds):
    """atan(friction): 5.7, 42.0 and 56.3 degrees; the docstring of MujocoEngine says why 55 are too steep for 1.5."""
    ramp, q = hk.terrain.Ramp(slope=np.radians(slope_deg)), athena.standing_q
    engine = standing(athena, ramp, friction=friction)
    before = engine.advance(q, 1).T_world_body[:3, 3]
    after = engine.advance(q, 500).T_world_body[:3, 3]
    assert (np.linalg.norm(after - before) < 1e-4) == holds


@pytest.mark.parametrize("friction", [3.0, 50.0])
def test_a_robot_walks_at_high_friction(athena, friction):
    recording = hk.simulate(
        athena, hk.terrain.Blocks(), hk.PostureController(athena), engine="mujoco", duration=4.0, friction=friction
    )
    assert np.median(recording.height) == pytest.approx(0.102, abs=4e-3)
    assert recording.penetration.max() < 1e-3 and recording.torso_force.max() == 0.0


def test_a_sliding_robot_has_coulombs_acceleration_but_hops(athena):
    """g (sin - mu cos) down the slope; the docstring of MujocoEngine says how much the contact force varies."""
    slope, friction = np.radians(30.0), 0.3
    engine = standing(athena, hk.terrain.Ramp(slope=slope), seconds=0.3, friction=friction)
    readings = [engine.advance(athena.standing_q, 1) for _ in range(600)]
    gained = (readings[-1].body_velocity - readings[0].body_velocity) / 0.599
    down = -np.array([0.0, np.cos(slope), np.sin(slope)])
    expected = GRAVITY * (np.sin(slope) - friction * np.cos(slope))
    assert gained @ down == pytest.approx(expected, rel=0.05)
    force = np.array([reading.foot_force.sum() for reading in readings]) / (athena.weight * np.cos(slope))
    assert force.mean() == pytest.approx(1.0, abs=0.05)
    assert 1.0 < force.std() < 4.0


def dropped(athena, **options):
    """Largest upward over largest downward speed of ATHENA dropped flat on its torso, with raised legs."""
    q = athena.standing_q.copy()
    q[:, 1], q[:, 2] = 1.2, -0.3
    engine = mujoco_engine(athena, hk.terrain.Plane(), **options)
    engine.place(pose(np.eye(3), [0.0, 0.0, 0.228]), q)
    speeds = [engine.advance(q, 2).body_velocity[2] for _ in range(200)]
    return max(speeds) / -min(speeds)


@pytest.mark.parametrize("restitution", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_a_dropped_robot_rebounds_with_its_restitution_within_five_percent_of_its_speed(athena, restitution):
    assert dropped(athena, restitution=restitution) == pytest.approx(restitution, abs=0.055)


def test_a_push_out_of_the_ground_at_mujocos_damping_ratio_would_be_a_rebound(athena):
    assert dropped(athena, restitution=0.0, damping_ratio=1.0) > 0.15


# Motion ----------------------------------------------------------------------------------------------------------


def lopsided(tree):
    """A torso whose centre of mass and principal axes are not those of the body frame."""
    tree["torso"]["center_of_mass_mm"] = [5, -10, 20]
    tree["torso"]["inertia"].update(xy=3e-4, xz=-2e-4)


def test_a_falling_robot_accelerates_by_gravity(edited):
    robot = edited("athena", lopsided)
    engine = mujoco_engine(robot, hk.terrain.Plane())
    engine.place(pose(np.eye(3), [0, 0, 5.0]), robot.standing_q)
    reading = engine.advance(robot.standing_q, 200)
    assert reading.body_velocity == pytest.approx([0, 0, -GRAVITY * 0.2], abs=1e-6)
    assert reading.foot_force.sum() == reading.penetration == 0.0


def test_readings_place_the_body_frame_and_turn_rates_into_it(edited):
    """One leg swings in free fall, which turns the body: finite differences of the poses are the velocities."""
    robot = edited("athena", lopsided)
    T = pose(hk.transforms.rpy_rotation([0.4, -0.3, 1.1]), [1.0, 2.0, 3.0])
    engine = mujoco_engine(robot, hk.terrain.Plane(), time_step=1e-5)
    engine.place(T, robot.standing_q)
    target = robot.standing_q.copy()
    target[0] += 0.3
    first, second = engine.advance(target, 500), engine.advance(target, 1)
    assert first.T_world_body == pytest.approx(T, abs=2e-3)
    turned = first.T_world_body[:3, :3].T @ second.T_world_body[:3, :3] / 1e-5
    rate = np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
    assert np.linalg.norm(rate) > 0.1
    assert second.body_angular_velocity == pytest.approx(rate, abs=1e-4)
    moved = (second.T_world_body[:3, 3] - first.T_world_body[:3, 3]) / 1e-5
    assert second.body_velocity == pytest.approx(moved, abs=1e-4)
    assert second.body_rate_moment == pytest.approx(np.outer(rate, rate), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("time_step", [1e-4, 1e-3, 1e-2])
def test_a_servo_closes_its_error_at_its_rate(athena, time_step):
    q = athena.standing_q
    target = q + [0.0, 0.1, 0.0]
    engine = mujoco_engine(athena, hk.terrain.Plane(), time_step=time_step)
    engine.place(pose(np.eye(3), [0, 0, 5.0]), q)
    reading = engine.advance(target, round(0.1 / time_step))
    error = target[:, 1] - reading.q[:, 1]
    # exp(-rate t), begun a few milliseconds late for the torque limit.
    assert error == pytest.approx(np.full(6, 0.1 * np.exp(-athena.servo.rate * 0.1)), rel=athena.servo.rate * 2e-3)
    assert (error > 0.0).all()


def test_joints_follow_the_same_commands_as_on_rigid(athena):
    """In free fall, with a command that differs for each joint; "rigid" begins half a time step late."""
    target = athena.standing_q + np.random.default_rng(4).uniform(-0.2, 0.2, (6, 3))
    readings = []
    for name in ("mujoco", "rigid"):
        with engine_class(name)(athena, hk.terrain.Plane()) as engine:
            engine.place(pose(np.eye(3), [0, 0, 5.0]), athena.standing_q)
            readings.append([engine.advance(target, 10) for _ in range(10)])
    fastest = max(np.abs(reading.joint_velocity).max() for reading in readings[1])
    for ours, theirs in zip(*readings, strict=True):
        assert ours.q == pytest.approx(theirs.q, abs=0.5e-3 * fastest)
        assert ours.joint_velocity == pytest.approx(theirs.joint_velocity, abs=0.01 * fastest)
        assert ours.joint_torque == pytest.approx(theirs.joint_torque, abs=0.01 * athena.servo.max_torque)


def test_an_overloaded_servo_gives_way_at_its_limit(edited):
    weak = edited("athena", lambda tree: tree["servo"].update(max_torque={"value": 0.05, "source": "test"}))
    reading = standing(weak, hk.terrain.Plane()).advance(weak.standing_q, 100)
    assert torso_height(hk.terrain.Plane(), reading.T_world_body) < 0.06
    assert np.abs(reading.joint_torque).max() == pytest.approx(0.05, rel=1e-6)


def test_a_torque_law_is_applied_within_the_limit_and_servos_return_after_it(athena):
    """A torque between two bodies leaves the whole robot's momentum as it is; the servo then holds the angles."""
    engine = mujoco_engine(athena, hk.terrain.Plane())
    engine.place(pose(np.eye(3), [0, 0, 50.0]), athena.standing_q)
    shape = athena.standing_q.shape
    law = TorqueLaw(np.full(shape, 2.0), np.full(shape, 0.01), np.zeros(shape))
    target = athena.standing_q + [0.0, 0.1, 0.0]
    reading = engine.advance(target, 1, law)
    assert reading.joint_torque == pytest.approx(2.0 * (target - athena.standing_q), abs=1e-12)
    strong = engine.advance(target, 1, TorqueLaw(*(1e3 * values for values in law)))
    assert np.abs(strong.joint_torque).max() == pytest.approx(athena.servo.max_torque)
    held = engine.advance(target, 1000)
    assert held.q == pytest.approx(target, abs=1e-4)
    assert held.servo_work != 0.0


@pytest.mark.parametrize("with_law", [False, True])
def test_energy_changes_by_the_work_of_servos_and_contacts(athena, with_law):
    """A drop by 46 mm, with servos or with a torque law; the balance closes with the time step."""
    law = TorqueLaw(np.full((6, 3), 20.0), np.full((6, 3), 0.02), np.zeros((6, 3))) if with_law else None
    errors = []
    for time_step in (1e-3, 2.5e-4):
        engine = mujoco_engine(athena, hk.terrain.Plane(), time_step=time_step)
        engine.place(pose(np.eye(3), [0.0, 0.0, 0.15]), athena.standing_q)
        readings = [engine.advance(athena.standing_q, round(0.02 / time_step), law) for _ in range(40)]
        work = sum(r.servo_work + r.contact_work for r in readings[1:])
        lost = readings[0].energy - readings[-1].energy
        assert lost > 0.5
        assert sum(r.contact_work for r in readings) < 0.0
        errors.append(abs(work + lost) / lost)
    assert errors[0] < 0.03 and errors[1] < 0.5 * errors[0]


def test_the_energy_is_that_of_the_dynamics(athena):
    from hexakin import dynamics

    engine = mujoco_engine(athena, hk.terrain.Plane())
    T = pose(hk.transforms.rpy_rotation([0.4, -0.3, 1.1]), [1.0, 2.0, 3.0])
    engine.place(T, athena.standing_q)
    r = engine.advance(athena.standing_q + 0.1, 37)
    configuration = dynamics.configuration(athena, r.T_world_body, r.q)
    base = np.r_[r.T_world_body[:3, :3].T @ r.body_velocity, r.body_angular_velocity]
    energies = dynamics.energies(athena, configuration, np.r_[base, r.joint_velocity.ravel()])
    assert r.energy == pytest.approx(sum(energies), rel=1e-9)


# Terrains --------------------------------------------------------------------------------------------------------


def test_a_robot_on_its_torso_is_told_from_one_on_its_limbs(athena):
    raised, kneeling = athena.standing_q.copy(), athena.standing_q.copy()
    raised[:, 1], raised[:, 2] = 1.2, -0.3
    kneeling[:, 1], kneeling[:, 2] = -1.2, 1.4
    readings = []
    for q, height in ((raised, 0.03), (kneeling, 0.12)):
        engine = mujoco_engine(athena, hk.terrain.Plane())
        engine.place(pose(np.eye(3), [0, 0, height]), q)
        engine.advance(q, 1000)
        readings.append(engine.advance(q, 100))
    on_torso, on_knees = readings
    assert on_torso.torso_force == pytest.approx(athena.weight, rel=0.01)
    assert on_torso.limb_force == on_torso.foot_force.sum() == 0.0
    assert on_knees.limb_force > 5.0 and on_knees.torso_force == 0.0


def rough(scale):
    """A field whose cells are far from flat, so that the diagonals of the cells matter."""
    x, y = np.linspace(-0.6, 0.6, 9), np.linspace(-0.8, 0.9, 12)
    return hk.terrain.HeightField(x, y, np.random.default_rng(3).uniform(0.0, scale, (len(x), len(y))))


TERRAINS = [
    hk.terrain.Plane(z=0.3),
    hk.terrain.Ramp(slope=0.2, heading=0.4),
    hk.terrain.Ramp(slope=0.2, start=0.05),
    hk.terrain.Blocks(),
    rough(0.1),
]


@pytest.mark.parametrize("terrain", TERRAINS, ids=repr)
def test_the_ground_is_where_the_terrain_says(athena, terrain):
    """Rays from above, as MuJoCo follows them through its own shapes."""
    import mujoco

    engine = mujoco_engine(athena, terrain)
    rng = np.random.default_rng(1)
    geom = np.zeros(1, np.int32)
    engine.place(pose(np.eye(3), [0.0, 0.0, 9.0]), athena.standing_q)  # above the rays
    mujoco.mj_kinematics(engine._model, engine._data)
    for x, y in rng.uniform(-0.55, 0.55, (200, 2)):
        from_above = np.array([x, y, 2.0])
        distance = mujoco.mj_ray(engine._model, engine._data, from_above, np.array([0.0, 0.0, -1.0]), None, 1, 1, geom)
        assert 2.0 - distance == pytest.approx(terrain.height(x, y), abs=1e-6)


@pytest.mark.parametrize("terrain", TERRAINS, ids=repr)
def test_feet_stand_on_the_ground_of_the_terrain(athena, terrain):
    """The lowest foot touches, and no foot is under the ground by more than soft contacts give way."""
    reading = standing(athena, terrain).advance(athena.standing_q, 1)
    feet = transform_points(reading.T_world_body, hk.forward_kinematics(athena, reading.q))
    # The surface of the sphere, at the points that lie deepest along the ground's normals nearby.
    around = feet[:, None] - athena.foot_radius * terrain.normal(
        *np.moveaxis(feet[:, None, :2] + np.random.default_rng(0).uniform(-0.02, 0.02, (200, 2)), -1, 0)
    )
    gap = hk.terrain.base.gaps(terrain, around).min(axis=-1)
    assert reading.foot_force.sum() > 0.9 * athena.weight
    assert gap.min() > -5e-4
    assert gap[reading.foot_force > 1.0].max() < 2e-3


def test_a_torso_lies_on_a_block_as_on_a_plane(athena):
    q = athena.standing_q + [0.0, 0.75, 0.0]
    for terrain in (hk.terrain.Plane(z=0.04), hk.terrain.Blocks(heights=(0.04, 0.04))):
        engine = mujoco_engine(athena, terrain, restitution=0.0)
        engine.place(pose(np.eye(3), [0.02, 0.03, 0.09]), q)
        reading = engine.advance(q, 1500)
        assert torso_height(terrain, reading.T_world_body) == pytest.approx(0.028, abs=1e-3)
        assert engine.advance(q, 100).torso_force > 0.0


# Walking ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def walks(athena):
    """Four gait cycles, up a ramp and over blocks, on the engines "mujoco" and "rigid"."""
    terrains = {"ramp": hk.terrain.Ramp(), "blocks": hk.terrain.Blocks()}
    return {
        (name, engine): hk.simulate(athena, terrain, hk.PostureController(athena), engine=engine, duration=8.0)
        for name, terrain in terrains.items()
        for engine in ("mujoco", "rigid")
    }


@pytest.mark.parametrize("name", ["ramp", "blocks"])
def test_walks_agree_with_rigid(walks, athena, name):
    """Height within 1 mm, distance within 5 %, joint errors within 3 %: contact laws differ, servos do not."""
    ours, theirs = walks[name, "mujoco"], walks[name, "rigid"]
    assert np.median(ours.height) == pytest.approx(np.median(theirs.height), abs=1e-3)
    moved = [np.linalg.norm(r.T_world_body[-1, :3, 3] - r.T_world_body[0, :3, 3]) for r in (ours, theirs)]
    assert moved[0] == pytest.approx(moved[1], rel=0.05)
    errors = [np.sqrt(np.mean((r.q[1:] - r.q_command[:-1]) ** 2)) for r in (ours, theirs)]
    assert errors[0] == pytest.approx(errors[1], rel=0.03)
    assert np.abs(ours.joint_torque).max() <= athena.servo.max_torque * (1 + 1e-9)
    assert ours.penetration.max() < 5e-4


def test_energy_changes_by_the_work_in_a_walk(walks):
    for name in ("ramp", "blocks"):
        recording = walks[name, "mujoco"]
        work = np.cumsum(recording.servo_work + recording.contact_work)
        balance = (recording.energy - recording.energy[0]) - (work - work[0])
        assert np.abs(balance).max() < 1e-3 * np.abs(recording.servo_work).sum()


def test_equal_runs_are_bit_identical(athena, walks):
    again = hk.simulate(athena, hk.terrain.Blocks(), hk.PostureController(athena), engine="mujoco", duration=2.0)
    for name in ("T_world_body", "q", "foot_force", "joint_torque", "energy", "contact_work"):
        first = getattr(walks["blocks", "mujoco"], name)
        assert np.array_equal(first[: len(again.time)], getattr(again, name)), name


def test_an_engine_that_is_placed_again_repeats_its_first_run(athena):
    engine = mujoco_engine(athena, hk.terrain.Plane())
    T = starting_pose(athena, hk.terrain.Plane(), athena.standing_q)
    runs = []
    for _ in range(2):
        engine.place(T, athena.standing_q)
        runs.append([engine.advance(athena.standing_q + 0.05, 50) for _ in range(4)])
    for first, second in zip(*runs, strict=True):
        assert np.array_equal(first.T_world_body, second.T_world_body)
        assert np.array_equal(first.foot_force, second.foot_force) and first.energy == second.energy


def test_the_recording_has_mujocos_version(walks):
    import mujoco

    assert walks["ramp", "mujoco"].parameters["versions"]["mujoco"] == mujoco.__version__


def test_a_coarse_step_walks_too(athena):
    recording = hk.simulate(
        athena, hk.terrain.Ramp(), hk.PostureController(athena), engine="mujoco", duration=4.0, time_step=0.005
    )
    assert np.median(recording.height) == pytest.approx(0.102, abs=4e-3)
    assert recording.torso_force.max() == 0.0


# Errors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "option",
    [
        {"time_step": 0.0},
        {"friction": -1.0},
        {"restitution": 2.0},
        {"impedance": 1.0},
        {"impratio": 0.0},
        {"damping_ratio": 0.5},
        {"solver_tolerance": 0.0},
        {"solver_iterations": 0},
    ],
    ids=str,
)
def test_impossible_options_are_named(athena, option):
    with pytest.raises(InvalidInputError, match=next(iter(option))):
        mujoco_engine(athena, hk.terrain.Plane(), **option)


def test_wrong_inputs_are_named(athena):
    engine = mujoco_engine(athena, hk.terrain.Plane())
    with pytest.raises(InvalidInputError, match="q_command"):
        engine.advance(np.full((6, 3), np.nan), 1)
    with pytest.raises(InvalidInputError, match="num_steps"):
        engine.advance(athena.standing_q, 0)
    with pytest.raises(InvalidInputError, match="torque_law: kd"):
        engine.advance(athena.standing_q, 1, TorqueLaw(np.zeros((6, 3)), np.zeros(3), np.zeros((6, 3))))
    with pytest.raises(InvalidInputError, match="T_world_body"):
        engine.place(2.0 * np.eye(4), athena.standing_q)
    with pytest.raises(InvalidInputError, match=r"foot\.radius"):
        mujoco_engine(hk.load_robot("hwr"), hk.terrain.Plane())
    with pytest.raises(UnknownNameError, match="facets"):
        hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), engine="mujoco", facets=4)


class Tetrahedron(hk.terrain.Plane):
    """A terrain with a triangle mesh of its own."""

    def shapes(self):
        vertices = np.array([[0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])
        return (hk.terrain.base.TriangleMesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])),)


def test_another_mesh_than_that_of_a_height_field_is_refused_by_name(athena):
    with pytest.raises(InvalidInputError, match='terrain: engine "mujoco" takes no triangle mesh but that of a Height'):
        mujoco_engine(athena, Tetrahedron())


def test_a_state_that_is_not_finite_is_an_error_and_leaves_no_file(athena, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    engine = standing(athena, hk.terrain.Plane())
    for speed in (1e9, np.nan):
        engine._data.qvel[:] = speed
        with pytest.raises(SimulationError, match=r"mujoco: .* at a time step of 0\.001 s; use a smaller one"):
            engine.advance(athena.standing_q, 20)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")
    engine.place(starting_pose(athena, hk.terrain.Plane(), athena.standing_q), athena.standing_q)
    assert np.isfinite(engine.advance(athena.standing_q, 100).energy)
