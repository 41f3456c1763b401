"""Gaits of any duty factor, and walking by velocity commands."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.control.standing_up import lying_q
from hexakin.control.steering import SteeringController, Twist
from hexakin.exceptions import HexakinError, InvalidInputError, JointLimitError, UnknownNameError, UnreachableError
from hexakin.feasibility import commanded_walk
from hexakin.motion.measures import slips
from hexakin.walking.gait import GAITS, Gait, gait_of, in_groups, wave

PLANE = hk.terrain.Plane()


@pytest.mark.parametrize("name", GAITS)
@pytest.mark.parametrize("robot", ["athena", "hwr"])
def test_every_leg_of_a_named_gait_swings_once_a_cycle_for_its_share(robot, name):
    gait = gait_of(hk.load_robot(robot), name)
    share = gait.swing_share(np.linspace(0.0, 1.0, 1200, endpoint=False))
    swinging = ~np.isnan(share)
    np.testing.assert_allclose(swinging.mean(axis=0), 1.0 - gait.duty_factor, atol=2e-3)
    starts = swinging & ~np.roll(swinging, 1, axis=0)
    assert (starts.sum(axis=0) == 1).all() and (share[starts] < 0.01).all()
    assert (6 - swinging.sum(axis=1)).min() == gait.fewest_carrying == {"tripod": 3, "wave": 5}.get(name, 4)


def test_swings_of_a_wave_run_from_the_rear_forwards_on_each_side(athena):
    gait, names = wave(athena), [leg.name for leg in athena.legs]
    for side in ("left", "right"):
        times = [gait.offsets[names.index(f"{side} {place}")] for place in ("rear", "middle", "front")]
        np.testing.assert_allclose(np.mod(np.diff(times), 1.0), 1 / 6)


def test_a_wave_of_one_half_has_the_tripods_groups(athena):
    assert wave(athena, 0.5).groups == hk.gait.tripod(athena).groups
    assert hk.gait.tripod(athena).has_equal_phases and not hk.gait.ripple(athena).has_equal_phases


def test_gaits_that_cannot_be_are_refused_by_name(athena):
    with pytest.raises(UnknownNameError, match="gallop"):
        gait_of(athena, "gallop")
    with pytest.raises(InvalidInputError, match="hop leaves 0 legs"):
        gait_of(athena, Gait("hop", 0.5, (0.0,) * 6))
    with pytest.raises(InvalidInputError, match="pace is for 4 legs"):
        gait_of(athena, in_groups("pace", ((0, 1), (2, 3))))
    for duty_factor, offsets in ((0.0, (0.0,)), (1.0, (0.0,)), (0.5, (1.0,)), (0.5, (-0.1,)), (0.5, ())):
        with pytest.raises(InvalidInputError, match="odd"):
            Gait("odd", duty_factor, offsets)


def test_strokes_that_cannot_be_made_are_refused_by_leg(athena):
    with pytest.raises((UnreachableError, JointLimitError), match="leg"):
        SteeringController(athena, Twist(0.2, 0.0, 0.0))
    with pytest.raises((UnreachableError, JointLimitError), match="leg"):
        SteeringController(athena, Twist(0.0, 0.0, 1.5))
    with pytest.raises(InvalidInputError, match="twist"):
        SteeringController(athena, Twist(np.nan, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match="twist"):
        SteeringController(athena, "forwards")


@pytest.mark.parametrize(
    "twist", ["forwards", ("0.01", "0", "0"), (0.0, 0.0), (10**400, 0, 0), [[0.0], [1.0, 2.0]], 1j]
)
def test_commands_that_are_not_three_numbers_are_named(athena, twist):
    for given in (twist, lambda time: twist):
        with pytest.raises(InvalidInputError, match=r"twist: expected .*Twist"):
            SteeringController(athena, given).command_at(0.0)


def test_a_function_of_something_else_than_time_is_no_command(athena):
    with pytest.raises(InvalidInputError, match="twist: expected a function of time"):
        SteeringController(athena, lambda: Twist(0.01))


def walked(robot, controller, cycles, **options):
    return hk.simulate(
        robot, PLANE, controller, engine="rigid", time_step=0.002, max_cycles=cycles, duration=60.0, **options
    )


def mean_velocity(recording, cycles, cycle_duration):
    """Forward, left and turning velocity between two instants a whole number of cycles apart."""
    start, end = np.searchsorted(recording.time, np.array(cycles) * cycle_duration + 1.0)
    T = hk.transforms.inverse_pose(recording.T_world_body[start]) @ recording.T_world_body[end]
    span = recording.time[end] - recording.time[start]
    forward = recording.forward
    return np.array([T[:3, 3] @ forward, -T[:3, 3] @ recording.right, np.arctan2(T[1, 0], T[0, 0])]) / span


@pytest.mark.parametrize(
    ("gait", "cycle", "twist"),
    [
        ("tripod", 2.0, Twist(0.02, 0.0, 0.0)),
        ("tetrapod", 2.0, Twist(0.0, -0.02, 0.0)),
        ("ripple", 3.0, Twist(-0.014, 0.014, 0.0)),
        ("tripod", 2.0, Twist(0.0, 0.0, 0.12)),
    ],
)
def test_the_body_moves_as_commanded_in_simulation(athena, gait, cycle, twist):
    recording = walked(athena, SteeringController(athena, twist, gait, cycle_duration=cycle), 6)
    found = mean_velocity(recording, (2, 5), cycle)
    np.testing.assert_allclose(found, twist, atol=0.1 * np.abs(twist).max())
    assert recording.torso_force.max() == 0.0 and np.median(slips(recording)) < 0.005


def test_commands_may_change_on_the_way_and_a_stopped_robot_stands_on_all_feet_at_home(athena):
    def command(time):
        return Twist(0.02, 0.0, 0.0) if time < 6.0 else Twist(0.0, 0.0, 0.1) if time < 12.0 else Twist()

    controller = SteeringController(athena, command)
    recording = walked(athena, controller, 12)
    assert recording.stance[-60:].all(), "nobody swings any more"
    np.testing.assert_allclose(recording.p_body_foot[-1], controller.home, atol=5e-3)
    still = recording.T_world_body[-40:, :3, 3]
    assert np.ptp(still, axis=0).max() < 1e-3
    plan = commanded_walk(controller, PLANE, num_cycles=12)
    jumps = np.linalg.norm(np.diff(plan.p_body_foot, axis=0), axis=-1)
    assert jumps.max() < 0.02, "no foot jumps when the command does"


@pytest.mark.parametrize("gait", GAITS)
def test_no_joint_jumps_when_walking_begins(athena, gait):
    """Nor a leg whose swing, by its phase offset, would already be under way."""
    plan = commanded_walk(SteeringController(athena, Twist(0.01), gait, cycle_duration=4.0), PLANE, num_cycles=2)
    speed = np.abs(np.diff(plan.q, axis=0)).max(axis=(1, 2)) / np.diff(plan.time)
    assert speed[:40].max() <= 1.05 * speed[40:].max()


def test_a_robot_that_lies_low_rises_first(athena):
    controller = SteeringController(athena, rise_duration=2.0, body_height=0.12)
    recording = walked(athena, controller, 2)
    assert recording.height[0] < 0.106 and recording.height[-1] == pytest.approx(0.12, abs=3e-3)
    assert np.diff(recording.height[:40]).max() < 0.002, "without a jerk"


@pytest.mark.parametrize("engine", ["rigid", "pybullet", "mujoco"])
@pytest.mark.parametrize("name", ["athena", "phantomx"])
def test_a_robot_that_lies_on_its_torso_stands_up_and_walks(name, engine):
    robot = hk.load_robot(name)
    controller = SteeringController(robot, Twist(0.015), "ripple", cycle_duration=3.0, rise_duration=3.0)
    recording = hk.simulate(
        robot, PLANE, controller, engine=engine, time_step=0.002, max_cycles=2, duration=20.0,
        q_start=lying_q(robot),
    )  # fmt: skip
    weight = robot.mass * hk.dynamics.GRAVITY
    carried = recording.torso_force[0] + recording.limb_force[0]  # the phantomx lies on its coxae
    assert carried == pytest.approx(weight, rel=0.1) and recording.foot_force[0].max() == 0.0
    standing = recording.time > 3.2
    assert recording.torso_force[standing].max() == 0.0
    assert recording.height[standing] == pytest.approx(-controller.home[0, 2] + robot.foot_radius, abs=6e-3)
    risen = int(np.searchsorted(recording.time, 3.0))
    assert np.linalg.norm(recording.T_world_body[risen, :2, 3]) < 3e-3, "it rises where it lay"
    assert recording.T_world_body[-1, :3, 3] @ robot.forward > 0.03
    assert np.diff(recording.height).max() < 2.5 * 0.12 / 1.5 / 20.0, "without a jerk"


def test_a_robot_that_lies_in_a_pose_it_cannot_have_is_named(athena):
    q = np.array(athena.standing_q)
    q[2, 1] = 3.0
    with pytest.raises(JointLimitError, match="leg 3"):
        hk.simulate(athena, PLANE, SteeringController(athena), q_start=q)
    with pytest.raises(InvalidInputError, match="q_start"):
        hk.simulate(athena, PLANE, SteeringController(athena), q_start=q[:4])


def test_rolling_feet_touch_the_ground_at_rest(athena):
    """A foot's centre moves in the world while it rolls; the point that touches does not."""
    from hexakin.kinematics import joint_axes

    controller = SteeringController(athena, Twist(0.0, 0.02, 0.0), rise_duration=0.0)
    plan = commanded_walk(controller, PLANE, num_cycles=4)
    at = slice(130, 139)  # stance of legs 2, 4, 6
    legs = np.flatnonzero(plan.carrying[at].all(axis=0))
    assert len(legs) == 3
    dt = plan.time[1] - plan.time[0]
    for k in range(at.start, at.stop - 1):
        q = 0.5 * (plan.q[k] + plan.q[k + 1])
        rate = (plan.q[k + 1] - plan.q[k]) / dt
        spin = np.einsum("lij,lj->li", joint_axes(athena, q), rate)
        lever = np.array([0.0, 0.0, -athena.foot_radius])
        touching = np.einsum("lij,lj->li", hk.jacobian(athena, q), rate) + np.cross(spin, lever)
        wanted = controller.velocity(controller.twist, hk.forward_kinematics(athena, q) + lever)
        np.testing.assert_allclose(touching[legs], wanted[legs], atol=2e-5)


