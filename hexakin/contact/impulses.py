"""Velocities and impulses of one time step in generalised coordinates, including servos with limited torque.

M v = r + J^T p + S^T s: mass matrix M, momentum r after all known forces, contact impulses p in cones and servo
impulses s in boxes. A servo holds its target velocity while its impulse is inside the box; otherwise its impulse is at
the limit. This is Coulomb friction relative to a moving target. Joints that hold are eliminated exactly, so that for a
standing robot only the body's six coordinates remain. An active-set iteration around the contact solver finds which
servos hold.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import ConeMemory, ConeProblem, solve_cone
from hexakin.contact.last_resorts import soften, solve_hard_cone, solve_softer_first
from hexakin.contact.lcp import solve_polyhedron
from hexakin.numerics.numba_cache import Whole, compiled

HOLDS, AT_LOW, AT_HIGH = 0, -1, 1


@compiled
def _cholesky(A: Array) -> bool:
    """Write the lower Cholesky factor to the lower half of ``A``; return false unless A is positive definite."""
    for j in range(A.shape[0]):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > 0.0:
            return False
        d = np.sqrt(d)
        A[j, j] = d
        for i in range(j + 1, A.shape[0]):
            value = A[i, j]
            for k in range(j):
                value -= A[i, k] * A[j, k]
            A[i, j] = value / d
    return True


@compiled
def _project(M: Array, r: Array, rows: Array, free: Whole, L: Array, Y: Array, y: Array, G: Array, g: Array) -> bool:
    """Compute L L^T = M, Y = L^-1 rows^T, y = L^-1 r, G = Y^T Y and g = Y^T y for the ``free`` coordinates.

    Return false if M is singular.
    """
    count, size = free.size, g.size
    for a in range(count):
        for b in range(a + 1):
            L[a, b] = M[free[b], free[a]]
    if not _cholesky(L[:count, :count]):
        return False
    G[:, :] = 0.0
    g[:] = 0.0
    for a in range(count):
        value = r[free[a]]
        for b in range(a):
            value -= L[a, b] * y[b]
        y[a] = value / L[a, a]
        for k in range(size):
            Y[a, k] = rows[k, free[a]]
        for b in range(a):
            f = L[a, b]
            if f != 0.0:
                for k in range(size):
                    Y[a, k] -= f * Y[b, k]
        f = 1.0 / L[a, a]
        for k in range(size):
            Y[a, k] *= f
        for i in range(size):
            f = Y[a, i]
            if f != 0.0:
                g[i] += f * y[a]
                for j in range(size):
                    G[i, j] += f * Y[a, j]
    return True


@compiled
def _velocities(free: Whole, L: Array, Y: Array, y: Array, p: Array, v: Array) -> None:
    """Write v = L^-T (y + Y p) to the ``free`` coordinates of ``v``."""
    count = free.size
    for a in range(count):
        for k in range(p.size):
            y[a] += Y[a, k] * p[k]
    for a in range(count - 1, -1, -1):
        value = y[a]
        for b in range(a + 1, count):
            value -= L[b, a] * y[b]
        y[a] = value / L[a, a]
        v[free[a]] = y[a]


@compiled
def _memory(rows: int) -> ConeMemory:
    """Return what ``hexakin.contact.cone.cone_memory`` does, in compiled code."""
    return ConeMemory(
        np.empty(rows), np.empty(rows), np.empty((rows, rows)), np.empty(rows), np.empty(rows), np.empty(rows),
        np.empty(rows), np.empty(rows),
    )  # fmt: skip


@compiled
def _solve_contacts(
    problem: ConeProblem,
    facets: int | None,
    thorough: bool | None,
    p: Array,
    u: Array,
    tolerance: float,
    max_sweeps: int,
) -> tuple[float, int]:
    """Solve with the polyhedron of ``facets``, or with the cone; if it fails, from other first guesses.

    With None for ``thorough``, these are only the solutions of softer contacts.
    """
    contacts, servos = problem.mu.size, problem.low.size
    # With None as the type of facets or of thorough, numba leaves the polyhedron's code out.
    if facets is not None:
        return solve_polyhedron(problem, contacts, servos, facets, p, u, tolerance, max_sweeps)
    memory = _memory(p.size)
    residual, sweeps = solve_cone(problem, contacts, servos, p, u, tolerance, max_sweeps, memory)
    if not residual <= tolerance:
        x, w = np.zeros(p.size), np.zeros(p.size)
        if thorough is None:
            second, used = solve_softer_first(problem, contacts, servos, x, w, tolerance, memory)
        else:
            second, used = solve_hard_cone(problem, contacts, servos, x, w, tolerance, memory)
        sweeps += used
        if second < residual:
            residual = second
            for i in range(p.size):
                p[i], u[i] = x[i], w[i]
    return residual, sweeps


@compiled
def solve_impulses(
    M: Array,
    r: Array,
    J: Array,
    mu: Array,
    bias: Array,
    p_min: Array,
    servo: Whole,
    target: Array,
    low: Array,
    high: Array,
    state: Whole,
    p: Array,
    s: Array,
    u: Array,
    v: Array,
    facets: int | None,
    compliance: float,
    tolerance: float,
    max_sweeps: int,
    thorough: bool | None = None,
) -> tuple[float, int]:
    """Solve in place for the impulses ``p`` (3 n,) and ``s`` (m,) and the velocities ``u`` (3 n,) and ``v`` (nv,).

    ``servo`` (m,) are the indices of the coordinates that have a servo, ``target`` their target velocities, and ``low``
    and ``high`` the limits of their impulses. ``state`` (m,) is HOLDS, AT_LOW or AT_HIGH for each servo; it is the
    first guess and receives the result. ``bias`` (n,) is added to the normal velocities, also in u. ``facets`` is the
    number of facets of the friction polyhedron, or None for the exact cone. ``compliance``, as a fraction of the mean
    of G's diagonal, is added to this diagonal; of the many ways in which redundant contacts can share a load it selects
    the most even one. ``thorough`` is True if more is to be tried where the cone is not solved, see
    ``hexakin.contact.last_resorts``, or else None. Returns the residual and the number of sweeps (or pivots) of the
    contact solver.
    """
    nv, m, size, contacts = r.size, servo.size, p.size, mu.size
    slot = np.full(nv, -1, dtype=np.int64)
    for j in range(m):
        slot[servo[j]] = j
    free, none = np.empty(nv, dtype=np.int64), np.empty(0)
    L, Y, y = np.empty((nv, nv)), np.empty((nv, size)), np.empty(nv)
    G, g, known = np.empty((size, size)), np.empty(size), np.empty(nv)
    sweeps = 0
    for _ in range(12):
        count = 0
        for i in range(nv):
            j = slot[i]
            known[i] = r[i]
            if j >= 0 and state[j] == HOLDS:
                v[i] = target[j]
            else:
                free[count] = i
                count += 1
                if j >= 0:
                    known[i] += high[j] if state[j] == AT_HIGH else low[j]
        for j in range(m):
            if state[j] == HOLDS:
                k = servo[j]
                for i in range(nv):
                    known[i] -= M[k, i] * v[k]
        if not _project(M, known, J, free[:count], L, Y, y, G, g):
            return np.inf, sweeps
        for c in range(contacts):
            g[3 * c + 2] += bias[c]
        soften(G, size, compliance)
        for j in range(m):
            if state[j] == HOLDS:
                for i in range(size):
                    g[i] += J[i, servo[j]] * target[j]
        problem = ConeProblem(G, g, mu, p_min, none, none)
        residual, used = _solve_contacts(problem, facets, thorough, p, u, tolerance, max_sweeps)
        sweeps += used
        _velocities(free[:count], L, Y, y, p, v)
        changed = False
        for j in range(m):
            i = servo[j]
            if state[j] == HOLDS:
                value = -r[i]
                for k in range(nv):
                    value += M[i, k] * v[k]
                for k in range(size):
                    value -= J[k, i] * p[k]
                s[j] = value
                slack = 1e-10 * (high[j] - low[j])
                if value > high[j] + slack or value < low[j] - slack:
                    state[j] = AT_HIGH if value > high[j] else AT_LOW
                    changed = True
            else:
                s[j] = high[j] if state[j] == AT_HIGH else low[j]
                if (v[i] - target[j]) * state[j] > 1e-12 * (1.0 + abs(target[j])):
                    state[j] = HOLDS
                    changed = True
        if not changed:
            return residual, sweeps
    # The iteration repeats itself (in about 1 of 500 hard random problems): solve for all unknowns together.
    rows, x, w = np.zeros((size + m, nv)), np.zeros(size + m), np.empty(size + m)
    for i in range(size):
        for k in range(nv):
            rows[i, k] = J[i, k]
    for j in range(m):
        rows[size + j, servo[j]] = 1.0
    for i in range(nv):
        free[i] = i
    Y, G, g = np.empty((nv, size + m)), np.empty((size + m, size + m)), np.empty(size + m)
    if not _project(M, r, rows, free, L, Y, y, G, g):
        return np.inf, sweeps
    for c in range(contacts):
        g[3 * c + 2] += bias[c]
    soften(G, size, compliance)
    for j in range(m):
        g[size + j] -= target[j]
    problem = ConeProblem(G, g, mu, p_min, low, high)
    residual, used = _solve_contacts(problem, facets, thorough, x, w, tolerance, max_sweeps)
    _velocities(free, L, Y, y, x, v)
    for i in range(size):
        p[i], u[i] = x[i], w[i]
    for j in range(m):
        s[j] = x[size + j]
        state[j] = AT_HIGH if s[j] >= high[j] else AT_LOW if s[j] <= low[j] else HOLDS
    return residual, sweeps + used


@compiled
def solve_impact(
    M: Array,
    r: Array,
    J: Array,
    mu: Array,
    bias: Array,
    strikes: Whole,
    approach: Array,
    restitution: float,
    poisson: bool,
    servo: Whole,
    target: Array,
    limit: Array,
    state: Whole,
    p: Array,
    compression: Array,
    s: Array,
    u: Array,
    v: Array,
    facets: int | None,
    compliance: float,
    tolerance: float,
    max_sweeps: int,
    thorough: bool | None = None,
) -> tuple[float, int]:
    """Solve as ``solve_impulses``, with restitution of the contacts that strike the ground.

    ``limit`` (m,) is the largest servo impulse in both directions. ``strikes`` (n,) is 1 for contacts that bounce,
    ``approach`` (n,) are the normal velocities before the impact, and xi is ``restitution``. Newton's law (``poisson``
    false) requires u_n >= -xi approach and is solved in one phase. Poisson's law has two: compression (A(4)), then
    expansion with additional normal impulses of at least xi times those of ``compression`` (3 n,) (A(5)-(6), A-E6
    corrected). ``p`` receives the sum of both phases, ``u`` the velocities after them.
    """
    n, m, nv = mu.size, servo.size, r.size
    p_min, low, high, bounces = np.zeros(n), np.empty(m), np.empty(m), False
    for j in range(m):
        low[j], high[j] = -limit[j], limit[j]
    for i in range(n):
        if strikes[i] and restitution > 0.0:
            bounces = True
            if not poisson:
                bias[i] = restitution * approach[i]
    residual, sweeps = solve_impulses(
        M,
        r,
        J,
        mu,
        bias,
        p_min,
        servo,
        target,
        -limit,
        limit,
        state,
        p,
        s,
        u,
        v,
        facets,
        compliance,
        tolerance,
        max_sweeps,
        thorough,
    )
    for i in range(3 * n):
        compression[i] = p[i]
    if bounces and poisson:
        extra, more, hold, kept = np.zeros(3 * n), np.zeros(m), np.empty(m, dtype=np.int64), np.empty(nv)
        for j in range(m):
            hold[j] = state[j]
        for i in range(n):
            if strikes[i]:
                p_min[i] = restitution * p[3 * i + 2]
        for i in range(nv):
            kept[i] = 0.0
            for k in range(nv):
                kept[i] += M[i, k] * v[k]
        for j in range(m):
            low[j], high[j] = -limit[j] - s[j], limit[j] - s[j]  # the sum of both phases stays within the limit
        second, used = solve_impulses(
            M, kept, J, mu, bias, p_min, servo, target, low, high, hold, extra, more, u, v,
            facets, compliance, tolerance, max_sweeps, thorough,
        )  # fmt: skip
        residual, sweeps = max(residual, second), sweeps + used
        for i in range(3 * n):
            p[i] += extra[i]
        for j in range(m):
            s[j] += more[j]
    return residual, sweeps
