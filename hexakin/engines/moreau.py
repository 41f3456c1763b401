"""Moreau time stepping of rigid bodies with friction and impacts, compiled (A section 3.1).

A step of length h goes from velocity v to v' at the configuration half-way, q + h v / 2, where contacts are sought:

    M (v' - v) = -h (C + g) + S^T s + J^T p,

servo impulses s and contact impulses p found together (``hexakin.contact.impulses``). A contact that is closed
may not approach; one about to close may at most close its gap. Contacts that strike faster than a threshold bounce,
by Poisson's law (A(4)-(6)), whose expansion phase returns at least the share xi of each compression impulse, or by
Newton's, which returns the share xi of each approach velocity. Jean and Moreau, "Unilaterality and dry friction in
the dynamics of rigid body collections" (1992); Anitescu and Potra (1997); Glocker, "Set-Valued Force Laws" (2001).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.compiled import Whole, compiled
from hexakin.contact.impulses import solve_impact
from hexakin.engines.collision import Contacts, Ground, box_near, box_pairs, sphere_contacts, vertex_contacts
from hexakin.transforms import Array

CAPACITY = 64  # contacts at a time
_SLOP = 1e-3  # [m] penetration that is left alone
_PUSH_TIME = 0.05  # [s] in which deeper penetration is taken back ...
_PUSH_SPEED = 0.1  # ... [m/s] but not faster than this


class Bodies(NamedTuple):
    """Shapes on bodies and the tree that moves them.

    ``moves`` (joint, coordinate) tells whether the coordinate moves the joint's body; ``floating`` and ``hinges``
    (k, 2) where the coordinates of free and revolute joints begin in q and v. ``meeting`` is true if bodies can meet
    each other.
    """

    sphere_joint: Whole
    sphere_group: Whole
    sphere: Array  # (s, 4) centre and radius
    box_joint: Whole
    box_group: Whole
    box_rotation: Array  # (b, 3, 3)
    box: Array  # (b, 6) centre and half sizes
    box_radius: Array  # (b,) of the sphere around it
    moves: NDArray[np.bool_]
    floating: Whole
    hinges: Whole
    servo: Whole
    servo_q: Whole
    meeting: bool


class Law(NamedTuple):
    """Constants of a run."""

    h: float
    friction: float
    restitution: float
    poisson: bool
    threshold: float
    servo_rate: float
    servo_torque: float
    facets: int
    compliance: float
    tolerance: float
    max_sweeps: int
    margin: float


class State(NamedTuple):
    """What goes from step to step, and results, all changed in place."""

    v: Array
    s: Array
    hold: Whole
    old_key: Whole
    old_impulse: Array  # (c, 3) in the world
    old_count: Whole  # (1,)
    found: Whole  # (1,)
    impulse: Array  # (g,) normal impulse by group
    sums: Array  # servo work, contact work, penetration, residual


@compiled
def _point_jacobian(moves: NDArray[np.bool_], J: Array, body: int, x: Array, d: Array, sign: float, row: Array) -> None:
    """Add the derivative of a body point's velocity along d to a row; J (6, nv) is about the world's origin."""
    # d . (v + w x x) = d . v + (x x d) . w
    mx, my, mz = x[1] * d[2] - x[2] * d[1], x[2] * d[0] - x[0] * d[2], x[0] * d[1] - x[1] * d[0]
    for k in range(row.size):
        if moves[body, k]:
            row[k] += sign * (
                d[0] * J[0, k] + d[1] * J[1, k] + d[2] * J[2, k] + mx * J[3, k] + my * J[4, k] + mz * J[5, k]
            )


@compiled
def _tangent(n: Array, t: Array) -> None:
    """First tangent: the world's x axis laid into the tangent plane (or y, if the normal is along x)."""
    axis = 0 if abs(n[0]) < 0.9 else 1
    for a in range(3):
        t[a] = -n[axis] * n[a]
    t[axis] += 1.0
    norm = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for a in range(3):
        t[a] /= norm


@compiled
def _center(P: Array, x: Array, out: Array) -> None:
    """Point x of a joint's frame in the world; a pose's row is its rotation, column by column, and its translation."""
    for a in range(3):
        out[a] = P[a] * x[0] + P[3 + a] * x[1] + P[6 + a] * x[2] + P[9 + a]


@compiled
def _rotation(P: Array, R_joint: Array, out: Array) -> None:
    for a in range(3):
        for b in range(3):
            out[a, b] = P[a] * R_joint[0, b] + P[3 + a] * R_joint[1, b] + P[6 + a] * R_joint[2, b]


