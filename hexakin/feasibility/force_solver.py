"""Solving the force problems: quadratic programmes of many instants at once, and linear ones for what they leave.

What a solver says of itself is not asked. Every answer is checked against the constraints; an instant without a good
one is shown by a linear programme to have none, or solved by another method.
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
from hexakin.stability.friction_pyramid import pyramid_faces

MOST_FRICTION = 10.0
"""Coefficient of friction beyond any ground's: what tips even with it tips, and is not said to slide.

Feet that are not quite in one plane could else be wedged against each other by forces without bound."""

_REGULARISATION = 1e-6
_EQUILIBRIUM = 1e-8  # [N], and of moments [N m]
_INEQUALITY = 1e-8  # of m g, and of the torque limit
_CHUNK = 250  # instants solved in one call: their matrices stay in the processor's cache
_RANK = 1e-9  # of the largest singular value


@lru_cache(maxsize=16)
def _solver(size: int, rows: int, instants: int, name: str) -> ca.Function:
    """Quadratic programmes of many instants in one call, side by side (CasADi's map)."""
    shapes = {"h": ca.Sparsity.dense(size, size), "a": ca.Sparsity.dense(rows, size)}
    return ca.conic("forces", name, shapes, {"error_on_fail": False}).map(instants)


def solved(problem: StaticProblem, bounded: bool, name: str = "daqp", rank: int = 6) -> tuple[Array, Array]:
    """Forces (n, 3 L) in the contact frames and costs (n,), not checked yet.

    Forces are one solution of the equilibrium plus what leaves it as it is, so that no solver's tolerance touches it.
    ``rank`` is that of the equilibrium; instants of a lower one (feet in line, or too few) have NaN.
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
    """Quadratic programmes of some instants over y, with the forces start + free @ y; instants first.

    Forces of feet in the air stand alone in the cost, so that they come out as zero.
    """
    jacobian, rest = problem.torque_map[span], problem.torque_free[span]
    n, num_legs = rest.shape[:2]
    per_leg = free.reshape(n, num_legs, 3, -1)
    at_start = start.reshape(n, num_legs, 3)
    slope = np.einsum("nlij,nljk->nlik", jacobian, per_leg).reshape(n, 3 * num_legs, -1)
    offset = (rest + np.einsum("nlij,nlj->nli", jacobian, at_start)).reshape(n, -1)
    weight = np.where(problem.carrying[span], _REGULARISATION, 1.0).repeat(3, axis=1)
    cones = (problem.cone[span, None] @ per_leg) * problem.carrying[span, :, None, None]
    room = -(problem.cone[span, None] @ at_start[..., None])[..., 0] * problem.carrying[span, :, None]
    rows, high = [cones.reshape(n, -1, free.shape[2])], [room.reshape(n, -1)]
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


def optimum(programme: dict[str, Array], name: str) -> tuple[Array, Array]:
    """Optimal y (n, k) and cost (n,) of the programmes."""
    constant = programme.pop("constant")
    n, rows, size = programme["a"].shape
    side_by_side = {
        key: np.ascontiguousarray(np.moveaxis(value, 0, 1).reshape(value.shape[1], -1))
        for key, value in programme.items()
    }
    found = _solver(size, rows, n, name)(**side_by_side)
    return np.asarray(found["x"]).T, np.asarray(found["cost"])[0] + constant


def satisfied(problem: StaticProblem, solution: Array, bounded: bool) -> NDArray[np.bool_]:
    """Whether forces (n, 3 L) keep every constraint; what the solver says of itself is not asked."""
    n = len(solution)
    force = solution.reshape(n, -1, 3)
    off = np.abs(np.einsum("nij,nj->ni", problem.equilibrium, solution) - problem.weight).max(axis=1)
    slip = (force @ problem.cone.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0)
    torque = problem.torque_free + np.einsum("nlij,nlj->nli", problem.torque_map, force)
    within = np.abs(torque).max(axis=(1, 2)) <= 1.0 + _INEQUALITY if bounded else np.ones(n, dtype=bool)
    return (off <= _EQUILIBRIUM / problem.unit) & (slip <= _INEQUALITY) & within


def smallest_torque(problem: StaticProblem, instant: int, cone: Array | None = None) -> float | None:
    """Smallest largest torque [limit] that holds an instant, found by a linear programme; None if nothing holds it."""
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
        # Left open, which happens at instants at which the robot tips.
        if _shortfall(problem, instant, sides) > _LACKING:
            return None
    if found.status != 0:
        raise SolverError(f"force distribution at instant {instant}: {found.message}")
    return float(found.fun)


_METHODS = ("highs", "highs-ipm")
_INFEASIBLE = 2  # linprog's status of a problem that is shown to have no solution
_LACKING = 1e-6  # of m g, and of its moment


def _shortfall(problem: StaticProblem, instant: int, sides: Array) -> float:
    """Least sum of force and moment that lacks when the feet carry what they can; this always has a solution."""
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
    """Outcome of an instant whose programme was not solved, and the smallest largest torque [limit], by HiGHS."""
    share = smallest_torque(problem, instant)
    if share is not None:
        return ("torque" if bounded and share > 1.0 + 1e-7 else "balanced"), share
    rough = pyramid_faces(np.array([MOST_FRICTION]), problem.cone.shape[1])[0]
    return ("support" if smallest_torque(problem, instant, rough) is None else "friction"), float("nan")


def solved_again(problem: StaticProblem, instant: int, bounded: bool) -> tuple[Array, float]:
    """Solve by another method an instant that has a solution, though the first method found none."""
    alone = problem.at(np.array([instant]))
    carried = alone.equilibrium[0] * np.repeat(alone.carrying[0], 3)
    singular = np.linalg.svd(carried, compute_uv=False)
    solution, cost = solved(alone, bounded, "piqp", rank=int((singular > _RANK * singular[0]).sum()))
    if not satisfied(alone, solution, bounded)[0]:
        raise SolverError(f"force distribution at instant {instant}: it has a solution, which two methods did not find")
    return solution[0], float(cost[0])
