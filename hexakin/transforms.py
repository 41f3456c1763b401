"""Rotations and homogeneous matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_arrays, check_poses, checked
from hexakin.exceptions import InvalidInputError, shown


def cross_matrix(vector: ArrayLike) -> Array:
    """Return the matrices (..., 3, 3) that map v to the cross product ``vector`` x v.

    ``vector`` (..., 3) may have any unit; the matrices have the same.
    """
    v = check_array("vector", vector, (3,), finite=False)
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return matrix


@checked
def axis_rotation(axis: ArrayLike, angle: float) -> Array:
    """Return the rotation matrix (3, 3) by ``angle`` [rad] about ``axis`` (3,), a unit vector (Rodrigues' formula).

    Raises InvalidInputError for a vector of another length.
    """
    direction = check_array("axis", axis, (3,))
    if direction.ndim != 1 or abs(np.linalg.norm(direction) - 1.0) > 1e-6:
        raise InvalidInputError(f"axis: expected a unit vector (3,), got {shown(axis)}")
    cross = cross_matrix(direction)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def rpy_rotation(rpy: ArrayLike) -> Array:
    """Return the rotation matrices (..., 3, 3) Rz(yaw) Ry(pitch) Rx(roll) of B(2).

    ``rpy`` (..., 3) [rad] are the angles (roll, pitch, yaw).
    """
    angles = check_array("rpy", rpy, (3,), ("angle",), finite=False)
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(angles), -1, 0), np.moveaxis(np.cos(angles), -1, 0)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the smallest rotation matrices (..., 3, 3) that turn the direction of ``a`` into that of ``b``.

    ``a`` (..., 3) and ``b`` (..., 3) may have any unit; only their directions count. For opposite directions the axis
    is not unique; one at a right angle to ``a`` is used. Raises InvalidInputError for a vector of zeros.
    """
    u, v = np.broadcast_arrays(*check_arrays(("a", a, (3,)), ("b", b, (3,))))
    for name, w in (("a", u), ("b", v)):
        if not w.any(axis=-1).all():
            raise InvalidInputError(f"{name}: a vector of zeros has no direction")
    # Scaled first, so that the squares of very long and very short vectors are numbers.
    u, v = (w / np.abs(w).max(axis=-1, keepdims=True) for w in (u, v))
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
    """Return the pose, a homogeneous matrix (4, 4), of ``rotation`` (3, 3), a matrix, and ``position`` (3,) [m].

    Raises InvalidInputError for other shapes and for a matrix that is no rotation.
    """
    matrix = np.eye(4)
    for name, value, block in (("rotation", rotation, matrix[:3, :3]), ("position", position, matrix[:3, 3])):
        values = check_array(name, value, block.shape)
        if values.shape != block.shape:
            raise InvalidInputError(f"{name}: expected shape {block.shape}, got {values.shape}")
        block[...] = values
    return check_poses("rotation", matrix)


def inverse_pose(T: ArrayLike) -> Array:
    """Return the inverses (..., 4, 4) of ``T`` (..., 4, 4), which are poses."""
    T = check_array("T", T, (4, 4), finite=False)
    result = np.zeros_like(T)
    result[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", result[..., :3, :3], T[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def transform_points(T_target_source: ArrayLike, p_source: ArrayLike) -> Array:
    """Return points (..., k, 3) [m] in the frame ``target``.

    ``T_target_source`` (..., 4, 4) are the poses of the frame ``source`` in ``target``, and ``p_source`` (..., k, 3)
    [m] the points in ``source``.
    """
    T, p = check_arrays(("T_target_source", T_target_source, (4, 4)), ("p_source", p_source, (None, 3)), finite=False)
    return p @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]


def wrapped(angle: ArrayLike) -> Array:
    """Return ``angle`` (...) [rad] plus whole turns, so that the result (...) [rad] lies in (-pi, pi]."""
    return np.pi - np.mod(np.pi - check_array("angle", angle, (), finite=False), 2.0 * np.pi)