@compiled
def find_contacts(
    poses: Array, bodies: Bodies, ground: Ground, margin: float, contacts: Contacts, pairs: Whole
) -> tuple[int, int]:
    """Seek contacts of spheres and boxes with the ground.

    Returns how many, and how many ``pairs`` (body's box, ground's box) are near; these are left to a library.
    """
    count, near, x = 0, 0, np.empty(3)
    number = 0
    for k in range(bodies.sphere_joint.size):
        S = bodies.sphere[k]
        _center(poses[bodies.sphere_joint[k]], S, x)
        count = sphere_contacts(
            ground,
            bodies.sphere_joint[k],
            bodies.sphere_group[k],
            number,
            x[0],
            x[1],
            x[2],
            S[3],
            margin,
            contacts,
            count,
        )
        number += 1
    R, center = np.empty((3, 3)), np.empty(3)
    for k in range(bodies.box_joint.size):
        P, B, joint, group = poses[bodies.box_joint[k]], bodies.box[k], bodies.box_joint[k], bodies.box_group[k]
        _center(P, B, center)
        if box_near(ground, center, bodies.box_radius[k] + margin):
            _rotation(P, bodies.box_rotation[k], R)
            for corner in range(8):
                for a in range(3):
                    x[a] = center[a]
                    for b in range(3):
                        x[a] += R[a, b] * (B[3 + b] if corner & (1 << b) else -B[3 + b])
                count = sphere_contacts(
                    ground, joint, group, number + corner, x[0], x[1], x[2], 0.0, margin, contacts, count
                )
            if ground.vertices.shape[0] > 0:
                count = vertex_contacts(ground, joint, group, R, center, B[3:], margin, contacts, count)
            if ground.boxes.shape[0] > 0:
                near = box_pairs(ground, k, R, center, B[3:], margin, pairs, near)
        number += 8
    return count, near


@compiled
def solve_step(
    M_upper: Array,
    bias_force: Array,
    J_world: Array,
    q: Array,
    command: Array,
    bodies: Bodies,
    contacts: Contacts,
    found: int,
    law: Law,
    state: State,
) -> None:
    """One step of the velocities, in place; configuration, mass matrix and contacts are those half-way."""
    nv, h, v = state.v.size, law.h, state.v
    m = bodies.servo.size
    M = np.empty((nv, nv))
    for j in range(nv):
        for i in range(j + 1):
            M[i, j] = M[j, i] = M_upper[i, j]
    # Which contacts take part.
    active, approach = np.empty(found, dtype=np.int64), np.empty(found)
    rows, frames = np.zeros((3 * found, nv)), np.empty((found, 3, 3))
    n = 0
    for c in range(found):
        frame = frames[n]
        normal, x = contacts.normal[c], contacts.point[c]
        _tangent(normal, frame[0])
        for a in range(3):
            frame[2, a] = normal[a]
        frame[1, 0] = normal[1] * frame[0, 2] - normal[2] * frame[0, 1]
        frame[1, 1] = normal[2] * frame[0, 0] - normal[0] * frame[0, 2]
        frame[1, 2] = normal[0] * frame[0, 1] - normal[1] * frame[0, 0]
        for a in range(3):
            row = rows[3 * n + a]
            row[:] = 0.0
            _point_jacobian(bodies.moves, J_world, contacts.bodies[c, 0], x, frame[a], 1.0, row)
            if contacts.bodies[c, 1] >= 0:
                _point_jacobian(bodies.moves, J_world, contacts.bodies[c, 1], x, frame[a], -1.0, row)
        speed = 0.0
        for k in range(nv):
            speed += rows[3 * n + 2, k] * v[k]
        # A fast body whose gap is still open flies on: it shall strike with its own speed.
        if contacts.gap[c] <= 0.0 or speed >= -law.threshold:
            active[n], approach[n] = c, speed
            n += 1
    J = rows[: 3 * n]
    mu, bias, strikes = np.full(n, law.friction), np.zeros(n), np.zeros(n, dtype=np.int64)
    p, u, r, after = np.zeros(3 * n), np.zeros(3 * n), np.empty(nv), np.empty(nv)
    for i in range(n):
        c = active[i]
        gap = contacts.gap[c]
        if gap > 0.0:
            bias[i] = gap / h
        elif gap < -_SLOP:
            bias[i] = -min((-gap - _SLOP) / _PUSH_TIME, _PUSH_SPEED)
        if gap <= 0.0 and approach[i] < -law.threshold:
            strikes[i] = 1
        for old in range(state.old_count[0]):
            if contacts.key[c] >= 0 and state.old_key[old] == contacts.key[c]:
                for a in range(3):
                    for k in range(3):
                        p[3 * i + a] += frames[i, a, k] * state.old_impulse[old, k]
    for i in range(nv):
        value = -h * bias_force[i]
        for k in range(nv):
            value += M[i, k] * v[k]
        r[i] = value
    target, limit = np.empty(m), np.full(m, h * law.servo_torque)
    for j in range(m):
        target[j] = law.servo_rate * (command[j] - q[bodies.servo_q[j]]) / (1.0 + 0.5 * h * law.servo_rate)
    residual, _ = solve_impact(
        M, r, J, mu, bias, strikes, approach, law.restitution, law.poisson, bodies.servo, target, limit, state.hold,
        p, np.empty(3 * n), state.s, u, after, law.facets, law.compliance, law.tolerance, law.max_sweeps,
    )  # fmt: skip
    # Work by the trapezoidal rule: exact for a constant mass matrix.
    for j in range(m):
        i = bodies.servo[j]
        state.sums[0] += 0.5 * state.s[j] * (v[i] + after[i])
    work = 0.0
    for i in range(3 * n):
        if p[i] != 0.0:
            speed = 0.0
            for k in range(nv):
                speed += J[i, k] * (v[k] + after[k])
            work += 0.5 * p[i] * speed
    state.sums[1] += work
    state.sums[3] = max(state.sums[3], residual)
    state.old_count[0] = n
    for i in range(n):
        c = active[i]
        state.sums[2] = max(state.sums[2], -contacts.gap[c])
        state.impulse[contacts.group[c]] += p[3 * i + 2]
        state.old_key[i] = contacts.key[c]
        for k in range(3):
            state.old_impulse[i, k] = 0.0
            for a in range(3):
                state.old_impulse[i, k] += frames[i, a, k] * p[3 * i + a]
    for i in range(nv):
        v[i] = after[i]


