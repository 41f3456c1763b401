"""Forward and inverse kinematics and Jacobians of all legs, broadcasting over leading axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, TypeGuard, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin import numerical_inverse
from hexakin.batch_kinematics import LIMIT_TOLERANCE, Solved, forward_of, inverse_of, jacobian_of, reach_of
from hexakin.exceptions import InvalidInputError, UnknownNameError, UnreachableError
from hexakin.leg_functions import closed_form, reach
from hexakin.robot import Robot, check_robot
from hexakin.transforms import Array, axis_rotation, check_array, inverse_pose, pose, transform_points, wrapped

BRANCH_SIGNS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
"""Signs (side of the first joint, knee) of the four inverse branches, (4, 2); every result keeps this order."""

_CHUNK = 1024  # poses whose four branches are compared at a time: what that takes stays in the cache


@dataclass(frozen=True)
class InverseSolution:
    """Result of the inverse kinematics for L legs; with ``branch="all"`` an axis of 4 branches follows the legs.

    ``q`` (..., L, 3) or (..., L, 4, 3) [rad], each within half a turn of the
    middle of its limits, NaN where not reachable;
    ``reachable`` and ``within_limits`` (..., L) or (..., L, 4) bool; ``branch`` (..., L) the index of the
    branch into ``BRANCH_SIGNS`` (of the four themselves with ``"all"``); ``distance`` (..., L) or
    (..., L, 4) [m] from the leg's second joint to the foot and ``reach`` (..., 2) [m], the bounds that it must keep.

    ``numerical`` is true for a leg whose inverse is not known in closed form. Its branches are then the solutions that
    were found, ordered by their largest angle's difference from the standing pose: 0 is the nearest to it.
    """

    q: Array
    reachable: NDArray[np.bool_]
    within_limits: NDArray[np.bool_]
    branch: NDArray[np.int_]
    distance: Array
    reach: Array
    numerical: bool = False


def forward_kinematics(robot: Robot, q: ArrayLike) -> Array:
    """Foot positions in the body frame (A(12)).

    ``q`` (..., L, 3) [rad] -> (..., L, 3) [m]. Raises InvalidInputError for a wrong shape or an angle
    that is not finite, naming leg and joint.
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
    angles = q if _fits(robot, q) else check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    result = function_of(robot)(angles)
    if result is None:
        check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
        # Finite, but too large for the polynomials of a batch.
        result = function_of(robot)(np.arctan2(np.sin(angles), np.cos(angles)))
    return cast(Array, result)


def _fits(robot: Robot, values: ArrayLike) -> TypeGuard[Array]:
    return isinstance(values, np.ndarray) and values.dtype == float and values.shape[-2:] == (robot.num_legs, 3)


