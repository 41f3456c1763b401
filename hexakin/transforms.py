"""Rotations and homogeneous matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array


def cross_matrix(vector: ArrayLike) -> Array:
    """Matrices (..., 3, 3) that take v to ``vector`` x v, for vectors (..., 3)."""
    v = np.asarray(vector, dtype=float)
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return matrix


def axis_rotation(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix (3, 3) by ``angle`` [rad] about the unit vector ``axis`` (Rodrigues' formula)."""
    cross = cross_matrix(axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def rpy_rotation(rpy: ArrayLike) -> Array:
    """Rotation Rz(yaw) Ry(pitch) Rx(roll) of B(2), for angles (..., 3) = (roll, pitch, yaw) [rad] -> (..., 3, 3)."""
    angles = np.asarray(rpy, dtype=float)
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(angles), -1, 0), np.moveaxis(np.cos(angles), -1, 0)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the smallest rotations (..., 3, 3) that take the direction of ``a`` to that of ``b``, (..., 3) each.

    Directions that oppose each other leave the axis open; one at a right angle to ``a`` is taken.
    """
    u, v = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    u, v = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (u, v))
    w = np.cross(u, v)
    cosine = np.einsum("...i,...i->...", u, v)
    opposed = cosine < -1.0 + 1e-12
    cross = cross_matrix(w)
    rotation = np.eye(3) + cross + cross @ cross / np.where(opposed, 1.0, 1.0 + cosine)[..., None, None]
    if opposed.any():
        least = np.eye(3)[np.argmin(np.abs(u), axis=-1)]
        axis = np.cross(u, least)
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
        half_turn = 2.0 * axis[..., :, None] * axis[..., None, :] - np.eye(3)
        rotation = np.where(opposed[..., None, None], half_turn, rotation)
    return rotation


def pose(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Homogeneous matrix (4, 4) from a rotation (3, 3) and a position (3,) [m]."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = position
    return matrix


def inverse_pose(T: ArrayLike) -> Array:
    """Inverse of poses (..., 4, 4)."""
    T = np.asarray(T, dtype=float)
    result = np.zeros_like(T)
    result[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", result[..., :3, :3], T[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def transform_points(T_target_source: ArrayLike, p_source: ArrayLike) -> Array:
    """Points (..., k, 3) given in ``source``, expressed in ``target``, for poses (..., 4, 4)."""
    T = np.asarray(T_target_source, dtype=float)
    return np.asarray(p_source, dtype=float) @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]


def wrapped(angle: ArrayLike) -> Array:
    """Angles [rad] in (-pi, pi]."""
    return np.pi - np.mod(np.pi - np.asarray(angle, dtype=float), 2.0 * np.pi)
