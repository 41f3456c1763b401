"""Multibody dynamics with Pinocchio: the robot as a floating base with three joints per leg (A section 2, A(1)).

Generalised coordinates and velocities are Pinocchio's. A configuration (7 + 3 L,) is the base position [m], the base
quaternion xyzw and the joint angles [rad] leg by leg; the function ``configuration`` returns it. A generalised velocity
(6 + 3 L,) is the linear [m/s] and angular [rad/s] velocity of the body in its own frame, then the joint speeds [rad/s]
leg by leg. With foot springs each leg's spring follows its joints. A generalised force (6 + 3 L,) is the force [N] and
moment [N m] on the body in its own frame, then the joint torques [N m].

This is the only module that imports pinocchio.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_poses, check_shape, checked
from hexakin.exceptions import InvalidInputError, MissingPackageError
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import GRAVITY, SEGMENT_NAMES, Body, Robot

try:
    import pinocchio as pin
except ImportError as error:
    # PyPI has no wheel for Windows.
    _install = "conda install -c conda-forge pinocchio" if sys.platform == "win32" else "pip install pin"
    raise MissingPackageError("pinocchio", "the dynamics", _install) from error

FOOT_SPRING_RATE = 9.28e3
"""Stiffness of ATHENA's foot springs [N/m] (A section 2.1, which prints the unit as N m)."""


class Energies(NamedTuple):
    """The energies ``kinetic`` [J] and ``potential`` [J], which is that of gravity, 0 at the world's origin."""

    kinetic: float
    potential: float


@checked
@lru_cache(maxsize=32)
def build_model(robot: Robot, foot_springs: bool = False) -> pin.Model:
    """Return the Pinocchio model of ``robot``: free flyer ``torso``, joints ``<name>_i``, frames ``foot_i``, i from 1.

    With ``foot_springs`` each foot slides on a prismatic joint ``spring_i`` along its tibia (A section 2.1: 25 bodies,
    24 joints). Without them the foot is fixed to the tibia, as in A's simulations. The model is shared by all callers:
    do not change it.
    """
    model = pin.Model()
    model.name = robot.name
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "torso")
    model.appendBodyToJoint(base, _inertia(robot.torso), pin.SE3.Identity())
    for leg in range(robot.num_legs):
        fixed, frames = robot.fixed_poses(leg), robot.segment_poses(leg)
        parent = base
        for k, name in enumerate(SEGMENT_NAMES):
            parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(fixed[k]), f"{robot.table.joints[k]}_{leg + 1}")
            model.appendBodyToJoint(parent, _inertia(robot.segments[name]), pin.SE3(frames[k]))
        placement = pin.SE3(fixed[-1])
        if foot_springs:
            # The spring acts along the tibia, the x axis of its segment frame.
            along = pin.SE3(frames[-1][:3, :3], placement.translation)
            parent = model.addJoint(parent, pin.JointModelPX(), along, f"spring_{leg + 1}")
            placement = pin.SE3(along.rotation.T @ placement.rotation, np.zeros(3))
        model.appendBodyToJoint(parent, _inertia(robot.foot), placement)
        model.addFrame(pin.Frame(f"foot_{leg + 1}", parent, placement, pin.FrameType.OP_FRAME))
    return model


@checked
def configuration(robot: Robot, T_world_body: ArrayLike, q: ArrayLike) -> Array:
    """Return the configuration (7 + 3 L,) [m, rad]: base position, base quaternion xyzw, joint angles leg by leg.

    ``T_world_body`` (4, 4) is the body's pose, ``q`` (L, 3) [rad] are the joint angles.
    """
    T = check_poses("T_world_body", check_shape("T_world_body", T_world_body, (4, 4)))
    angles = check_shape("q", q, (robot.num_legs, NUM_JOINTS), ("leg", "joint"))
    return np.concatenate([pin.SE3ToXYZQUAT(pin.SE3(T)), angles.ravel()])


@checked
def mass_matrix(robot: Robot, configuration: ArrayLike) -> Array:
    """Return the mass matrix M (6 + 3 L, 6 + 3 L) [kg, kg m, kg m^2] at ``configuration`` (7 + 3 L,) [m, rad]."""
    model, data, q = _prepared(robot, configuration)
    pin.crba(model, data, q)
    return np.triu(data.M) + np.triu(data.M, 1).T


@checked
def bias(robot: Robot, configuration: ArrayLike, velocity: ArrayLike) -> Array:
    """Return the Coriolis, centrifugal and gravity terms C + g (6 + 3 L,) [N, N m] of A(1), completed (A-E5).

    They depend on ``configuration`` (7 + 3 L,) [m, rad] and ``velocity`` (6 + 3 L,) [m/s, rad/s].
    """
    model, data, q = _prepared(robot, configuration)
    return pin.nonLinearEffects(model, data, q, _velocity(model, velocity)).copy()


@checked
def gravity(robot: Robot, configuration: ArrayLike) -> Array:
    """Return the gravity term g (6 + 3 L,) [N, N m], the generalised force that holds the robot at rest.

    It depends on ``configuration`` (7 + 3 L,) [m, rad].
    """
    model, data, q = _prepared(robot, configuration)
    return pin.computeGeneralizedGravity(model, data, q).copy()


@checked
def center_of_mass(robot: Robot, configuration: ArrayLike) -> Array:
    """Return the centre of mass (3,) [m] of the whole robot in the world, at ``configuration`` (7 + 3 L,) [m, rad]."""
    model, data, q = _prepared(robot, configuration)
    return pin.centerOfMass(model, data, q).copy()


