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
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from hexakin.dynamics import GRAVITY
from hexakin.exceptions import InvalidInputError, SolverError
from hexakin.feasibility.legs import LegStates, leg_states
from hexakin.robot import Robot, check_robot
from hexakin.transforms import Array, check_array, check_number, check_whole

OUTCOMES = ("balanced", "torque", "friction", "support")
"""Outcomes of an instant: forces were found; joints lack torque; feet would slide; the robot would tip or fall."""

MOST_FRICTION = 10.0
"""Coefficient of friction beyond any ground's: what tips even with it tips, and is not said to slide.

Feet that are not quite in one plane could else be wedged against each other by forces without bound."""

_REGULARISATION = 1e-6
_EQUILIBRIUM = 1e-8  # [N], and of moments [N m]
_INEQUALITY = 1e-8  # of m g, and of the torque limit
_CHUNK = 250  # instants solved in one call: their matrices stay in the processor's cache
_RANK = 1e-9  # of the largest singular value
_LENGTH = 0.1  # [m] lever by which moments are scaled to forces


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


@dataclass(frozen=True, eq=False)
class StaticProblem:
    """The data of n force problems, forces in units of m g and moments in m g times 0.1 m.

    The variables are the forces' components in the contact frames (uphill, across, normal), 3 for each leg.
    ``equilibrium`` (n, 6, 3 L) and its right side ``weight`` (6,); ``cone`` (n, facets, 3): cone @ f <= 0;
    ``torque_map`` (n, L, 3, 3) and ``torque_free`` (n, L, 3): torque / max_torque = torque_free + torque_map @ f;
    ``carrying`` (n, L); ``frames`` (n, L, 3, 3) the contact frames' axes in the world, as columns; ``center_of_mass``
    (n, 3) [m] in the world; ``unit`` [N], the weight m g.
    """

    equilibrium: Array
    weight: Array
    cone: Array
    torque_map: Array
    torque_free: Array
    carrying: NDArray[np.bool_]
    frames: Array
    center_of_mass: Array
    unit: float

    def at(self, instants: NDArray[np.int_]) -> StaticProblem:
        """Problems of some instants."""
        return dataclasses.replace(self, **{name: getattr(self, name)[instants] for name in _PER_INSTANT})


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

    Parameters
    ----------
    T_world_body, q:
        Poses (n, 4, 4) of the body in the world, whose z is up, and angles (n, L, 3) [rad].
    carrying:
        Which feet the ground carries, (n, L).
    normals:
        Unit normals of the ground under the feet, out of it, (n, L, 3) or one for all.
    friction, facets:
        Coefficient of friction, and how many sides the pyramids have that stand for the cones.
    max_torque:
        Limit of every joint [N m]; None is that of the robot's servo, ``inf`` is none.

    Raises InvalidInputError for shapes or values that cannot be used, and SolverError if a problem was neither solved
    nor shown to have no solution.
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
    solution, cost = _solved(problem, bounded)
    good = _satisfied(problem, solution, bounded)
    outcome = np.where(good, "balanced", "").astype("<U8")
    needed = np.full(n, np.nan)
    for k in np.flatnonzero(~good):
        outcome[k], share = _diagnosed(problem, int(k), bounded)
        if outcome[k] == "balanced":
            solution[k], cost[k] = _solved_again(problem, int(k), bounded)
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


def friction_needed(problem: StaticProblem, *, most: float = MOST_FRICTION, tolerance: float = 1e-3) -> Array:
    """Smallest coefficient of friction with which each instant can be held without limits of torque, (n,).

    Found by bisection to ``tolerance``; inf where even ``most`` is not enough.
    """
    n, facets = problem.cone.shape[:2]

    def holds(friction: Array) -> NDArray[np.bool_]:
        tried = dataclasses.replace(problem, cone=pyramids(friction, facets))
        return _satisfied(tried, _solved(tried, bounded=False)[0], bounded=False)

    possible = holds(np.full(n, most))
    low, high = np.zeros(n), np.full(n, most)
    while (high - low).max(initial=0.0) > tolerance:
        middle = 0.5 * (low + high)
        enough = holds(middle)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return np.where(possible, high, np.inf)


