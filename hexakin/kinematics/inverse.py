"""Forward and inverse kinematics and Jacobians of all legs, broadcasting over leading axes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array
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
from hexakin.kinematics.evaluation import fits
from hexakin.kinematics.leg_functions import closed_form
from hexakin.robot.model import Robot, check_robot
from hexakin.transforms import inverse_pose, transform_points, wrapped


def within_limits(robot: Robot, q: ArrayLike) -> NDArray[np.bool_]:
    """Whether all three angles of each leg keep their limits: ``q`` (..., L, 3) [rad] -> (..., L)."""
    return inside(robot, check_array("q", q, (robot.num_legs, 3), ("leg", "joint")))


def inverse_kinematics(
    robot: Robot,
    p_body_foot: ArrayLike,
    *,
    branch: Literal["standing", "all"] = "standing",
    near: ArrayLike | None = None,
    on_unreachable: Literal["mark", "raise"] = "mark",
) -> InverseSolution:
    """Joint angles that bring the feet to ``p_body_foot`` (..., L, 3) [m] in the body frame (A(14)-(18)).

    The branch is that of the standing pose, or the one nearest to the angles ``near`` (..., L, 3), or
    all four with ``branch="all"``. Singular targets are solved too: a foot on the first joint's axis leaves the first
    angle free, and 0 is returned; a stretched or folded leg's third angle is known to 1e-8 rad only, yet the foot is
    where it should be; a foot in the second joint of equally long links leaves the second angle free.

    A leg without a known closed form is solved numerically (``hexakin.kinematics.numerical``); a foot is then reached
    if it is missed by less than 1e-9 of the leg's length. With ``on_unreachable="raise"`` the first unreachable foot
    raises UnreachableError, which names leg, distance and reach; otherwise ``reachable`` says which are not, and their
    angles are NaN. Raises InvalidInputError for a wrong shape or a position that is not finite, and UnknownNameError
    for an unknown option.
    """
    check_robot(robot)
    closed = _is_closed(robot)
    # A foot with a coordinate that is not finite is not reached, and its distance is not finite either: the feet are
    # looked through only then.
    checked = not (fits(robot, p_body_foot) and near is None and closed)
    foot = _feet(robot, p_body_foot) if checked else cast(Array, p_body_foot)
    if not isinstance(branch, str) or branch not in ("standing", "all"):
        raise UnknownNameError("branch", branch, ["standing", "all"])
    if on_unreachable not in ("mark", "raise"):
        raise UnknownNameError("on_unreachable", on_unreachable, ["mark", "raise"])
    if near is not None and branch == "all":
        raise InvalidInputError('near: choose either the branch nearest to it or branch="all", not both')
    if near is not None:
        hint = check_array("near", near, (robot.num_legs, 3), ("leg", "joint"))
        try:
            if hint.shape != foot.shape:
                foot, hint = np.broadcast_arrays(foot, hint)
        except ValueError as error:
            raise InvalidInputError(f"near: shape {hint.shape} does not go with feet of shape {foot.shape}") from error
        solution = nearest(robot, foot, hint)
    elif branch == "all":
        solution = every_branch(robot, foot)
    elif not closed:
        first = np.zeros(foot.shape[:-1], dtype=int)
        solution = picked(every_branch(robot, foot), first, first)
    else:
        solution = on_standing_branch(robot, foot)
    reached = np.count_nonzero(solution.reachable) == solution.reachable.size
    if not checked and not reached and not np.isfinite(solution.distance.sum()):
        _feet(robot, foot)
    if on_unreachable == "raise":
        _raise_if_unreachable(solution, many=branch == "all")
    return solution


@lru_cache(maxsize=64)
def _is_closed(robot: Robot) -> bool:
    return closed_form(robot.table)


def _feet(robot: Robot, p_body_foot: ArrayLike) -> Array:
    return check_array("p_body_foot", p_body_foot, (robot.num_legs, 3), ("leg", "coordinate"))


def path_inverse_kinematics(robot: Robot, p_body_foot: ArrayLike, near: ArrayLike | None = None) -> InverseSolution:
    """Joint angles along a path of the feet, each leg on one branch throughout.

    ``p_body_foot`` (n, L, 3) [m], in order of time. Branches meet only in singular poses, so that a leg that
    stays on one moves continuously. Of the branches that reach the whole path, those within the limits
    throughout come first, and of these the one nearest to ``near`` (L, 3) [rad] at the start. Without ``near``
    the standing pose's branch is taken if it serves. Where none reaches, the branch that reaches
    furthest is returned, with its flags. Raises InvalidInputError for a wrong shape or a value that is not finite.
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


def posed_inverse_kinematics(
    robot: Robot, T_world_body: ArrayLike, p_world_foot: ArrayLike, **options: Any
) -> InverseSolution:
    """Inverse kinematics for a body pose and feet in the world, all six degrees of freedom (B(12)).

    ``T_world_body`` (..., 4, 4), ``p_world_foot`` (..., L, 3) [m]; options and errors as for ``inverse_kinematics``.
    """
    T = check_array("T_world_body", T_world_body, (4, 4))
    feet = check_array("p_world_foot", p_world_foot, (robot.num_legs, 3), ("leg", "coordinate"))
    try:
        np.broadcast_shapes(T.shape[:-2], feet.shape[:-2])
    except ValueError as error:
        raise InvalidInputError(f"T_world_body {T.shape} and p_world_foot {feet.shape} do not go together") from error
    return inverse_kinematics(robot, transform_points(inverse_pose(T), feet), **options)


def raise_if_impossible(robot: Robot, solution: InverseSolution, time: Array) -> None:
    """Raise UnreachableError for the first instant out of reach, else JointLimitError for the first out of the limits.

    ``solution`` is of n instants (n, L, 3), at ``time`` (n,) [s].
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