@checked
def inverse_dynamics(robot: Robot, configuration: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> Array:
    """Return the generalised force M a + C + g (6 + 3 L,) [N, N m] that causes an acceleration a.

    ``acceleration`` (6 + 3 L,) [m/s^2, rad/s^2] is a. The force is that at ``configuration`` (7 + 3 L,) [m, rad] and
    ``velocity`` (6 + 3 L,) [m/s, rad/s].
    """
    model, data, q = _prepared(robot, configuration)
    a = check_shape("acceleration", acceleration, (model.nv,))
    return pin.rnea(model, data, q, _velocity(model, velocity), a).copy()


@checked
def foot_jacobians(robot: Robot, configuration: ArrayLike) -> Array:
    """Return the Jacobians (L, 3, 6 + 3 L) [1, m] of the foot centres at ``configuration`` (7 + 3 L,) [m, rad].

    They map the generalised velocity to the velocities [m/s] of the foot centres in the world.
    """
    model, data, q = _prepared(robot, configuration)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frames = (model.getFrameId(f"foot_{leg + 1}") for leg in range(robot.num_legs))
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return np.array([pin.getFrameJacobian(model, data, frame, aligned)[:3] for frame in frames])


@checked
def delassus(robot: Robot, configuration: ArrayLike) -> Array:
    """Return the Delassus matrix J M^-1 J^T (3 L, 3 L) [1/kg] of the foot centres, in world axes.

    J are the ``foot_jacobians`` and M is the ``mass_matrix`` at ``configuration`` (7 + 3 L,) [m, rad].
    """
    J = foot_jacobians(robot, configuration).reshape(3 * robot.num_legs, -1)
    return J @ np.linalg.solve(mass_matrix(robot, configuration), J.T)


@checked
def energies(robot: Robot, configuration: ArrayLike, velocity: ArrayLike) -> Energies:
    """Return the kinetic and potential energy [J].

    They are those at ``configuration`` (7 + 3 L,) [m, rad] and ``velocity`` (6 + 3 L,) [m/s, rad/s].
    """
    model, data, q = _prepared(robot, configuration)
    kinetic = pin.computeKineticEnergy(model, data, q, _velocity(model, velocity))
    return Energies(float(kinetic), float(pin.computePotentialEnergy(model, data, q)))


class MaximalModel(NamedTuple):
    """The maximal coordinates of A(1): the velocity of each body at its centre of mass, in world axes.

    ``names`` are those of the b bodies. ``mass`` (6 b, 6 b) [kg, kg m^2] is block diagonal; for each body, linear
    coordinates come before angular ones. ``jacobian`` (6 b, 6 + 3 L) [1, m] maps the generalised velocity to the
    velocities of the bodies.
    """

    names: tuple[str, ...]
    mass: Array
    jacobian: Array

    def __repr__(self) -> str:
        return short_repr(self)


@checked
def maximal_model(robot: Robot, configuration: ArrayLike) -> MaximalModel:
    """Return mass matrix M and Jacobian J of the separate bodies of A(1): 25 for six legs, since feet are separate.

    They are those at ``configuration`` (7 + 3 L,) [m, rad]. J^T M J equals ``mass_matrix``. Inertias and positions come
    from the robot's description, because the Pinocchio model merges fixed feet with the tibiae.
    """
    model, data, q = _prepared(robot, configuration)
    pin.computeJointJacobians(model, data, q)
    bodies = [("torso", robot.torso, model.getJointId("torso"), pin.SE3.Identity())]
    for leg in range(robot.num_legs):
        frames, number = robot.segment_poses(leg), leg + 1
        joints = [model.getJointId(f"{name}_{number}") for name in robot.table.joints]
        for name, joint, frame in zip(SEGMENT_NAMES, joints, frames, strict=True):
            bodies.append((f"{name}_{number}", robot.segments[name], joint, pin.SE3(frame)))
        bodies.append((f"foot_{number}", robot.foot, joints[-1], pin.SE3(robot.fixed_poses(leg)[-1])))
    mass = np.zeros((6 * len(bodies), 6 * len(bodies)))
    jacobian = np.zeros((6 * len(bodies), model.nv))
    for k, (_, body, joint, placement) in enumerate(bodies):
        T_world = data.oMi[joint] * placement
        rotation, center = T_world.rotation, T_world.act(body.center_of_mass)
        block = slice(6 * k, 6 * k + 6)
        mass[block, block][:3, :3] = body.mass * np.eye(3)
        mass[block, block][3:, 3:] = rotation @ body.inertia @ rotation.T
        at_joint = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        lever = center - data.oMi[joint].translation
        jacobian[block][:3] = at_joint[:3] - pin.skew(lever) @ at_joint[3:]
        jacobian[block][3:] = at_joint[3:]
    return MaximalModel(tuple(name for name, *_ in bodies), mass, jacobian)


def _inertia(body: Body) -> pin.Inertia:
    return pin.Inertia(body.mass, np.array(body.center_of_mass), np.array(body.inertia))


def _prepared(robot: Robot, configuration: ArrayLike) -> tuple[pin.Model, pin.Data, Array]:
    model = build_model(robot)
    q = check_shape("configuration", configuration, (model.nq,))
    if abs(np.linalg.norm(q[3:7]) - 1.0) > 1e-6:
        raise InvalidInputError(f"configuration: its quaternion has norm {np.linalg.norm(q[3:7]):g}, expected 1")
    return model, model.createData(), q


def _velocity(model: pin.Model, velocity: ArrayLike) -> Array:
    return check_shape("velocity", velocity, (model.nv,))
