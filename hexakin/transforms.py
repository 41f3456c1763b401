"""Rotations, homogeneous matrices, and the checks that public functions make at their edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.exceptions import InvalidInputError

Array = NDArray[np.float64]


def check_array(name: str, value: ArrayLike, trailing: tuple[int, ...], labels: tuple[str, ...] = ()) -> Array:
    """Coerce to a float array whose last axes are ``trailing``, all finite.

    ``labels`` name these axes in the message, such as ``("leg", "joint")``; numbers in messages
    count from 1. Raises InvalidInputError naming the argument and the first bad element.
    """
    if np.iscomplexobj(value):
        raise InvalidInputError(f"{name}: expected real numbers, got complex ones")
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: expected numbers, got {type(value).__name__} ({error})") from error
    if array.shape[array.ndim - len(trailing) :] != trailing or array.ndim < len(trailing):
        expected = "(..., " + ", ".join(map(str, trailing)) + ")"
        raise InvalidInputError(f"{name}: expected shape {expected}, got {array.shape}")
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        last = index[len(index) - len(trailing) :]
        place = ", ".join(f"{label} {i + 1}" for label, i in zip(labels, last, strict=False)) or f"index {index}"
        leading = index[: len(index) - len(trailing)]
        at = f" (at index {', '.join(map(str, leading))})" if leading else ""
        raise InvalidInputError(f"{name}: {place} is {array[index]}, expected a finite number{at}")
    return array


def check_number(
    name: str,
    value: float,
    *,
    above: float = -np.inf,
    at_least: float = -np.inf,
    at_most: float = np.inf,
    unit: str = "",
) -> float:
    """Return ``value`` as a float if it is finite and within its bounds; else raise InvalidInputError."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: expected a number, got {value!r}") from error
    if not (np.isfinite(number) and number > above and at_least <= number <= at_most):
        bounds = []
        if np.isfinite(above):
            bounds.append(f"above {above:g}")
        if np.isfinite(at_least):
            bounds.append(f"at least {at_least:g}")
        if np.isfinite(at_most):
            bounds.append(f"at most {at_most:g}")
        wanted = " and ".join(bounds) or "finite"
        raise InvalidInputError(f"{name}: {number:g}{' ' + unit if unit else ''}, expected {wanted}")
    return number


def check_whole(name: str, value: object, *, at_least: int = 0) -> int:
    """Return ``value`` as an int if it is a whole number of at least ``at_least``; else raise InvalidInputError."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)) or value < at_least:
        raise InvalidInputError(f"{name}: {value!r}, expected a whole number of at least {at_least}")
    return int(value)


def read_only(value: ArrayLike) -> Array:
    """Return a copy that cannot be written to."""
    array = np.array(value, dtype=float)
    array.setflags(write=False)
    return array


def axis_rotation(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix (3, 3) by ``angle`` [rad] about the unit vector ``axis`` (Rodrigues' formula)."""
    x, y, z = np.asarray(axis, dtype=float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
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
    zero = np.zeros_like(cosine)
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*cosine.shape, 3, 3)
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
