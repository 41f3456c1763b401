"""One time step's velocities and impulses in generalised coordinates, with torque-limited servos inside the step.

M v = r + J^T p + S^T s: mass matrix M, momentum r that all known forces would leave, contact impulses p in
cones and servo impulses s in boxes. A servo holds its target velocity as long as its impulse stays within the
box, and gives the limit otherwise; it is a Coulomb friction about a moving target. Holding joints are eliminated
exactly, so that for a standing robot only the body's six coordinates remain. Which servos hold is found by an
active-set iteration around the contact solver.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import solve_cone
from hexakin.contact.lcp import solve_polyhedron
from hexakin.numerics.numba_cache import Whole, compiled

HOLDS, AT_LOW, AT_HIGH = 0, -1, 1


@compiled
def _cholesky(A: Array) -> bool:
    """Lower factor in place; false unless positive definite."""
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
    """Put L L^T = M, Y = L^-1 rows^T, y = L^-1 r, G = Y^T Y, g = Y^T y over the free coordinates; false if singular."""
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
    """Put v = L^-T (y + Y p) into the free coordinates."""
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
def _soften(G: Array, size: int, compliance: float) -> None:
    mean = 0.0
    for i in range(size):
        mean += G[i, i] / size
    for i in range(size):
        G[i, i] += compliance * mean


@compiled
def _solve_contacts(
    G: Array,
    g: Array,
    mu: Array,
    p_min: Array,
    low: Array,
    high: Array,
    facets: int | None,
    p: Array,
    u: Array,
    tolerance: float,
    max_sweeps: int,
) -> tuple[float, int]:
    """Cone or polyhedron; a cone that resists is approached through softer ones, which are easier to solve."""
    # With None as the type of facets, numba leaves the polyhedron's code out.
    if facets is not None:
        return solve_polyhedron(G, g, mu, p_min, low, high, facets, p, u, tolerance, max_sweeps)
    residual, sweeps = solve_cone(G, g, mu, p_min, low, high, p, u, tolerance, max_sweeps)
    if not residual <= tolerance:
        x, w, soft = np.zeros(p.size), np.zeros(p.size), np.empty((p.size, p.size))
        for stage in range(9):
            for i in range(p.size):
                for j in range(p.size):
                    soft[i, j] = G[i, j]
            if stage < 8:
                _soften(soft, p.size, 10.0 ** (-stage))
            second, used = solve_cone(soft, g, mu, p_min, low, high, x, w, tolerance, max_sweeps)
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
) -> tuple[float, int]:
    """Solve in place for p (3 n,), s (m,), contact velocities u (3 n,) and v (nv,).

    ``servo`` (m,) are the coordinates that have a servo, ``target`` their velocities, ``low`` and ``high`` their
    impulses' limits, ``state`` (m,) which of them hold: first guess and result. ``bias`` (n,) is added to the
    normal velocities, and to u. ``facets`` is the number of the friction polyhedron's, or None for the exact cone.
    ``compliance``, a share of the mean of G's diagonal, is added to that diagonal: among the many ways to share a load
    between redundant contacts it selects the most even one. Returns the residual and the sweeps (or pivots) of the
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
        _soften(G, size, compliance)
        for j in range(m):
            if state[j] == HOLDS:
                for i in range(size):
                    g[i] += J[i, servo[j]] * target[j]
        residual, used = _solve_contacts(G, g, mu, p_min, none, none, facets, p, u, tolerance, max_sweeps)
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
    # Going round in circles (about 1 in 500 hard random problems): all unknowns at once.
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
    _soften(G, size, compliance)
    for j in range(m):
        g[size + j] -= target[j]
    residual, used = _solve_contacts(G, g, mu, p_min, low, high, facets, x, w, tolerance, max_sweeps)
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
) -> tuple[float, int]:
    """``solve_impulses`` with restitution of the contacts that strike; ``limit`` (m,) bounds the servos' impulses.

    ``strikes`` (n,) is 1 where a contact bounces, ``approach`` (n,) are the normal velocities before. Newton's law
    asks for u_n >= -xi approach at once. Poisson's first compresses (A(4)), then expands with impulses of its own, at
    least xi of each ``compression`` (3 n,) impulse (A(5)-(6), A-E6 corrected); p receives the sum of both, u the
    velocities after.
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
            low[j], high[j] = -limit[j] - s[j], limit[j] - s[j]  # its two impulses together keep to the limit
        second, used = solve_impulses(
            M, kept, J, mu, bias, p_min, servo, target, low, high, hold, extra, more, u, v,
            facets, compliance, tolerance, max_sweeps,
        )  # fmt: skip
        residual, sweeps = max(residual, second), sweeps + used
        for i in range(3 * n):
            p[i] += extra[i]
        for j in range(m):
            s[j] += more[j]
    return residual, sweeps
