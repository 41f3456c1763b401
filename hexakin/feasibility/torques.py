"""Contact forces from joint torques and torques from forces, and the internal part of the contact forces.

Forces and torques of a leg at rest are related by the transpose of the Jacobian (J. J. Craig, "Introduction to
robotics", 1986). Internal forces are those of V. Kumar and K. J. Waldron, "Force distribution in closed kinematic
chains", IEEE J. Robotics and Automation 4(6), 1988.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_flags, check_poses, checked
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility.casadi_legs import leg_states
from hexakin.feasibility.statics import StaticProblem, static_problem
from hexakin.robot.model import Robot

_SINGULAR = 1e8  # condition number of a leg's Jacobian above which torques do not determine the force along the leg


@checked
def forces_from_torques(
    robot: Robot, T_world_body: ArrayLike, q: ArrayLike, torque: ArrayLike, normals: ArrayLike = (0.0, 0.0, 1.0)
) -> Array:
    """Forces (n, L, 3) [N] of the ground on the feet, in the world, that hold legs at rest under given joint torques.

    f = J^-T (g - tau), with the Jacobian J of the contact point and the torques g of the leg's own weight. This is the
    inverse of ``torques_from_forces``. For a leg in the air at rest the force is zero; if the leg accelerates, it is
    the force that the acceleration would need.

    Raises InvalidInputError for shapes that do not fit together and for a leg that is stretched straight.

    Parameters
    ----------
    T_world_body, q
        Poses (n, 4, 4) of the body in the world, whose z axis points up, and joint angles (n, L, 3) [rad].
    torque
        Torques (n, L, 3) [N m] of the joints, positive in the direction of the angles.
    normals
        Unit vectors normal to the ground under the feet, pointing out of it: (n, L, 3), or (3,) for all feet.
    """
    problem, tau = _problem(robot, T_world_body, q, torque, normals, "torque")
    condition = np.linalg.cond(problem.torque_map)
    if (condition > _SINGULAR).any():
        instant, leg = np.argwhere(condition > _SINGULAR)[0]
        said = f"leg {leg + 1} is stretched straight at instant {instant}"
        raise InvalidInputError(f"q: {said}; torques do not determine its force")
    local = np.linalg.solve(problem.torque_map, (tau - problem.torque_free)[..., None])
    return problem.unit * (problem.frames @ local)[..., 0]


@checked
def torques_from_forces(
    robot: Robot, T_world_body: ArrayLike, q: ArrayLike, force: ArrayLike, normals: ArrayLike = (0.0, 0.0, 1.0)
) -> Array:
    """Joint torques (n, L, 3) [N m] that hold legs at rest under given forces of the ground.

    This is the inverse of ``forces_from_torques``. Raises InvalidInputError for shapes that do not fit together.

    Parameters
    ----------
    T_world_body, q
        Poses (n, 4, 4) of the body in the world, whose z axis points up, and joint angles (n, L, 3) [rad].
    force
        Forces (n, L, 3) [N] of the ground on the feet, in the world; zero for a foot in the air.
    normals
        Unit vectors normal to the ground under the feet, pointing out of it: (n, L, 3), or (3,) for all feet.
    """
    problem, f = _problem(robot, T_world_body, q, force, normals, "force")
    local = problem.frames.swapaxes(-1, -2) @ f[..., None] / problem.unit
    return problem.torque_free + (problem.torque_map @ local)[..., 0]


def _problem(
    robot: Robot, T_world_body: ArrayLike, q: ArrayLike, given: ArrayLike, normals: ArrayLike, name: str
) -> tuple[StaticProblem, Array]:
    """Statics with all feet on the ground and torques in N m, and the ``given`` values (n, L, 3) after a check."""
    T = check_poses("T_world_body", T_world_body)
    shape = (robot.num_legs, 3)
    angles = check_array("q", q, shape, ("leg", "joint"))
    values = check_array(name, given, shape, ("leg", "component"))
    if angles.ndim != 3 or T.shape != (len(angles), 4, 4) or values.shape != angles.shape:
        shapes = f"T_world_body {T.shape}, q {angles.shape}, {name} {values.shape}"
        raise InvalidInputError(f"expected shapes (n, 4, 4), (n, {shape[0]}, 3) and (n, {shape[0]}, 3); got {shapes}")
    every = np.ones(angles.shape[:2], dtype=bool)
    states = leg_states(robot, angles)
    return static_problem(robot, T, states, every, normals, friction=0.0, facets=3, torque_unit=1.0), values


def internal_forces(points: ArrayLike, force: ArrayLike, carrying: ArrayLike) -> Array:
    """Internal part (n, L, 3) [N] of contact forces: it has no resultant force and no resultant moment.

    The rest, ``force`` (n, L, 3) [N] minus this part, is the smallest set of forces with the same resultant force and
    moment. For this comparison, moments are divided by the mean distance of the feet from their mean position. Raises
    InvalidInputError for shapes that do not fit together.

    Parameters
    ----------
    points
        Points (n, L, 3) [m] at which the forces act.
    force
        Forces (n, L, 3) [N] of the ground on the feet.
    carrying
        Which feet carry load, (n, L) bool. The forces of the other feet are left out, and zero in the result.
    """
    where, f = (check_array(name, v, (3,), ("coordinate",)) for name, v in (("points", points), ("force", force)))
    carry = check_flags("carrying", carrying, (None, None))
    if f.ndim != 3 or where.shape != f.shape or carry.shape != f.shape[:2]:
        shapes = f"points {where.shape}, force {f.shape}, carrying {carry.shape}"
        raise InvalidInputError(f"expected shapes (n, L, 3), (n, L, 3) and (n, L); got {shapes}")
    count = np.maximum(carry.sum(axis=1), 1)[:, None]
    arm = where - (where * carry[..., None]).sum(axis=1, keepdims=True) / count[..., None]
    size = (np.linalg.norm(arm, axis=-1) * carry).sum(axis=1, keepdims=True) / count
    arm = arm / np.where(size > 0.0, size, 1.0)[..., None]
    balance = np.zeros((*f.shape[:2], 6, 3))
    balance[:, :, :3] = np.eye(3)
    balance[:, :, 3:] = np.cross(arm[..., None], np.eye(3), axisa=-2, axisb=-2, axisc=-2)
    balance = np.moveaxis(np.where(carry[..., None, None], balance, 0.0), 1, 2).reshape(len(f), 6, -1)
    carried = np.where(carry[..., None], f, 0.0)
    flat = carried.reshape(len(f), -1, 1)
    needed = (np.linalg.pinv(balance) @ (balance @ flat)).reshape(f.shape)
    return np.where(carry[..., None], f - needed, 0.0)
