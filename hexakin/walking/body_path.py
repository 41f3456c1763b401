"""Path of the body during a walk of paper B (B(24)-(25))."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array
from hexakin.transforms import rotation_between, rpy_rotation
from hexakin.walking.foot_tracks import Course


def body_poses(
    course: Course,
    ground: Array,
    progress: Array,
    step: Array,
    *,
    height: Array,
    height_reference: str,
    height_along: str,
    orientation: str | ArrayLike,
    yaw: float,
) -> Array:
    """Body poses (n, 4, 4) over the mean of the footholds, which moves from step to step (B(24)-(25)).

    Parameters
    ----------
    course
        Tracks of the legs; used for the horizontal offset of the body from its feet.
    ground
        Footholds (k + 1, L, 3) [m] on the ground, for k steps.
    progress, step
        Times (n,) of the samples in steps, and the index (n,) of the step of each sample.
    height
        Heights (n,) [m] of the body's origin.
    height_reference, height_along, orientation, yaw
        As in ``hexakin.plan_walk``, where ``orientation`` is called ``body_orientation``.
    """
    part = (progress - step)[:, None]
    middle = ground.mean(axis=1)
    center = (1.0 - part) * middle[step] + part * middle[step + 1]
    center[:, :2] += course.body_offset
    if height_reference == "start":
        center[:, 2] = middle[0, 2]
    turn = rpy_rotation([0.0, 0.0, yaw])
    up = np.broadcast_to([0.0, 0.0, 1.0], center.shape)
    if isinstance(orientation, str) and orientation == "parallel":
        normals = _fitted_normals(ground)
        up = (1.0 - part) * normals[step] + part * normals[step + 1]
        up = up / np.linalg.norm(up, axis=-1, keepdims=True)
        rotation = rotation_between([0.0, 0.0, 1.0], up) @ turn
    elif isinstance(orientation, str):
        rotation = np.broadcast_to(turn, (len(center), 3, 3))
    else:
        rotation = np.broadcast_to(turn @ rpy_rotation(orientation), (len(center), 3, 3))
    T = np.zeros((len(center), 4, 4))
    T[:, :3, :3] = rotation
    if height_along == "vertical":
        # B(24)-(25) fix x and y for any orientation of the body.
        T[:, :3, 3] = center
        T[:, 2, 3] += height / up[:, 2]
    else:
        T[:, :3, 3] = center + height[:, None] * up
    T[:, 3, 3] = 1.0
    return T


def _fitted_normals(points: Array) -> Array:
    """Upward unit normals (k, 3) of the least-squares planes z = a x + b y + c through points (k, L, 3)."""
    offset = points - points.mean(axis=1, keepdims=True)
    moment = np.einsum("kli,klj->kij", offset[..., :2], offset[..., :2])
    slope = np.linalg.solve(moment, np.einsum("kli,kl->ki", offset[..., :2], offset[..., 2])[..., None])[..., 0]
    normal = np.concatenate([-slope, np.ones((len(points), 1))], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)
