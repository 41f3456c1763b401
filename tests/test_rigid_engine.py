"""ATHENA on the rigid engine: standing, walking, dragging, and the books of energy."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.engines import engine_class
from hexakin.engines.rigid_engine import RigidEngine
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.robot.model import GRAVITY
from hexakin.simulation.closed_loop import starting_pose, torso_height
from hexakin.transforms import pose


def standing(robot, terrain, seconds=0.5, **options):
    engine = RigidEngine(robot, terrain, **options)
    engine.place(starting_pose(robot, terrain, robot.standing_q), robot.standing_q)
    engine.advance(robot.standing_q, round(seconds / options.get("time_step", 1e-3)))
    return engine


def walk(robot, terrain, duration, controller=None, **options):
    return hk.simulate(
        robot, terrain, controller or hk.PostureController(robot), engine="rigid", duration=duration, **options
    )


@pytest.fixture(scope="module")
def ramp_walk(athena):
    return walk(athena, hk.terrain.Ramp(), 8.0)


# Standing --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["athena", "athena_physical"])
def test_standing_feet_share_the_weight(name):
    robot = hk.load_robot(name)
    reading = standing(robot, hk.terrain.Plane()).advance(robot.standing_q, 200)
    assert reading.foot_force.sum() == pytest.approx(robot.mass * GRAVITY, rel=1e-6)
    assert (reading.foot_force > 0.0).all()
    assert reading.torso_force == reading.limb_force == 0.0


def test_six_redundant_feet_share_evenly(athena):
    """The laws leave the split free; the compliance takes the most even one."""
    force = standing(athena, hk.terrain.Plane()).advance(athena.standing_q, 100).foot_force
    assert force == pytest.approx(np.full(6, athena.mass * GRAVITY / 6), rel=0.01)


def test_standing_feet_and_torso_keep_still(athena):
    plane = hk.terrain.Plane()
    engine = standing(athena, plane)
    first = engine.advance(athena.standing_q, 1)
    last = engine.advance(athena.standing_q, 5000)
    assert torso_height(plane, last.T_world_body) == pytest.approx(0.104, abs=1e-4)
    # The compliance lets loaded contacts creep by about compliance g h = 1e-8 m/s.
    assert last.T_world_body == pytest.approx(first.T_world_body, abs=1e-6)
    assert np.abs(last.body_angular_velocity).max() < 1e-6


@pytest.mark.parametrize("slope_deg, holds", [(41.0, True), (43.0, False)])
def test_a_robot_on_a_slope_holds_up_to_the_friction_angle(athena, slope_deg, holds):
    """Friction 0.9 holds up to atan(0.9) = 41.99 degrees."""
    ramp, q = hk.terrain.Ramp(slope=np.radians(slope_deg)), athena.standing_q
    engine = standing(athena, ramp)
    before = engine.advance(q, 1).T_world_body[:3, 3]
    after = engine.advance(q, 500).T_world_body[:3, 3]
    assert (np.linalg.norm(after - before) < 1e-4) == holds


def test_a_falling_robot_accelerates_by_gravity(athena):
    engine = RigidEngine(athena, hk.terrain.Plane())
    engine.place(pose(np.eye(3), [0, 0, 5.0]), athena.standing_q)
    reading = engine.advance(athena.standing_q, 200)
    assert reading.body_velocity == pytest.approx([0, 0, -GRAVITY * 0.2], abs=1e-9)
    assert reading.T_world_body[2, 3] == pytest.approx(5.0 - 0.5 * GRAVITY * 0.04, abs=1e-9)
    assert reading.foot_force.sum() == 0.0


# Servos ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("time_step", [1e-4, 1e-3, 1e-2])
def test_a_servo_closes_its_error_at_its_rate(athena, time_step):
    q = athena.standing_q
    target = q + [0.0, 0.1, 0.0]
    engine = RigidEngine(athena, hk.terrain.Plane(), time_step=time_step)
    engine.place(pose(np.eye(3), [0, 0, 5.0]), q)
    reading = engine.advance(target, round(0.1 / time_step))
    error = target[:, 1] - reading.q[:, 1]
    # exp(-rate t), begun half a step late and, for the torque limit, a few milliseconds.
    assert error == pytest.approx(
        np.full(6, 0.1 * np.exp(-athena.servo.rate * 0.1)), rel=athena.servo.rate * (0.5 * time_step + 2e-3)
    )
    assert (error > 0.0).all()


def test_a_servo_does_not_overshoot_at_the_longest_step(athena):
    """The servo's own rate: 50 ms is a whole time constant."""
    engine = RigidEngine(athena, hk.terrain.Plane(), time_step=0.05)
    engine.place(pose(np.eye(3), [0, 0, 50.0]), athena.standing_q)
    target = athena.standing_q + [0.0, 0.1, 0.0]
    errors = [(target - engine.advance(target, 1).q)[0, 1] for _ in range(12)]
    assert min(errors) > -1e-9 and errors[-1] < 1e-3


