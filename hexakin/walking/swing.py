"""Paths of a foot in the body frame, in swing and in stance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_arrays, check_number, checked
from hexakin.numerics.display import short_repr


def bezier(control: ArrayLike, phase: ArrayLike) -> Array:
    """Points (..., 3) [m] of a cubic Bezier curve (A(19), with the binomial coefficients that are missing there).

    ``control`` (..., 4, 3) [m] are the control points. ``phase`` (...) in [0, 1], the share t / t_g of the swing,
    broadcasts against the leading axes.
    """
    p, t = check_arrays(("control", control, (4, 3)), ("phase", phase, ()))
    t = t[..., None]
    u = 1.0 - t
    # A(19) in Bernstein form
    return u**3 * p[..., 0, :] + 3 * u**2 * t * p[..., 1, :] + 3 * u * t**2 * p[..., 2, :] + t**3 * p[..., 3, :]


@checked
def swing_control_points(
    start: ArrayLike, displacement: ArrayLike, forward: ArrayLike, stride: float, apex: float
) -> Array:
    """Control points (..., 4, 3) [m] of a swing (A(20)-(22), A(27)).

    ``start`` (..., 3) [m] is the position of the foot, and ``displacement`` (3,) [m] leads from there to the end of the
    swing. The two inner points lie a quarter and three quarters of ``stride`` [m] ahead along the unit vector
    ``forward`` (3,). They are raised by 4/3 of ``apex`` [m], so that a level swing rises by ``apex``. The paper prints
    h/3, which gives an apex of h/4, but calls h the maximum height.
    """
    p0, way, f = check_arrays(("start", start, (3,)), ("displacement", displacement, (3,)), ("forward", forward, (3,)))
    up = np.array([0.0, 0.0, 4.0 / 3.0 * check_number("apex", apex)])
    ahead = check_number("stride", stride) / 4 * f
    return np.stack(np.broadcast_arrays(p0, p0 + ahead + up, p0 + 3 * ahead + up, p0 + way), axis=-2)


class StepGeometry(NamedTuple):
    """Steps from one foothold to the next, B(17)-(21).

    Parameters
    ----------
    yaw
        Angle psi (...) [rad] with the sign that turns column vectors; B prints its negative, for row vectors.
    plan_length
        Length l_p (...) [m], seen from above.
    slope
        Angle theta (...) [rad] with the horizontal.
    length
        Length l_s (...) [m] in space.
    radius
        Radius R (...) [m] of the cycloid.
    """

    yaw: Array
    plan_length: Array
    slope: Array
    length: Array
    radius: Array

    def __repr__(self) -> str:
        return short_repr(self)


def step_geometry(start: ArrayLike, end: ArrayLike) -> StepGeometry:
    """Geometry of the steps from ``start`` to ``end``, both (..., 3) [m], by B(17)-(21)."""
    first, last = check_arrays(("start", start, (3,)), ("end", end, (3,)))
    dx, dy, dz = np.moveaxis(last - first, -1, 0)
    plan_length = np.hypot(dx, dy)  # B(18)
    length = np.hypot(plan_length, dz)  # B(20)
    # B(17), B(19), B(21)
    return StepGeometry(np.arctan2(dy, dx), plan_length, np.arctan2(dz, plan_length), length, length / (2.0 * np.pi))


def adapted_cycloid(start: ArrayLike, end: ArrayLike, phase: ArrayLike, arch: ArrayLike = 1.0) -> Array:
    """Points (..., 3) [m] of a cycloid in the vertical plane through its ends (B(22)-(23)).

    ``start`` and ``end`` (..., 3) [m] are the ends. ``phase`` (...) in [0, 1] is the share of the swing; the angle in
    B(22) is 2 pi times it. ``arch`` (...) is a factor, without unit, on the height of the cycloid; this height is 2 R
    and is measured at right angles to the step. ``phase`` and ``arch`` broadcast against the leading axes.
    """
    p0, p1, share, factor = check_arrays(
        ("start", start, (3,)), ("end", end, (3,)), ("phase", phase, ()), ("arch", arch, ())
    )
    step, angle = step_geometry(p0, p1), 2.0 * np.pi * share
    # B(22)
    x = step.radius * (angle - np.sin(angle))
    z = factor * step.radius * (1.0 - np.cos(angle))
    # B(23) for column vectors: Rz(yaw) Ry(-slope) (x, 0, z)
    out, up = x * np.cos(step.slope) - z * np.sin(step.slope), x * np.sin(step.slope) + z * np.cos(step.slope)
    return p0 + np.stack(np.broadcast_arrays(out * np.cos(step.yaw), out * np.sin(step.yaw), up), axis=-1)


def stance_line(start: ArrayLike, displacement: ArrayLike, phase: ArrayLike) -> Array:
    """Points (..., 3) [m] of the straight path of a foot in stance (A(23), A(31)).

    ``start`` (..., 3) [m] is the beginning of the path and ``displacement`` (..., 3) [m] leads to its end. ``phase``
    (...) in [0, 1] is the completed share of the path.
    """
    p0, way, share = check_arrays(("start", start, (3,)), ("displacement", displacement, (3,)), ("phase", phase, ()))
    return p0 + share[..., None] * way
