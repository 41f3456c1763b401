"""A controller of one's own: what it is given, what it may answer, and torques instead of servos."""

from pathlib import Path

import numpy as np
import pytest

import hexakin as hk
from hexakin.control.interface import check_command
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility import commanded_walk, distribute
from hexakin.transforms import pose

ENGINES = ("rigid", "pybullet", "mujoco")


class Standing:
    """A controller that holds the standing pose and keeps what it is given; ``answer`` completes its commands."""

    phases_per_cycle = 1

    def __init__(self, robot, **answer):
        self.robot, self.answer, self.seen = robot, answer, []

    def parameters(self):
        return {}

    def start(self, observation, control_rate):
        return self

    def command(self, observation):
        self.seen.append(observation)
        stance = np.ones(self.robot.num_legs, dtype=bool)
        return hk.Command(self.robot.standing_q, stance, 0, **self.answer)


class Silent:
    """An object that cannot be printed."""

    def __repr__(self):
        raise RuntimeError("no text")


def deep(levels):
    """Lists in lists, in more levels than JSON can have."""
    value = []
    for _ in range(levels):
        value = [value]
    return {"gait": value}


def still(robot, **options):
    return {"time_step": 0.001, "duration": 1.0, "perturbation": 0.0, **options}


@pytest.mark.parametrize("engine", ENGINES)
def test_an_observation_has_what_an_imu_and_encoders_tell(athena, engine):
    controller, slope = Standing(athena), 0.2
    ramp = hk.terrain.Ramp(slope=slope)
    walk = hk.simulate(athena, ramp, controller, engine=engine, **still(athena, duration=0.5))
    last = controller.seen[-1]
    assert np.linalg.norm(last.up_in_body) == pytest.approx(1.0)
    np.testing.assert_allclose(last.up_in_body, [0.0, np.sin(slope), np.cos(slope)], atol=0.02)
    np.testing.assert_allclose(last.up_in_body, walk.T_world_body[-1, 2, :3])
    np.testing.assert_allclose(last.body_angular_velocity, walk.body_angular_velocity[-1])
    assert last.joint_velocity.shape == (6, 3) and np.abs(last.joint_velocity).max() < 0.1
    np.testing.assert_allclose(walk.joint_velocity[-1], last.joint_velocity)


@pytest.mark.parametrize("engine", ENGINES)
def test_joint_velocities_are_the_rates_of_the_angles(athena, engine):
    options = still(athena, duration=2.0, control_rate=200.0)
    walk = hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), engine=engine, **options)
    rate = np.gradient(walk.q, walk.time, axis=0)
    swinging = slice(40, 160)
    error = np.abs(rate - walk.joint_velocity)[swinging]
    assert np.median(error) < 0.02 and np.abs(walk.joint_velocity[swinging]).max() > 0.5


def test_a_commanded_walk_tells_a_controller_how_ideal_servos_move(athena):
    controller = hk.steering.SteeringController(athena, hk.steering.Twist(turn=0.2), gait="ripple")
    seen = []

    class Listening:
        robot, phases_per_cycle, parameters = athena, controller.phases_per_cycle, controller.parameters

        def start(self, observation, control_rate):
            self.run = controller.start(observation, control_rate)
            return self

        def command(self, observation):
            seen.append(observation)
            return self.run.command(observation)

    motion = commanded_walk(Listening(), hk.terrain.Plane(), num_cycles=2)
    turning = np.array([observation.body_angular_velocity for observation in seen[80:]])
    np.testing.assert_allclose(turning.mean(axis=0), [0.0, 0.0, 0.2], atol=0.02)
    np.testing.assert_allclose(seen[-1].joint_velocity, 20.0 * (motion.q[-1] - motion.q[-2]), atol=1e-9)
    np.testing.assert_allclose(seen[-1].up_in_body, [0.0, 0.0, 1.0], atol=5e-3)


