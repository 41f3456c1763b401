"""Multibody dynamics with Pinocchio: the robot as a floating base with three joints a leg (A section 2, A(1)).

Velocities are Pinocchio's: linear and angular velocity of the body in its own frame (6), then the joint
rates leg by leg, and with foot springs each leg's spring rate behind its joints. This is the only module that
imports pinocchio and its collision library coal.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array
from hexakin.exceptions import InvalidInputError, MissingPackageError
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import GRAVITY, SEGMENT_NAMES, Body, Robot, check_robot

try:
    import coal  # noqa: F401 (for the rigid engine)
    import pinocchio as pin
except ImportError as error:
    raise MissingPackageError("pinocchio", "the dynamics", "pip install pin") from error

FOOT_SPRING_RATE = 9.28e3
"""Rate of ATHENA's foot springs [N/m] (A section 2.1, which prints N m)."""


class Energies(NamedTuple):
    """Kinetic and potential energy [J]; the latter is of gravity and counts from the world's origin."""

    kinetic: float
    potential: float


@lru_cache(maxsize=32)
def build_model(robot: Robot, foot_springs: bool = False) -> pin.Model:
    """Return the Pinocchio model of a robot: free flyer ``torso``, joints ``<name>_i`` and frames ``foot_i``, i from 1.

    With ``foot_springs`` each foot slides on a prismatic joint ``spring_i`` along its tibia (A section 2.1: 25 bodies,
    24 joints); without, it is fixed to the tibia, as A simulates it. The model is shared: do not change it.
    """
    check_robot(robot)
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
            # The spring works along the tibia: x of its segment frame.
            along = pin.SE3(frames[-1][:3, :3], placement.translation)
            parent = model.addJoint(parent, pin.JointModelPX(), along, f"spring_{leg + 1}")
            placement = pin.SE3(along.rotation.T @ placement.rotation, np.zeros(3))
        model.appendBodyToJoint(parent, _inertia(robot.foot), placement)
        model.addFrame(pin.Frame(f"foot_{leg + 1}", parent, placement, pin.FrameType.OP_FRAME))
    return model


def configuration(robot: Robot, T_world_body: ArrayLike, q: ArrayLike) -> Array:
    """Configuration (7 + 3 L,): base position, base quaternion xyzw, joint angles leg by leg.

    ``T_world_body`` (4, 4), ``q`` (L, 3) [rad].
    """
    T = check_array("T_world_body", T_world_body, (4, 4))
    angles = check_array("q", q, (robot.num_legs, NUM_JOINTS), ("leg", "joint"))
    return np.concatenate([pin.SE3ToXYZQUAT(pin.SE3(T)), angles.ravel()])


def mass_matrix(robot: Robot, configuration: ArrayLike) -> Array:
    """Mass matrix M (6 + 3 L, 6 + 3 L) at a configuration (7 + 3 L,)."""
    model, data, q = _prepared(robot, configuration)
    pin.crba(model, data, q)
    return np.triu(data.M) + np.triu(data.M, 1).T


def bias(robot: Robot, configuration: ArrayLike, velocity: ArrayLike) -> Array:
    """Coriolis, centrifugal and gravity terms C + g (6 + 3 L,) of A(1), completed (A-E5)."""
    model, data, q = _prepared(robot, configuration)
    return pin.nonLinearEffects(model, data, q, _velocity(model, velocity)).copy()


def gravity(robot: Robot, configuration: ArrayLike) -> Array:
    """Gravity term g (6 + 3 L,): the generalised force that holds the robot at rest."""
    model, data, q = _prepared(robot, configuration)
    return pin.computeGeneralizedGravity(model, data, q).copy()


def center_of_mass(robot: Robot, configuration: ArrayLike) -> Array:
    """Centre of mass (3,) [m] of the whole robot, in the world."""
    model, data, q = _prepared(robot, configuration)
    return pin.centerOfMass(model, data, q).copy()


def inverse_dynamics(robot: Robot, configuration: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> Array:
    """Generalised force M a + C + g (6 + 3 L,) that gives ``acceleration`` (6 + 3 L,)."""
    model, data, q = _prepared(robot, configuration)
    a = check_array("acceleration", acceleration, (model.nv,))
    return pin.rnea(model, data, q, _velocity(model, velocity), a).copy()


def foot_jacobians(robot: Robot, configuration: ArrayLike) -> Array:
    """Derivative (L, 3, 6 + 3 L) of each foot centre's velocity in the world by the generalised velocity."""
    model, data, q = _prepared(robot, configuration)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frames = (model.getFrameId(f"foot_{leg + 1}") for leg in range(robot.num_legs))
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return np.array([pin.getFrameJacobian(model, data, frame, aligned)[:3] for frame in frames])


def delassus(robot: Robot, configuration: ArrayLike) -> Array:
    """Delassus matrix J M^-1 J^T (3 L, 3 L) [1/kg] of the foot centres, in world axes."""
    J = foot_jacobians(robot, configuration).reshape(3 * robot.num_legs, -1)
    return J @ np.linalg.solve(mass_matrix(robot, configuration), J.T)


def energies(robot: Robot, configuration: ArrayLike, velocity: ArrayLike) -> Energies:
    """Kinetic and potential energy [J]."""
    model, data, q = _prepared(robot, configuration)
    kinetic = pin.computeKineticEnergy(model, data, q, _velocity(model, velocity))
    return Energies(float(kinetic), float(pin.computePotentialEnergy(model, data, q)))


class MaximalModel(NamedTuple):
    """A(1)'s maximal coordinates: each body's velocity at its centre of mass.

    ``names`` (b,) of the bodies, ``mass`` (6 b, 6 b), block diagonal, linear before angular, in world axes;
    ``jacobian`` (6 b, 6 + 3 L): the bodies' velocities by the generalised velocity.
    """

    names: tuple[str, ...]
    mass: Array
    jacobian: Array


def maximal_model(robot: Robot, configuration: ArrayLike) -> MaximalModel:
    """The robot's bodies one by one (A(1)): 25 for six legs, each foot counted by itself.

    Then J^T M J is the mass matrix of ``mass_matrix``. The inertias and places come from the description, not from the
    Pinocchio model, which merges fixed feet into tibiae.
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
    q = check_array("configuration", configuration, (model.nq,))
    if abs(np.linalg.norm(q[3:7]) - 1.0) > 1e-6:
        raise InvalidInputError(f"configuration: its quaternion has norm {np.linalg.norm(q[3:7]):g}, expected 1")
    return model, model.createData(), q


def _velocity(model: pin.Model, velocity: ArrayLike) -> Array:
    return check_array("velocity", velocity, (model.nv,))