@pytest.mark.parametrize("name", ["cycle_duration", "apex", "body_height", "response", "rise_duration"])
def test_parameters_out_of_range_are_named(athena, name):
    with pytest.raises(HexakinError, match=name):
        SteeringController(athena, **{name: -1.0})


@pytest.mark.parametrize(("legs", "gait"), [(4, "wave"), (8, "ripple")])
def test_robots_of_four_and_eight_legs_walk(athena, legs, gait):
    import dataclasses

    from hexakin.robot.model import Leg

    angles = np.linspace(1.0, -1.0, legs // 2)
    values = [{**athena.legs[0].values, "theta_1": theta, "l_1": 0.11} for a in angles for theta in (a, np.pi - a)]
    robot = dataclasses.replace(
        athena, name=f"{legs} legs", legs=tuple(Leg(f"leg {k}", v) for k, v in enumerate(values)),
        joint_limits=np.repeat(athena.joint_limits[:1], legs, axis=0),
        standing_q=np.repeat(athena.standing_q[:1], legs, axis=0),
    )  # fmt: skip
    cycle = 4.0 if legs == 4 else 3.0
    recording = walked(robot, SteeringController(robot, Twist(0.012), gait, cycle_duration=cycle), 4)
    np.testing.assert_allclose(mean_velocity(recording, (2, 3), cycle), [0.012, 0.0, 0.0], atol=0.0018)
    assert recording.torso_force.max() == 0.0
    with pytest.raises(InvalidInputError, match="6"):
        SteeringController(robot, gait="tripod")


def test_a_leg_that_is_stretched_straight_stops_no_walk(athena):
    from hexakin.control.interface import Observation

    controller = SteeringController(athena, Twist(0.0, 0.02, 0.0), rise_duration=0.0)
    straight = np.array(athena.standing_q)
    straight[:, 1:] = [-0.5, 0.0]  # femur and tibia in line: the Jacobian is singular
    run = controller.start(Observation.at_rest(0.0, straight, np.ones(6), 0.1), 20.0)
    for tick in range(40):
        command = run.command(Observation.at_rest(tick / 20.0, straight, np.ones(6), 0.1))
        assert np.isfinite(command.q).all()


@pytest.mark.parametrize(("gait", "cycle"), [("tripod", 2.0), ("ripple", 3.0)])
def test_a_foot_that_lifts_off_moves_with_the_ground_until_then(athena, gait, cycle):
    controller = SteeringController(athena, Twist(0.02), gait, cycle_duration=cycle, rise_duration=0.0)
    walk = commanded_walk(controller, PLANE, num_cycles=5, control_rate=20.0)
    steady = walk.time > 6.0
    steps, stance = np.diff(walk.p_body_foot[steady] @ athena.forward, axis=0), walk.carrying[steady]
    lifting = stance[:-1] & ~stance[1:]  # lift-offs fall on ticks here
    assert lifting.any()
    np.testing.assert_allclose(steps[lifting], -0.02 / 20.0, rtol=0.2)