def test_diagnostics_become_columns_of_the_recording(athena, tmp_path):
    controller = Standing(athena, diagnostics={"battery": 7.4, "mood": np.float64(0.5)})
    walk = hk.simulate(athena, hk.terrain.Plane(), controller, engine="rigid", **still(athena, duration=0.2))
    np.testing.assert_array_equal(walk.battery, np.full(4, 7.4))
    walk.save(tmp_path / "walk.npz")
    back = hk.load_recording(tmp_path / "walk.npz")
    assert set(back.diagnostics) == {"battery", "mood"} and np.array_equal(back.mood, walk.mood)
    with pytest.raises(AttributeError, match="no 'fuel'; the controller's diagnostics are: "):
        _ = back.fuel


def test_posture_control_reports_its_estimates_and_steering_reports_none(athena):
    options = {"engine": "rigid", **still(athena, duration=0.2)}
    walk = hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), **options)
    assert list(walk.diagnostics) == ["delta_z", "delta_alpha", "delta_beta", "plane_misfit"]
    walk = hk.simulate(athena, hk.terrain.Plane(), hk.steering.SteeringController(athena), **options)
    assert walk.diagnostics == {}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ["athena", "phantomx"])
def test_torques_of_a_stiff_spring_and_damper_hold_the_standing_pose(name, engine):
    """Within 2 mm of the standing pose, body and feet, on both engines."""
    robot = hk.load_robot(name)
    shape = (robot.num_legs, 3)
    controller = Standing(robot, kp=np.full(shape, 100.0), kd=np.full(shape, 0.05))
    walk = hk.simulate(robot, hk.terrain.Plane(), controller, engine=engine, **still(robot, duration=2.0))
    feet = np.linalg.norm(walk.p_body_foot - hk.forward_kinematics(robot, robot.standing_q), axis=-1)
    assert feet[20:].max() < 2e-3
    assert np.abs(walk.height[20:] - hk.kinematics.standing_height(robot)).max() < 2e-3
    assert np.abs(walk.joint_torque).max() <= robot.servo.max_torque


def test_a_strongly_damped_law_is_stable_on_rigid(athena):
    shape = (6, 3)
    controller = Standing(athena, kp=np.full(shape, 500.0), kd=np.full(shape, 50.0))
    options = still(athena, time_step=0.005, duration=2.0)
    walk = hk.simulate(athena, hk.terrain.Plane(), controller, engine="rigid", **options)
    assert np.abs(walk.height[10:] - 0.104).max() < 2e-3 and np.abs(walk.joint_velocity[10:]).max() < 0.1


@pytest.mark.parametrize("engine", ENGINES)
def test_torques_alone_hold_the_weight_that_they_balance(athena, engine):
    """The torques that statics names for standing on six feet, and a weak damper against the drift."""
    plane, height = hk.terrain.Plane(), hk.kinematics.standing_height(athena)
    stands = pose(np.eye(3), [0.0, 0.0, height])[None], athena.standing_q[None], np.ones((1, 6), dtype=bool)
    torque = distribute(athena, *stands).torque[0]
    options = still(athena, duration=0.3, settling_time=0.5)
    held = Standing(athena, torque=torque, kd=np.full((6, 3), 0.05))
    assert np.abs(hk.simulate(athena, plane, held, engine=engine, **options).height - height).max() < 3e-3
    free = Standing(athena, torque=np.zeros((6, 3)))
    sunk = hk.simulate(athena, plane, free, engine=engine, **options).height[-1]
    assert sunk < 0.8 * height, "without torques it sinks"


