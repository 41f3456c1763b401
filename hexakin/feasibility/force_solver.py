"""Solvers of the force problems: quadratic programs of many instants, and linear programs of single instants.

The status that a solver reports is not used. Every solution is checked against the constraints. If the check fails at
an instant, a linear program shows that there is no solution, or another method solves the instant.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from hexakin.checks import Array
from hexakin.exceptions import SolverError
from hexakin.feasibility.statics import StaticProblem
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.stability.friction_pyramid import pyramid_faces

MOST_FRICTION = 10.0
"""Coefficient of friction larger than that of any ground; a robot that tips even with it is reported as tipping.

Without this bound, feet that are not exactly in one plane could press against each other with unbounded forces."""

_REGULARISATION = 1e-6  # weight of the squared forces in the cost
_EQUILIBRIUM = 1e-8  # [N] and [N m], largest residual of a solution
_INEQUALITY = 1e-8  # as a share of m g or of the torque limit: largest violation of an inequality
_CHUNK = 250  # instants solved in one call, so that their matrices stay in the processor's cache
_RANK = 1e-9  # as a share of the largest singular value: smaller values count as zero


@lru_cache(maxsize=16)
def _solver(size: int, rows: int, instants: int, name: str) -> ca.Function:
    """Solver of the quadratic programs of many instants in one call (CasADi's map)."""
    shapes = {"h": ca.Sparsity.dense(size, size), "a": ca.Sparsity.dense(rows, size)}
    return ca.conic("forces", name, shapes, {"error_on_fail": False}).map(instants)


def solved(problem: StaticProblem, bounded: bool, name: str = "daqp", rank: int = 6) -> tuple[Array, Array]:
    """Forces (n, 3 L) in the contact frames and costs (n,), not yet checked against the constraints.

    The forces are one solution of the equilibrium plus a combination of its null space, so that the equilibrium holds
    exactly with any tolerance of the solver. ``bounded`` applies the torque limits; ``name`` is CasADi's name of the
    solver. ``rank`` is the rank of the equilibrium. The results are NaN at instants with a lower rank (too few feet, or
    all feet on one line).
    """
    n, num_legs = problem.carrying.shape
    size = 3 * num_legs
    carried = np.repeat(problem.carrying, 3, axis=1)
    forces, costs = np.zeros((n, size)), np.zeros(n)
    for first in range(0, n, _CHUNK):
        span = slice(first, first + _CHUNK)
        held = problem.equilibrium[span] * carried[span, None]
        u, singular, vh = np.linalg.svd(held)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(singular > _RANK * singular[:, :1], 1.0 / singular, np.nan)[:, :rank]
        along = np.einsum("nij,i->nj", u[:, :, :rank], problem.weight)
        start = np.einsum("nji,nj->ni", vh[:, :rank], inverse * along)
        usable = np.isfinite(start).all(axis=1)
        free = vh[:, rank:].swapaxes(1, 2)
        found, cost = optimum(_programme(problem, bounded, span, np.where(usable[:, None], start, 0.0), free), name)
        force = np.where(carried[span], start + np.einsum("nij,nj->ni", free, found), 0.0)
        forces[span], costs[span] = np.where(usable[:, None], force, np.nan), np.where(usable, cost, np.nan)
    return forces, costs


def _programme(problem: StaticProblem, bounded: bool, span: slice, start: Array, free: Array) -> dict[str, Array]:
    """Quadratic programs of some instants over y, where the forces are start + free @ y; the first axis is the instant.

    Forces of feet in the air appear in the cost only, with weight 1, so that they become zero.
    """
    jacobian, rest = problem.torque_map[span], problem.torque_free[span]
    n, num_legs = rest.shape[:2]
    per_leg = free.reshape(n, num_legs, 3, -1)
    at_start = start.reshape(n, num_legs, 3)
    slope = np.einsum("nlij,nljk->nlik", jacobian, per_leg).reshape(n, 3 * num_legs, -1)
    offset = (rest + np.einsum("nlij,nlj->nli", jacobian, at_start)).reshape(n, -1)
    weight = np.where(problem.carrying[span], _REGULARISATION, 1.0).repeat(3, axis=1)
    cones = (problem.cone[span, None] @ per_leg) * problem.carrying[span, :, None, None]
    slack = -(problem.cone[span, None] @ at_start[..., None])[..., 0] * problem.carrying[span, :, None]
    rows, high = [cones.reshape(n, -1, free.shape[2])], [slack.reshape(n, -1)]
    low = [np.full_like(high[0], -np.inf)]
    if bounded:
        rows, low, high = [*rows, slope], [*low, -1.0 - offset], [*high, 1.0 - offset]
    weighted = weight[..., None] * free
    return {
        "h": 2.0 * (slope.swapaxes(1, 2) @ slope + free.swapaxes(1, 2) @ weighted),
        "g": 2.0 * np.einsum("nij,ni->nj", slope, offset) + 2.0 * np.einsum("nij,ni->nj", weighted, start),
        "a": np.concatenate(rows, axis=1),
        "lba": np.concatenate(low, axis=1),
        "uba": np.concatenate(high, axis=1),
        "constant": (offset**2).sum(axis=1) + (weight * start**2).sum(axis=1),
    }


@interrupts_kept()
def optimum(programme: dict[str, Array], name: str) -> tuple[Array, Array]:
    """Optimal y (n, k) and cost (n,) of the quadratic programs."""
    constant = programme.pop("constant")
    n, rows, size = programme["a"].shape
    side_by_side = {
        key: np.ascontiguousarray(np.moveaxis(value, 0, 1).reshape(value.shape[1], -1))
        for key, value in programme.items()
    }
    found = _solver(size, rows, n, name)(**side_by_side)
    return np.asarray(found["x"]).T, np.asarray(found["cost"])[0] + constant


def satisfied(problem: StaticProblem, solution: Array, bounded: bool) -> NDArray[np.bool_]:
    """Whether forces (n, 3 L) satisfy every constraint, (n,), computed without the solver's own status."""
    n = len(solution)
    force = solution.reshape(n, -1, 3)
    off = np.abs(np.einsum("nij,nj->ni", problem.equilibrium, solution) - problem.weight).max(axis=1)
    slip = (force @ problem.cone.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0)
    torque = problem.torque_free + np.einsum("nlij,nlj->nli", problem.torque_map, force)
    within = np.abs(torque).max(axis=(1, 2)) <= 1.0 + _INEQUALITY if bounded else np.ones(n, dtype=bool)
    return (off <= _EQUILIBRIUM / problem.unit) & (slip <= _INEQUALITY) & within


def smallest_torque(problem: StaticProblem, instant: int, cone: Array | None = None) -> float | None:
    """Smallest torque limit with which the robot is held at an instant, by a linear program; None if no forces hold it.

    The result is in units of the problem's torque limit. ``cone`` (facets, 3) replaces the pyramid of the problem.
    """
    jacobian, free = problem.torque_map[instant], problem.torque_free[instant]
    num_legs = len(jacobian)
    sides = problem.cone[instant] if cone is None else cone
    size = 3 * num_legs
    cones, torques = np.zeros((num_legs * len(sides), size + 1)), np.zeros((size, size))
    for leg in range(num_legs):
        own = slice(3 * leg, 3 * leg + 3)
        cones[leg * len(sides) : (leg + 1) * len(sides), own] = sides
        torques[own, own] = jacobian[leg]
    ones = np.ones((size, 1))
    inequalities = np.vstack([cones, np.hstack([torques, -ones]), np.hstack([-torques, -ones])])
    bounds = np.concatenate([np.zeros(len(cones)), -free.ravel(), free.ravel()])
    carried = np.repeat(problem.carrying[instant], 3)
    limits = [(None, None) if carries else (0.0, 0.0) for carries in carried] + [(0.0, None)]
    for method in _METHODS:
        found = linprog(
            np.r_[np.zeros(size), 1.0],
            A_ub=inequalities,
            b_ub=bounds,
            A_eq=np.hstack([problem.equilibrium[instant], np.zeros((6, 1))]),
            b_eq=problem.weight,
            bounds=limits,
            method=method,
        )
        if found.status == _INFEASIBLE:
            return None
        if found.status == 0:
            break
        # HiGHS found no result. This happens at instants at which the robot tips.
        if _shortfall(problem, instant, sides) > _LACKING:
            return None
    if found.status != 0:
        raise SolverError(f"force distribution at instant {instant}: {found.message}")
    return float(found.fun)


_METHODS = ("highs", "highs-ipm")
_INFEASIBLE = 2  # linprog's status of a problem that has no solution
_LACKING = 1e-6  # as a share of m g and of its moment: a larger residual shows that there is no solution


def _shortfall(problem: StaticProblem, instant: int, sides: Array) -> float:
    """Smallest residual wrench that the contact forces leave; this linear program always has a solution."""
    num_legs, size = problem.carrying.shape[1], 3 * problem.carrying.shape[1]
    carried = np.repeat(problem.carrying[instant], 3)
    found = linprog(
        np.r_[np.zeros(size), np.ones(12)],
        A_ub=np.hstack([np.kron(np.eye(num_legs), sides), np.zeros((num_legs * len(sides), 12))]),
        b_ub=np.zeros(num_legs * len(sides)),
        A_eq=np.hstack([problem.equilibrium[instant] * carried, np.eye(6), -np.eye(6)]),
        b_eq=problem.weight,
        bounds=[(None, None)] * size + [(0.0, None)] * 12,
    )
    return float(found.fun) if found.status == 0 else 0.0


def diagnosed(problem: StaticProblem, instant: int, bounded: bool) -> tuple[str, float]:
    """Outcome of an instant whose quadratic program was not solved, and the smallest torque limit, both by HiGHS."""
    share = smallest_torque(problem, instant)
    if share is not None:
        return ("torque" if bounded and share > 1.0 + 1e-7 else "balanced"), share
    rough = pyramid_faces(np.array([MOST_FRICTION]), problem.cone.shape[1])[0]
    return ("support" if smallest_torque(problem, instant, rough) is None else "friction"), float("nan")


def solved_again(problem: StaticProblem, instant: int, bounded: bool) -> tuple[Array, float]:
    """Solve an instant by another method; the instant has a solution, but the first method did not find it.

    Returns the forces (3 L,) and the cost. Raises SolverError if the other method fails too.
    """
    alone = problem.at(np.array([instant]))
    carried = alone.equilibrium[0] * np.repeat(alone.carrying[0], 3)
    singular = np.linalg.svd(carried, compute_uv=False)
    solution, cost = solved(alone, bounded, "piqp", rank=int((singular > _RANK * singular[0]).sum()))
    if not satisfied(alone, solution, bounded)[0]:
        raise SolverError(f"force distribution at instant {instant}: two methods did not find the solution that exists")
    return solution[0], float(cost[0])
