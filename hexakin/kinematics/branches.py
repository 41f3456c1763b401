"""Branches of the inverse kinematics: all of them, the standing pose's, the one nearest to given angles.

The branches are those of A(14)-(18) and B(12)-(13), four for each leg.

The functions here take arrays whose shape is checked. For legs with a closed form they raise ``OutOfRangeError``
(``hexakin.kinematics.evaluation``) if a coordinate of a foot is not finite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, checked
from hexakin.kinematics.bounds import LIMIT_TOLERANCE
from hexakin.kinematics.evaluation import Solved, forward_of, inverse_of, reach_of
from hexakin.kinematics.leg_functions import closed_form, reach
from hexakin.kinematics.numerical import solve_numerically
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot
from hexakin.transforms import wrapped

BRANCH_SIGNS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
"""Signs (side of the first joint, knee) of the four inverse branches, (4, 2). Every result has this order."""

_CHUNK = 1024  # poses whose four branches are compared at a time: few enough for the cache


@checked
@dataclass(frozen=True)
class InverseSolution:
    """Result of the inverse kinematics for L legs; with ``branch="all"`` an axis of 4 branches follows the legs.

    ``q`` (..., L, 3) or (..., L, 4, 3) [rad] are the angles, each within half a turn of the middle of its limits; NaN
    where the foot is not reachable. ``reachable`` and ``within_limits`` (..., L) or (..., L, 4) are flags. ``branch``
    (..., L) or (..., L, 4) are indices into ``BRANCH_SIGNS``. ``distance`` (..., L) or (..., L, 4) [m] is from the
    leg's second joint to the foot, and ``reach`` (..., L, 2) or (..., L, 4, 2) [m] are its lower and upper bound.

    ``numerical`` is true for a leg whose inverse is not known in closed form. Its branches are then the solutions that
    were found, ordered by the largest difference of an angle from the standing pose; 0 is the nearest to it.
    """

    q: Array
    reachable: NDArray[np.bool_]
    within_limits: NDArray[np.bool_]
    branch: NDArray[np.int_]
    distance: Array
    reach: Array
    numerical: bool = False

    __repr__ = short_repr


@checked
@lru_cache(maxsize=64)
def standing_branch(robot: Robot) -> NDArray[np.int_]:
    """Return the index (L,) into ``BRANCH_SIGNS`` of the branch of each leg's standing pose, for ``robot``."""
    every = every_branch(robot, forward_of(robot)(robot.standing_q))
    change = np.abs(wrapped(every.q - robot.standing_q[:, None, :])).max(axis=-1)
    index = np.argmin(np.where(every.reachable, change, np.inf), axis=-1)
    index.setflags(write=False)
    return index


def inside(robot: Robot, q: Array, branches: int = 0) -> NDArray[np.bool_]:
    """Return whether the angles of each leg of ``robot`` are within their limits, as flags (..., L) or (..., L, b).

    ``q`` (..., L, 3) [rad] are the angles; (..., L, b, 3) with ``branches`` 1, where b is the number of branches.
    """
    extra = (slice(None), *[None] * branches, slice(None))
    low, high = robot.q_min[extra], robot.q_max[extra]
    return np.all((q >= low - LIMIT_TOLERANCE) & (q <= high + LIMIT_TOLERANCE), axis=-1)


def every_branch(robot: Robot, foot: Array) -> InverseSolution:
    """Return all four branches of ``robot`` for feet ``foot`` (..., L, 3) [m]."""
    if closed_form(robot.table):
        shape = foot.shape[:-1]
        solved = _for_every_branch(robot)(foot)
        # They lie in memory branch by branch. (np.moveaxis takes as long as the inverse of some legs.)
        last = (*range(1, len(shape) + 1), 0)
        index, bounds = _four_for_all(robot, shape)
        return InverseSolution(
            solved.q.reshape(4, *shape, 3).transpose(*last, len(last)),
            solved.reachable.reshape(4, *shape).transpose(last),
            solved.within_limits.reshape(4, *shape).transpose(last),
            index,
            solved.distance.reshape(4, *shape).transpose(last),
            bounds,
        )
    found = solve_numerically(robot, foot)
    middle = 0.5 * (robot.q_min + robot.q_max)[:, None, :]
    q = middle + wrapped(found.q - middle)
    shape = q.shape[:-1]
    distance = np.broadcast_to(found.distance[..., None], shape)
    bounds = np.broadcast_to(reach(robot)[:, None, :], (*shape, 2))
    indices = np.broadcast_to(np.arange(shape[-1]), shape)
    flags = np.asarray(np.isfinite(q).all(axis=-1)), inside(robot, q, branches=1)
    return InverseSolution(q, *flags, indices, distance, bounds, numerical=True)


def followed(every: InverseSolution, start: Array) -> InverseSolution:
    """Return along a path the solution that is nearest, for each leg, to the solution before.

    ``every`` are all solutions at n positions, with branches (n, L, 4). ``start`` (L, 3) [rad] are the angles before
    the first position. Where a leg has no solution, the next one is compared with the last one that it had.
    """
    chosen = np.zeros(every.reachable.shape[:-1], dtype=int)
    legs = np.arange(len(start))
    for k in range(len(chosen)):
        change = np.abs(wrapped(every.q[k] - start[:, None, :])).max(axis=-1)
        chosen[k] = np.argmin(np.where(every.reachable[k], change, np.inf), axis=-1)
        here = every.q[k, legs, chosen[k]]
        start = np.where(np.isfinite(here), here, start)
    return picked(every, chosen, chosen)


