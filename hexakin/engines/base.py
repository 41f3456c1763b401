"""The interface of all simulation engines, which is hexakin's own."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

from numpy.typing import ArrayLike

from hexakin.checks import Array, check_poses, check_shape
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain


class TorqueLaw(NamedTuple):
    """Law of the joint torques that replace the servos: torque + kp (q_command - angle) - kd rate.

    ``kp`` (L, 3) [N m/rad] is the stiffness, ``kd`` (L, 3) [N m s/rad] the damping and ``torque`` (L, 3) [N m] a
    constant part. The law is evaluated at every time step; each torque is limited to the servo's ``max_torque``.
    """

    kp: Array
    kd: Array
    torque: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Reading(NamedTuple):
    """State and sensor values after a control tick (A section 5.1).

    Parameters
    ----------
    T_world_body
        Pose (4, 4) of the body in the world.
    body_velocity
        Velocity (3,) [m/s] of the body's origin, in the world frame.
    body_angular_velocity
        Angular velocity (3,) [rad/s] of the body, in the body frame (IMU).
    body_rate_moment
        Mean (3, 3) [rad^2/s^2] of w w^T over the time steps of the tick, with w the angular velocity in the body frame.
        The mean square rate about a unit axis a is a^T m a.
    q
        Joint angles (L, 3) [rad].
    joint_velocity
        Joint rates (L, 3) [rad/s].
    joint_torque
        Torques (L, 3) [N m] of the servos in the last time step.
    foot_force
        Normal forces (L,) [N] on the feet, mean over the tick.
    foot_force_last
        Normal forces (L,) [N] on the feet in the last time step.
    torso_force
        Normal force [N] on the torso, mean over the tick.
    limb_force
        Sum of the normal forces [N] on coxae, femora and tibiae, mean over the tick.
    penetration
        Largest penetration [m] of any contact in the tick.
    energy
        Kinetic and potential energy [J] at the end of the tick; the potential of gravity is zero at the world's origin.
        This value and the next two are NaN for an engine that does not compute them.
    servo_work, contact_work
        Work [J] of the servos and of the contacts on the robot in the tick. Contacts dissipate energy, so that their
        work is negative.
    solver_residual
        Largest relative residual of the contact solver in the tick; NaN for an engine that does not compute it.
    unsolved_steps
        Number of time steps of the tick whose residual is above the tolerance of the contact solver; NaN for an engine
        that does not compute residuals.
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
    unsolved_steps: float = math.nan

    def __repr__(self) -> str:
        return short_repr(self)


class Engine(ABC):
    """A robot with servo-driven joints on a terrain, in a simulator; to be used as a context manager.

    ``packages`` are the names of the Python packages whose versions are stored in a recording, if they are installed.
    """

    packages: tuple[str, ...] = ()

    @abstractmethod
    def __init__(self, robot: Robot, terrain: Terrain, *, time_step: float, friction: float, restitution: float):
        """Load ``robot`` and ``terrain``.

        ``time_step`` [s] is the duration of a step. ``friction`` and ``restitution`` are the coefficients of all
        contacts.
        """

    @abstractmethod
    def place(self, T_world_body: ArrayLike, q: ArrayLike) -> None:
        """Set the pose ``T_world_body`` (4, 4) and the joint angles ``q`` (L, 3) [rad] of the robot, at rest."""

    @abstractmethod
    def advance(self, q_command: ArrayLike, num_steps: int, torque_law: TorqueLaw | None = None) -> Reading:
        """Drive the joints for ``num_steps`` time steps, and return the state and sensor values after them.

        The servos drive the joints towards ``q_command`` (L, 3) [rad]. If ``torque_law`` is not None, the joints apply
        its torques instead.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the simulator; the engine cannot be used afterwards."""

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def check_place(robot: Robot, T_world_body: ArrayLike, q: ArrayLike) -> tuple[Array, Array]:
    """Return pose (4, 4) and joint angles (L, 3) [rad] of ``Engine.place`` as arrays; raise InvalidInputError."""
    T = check_poses("T_world_body", check_shape("T_world_body", T_world_body, (4, 4)))
    return T, check_angles("q", robot, q)


def check_angles(name: str, robot: Robot, q: ArrayLike) -> Array:
    """Return values (L, 3) of all joints as an array; raise InvalidInputError, which names the argument ``name``."""
    return check_shape(name, q, (robot.num_legs, NUM_JOINTS), ("leg", "joint"))


def check_law(robot: Robot, law: TorqueLaw) -> TorqueLaw:
    """Return the torque law with arrays (L, 3); raise InvalidInputError for other shapes and numbers."""
    return TorqueLaw(*(check_angles(f"torque_law: {name}", robot, value) for name, value in law._asdict().items()))