def within_limits(robot: Robot, q: ArrayLike) -> NDArray[np.bool_]:
    """Whether all three angles of each leg keep their limits: ``q`` (..., L, 3) [rad] -> (..., L)."""
    return _inside(robot, check_array("q", q, (robot.num_legs, 3), ("leg", "joint")))


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
    all four with ``branch="all"``. A foot on the first joint's axis leaves its first angle free: 0 is
    returned. A leg without a known closed form is solved by ``hexakin.numerical_inverse``; a foot is then reached
    if it is missed by less than 1e-9 of the leg's length. With ``on_unreachable="raise"`` the first unreachable
    foot raises UnreachableError, which names leg, distance and reach; otherwise ``reachable`` says which are
    not, and their angles are NaN. Raises InvalidInputError for a wrong shape or a position that is not finite, and
    UnknownNameError for an unknown option.
    """
    check_robot(robot)
    ready = _fits(robot, p_body_foot) and near is None and closed_form(robot.table)
    foot = p_body_foot if ready else check_array("p_body_foot", p_body_foot, (robot.num_legs, 3), ("leg", "coordinate"))
    if not isinstance(branch, str) or branch not in ("standing", "all"):
        raise UnknownNameError("branch", branch, ["standing", "all"])
    if on_unreachable not in ("mark", "raise"):
        raise UnknownNameError("on_unreachable", on_unreachable, ["mark", "raise"])
    if near is not None and branch == "all":
        raise InvalidInputError('near: choose either the branch nearest to it or branch="all", not both')
    if near is not None:
        hint = check_array("near", near, (robot.num_legs, 3), ("leg", "joint"))
        try:
            foot, hint = np.broadcast_arrays(foot, hint)
        except ValueError as error:
            raise InvalidInputError(f"near: shape {hint.shape} does not go with feet of shape {foot.shape}") from error
        solution = _nearest(robot, foot, hint)
    elif branch == "all":
        solution = _every(robot, foot)
    elif not (ready or closed_form(robot.table)):
        first = np.zeros(foot.shape[:-1], dtype=int)
        solution = _pick(_every(robot, foot), first, first)
    else:
        solution = _standing(robot, foot)
    if ready and not np.isfinite(solution.distance.sum()):
        check_array("p_body_foot", foot, (robot.num_legs, 3), ("leg", "coordinate"))
    if on_unreachable == "raise":
        _raise_if_unreachable(solution, many=branch == "all")
    return solution


def path_inverse_kinematics(robot: Robot, p_body_foot: ArrayLike, near: ArrayLike | None = None) -> InverseSolution:
    """Joint angles along a path of the feet, each leg on one branch throughout.

    ``p_body_foot`` (n, L, 3) [m], in order of time. Branches meet only in singular poses, so that a leg that
    stays on one moves continuously. Of the branches that reach the whole path, those within the limits
    throughout come first, and of these the one nearest to ``near`` (L, 3) [rad] at the start. Without ``near``
    the standing pose's branch is taken if it serves. Where none reaches, the branch that reaches
    furthest is returned, with its flags. Raises InvalidInputError for a wrong shape or a value that is not finite.
    """
    feet = check_array("p_body_foot", p_body_foot, (robot.num_legs, 3), ("leg", "coordinate"))
    if feet.ndim != 3 or len(feet) == 0:
        raise InvalidInputError(f"p_body_foot: expected shape (n, {robot.num_legs}, 3) with n > 0, got {feet.shape}")
    if near is None and closed_form(robot.table):
        standing = inverse_kinematics(robot, feet)
        if standing.within_limits.all():
            return standing
    start = robot.standing_q if near is None else check_array("near", near, (robot.num_legs, 3), ("leg", "joint"))
    if start.ndim != 2:
        raise InvalidInputError(f"near: expected shape ({robot.num_legs}, 3), got {start.shape}")
    every = _every(robot, feet)
    if every.numerical:
        return _followed(every, start)
    change = np.nan_to_num(np.abs(wrapped(every.q[0] - start[:, None, :])).max(axis=-1), nan=np.pi)
    # By samples reached, then limits, then distance from the start.
    order = np.lexsort((change, ~every.within_limits.all(axis=0), -every.reachable.sum(axis=0)), axis=-1)
    chosen = np.broadcast_to(order[:, 0], feet.shape[:-1])
    return _pick(every, chosen, chosen)


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


@lru_cache(maxsize=64)
def standing_branch(robot: Robot) -> NDArray[np.int_]:
    """Index (L,) into ``BRANCH_SIGNS`` of the branch that holds each leg's standing pose."""
    feet = forward_kinematics(robot, robot.standing_q)
    every = _every(robot, feet)
    change = np.abs(wrapped(every.q - robot.standing_q[:, None, :])).max(axis=-1)
    index = np.argmin(np.where(every.reachable, change, np.inf), axis=-1)
    index.setflags(write=False)
    return index


def standing_height(robot: Robot) -> float:
    """Height [m] of the body's origin above the ground when the robot stands: its reference height."""
    feet = forward_kinematics(robot, robot.standing_q)
    return float(robot.foot_radius - feet[:, 2].min())


