"""Mass matrix and bias forces of free bodies that carry legs, compiled.

A free body carries any number of legs, and a leg is a chain of hinges. All quantities of a leg are in the frame of its
free body, about the origin of that frame, so that inertias and forces of segments are sums, and no quantity is moved
from one frame to the next. Masses follow from composite inertias, bias forces from Newton's and Euler's equations at
zero generalised acceleration (R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, chapters 5 and 6). Coordinates
are Pinocchio's, as in ``hexakin.dynamics``; ``tests/test_leg_dynamics.py`` compares both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, inlined, no_new_arrays
from hexakin.numerics.vectors import (
    Symmetric,
    Vector,
    cross,
    dot,
    in_frame,
    matrix,
    plus,
    product,
    rotated,
    rotated_back,
    rotation_of,
    symmetric,
    symmetric_times,
    times,
    turned_about_z,
    vector,
    write_matrix,
    write_symmetric,
    write_vector,
)


class Bodies(NamedTuple):
    """Free bodies b and their legs l; the joints j of all legs are numbered leg by leg, from the body to the foot.

    Parameters
    ----------
    base_q, base_v
        Index (b,) of each free body's first coordinate in the configuration and in the velocity.
    joint_q, joint_v
        Index (j,) of each joint's coordinate.
    leg_base
        The free body (l,) that carries each leg.
    leg_start
        The joints of leg l are those from ``leg_start[l]`` to ``leg_start[l + 1]``, (l + 1,).
    base_inertia
        Inertia (b, 10) of each free body: mass [kg], mass times centre of mass [kg m], and moments about the origin of
        its frame [kg m^2] in the order xx, xy, xz, yy, yz, zz.
    segment_inertia
        Mass, centre of mass [m] and moments about it (j, 10) of each joint's segment, in the joint's frame.
    placement
        Pose (j, 12) of each joint at angle zero in the frame before it: rotation, row by row, and translation [m].
    gravity
        Acceleration (3,) [m/s^2] in the world.
    """

    base_q: Whole
    base_v: Whole
    joint_q: Whole
    joint_v: Whole
    leg_base: Whole
    leg_start: Whole
    base_inertia: Array
    segment_inertia: Array
    placement: Array
    gravity: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Dynamics(NamedTuple):
    """Quantities at one configuration and velocity, in the frames of the free bodies; w is the most joints of a leg.

    Parameters
    ----------
    base_rotation
        Rotation (b, 9) of each free body in the world, row by row.
    rotation, origin
        Rotation (j, 9) and origin (j, 3) [m] of each joint's frame.
    axis
        Velocity (j, 6) at the frame's origin, and angular velocity, that each joint's unit rate causes.
    composite
        Inertia (b, 10) of each free body with its legs, as ``Bodies.base_inertia``.
    coupling
        Elements (j, 6) of the mass matrix between each joint and its free body.
    block
        Elements (j, w) of the mass matrix between each joint and those before it in its leg, itself included.
    bias
        Coriolis, centrifugal and gravity forces (nv,) [N, N m].
    inertia, force
        Memory (j, 10) and (j, 6): inertia of each segment, and the force and moment that it needs.
    """

    base_rotation: Array
    rotation: Array
    origin: Array
    axis: Array
    composite: Array
    coupling: Array
    block: Array
    bias: Array
    inertia: Array
    force: Array

    def __repr__(self) -> str:
        return short_repr(self)


def dynamics_memory(bodies: Bodies) -> Dynamics:
    """Return the arrays of ``Dynamics`` for ``bodies``, filled with zeros."""
    b, j = len(bodies.base_q), len(bodies.joint_q)
    width = int(np.diff(bodies.leg_start).max(initial=0))
    shapes = ((b, 9), (j, 9), (j, 3), (j, 6), (b, 10), (j, 6), (j, width), (6 * b + j,), (j, 10), (j, 6))
    return Dynamics(*(np.zeros(shape) for shape in shapes))


@inlined
def _momentum(m: float, first: Vector, second: Symmetric, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Linear momentum, and angular momentum about the origin, of a body with velocity ``v`` there and rates ``w``.

    ``m``, ``first`` and ``second`` are its mass, mass times centre of mass, and moments about the origin.
    """
    return plus(times(m, v), cross(w, first)), plus(symmetric_times(second, w), cross(first, v))


@inlined
def _force(
    m: float, first: Vector, second: Symmetric, v: Vector, w: Vector, a: Vector, e: Vector
) -> tuple[Vector, Vector]:
    """Force and moment about the origin that give a body the accelerations ``a`` and ``e``, as derivatives of v and w.

    The other arguments are those of ``_momentum``.
    """
    p, L = _momentum(m, first, second, v, w)
    rate_p, rate_L = _momentum(m, first, second, a, e)
    return plus(rate_p, cross(w, p)), plus(rate_L, plus(cross(w, L), cross(v, p)))


