"""The MuJoCo engine: joint coordinates, and soft contacts whose forces solve a convex problem (Todorov 2014)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_whole, checked
from hexakin.engines.base import Engine, Reading, TorqueLaw, check_angles, check_law, check_place
from hexakin.engines.mujoco_scene import SERVO_IMPEDANCE, ContactParameters, build_scene, mujoco
from hexakin.exceptions import InvalidInputError, SimulationError
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import GRAVITY, Robot
from hexakin.terrain.base import Terrain
from hexakin.transforms import pose

_FASTEST = 1e6  # [m/s, rad/s] a robot that is faster has diverged; assumed
_BASE = 6  # velocities of the torso's free joint, before those of the legs' joints


@checked
class MujocoEngine(Engine):
    """A robot simulated with MuJoCo: the model that ``hk.mjcf.to_mjcf`` writes, on a terrain.

    Feet are spheres, torso and limbs are boxes; they touch the ground and not each other. The friction cone is
    elliptic. Joint limits hold. Equal runs give bit-identical readings.

    The servo is the same as in engine "rigid": a motor that moves its joint at rate * (command - angle) within its
    torque limit, inside the solver, with the angle in the middle of the time step. MuJoCo's dry friction of joints is
    such a motor for the speed 0: a force within limits that stops the joint in one time step. The engine gives it the
    servo's speed, between the two halves of MuJoCo's step.

    MuJoCo's contacts are soft: a loaded contact gives way, and a foot that sticks creeps at a speed in proportion to
    its load. With the defaults, at 1 ms, ATHENA and PhantomX stand with a penetration of at most 0.1 mm, and their feet
    creep by at most 0.08 mm in 7 s on a slope of 20 degrees (7.6 mm with MuJoCo's ``impratio`` of 1). The defaults are
    the softest contacts that keep penetration and creep below 0.1 mm, among the impedances 0.9, 0.95, 0.99, 0.999 and
    0.9999 and the ratios 1, 10 and 100 (tests/test_mujoco_engine.py). Stiffer contacts creep less and cost more; the
    servos then answer the landing of a foot with torques up to their limit, and the torso shakes more.

    Friction is at most its coefficient. A foot that slides hops, because MuJoCo's contact law is convex: the ground
    pushes a foot that slides at speed v away at a speed of up to friction * v. ATHENA, sliding down 30 degrees at a
    friction of 0.3, has the acceleration of Coulomb's law to 5 %, but its contact force varies by three times the
    weight from step to step. A robot that is set down on a steep slope may therefore go on sliding: ATHENA sticks up to
    41.5 degrees at a friction of 0.9 (Coulomb's law: 42.0), and up to 53 degrees at 1.5 (56.3).

    MuJoCo has no coefficient of restitution. A contact that closes faster than 5 g h, with the time step h, is given a
    reference acceleration that turns its speed v into -restitution * v. Soft contacts follow it in part: ATHENA dropped
    flat on its torso rebounds with 0.46 of its speed at a restitution of 0.5, with 0.95 at 1, and with 0.04 at 0.

    ``robot``, ``terrain``, ``time_step`` [s], ``friction`` and ``restitution`` are those of ``Engine``. ``impedance``,
    ``impratio`` and ``damping_ratio`` are those of ``ContactParameters``. MuJoCo's Newton solver stops when a step
    improves the scaled cost by less than ``solver_tolerance``, or after ``solver_iterations``. Raises InvalidInputError
    for a number out of its range, a robot whose feet have no radius, and a terrain with a triangle mesh other than that
    of a ``HeightField``.
    """

    packages = ("mujoco",)

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        *,
        time_step: float = 0.001,
        friction: float = 0.9,
        restitution: float = 0.5,
        impedance: float = 0.95,
        impratio: float = 100.0,
        damping_ratio: float = 2.5,
        solver_tolerance: float = 1e-8,
        solver_iterations: int = 100,
    ):
        if robot.foot_radius == 0.0:
            raise InvalidInputError(f"robot {robot.name!r}: foot.radius is 0; a simulation needs spherical feet")
        self._robot = robot
        self._time_step = h = check_number("time_step", time_step, above=0.0, unit="s")
        self._restitution = check_number("restitution", restitution, at_least=0.0, at_most=1.0)
        scene = build_scene(
            robot,
            terrain,
            time_step=h,
            friction=check_number("friction", friction, at_least=0.0),
            contact=ContactParameters(
                check_number("impedance", impedance, at_least=1e-4, at_most=SERVO_IMPEDANCE),
                check_number("impratio", impratio, above=0.0),
                check_number("damping_ratio", damping_ratio, at_least=1.0),
            ),
            solver_tolerance=check_number("solver_tolerance", solver_tolerance, above=0.0),
            solver_iterations=check_whole("solver_iterations", solver_iterations, at_least=1),
        )
        self._model, self._group = scene
        self._data = mujoco.MjData(self._model)
        self._num_joints = NUM_JOINTS * robot.num_legs
        # The servo's rate for the angle in the middle of the step: speed = rate (command - angle - h speed / 2). The
        # error then falls by exp(-rate t) up to the third order of rate h.
        self._rate = robot.servo.rate / (1.0 + 0.5 * robot.servo.rate * h)
        # [m/s] Only faster contacts bounce; bodies at rest cannot reach it. It is that of engine "rigid".
        self._threshold = 5.0 * GRAVITY * h
        self._reset()

    def _reset(self) -> None:
        mujoco.mj_resetData(self._model, self._data)
        # MuJoCo prints the first warning of each kind and writes it to a file; _check_state raises errors instead.
        for warning in self._data.warning:
            warning.number = 1

    def place(self, T_world_body: ArrayLike, q: ArrayLike) -> None:
        """Set the pose ``T_world_body`` (4, 4) and the joint angles ``q`` (L, 3) [rad] of the robot, at rest."""
        T, angles = check_place(self._robot, T_world_body, q)
        quat_wxyz = np.zeros(4)
        mujoco.mju_mat2Quat(quat_wxyz, T[:3, :3].ravel())
        self._reset()
        self._data.qpos[:] = np.concatenate([T[:3, 3], quat_wxyz, angles.ravel()])

    @checked
    def advance(self, q_command: ArrayLike, num_steps: int, torque_law: TorqueLaw | None = None) -> Reading:
        """Drive the joints for ``num_steps`` time steps, and return the state and sensor values after them.

        The servos drive the joints towards ``q_command`` (L, 3) [rad]. If ``torque_law`` is not None, the joints apply
        its torques instead, computed from the angles and rates at the beginning of each step; a joint of inertia I is
        then stable up to kd = 2 I / time_step. The work of the joint limits counts as work of the contacts. Raises
        InvalidInputError for a wrong shape or number, and SimulationError if the state is no longer finite.
        """
        robot, model, data = self._robot, self._model, self._data
        target = check_angles("q_command", robot, q_command).ravel()
        check_whole("num_steps", num_steps, at_least=1)
        law = None if torque_law is None else TorqueLaw(*map(np.ravel, check_law(robot, torque_law)))
        model.dof_frictionloss[_BASE:] = robot.servo.max_torque if law is None else 0.0
        data.ctrl[:] = 0.0
        groups, velocity = robot.num_legs + 2, data.qvel
        force: Array = np.zeros(groups)
        last: Array = np.zeros(groups)
        depth = 0.0
        rate_moment, servo_work, contact_work = np.zeros((3, 3)), 0.0, 0.0
        for _ in range(num_steps):
            mujoco.mj_step1(model, data)
            first = len(data.efc_aref) - 3 * data.ncon  # the rows of the contacts are the last ones
            if first < (0 if law else self._num_joints):
                self._check_state()
            self._drive(target, law)
            if data.ncon and self._restitution > 0.0:
                self._set_rebound(first)
            before = velocity.copy()
            if not before @ before < _FASTEST**2:
                raise self._diverged(f"a speed of {np.abs(before).max():.3g} m/s or rad/s")
            mujoco.mj_step2(model, data)
            torque = data.efc_force[: self._num_joints] if law is None else data.ctrl
            # The mean of the velocities before and after a step makes the work equal to the change of kinetic energy.
            mean = 0.5 * (before + velocity)
            power = float(torque @ mean[_BASE:])
            servo_work += power
            contact_work += float(data.qfrc_constraint @ mean) - (power if law is None else 0.0)
            rate_moment += velocity[3:6, None] * velocity[3:6]
            last = np.zeros(groups)
            if data.ncon:
                touched = self._group[data.contact.geom].max(axis=1)
                last = np.bincount(touched, data.efc_force[first::3], groups).astype(float)
                force += last
                depth = max(depth, -float(data.contact.dist.min()))
        self._check_state()
        legs, shape = robot.num_legs, (robot.num_legs, NUM_JOINTS)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
        force /= num_steps
        return Reading(
            T_world_body=pose(rotation.reshape(3, 3), data.qpos[:3]),
            body_velocity=velocity[:3].copy(),
            body_angular_velocity=velocity[3:6].copy(),
            body_rate_moment=rate_moment / num_steps,
            q=data.qpos[7:].reshape(shape).copy(),
            joint_velocity=velocity[_BASE:].reshape(shape).copy(),
            joint_torque=torque.reshape(shape).copy(),
            foot_force=force[:legs],
            foot_force_last=last[:legs],
            torso_force=float(force[legs]),
            limb_force=float(force[legs + 1]),
            penetration=depth,
            energy=self._energy(),
            servo_work=self._time_step * servo_work,
            contact_work=self._time_step * contact_work,
        )

    def _drive(self, target: Array, law: TorqueLaw | None) -> None:
        """Set what the joints do in the step that has begun; ``target`` (3 L,) [rad] and ``law`` in flat arrays."""
        data, limit = self._data, self._robot.servo.max_torque
        q, velocity = data.qpos[7:], data.qvel[_BASE:]
        if law is None:
            # The servos are the first rows. Their reference acceleration leads to the servo's speed in one step.
            data.efc_aref[: self._num_joints] = (self._rate * (target - q) - velocity) / self._time_step
        else:
            data.ctrl[:] = np.clip(law.torque + law.kp * (target - q) - law.kd * velocity, -limit, limit)

    def _set_rebound(self, first: int) -> None:
        """Set the reference acceleration of the contacts that close fast; their rows begin with row ``first``."""
        speed = self._data.efc_vel[first::3]
        fast = speed < -self._threshold
        if fast.any():
            self._data.efc_aref[first::3][fast] = -(1.0 + self._restitution) * speed[fast] / self._time_step

    def _check_state(self) -> None:
        for index, warning in enumerate(self._data.warning):
            if warning.number > 1:
                raise self._diverged(mujoco.mju_warningText(index, warning.lastinfo))

    def _diverged(self, what: str) -> SimulationError:
        return SimulationError(f"mujoco: {what} at a time step of {self._time_step:g} s; use a smaller one")

    def _energy(self) -> float:
        """Return the kinetic and potential energy [J] of the present state, whose positions are not yet computed."""
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return float(data.energy.sum())

    def close(self) -> None:
        """Do nothing: MuJoCo's memory is released with the engine."""
