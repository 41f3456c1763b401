"""Moreau time stepping of rigid bodies with friction and impacts, compiled (A section 3.1).

A step of length h goes from velocity v to v' at the configuration half-way, q + h v / 2, where contacts are sought:

    M (v' - v) = -h (C + g) + S^T s + J^T p,

servo impulses s and contact impulses p found together (``hexakin.contact.impulses``). A contact that is closed
may not approach; one about to close may at most close its gap. If contacts strike faster than a threshold, an impact
comes first: by Poisson's law (A(4)-(6)), whose expansion phase returns at least the share xi of each compression
impulse, or by Newton's, which returns the share xi of each approach velocity. Jean and Moreau, "Unilaterality and
dry friction in the dynamics of rigid body collections" (1992); Anitescu and Potra (1997); Glocker, "Set-Valued Force
Laws" (2001).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.contact.impulses import AT_HIGH, AT_LOW, HOLDS, solve_impact, solve_impulses
from hexakin.engines.ground_contacts import Bodies, Contacts, find_contacts
from hexakin.engines.ground_grid import Ground
from hexakin.numerics.numba_cache import Whole, compiled

CAPACITY = 256  # contacts at a time; at steps of 50 ms every corner of ATHENA's boxes is a candidate
_SLOP = 1e-3  # [m] penetration that is left alone
_PUSH_TIME = 0.05  # [s] in which deeper penetration is taken back ...
_PUSH_SPEED = 0.1  # ... [m/s] but not faster than this


class Law(NamedTuple):
    """Constants of a run."""

    h: float
    friction: float
    restitution: float
    poisson: bool
    threshold: float
    servo_rate: float
    servo_torque: float
    compliance: float
    tolerance: float
    max_sweeps: int
    reach: float
    margin: float


class Drive(NamedTuple):
    """How m joints are driven in a run of steps, changed in place between the runs.

    ``command`` (m,) [rad] are the wanted angles. If ``by_torque`` (1,), joints give the torques
    ``torque + kp (command - angle) - kd rate`` (m,), up to the servos' limit; else their servos follow the command.
    """

    command: Array
    by_torque: NDArray[np.bool_]
    kp: Array
    kd: Array
    torque: Array


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
    last_impulse: Array  # (g,) the same of the last step alone
    sums: Array  # servo work, contact work, penetration, residual
    rate_moment: Array  # (3, 3) sum of w w^T, w the first free body's angular velocity in its own frame


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
def _contact_rows(bodies: Bodies, J_world: Array, contacts: Contacts, c: int, frame: Array, rows: Array) -> None:
    """A contact's axes (t1, t2, n), into ``frame``, and the derivative of its velocity along them, into ``rows``."""
    normal = contacts.normal[c]
    _tangent(normal, frame[0])
    for a in range(3):
        frame[2, a] = normal[a]
    frame[1, 0] = normal[1] * frame[0, 2] - normal[2] * frame[0, 1]
    frame[1, 1] = normal[2] * frame[0, 0] - normal[0] * frame[0, 2]
    frame[1, 2] = normal[0] * frame[0, 1] - normal[1] * frame[0, 0]
    rows[:, :] = 0.0
    for a in range(3):
        _point_jacobian(bodies.moves, J_world, contacts.bodies[c, 0], contacts.point[c], frame[a], 1.0, rows[a])
        if contacts.bodies[c, 1] >= 0:
            _point_jacobian(bodies.moves, J_world, contacts.bodies[c, 1], contacts.point[c], frame[a], -1.0, rows[a])


@compiled
def _momentum(M: Array, v: Array, turning: Array, bias_force: Array, h: float, r: Array) -> None:
    """Put M (v + h turning) - h bias_force into r: the momentum that known forces leave after a time h."""
    for i in range(v.size):
        r[i] = -h * bias_force[i]
        for k in range(v.size):
            r[i] += M[i, k] * (v[k] + h * turning[k])