def segment_poses(robot: Robot, q: ArrayLike) -> Array:
    """Pose in the body frame of each segment's frame (origin at its joint, x towards the next joint).

    ``q`` (L, 3) [rad] -> (L, 3, 4, 4), the segments in the order coxa, femur, tibia.
    """
    angles = check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    if angles.ndim != 2:
        raise InvalidInputError(f"q: expected shape ({robot.num_legs}, 3), got {angles.shape}")
    result = np.empty((robot.num_legs, 3, 4, 4))
    for leg in range(robot.num_legs):
        fixed, frames, T = robot.fixed_poses(leg), robot.segment_poses(leg), np.eye(4)
        for k in range(3):
            T = T @ fixed[k] @ pose(axis_rotation([0.0, 0.0, 1.0], angles[leg, k]), np.zeros(3))
            result[leg, k] = T @ frames[k]
    return result


def joint_axes(robot: Robot, q: ArrayLike) -> Array:
    """Unit vectors along the joints' axes in the body frame, as columns: the angular Jacobian of each foot.

    ``q`` (L, 3) [rad] -> (L, 3, 3).
    """
    angles = check_array("q", q, (robot.num_legs, 3), ("leg", "joint"))
    if angles.ndim != 2:
        raise InvalidInputError(f"q: expected shape ({robot.num_legs}, 3), got {angles.shape}")
    result = np.empty((robot.num_legs, 3, 3))
    for leg in range(robot.num_legs):
        fixed, rotation = robot.fixed_poses(leg)[:, :3, :3], np.eye(3)
        for k in range(3):
            rotation = rotation @ fixed[k] @ axis_rotation([0.0, 0.0, 1.0], angles[leg, k])
            result[leg, :, k] = rotation[:, 2]
    return result


def _inside(robot: Robot, q: Array, branches: int = 0) -> NDArray[np.bool_]:
    # Branches, if any, stand between the legs and the joints.
    extra = (slice(None), *[None] * branches, slice(None))
    low, high = robot.q_min[extra], robot.q_max[extra]
    return np.all((q >= low - LIMIT_TOLERANCE) & (q <= high + LIMIT_TOLERANCE), axis=-1)


def _every(robot: Robot, foot: Array) -> InverseSolution:
    """All four branches for feet (..., L, 3)."""
    if closed_form(robot.table):
        shape = foot.shape[:-1]
        q, *rest = _on_every_branch(robot)(foot)
        # Branch by branch in memory.
        q = np.moveaxis(q.reshape(4, *shape, 3), 0, -2)
        reachable, within, distance = (np.moveaxis(values.reshape(4, *shape), 0, -1) for values in rest)
        index = np.broadcast_to(np.arange(4), (*shape, 4))
        bounds = np.broadcast_to(reach_of(robot)[:, None, :], (*shape, 4, 2))
        return InverseSolution(q, reachable, within, index, distance, bounds)
    found = numerical_inverse.solve(robot, foot)
    middle = 0.5 * (robot.q_min + robot.q_max)[:, None, :]
    q = middle + wrapped(found.q - middle)
    shape = q.shape[:-1]
    distance = np.broadcast_to(found.distance[..., None], shape)
    bounds = np.broadcast_to(reach(robot)[:, None, :], (*shape, 2))
    indices = np.broadcast_to(np.arange(shape[-1]), shape)
    flags = np.asarray(np.isfinite(q).all(axis=-1)), _inside(robot, q, branches=1)
    return InverseSolution(q, *flags, indices, distance, bounds, numerical=True)


