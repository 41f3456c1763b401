"""Inverse kinematics of a leg whose table has no known closed form: damped least squares from many starts.

A foot's height along the first joint's axis and its distance from it do not depend on the first angle. On a grid of the
two others, the places that come nearest to the target in both are the starts; a leg of three joints has at most
four solutions (Kohli and Spanos 1985).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.kinematics.leg_functions import leg_functions
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot
from hexakin.transforms import wrapped

NUM_SOLUTIONS = 4
"""Largest number of solutions of a leg of three joints."""

_GRID = 24  # samples of a turn
_STARTS = 12  # with 8, one solution in a thousand is missed, near singular poses; with 12 none in 18000 was
_ITERATIONS = 40  # a stretched leg, at the edge of its reach, gains a factor of four in each
_TOLERANCE = 1e-9  # of the leg's size: a target that is missed by more is not reached
_DISTINCT = 1e-4  # [rad] between two solutions; nearer ones are one, at a singular pose
_CHUNK = 256  # targets at a time: their mismatch on the grid takes 4.6 kB per leg


class Solutions(NamedTuple):
    """Angles that bring feet to their targets.

    ``q`` (..., L, 4, 3) [rad], ordered by their largest difference from the standing pose and within half a turn of it,
    NaN where there are fewer than four; ``distance`` (..., L) [m] from the second joint to the target, while the first
    angle is that of the pose which brings the foot nearest to it.
    """

    q: Array
    distance: Array

    def __repr__(self) -> str:
        return short_repr(self)


def solve_numerically(robot: Robot, foot: Array) -> Solutions:
    """Return the solutions of ``robot`` for feet ``foot`` (..., L, 3) [m] in the body frame, all finite.

    It takes every leg type, also one with a closed form.
    """
    fixed = np.array([robot.fixed_poses(leg) for leg in range(robot.num_legs)])
    grid = _grid(robot, fixed[:, 0])
    flat = foot.reshape(-1, robot.num_legs, 3)
    q = np.empty((len(flat), robot.num_legs, NUM_SOLUTIONS, 3))
    first = np.empty(flat.shape[:2])
    for k in range(0, len(flat), _CHUNK):
        part = slice(k, k + _CHUNK)
        q[part], first[part] = _solve(robot, fixed[:, 0], grid, flat[part])
    c, s = np.cos(first), np.sin(first)
    x, y, z = np.moveaxis(fixed[:, 1, :3, 3], -1, 0)
    turned = np.stack(np.broadcast_arrays(c * x - s * y, s * x + c * y, z), axis=-1)
    second = np.einsum("lij,...lj->...li", fixed[:, 0, :3, :3], turned) + fixed[:, 0, :3, 3]
    distance = np.linalg.norm(flat - second, axis=-1)
    return Solutions(q.reshape(*foot.shape[:-1], NUM_SOLUTIONS, 3), distance.reshape(foot.shape[:-1]))


class _Grid(NamedTuple):
    """Angles (g, 3) with the first 0, and the foot's distance from the first axis, height and azimuth, (L, g) each."""

    q: Array
    radius: Array
    height: Array
    azimuth: Array
    size: Array


def _grid(robot: Robot, T_body_first: Array) -> _Grid:
    turn = 2.0 * np.pi * np.arange(_GRID) / _GRID
    q = np.stack([np.zeros(_GRID**2), np.repeat(turn, _GRID), np.tile(turn, _GRID)], axis=-1)
    every = np.broadcast_to(q[:, None], (len(q), robot.num_legs, 3))
    feet = np.swapaxes(leg_functions(robot.table).forward(robot.parameters, every), 0, 1)
    radius, height, azimuth = _cylindrical(T_body_first[:, None], feet)
    return _Grid(q, radius, height, azimuth, np.hypot(radius, height).max(axis=-1))


def _cylindrical(T: Array, point: Array) -> tuple[Array, Array, Array]:
    local = np.einsum("...ji,...j->...i", T[..., :3, :3], point - T[..., :3, 3])
    return np.hypot(local[..., 0], local[..., 1]), local[..., 2], np.arctan2(local[..., 1], local[..., 0])