@pytest.mark.parametrize("engine", ENGINES)
def test_a_torque_beyond_the_servos_limit_is_cut_to_it(athena, engine):
    push = np.zeros((6, 3))
    push[:, 1] = 100.0
    controller = Standing(athena, torque=push)
    walk = hk.simulate(athena, hk.terrain.Plane(), controller, engine=engine, **still(athena, duration=0.15))
    np.testing.assert_allclose(walk.joint_torque[1:, :, 1], athena.servo.max_torque, rtol=1e-9)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"q": np.zeros((6, 2))}, r"q: expected shape"),
        ({"q": np.full((6, 3), np.nan)}, "q: leg 1, joint 1 is nan"),
        ({"stance": np.ones(6)}, "stance: expected 6 booleans, got float64"),
        ({"stance": np.ones(4, dtype=bool)}, "stance: expected 6 booleans"),
        ({"stance": None}, "stance: expected 6 booleans, got object"),
        ({"stance": [[True], [True, False]]}, "stance: expected 6 booleans, got "),
        ({"phase": 0.5}, "phase: 0.5, expected a whole number"),
        ({"phase": -1}, "phase: -1, expected a whole number of at least 0"),
        ({"phase": 2**40}, "phase: 1099511627776, expected at most"),
        ({"phase": 10**5000}, "phase: a value of type int, expected a whole number"),
        ({"extending": "no"}, "extending: 'no', expected True or False"),
        ({"extending": Silent()}, "extending: a value of type Silent, expected True or False"),
        ({"kp": np.full((6, 3), -1.0)}, "kp: -1, expected at least 0"),
        ({"torque": np.zeros(18)}, "torque: expected shape"),
        ({"diagnostics": {"speed": "fast"}}, "diagnostics: speed: expected a number, got 'fast'"),
        ({"diagnostics": {"speed": 1j}}, "diagnostics: speed: expected a number, got 1j"),
        ({"diagnostics": {"speed": 10**400}}, "diagnostics: speed: 1000000000"),
        ({"diagnostics": {3: 1.0}}, "diagnostics: 3 as a name"),
        ({"diagnostics": {"a/b": 1.0}}, "diagnostics: 'a/b' as a name"),
        ({"diagnostics": {"height": 1.0}}, "diagnostics: 'height': a recording has a member of that name"),
        ({"diagnostics": {"save": 1.0}}, "diagnostics: 'save': a recording has a member of that name"),
        ({"diagnostics": 1.0}, "diagnostics: 1.0, expected a mapping"),
        ({"diagnostics": {"speed": 10**5000}}, "diagnostics: speed: a value of type int is too large"),
        ({"diagnostics": {Silent(): 1.0}}, "diagnostics: a value of type Silent as a name"),
    ],
)
def test_a_command_that_cannot_be_used_names_the_controller_and_the_field(athena, change, message):
    good = hk.Command(athena.standing_q, np.ones(6, dtype=bool), 0)
    assert check_command(good, 6).limited.tolist() == [False] * 6
    with pytest.raises(InvalidInputError, match=message):
        check_command(good._replace(**change), 6)
    wrong = Standing(athena)
    wrong.command = lambda observation: good._replace(**change)
    with pytest.raises(InvalidInputError, match=f"command of Standing at t = 0 s: {message}"):
        hk.simulate(athena, hk.terrain.Plane(), wrong, engine="rigid", **still(athena, duration=0.1, settling_time=0.1))


def test_what_is_no_command_and_diagnostics_that_come_and_go_are_named(athena):
    wrong = Standing(athena)
    wrong.command = lambda observation: athena.standing_q
    options = {"engine": "rigid", **still(athena, duration=0.2, settling_time=0.1)}
    with pytest.raises(InvalidInputError, match=r"expected a hexakin\.Command, got an array \(6, 3\)"):
        hk.simulate(athena, hk.terrain.Plane(), wrong, **options)
    stance = np.ones(6, dtype=bool)
    wrong.command = lambda o: hk.Command(athena.standing_q, stance, 0, diagnostics={"a": 1.0} if o.time else {})
    with pytest.raises(InvalidInputError, match=r"at t = 0.05 s: diagnostics: a not at every tick"):
        hk.simulate(athena, hk.terrain.Plane(), wrong, **options)