def _followed(every: InverseSolution, start: Array) -> InverseSolution:
    """Along a path (n, L, 4): at each sample the solution nearest to that of the sample before."""
    chosen = np.zeros(every.reachable.shape[:-1], dtype=int)
    legs = np.arange(len(start))
    for k in range(len(chosen)):
        change = np.abs(wrapped(every.q[k] - start[:, None, :])).max(axis=-1)
        chosen[k] = np.argmin(np.where(every.reachable[k], change, np.inf), axis=-1)
        here = every.q[k, legs, chosen[k]]
        start = np.where(np.isfinite(here), here, start)
    return _pick(every, chosen, chosen)


@lru_cache(maxsize=64)
def _on_every_branch(robot: Robot) -> Callable[[Array], Solved]:
    return inverse_of(robot, BRANCH_SIGNS)


@lru_cache(maxsize=64)
def _on_standing_branch(robot: Robot) -> Callable[[Array], Solved]:
    return inverse_of(robot, BRANCH_SIGNS[standing_branch(robot)][:, None, :])


@lru_cache(maxsize=64)
def _same_for_all(robot: Robot, shape: tuple[int, ...]) -> tuple[NDArray[np.int_], Array]:
    """Branch and reach of legs in a result of ``shape`` (..., L): read-only views of one value each."""
    return np.broadcast_to(standing_branch(robot), shape), np.broadcast_to(reach_of(robot), (*shape, 2))


def _standing(robot: Robot, foot: Array) -> InverseSolution:
    """Each leg's standing branch for feet (..., L, 3)."""
    shape = foot.shape[:-1]
    q, *rest = (values[0] for values in _on_standing_branch(robot)(foot))
    reachable, within, distance = (values.reshape(shape) for values in rest)
    index, bounds = _same_for_all(robot, shape)
    return InverseSolution(q.reshape(foot.shape), reachable, within, index, distance, bounds)


def _pick(solution: InverseSolution, position: NDArray[np.int_], branch: NDArray[np.int_]) -> InverseSolution:
    def take(values: np.ndarray) -> Any:
        extra = values.ndim - position.ndim - 1
        index = position[(..., *[None] * (extra + 1))]
        return np.take_along_axis(values, index, axis=position.ndim).squeeze(axis=position.ndim)

    s = solution
    taken = (take(s.q), take(s.reachable), take(s.within_limits), branch, take(s.distance), take(s.reach))
    return InverseSolution(*taken, numerical=s.numerical)


def _nearest(robot: Robot, foot: Array, near: Array) -> InverseSolution:
    """Each leg's branch with the smallest largest change from ``near``; both (..., L, 3)."""
    if foot.size <= 3 * _CHUNK:
        return _nearest_of(_every(robot, foot), near)
    flat, hints = foot.reshape(-1, *foot.shape[-2:]), near.reshape(-1, *near.shape[-2:])
    parts = [
        _nearest_of(_every(robot, flat[k : k + _CHUNK]), hints[k : k + _CHUNK]) for k in range(0, len(flat), _CHUNK)
    ]
    arrays = [
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("q", "reachable", "within_limits", "branch", "distance", "reach")
    ]
    shaped = (values.reshape(*foot.shape[:-2], *values.shape[1:]) for values in arrays)
    return InverseSolution(*shaped, numerical=parts[0].numerical)


def _nearest_of(solution: InverseSolution, near: Array) -> InverseSolution:
    change = np.abs(wrapped(solution.q - near[..., None, :])).max(axis=-1)
    # Where no branch reaches, the first one (the foot faced by the leg) reports the distance.
    position = np.argmin(np.where(solution.reachable, change, np.inf), axis=-1)
    return _pick(solution, position, position)


def _raise_if_unreachable(solution: InverseSolution, many: bool) -> None:
    reachable = solution.reachable.any(axis=-1) if many else solution.reachable
    if reachable.all():
        return
    index = tuple(int(i) for i in np.argwhere(~reachable)[0])
    at = (*index, 0) if many else index
    low, high = solution.reach[at]
    where = ", ".join(map(str, index[:-1]))
    raise UnreachableError(index[-1] + 1, float(solution.distance[at]), (float(low), float(high)), where)