@compiled
def _solve_torques(
    M: Array,
    r: Array,
    J: Array,
    mu: Array,
    bias: Array,
    q: Array,
    drive: Drive,
    bodies: Bodies,
    law: Law,
    facets: int | None,
    state: State,
    p: Array,
    u: Array,
    after: Array,
) -> float:
    """Velocities ``after`` and contact impulses p with joints that give torques; the solver's residual.

    The torques are those of the angles and rates at the end of the step, which makes them a part of the mass matrix:
    M + h (kd + h kp / 2) on the diagonal (q is the configuration half-way). Which joints give their limit instead is
    found by trying: those whose torque would be beyond it.
    """
    m, h, limit = bodies.servo.size, law.h, law.h * law.servo_torque
    nobody, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
    wanted, soft = np.empty(m), np.empty(m)
    for j in range(m):
        wanted[j] = h * (drive.torque[j] + drive.kp[j] * (drive.command[j] - q[bodies.servo_q[j]]))
        soft[j] = h * (drive.kd[j] + 0.5 * h * drive.kp[j])
        state.hold[j] = HOLDS
    residual = np.inf
    for _ in range(12):
        for j in range(m):
            i = bodies.servo[j]
            if state.hold[j] == HOLDS:
                M[i, i] += soft[j]
                r[i] += wanted[j]
            else:
                r[i] += limit * state.hold[j]
        residual, _ = solve_impulses(
            M, r, J, mu, bias, np.zeros(mu.size), nobody, nothing, nothing, nothing, nobody, p, nothing, u, after,
            facets, law.compliance, law.tolerance, law.max_sweeps,
        )  # fmt: skip
        changed = False
        for j in range(m):
            i = bodies.servo[j]
            free = wanted[j] - soft[j] * after[i]
            if state.hold[j] == HOLDS:
                M[i, i] -= soft[j]
                r[i] -= wanted[j]
                state.s[j] = min(max(free, -limit), limit)
                if abs(free) > limit * (1.0 + 1e-10):
                    state.hold[j] = AT_HIGH if free > 0.0 else AT_LOW
                    changed = True
            else:
                r[i] -= limit * state.hold[j]
                state.s[j] = limit * state.hold[j]
                if free * state.hold[j] < limit:
                    state.hold[j] = HOLDS
                    changed = True
        if not changed:
            break
    return residual