def test_a_command_is_copied_and_an_observation_may_be_written_into(athena):
    """A controller that reuses its arrays, and writes into those that it is given, changes no recording."""
    reused, plain = Standing(athena), Standing(athena)
    q, stance = athena.standing_q.copy(), np.ones(6, dtype=bool)

    def command(observation):
        observation.q[:], observation.foot_force[:], observation.body_angular_velocity[:] = 0.0, 0.0, 0.0
        q[:] = athena.standing_q + 0.01 * observation.time
        return hk.Command(q, stance, 0)

    reused.command = command
    plain.command = lambda o: hk.Command(athena.standing_q + 0.01 * o.time, np.ones(6, dtype=bool), 0)
    options = {"engine": "rigid", **still(athena, duration=0.3, settling_time=0.1)}
    one, other = (hk.simulate(athena, hk.terrain.Plane(), controller, **options) for controller in (reused, plain))
    for name in ("q", "q_command", "stance", "foot_force", "joint_velocity"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"robot": None}, "expected one such as hexakin.PostureController"),
        ({"start": None}, "Standing has no method 'start', see hexakin.Controller"),
        ({"parameters": None}, "Standing has no method 'parameters'"),
        ({"phases_per_cycle": 0}, "Standing: phases_per_cycle: 0, expected a whole number of at least 1"),
        ({"parameters": lambda: {"gait": {1, 2}}}, r"Standing: \{1, 2\} cannot be stored with a recording"),
        ({"parameters": lambda: 3}, "Standing: "),
        ({"parameters": lambda: {"gait": Silent()}}, "Standing: a value of type Silent cannot be stored"),
        ({"parameters": lambda: deep(100_000)}, "Standing: "),
        ({"start": lambda observation: None}, "Standing: start: expected a function of observation, control_rate"),
        ({"parameters": lambda unit: {}}, "Standing: parameters: expected a function of"),
        ({"check_control_rate": lambda: None}, "Standing: check_control_rate: expected a function of control_rate"),
    ],
)
@pytest.mark.parametrize("walk", ["simulate", "commanded_walk"])
def test_a_controller_that_cannot_be_used_is_named_before_the_walk(athena, walk, change, message):
    wrong, ground = Standing(athena), hk.terrain.Plane()
    vars(wrong).update(change)
    with pytest.raises(InvalidInputError, match=f"controller: {message}"):
        if walk == "simulate":
            hk.simulate(athena, ground, wrong, engine="rigid")
        else:
            commanded_walk(wrong, ground)
    assert not wrong.seen


@pytest.mark.parametrize("run", [None, 1.0, Silent()])
def test_a_start_that_returns_no_run_is_named(athena, run):
    """Such as a method ``start`` that ends without ``return self``."""
    wrong, ground = Standing(athena), hk.terrain.Plane()
    wrong.start = lambda observation, control_rate: run
    message = "controller: start of Standing: .* has no method 'command'"
    with pytest.raises(InvalidInputError, match=message):
        commanded_walk(wrong, ground)
    with pytest.raises(InvalidInputError, match=message):
        hk.simulate(athena, ground, wrong, engine="rigid", **still(athena, duration=0.1, settling_time=0.1))


def test_a_commanded_walk_ends_even_if_the_controller_does_not(athena):
    with pytest.raises(InvalidInputError, match=r"Standing is in phase 0 after .* expected 1 gait cycles of"):
        commanded_walk(Standing(athena), hk.terrain.Plane(), num_cycles=1, longest_cycle=2.0)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_readmes_controller_of_ones_own_walks(engine, capsys):
    """Fifteen lines without the blank ones; on both engines it walks ahead by most of its strokes."""
    readme = (Path(__file__).resolve().parent.parent / "README.md").read_text(encoding="utf-8")
    example = readme.split("## Your own controller")[1].split("```python\n")[1].split("```")[0]
    controller = example.partition("class Tripod")[2].partition("\n\n\n")[0]
    assert sum(bool(line.strip()) for line in controller.splitlines()) <= 15
    exec(compile(example.replace('engine="rigid"', f"engine={engine!r}"), "README.md", "exec"), {})
    assert 0.2 < float(capsys.readouterr().out) < 0.32, "six strokes of 50 mm"
