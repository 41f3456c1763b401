"""Moreau time stepping of rigid bodies with friction and impacts, compiled (A section 3.1).

A step of duration h changes the velocity from v to v'. The mass matrix, the forces and the contacts are those at the
configuration in the middle of the step, q + h v / 2:

    M (v' - v) = -h (C + g) + S^T s + J^T p.

The servo impulses s and the contact impulses p are computed together (``hexakin.contact.impulses``). Bodies at a closed
contact do not approach each other; at an open one they approach at most by the gap. If contacts close faster than a
threshold, an impact is computed first. With Poisson's law (A(4)-(6)), the expansion phase returns at least the share xi
of each compression impulse; with Newton's law, the impact returns the share xi of each approach velocity. M. Jean and
J. J. Moreau, "Unilaterality and dry friction in the dynamics of rigid body collections", 1992; M. Anitescu and F. A.
Potra, "Formulating dynamic multi-rigid-body contact problems with friction as solvable linear complementarity
problems", 1997; Ch. Glocker, "Set-Valued Force Laws", 2001.
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
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, compiled

CAPACITY = 256  # largest number of contacts; with time steps of 50 ms all corners of ATHENA's boxes are candidates
_SLOP = 1e-3  # [m] penetration that is not corrected
_PUSH_TIME = 0.05  # [s] time constant with which deeper penetration is corrected ...
_PUSH_SPEED = 0.1  # [m/s] ... and the largest speed of this correction


class Law(NamedTuple):
    """Constants of a run.

    Parameters
    ----------
    h
        Time step [s].
    friction, restitution
        Coefficients of all contacts.
    poisson
        Whether restitution follows Poisson's law; otherwise Newton's.
    threshold
        Speed [m/s] above which contacts bounce.
    servo_rate, servo_torque
        Rate [1/s] and torque limit [N m] of the servos.
    compliance
        Compliance of the contacts, relative to the mean of the diagonal of the Delassus matrix.
    tolerance, max_sweeps
        Relative residual at which the contact solver stops, and its largest number of sweeps.
    reach
        Gap [m] up to which slow contacts take part in a step.
    search_distance
        Gap [m] up to which contacts are searched.
    """

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
    search_distance: float


class Drive(NamedTuple):
    """How m joints are driven; changed in place between two calls of ``MoreauStepper.advance``.

    ``command`` (m,) [rad] are the wanted angles. If ``by_torque`` (1,) bool is False, the servos follow the command.
    Otherwise the joints apply the torques torque + kp (command - angle) - kd rate, limited to the servos' torque, with
    ``kp`` (m,) [N m/rad], ``kd`` (m,) [N m s/rad] and ``torque`` (m,) [N m].
    """

    command: Array
    by_torque: NDArray[np.bool_]
    kp: Array
    kd: Array
    torque: Array

    def __repr__(self) -> str:
        return short_repr(self)


class State(NamedTuple):
    """State that is kept from step to step, and results; all arrays are changed in place.

    Parameters
    ----------
    v
        Velocity (nv,) [m/s, rad/s].
    s
        Impulses (m,) [N m s] of the servos in the last step.
    hold
        Whether each servo holds its target velocity or is at a limit, (m,): HOLDS, AT_LOW or AT_HIGH.
    old_key, old_impulse, old_count
        Keys (c,) and impulses (c, 3) [N s] in the world of the contacts in the last step, and their number (1,).
    found
        Number (1,) of contacts that the search has found.
    impulse, last_impulse
        Normal impulse (g,) [N s] of each group: the sum over the steps, and that of the last step.
    sums
        Work of the servos and of the contacts [J], largest penetration [m] and largest residual of the steps, (4,).
    rate_moment
        Sum (3, 3) [rad^2/s^2] of w w^T over the steps, with w the angular velocity of the first free body in its frame.
    """

    v: Array
    s: Array
    hold: Whole
    old_key: Whole
    old_impulse: Array
    old_count: Whole
    found: Whole
    impulse: Array
    last_impulse: Array
    sums: Array
    rate_moment: Array

    def __repr__(self) -> str:
        return short_repr(self)


@compiled
def _point_jacobian(moves: NDArray[np.bool_], J: Array, body: int, x: Array, d: Array, sign: float, row: Array) -> None:
    """Add ``sign`` times the derivative by v of the velocity, along ``d``, of point ``x`` of a body to ``row`` (nv,).

    ``J`` (6, nv) is the Jacobian of all joints about the world's origin.
    """
    # d . (v + w x x) = d . v + (x x d) . w
    mx, my, mz = x[1] * d[2] - x[2] * d[1], x[2] * d[0] - x[0] * d[2], x[0] * d[1] - x[1] * d[0]
    for k in range(row.size):
        if moves[body, k]:
            row[k] += sign * (
                d[0] * J[0, k] + d[1] * J[1, k] + d[2] * J[2, k] + mx * J[3, k] + my * J[4, k] + mz * J[5, k]
            )


@compiled
def _tangent(n: Array, t: Array) -> None:
    """Write the first tangent to ``t``: the normalised projection of the world's x axis (y if ``n`` is near x)."""
    axis = 0 if abs(n[0]) < 0.9 else 1
    for a in range(3):
        t[a] = -n[axis] * n[a]
    t[axis] += 1.0
    norm = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for a in range(3):
        t[a] /= norm