@compiled
def solve_step(
    M_upper: Array,
    bias_force: Array,
    J_world: Array,
    q: Array,
    drive: Drive,
    bodies: Bodies,
    contacts: Contacts,
    found: int,
    law: Law,
    facets: int | None,
    state: State,
) -> None:
    """One step of the velocities, in place; configuration, mass matrix and contacts are those half-way."""
    nv, h, v = state.v.size, law.h, state.v
    m = bodies.servo.size
    M = np.empty((nv, nv))
    for j in range(nv):
        for i in range(j + 1):
            M[i, j] = M[j, i] = M_upper[i, j]
    # Which contacts take part: first those that are closed or strike until the end of the step, then slow ones that
    # may close within it. A fast body whose gap is open for longer flies on: it shall strike with its own speed.
    active, approach = np.empty(found, dtype=np.int64), np.empty(found)
    strikes = np.zeros(found, dtype=np.int64)
    rows, frames = np.empty((3 * found + 3, nv)), np.empty((found + 1, 3, 3))  # one to try
    n, closed = 0, 0
    for turn in range(2):
        for c in range(found):
            gap = contacts.gap[c]
            if turn == 1 and not 0.0 < gap <= law.reach:
                continue
            _contact_rows(bodies, J_world, contacts, c, frames[n], rows[3 * n : 3 * n + 3])
            speed = 0.0
            for k in range(nv):
                speed += rows[3 * n + 2, k] * v[k]
            fast = speed < -law.threshold
            if (gap <= 0.0 or (fast and gap + 0.5 * h * speed <= 0.0)) if turn == 0 else not fast:
                active[n], approach[n] = c, speed
                strikes[n] = fast
                n += 1
        if turn == 0:
            closed = n
    J = rows[: 3 * n]
    mu, bias, p = np.empty(n), np.zeros(n), np.zeros(3 * n)
    for i in range(n):
        mu[i] = law.friction
        c = active[i]
        gap = contacts.gap[c]
        if gap > 0.0:
            bias[i] = gap / h
        elif gap < -_SLOP:
            bias[i] = -min((-gap - _SLOP) / _PUSH_TIME, _PUSH_SPEED)
        for old in range(state.old_count[0]):
            if contacts.key[c] >= 0 and state.old_key[old] == contacts.key[c]:
                for a in range(3):
                    for k in range(3):
                        p[3 * i + a] += frames[i, a, k] * state.old_impulse[old, k]
    # The velocity as it would be without any force, in the axes that the bodies have half-way: Pinocchio's C holds the
    # turning of these axes too, which drift accounts for.
    turning = np.zeros(nv)
    for k in range(bodies.floating.shape[0]):
        j = bodies.floating[k, 1]
        turning[j] = v[j + 4] * v[j + 2] - v[j + 5] * v[j + 1]
        turning[j + 1] = v[j + 5] * v[j] - v[j + 3] * v[j + 2]
        turning[j + 2] = v[j + 3] * v[j + 1] - v[j + 4] * v[j]
    r, start, after, u = np.empty(nv), np.empty(nv), np.empty(nv), np.empty(3 * n)
    for i in range(nv):
        start[i] = v[i]
    struck = False
    for i in range(closed):
        struck = struck or strikes[i] > 0
    residual, blow, rest = 0.0, np.zeros(3 * n), h
    if struck:
        # An impact takes no time, so that servos have no part in it; on average it comes when half the step is over.
        rest = 0.5 * h
        _momentum(M, v, turning, bias_force, h - rest, r)
        nobody, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
        residual, _ = solve_impact(
            M, r, J[: 3 * closed], mu[:closed], np.zeros(closed), strikes, approach, law.restitution, law.poisson,
            nobody, nothing, nothing, nobody, blow[: 3 * closed], np.empty(3 * closed), nothing, u[: 3 * closed], start,
            facets, law.compliance, law.tolerance, law.max_sweeps,
        )  # fmt: skip
    _momentum(M, start, turning, bias_force, rest, r)
    if drive.by_torque[0]:
        last = _solve_torques(M, r, J, mu, bias, q, drive, bodies, law, facets, state, p, u, after)
    else:
        target, low, high = np.empty(m), np.empty(m), np.empty(m)
        for j in range(m):
            low[j], high[j] = -h * law.servo_torque, h * law.servo_torque
            lag = drive.command[j] - q[bodies.servo_q[j]]
            target[j] = law.servo_rate * lag / (1.0 + 0.5 * h * law.servo_rate)
        last, _ = solve_impulses(
            M, r, J, mu, bias, np.zeros(n), bodies.servo, target, low, high, state.hold, p, state.s, u, after,
            facets, law.compliance, law.tolerance, law.max_sweeps,
        )  # fmt: skip
    residual = max(residual, last)
    # Work by the trapezoidal rule, which is exact for a constant mass matrix.
    for j in range(m):
        i = bodies.servo[j]
        state.sums[0] += 0.5 * state.s[j] * (start[i] + after[i])
    for i in range(3 * n):
        for k in range(nv):
            state.sums[1] += 0.5 * J[i, k] * (p[i] * (start[k] + after[k]) + blow[i] * (v[k] + start[k]))
    state.sums[3] = max(state.sums[3], residual)
    state.old_count[0] = n
    for g in range(state.last_impulse.size):
        state.last_impulse[g] = 0.0
    for i in range(n):
        c = active[i]
        state.sums[2] = max(state.sums[2], -contacts.gap[c])
        state.impulse[contacts.group[c]] += p[3 * i + 2] + blow[3 * i + 2]
        state.last_impulse[contacts.group[c]] += p[3 * i + 2] + blow[3 * i + 2]
        state.old_key[i] = contacts.key[c]
        for k in range(3):
            state.old_impulse[i, k] = 0.0
            for a in range(3):
                state.old_impulse[i, k] += frames[i, a, k] * p[3 * i + a]
    for i in range(nv):
        v[i] = after[i]
    if bodies.floating.shape[0] > 0:
        first = bodies.floating[0, 1] + 3
        for i in range(3):
            for k in range(3):
                state.rate_moment[i, k] += v[first + i] * v[first + k]