@lru_cache(maxsize=64)
def _for_every_branch(robot: Robot) -> Callable[..., Solved]:
    return inverse_of(robot, BRANCH_SIGNS)


@lru_cache(maxsize=64)
def _for_standing_branch(robot: Robot) -> Callable[[Array], Solved]:
    return inverse_of(robot, BRANCH_SIGNS[standing_branch(robot)][:, None, :])


@lru_cache(maxsize=64)
def _same_for_all(robot: Robot, shape: tuple[int, ...]) -> tuple[NDArray[np.int_], Array]:
    """Return standing branch and reach of legs in a result of ``shape`` (..., L), as read-only views."""
    return np.broadcast_to(standing_branch(robot), shape), np.broadcast_to(reach_of(robot), (*shape, 2))


@lru_cache(maxsize=64)
def _four_for_all(robot: Robot, shape: tuple[int, ...]) -> tuple[NDArray[np.int_], Array]:
    """Return index and reach of the four branches of legs in a result of ``shape`` (..., L), as read-only views."""
    return np.broadcast_to(np.arange(4), (*shape, 4)), np.broadcast_to(reach_of(robot)[:, None, :], (*shape, 4, 2))


def on_standing_branch(robot: Robot, foot: Array) -> InverseSolution:
    """Return the standing branch of each leg of ``robot`` for feet ``foot`` (..., L, 3) [m]."""
    shape = foot.shape[:-1]
    found = _for_standing_branch(robot)(foot)
    index, bounds = _same_for_all(robot, shape)
    return InverseSolution(
        found.q.reshape(foot.shape),
        found.reachable.reshape(shape),
        found.within_limits.reshape(shape),
        index,
        found.distance.reshape(shape),
        bounds,
    )


def picked(solution: InverseSolution, position: NDArray[np.int_], branch: NDArray[np.int_]) -> InverseSolution:
    """Return one branch for each leg of a ``solution`` with every branch.

    ``position`` (..., L) is the branch's index in the solution, and ``branch`` (..., L) its number in the result.
    """

    def take(values: np.ndarray) -> Any:
        extra = values.ndim - position.ndim - 1
        index = position[(..., *[None] * (extra + 1))]
        return np.take_along_axis(values, index, axis=position.ndim).squeeze(axis=position.ndim)

    s = solution
    taken = (take(s.q), take(s.reachable), take(s.within_limits), branch, take(s.distance), take(s.reach))
    return InverseSolution(*taken, numerical=s.numerical)


def nearest(robot: Robot, foot: Array, near: Array) -> InverseSolution:
    """Return for each leg of ``robot`` the branch whose largest change of an angle from ``near`` is smallest.

    ``foot`` [m] and ``near`` [rad] are of the same shape (..., L, 3).
    """
    nearest_of = _nearest_branch if closed_form(robot.table) else _nearest_found
    total = foot.size // 3
    if total <= _CHUNK:
        return nearest_of(robot, foot, near, total)
    flat, hints = foot.reshape(-1, *foot.shape[-2:]), near.reshape(-1, *near.shape[-2:])
    chunks = (slice(k, k + _CHUNK) for k in range(0, len(flat), _CHUNK))
    parts = [nearest_of(robot, flat[chunk], hints[chunk], total) for chunk in chunks]

    def joined(name: str) -> Any:
        values = np.concatenate([getattr(part, name) for part in parts])
        return values.reshape(*foot.shape[:-2], *values.shape[1:])

    names = ("q", "reachable", "within_limits", "branch", "distance", "reach")
    return InverseSolution(**{name: joined(name) for name in names}, numerical=parts[0].numerical)


def _nearest_branch(robot: Robot, foot: Array, near: Array, total: int) -> InverseSolution:
    solved = _for_every_branch(robot)(foot, total)
    position = _nearest_position(solved.q, solved.reachable, near.reshape(-1, 3), axis=0)
    shape, chosen = foot.shape[:-1], (position, np.arange(len(position)))
    return InverseSolution(
        solved.q[chosen].reshape(foot.shape),
        solved.reachable[chosen].reshape(shape),
        solved.within_limits[chosen].reshape(shape),
        position.reshape(shape),
        solved.distance[chosen].reshape(shape),
        _same_for_all(robot, shape)[1],
    )


def _nearest_found(robot: Robot, foot: Array, near: Array, _: int) -> InverseSolution:
    every = every_branch(robot, foot)
    position = _nearest_position(every.q, every.reachable, near[..., None, :], axis=-1)
    return picked(every, position, position)


def _nearest_position(q: Array, reachable: NDArray[np.bool_], near: Array, axis: int) -> NDArray[np.int_]:
    change = np.abs(wrapped(q - near)).max(axis=-1)
    # Where no branch reaches, the first one (the foot faced by the leg) reports the distance.
    return np.argmin(np.where(reachable, change, np.inf), axis=axis)
