"""The rigid engine: Moreau time stepping with exact Coulomb friction on the robot's Pinocchio model (A section 3.1).

The method is that of Jean and Moreau (1992); ``hexakin.engines.moreau_step`` describes it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_whole, checked
from hexakin.dynamics import build_model, configuration, pin
from hexakin.engines.base import Engine, Reading, TorqueLaw, check_angles, check_law, check_place
from hexakin.engines.moreau_stepper import MoreauStepper, Servos
from hexakin.engines.shapes import Cuboid, Sphere
from hexakin.exceptions import InvalidInputError
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import SEGMENT_NAMES, Body, Robot
from hexakin.terrain.base import Terrain
from hexakin.transforms import pose


@checked
class RigidEngine(Engine):
    """A robot simulated with ``MoreauStepper``: feet are spheres, torso and limbs are boxes, as in the robot's URDF.

    The servo is the same as in PyBullet: a motor that moves its joint at rate * (command - angle) within its torque
    limit. Here ``angle`` is the angle at the end of the time step, so that the servo does not overshoot or oscillate
    with any time step. The engine does not enforce joint limits; controllers must keep them.

    ``robot``, ``terrain``, ``time_step`` [s], ``friction`` and ``restitution`` are those of ``Engine``.
    ``restitution_law``, ``restitution_threshold`` [m/s] and ``facets`` (None for the exact friction cone) are those of
    ``MoreauStepper``. The contact forces of each step are computed to the relative residual ``solver_tolerance``; the
    readings contain the largest residual and the number of steps above this tolerance, and a residual above 1e-3 ends
    the run with SimulationError. Equal
    runs give bit-identical readings. Raises InvalidInputError for a number out of its range or a robot whose feet have
    no radius, and UnknownNameError for an unknown ``restitution_law``.
    """

    packages = ("pin", "numba")

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        *,
        time_step: float = 0.001,
        friction: float = 0.9,
        restitution: float = 0.5,
        restitution_law: Literal["poisson", "newton"] = "poisson",
        restitution_threshold: float | None = None,
        facets: int | None = None,
        solver_tolerance: float = 1e-8,
    ):
        if robot.foot_radius == 0.0:
            raise InvalidInputError(f"robot {robot.name!r}: foot.radius is 0; a simulation needs spherical feet")
        self._robot = robot
        model = build_model(robot)
        names = [f"{joint}_{leg + 1}" for leg in range(robot.num_legs) for joint in robot.table.joints]
        joints = tuple(model.getJointId(name) for name in names)
        self._stepper = MoreauStepper(
            model,
            _shapes(robot, model, joints),
            terrain,
            servos=Servos(joints, robot.servo.rate, robot.servo.max_torque),
            groups=robot.num_legs + 2,
            time_step=time_step,
            friction=friction,
            restitution=restitution,
            restitution_law=restitution_law,
            restitution_threshold=restitution_threshold,
            facets=facets,
            tolerance=solver_tolerance,
        )

    def place(self, T_world_body: ArrayLike, q: ArrayLike) -> None:
        """Set the pose ``T_world_body`` (4, 4) and the joint angles ``q`` (L, 3) [rad] of the robot, at rest."""
        self._stepper.place(configuration(self._robot, *check_place(self._robot, T_world_body, q)))

    @checked
    def advance(self, q_command: ArrayLike, num_steps: int, torque_law: TorqueLaw | None = None) -> Reading:
        """Drive the joints for ``num_steps`` time steps, and return the state and sensor values after them.

        The servos drive the joints towards ``q_command`` (L, 3) [rad]. If ``torque_law`` is not None, the joints apply
        its torques instead, computed from the angles and rates at the end of each step; stiff and strongly damped laws
        are therefore stable too. Raises InvalidInputError for a wrong shape or number, and SimulationError if no
        contact forces are found.
        """
        robot, stepper = self._robot, self._stepper
        shape = (robot.num_legs, NUM_JOINTS)
        command = check_angles("q_command", robot, q_command)
        duration = check_whole("num_steps", num_steps, at_least=1) * stepper.time_step
        law = None if torque_law is None else check_law(robot, torque_law)
        sums = stepper.advance(num_steps, command, law)
        q, v = state = stepper.state()
        T = np.eye(4)
        T[:3, :3] = rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        T[:3, 3] = q[:3]
        force = sums.normal_impulse / duration
        return Reading(
            T_world_body=T,
            body_velocity=rotation @ v[:3],
            body_angular_velocity=v[3:6],
            body_rate_moment=sums.rate_moment / num_steps,
            q=q[7:].reshape(shape),
            joint_velocity=v[6:].reshape(shape),
            joint_torque=stepper.servo_torque.reshape(shape),
            foot_force=force[: robot.num_legs],
            foot_force_last=sums.last_normal_impulse[: robot.num_legs] / stepper.time_step,
            torso_force=float(force[robot.num_legs]),
            limb_force=float(force[robot.num_legs + 1]),
            penetration=sums.penetration,
            energy=stepper.energy(state),
            servo_work=sums.servo_work,
            contact_work=sums.contact_work,
            solver_residual=sums.residual,
            unsolved_steps=float(sums.unsolved_steps),
        )

    def close(self) -> None:
        """Do nothing: this engine holds no resources."""


def _shapes(robot: Robot, model: pin.Model, joints: tuple[int, ...]) -> tuple[Sphere | Cuboid, ...]:
    feet, torso, limbs = robot.num_legs, robot.num_legs, robot.num_legs + 1
    shapes: list[Sphere | Cuboid] = [_box(model.getJointId("torso"), np.eye(4), robot.torso, torso)]
    for leg in range(feet):
        frames = robot.segment_poses(leg)
        mine = joints[leg * NUM_JOINTS : (leg + 1) * NUM_JOINTS]
        shapes += [
            _box(joint, T, robot.segments[name], limbs)
            for joint, T, name in zip(mine, frames, SEGMENT_NAMES, strict=True)
        ]
        shapes.append(Sphere(mine[-1], robot.fixed_poses(leg)[-1][:3, 3], robot.foot_radius, leg))
    return tuple(shapes)


def _box(joint: int, T_joint_body: Array, body: Body, group: int) -> Cuboid:
    return Cuboid(joint, T_joint_body @ pose(np.eye(3), body.center_of_mass), body.size, group)