@compiled
def _turn(x: float, y: float, z: float, w: float, d: Array, back: bool) -> None:
    """Turn d (3,) by a unit quaternion, or back, in place: d + 2 r x (r x d + w d), r the quaternion's vector."""
    if back:
        x, y, z = -x, -y, -z
    ex, ey, ez = y * d[2] - z * d[1] + w * d[0], z * d[0] - x * d[2] + w * d[1], x * d[1] - y * d[0] + w * d[2]
    d[0] += 2.0 * (y * ez - z * ey)
    d[1] += 2.0 * (z * ex - x * ez)
    d[2] += 2.0 * (x * ey - y * ex)


@compiled
def drift(q: Array, v: Array, bodies: Bodies, h: float) -> None:
    """Move the configuration by h seconds of constant velocity, in place.

    A free body goes straight in the world and turns at its rate; its linear velocity, which Pinocchio has in the
    body's frame, is turned along.
    """
    for k in range(bodies.hinges.shape[0]):
        q[bodies.hinges[k, 0]] += h * v[bodies.hinges[k, 1]]
    for k in range(bodies.floating.shape[0]):
        i, j = bodies.floating[k]
        linear = v[j : j + 3]
        x, y, z, w = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        _turn(x, y, z, w, linear, False)
        for a in range(3):
            q[i + a] += h * linear[a]
        wx, wy, wz = h * v[j + 3], h * v[j + 4], h * v[j + 5]
        angle = np.sqrt(wx * wx + wy * wy + wz * wz)
        sine = np.sin(0.5 * angle) / angle if angle > 1e-6 else 0.5 - angle * angle / 48.0
        cosine = np.cos(0.5 * angle)
        sx, sy, sz = sine * wx, sine * wy, sine * wz
        nx = w * sx + x * cosine + y * sz - z * sy
        ny = w * sy - x * sz + y * cosine + z * sx
        nz = w * sz + x * sy - y * sx + z * cosine
        nw = w * cosine - x * sx - y * sy - z * sz
        norm = np.sqrt(nx * nx + ny * ny + nz * nz + nw * nw)
        q[i + 3], q[i + 4], q[i + 5], q[i + 6] = nx / norm, ny / norm, nz / norm, nw / norm
        _turn(nx / norm, ny / norm, nz / norm, nw / norm, linear, True)


@compiled
def march(
    M: Array,
    bias_force: Array,
    J: Array,
    poses: Array,
    q: Array,
    drive: Drive,
    bodies: Bodies,
    ground: Ground,
    contacts: Contacts,
    pairs: Whole,
    law: Law,
    facets: int | None,
    state: State,
) -> Iterator[int]:
    """A coroutine over shared arrays, so that a step costs one resumption and not the passing of fifty arrays.

    Before each step the caller refreshes M, ``bias_force``, J and ``poses`` at q, the configuration half-way. If boxes
    may touch boxes it yields how many ``pairs`` there are; the caller appends to the ``contacts`` and resumes. It
    yields -1 when the step is made and q stands half-way through the next.
    """
    while True:
        found, near = find_contacts(poses, bodies, ground, law.margin, contacts, pairs)
        state.found[0] = found
        if near > 0 or bodies.meeting:
            yield near
            found = state.found[0]
        solve_step(M, bias_force, J, q, drive, bodies, contacts, found, law, facets, state)
        drift(q, state.v, bodies, law.h)
        yield -1
