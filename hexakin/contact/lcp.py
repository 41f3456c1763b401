"""Coulomb's law with paper A's polyhedron, as a linear complementarity problem (LCP), compiled (A section 3.1).

The friction disc is replaced by an inscribed regular polygon with corners at k generators d_i, the first along t1.
A(7)-(10) are used with three corrections (Stewart and Trinkle 1996, Anitescu and Potra 1997): velocities u where the
paper prints the Jacobians alone, one impulse for each generator, and the sum of these impulses in the friction bound.
For each contact

    0 <= u_n                         ⊥  p_n - p_min >= 0    A(7), A(8)
    0 <= lambda + d_i . u_t          ⊥  f_i         >= 0    A(9)
    0 <= mu p_n - (f_1 + ... + f_k)  ⊥  lambda      >= 0    A(10)

with p_t = f_1 d_1 + ... + f_k d_k; lambda is the slip speed, measured along the generators. Each servo has two pairs:

    0 <= u + kappa                   ⊥  p - low     >= 0
    0 <= high - p                    ⊥  kappa       >= 0

The matrix is copositive, so that Lemke's method finds a solution in exact arithmetic (Cottle, Pang and Stone, "The
Linear Complementarity Problem", 1992, section 4.4). Three measures reduce rounding errors: one scale for each contact
and servo brings the diagonal of the matrix near 1; the final basis is solved once more from the original data; and if
one path fails, others are tried. The residual alone decides whether the result is a solution.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import ConeProblem, impulse_scales, write_velocity
from hexakin.contact.lemke import SOLVED, follow, sharpen
from hexakin.numerics.numba_cache import Whole, compiled

_PATHS = 4


@compiled
def nearest_in_polygon(x: float, y: float, radius: float, facets: int) -> tuple[float, float]:
    """Return the point of a regular polygon that is nearest to (``x``, ``y``).

    The polygon has ``facets`` sides, its centre at the origin, and its first corner at (``radius``, 0).
    """
    half = np.pi / facets
    middle = (2.0 * np.floor(np.arctan2(y, x) / (2.0 * half)) + 1.0) * half
    c, s = np.cos(middle), np.sin(middle)
    # Axes across and along the facet nearest to the point.
    across, along = c * x + s * y, c * y - s * x
    if across <= radius * np.cos(half):
        return x, y
    across, end = radius * np.cos(half), radius * np.sin(half)
    along = min(max(along, -end), end)
    return c * across - s * along, s * across + c * along


@compiled
def polygon_residual(
    problem: ConeProblem, contacts: int, servos: int, facets: int, p: Array, u: Array, step_length: Array
) -> float:
    """Return the residual of ``hexakin.contact.cone.natural_map``, with the polygon instead of the disc."""
    mu, p_min, low, high = problem.mu, problem.p_min, problem.low, problem.high
    worst = 0.0
    for c in range(contacts):
        k, rho = 3 * c, step_length[3 * c]
        normal = abs(p[k + 2] - max(p_min[c], p[k + 2] - rho * u[k + 2]))
        radius = mu[c] * max(p[k + 2], 0.0)
        x, y = nearest_in_polygon(p[k] - rho * u[k], p[k + 1] - rho * u[k + 1], radius, facets)
        slip = np.sqrt((x - p[k]) ** 2 + (y - p[k + 1]) ** 2)
        # A NaN must not count as a small residual.
        if not (normal <= worst and slip <= worst):
            worst = max(normal, slip) if normal == normal and slip == slip else np.inf
    for j in range(servos):
        k = 3 * contacts + j
        error = abs(p[k] - min(max(p[k] - step_length[k] * u[k], low[j]), high[j]))
        if not error <= worst:
            worst = error if error == error else np.inf
    return worst


@compiled
def _build(
    G: Array, h: Array, mu: Array, least: Array, width: Array, row: Whole, part: Array, A: Array, q: Array
) -> None:
    """Fill the LCP (``A``, ``q``). If row[j] >= 0, unknown j is an impulse part[j] in row[j] and the next row.

    The order is: normal impulses, facet impulses contact by contact, slip multipliers, servo impulses, their
    multipliers. ``G`` and ``h`` are scaled; h are the velocities at the lower bounds ``least`` of the impulses.
    ``width`` (m,) are the widths of the servos' boxes.
    """
    n, m = least.size, width.size
    facets, boxes = (q.size - 2 * m) // n - 2 if n > 0 else 0, q.size - 2 * m
    for i in range(q.size):
        q[i] = 0.0
        for j in range(q.size):
            A[i, j] = 0.0
    for i in range(q.size):
        if row[i] < 0:
            continue
        a, x, y = row[i], part[i, 0], part[i, 1]
        b = a + 1 if y != 0.0 else a
        q[i] = x * h[a] + y * h[b]
        for j in range(i + 1):
            if row[j] >= 0:
                c = row[j]
                d = c + 1 if part[j, 1] != 0.0 else c
                value = x * (G[a, c] * part[j, 0] + G[a, d] * part[j, 1])
                if y != 0.0:
                    value += y * (G[b, c] * part[j, 0] + G[b, d] * part[j, 1])
                A[i, j] = A[j, i] = value
    for c in range(n):
        slip = n + n * facets + c
        for i in range(n + c * facets, n + (c + 1) * facets):
            A[i, slip] = 1.0  # A(9): lambda in each facet's row
            A[slip, i] = -1.0  # A(10): the facets' sum
        A[slip, c] = mu[c]
        q[slip] = mu[c] * least[c]
    for j in range(m):
        A[boxes + j, boxes + m + j] = 1.0
        A[boxes + m + j, boxes + j] = -1.0
        q[boxes + m + j] = width[j]


@compiled
def solve_polyhedron(
    problem: ConeProblem,
    contacts: int,
    servos: int,
    facets: int,
    p: Array,
    u: Array,
    tolerance: float,
    max_pivots: int,
) -> tuple[float, int]:
    """Solve for the impulses ``p`` (3 n + m,), in place; ``u`` (3 n + m,) receives the velocities.

    Arguments, order and units are those of ``hexakin.contact.cone.solve_cone``, except that p needs no first guess and
    that the servos' limits must be finite; ``facets`` is the number of generators, even and at least 4. If a path ends
    with a residual above ``tolerance`` or after ``max_pivots``, up to three others are tried and the best result is
    kept. Returns the natural residual of the polygon problem, relative to the largest impulse, and the number of pivots
    on all paths; the caller compares the residual with the tolerance.
    """
    G, g, p_min, low, high = problem.G, problem.g, problem.p_min, problem.low, problem.high
    n, m, size = contacts, servos, 3 * contacts + servos
    count = n * (facets + 2) + 2 * m
    step_length, d = np.empty(size), np.empty(size)
    scale = impulse_scales(problem, n, m, step_length)
    # With impulses in units of d and velocities in units of 1 / d the matrix's diagonal is near 1.
    S, h, start = np.empty((size, size)), np.empty(size), np.empty(size)
    for k in range(size):
        d[k] = np.sqrt(step_length[k])
        start[k] = 0.0 if k < 3 * n else low[k - 3 * n] / d[k]
    least, width = np.empty(n), np.empty(m)
    for c in range(n):
        least[c] = start[3 * c + 2] = p_min[c] / d[3 * c]
    for j in range(m):
        width[j] = (high[j] - low[j]) / d[3 * n + j]
    for i in range(size):
        h[i] = d[i] * g[i]
        for j in range(size):
            S[i, j] = d[i] * G[i, j] * d[j]
            h[i] += S[i, j] * start[j]
    row, part = np.empty(count, dtype=np.int64), np.empty((count, 2))
    for i in range(count):
        row[i], part[i, 0], part[i, 1] = -1, 0.0, 0.0
    for c in range(n):
        row[c], part[c, 0] = 3 * c + 2, 1.0
        for i in range(facets // 2):
            k = n + c * facets + i
            x, y = np.cos(2.0 * np.pi * i / facets), np.sin(2.0 * np.pi * i / facets)
            row[k], part[k, 0], part[k, 1] = 3 * c, x, y
            k += facets // 2
            row[k], part[k, 0], part[k, 1] = 3 * c, -x, -y
    for j in range(m):
        k = n * (facets + 2) + j
        row[k], part[k, 0] = 3 * n + j, 1.0
    A, q = np.empty((count, count)), np.empty(count)
    _build(S, h, problem.mu, least, width, row, part, A, q)
    unit = 0.0
    for i in range(count):
        unit = max(unit, abs(q[i]))
    if unit > 0.0:
        for i in range(count):
            q[i] /= unit
    T, basic, z, cover = np.empty((count, count + 2)), np.empty(count, dtype=np.int64), np.empty(count), np.empty(count)
    x, w = np.empty(size), np.empty(size)
    best, pivots = np.inf, 0
    for path in range(_PATHS):
        for i in range(count):
            cover[i] = 1.0 if path == 0 else 0.5 + (0.618033988749895 * path * (i + 1)) % 1.0
        status, used = follow(A, q, cover, max_pivots, T, basic, z)
        pivots += used
        if status == SOLVED:
            sharpen(A, q, basic, z)
        for k in range(size):
            x[k] = start[k]
        for i in range(count):
            if row[i] >= 0:
                x[row[i]] += unit * z[i] * part[i, 0]
                if part[i, 1] != 0.0:
                    x[row[i] + 1] += unit * z[i] * part[i, 1]
        largest = scale
        for k in range(size):
            x[k] *= d[k]
            largest = max(largest, abs(x[k]))
        write_velocity(problem, size, x, w)
        residual = polygon_residual(problem, n, m, facets, x, w, step_length)
        if largest > 0.0:
            residual /= largest
        if path == 0 or residual < best:
            best = residual
            for k in range(size):
                p[k], u[k] = x[k], w[k]
        if best <= tolerance:
            break
    return best, pivots
