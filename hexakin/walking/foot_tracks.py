"""Tracks of the feet: the ground along each leg's track, starting offsets, and swings that clear the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array
from hexakin.exceptions import ClearanceError, InvalidInputError
from hexakin.kinematics.forward import forward_kinematics
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain
from hexakin.terrain.leg_curves import LegCurves
from hexakin.transforms import axis_rotation
from hexakin.walking.gait import Gait
from hexakin.walking.swing import adapted_cycloid

START_OFFSETS = ("stable", "B15", "B16")
MAX_ARCH = 4.0
"""Highest swing that is tried for ``arch="clear"``, as a multiple of the height of the paper's cycloid."""


def start_offset(gait: Gait, step_length: float, name: str, first_group: int = 0) -> Array:
    """Distance (L,) [m] at which each leg starts ahead of its standing foothold (B(15)-(16), B-E2).

    ``step_length`` [m], ``name`` (called ``start_offsets`` there) and ``first_group`` are those of
    ``hexakin.plan_walk``. Raises InvalidInputError if B(15) or B(16) is chosen for a ``gait`` other than the tripod.
    """
    offset = np.zeros(gait.num_legs)
    if name == "stable":
        for group, legs in enumerate(gait.groups):
            turn = (group - first_group) % gait.phases_per_cycle
            offset[list(legs)] = turn * step_length / gait.phases_per_cycle
        return offset
    if gait.name != "tripod":
        raise InvalidInputError(f"start_offsets: {name!r} is defined for the tripod gait only, got {gait.name}")
    offset[[1, 3, 5]] = -step_length / 2.0
    if name == "B16":
        offset[1] = step_length / 2.0
    return offset


class Course:
    """Track of each leg over the ground (B section 3); the arguments are those of ``hexakin.plan_walk``.

    Attributes: ``ahead`` and ``left`` (3,), the unit vectors along and across the walk; ``body_offset`` (2,) [m], the
    position of the body relative to the mean of its standing feet; ``order`` (L,), the index of the phase of a step in
    which each leg swings.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain | LegCurves,
        gait: Gait,
        step_length: float,
        *,
        heading: float,
        start: tuple[float, float],
        yaw: float,
        start_offsets: str,
        first_group: int,
    ):
        up = [0.0, 0.0, 1.0]
        self._terrain, self._step_length = terrain, step_length
        turn = axis_rotation(up, yaw)
        self.ahead = axis_rotation(up, heading) @ turn @ robot.forward
        self.left = np.cross(up, self.ahead)
        feet = forward_kinematics(robot, robot.standing_q) @ turn.T
        offset = start_offset(gait, step_length, start_offsets, first_group)
        self._origin = feet[:, :2] + np.asarray(start) + offset[:, None] * self.ahead[:2]
        # Position of the body relative to the mean of its standing feet, seen from above.
        self.body_offset = -feet[:, :2].mean(axis=0)
        # Index of the phase of a step in which each leg swings.
        self.order = np.zeros(robot.num_legs, dtype=int)
        for group, legs in enumerate(gait.groups):
            self.order[list(legs)] = (group - first_group) % gait.phases_per_cycle

    def ground(self, steps: ArrayLike) -> Array:
        """Points (..., L, 3) [m] on the ground after ``steps`` (...) or (..., L), which need not be whole numbers."""
        s = self._step_length * np.asarray(steps, dtype=float)
        s = s[..., None] if s.ndim < 2 else s
        if isinstance(self._terrain, LegCurves):
            move = self._terrain.displacement(s)
            xy = self._origin + move[..., :1] * self.ahead[:2] + move[..., 1:2] * self.left[:2]
            return np.concatenate([xy, move[..., 2:]], axis=-1)
        xy = self._origin + s[..., None] * self.ahead[:2]
        return np.concatenate([xy, self._terrain.height(xy[..., 0], xy[..., 1])[..., None]], axis=-1)

    def normal(self, ground: Array) -> Array:
        """Unit normals (..., 3) at points ``ground`` (..., 3) [m]; the curves of paper B count as level."""
        if isinstance(self._terrain, LegCurves):
            return np.broadcast_to([0.0, 0.0, 1.0], ground.shape)
        return self._terrain.normal(ground[..., 0], ground[..., 1])

    def ground_under(self, feet: Array, centers: Array, step: NDArray[np.int_]) -> Array:
        """Height (n, L) [m] of the ground below ``feet`` (n, L, 3) [m]; on paper B's curves, of the leg's own curve.

        ``centers`` (k + 1, L, 3) [m] are the positions of the feet on their footholds, ``step`` (n,) the index of the
        step of each sample.
        """
        if not isinstance(self._terrain, LegCurves):
            return self._terrain.height(feet[..., 0], feet[..., 1])
        first, chord = centers[step, :, :2], (centers[step + 1] - centers[step])[..., :2]
        length = np.einsum("...i,...i->...", chord, chord)
        along = np.einsum("...i,...i->...", feet[..., :2] - first, chord) / np.where(length > 0.0, length, 1.0)
        return self.ground(step[:, None] + np.clip(along, 0.0, 1.0))[..., 2]


def swing_arches(course: Course, centers: Array, num_steps: int, arch: float | str) -> Array:
    """Height (k, L) of every swing, as a multiple of the height of the paper's cycloid.

    ``centers`` (k + 1, L, 3) [m] are the positions of the feet on their footholds, ``num_steps`` is k, and ``arch`` is
    that of ``hexakin.plan_walk``. Raises ClearanceError if ``arch`` is ``"clear"`` and a swing cuts into the ground
    even with the largest height.
    """
    num_legs = centers.shape[1]
    if arch != "clear":
        return np.full((num_steps, num_legs), float(arch))
    samples = np.linspace(0.0, 1.0, 65)[1:-1]
    radius_up = centers[..., 2] - course.ground(np.arange(num_steps + 1))[..., 2]
    result = np.ones((num_steps, num_legs))
    while True:
        depth = np.full((num_steps, num_legs), np.inf)
        for k in range(num_steps):
            path = adapted_cycloid(centers[k], centers[k + 1], samples[:, None], result[k])
            step = np.full(len(samples), k)
            ground = course.ground_under(path, centers, step)
            # Height of the centre of a resting foot over the ground, from one foothold to the next.
            rest = radius_up[k] + samples[:, None] * (radius_up[k + 1] - radius_up[k])
            depth[k] = (path[..., 2] - rest - ground).min(axis=0)
        cutting = depth < -1e-9
        if not cutting.any():
            return result
        stuck = cutting & (result >= MAX_ARCH)
        if stuck.any():
            k, leg = np.argwhere(stuck)[0]
            raise ClearanceError(int(leg) + 1, int(k) + 1, float(-depth[k, leg]), MAX_ARCH)
        result = np.where(cutting, result + 0.25, result)