def test_servo_torques_keep_their_limit(ramp_walk, athena):
    assert np.abs(ramp_walk.joint_torque).max() <= athena.servo.max_torque * (1 + 1e-9)


def test_an_overloaded_servo_gives_way(edited):
    weak = edited("athena", lambda tree: tree["servo"].update(max_torque={"value": 0.05, "source": "test"}))
    engine = standing(weak, hk.terrain.Plane(), seconds=1.0)
    reading = engine.advance(weak.standing_q, 100)
    assert torso_height(hk.terrain.Plane(), reading.T_world_body) < 0.06
    assert np.abs(reading.joint_torque).max() == pytest.approx(0.05, rel=1e-6)


# Walking ---------------------------------------------------------------------------------------------------------


def test_contact_forces_are_found_to_the_tolerance_and_penetration_stays_small(ramp_walk):
    assert ramp_walk.solver_residual.max() < 1e-6
    assert np.median(ramp_walk.solver_residual) < 1e-8
    assert ramp_walk.penetration.max() < 1e-3
    assert np.isfinite(ramp_walk.foot_force).all()


def test_steps_that_miss_the_tolerance_are_counted(athena, ramp_walk):
    assert np.array_equal(ramp_walk.unsolved_steps > 0, ramp_walk.solver_residual > 1e-8)
    # The tolerance is below the rounding error: only steps without contact reach it. The polyhedron is not solved again
    # and again for it.
    tolerance = 1e-16
    ticks, steps = (RigidEngine(athena, hk.terrain.Plane(), solver_tolerance=tolerance, facets=4) for _ in range(2))
    counts = []
    for engine in (ticks, steps):
        engine.place(pose(np.eye(3), [0, 0, hk.kinematics.standing_height(athena) + 5e-4]), athena.standing_q)
    for _ in range(3):
        tick = ticks.advance(athena.standing_q, 20)
        every = [steps.advance(athena.standing_q, 1) for _ in range(20)]
        missed = [step.solver_residual > tolerance for step in every]
        assert [step.unsolved_steps for step in every] == missed
        assert tick.unsolved_steps == sum(missed)
        counts.append(sum(missed))
    assert 0 < sum(counts) < 60


def test_energy_changes_by_the_work_of_servos_less_dissipation(athena):
    errors = []
    for time_step in (2e-3, 5e-4):
        recording = walk(athena, hk.terrain.Ramp(), 4.0, time_step=time_step)
        work = np.cumsum(recording.servo_work + recording.contact_work)
        balance = (recording.energy - recording.energy[0]) - (work - work[0])
        spent = np.abs(recording.servo_work).sum()
        errors.append(np.abs(balance).max() / spent)
        assert (recording.contact_work <= 1e-9).all()
    assert errors[0] < 0.03
    assert errors[1] < 0.5 * errors[0]