@compiled
def _contact_rows(bodies: Bodies, J_world: Array, contacts: Contacts, c: int, frame: Array, rows: Array) -> None:
    """Write the axes (t1, t2, n) of contact ``c`` to ``frame``, the Jacobian of its velocity along them to ``rows``."""
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
    """Write M (v + h turning) - h bias_force to ``r``: the momentum after a time h under the known forces."""
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
    """Compute the velocities ``after`` and the contact impulses ``p`` with a torque law; return the solver's residual.

    The torques are those at the angles and rates at the end of the step. They therefore add h (kd + h kp / 2) to the
    diagonal of the mass matrix (``q`` is the configuration in the middle of the step). Joints whose torque would exceed
    the limit apply the limit instead; which joints these are is found by iteration.
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
    """Make one step of the velocities, in place.

    ``M_upper`` (nv, nv), ``bias_force`` (nv,), ``J_world`` (6, nv), ``q`` (nq,) and the first ``found`` of ``contacts``
    are those in the middle of the step: the upper half of the mass matrix, Coriolis and gravity forces, the Jacobian of
    all joints about the world's origin and the configuration. ``drive``, ``bodies``, ``law``, ``facets`` and ``state``
    are those of ``march``.
    """
    nv, h, v = state.v.size, law.h, state.v
    m = bodies.servo.size
    M = np.empty((nv, nv))
    for j in range(nv):
        for i in range(j + 1):
            M[i, j] = M[j, i] = M_upper[i, j]
    # Contacts that take part in the step: first those that are closed or strike before its end, then slow ones that may
    # close in it. A fast body that strikes later is left in flight, so that it hits with its own speed.
    active, approach = np.empty(found, dtype=np.int64), np.empty(found)
    strikes = np.zeros(found, dtype=np.int64)
    rows, frames = np.empty((3 * found + 3, nv)), np.empty((found + 1, 3, 3))  # with space for one more candidate
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
    # ``turning`` is the part of the linear accelerations that results from the rotation of the bodies' frames. It is
    # contained in Pinocchio's C, but ``drift`` takes account of it already.
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
        # An impact takes no time, so that servos have no effect on it. On average it occurs in the middle of the step.
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
    # The work is computed with the trapezoidal rule, which is exact for a constant mass matrix.
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
    """Rotate ``d`` (3,) in place by a unit quaternion, or with ``back`` by its inverse.

    The result is d + 2 r x (r x d + w d), with r = (x, y, z).
    """
    if back:
        x, y, z = -x, -y, -z
    ex, ey, ez = y * d[2] - z * d[1] + w * d[0], z * d[0] - x * d[2] + w * d[1], x * d[1] - y * d[0] + w * d[2]
    d[0] += 2.0 * (y * ez - z * ey)
    d[1] += 2.0 * (z * ex - x * ez)
    d[2] += 2.0 * (x * ey - y * ex)


@compiled
def drift(q: Array, v: Array, bodies: Bodies, h: float) -> None:
    """Change the configuration ``q`` (nq,) in place by the motion with constant velocity in a time ``h`` [s].

    A free body of ``bodies`` moves along a straight line in the world and rotates at its angular velocity. Pinocchio
    expresses its linear velocity in the frame of the body, so that this part of ``v`` (nv,) is rotated in place too.
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
    """Make time steps, as a coroutine: shared arrays need not be passed again at each step, which saves time.

    Before each step the caller updates ``M`` (nv, nv), ``bias_force`` (nv,), ``J`` (6, nv) and ``poses`` (joints, 12)
    for ``q`` (nq,), the configuration in the middle of the step. If boxes may touch boxes, the coroutine yields the
    number of ``pairs``; the caller appends their contacts to ``contacts`` and resumes. When the step is complete and
    ``q`` is the configuration in the middle of the next step, the coroutine yields -1.

    ``drive``, ``bodies``, ``ground``, ``law`` and ``state`` are described in their classes. ``facets`` is the number of
    facets of the friction polyhedron, or None for the exact cone.
    """
    while True:
        found, near = find_contacts(poses, bodies, ground, law.search_distance, contacts, pairs)
        state.found[0] = found
        if near > 0 or bodies.meeting:
            yield near
            found = state.found[0]
        solve_step(M, bias_force, J, q, drive, bodies, contacts, found, law, facets, state)
        drift(q, state.v, bodies, law.h)
        yield -1
