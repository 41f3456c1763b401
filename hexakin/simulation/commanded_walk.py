"""The motion that a controller commands, computed with ideal servos instead of an engine."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hexakin.checks import Array, check_number, check_whole, checked
from hexakin.control.interface import Controller, Observation, check_answer, check_controller, started
from hexakin.exceptions import InvalidInputError
from hexakin.kinematics.forward import forward_kinematics
from hexakin.motion.clearance import foot_gaps, way_to_ground
from hexakin.motion.motion import Motion
from hexakin.simulation.closed_loop import count_ticks, starting_pose, torso_height
from hexakin.terrain.base import Terrain
from hexakin.transforms import pose, transform_points


@checked
def commanded_walk(
    controller: Controller,
    terrain: Terrain,
    *,
    num_cycles: int = 4,
    control_rate: float = 20.0,
    longest_cycle: float = 120.0,
) -> Motion:
    """Motion of a robot whose joints follow a controller's commands exactly, with feet in stance that do not move.

    The body starts in the standing pose over the origin; its pose then follows from the feet in stance. In the
    observations, these feet and all feet within 2 mm of the ground carry equal shares of the weight. On uneven ground a
    swing may end above the ground or in it, because the motion results from the commands alone; ``simulate`` shows how
    the robot would walk there.

    ``controller`` is the controller, ``terrain`` the ground, ``num_cycles`` the number of gait cycles, ``control_rate``
    [Hz] the number of commands per second, and ``longest_cycle`` [s] the mean time of a gait cycle beyond which the
    walk counts as endless. Torques and gains of a command are not used: ideal servos follow its angles. Raises
    UnknownNameError for another kind of terrain and InvalidInputError for a number out of its range, a controller or a
    command that cannot be used, and an endless walk.
    """
    check_number("longest_cycle", longest_cycle, above=0.0, unit="s")
    check_whole("num_cycles", num_cycles, at_least=1)
    check_number("control_rate", control_rate, above=0.0)
    check_controller(controller, control_rate)
    most_ticks = count_ticks("num_cycles, longest_cycle", num_cycles * longest_cycle, control_rate)
    robot, near = controller.robot, 2e-3
    q = np.array(robot.standing_q)
    run, samples, tick = None, [], 0
    T, feet = starting_pose(robot, terrain, q), forward_kinematics(robot, q)
    world = transform_points(T, feet)
    way = way_to_ground(robot, terrain, T, q, T[:3, 2], gap=0.0, torso=False) * T[:3, 2]
    T[:3, 3] += way
    world += way
    loaded = np.ones(robot.num_legs, dtype=bool)
    q_before, T_before = q, T
    while True:
        weight = np.where(loaded, robot.weight / max(loaded.sum(), 1), 0.0)
        observation = Observation(
            time=tick / control_rate,
            q=q,
            joint_velocity=control_rate * (q - q_before),
            foot_force=weight,
            height=torso_height(terrain, T),
            body_angular_velocity=_body_rate(T_before, T, control_rate),
            up_in_body=T[2, :3].copy(),
        )
        if run is None:
            run = started(controller, observation, control_rate)
        command = check_answer(controller, run.command(observation), observation.time)
        if command.phase >= num_cycles * controller.phases_per_cycle:
            break
        if tick > most_ticks:
            raise InvalidInputError(
                f"controller: {type(controller).__name__} is in phase {command.phase} after {tick / control_rate:g} s; "
                f"expected {num_cycles} gait cycles of at most {longest_cycle:g} s (longest_cycle)"
            )
        tick += 1
        q_before, T_before = q, T
        q, stance = command.q, command.stance
        feet = forward_kinematics(robot, q)
        T = _follow(feet[stance], world[stance], T)
        world = np.where(stance[:, None], world, transform_points(T, feet))
        loaded = stance | (foot_gaps(robot, terrain, world) < near)
        samples.append((tick / control_rate, T, feet, q, stance, command.limited))
    if not samples:
        raise InvalidInputError("controller: the phase of its first command is beyond num_cycles")
    time, poses, p_body_foot, angles, carrying, clipped = (np.array(values) for values in zip(*samples, strict=True))
    return Motion(time, poses, p_body_foot, angles, carrying, clipped, touch=near)


def _body_rate(T_before: Array, T: Array, control_rate: float) -> Array:
    """Mean angular velocity (3,) [rad/s], in the body frame, between two poses one tick apart."""
    return control_rate * Rotation.from_matrix(T_before[:3, :3].T @ T[:3, :3]).as_rotvec()


def _follow(body: Array, world: Array, T_before: Array) -> Array:
    """Pose (4, 4) at which k feet ``body`` (k, 3) [m] in the body frame are closest to ``world`` (k, 3) [m].

    With fewer than three feet it is the pose before.
    """
    if len(body) < 3:
        return T_before
    center, target = body.mean(axis=0), world.mean(axis=0)
    rotation = Rotation.align_vectors(world - target, body - center)[0].as_matrix()
    return pose(rotation, target - rotation @ center)