def test_equal_runs_are_bit_identical(athena):
    first, second = (walk(athena, hk.terrain.Blocks(), 2.0, seed=3) for _ in range(2))
    for name in ("T_world_body", "q", "foot_force", "joint_torque", "energy", "solver_residual"):
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


def test_a_dragging_torso_is_seen(athena):
    """Simple control sinks by 3 mm a cycle; started low, the torso touches within a few."""
    q = athena.standing_q + [0.0, 0.75, 0.0]
    engine = RigidEngine(athena, hk.terrain.Plane())
    engine.place(pose(np.eye(3), [0, 0, 0.05]), q)
    reading = engine.advance(q, 1500)
    low = torso_height(hk.terrain.Plane(), reading.T_world_body)
    assert low == pytest.approx(athena.torso.size[2] / 2, abs=1e-3)
    reading = engine.advance(q, 100)
    assert reading.torso_force > 0.5 * athena.mass * GRAVITY
    assert reading.torso_force + reading.limb_force + reading.foot_force.sum() == pytest.approx(
        athena.mass * GRAVITY, rel=1e-3
    )


@pytest.mark.parametrize("terrain", [hk.terrain.Plane(z=0.04), hk.terrain.Blocks(heights=(0.04, 0.04))], ids=repr)
def test_a_torso_lies_on_a_block_as_on_a_plane(athena, terrain):
    q = athena.standing_q + [0.0, 0.75, 0.0]
    engine = RigidEngine(athena, terrain, restitution=0.0)
    engine.place(pose(np.eye(3), [0.02, 0.03, 0.09]), q)
    reading = engine.advance(q, 1500)
    assert torso_height(terrain, reading.T_world_body) == pytest.approx(0.028, abs=1e-3)
    assert engine.advance(q, 100).torso_force > 0.0


def test_a_foot_is_stopped_by_a_side_face(edited, athena):
    """The robot is pushed against a wall of blocks by its legs' swing: feet touch it and do not go through."""
    terrain = hk.terrain.Blocks(size=0.1, heights=(0.3, 0.3), level=0.0, extent=(0.3, 0.5, -0.5, 0.5))
    q = athena.standing_q
    engine = RigidEngine(athena, terrain)
    engine.place(pose(np.eye(3), [0.0, 0.0, 0.105]), q)
    wall = float(terrain.x_edges[0])
    for _ in range(20):
        reading = engine.advance(q + [0.0, 0.0, 0.7], 50)
    feet = hk.forward_kinematics(athena, reading.q) @ reading.T_world_body[:3, :3].T + reading.T_world_body[:3, 3]
    reached = feet[:, 0].max() + athena.foot_radius
    assert reached < wall + 1e-3


@pytest.mark.pybullet
def test_rigid_and_pybullet_agree_on_height_and_distance(athena, ramp_walk):
    other = hk.simulate(athena, hk.terrain.Ramp(), hk.PostureController(athena), engine="pybullet", duration=8.0)
    assert np.median(ramp_walk.height) == pytest.approx(np.median(other.height), abs=2e-3)
    ours, theirs = (r.T_world_body[-1, :3, 3] - r.T_world_body[0, :3, 3] for r in (ramp_walk, other))
    assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(theirs), rel=0.1)


def test_height_and_contacts_converge_with_the_step(athena):
    """From 2 ms on, halving the step moves the median height by less each time, and by under a millimetre."""
    heights, contacts = [], []
    for time_step in (2e-3, 1e-3, 5e-4, 2.5e-4):
        recording = walk(athena, hk.terrain.Ramp(), 4.0, time_step=time_step)
        heights.append(np.median(recording.height))
        contacts.append((recording.foot_force > 0.0).mean())
    changes = np.abs(np.diff(heights))
    assert changes[-1] < 3e-4 and changes.max() < 1e-3
    assert np.abs(np.diff(contacts))[-1] < 0.02


