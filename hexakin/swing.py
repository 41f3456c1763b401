"""Paths of a foot in the body frame, in swing and in stance."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hexakin.transforms import Array


def bezier(control: ArrayLike, phase: ArrayLike) -> Array:
    """Cubic Bezier curve (A(19) with the binomial coefficients that it omits).

    ``control`` (..., 4, 3) [m] are the control points, ``phase`` in [0, 1] is t / t_g and broadcasts
    against the leading axes; returns (..., 3) [m].
    """
    p = np.asarray(control, dtype=float)
    t = np.asarray(phase, dtype=float)[..., None]
    u = 1.0 - t
    # A(19) in Bernstein form
    return u**3 * p[..., 0, :] + 3 * u**2 * t * p[..., 1, :] + 3 * u * t**2 * p[..., 2, :] + t**3 * p[..., 3, :]


def swing_control_points(
    start: ArrayLike, displacement: ArrayLike, forward: ArrayLike, stride: float, apex: float
) -> Array:
    """Control points of a swing (A(20)-(22), (27)).

    ``start`` (..., 3) [m] is the foot's position, ``displacement`` (3,) [m] where it ends relative to it,
    ``forward`` (3,) the unit vector along which the inner points advance by a quarter and three quarters
    of ``stride`` [m]. They are raised by 4/3 of ``apex`` [m], so that a level swing rises by ``apex``;
    A prints h/3, whose apex is h/4, and calls h the maximum height. Returns (..., 4, 3).
    """
    p0 = np.asarray(start, dtype=float)
    f, up = np.asarray(forward, dtype=float), np.array([0.0, 0.0, 4.0 / 3.0 * apex])
    return np.stack(
        [p0, p0 + stride / 4 * f + up, p0 + 3 * stride / 4 * f + up, p0 + np.asarray(displacement)], axis=-2
    )


def stance_line(start: ArrayLike, displacement: ArrayLike, phase: ArrayLike) -> Array:
    """Straight stance path (A(23), A(31)) from ``start`` (..., 3) [m]: ``phase`` in [0, 1] times ``displacement``."""
    return np.asarray(start, dtype=float) + np.asarray(phase, dtype=float)[..., None] * np.asarray(displacement)
