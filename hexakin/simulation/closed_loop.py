"""Closed-loop simulation: a controller commands a robot in a simulation engine at the control rate (A section 5.1)."""

from __future__ import annotations

import inspect
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from hexakin.checks import Array, check_array, check_number, check_whole, checked
from hexakin.control.interface import Command, Controller, Observation, check_answer, check_controller, started
from hexakin.engines import Engine, Reading, TorqueLaw, default_engine, engine_class
from hexakin.exceptions import InvalidInputError, JointLimitError, SimulationError, UnknownNameError
from hexakin.installation import versions
from hexakin.kinematics.forward import forward_kinematics, standing_height
from hexakin.motion.clearance import way_to_ground
from hexakin.motion.recording import MOST_TICKS, Recording
from hexakin.numerics.interrupts import many_interrupts_kept
from hexakin.numerics.messages import messages
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain
from hexakin.transforms import pose, rotation_between

_MOST_STEPS = 1_000_000  # time steps in a tick; more would take minutes, and no engine needs them
_MOST_PERTURBATION = 1.0  # [rad] beyond most joint limits; a larger one was meant in degrees
_START_CLEARANCE = 1e-3  # [m] smallest gap between the robot and the ground at the start


@checked
def simulate(
    robot: Robot,
    terrain: Terrain,
    controller: Controller,
    *,
    engine: str | None = None,
    duration: float = 50.0,
    max_cycles: int | None = None,
    time_step: float = 0.001,
    control_rate: float = 20.0,
    friction: float = 0.9,
    restitution: float = 0.5,
    seed: int = 0,
    perturbation: float = 0.02,
    q_start: ArrayLike | None = None,
    settling_time: float = 1.0,
    force_sampling: Literal["mean", "last"] = "mean",
    progress: bool = False,
    **engine_options: Any,
) -> Recording:
    """Simulate a walk of a robot under a controller, and return its recording.

    The robot is placed over the origin of the terrain, with its z axis normal to the ground there. First its servos
    hold the angles at the start; after ``settling_time`` the controller commands the joints. Equal arguments give equal
    recordings.

    Raises UnknownNameError for an unknown engine, engine option, ``force_sampling`` or terrain; MissingPackageError if
    the package of the engine is not installed; InvalidInputError for a number, controller or command that cannot be
    used; JointLimitError, which names the leg, if a given angle at the start is beyond its limit; SimulationError if
    the state is no longer finite or the robot leaves the terrain or turns over.

    Parameters
    ----------
    robot
        The robot that walks.
    terrain
        The ground.
    controller
        A controller that was made for this robot.
    engine
        ``"pybullet"``, ``"rigid"`` or ``"mujoco"``. ``"rigid"`` has hard contacts and exact friction, ``"mujoco"`` soft
        contacts. None means ``"pybullet"`` where PyBullet is installed, and ``"rigid"`` elsewhere;
        ``parameters["engine_choice"]`` of the recording says which case it was.
    duration
        Duration [s] of the walk, without settling.
    max_cycles
        Largest number of gait cycles; None means no limit. The walk also ends after ``duration``.
    time_step
        Time step [s] of the engine. A control tick must be a whole number of time steps.
    control_rate
        Number of control ticks per second [Hz].
    friction, restitution
        Coefficients of friction and of restitution of all contacts.
    seed
        Seed of the perturbation.
    perturbation
        Largest absolute value [rad] of the random numbers, drawn with ``seed``, that are added to the joint angles at
        the start, at most 1. The sums are clipped to the joint limits.
    q_start
        Joint angles (L, 3) [rad] at the start, for example ``hexakin.rising.lying_q``; None means the standing pose.
    settling_time
        Time [s] in which the servos hold the robot before the controller starts, rounded to whole control ticks. One
        more tick gives the first observation.
    force_sampling
        Which foot forces the controller receives: the ``"mean"`` over the previous tick, or the forces in the
        ``"last"`` time step of that tick, which vary more because contacts open and close quickly.
    progress
        Whether to show progress and remaining time on stderr.
    **engine_options
        Options of the class of the engine.
    """
    check_number("control_rate", control_rate, above=0.0, unit="Hz")
    controller_parameters = check_controller(controller, control_rate)
    if controller.robot is not robot and controller.robot.description() != robot.description():
        raise InvalidInputError(f"controller: made for another robot than {robot.name!r}")
    check_whole("seed", seed)
    if max_cycles is not None:
        check_whole("max_cycles", max_cycles, at_least=1)
    for name, value in {"duration": duration, "time_step": time_step}.items():
        check_number(name, value, above=0.0)
    check_number("perturbation", perturbation, at_least=0.0, at_most=_MOST_PERTURBATION, unit="rad")
    check_number("settling_time", settling_time, at_least=0.0, unit="s")
    if force_sampling not in ("mean", "last"):
        raise UnknownNameError("force_sampling", force_sampling, ["mean", "last"])
    steps_per_tick = _whole(1.0 / control_rate / time_step, f"control tick of {1.0 / control_rate:g} s", time_step)
    num_ticks = count_ticks("duration", duration, control_rate)
    settling_ticks = count_ticks("settling_time", settling_time, control_rate)

    rng = np.random.default_rng(seed)
    pose_at_start = _angles_at_start(robot, q_start)
    q = np.clip(pose_at_start + rng.uniform(-perturbation, perturbation, pose_at_start.shape), robot.q_min, robot.q_max)
    used = default_engine() if engine is None else engine
    make_engine = engine_class(used)
    known_options = list(inspect.signature(make_engine).parameters)[2:]
    for option in engine_options:
        if option not in known_options:
            raise UnknownNameError(f"option of engine {used!r}", option, known_options)
    options = {"time_step": time_step, "friction": friction, "restitution": restitution, **engine_options}
    with make_engine(robot, terrain, **options) as simulator, many_interrupts_kept():
        simulator.place(starting_pose(robot, terrain, q), q)
        reading = simulator.advance(q, settling_ticks * steps_per_tick)
        reading = simulator.advance(q, steps_per_tick)
        last = force_sampling == "last"
        end = np.inf if max_cycles is None else max_cycles * controller.phases_per_cycle
        with tqdm(desc=robot.name, total=num_ticks, unit="tick", file=messages, disable=not progress) as bar:
            rows = _walk(
                simulator, terrain, controller, reading, control_rate, num_ticks, end, steps_per_tick, last, bar
            )
    parameters = {
        "robot": robot.description(),
        "terrain": repr(terrain),
        "controller": controller_parameters,
        "phases_per_cycle": controller.phases_per_cycle,
        "engine": used,
        "engine_choice": _engine_choice(engine, used),
        **options,
        "duration": duration,
        "max_cycles": max_cycles,
        "control_rate": control_rate,
        "seed": seed,
        "perturbation": perturbation,
        "q_start": None if q_start is None else pose_at_start.tolist(),
        "settling_time": settling_time,
        "force_sampling": force_sampling,
        "versions": versions(["numpy", *make_engine.packages]),
    }
    return _recording(robot, rows, control_rate, parameters)