@compiled
def _integrate(q: Array, v: Array, bodies: Bodies, h: float) -> None:
    """Move the configuration along a constant velocity, exactly, in place."""
    for k in range(bodies.hinges.shape[0]):
        q[bodies.hinges[k, 0]] += h * v[bodies.hinges[k, 1]]
    for k in range(bodies.floating.shape[0]):
        i, j = bodies.floating[k]
        wx, wy, wz = h * v[j + 3], h * v[j + 4], h * v[j + 5]
        ux, uy, uz = h * v[j], h * v[j + 1], h * v[j + 2]
        square = wx * wx + wy * wy + wz * wz
        angle = np.sqrt(square)
        if angle > 1e-4:
            a, b = (1.0 - np.cos(angle)) / square, (angle - np.sin(angle)) / (square * angle)
            sine, cosine = np.sin(0.5 * angle) / angle, np.cos(0.5 * angle)
        else:
            a, b = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
            sine, cosine = 0.5 - square / 48.0, 1.0 - square / 8.0
        # Displacement along the screw, in the body's frame: u + a w x u + b w x (w x u).
        cx, cy, cz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
        dx = ux + a * cx + b * (wy * cz - wz * cy)
        dy = uy + a * cy + b * (wz * cx - wx * cz)
        dz = uz + a * cz + b * (wx * cy - wy * cx)
        x, y, z, w = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        # Rotated into the world: d + 2 r x (r x d + w d), r the quaternion's vector.
        ex, ey, ez = y * dz - z * dy + w * dx, z * dx - x * dz + w * dy, x * dy - y * dx + w * dz
        q[i] += dx + 2.0 * (y * ez - z * ey)
        q[i + 1] += dy + 2.0 * (z * ex - x * ez)
        q[i + 2] += dz + 2.0 * (x * ey - y * ex)
        sx, sy, sz = sine * wx, sine * wy, sine * wz
        nx = w * sx + x * cosine + y * sz - z * sy
        ny = w * sy - x * sz + y * cosine + z * sx
        nz = w * sz + x * sy - y * sx + z * cosine
        nw = w * cosine - x * sx - y * sy - z * sz
        norm = np.sqrt(nx * nx + ny * ny + nz * nz + nw * nw)
        q[i + 3], q[i + 4], q[i + 5], q[i + 6] = nx / norm, ny / norm, nz / norm, nw / norm


@compiled
def march(
    M: Array,
    bias_force: Array,
    J: Array,
    poses: Array,
    q: Array,
    command: Array,
    bodies: Bodies,
    ground: Ground,
    contacts: Contacts,
    pairs: Whole,
    law: Law,
    state: State,
) -> Iterator[int]:
    """A coroutine over shared arrays, so that a step costs one resumption and not the passing of fifty arrays.

    Before each step the caller refreshes M, ``bias_force``, J and ``poses`` at q, the configuration half-way. If boxes
    may touch boxes it yields how many ``pairs`` there are; the caller appends to the ``contacts`` and resumes. It
    yields -1 when the step is made and q stands half-way through the next.
    """
    while True:
        found, near = find_contacts(poses, bodies, ground, law.margin, contacts, pairs)
        if near > 0 or bodies.meeting:
            state.found[0] = found
            yield near
            found = state.found[0]
        solve_step(M, bias_force, J, q, command, bodies, contacts, found, law, state)
        _integrate(q, state.v, bodies, law.h)
        yield -1
