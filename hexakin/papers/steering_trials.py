"""Steering tried out: every gait of a robot in eight directions and turning, on level ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hexakin.control.steering import SteeringController, Twist
from hexakin.exceptions import SimulationError, UnknownNameError
from hexakin.motion.measures import slips
from hexakin.robot.file import load_robot
from hexakin.robot.model import Robot
from hexakin.simulation.closed_loop import simulate
from hexakin.study.runner import Study, grid
from hexakin.terrain.planes import Plane
from hexakin.transforms import inverse_pose
from hexakin.walking.gait import GAITS, gait_of

HEADINGS = tuple(range(0, 360, 45))
"""Directions [deg] counter-clockwise from the robot's forward axis."""

TURNS = ("turn left", "turn right")
ROBOTS = ("athena", "phantomx")
STROKE = 0.04  # [m] of a foot against the body while it is on the ground
SWING = 1.0  # [s]
_FIRST = 2  # cycles in which the command is taken up


def study(robots: Sequence[str] = ROBOTS, *, num_cycles: int = 20) -> Study:
    """Every robot with every gait in every direction, on the rigid engine."""
    directions = [*(f"{heading} deg" for heading in HEADINGS), *TURNS]
    return Study(
        "manoeuvres", steered, tuple(grid(robot=robots, gait=GAITS, direction=directions, num_cycles=num_cycles))
    )


def command(robot: Robot, gait: str, direction: str, *, stroke: float = STROKE) -> tuple[Twist, float]:
    """Velocity with which strokes are ``stroke`` [m] long, and the gait's cycle [s] with swings of one second.

    ``direction`` is one of ``HEADINGS`` with " deg", or of ``TURNS``. Raises UnknownNameError for another.
    """
    duty_factor = gait_of(robot, gait).duty_factor
    cycle = SWING / (1.0 - duty_factor)
    speed = stroke / (duty_factor * cycle)
    if direction in TURNS:
        home = SteeringController(robot, gait=gait).home
        turn = speed / float(np.linalg.norm(home[:, :2], axis=1).mean())
        return Twist(turn=turn if direction == "turn left" else -turn), cycle
    known = [f"{heading} deg" for heading in HEADINGS]
    if direction not in known:
        raise UnknownNameError("direction", direction, [*known, *TURNS])
    angle = np.radians(HEADINGS[known.index(direction)])
    return Twist(float(speed * np.cos(angle)), float(speed * np.sin(angle))), cycle


def steered(robot: str, gait: str, direction: str, num_cycles: int) -> dict[str, float]:
    """Walk in one direction and measure; a trial of ``hexakin.study``.

    Columns: ``forward``, ``left`` [m/s] and ``turn`` [rad/s], the mean velocity from the third cycle on;
    ``error``, how far it is from the commanded one as a share of it, rates counted as speeds of a standing foot;
    ``slip`` and ``slip_most`` [m], median and largest over
    phases of the way that the most slipping foot in stance slid; ``torso_contact``, the share of ticks.
    """
    walker = load_robot(robot)
    twist, cycle = command(walker, gait, direction)
    controller = SteeringController(walker, twist, gait, cycle_duration=cycle)
    begin = controller.rise_duration + _FIRST * cycle
    recording = simulate(
        walker, Plane(), controller, engine="rigid", time_step=0.002,
        duration=controller.rise_duration + num_cycles * cycle + 1.0, max_cycles=num_cycles,
    )  # fmt: skip
    start, end = np.searchsorted(recording.time, [begin, begin + (num_cycles - _FIRST - 1) * cycle])
    if end >= len(recording.time):
        raise SimulationError(f"only {recording.time[-1]:.0f} s of {num_cycles} gait cycles")
    # Steps between whole cycles, each from the pose before it: a turning body comes back to where it was.
    per_cycle = round(cycle / (recording.time[1] - recording.time[0]))
    moved = []
    for k in range(start, end - per_cycle + 1, per_cycle):
        T = inverse_pose(recording.T_world_body[k]) @ recording.T_world_body[k + per_cycle]
        moved.append([T[:3, 3] @ walker.forward, -T[:3, 3] @ walker.right, np.arctan2(T[1, 0], T[0, 0])])
    mean = np.mean(moved, axis=0) / (per_cycle * (recording.time[1] - recording.time[0]))
    # Components are compared as speeds of a foot.
    arm = float(np.linalg.norm(controller.home[:, :2], axis=1).mean())
    scale = np.array([1.0, 1.0, arm])
    wanted = scale * np.array(twist)
    error = float(np.linalg.norm(scale * mean - wanted) / np.linalg.norm(wanted))
    slid = slips(recording)
    measured = {
        **dict(zip(("forward", "left", "turn"), mean, strict=True)),
        "error": error,
        "slip": float(np.median(slid)),
        "slip_most": float(slid.max()),
        "torso_contact": float(np.mean(recording.torso_force > 0.0)),
    }
    return {name: float(f"{value:.6g}") for name, value in measured.items()}