def _engine_choice(given: str | None, used: str) -> str:
    """Return the reason why the engine ``used`` simulates, for the recording."""
    if given is not None:
        return "given"
    return "default" if used == "pybullet" else "default, because PyBullet is not installed"


def starting_pose(robot: Robot, terrain: Terrain, q: Array) -> Array:
    """Pose (4, 4) of the body over the origin, with its z axis normal to the ground there.

    At the joint angles ``q`` (L, 3) [rad], the foot or the part of the torso that is closest to the ground has a gap of
    1 mm to the ground of ``terrain``.
    """
    normal = terrain.normal(0.0, 0.0)
    rotation = rotation_between([0.0, 0.0, 1.0], normal)
    ground = np.array([0.0, 0.0, float(terrain.height(0.0, 0.0))])
    T = pose(rotation, ground + standing_height(robot) * normal)
    T[:3, 3] += way_to_ground(robot, terrain, T, q, normal, gap=_START_CLEARANCE) * normal
    return T


def _angles_at_start(robot: Robot, q_start: ArrayLike | None) -> Array:
    if q_start is None:
        return robot.standing_q
    q = check_array("q_start", q_start, (robot.num_legs, 3), ("leg", "joint"))
    if q.ndim != 2:
        raise InvalidInputError(f"q_start: expected shape ({robot.num_legs}, 3), got {q.shape}")
    for leg, joint in np.argwhere((q < robot.q_min) | (q > robot.q_max)):
        limits = (float(robot.q_min[leg, joint]), float(robot.q_max[leg, joint]))
        raise JointLimitError(int(leg) + 1, robot.table.joints[joint], float(q[leg, joint]), limits, 0.0)
    return q


def count_ticks(name: str, seconds: float, control_rate: float) -> int:
    """Return the number of ticks, at least 1, in a time of ``seconds`` at ``control_rate`` [Hz].

    Raises InvalidInputError, with the argument's ``name``, for more ticks than a recording can have.
    """
    ticks = seconds * control_rate
    if not ticks <= MOST_TICKS:
        raise InvalidInputError(
            f"{name}: {seconds:g} s at {control_rate:g} Hz are {ticks:.3g} ticks, expected at most {MOST_TICKS}"
        )
    return max(1, round(ticks))


def _whole(ratio: float, what: str, time_step: float) -> int:
    if not ratio <= _MOST_STEPS:
        raise InvalidInputError(f"time_step: {time_step:g} s, expected at most {_MOST_STEPS} steps in a {what}")
    if abs(ratio - round(ratio)) > 1e-6 or round(ratio) < 1:
        raise InvalidInputError(f"time_step: {time_step:g} s does not divide the {what}")
    return round(ratio)