def static_problem(
    robot: Robot,
    T_world_body: Array,
    states: LegStates,
    carrying: NDArray[np.bool_],
    normals: ArrayLike,
    *,
    friction: float,
    facets: int,
    torque_unit: float,
) -> StaticProblem:
    """Set up the force problems of n instants; see ``distribute`` for the arguments."""
    check_whole("facets", facets, at_least=3)
    n, num_legs = carrying.shape
    normal = check_array("normals", normals, (3,), ("coordinate",))
    normal = np.broadcast_to(normal, (n, num_legs, 3))
    if np.abs(np.linalg.norm(normal, axis=-1) - 1.0).max(initial=0.0) > 1e-6:
        raise InvalidInputError("normals: expected unit vectors")
    R = T_world_body[:, :3, :3]
    frames = _contact_frames(normal)
    turn = np.einsum("nji,nljk->nlik", R, frames)  # contact frame in the body frame
    # The contact lies on the foot's sphere: its lever about the foot's centre turns friction into a moment.
    lever = -robot.foot_radius * turn[..., 2]
    point = states.foot + lever
    slide = states.jacobian + np.cross(states.axes, lever[..., None], axisa=-2, axisb=-2, axisc=-2)
    gravity = -GRAVITY * R[:, 2]  # acceleration of gravity in the body frame: rows of R are the world's axes
    center = (robot.torso.mass * robot.torso.center_of_mass + states.moment.sum(axis=1)) / robot.mass
    unit = robot.mass * GRAVITY

    equilibrium = np.zeros((n, 6, num_legs, 3))
    equilibrium[:, :3] = np.moveaxis(turn, 1, 2)
    arm = (point - center[:, None]) / _LENGTH
    equilibrium[:, 3:] = np.moveaxis(np.cross(arm[..., None], turn, axisa=-2, axisb=-2, axisc=-2), 1, 2)
    # Force and moment in the world's axes, in which the weight is the same at every instant.
    equilibrium[:, :3] = np.einsum("nij,njlk->nilk", R, equilibrium[:, :3])
    equilibrium[:, 3:] = np.einsum("nij,njlk->nilk", R, equilibrium[:, 3:])
    torque_free = -np.einsum("nlij,ni->nlj", states.moment_slope, gravity) / torque_unit
    torque_map = -unit / torque_unit * np.einsum("nlij,nlik->nljk", slide, turn)
    torque_map = np.where(carrying[..., None, None], torque_map, 0.0)
    return StaticProblem(
        equilibrium.reshape(n, 6, -1),
        np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        pyramids(np.full(n, friction), facets),
        torque_map,
        torque_free,
        carrying,
        frames,
        np.einsum("nij,nj->ni", R, center) + T_world_body[:, :3, 3],
        unit,
    )


def _unit(robot: Robot, limit: float) -> float:
    """Torque [N m] in which torques are counted: the limit, or the servo's where there is none."""
    return limit if np.isfinite(limit) else robot.servo.max_torque


def _contact_frames(normal: Array) -> Array:
    """Axes uphill, across and along the normal as columns, (..., 3, 3); on level ground x is uphill."""
    uphill = np.array([0.0, 0.0, 1.0]) - normal[..., 2:] * normal
    level = np.linalg.norm(uphill, axis=-1, keepdims=True) < 1e-9
    across_x = np.array([1.0, 0.0, 0.0]) - normal[..., :1] * normal
    uphill = np.where(level, across_x, uphill)
    uphill = uphill / np.linalg.norm(uphill, axis=-1, keepdims=True)
    return np.stack([uphill, np.cross(normal, uphill), normal], axis=-1)


def pyramids(friction: Array, facets: int) -> Array:
    """Rows (n, facets, 3) of inscribed pyramids: row @ (uphill, across, normal force) <= 0; an edge points uphill."""
    angle = (2.0 * np.arange(facets) + 1.0) * np.pi / facets
    height = np.broadcast_to(friction[:, None] * np.cos(np.pi / facets), (len(friction), facets))
    sides = np.broadcast_to([np.cos(angle), np.sin(angle)], (len(friction), 2, facets))
    return np.stack([sides[:, 0], sides[:, 1], -height], axis=-1)


