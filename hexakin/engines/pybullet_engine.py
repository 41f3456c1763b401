"""The PyBullet engine: a Featherstone multibody with Bullet's projected Gauss-Seidel contact solver (A section 3.1)."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_whole, checked
from hexakin.engines.base import Engine, Reading, TorqueLaw, check_angles, check_law, check_place
from hexakin.engines.pybullet_ground import BulletGround
from hexakin.engines.pybullet_import import pybullet
from hexakin.exceptions import SimulationError
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import GRAVITY, Robot
from hexakin.robot.urdf import to_urdf
from hexakin.terrain.base import Terrain
from hexakin.transforms import inverse_pose, pose


@checked
class PyBulletEngine(Engine):
    """A robot simulated with PyBullet.

    The servo is Bullet's joint motor. With the position gain rate * time_step per step and the velocity gain 1 it
    drives the joint at rate * (command - angle), inside the solver and with limited torque. Bullet multiplies the
    coefficients of the two bodies of a contact; therefore those of the ground are 1, and those of the robot have the
    given values.

    ``robot``, ``terrain``, ``time_step`` [s], ``friction`` and ``restitution`` are those of ``Engine``. Bullet's
    Gauss-Seidel solver stops at the residual ``solver_residual`` or after ``solver_iterations``; with its default of 50
    iterations servos and rates are visibly unconverged. ``friction_model`` is a ``"pyramid"`` (A section 3.1
    approximates the cone by a polyhedron) or Bullet's ``"cone"``. Raises InvalidInputError for a number out of its
    range and UnknownNameError for an unknown ``friction_model``.
    """

    packages = ("pybullet", "pybullet-arm64")  # one of them is installed

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        *,
        time_step: float = 0.001,
        friction: float = 0.9,
        restitution: float = 0.5,
        solver_residual: float = 3e-3,
        solver_iterations: int = 500,
        friction_model: Literal["pyramid", "cone"] = "pyramid",
    ):
        self._robot = robot
        self._time_step = check_number("time_step", time_step, above=0.0, unit="s")
        check_number("friction", friction, at_least=0.0)
        check_number("restitution", restitution, at_least=0.0, at_most=1.0)
        check_number("solver_residual", solver_residual, at_least=0.0)
        check_whole("solver_iterations", solver_iterations, at_least=1)
        urdf = to_urdf(robot)
        self._client = pybullet.connect(pybullet.DIRECT)
        try:
            self._build(urdf, terrain, solver_residual, solver_iterations, friction_model, friction, restitution)
        except BaseException:
            self.close()
            raise

    def _build(
        self,
        urdf: str,
        terrain: Terrain,
        solver_residual: float,
        solver_iterations: int,
        friction_model: str,
        friction: float,
        restitution: float,
    ) -> None:
        pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._time_step,
            solverResidualThreshold=solver_residual,
            numSolverIterations=solver_iterations,
            enableConeFriction=int(friction_model == "cone"),
            numSubSteps=0,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        self._ground = BulletGround(terrain, self._client)
        self._body = self._load(urdf)
        links = range(-1, pybullet.getNumJoints(self._body, physicsClientId=self._client))
        # The pose of Bullet's base is that of its inertial frame: the centre of mass and the principal axes.
        _, _, _, place, turn, *_ = pybullet.getDynamicsInfo(self._body, -1, physicsClientId=self._client)
        self._T_body_inertial = pose(np.reshape(pybullet.getMatrixFromQuaternion(turn), (3, 3)), place)
        robot, per_leg = self._robot, NUM_JOINTS + 1
        self._joints = [per_leg * leg + k for leg in range(robot.num_legs) for k in range(NUM_JOINTS)]
        self._foot_of_link = {per_leg * leg + NUM_JOINTS: leg for leg in range(robot.num_legs)}
        for link in links:
            pybullet.changeDynamics(
                self._body,
                link,
                lateralFriction=friction,
                rollingFriction=0.0,
                spinningFriction=0.0,
                restitution=restitution,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                physicsClientId=self._client,
            )

    def _load(self, urdf: str) -> int:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(urdf, encoding="utf-8")
            # Without this flag Bullet computes the inertias from the collision shapes.
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            return pybullet.loadURDF(str(path), flags=flags, physicsClientId=self._client)

    def place(self, T_world_body: ArrayLike, q: ArrayLike) -> None:
        """Set the pose ``T_world_body`` (4, 4) and the joint angles ``q`` (L, 3) [rad] of the robot, at rest."""
        body, angles = check_place(self._robot, T_world_body, q)
        T = body @ self._T_body_inertial
        center, quaternion = T[:3, 3], _quat_xyzw(T[:3, :3])
        pybullet.resetBasePositionAndOrientation(self._body, center, quaternion, physicsClientId=self._client)
        pybullet.resetBaseVelocity(self._body, [0.0] * 3, [0.0] * 3, physicsClientId=self._client)
        for joint, angle in zip(self._joints, angles.ravel(), strict=True):
            pybullet.resetJointState(self._body, joint, angle, 0.0, physicsClientId=self._client)
        self._ground.reach(self._body)

    @checked
    def advance(self, q_command: ArrayLike, num_steps: int, torque_law: TorqueLaw | None = None) -> Reading:
        """Drive the joints for ``num_steps`` time steps, and return the state and sensor values after them.

        The servos drive the joints towards ``q_command`` (L, 3) [rad]. If ``torque_law`` is not None, the joints apply
        its torques instead, computed from the angles and rates at the beginning of each step; a joint of inertia I is
        then stable up to kd = 2 I / time_step. Raises InvalidInputError for a wrong shape or number, and
        SimulationError if the state is no longer finite.
        """
        robot = self._robot
        target = check_angles("q_command", robot, q_command).ravel()
        check_whole("num_steps", num_steps, at_least=1)
        self._drive_servos(target, 0.0 if torque_law is not None else robot.servo.max_torque)
        law = None if torque_law is None else check_law(robot, torque_law)
        torque = None
        foot, torso, limb, depth = np.zeros((num_steps, robot.num_legs)), 0.0, 0.0, 0.0
        rate_moment = np.zeros((3, 3))
        check = self._ground.steps_between_checks(self._time_step)
        for step in range(num_steps):
            if check and step % check == 0:
                self._ground.reach(self._body)
            if law is not None:
                torque = self._apply_torques(target, law)
            pybullet.stepSimulation(physicsClientId=self._client)
            rate = self._body_rate()
            rate_moment += rate[:, None] * rate
            for contact in pybullet.getContactPoints(bodyA=self._body, physicsClientId=self._client):
                link, force = contact[3], contact[9]
                depth = max(depth, -contact[8])
                if link in self._foot_of_link:
                    foot[step, self._foot_of_link[link]] += force
                elif link < 0:
                    torso += force
                else:
                    limb += force
        reading = self._read(foot, torso / num_steps, limb / num_steps, depth, rate_moment / num_steps)
        return reading if torque is None else reading._replace(joint_torque=torque.reshape(reading.q.shape))

    def _drive_servos(self, target: Array, max_torque: float) -> None:
        """Drive all joints towards angles (m,) [rad] with at most this torque [N m]; with 0 the servos are off."""
        count = len(self._joints)
        pybullet.setJointMotorControlArray(
            self._body,
            self._joints,
            pybullet.POSITION_CONTROL,
            targetPositions=target.tolist(),
            targetVelocities=[0.0] * count,
            forces=[max_torque] * count,
            positionGains=[self._robot.servo.rate * self._time_step] * count,
            velocityGains=[1.0] * count,
            physicsClientId=self._client,
        )

    def _apply_torques(self, target: Array, law: TorqueLaw) -> Array:
        """Apply a torque law for one step; returns the torques (m,) [N m]."""
        states = pybullet.getJointStates(self._body, self._joints, physicsClientId=self._client)
        angle, rate = np.array([state[:2] for state in states]).T
        kp, kd, added = (np.ravel(values) for values in law)
        limit = self._robot.servo.max_torque
        torque = np.clip(added + kp * (target - angle) - kd * rate, -limit, limit)
        pybullet.setJointMotorControlArray(
            self._body, self._joints, pybullet.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=self._client
        )
        return torque

    def _body_rate(self) -> Array:
        """Angular velocity (3,) [rad/s] in the body frame."""
        _, quaternion = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        _, angular = pybullet.getBaseVelocity(self._body, physicsClientId=self._client)
        inertial = np.reshape(pybullet.getMatrixFromQuaternion(quaternion), (3, 3))
        return self._T_body_inertial[:3, :3] @ (np.array(angular) @ inertial)

    def _read(self, foot: Array, torso: float, limb: float, depth: float, rate_moment: Array) -> Reading:
        client, shape = self._client, (self._robot.num_legs, NUM_JOINTS)
        states = pybullet.getJointStates(self._body, self._joints, physicsClientId=client)
        center, quaternion = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=client)
        velocity, angular = pybullet.getBaseVelocity(self._body, physicsClientId=client)
        T = np.eye(4)
        T[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(quaternion), (3, 3))
        T[:3, 3] = center
        T = T @ inverse_pose(self._T_body_inertial)
        lever = T[:3, :3] @ self._T_body_inertial[:3, 3]
        q = np.array([state[0] for state in states]).reshape(shape)
        if not (np.isfinite(T).all() and np.isfinite(q).all()):
            raise SimulationError(
                f"pybullet: the state is no longer finite at a time step of {self._time_step:g} s; use a smaller one"
            )
        return Reading(
            T_world_body=T,
            body_velocity=np.array(velocity) - np.cross(angular, lever),
            body_angular_velocity=T[:3, :3].T @ np.array(angular),
            body_rate_moment=rate_moment,
            q=q,
            joint_velocity=np.array([state[1] for state in states]).reshape(shape),
            joint_torque=np.array([state[3] for state in states]).reshape(shape),
            foot_force=foot.mean(axis=0),
            foot_force_last=foot[-1],
            torso_force=torso,
            limb_force=limb,
            penetration=depth,
        )

    def close(self) -> None:
        """Disconnect from the physics server; the engine cannot be used afterwards."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1


def _quat_xyzw(rotation: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat()
