"""Trials of steering on level ground: every gait of a robot, in eight directions and turning."""

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
STROKE = 0.04  # [m] that a foot in stance moves relative to the body
SWING = 1.0  # [s] duration of a swing
_FIRST = 2  # cycles in which the robot accelerates; they are not measured


def study(robots: Sequence[str] = ROBOTS, *, num_cycles: int = 20) -> Study:
    """Walks of every robot with every gait in every direction, ``num_cycles`` gait cycles each, on the rigid engine."""
    directions = [*(f"{heading} deg" for heading in HEADINGS), *TURNS]
    return Study(
        "manoeuvres", steered, tuple(grid(robot=robots, gait=GAITS, direction=directions, num_cycles=num_cycles))
    )


def command(robot: Robot, gait: str, direction: str, *, stroke: float = STROKE) -> tuple[Twist, float]:
    """Velocity that makes strokes ``stroke`` [m] long, and the duration [s] of a cycle whose swings take one second.

    ``gait`` is the name of the gait. ``direction`` is one of ``HEADINGS`` with " deg", or one of ``TURNS``. Raises
    UnknownNameError for another direction.
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
    """Simulate a walk in one direction and measure it; a trial of ``hexakin.study``.

    ``robot`` and ``gait`` are names, ``direction`` is that of ``command``, and ``num_cycles`` the number of gait
    cycles. Raises SimulationError if the walk contains fewer cycles. The columns of the result are:

    - ``forward``, ``left`` [m/s] and ``turn`` [rad/s], the mean velocity from the third cycle on;
    - ``error``, its difference from the commanded velocity as a share of that velocity, where a rate counts as the
      speed of a standing foot;
    - ``slip`` and ``slip_most`` [m], the largest sliding distance among the feet in stance, as the median and the
      maximum over the phases;
    - ``torso_contact``, the share of ticks in which the torso touches the ground.
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
    # Sum the motion of whole cycles, each relative to the pose before it, because a turning body returns to its start.
    per_cycle = round(cycle / (recording.time[1] - recording.time[0]))
    moved = []
    for k in range(start, end - per_cycle + 1, per_cycle):
        T = inverse_pose(recording.T_world_body[k]) @ recording.T_world_body[k + per_cycle]
        moved.append([T[:3, 3] @ walker.forward, -T[:3, 3] @ walker.right, np.arctan2(T[1, 0], T[0, 0])])
    mean = np.mean(moved, axis=0) / (per_cycle * (recording.time[1] - recording.time[0]))
    # Compare all components as speeds of a foot.
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
