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


def rotation_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the smallest rotation (3, 3) that takes the direction of ``a`` (3,) to that of ``b`` (3,)."""
    u, v = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    axis = np.cross(u, v)
    sine, cosine = float(np.linalg.norm(axis)), float(u @ v)
    if sine < 1e-15:
        if cosine > 0.0:
            return np.eye(3)
        axis = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
        return axis_rotation(axis / np.linalg.norm(axis), np.pi)
    return axis_rotation(axis / sine, float(np.arctan2(sine, cosine)))


def pose(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Homogeneous matrix (4, 4) from a rotation (3, 3) and a position (3,) [m]."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = position
    return matrix


def transform_points(T_target_source: ArrayLike, p_source: ArrayLike) -> Array:
    """Points (..., k, 3) given in ``source``, expressed in ``target``, for poses (..., 4, 4)."""
    T = np.asarray(T_target_source, dtype=float)
    return np.asarray(p_source, dtype=float) @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]