def torso_height(terrain: Terrain, T_world_body: Array) -> float:
    """Distance [m] from the body's origin to the ground along the body's downward axis (infrared sensor).

    ``T_world_body`` (4, 4) is the pose of the body over ``terrain``. The result is inf if the axis does not meet the
    ground.
    """
    return float(terrain.distance_along(T_world_body[:3, 3], -T_world_body[:3, 2]))


def _walk(
    simulator: Engine,
    terrain: Terrain,
    controller: Controller,
    reading: Reading,
    control_rate: float,
    num_ticks: int,
    end_phase: float,
    steps_per_tick: int,
    last_force: bool,
    bar: tqdm,
) -> list[tuple[Reading, Command, float]]:
    rows: list[tuple[Reading, Command, float]] = []
    run = None
    for tick in range(num_ticks):
        try:
            height = torso_height(terrain, reading.T_world_body)
        except InvalidInputError as error:
            raise SimulationError(f"t = {tick / control_rate:g} s: the robot has left the terrain ({error})") from error
        if not np.isfinite(height):
            raise SimulationError(
                f"t = {tick / control_rate:g} s: no ground below the torso; the robot has turned over"
            )
        force = reading.foot_force_last if last_force else reading.foot_force
        observation = _observation(tick / control_rate, reading, force, height)
        if run is None:
            run = started(controller, observation, control_rate)
        first = rows[0][1] if rows else None
        command = check_answer(controller, run.command(observation), observation.time, first)
        if command.phase >= end_phase:
            break
        rows.append((reading, command, height))
        reading = simulator.advance(command.q, steps_per_tick, _torque_law(command))
        bar.update()
    return rows


def _observation(time: float, reading: Reading, foot_force: Array, height: float) -> Observation:
    """What a controller is given, in copies: it may write into them."""
    return Observation(
        time=time,
        q=reading.q.copy(),
        joint_velocity=reading.joint_velocity.copy(),
        foot_force=foot_force.copy(),
        height=height,
        body_angular_velocity=reading.body_angular_velocity.copy(),
        up_in_body=reading.T_world_body[2, :3].copy(),  # the world's z axis in the body frame
    )


def _torque_law(command: Command) -> TorqueLaw | None:
    """Return the torque law of a command, or None if the servos follow its angles."""
    given = (command.kp, command.kd, command.torque)
    if all(values is None for values in given):
        return None
    return TorqueLaw(*(np.zeros(command.q.shape) if values is None else values for values in given))


def _recording(
    robot: Robot, rows: list[tuple[Reading, Command, float]], control_rate: float, parameters: dict[str, Any]
) -> Recording:
    if not rows:
        raise InvalidInputError("controller: the phase of its first command is beyond max_cycles")
    readings, commands, heights = zip(*rows, strict=True)
    q = _rows([r.q for r in readings])
    return Recording(
        time=np.arange(len(rows)) / control_rate,
        T_world_body=_rows([r.T_world_body for r in readings]),
        body_velocity=_rows([r.body_velocity for r in readings]),
        body_angular_velocity=_rows([r.body_angular_velocity for r in readings]),
        body_rate_moment=_rows([r.body_rate_moment for r in readings]),
        height=np.array(heights),
        q=q,
        joint_velocity=_rows([r.joint_velocity for r in readings]),
        q_command=_rows([c.q for c in commands]),
        joint_torque=_rows([r.joint_torque for r in readings]),
        p_body_foot=forward_kinematics(robot, q),
        foot_force=_rows([r.foot_force for r in readings]),
        foot_force_last=_rows([r.foot_force_last for r in readings]),
        torso_force=np.array([r.torso_force for r in readings]),
        limb_force=np.array([r.limb_force for r in readings]),
        penetration=np.array([r.penetration for r in readings]),
        energy=np.array([r.energy for r in readings]),
        servo_work=np.array([r.servo_work for r in readings]),
        contact_work=np.array([r.contact_work for r in readings]),
        solver_residual=np.array([r.solver_residual for r in readings]),
        unsolved_steps=np.array([r.unsolved_steps for r in readings]),
        phase=np.array([c.phase for c in commands]),
        stance=_rows([c.stance for c in commands]),
        extending=np.array([c.extending for c in commands]),
        limited=_rows([c.limited for c in commands]),
        diagnostics={name: np.array([c.diagnostics[name] for c in commands]) for name in commands[0].diagnostics},
        parameters=parameters,
    )


def _rows(arrays: list[np.ndarray]) -> np.ndarray:
    """Return an array (n, ...) of n arrays of equal shapes; ``np.array`` takes ten times as long."""
    return np.concatenate(arrays).reshape(len(arrays), *arrays[0].shape)