@no_new_arrays
def update(bodies: Bodies, q: Array, v: Array, dynamics: Dynamics) -> None:
    """Compute ``dynamics`` at the configuration ``q`` (nq,) and the velocity ``v`` (nv,)."""
    for b in range(bodies.base_q.size):
        i, k = bodies.base_q[b], bodies.base_v[b]
        R = rotation_of(q[i + 3], q[i + 4], q[i + 5], q[i + 6])
        write_matrix(R, dynamics.base_rotation, b)
        linear, angular = (v[k], v[k + 1], v[k + 2]), (v[k + 3], v[k + 4], v[k + 5])
        # A body that resists gravity is like one that accelerates upwards.
        up = rotated_back(R, (-bodies.gravity[0], -bodies.gravity[1], -bodies.gravity[2]))
        for a in range(10):
            dynamics.composite[b, a] = bodies.base_inertia[b, a]
        first, second = vector(bodies.base_inertia, b, 1), symmetric(bodies.base_inertia, b, 4)
        f, n = _force(bodies.base_inertia[b, 0], first, second, linear, angular, up, (0.0, 0.0, 0.0))
        for a in range(3):
            dynamics.bias[k + a], dynamics.bias[k + 3 + a] = f[a], n[a]
    for leg in range(bodies.leg_base.size):
        _outwards(bodies, q, v, leg, dynamics)
        _inwards(bodies, leg, dynamics)


@inlined
def _outwards(bodies: Bodies, q: Array, v: Array, leg: int, dynamics: Dynamics) -> None:
    """Compute pose, axis, inertia and force of each segment of a leg, from the body to the foot."""
    b = bodies.leg_base[leg]
    k = bodies.base_v[b]
    R, origin = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    linear, angular = (v[k], v[k + 1], v[k + 2]), (v[k + 3], v[k + 4], v[k + 5])
    up = rotated_back(
        matrix(dynamics.base_rotation, b), (-bodies.gravity[0], -bodies.gravity[1], -bodies.gravity[2])
    )  # the accelerations at the origin, and of the rates
    turning = (0.0, 0.0, 0.0)
    for j in range(bodies.leg_start[leg], bodies.leg_start[leg + 1]):
        rate = v[bodies.joint_v[j]]
        origin = plus(origin, rotated(R, vector(bodies.placement, j, 9)))
        R = turned_about_z(product(R, matrix(bodies.placement, j)), q[bodies.joint_q[j]])
        z = (R[2], R[5], R[8])
        s = cross(origin, z)
        write_matrix(R, dynamics.rotation, j)
        write_vector(origin, dynamics.origin, j, 0)
        write_vector(s, dynamics.axis, j, 0)
        write_vector(z, dynamics.axis, j, 3)
        # The derivative of the joint's own velocity s rate, z rate, which turns with the leg.
        up = plus(up, times(rate, plus(cross(angular, s), cross(linear, z))))
        turning = plus(turning, times(rate, cross(angular, z)))
        linear, angular = plus(linear, times(rate, s)), plus(angular, times(rate, z))
        m = bodies.segment_inertia[j, 0]
        center = plus(origin, rotated(R, vector(bodies.segment_inertia, j, 1)))
        moments = in_frame(R, symmetric(bodies.segment_inertia, j, 4))
        x, y, z_ = center
        first = times(m, center)
        second = (
            moments[0] + m * (y * y + z_ * z_), moments[1] - m * x * y, moments[2] - m * x * z_,
            moments[3] + m * (x * x + z_ * z_), moments[4] - m * y * z_, moments[5] + m * (x * x + y * y),
        )  # fmt: skip
        f, n = _force(m, first, second, linear, angular, up, turning)
        dynamics.inertia[j, 0] = m
        write_vector(first, dynamics.inertia, j, 1)
        write_symmetric(second, dynamics.inertia, j, 4)
        write_vector(f, dynamics.force, j, 0)
        write_vector(n, dynamics.force, j, 3)


@inlined
def _inwards(bodies: Bodies, leg: int, dynamics: Dynamics) -> None:
    """Add inertias and forces from the foot to the body, and compute the leg's part of the mass matrix and the bias."""
    start, end, b = bodies.leg_start[leg], bodies.leg_start[leg + 1], bodies.leg_base[leg]
    inertia, force = dynamics.inertia, dynamics.force
    for j in range(end - 1, start - 1, -1):
        if j + 1 < end:
            for a in range(10):
                inertia[j, a] += inertia[j + 1, a]
            for a in range(6):
                force[j, a] += force[j + 1, a]
        s, z = vector(dynamics.axis, j, 0), vector(dynamics.axis, j, 3)
        p, L = _momentum(inertia[j, 0], vector(inertia, j, 1), symmetric(inertia, j, 4), s, z)
        write_vector(p, dynamics.coupling, j, 0)
        write_vector(L, dynamics.coupling, j, 3)
        for i in range(start, j + 1):
            dynamics.block[j, i - start] = dot(vector(dynamics.axis, i, 0), p) + dot(vector(dynamics.axis, i, 3), L)
        dynamics.bias[bodies.joint_v[j]] = dot(s, vector(force, j, 0)) + dot(z, vector(force, j, 3))
    if end > start:
        for a in range(10):
            dynamics.composite[b, a] += inertia[start, a]
        for a in range(6):
            dynamics.bias[bodies.base_v[b] + a] += force[start, a]