@lru_cache(maxsize=16)
def _solver(size: int, rows: int, instants: int, name: str) -> ca.Function:
    """Quadratic programmes of many instants in one call, side by side (CasADi's map)."""
    shapes = {"h": ca.Sparsity.dense(size, size), "a": ca.Sparsity.dense(rows, size)}
    return ca.conic("forces", name, shapes, {"error_on_fail": False}).map(instants)


def _solved(problem: StaticProblem, bounded: bool, name: str = "daqp", rank: int = 6) -> tuple[Array, Array]:
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
        found, cost = _optimum(_programme(problem, bounded, span, np.where(usable[:, None], start, 0.0), free), name)
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


def _optimum(programme: dict[str, Array], name: str) -> tuple[Array, Array]:
    """Optimal y (n, k) and cost (n,) of the programmes."""
    constant = programme.pop("constant")
    n, rows, size = programme["a"].shape
    side_by_side = {
        key: np.ascontiguousarray(np.moveaxis(value, 0, 1).reshape(value.shape[1], -1))
        for key, value in programme.items()
    }
    found = _solver(size, rows, n, name)(**side_by_side)
    return np.asarray(found["x"]).T, np.asarray(found["cost"])[0] + constant


def _satisfied(problem: StaticProblem, solution: Array, bounded: bool) -> NDArray[np.bool_]:
    """Whether forces (n, 3 L) keep every constraint; what the solver says of itself is not asked."""
    n = len(solution)
    force = solution.reshape(n, -1, 3)
    off = np.abs(np.einsum("nij,nj->ni", problem.equilibrium, solution) - problem.weight).max(axis=1)
    slip = (force @ problem.cone.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0)
    torque = problem.torque_free + np.einsum("nlij,nlj->nli", problem.torque_map, force)
    within = np.abs(torque).max(axis=(1, 2)) <= 1.0 + _INEQUALITY if bounded else np.ones(n, dtype=bool)
    return (off <= _EQUILIBRIUM / problem.unit) & (slip <= _INEQUALITY) & within


def _smallest_torque(problem: StaticProblem, instant: int, cone: Array | None = None) -> float | None:
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
    found = linprog(
        np.r_[np.zeros(size), 1.0],
        A_ub=inequalities,
        b_ub=bounds,
        A_eq=np.hstack([problem.equilibrium[instant], np.zeros((6, 1))]),
        b_eq=problem.weight,
        bounds=limits,
        method="highs",
    )
    if found.status == _INFEASIBLE:
        return None
    if found.status != 0:
        raise SolverError(f"force distribution at instant {instant}: {found.message}")
    return float(found.fun)


_INFEASIBLE = 2  # linprog's status of a problem that is shown to have no solution


def _diagnosed(problem: StaticProblem, instant: int, bounded: bool) -> tuple[str, float]:
    """Outcome of an instant whose programme was not solved, and the smallest largest torque [limit], by HiGHS."""
    share = _smallest_torque(problem, instant)
    if share is not None:
        return ("torque" if bounded and share > 1.0 + 1e-7 else "balanced"), share
    rough = pyramids(np.array([MOST_FRICTION]), problem.cone.shape[1])[0]
    return ("support" if _smallest_torque(problem, instant, rough) is None else "friction"), float("nan")


def _solved_again(problem: StaticProblem, instant: int, bounded: bool) -> tuple[Array, float]:
    """Solve by another method an instant that has a solution, though the first method found none."""
    alone = problem.at(np.array([instant]))
    carried = alone.equilibrium[0] * np.repeat(alone.carrying[0], 3)
    singular = np.linalg.svd(carried, compute_uv=False)
    solution, cost = _solved(alone, bounded, "piqp", rank=int((singular > _RANK * singular[0]).sum()))
    if not _satisfied(alone, solution, bounded)[0]:
        raise SolverError(f"force distribution at instant {instant}: it has a solution, which two methods did not find")
    return solution[0], float(cost[0])


_PER_INSTANT = ("equilibrium", "cone", "torque_map", "torque_free", "carrying", "frames", "center_of_mass")
