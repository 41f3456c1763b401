"""Contact forces that hold a robot at rest: an optimal distribution over its feet, or why there is none.

For each instant a quadratic programme over the forces f_i of the ground on the carrying feet::

    minimise    sum over all joints (tau / max_torque)^2  +  1e-6 sum |f_i|^2 / (m g)^2
    subject to  sum f_i + m g = 0,  sum (p_i - c) x f_i = 0        (equilibrium; c the centre of mass)
                f_i in its friction cone, |tau| <= max_torque      (tau = gravity of the leg - J_i^T f_i)

The cones are inscribed pyramids of ``facets`` sides, which lie within the true cone: a friction coefficient mu is used
down to mu cos(pi / facets) between two edges of the pyramid and in full along them; one edge points uphill.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_number
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility.casadi_legs import leg_states
from hexakin.feasibility.force_solver import MOST_FRICTION, diagnosed, satisfied, solved, solved_again
from hexakin.feasibility.statics import StaticProblem, static_problem
from hexakin.robot.model import Robot, check_robot
from hexakin.stability.friction_pyramid import pyramid_faces

OUTCOMES = ("balanced", "torque", "friction", "support")
"""Outcomes of an instant: forces were found; joints lack torque; feet would slide; the robot would tip or fall."""


@dataclass(frozen=True, eq=False)
class ForceDistribution:
    """Forces and joint torques of n instants.

    ``outcome`` (n,) is one of ``OUTCOMES``. ``force`` (n, L, 3) [N] of the ground on each foot, in the world, zero for
    a foot in the air; ``torque`` (n, L, 3) [N m] of the joints; ``cost`` (n,), the programme's optimum. All are NaN
    where the outcome is not "balanced". ``torque_needed`` (n,) [N m] is the smallest limit with which the
    instant could be held where the outcome is "torque", else NaN. ``center_of_mass`` (n, 3) [m] in the world.
    """

    outcome: NDArray[np.str_]
    force: Array
    torque: Array
    cost: Array
    torque_needed: Array
    center_of_mass: Array

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Whether forces were found, (n,)."""
        return self.outcome == "balanced"


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
    """Forces that hold the robot at rest at every instant with the least joint torque.

    Raises InvalidInputError for shapes or values that cannot be used, and SolverError if a problem was neither solved
    nor shown to have no solution.

    Parameters
    ----------
    T_world_body, q
        Poses (n, 4, 4) of the body in the world, whose z is up, and angles (n, L, 3) [rad].
    carrying
        Which feet the ground carries, (n, L).
    normals
        Unit normals of the ground under the feet, out of it, (n, L, 3) or one for all.
    friction, facets
        Coefficient of friction, and how many sides the pyramids have that stand for the cones.
    max_torque
        Limit of every joint [N m]; None is that of the robot's servo, ``inf`` is none.
    """
    check_robot(robot)
    check_number("friction", friction, at_least=0.0)
    limit = robot.servo.max_torque if max_torque is None else max_torque
    if not limit > 0.0:
        raise InvalidInputError(f"max_torque: {limit}, expected a number above 0 or inf")
    T = check_array("T_world_body", T_world_body, (4, 4))
    angles = check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    carry = np.asarray(carrying, dtype=bool)
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
    """Smallest coefficient of friction with which each instant can be held without limits of torque, (n,).

    Found by bisection to ``tolerance``; inf where even ``most`` is not enough.
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
    """Torque [N m] in which torques are counted: the limit, or the servo's where there is none."""
    return limit if np.isfinite(limit) else robot.servo.max_torque