def test_the_papers_step_of_50_ms_neither_falls_nor_fails(athena):
    recording = walk(athena, hk.terrain.Ramp(), 2.0, time_step=0.05)
    assert np.median(recording.height) == pytest.approx(0.102, abs=4e-3)
    assert recording.penetration.max() < 5e-3 and recording.torso_force.max() == 0.0


def test_ten_minutes_of_walking_keep_their_books(athena):
    recording = walk(athena, hk.terrain.Plane(), 600.0, time_step=0.002)
    for name in ("T_world_body", "q", "foot_force", "energy"):
        assert np.isfinite(getattr(recording, name)).all()
    assert recording.penetration.max() < 3e-3
    work = (recording.servo_work + recording.contact_work)[1:].sum()
    spent = np.abs(recording.servo_work).sum()
    assert recording.energy[-1] - recording.energy[0] == pytest.approx(work, abs=0.03 * spent)


@pytest.mark.parametrize("law", ["poisson", "newton"])
def test_a_robot_on_a_height_field_walks_as_on_the_ramp(athena, law):
    grid = np.linspace(-1.5, 1.5, 61)
    slope = np.tan(np.pi / 18)
    field = hk.terrain.HeightField(grid, grid, 0.0 * grid[:, None] + slope * grid[None, :])
    on_field, on_ramp = (walk(athena, t, 2.0, restitution_law=law) for t in (field, hk.terrain.Ramp()))
    assert on_field.T_world_body[-1] == pytest.approx(on_ramp.T_world_body[-1], abs=2e-3)
    assert on_field.foot_force.sum(axis=1) == pytest.approx(on_ramp.foot_force.sum(axis=1), abs=8.0)


@pytest.mark.parametrize("facets", [4, 8])
def test_the_papers_polyhedron_walks_too(athena, facets):
    recording = walk(athena, hk.terrain.Ramp(), 1.0, facets=facets)
    assert np.median(recording.height) == pytest.approx(0.104, abs=2e-3)
    assert np.median(recording.solver_residual) < 1e-8


@pytest.mark.pybullet
def test_robots_with_products_of_inertia_fall_and_stand_as_in_pybullet(edited):
    def lopsided(tree):
        tree["torso"]["center_of_mass_mm"] = [5, -10, 20]
        tree["torso"]["inertia"].update(xy=3e-4, xz=-2e-4)

    robot = edited("athena", lopsided)
    force = standing(robot, hk.terrain.Plane()).advance(robot.standing_q, 100).foot_force
    with engine_class("pybullet")(robot, hk.terrain.Plane()) as engine:
        engine.place(starting_pose(robot, hk.terrain.Plane(), robot.standing_q), robot.standing_q)
        engine.advance(robot.standing_q, 1000)
        other = engine.advance(robot.standing_q, 200).foot_force
    feet = hk.forward_kinematics(robot, robot.standing_q)[:, :2]
    assert force @ feet / force.sum() == pytest.approx(other @ feet / other.sum(), abs=2e-3)


# Errors ----------------------------------------------------------------------------------------------------------


def test_bad_options_are_named(athena, edited):
    plane = hk.terrain.Plane()
    with pytest.raises(InvalidInputError, match="time_step"):
        RigidEngine(athena, plane, time_step=-1.0)
    with pytest.raises(UnknownNameError, match="restitution_law"):
        RigidEngine(athena, plane, restitution_law="hertz")
    with pytest.raises(UnknownNameError, match="frction"):
        walk(athena, plane, 1.0, frction=0.5)
    with pytest.raises(InvalidInputError, match=r"foot.radius"):
        RigidEngine(edited("athena", lambda tree: tree["foot"]["radius_mm"].update(value=0)), plane)
    with pytest.raises(InvalidInputError, match="q_command"):
        RigidEngine(athena, plane).advance(np.full((6, 3), np.nan), 1)
