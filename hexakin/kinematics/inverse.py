"""Inverse kinematics of all legs, with checks of reach and joint limits (A(14)-(18), B(12)-(13)).

All functions take feet with any number of leading axes, unless they say otherwise. L is the number of the robot's legs.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_poses, checked
from hexakin.exceptions import InvalidInputError, JointLimitError, UnknownNameError, UnreachableError
from hexakin.kinematics.branches import (
    InverseSolution,
    every_branch,
    followed,
    inside,
    nearest,
    on_standing_branch,
    picked,
)
from hexakin.kinematics.evaluation import OutOfRangeError, fits
from hexakin.kinematics.leg_functions import closed_form
from hexakin.robot.model import Robot
from hexakin.transforms import inverse_pose, transform_points, wrapped


@checked
def within_limits(robot: Robot, q: ArrayLike) -> NDArray[np.bool_]:
    """Return whether each leg of ``robot`` is within its joint limits, as flags (..., L).

    ``q`` (..., L, 3) [rad] are the joint angles. An angle may be beyond its limit by 1e-9 rad, because of rounding.
    Raises InvalidInputError for a wrong shape or an angle that is not finite.
    """
    return inside(robot, check_array("q", q, (robot.num_legs, 3), ("leg", "joint")))


@checked
def inverse_kinematics(
    robot: Robot,
    p_body_foot: ArrayLike,
    *,
    branch: Literal["standing", "all"] = "standing",
    near: ArrayLike | None = None,
    on_unreachable: Literal["mark", "raise"] = "mark",
) -> InverseSolution:
    """Joint angles that bring the feet of ``robot`` to ``p_body_foot`` (A(14)-(18)).

    ``p_body_foot`` (..., L, 3) [m] are positions in the body frame. ``branch`` is ``"standing"`` for the branch of the
    standing pose, or ``"all"`` for all four branches. With ``near`` (..., L, 3) [rad] it is, for each leg, the branch
    nearest to these angles; ``near`` and ``p_body_foot`` are broadcast against each other. ``on_unreachable`` is
    ``"mark"``, then ``reachable`` of the result says which feet are out of reach, and their angles are NaN; or
    ``"raise"``.

    Singular targets are solved too. A foot on the first joint's axis leaves the first angle free: 0 is returned. The
    third angle of a stretched or folded leg is known to 1e-8 rad only, but the foot is where it should be. A foot in
    the second joint of equally long links leaves the second angle free. A leg without a known closed form is solved
    numerically (``hexakin.kinematics.numerical``): a foot is reached if it is missed by less than 1e-9 of the leg's
    length.

    Raises UnreachableError for the first foot out of reach with ``on_unreachable="raise"``; it names leg, distance and
    reach. Raises InvalidInputError if ``robot`` is not a robot, for a wrong shape, for a number that is not finite and
    for ``near`` together with ``branch="all"``; UnknownNameError for an unknown ``branch`` or ``on_unreachable``.
    """
    # The closed form checks an array itself. With ``near`` an error in the feet is to be named first, so it is checked
    # here too.
    checks = _is_closed(robot) and near is None
    foot = p_body_foot if checks and fits(p_body_foot, robot) else _feet(robot, p_body_foot)
    if not isinstance(branch, str) or branch not in ("standing", "all"):
        raise UnknownNameError("branch", branch, ["standing", "all"])
    if on_unreachable not in ("mark", "raise"):
        raise UnknownNameError("on_unreachable", on_unreachable, ["mark", "raise"])
    if near is not None and branch == "all":
        raise InvalidInputError('near: choose either the branch nearest to it or branch="all", not both')
    hint = None if near is None else check_array("near", near, (robot.num_legs, 3), ("leg", "joint"))
    try:
        solution = _solved(robot, foot, branch, hint)
    except OutOfRangeError:
        pass  # the feet are checked below: an error raised here would be shown together with this one
    else:
        if on_unreachable == "raise":
            _raise_if_unreachable(solution, many=branch == "all")
        return solution
    _feet(robot, foot)
    raise AssertionError("a finite foot is out of range")


def _solved(robot: Robot, foot: Array, branch: str, near: Array | None) -> InverseSolution:
    """Solve for feet (..., L, 3) [m]; raise OutOfRangeError if one is not finite and the leg has a closed form."""
    if near is not None:
        try:
            if near.shape != foot.shape:
                foot, near = np.broadcast_arrays(foot, near)
        except ValueError as error:
            raise InvalidInputError(f"near: shape {near.shape} does not go with feet of shape {foot.shape}") from error
        return nearest(robot, foot, near)
    if branch == "all":
        return every_branch(robot, foot)
    if _is_closed(robot):
        return on_standing_branch(robot, foot)
    first = np.zeros(foot.shape[:-1], dtype=int)
    return picked(every_branch(robot, foot), first, first)


@lru_cache(maxsize=64)
def _is_closed(robot: Robot) -> bool:
    return closed_form(robot.table)


def _feet(robot: Robot, p_body_foot: ArrayLike) -> Array:
    return check_array("p_body_foot", p_body_foot, (robot.num_legs, 3), ("leg", "coordinate"))


@checked
def path_inverse_kinematics(robot: Robot, p_body_foot: ArrayLike, near: ArrayLike | None = None) -> InverseSolution:
    """Return the joint angles of ``robot`` along a path of its feet, each leg on one branch throughout.

    ``p_body_foot`` (n, L, 3) [m] are n positions in the body frame, in order of time. A leg that stays on one branch
    moves continuously, because branches meet in singular poses only. Each leg's branch is the one that reaches most
    of the path; among equal ones it is one that is within the limits throughout, and then the one nearest to ``near``
    (L, 3) [rad] at the start. Without ``near`` the standing pose is used; its branch is taken for all legs if it is
    within the limits throughout. Where no branch reaches the whole path, the flags of the result say so. For a leg
    without a closed form it is at each position the solution nearest to the one before. Raises InvalidInputError for a
    wrong shape or a number that is not finite.
    """
    feet = _feet(robot, p_body_foot)
    if feet.ndim != 3 or len(feet) == 0:
        raise InvalidInputError(f"p_body_foot: expected shape (n, {robot.num_legs}, 3) with n > 0, got {feet.shape}")
    if near is None and closed_form(robot.table):
        standing = inverse_kinematics(robot, feet)
        if standing.within_limits.all():
            return standing
    start = robot.standing_q if near is None else check_array("near", near, (robot.num_legs, 3), ("leg", "joint"))
    if start.ndim != 2:
        raise InvalidInputError(f"near: expected shape ({robot.num_legs}, 3), got {start.shape}")
    every = every_branch(robot, feet)
    if every.numerical:
        return followed(every, start)
    change = np.nan_to_num(np.abs(wrapped(every.q[0] - start[:, None, :])).max(axis=-1), nan=np.pi)
    # By samples reached, then limits, then distance from the start.
    order = np.lexsort((change, ~every.within_limits.all(axis=0), -every.reachable.sum(axis=0)), axis=-1)
    chosen = np.broadcast_to(order[:, 0], feet.shape[:-1])
    return picked(every, chosen, chosen)


@checked
def posed_inverse_kinematics(
    robot: Robot, T_world_body: ArrayLike, p_world_foot: ArrayLike, **options: Any
) -> InverseSolution:
    """Return the joint angles of ``robot`` for poses of the body and feet in the world (B(12)).

    ``T_world_body`` (..., 4, 4) is the body's pose in the world [m], and ``p_world_foot`` (..., L, 3) [m] are the feet;
    they are broadcast against each other. ``options`` and errors are those of ``inverse_kinematics``. Raises
    InvalidInputError too if the shapes do not go together.
    """
    T = check_poses("T_world_body", T_world_body)
    feet = check_array("p_world_foot", p_world_foot, (robot.num_legs, 3), ("leg", "coordinate"))
    try:
        np.broadcast_shapes(T.shape[:-2], feet.shape[:-2])
    except ValueError as error:
        raise InvalidInputError(f"T_world_body {T.shape} and p_world_foot {feet.shape} do not go together") from error
    return inverse_kinematics(robot, transform_points(inverse_pose(T), feet), **options)


def raise_if_impossible(robot: Robot, solution: InverseSolution, time: Array) -> None:
    """Raise UnreachableError for the first instant out of reach, else JointLimitError for the first out of the limits.

    ``solution`` is the inverse kinematics of ``robot`` at n instants (n, L, 3), at ``time`` (n,) [s].
    """
    if not solution.reachable.all():
        at, leg = (int(i) for i in np.argwhere(~solution.reachable)[0])
        low, high = solution.reach[at, leg]
        raise UnreachableError(
            leg + 1, float(solution.distance[at, leg]), (float(low), float(high)), time=float(time[at])
        )
    if not solution.within_limits.all():
        at, leg = (int(i) for i in np.argwhere(~solution.within_limits)[0])
        q, low, high = solution.q[at, leg], robot.q_min[leg], robot.q_max[leg]
        joint = int(np.argmax(np.maximum(low - q, q - high)))
        limits = (float(low[joint]), float(high[joint]))
        raise JointLimitError(leg + 1, robot.table.joints[joint], float(q[joint]), limits, float(time[at]))


def _raise_if_unreachable(solution: InverseSolution, many: bool) -> None:
    reachable = solution.reachable.any(axis=-1) if many else solution.reachable
    if reachable.all():
        return
    index = tuple(int(i) for i in np.argwhere(~reachable)[0])
    at = (*index, 0) if many else index
    low, high = solution.reach[at]
    where = ", ".join(map(str, index[:-1]))
    raise UnreachableError(index[-1] + 1, float(solution.distance[at]), (float(low), float(high)), where)
