"""Contact forces that hold a robot at rest: an optimal distribution over its feet, or the reason why there is none.

For each instant, a quadratic program determines the forces f_i of the ground on the feet that carry load::

    minimise    sum over all joints (tau / max_torque)^2  +  1e-6 sum |f_i|^2 / (m g)^2
    subject to  sum f_i + m g = 0,  sum (p_i - c) x f_i = 0        (equilibrium; c the centre of mass)
                f_i in its friction cone, |tau| <= max_torque      (tau = gravity of the leg - J_i^T f_i)

Linear constraints in place of friction cones are those of C. A. Klein and S. Kittivatcharapong, "Optimal force
distribution for the legs of a walking machine with friction cone constraints", IEEE Trans. Robotics and Automation
6(1), 1990. Here they are inscribed pyramids of ``facets`` sides, which lie inside the cones. Along the edges of a
pyramid the full friction coefficient mu is available, and between two edges at least mu cos(pi / facets). One edge
points uphill.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_flags, check_number, check_poses, checked
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility.casadi_legs import leg_states
from hexakin.feasibility.force_solver import MOST_FRICTION, diagnosed, satisfied, solved, solved_again
from hexakin.feasibility.statics import StaticProblem, static_problem
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot
from hexakin.stability.friction_pyramid import pyramid_faces

OUTCOMES = ("balanced", "torque", "friction", "support")
"""Outcomes of an instant: forces were found; torque is too small; the feet would slide; the robot would tip or fall."""


@dataclass(frozen=True, eq=False)
class ForceDistribution:
    """Contact forces and joint torques of n instants, as ``distribute`` returns them.

    Where the outcome is not "balanced", ``force``, ``torque`` and ``cost`` are NaN.

    Parameters
    ----------
    outcome
        One of ``OUTCOMES`` for each instant, a unit-free text (n,).
    force
        Forces (n, L, 3) [N] of the ground on the feet, in the world; zero for a foot in the air.
    torque
        Torques (n, L, 3) [N m] of the joints.
    cost
        Optima (n,) of the quadratic programs, numbers without a unit.
    torque_needed
        Smallest torque limit (n,) [N m] that would hold the robot where the outcome is "torque", else NaN.
    center_of_mass
        Centres of mass (n, 3) [m] in the world.
    """

    outcome: NDArray[np.str_]
    force: Array
    torque: Array
    cost: Array
    torque_needed: Array
    center_of_mass: Array

    __repr__ = short_repr

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Whether forces were found, (n,)."""
        return self.outcome == "balanced"


@checked
def distribute(
    robot: Robot,
    T_world_body: ArrayLike,
    q: ArrayLike,
    carrying: ArrayLike,
    normals: ArrayLike = (0.0, 0.0, 1.0),
    *,
    friction: float = 0.9,
    facets: int = 16,
    max_torque: float | None = None,
) -> ForceDistribution:
    """Contact forces that hold the robot at rest at n instants with the least joint torque.

    Returns a ``ForceDistribution``. Raises InvalidInputError for a wrong shape or value, and SolverError if a problem
    was neither solved nor shown to have no solution.

    Parameters
    ----------
    T_world_body, q
        Poses (n, 4, 4) of the body in the world, whose z axis points up, and joint angles (n, L, 3) [rad].
    carrying
        Which feet carry load, (n, L) bool.
    normals
        Unit vectors normal to the ground under the feet, pointing out of it: (n, L, 3), or (3,) for all feet.
    friction, facets
        Coefficient of friction, and number of sides of the pyramids that replace the friction cones.
    max_torque
        Torque limit [N m] of every joint. None is the limit of the robot's servo; ``inf`` means no limit.
    """
    check_number("friction", friction, at_least=0.0)
    limit = robot.servo.max_torque if max_torque is None else max_torque
    if not limit > 0.0:
        raise InvalidInputError(f"max_torque: {limit}, expected a number above 0 or inf")
    T = check_poses("T_world_body", T_world_body)
    angles = check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    carry = check_flags("carrying", carrying, (None, robot.num_legs))
    n = len(angles)
    if angles.ndim != 3 or T.shape != (n, 4, 4) or carry.shape != (n, robot.num_legs):
        shapes = f"T_world_body {T.shape}, q {angles.shape}, carrying {carry.shape}"
        raise InvalidInputError(
            f"expected shapes (n, 4, 4), (n, {robot.num_legs}, 3) and (n, {robot.num_legs}); got {shapes}"
        )
    if n == 0:
        none, joints = np.zeros(0), np.zeros((0, robot.num_legs, 3))
        return ForceDistribution(np.zeros(0, dtype="<U8"), joints, joints, none, none, np.zeros((0, 3)))
    problem = static_problem(
        robot,
        T,
        leg_states(robot, angles),
        carry,
        normals,
        friction=friction,
        facets=facets,
        torque_unit=_unit(robot, limit),
    )
    bounded = np.isfinite(limit)
    solution, cost = solved(problem, bounded)
    good = satisfied(problem, solution, bounded)
    outcome = np.where(good, "balanced", "").astype("<U8")
    needed = np.full(n, np.nan)
    for k in np.flatnonzero(~good):
        outcome[k], share = diagnosed(problem, int(k), bounded)
        if outcome[k] == "balanced":
            solution[k], cost[k] = solved_again(problem, int(k), bounded)
        elif outcome[k] == "torque":
            needed[k] = share * limit
    forces = problem.unit * np.einsum("nlij,nlj->nli", problem.frames, solution.reshape(n, -1, 3))
    torques = _unit(robot, limit) * (
        problem.torque_free + np.einsum("nlij,nlj->nli", problem.torque_map, solution.reshape(n, -1, 3))
    )
    held = outcome == "balanced"
    return ForceDistribution(
        outcome,
        np.where(held[:, None, None], forces, np.nan),
        np.where(held[:, None, None], torques, np.nan),
        np.where(held, cost, np.nan),
        needed,
        problem.center_of_mass,
    )


def friction_needed(problem: StaticProblem, *, most: float = MOST_FRICTION, tolerance: float = 1e-4) -> Array:
    """Smallest coefficient of friction (n,) that holds the robot at each instant, without torque limits.

    It is found by bisection with the given ``tolerance``, and is inf where a coefficient of ``most`` is not enough.
    """
    n, facets = problem.cone.shape[:2]

    def holds(friction: Array) -> NDArray[np.bool_]:
        tried = dataclasses.replace(problem, cone=pyramid_faces(friction, facets))
        return satisfied(tried, solved(tried, bounded=False)[0], bounded=False)

    possible = holds(np.full(n, most))
    low, high = np.zeros(n), np.full(n, most)
    while (high - low).max(initial=0.0) > tolerance:
        middle = 0.5 * (low + high)
        enough = holds(middle)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return np.where(possible, high, np.inf)


def _unit(robot: Robot, limit: float) -> float:
    """Unit of torque [N m] of the problem: the limit, or the servo's limit if there is none."""
    return limit if np.isfinite(limit) else robot.servo.max_torque
