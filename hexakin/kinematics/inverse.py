"""Forward and inverse kinematics and Jacobians of all legs, broadcasting over leading axes."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.batch_kinematics import forward_of, jacobian_of
from hexakin.exceptions import InvalidInputError, UnknownNameError, UnreachableError
from hexakin.inverse_branches import (
    BRANCH_SIGNS,
    InverseSolution,
    every_branch,
    followed,
    inside,
    nearest,
    on_standing_branch,
    picked,
    standing_branch,
)
from hexakin.leg_functions import closed_form
from hexakin.robot import Robot, check_robot
from hexakin.transforms import Array, check_array, inverse_pose, transform_points, wrapped

__all__ = [
    "BRANCH_SIGNS",
    "InverseSolution",
    "forward_kinematics",
    "inverse_kinematics",
    "jacobian",
    "joint_axes",
    "path_inverse_kinematics",
    "posed_inverse_kinematics",
    "segment_poses",
    "standing_branch",
    "standing_height",
    "within_limits",
]


def forward_kinematics(robot: Robot, q: ArrayLike) -> Array:
    """Foot positions in the body frame (A(12)).

    ``q`` (..., L, 3) [rad] -> (..., L, 3) [m], to four units in the last place of the length of the leg's whole
    chain, for angles of any size. Raises InvalidInputError for a wrong shape or an angle that is not finite, naming leg
    and joint.
    """
    return _of_angles(forward_of, robot, q)


def jacobian(robot: Robot, q: ArrayLike) -> Array:
    """Derivative of each foot's position in the body frame by its leg's angles.

    ``q`` (..., L, 3) [rad] -> (..., L, 3, 3) [m/rad]. Raises InvalidInputError as ``forward_kinematics``.
    """
    return _of_angles(jacobian_of, robot, q)


def _of_angles(function_of: Callable[[Robot], Callable[[Array], Array | None]], robot: Robot, q: ArrayLike) -> Array:
    check_robot(robot)
    # The generated code finds infinities and NaN itself; an array is looked through only if it has.
    fits = _fits(robot, q)
    angles = cast(Array, q) if fits else check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    result = function_of(robot)(angles)
    if result is None:
        check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
        # Finite, but too large for the polynomials of a batch.
        result = function_of(robot)(np.arctan2(np.sin(angles), np.cos(angles)))
    assert result is not None
    return result


def _fits(robot: Robot, values: ArrayLike) -> bool:
    return type(values) is np.ndarray and values.dtype == float and values.shape[-2:] == (robot.num_legs, 3)


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

    A leg without a known closed form is solved by ``hexakin.numerical_inverse``; a foot is then reached if it is missed
    by less than 1e-9 of the leg's length. With ``on_unreachable="raise"`` the first unreachable foot raises
    UnreachableError, which names leg, distance and reach; otherwise ``reachable`` says which are not, and their angles
    are NaN. Raises InvalidInputError for a wrong shape or a position that is not finite, and
    UnknownNameError for an unknown option.
    """
    check_robot(robot)
    closed = _is_closed(robot)
    # A foot with a coordinate that is not finite is not reached, and its distance is not finite either: the feet are
    # looked through only then.
    checked = not (_fits(robot, p_body_foot) and near is None and closed)
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


def standing_height(robot: Robot) -> float:
    """Height [m] of the body's origin above the ground when the robot stands: its reference height."""
    feet = forward_kinematics(robot, robot.standing_q)
    return float(robot.foot_radius - feet[:, 2].min())


def segment_poses(robot: Robot, q: ArrayLike) -> Array:
    """Pose in the body frame of each segment's frame (origin at its joint, x towards the next joint).

    ``q`` (..., L, 3) [rad] -> (..., L, 3, 4, 4), the segments in the order coxa, femur, tibia.
    """
    return _joint_poses(robot, q) @ np.array([robot.segment_poses(leg) for leg in range(robot.num_legs)])


def joint_axes(robot: Robot, q: ArrayLike) -> Array:
    """Unit vectors along the joints' axes in the body frame, as columns: the angular Jacobian of each foot.

    ``q`` (..., L, 3) [rad] -> (..., L, 3, 3).
    """
    return np.swapaxes(_joint_poses(robot, q)[..., :3, 2], -1, -2)


def _joint_poses(robot: Robot, q: ArrayLike) -> Array:
    """Pose (..., L, 3, 4, 4) in the body frame of each joint's frame, turned with the joint, whose axis is its z."""
    check_robot(robot)
    angles = check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    fixed = np.array([robot.fixed_poses(leg) for leg in range(robot.num_legs)])
    turns = np.zeros((*angles.shape, 4, 4))
    turns[..., 0, 0] = turns[..., 1, 1] = np.cos(angles)
    turns[..., 1, 0] = np.sin(angles)
    turns[..., 0, 1] = -turns[..., 1, 0]
    turns[..., 2, 2] = turns[..., 3, 3] = 1.0
    poses = fixed[:, :3] @ turns
    for joint in (1, 2):
        poses[..., joint, :, :] = poses[..., joint - 1, :, :] @ poses[..., joint, :, :]
    return poses


def _raise_if_unreachable(solution: InverseSolution, many: bool) -> None:
    reachable = solution.reachable.any(axis=-1) if many else solution.reachable
    if reachable.all():
        return
    index = tuple(int(i) for i in np.argwhere(~reachable)[0])
    at = (*index, 0) if many else index
    low, high = solution.reach[at]
    where = ", ".join(map(str, index[:-1]))
    raise UnreachableError(index[-1] + 1, float(solution.distance[at]), (float(low), float(high)), where)
