"""Checks of the arguments of public functions, and the type ``Array``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.exceptions import InvalidInputError

Array = NDArray[np.float64]

_ROTATION_ERROR = 1e-6  # of R^T R: rounding in single precision, or in a long product of rotations, is below it


def check_array(name: str, value: ArrayLike, trailing: tuple[int, ...], labels: tuple[str, ...] = ()) -> Array:
    """Convert ``value`` to a float array with the last axes ``trailing``, and check that all elements are finite.

    ``name`` is the argument's name in the message. ``labels`` are names of the last axes, such as ``("leg", "joint")``;
    the message counts along them from 1. Raises InvalidInputError, which names the argument and the first bad element.
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


def check_poses(name: str, value: ArrayLike) -> Array:
    """Return ``value`` (..., 4, 4) as a float array if each matrix is a pose; otherwise raise InvalidInputError.

    A pose consists of a rotation, a position [m] and the row (0, 0, 0, 1). Zeros, shears, scales and reflections are no
    rotations. ``name`` is the argument's name in the message.
    """
    T = check_array(name, value, (4, 4))
    rotation = T[..., :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max(axis=(-2, -1))
        turned = (off <= _ROTATION_ERROR) & (np.linalg.det(rotation) > 0.0)
    for bad, text in (
        (~turned, "the first three rows and columns are no rotation"),
        ((T[..., 3, :] != [0.0, 0.0, 0.0, 1.0]).any(axis=-1), "the last row is not (0, 0, 0, 1)"),
    ):
        if bad.any():
            at = ", ".join(map(str, np.argwhere(bad)[0]))
            raise InvalidInputError(f"{name}: expected poses, but {text}" + (f" (at index {at})" if at else ""))
    return T


def check_number(
    name: str,
    value: float,
    *,
    above: float = -np.inf,
    at_least: float = -np.inf,
    at_most: float = np.inf,
    unit: str = "",
) -> float:
    """Return ``value`` as a float if it is finite and within its bounds; otherwise raise InvalidInputError.

    The bounds are ``above`` (exclusive), ``at_least`` and ``at_most`` (inclusive). ``name`` and ``unit`` are for the
    message.
    """
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
    """Return ``value`` as an int if it is a whole number, ``at_least`` or more; otherwise raise InvalidInputError.

    ``name`` is the argument's name in the message.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)) or value < at_least:
        raise InvalidInputError(f"{name}: {value!r}, expected a whole number of at least {at_least}")
    return int(value)


def read_only(value: ArrayLike) -> Array:
    """Return a read-only copy of ``value`` as a float array."""
    array = np.array(value, dtype=float)
    array.setflags(write=False)
    return array
