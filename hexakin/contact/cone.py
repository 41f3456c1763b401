"""Coulomb's law with the exact cone, compiled: block Gauss-Seidel followed by semismooth Newton steps.

The unknowns are the impulses p: three for each of n contacts in the order (t1, t2, n), then one for each of m servos.
The velocities are u = G p + g. For each contact: p_n >= p_min, u_n >= 0, (p_n - p_min) u_n = 0, and the tangential
impulse is the point of the disc |p_t| <= mu p_n that dissipates most power (maximum dissipation). A bias of the normal
velocity (restitution, gap) is part of g. For each servo: low <= p <= high, and u = 0 between the limits.

A Gauss-Seidel sweep solves the contacts one after the other, each exactly; it converges slowly if contacts are
redundant. Newton's method on the natural map is fast, but converges only near a solution. Therefore sweeps come first
and Newton steps finish. The residual alone decides whether the result is a solution.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.numerics.numba_cache import Interrupted, compiled, signals_raise


@compiled
def _disc(a: float, b: float, c: float, gx: float, gy: float, radius: float) -> tuple[float, float]:
    """Minimise p'Wp/2 + g'p over |p| <= ``radius``, for positive definite W = [[a, b], [b, c]] and g = (gx, gy)."""
    det = a * c - b * b
    x, y = -(c * gx - b * gy) / det, -(a * gy - b * gx) / det
    if x * x + y * y <= radius * radius:
        return x, y
    if radius <= 0.0:
        return 0.0, 0.0
    # On the boundary: (W + s I) p = -g with |p| = radius; Newton's method for 1/|p| converges monotonically in s.
    shift, norm = 0.0, np.sqrt(x * x + y * y)
    for _ in range(50):
        dx, dy = (c + shift) * x - b * y, (a + shift) * y - b * x
        slope = (x * dx + y * dy) / det
        shift += (norm - radius) / radius * norm * norm / slope
        det = (a + shift) * (c + shift) - b * b
        x, y = -((c + shift) * gx - b * gy) / det, -((a + shift) * gy - b * gx) / det
        norm = np.sqrt(x * x + y * y)
        if abs(norm - radius) <= 1e-15 * radius:
            break
    return x * radius / norm, y * radius / norm


@compiled
def write_velocity(G: Array, g: Array, p: Array, u: Array) -> None:
    """Write the velocities G p + g to ``u`` (k,), for ``G`` (k, k), ``g`` (k,) and the impulses ``p`` (k,)."""
    for i in range(g.size):
        total = g[i]
        for j in range(g.size):
            total += G[i, j] * p[j]
        u[i] = total


@compiled
def impulse_scales(G: Array, g: Array, contacts: int, step_length: Array) -> float:
    """Write the effective mass of each row to ``step_length`` (3 n + m,), one value for the rows of a contact.

    Return the smallest scale of impulses, a thousandth of the impulse that stops the fastest row. It is used as the
    scale if all impulses of the solution are small. ``contacts`` is n.
    """
    scale = 0.0
    for c in range(contacts):
        k = 3 * c
        rho = 3.0 / (G[k, k] + G[k + 1, k + 1] + G[k + 2, k + 2])
        for i in range(k, k + 3):
            step_length[i] = rho
            scale = max(scale, 1e-3 * rho * abs(g[i]))
    for k in range(3 * contacts, g.size):
        step_length[k] = 1.0 / G[k, k]
        scale = max(scale, 1e-3 * abs(g[k]) / G[k, k])
    return scale


@compiled
def natural_residual(p: Array, u: Array, mu: Array, p_min: Array, low: Array, high: Array, step_length: Array) -> float:
    """Return the largest distance by which an impulse moves in a step -``step_length`` u followed by a projection.

    The projection is onto the set of allowed impulses. The residual is zero at solutions and nowhere else, and it is of
    first order in the error everywhere, unlike the products p u.
    """
    worst = 0.0
    for c in range(mu.size):
        k = 3 * c
        rho = step_length[k]
        error = abs(p[k + 2] - max(p_min[c], p[k + 2] - rho * u[k + 2]))
        x, y, radius = p[k] - rho * u[k], p[k + 1] - rho * u[k + 1], mu[c] * max(p[k + 2], 0.0)
        norm = np.sqrt(x * x + y * y)
        if norm > radius:
            x, y = x * radius / norm, y * radius / norm
        slip = np.sqrt((x - p[k]) ** 2 + (y - p[k + 1]) ** 2)
        # A NaN must not count as a small residual.
        if not (error <= worst and slip <= worst):
            worst = max(error, slip) if error == error and slip == slip else np.inf
    for j in range(low.size):
        k = 3 * mu.size + j
        error = abs(p[k] - min(max(p[k] - step_length[k] * u[k], low[j]), high[j]))
        if not error <= worst:
            worst = error if error == error else np.inf
    return worst


@compiled
def _sweep(G: Array, mu: Array, p_min: Array, low: Array, high: Array, p: Array, u: Array) -> None:
    """Solve each contact and each servo once, one after the other, and update ``p`` and ``u`` in place."""
    size = u.size
    for c in range(mu.size):
        k = 3 * c
        normal = max(p_min[c], p[k + 2] - u[k + 2] / G[k + 2, k + 2])
        dn = normal - p[k + 2]
        a, b, d = G[k, k], G[k, k + 1], G[k + 1, k + 1]
        gx = u[k] + G[k, k + 2] * dn - a * p[k] - b * p[k + 1]
        gy = u[k + 1] + G[k + 1, k + 2] * dn - b * p[k] - d * p[k + 1]
        x, y = _disc(a, b, d, gx, gy, mu[c] * normal)
        dx, dy = x - p[k], y - p[k + 1]
        p[k], p[k + 1], p[k + 2] = x, y, normal
        for i in range(size):
            u[i] += G[k, i] * dx + G[k + 1, i] * dy + G[k + 2, i] * dn
    for j in range(low.size):
        k = 3 * mu.size + j
        value = min(max(p[k] - u[k] / G[k, k], low[j]), high[j])
        change = value - p[k]
        p[k] = value
        for i in range(size):
            u[i] += G[k, i] * change


@compiled
def eliminate(A: Array, b: Array) -> bool:
    """Solve A x = b by Gaussian elimination with partial pivoting; return false if A is singular.

    ``A`` (k, k) is overwritten, and ``b`` (k,) receives x.
    """
    size = b.size
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if not abs(A[pivot, k]) > 1e-14:
            return False
        if pivot != k:
            for j in range(k, size):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            b[k], b[pivot] = b[pivot], b[k]
        for i in range(k + 1, size):
            factor = A[i, k] / A[k, k]
            if factor != 0.0:
                for j in range(k + 1, size):
                    A[i, j] -= factor * A[k, j]
                b[i] -= factor * b[k]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            b[k] -= A[k, j] * b[j]
        b[k] /= A[k, k]
    return True


@compiled
def _project_back(mu: Array, p_min: Array, low: Array, high: Array, p: Array) -> None:
    """Project the impulses ``p`` onto their sets in place, so that the returned impulses are allowed ones."""
    for c in range(mu.size):
        k = 3 * c
        p[k + 2] = max(p[k + 2], p_min[c])
        norm, radius = np.sqrt(p[k] ** 2 + p[k + 1] ** 2), mu[c] * p[k + 2]
        if norm > radius:
            p[k] *= radius / norm
            p[k + 1] *= radius / norm
    for j in range(low.size):
        k = 3 * mu.size + j
        p[k] = min(max(p[k], low[j]), high[j])


@compiled
def _newton(
    G: Array,
    g: Array,
    mu: Array,
    p_min: Array,
    low: Array,
    high: Array,
    step_length: Array,
    p: Array,
    u: Array,
    goal: float,
    steps: int,
    damped: bool,
) -> float:
    """Make semismooth Newton steps on the natural map, in place, and return the residual that was reached.

    They end below the residual ``goal`` or after ``steps``. The caller keeps a copy of ``p``.
    """
    size = g.size
    A, step = np.empty((size, size)), np.empty(size)
    residual = natural_residual(p, u, mu, p_min, low, high, step_length)
    for _ in range(steps):
        # With redundant contacts A is singular. Damping that decreases with the residual (Levenberg, Marquardt) helps,
        # but it hides the effect of a small compliance; the caller therefore also tries without.
        largest = 1e-300
        for i in range(size):
            largest = max(largest, abs(p[i]))
        damping = (min(1.0, residual / largest) if damped else 0.0) + 1e-13
        for c in range(mu.size):
            k = 3 * c
            n, rho = k + 2, step_length[k]
            if p[n] - rho * u[n] > p_min[c]:
                step[n] = -rho * u[n]
                for j in range(size):
                    A[n, j] = rho * G[n, j]
                A[n, n] += damping
            else:
                step[n] = p_min[c] - p[n]
                for j in range(size):
                    A[n, j] = 0.0
                A[n, n] = 1.0
            x, y, radius = p[k] - rho * u[k], p[k + 1] - rho * u[k + 1], mu[c] * max(p[n], 0.0)
            norm = np.sqrt(x * x + y * y)
            if norm <= radius:
                step[k], step[k + 1] = -rho * u[k], -rho * u[k + 1]
                for j in range(size):
                    A[k, j], A[k + 1, j] = rho * G[k, j], rho * G[k + 1, j]
                A[k, k] += damping
                A[k + 1, k + 1] += damping
            else:
                # The derivative of p_t - radius y/|y| with y = p_t - rho u_t.
                x, y, share = x / norm, y / norm, radius / norm
                step[k], step[k + 1] = radius * x - p[k], radius * y - p[k + 1]
                xx, xy, yy = share * (1.0 - x * x), -share * x * y, share * (1.0 - y * y)
                for j in range(size):
                    A[k, j] = rho * (xx * G[k, j] + xy * G[k + 1, j])
                    A[k + 1, j] = rho * (xy * G[k, j] + yy * G[k + 1, j])
                A[k, k] += 1.0 - xx
                A[k, k + 1] -= xy
                A[k + 1, k] -= xy
                A[k + 1, k + 1] += 1.0 - yy
                if p[n] > 0.0:
                    A[k, n] -= mu[c] * x
                    A[k + 1, n] -= mu[c] * y
        for j in range(low.size):
            k = 3 * mu.size + j
            rho = step_length[k]
            value = p[k] - rho * u[k]
            if low[j] < value < high[j]:
                step[k] = -rho * u[k]
                for i in range(size):
                    A[k, i] = rho * G[k, i]
                A[k, k] += damping
            else:
                step[k] = (high[j] if value >= high[j] else low[j]) - p[k]
                for i in range(size):
                    A[k, i] = 0.0
                A[k, k] = 1.0
        if not eliminate(A, step):
            return np.inf
        for i in range(size):
            p[i] += step[i]
        if damped:
            _project_back(mu, p_min, low, high, p)
        write_velocity(G, g, p, u)
        residual = natural_residual(p, u, mu, p_min, low, high, step_length)
        if not residual > goal:
            break
    if not damped:
        _project_back(mu, p_min, low, high, p)
        write_velocity(G, g, p, u)
        residual = natural_residual(p, u, mu, p_min, low, high, step_length)
    return residual


@compiled
def solve_cone(
    G: Array,
    g: Array,
    mu: Array,
    p_min: Array,
    low: Array,
    high: Array,
    p: Array,
    u: Array,
    tolerance: float,
    max_sweeps: int,
) -> tuple[float, int]:
    """Solve for the impulses ``p`` (3 n + m,), in place from a first guess; ``u`` (3 n + m,) receives the velocities.

    ``G`` (3 n + m, 3 n + m) and ``g`` (3 n + m,) give u = G p + g; ``mu`` and ``p_min`` (n,) are the contacts' friction
    coefficients and smallest normal impulses, ``low`` and ``high`` (m,) the servos' limits. It ends at ``tolerance`` or
    after ``max_sweeps``. Returns the natural residual relative to the largest impulse, and the number of sweeps; the
    caller compares the residual with the tolerance.
    """
    size = g.size
    step_length = np.empty(size)
    scale = impulse_scales(G, g, mu.size, step_length)
    write_velocity(G, g, p, u)
    saved_p, saved_u = np.empty(size), np.empty(size)
    sweeps, next_newton, attempts = 0, 4, 0
    while True:
        largest = scale
        for i in range(size):
            largest = max(largest, abs(p[i]))
        for c in range(mu.size):
            largest = max(largest, p_min[c])
        if largest == 0.0:
            return 0.0, sweeps
        goal = tolerance * largest
        residual = natural_residual(p, u, mu, p_min, low, high, step_length)
        if residual <= goal or sweeps >= max_sweeps:
            return residual / largest, sweeps
        if sweeps == 0 and attempts == 0 and residual <= 0.1 * largest:
            next_newton = 0  # the first guess is good, such as the last time step's impulses
        if sweeps >= next_newton:
            next_newton = max(4, int(1.5 * sweeps))
            for i in range(size):
                saved_p[i], saved_u[i] = p[i], u[i]
            if _newton(G, g, mu, p_min, low, high, step_length, p, u, goal, 40, attempts % 2 == 0) <= goal:
                continue
            attempts += 1
            for i in range(size):
                p[i], u[i] = saved_p[i], saved_u[i]
        if signals_raise() != 0:
            raise Interrupted
        _sweep(G, mu, p_min, low, high, p, u)
        sweeps += 1
        if sweeps % 50 == 0:
            write_velocity(G, g, p, u)  # removes accumulated rounding errors
