"""What every simulation engine offers."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

from numpy.typing import ArrayLike

from hexakin.checks import Array
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain


class TorqueLaw(NamedTuple):
    """Torques that joints give instead of following their servos: ``torque + kp (q_command - angle) - kd rate``.

    ``kp`` (L, 3) [N m/rad], ``kd`` (L, 3) [N m s/rad], ``torque`` (L, 3) [N m]. They act at every time step, each at
    most the servo's ``max_torque``.
    """

    kp: Array
    kd: Array
    torque: Array


class Reading(NamedTuple):
    """State and sensors after a control tick (A section 5.1).

    ``T_world_body`` (4, 4) [m], ``body_velocity`` (3,) [m/s] of the body's origin in the world,
    ``body_angular_velocity`` (3,) [rad/s] in the body frame (the IMU), ``q`` (L, 3) [rad] and ``joint_velocity`` (L, 3)
    [rad/s], ``joint_torque`` (L, 3) [N m] of the servos at the last step. ``body_rate_moment`` (3, 3) [rad^2/s^2] is
    the mean of w w^T over the tick's steps, w the angular velocity in the body frame: the mean square rate about a unit
    axis a is a^T m a.

    Normal contact forces [N] are means over the tick's steps: ``foot_force`` (L,), ``torso_force`` and ``limb_force``
    (coxae, femora and tibiae together); ``foot_force_last`` (L,) is that of the last step alone.
    ``penetration`` [m] is the deepest of any contact in the tick.

    ``energy`` [J], kinetic and potential (of gravity, from the world's origin), is that at the end of the tick;
    ``servo_work`` and ``contact_work`` [J] are what servos and contacts put in during the tick (contacts take out, so
    theirs is negative); ``solver_residual`` is the largest relative residual of the contact solver. They are NaN for an
    engine that does not know them.
    """

    T_world_body: Array
    body_velocity: Array
    body_angular_velocity: Array
    body_rate_moment: Array
    q: Array
    joint_velocity: Array
    joint_torque: Array
    foot_force: Array
    foot_force_last: Array
    torso_force: float
    limb_force: float
    penetration: float
    energy: float = math.nan
    servo_work: float = math.nan
    contact_work: float = math.nan
    solver_residual: float = math.nan


class Engine(ABC):
    """A robot on a terrain with servo-driven joints. Use as a context manager; it owns a simulator.

    ``packages`` are the distributions whose versions a recording names.
    """

    packages: tuple[str, ...] = ()

    @abstractmethod
    def __init__(self, robot: Robot, terrain: Terrain, *, time_step: float, friction: float, restitution: float):
        """Load robot and terrain. ``time_step`` [s]; ``friction`` and ``restitution`` hold for every contact."""

    @abstractmethod
    def place(self, T_world_body: ArrayLike, q: ArrayLike) -> None:
        """Put the robot at rest with the pose ``T_world_body`` (4, 4) [m] and the joint angles ``q`` (L, 3) [rad]."""

    @abstractmethod
    def advance(self, q_command: ArrayLike, num_steps: int, torque_law: TorqueLaw | None = None) -> Reading:
        """Drive the joints for ``num_steps`` time steps and read the sensors.

        The servos turn them towards ``q_command`` (L, 3) [rad]; with a ``torque_law`` it gives their torques instead.
        """

    @abstractmethod
    def close(self) -> None:
        """Free the simulator."""

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