def _solve(robot: Robot, T_body_first: Array, grid: _Grid, foot: Array) -> tuple[Array, Array]:
    """Solutions (n, L, 4, 3) and the nearest pose's first angle (n, L) for feet (n, L, 3)."""
    forward, jacobian = leg_functions(robot.table).forward, leg_functions(robot.table).jacobian
    near = robot.standing_q[:, None]
    q = _starts(grid, T_body_first, foot)
    target, p = foot[..., None, :], robot.parameters[:, None, :]
    error = target - forward(p, q)
    damping = np.ones(error.shape[:-1])
    for _ in range(_ITERATIONS):
        square = (error**2).sum(axis=-1)
        J = jacobian(p, q)
        # Damping in proportion to the squared error keeps the convergence quadratic (Yamashita and Fukushima 2001).
        normal = J @ np.swapaxes(J, -1, -2) + (damping * square + 1e-30)[..., None, None] * np.eye(3)
        step = np.einsum("...ji,...j->...i", J, np.linalg.solve(normal, error[..., None])[..., 0])
        tried = q + np.clip(step, -0.5, 0.5)
        missed = target - forward(p, tried)
        better = (missed**2).sum(axis=-1) <= square
        q, error = np.where(better[..., None], tried, q), np.where(better[..., None], missed, error)
        damping = np.where(better, np.maximum(0.3 * damping, 1e-6), 10.0 * damping)
    residual = np.linalg.norm(error, axis=-1)
    first = np.take_along_axis(q[..., 0], np.argmin(residual, axis=-1)[..., None], axis=-1)[..., 0]
    q = near + wrapped(q - near)
    change = np.where(residual <= _TOLERANCE * grid.size[:, None], np.abs(q - near).max(axis=-1), np.inf)
    order = np.argsort(change, axis=-1, kind="stable")
    q, change = np.take_along_axis(q, order[..., None], axis=-2), np.take_along_axis(change, order, axis=-1)
    found = _first_of_each(q, np.isfinite(change))
    order = np.argsort(~found, axis=-1, kind="stable")[..., :NUM_SOLUTIONS]
    q, found = np.take_along_axis(q, order[..., None], axis=-2), np.take_along_axis(found, order, axis=-1)
    return np.where(found[..., None], q, np.nan), first


def _starts(grid: _Grid, T: Array, foot: Array) -> Array:
    """Angles (n, L, starts, 3) at the local minima, on the torus of the second and third angle, of the mismatch."""
    radius, height, azimuth = _cylindrical(T, foot)
    mismatch = (grid.radius - radius[..., None]) ** 2 + (grid.height - height[..., None]) ** 2
    torus = mismatch.reshape(*mismatch.shape[:-1], _GRID, _GRID)
    lowest = np.ones(torus.shape, dtype=bool)
    for shift in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for sign in (1, -1):
            lowest &= torus <= np.roll(torus, (sign * shift[0], sign * shift[1]), axis=(-2, -1))
    lowest = lowest.reshape(mismatch.shape)
    chosen = np.argpartition(np.where(lowest, mismatch, mismatch + 1e3 * grid.size[:, None] ** 2), _STARTS, axis=-1)
    chosen = chosen[..., :_STARTS]
    q = grid.q[chosen]
    q[..., 0] = azimuth[..., None] - np.take_along_axis(np.broadcast_to(grid.azimuth, mismatch.shape), chosen, axis=-1)
    return q


def _first_of_each(q: Array, found: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the solutions (..., s, 3) are there, and the first of their kind."""
    gap = np.abs(wrapped(q[..., :, None, :] - q[..., None, :, :])).max(axis=-1)
    earlier = np.tril(np.ones(gap.shape[-2:], dtype=bool), -1)
    return found & ~((gap < _DISTINCT) & found[..., None, :] & earlier).any(axis=-1)
