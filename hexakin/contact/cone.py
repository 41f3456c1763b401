"""Coulomb's law with the exact cone, compiled: block Gauss-Seidel sweeps and semismooth Newton steps.

The unknowns are the impulses p: three for each of n contacts in the order (t1, t2, n), then one for each of m servos.
The velocities are u = G p + g. For each contact: p_n >= p_min, u_n >= 0, (p_n - p_min) u_n = 0, and the tangential
impulse is the point of the disc |p_t| <= mu p_n that dissipates most power (maximum dissipation). A bias of the normal
velocity (restitution, gap) is part of g. For each servo: low <= p <= high, and u = 0 between the limits.

A sweep solves the contacts one after the other, each exactly (``hexakin.contact.one_contact``). Sweeps make progress
from any first guess, but slowly if contacts are redundant or friction is large. Newton's method on the natural map is
fast, but converges only near a solution, or farther away with a line search. Therefore the two alternate. The residual
alone decides whether the result is a solution.

The functions allocate no memory. Arrays have a capacity: only their leading part is used, 3 n + m rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.contact.one_contact import solve_contact
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Interrupted, no_new_arrays, signals_raise

_FEW, _MANY = 8, 40  # largest number of Newton steps before the first sweep, and later
_WAYS = 4  # ways of Newton's method, see ``_newton``
_HALVINGS = 8  # of the step in a line search
_DECREASE = 2e-4  # share of the decrease predicted by Newton's method that a step must reach
_REFRESH = 50  # sweeps after which velocities are computed anew, without accumulated rounding errors


class ConeProblem(NamedTuple):
    """Impulses p are sought with the velocities u = G p + g; see the module's first lines.

    ``G`` (capacity, capacity) [1/kg] is symmetric and contiguous row by row, ``g`` (capacity,) [m/s]. ``mu`` and
    ``p_min`` [N s] are the contacts' friction coefficients and smallest normal impulses, ``low`` and ``high`` [N m s]
    the servos' limits.
    """

    G: Array
    g: Array
    mu: Array
    p_min: Array
    low: Array
    high: Array

    def __repr__(self) -> str:
        return short_repr(self)


class ConeMemory(NamedTuple):
    """Memory for the solution of problems of up to ``rows`` rows, made by ``cone_memory``.

    ``step_length`` (rows,) receives the effective mass [kg] of each row, one value for the rows of a contact. ``moved``
    (rows,) receives the natural map, by which impulses move in a step -``step_length`` u followed by a projection. The
    other arrays hold Newton's matrix (rows, rows) and vectors (rows,) of impulses and velocities.
    """

    step_length: Array
    moved: Array
    matrix: Array
    step: Array
    trial_p: Array
    trial_u: Array
    saved_p: Array
    best_p: Array

    def __repr__(self) -> str:
        return short_repr(self)


def cone_memory(rows: int) -> ConeMemory:
    """Return the memory for problems of up to ``rows`` = 3 n + m unknowns."""
    vectors = [np.zeros(rows) for _ in range(7)]
    return ConeMemory(vectors[0], vectors[1], np.zeros((rows, rows)), *vectors[2:])


@no_new_arrays
def write_velocity(problem: ConeProblem, size: int, p: Array, u: Array) -> None:
    """Write the velocities G p + g of the first ``size`` rows to ``u``."""
    G, g = problem.G, problem.g
    for i in range(size):
        u[i] = g[i]
    for j in range(size):
        value = p[j]
        for i in range(size):
            u[i] += G[j, i] * value  # row j instead of column j: G is symmetric


@no_new_arrays
def impulse_scales(problem: ConeProblem, contacts: int, servos: int, step_length: Array) -> float:
    """Write the effective mass of each row to ``step_length``, one value for the rows of a contact.

    Return the smallest scale of impulses: the largest of the contacts' smallest normal impulses, and of a thousandth of
    the impulse that stops the fastest row. It is used as the scale if all impulses of the solution are small.
    """
    G, g = problem.G, problem.g
    scale = 0.0
    for c in range(contacts):
        k = 3 * c
        rho = 3.0 / (G[k, k] + G[k + 1, k + 1] + G[k + 2, k + 2])
        fastest = max(abs(g[k]), abs(g[k + 1]), abs(g[k + 2]))
        step_length[k] = step_length[k + 1] = step_length[k + 2] = rho
        scale = max(scale, 1e-3 * rho * fastest, problem.p_min[c])
    for k in range(3 * contacts, 3 * contacts + servos):
        step_length[k] = 1.0 / G[k, k]
        scale = max(scale, 1e-3 * abs(g[k]) / G[k, k])
    return scale


@no_new_arrays
def natural_map(
    problem: ConeProblem, contacts: int, servos: int, p: Array, u: Array, memory: ConeMemory
) -> tuple[float, float]:
    """Write p - P(p - step_length u) to ``memory.moved``, with the projection P onto the set of allowed impulses.

    The map is zero at solutions and nowhere else, and it is of first order in the error everywhere, unlike the products
    p u. Return the residual, which is the largest distance of a contact's or servo's impulses from their projections,
    and the sum of the squares. The residual is infinite if a value is not finite.
    """
    step_length, moved = memory.step_length, memory.moved
    worst, total = 0.0, 0.0  # the square of the residual, and the sum of the squares
    for c in range(contacts):
        k = 3 * c
        n, rho = k + 2, step_length[k]
        normal = min(rho * u[n], p[n] - problem.p_min[c])
        x, y, radius = p[k] - rho * u[k], p[k + 1] - rho * u[k + 1], problem.mu[c] * max(p[n], 0.0)
        square = x * x + y * y
        share = 1.0 if square <= radius * radius else radius / np.sqrt(square)
        x, y = p[k] - share * x, p[k + 1] - share * y
        moved[k], moved[k + 1], moved[n] = x, y, normal
        square = x * x + y * y
        worst = max(worst, square, normal * normal)
        total += square + normal * normal
    for j in range(servos):
        k = 3 * contacts + j
        error = p[k] - min(max(p[k] - step_length[k] * u[k], problem.low[j]), problem.high[j])
        moved[k] = error
        worst = max(worst, error * error)
        total += error * error
    if not total < np.inf:  # a NaN must not count as a small residual
        return np.inf, np.inf
    return np.sqrt(worst), total


@no_new_arrays
def _largest(size: int, scale: float, p: Array) -> float:
    """Return the largest of ``scale`` and of the first ``size`` absolute values of ``p``."""
    for i in range(size):
        scale = max(scale, abs(p[i]))
    return scale


@no_new_arrays
def project(problem: ConeProblem, contacts: int, servos: int, p: Array) -> bool:
    """Project the impulses ``p`` onto their sets in place, and return whether this has changed them."""
    changed = False
    for c in range(contacts):
        k = 3 * c
        if p[k + 2] < problem.p_min[c]:
            p[k + 2], changed = problem.p_min[c], True
        square, radius = p[k] * p[k] + p[k + 1] * p[k + 1], problem.mu[c] * p[k + 2]
        if square > radius * radius:
            share = radius / np.sqrt(square)
            p[k], p[k + 1], changed = share * p[k], share * p[k + 1], True
    for j in range(servos):
        k = 3 * contacts + j
        value = min(max(p[k], problem.low[j]), problem.high[j])
        if value != p[k]:
            p[k], changed = value, True
    return changed


@no_new_arrays
def _sweep(problem: ConeProblem, contacts: int, servos: int, p: Array, u: Array) -> None:
    """Solve each contact and each servo once, one after the other, and update ``p`` and ``u`` in place."""
    G, size = problem.G, 3 * contacts + servos
    for c in range(contacts):
        k = 3 * c
        x, y, normal = solve_contact(G, k, problem.mu[c], problem.p_min[c], p, u)
        dx, dy, dn = x - p[k], y - p[k + 1], normal - p[k + 2]
        p[k], p[k + 1], p[k + 2] = x, y, normal
        for i in range(size):
            u[i] += G[k, i] * dx + G[k + 1, i] * dy + G[k + 2, i] * dn
    for j in range(servos):
        k = 3 * contacts + j
        value = min(max(p[k] - u[k] / G[k, k], problem.low[j]), problem.high[j])
        change = value - p[k]
        p[k] = value
        for i in range(size):
            u[i] += G[k, i] * change


@no_new_arrays
def eliminate(size: int, A: Array, b: Array) -> bool:
    """Solve A x = b by Gaussian elimination with partial pivoting; return false if A is singular.

    The first ``size`` rows and columns of ``A`` are overwritten, and the first ``size`` elements of ``b`` receive x.
    """
    # Crout's order: for 9 rows it takes 0.8 of the time of updating all remaining rows, for 27 rows 0.7.
    for k in range(size):
        pivot, largest = k, 1e-14
        for i in range(k, size):
            value = A[i, k]
            for j in range(k):
                value -= A[i, j] * A[j, k]
            A[i, k] = value
            if abs(value) > largest:
                pivot, largest = i, abs(value)
        if not largest > 1e-14:
            return False
        if pivot != k:
            for j in range(size):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            b[k], b[pivot] = b[pivot], b[k]
        inverse = 1.0 / A[k, k]
        for i in range(k + 1, size):
            value = A[k, i]
            for j in range(k):
                value -= A[k, j] * A[j, i]
            A[k, i] = value * inverse
        value = b[k]
        for j in range(k):
            value -= A[k, j] * b[j]
        b[k] = value * inverse
    for k in range(size - 1, -1, -1):
        value = b[k]
        for j in range(k + 1, size):
            value -= A[k, j] * b[j]
        b[k] = value
    return True


@no_new_arrays
def _write_matrix(
    problem: ConeProblem, contacts: int, servos: int, p: Array, u: Array, damping: float, memory: ConeMemory
) -> None:
    """Write a generalised derivative of the natural map by p to ``memory.matrix``, with ``damping`` on its diagonal."""
    G, A, step_length = problem.G, memory.matrix, memory.step_length
    size = 3 * contacts + servos
    for c in range(contacts):
        k = 3 * c
        n, rho = k + 2, step_length[k]
        pressed = p[n] - rho * u[n] > problem.p_min[c]
        share = rho if pressed else 0.0
        x, y, radius = p[k] - rho * u[k], p[k + 1] - rho * u[k + 1], problem.mu[c] * max(p[n], 0.0)
        square = x * x + y * y
        if square <= radius * radius:
            for j in range(size):
                A[k, j], A[k + 1, j], A[n, j] = rho * G[k, j], rho * G[k + 1, j], share * G[n, j]
            A[k, k] += damping
            A[k + 1, k + 1] += damping
        else:
            # The derivative of p_t - radius y / |y| with y = p_t - rho u_t.
            norm = np.sqrt(square)
            x, y, kept = x / norm, y / norm, radius / norm
            xx, xy, yy = kept * (1.0 - x * x), -kept * x * y, kept * (1.0 - y * y)
            for j in range(size):
                A[k, j] = rho * (xx * G[k, j] + xy * G[k + 1, j])
                A[k + 1, j] = rho * (xy * G[k, j] + yy * G[k + 1, j])
                A[n, j] = share * G[n, j]
            A[k, k] += 1.0 - xx
            A[k, k + 1] -= xy
            A[k + 1, k] -= xy
            A[k + 1, k + 1] += 1.0 - yy
            if p[n] > 0.0:
                A[k, n] -= problem.mu[c] * x
                A[k + 1, n] -= problem.mu[c] * y
        A[n, n] += damping if pressed else 1.0
    for j in range(servos):
        k = 3 * contacts + j
        rho = step_length[k]
        held = problem.low[j] < p[k] - rho * u[k] < problem.high[j]
        share = rho if held else 0.0
        for i in range(size):
            A[k, i] = share * G[k, i]
        A[k, k] += damping if held else 1.0


@no_new_arrays
def _newton(
    problem: ConeProblem,
    contacts: int,
    servos: int,
    p: Array,
    u: Array,
    scale: float,
    tolerance: float,
    way: int,
    steps: int,
    memory: ConeMemory,
) -> float:
    """Make semismooth Newton steps on the natural map, in place, and return the relative residual that was reached.

    They end at the ``tolerance`` or after ``steps``. There are four ``way``s: 0 and 2 without damping, 1 and 3 with
    damping, 0 and 1 with a line search on the sum of squares, 2 and 3 with full steps.
    """
    size = 3 * contacts + servos
    step, trial_p, trial_u = memory.step, memory.trial_p, memory.trial_u
    trials = _HALVINGS if way < 2 else 1
    residual, total = natural_map(problem, contacts, servos, p, u, memory)
    largest = _largest(size, scale, p)
    for _ in range(steps):
        if not tolerance * largest < residual < np.inf:
            break
        # With redundant contacts the matrix is singular. Damping that decreases with the residual (Levenberg,
        # Marquardt) helps, but it hides the effect of a small compliance and takes more steps.
        damping = 1e-13
        if way % 2 == 1:
            damping += min(1.0, residual / largest)
        _write_matrix(problem, contacts, servos, p, u, damping, memory)
        for i in range(size):
            step[i] = -memory.moved[i]
        if not eliminate(size, memory.matrix, step):
            return np.inf
        length, before = 1.0, total
        for _trial in range(trials):
            for i in range(size):
                trial_p[i] = p[i] + length * step[i]
            write_velocity(problem, size, trial_p, trial_u)
            residual, total = natural_map(problem, contacts, servos, trial_p, trial_u, memory)
            if total <= (1.0 - _DECREASE * length) * before:
                break
            length *= 0.5
        # Also without a decrease: some problems are solved only after an increase.
        for i in range(size):
            p[i], u[i] = trial_p[i], trial_u[i]
        largest = _largest(size, scale, p)
    if residual < np.inf and project(problem, contacts, servos, p):
        write_velocity(problem, size, p, u)
        residual, total = natural_map(problem, contacts, servos, p, u, memory)
        largest = _largest(size, scale, p)
    return residual / largest if largest > 0.0 else residual


@no_new_arrays
def _descend(
    problem: ConeProblem,
    contacts: int,
    servos: int,
    p: Array,
    u: Array,
    scale: float,
    tolerance: float,
    max_sweeps: int,
    memory: ConeMemory,
) -> tuple[float, int]:
    """Alternate sweeps and Newton's method from the first guess ``p``; arguments and results as of ``solve_cone``.

    ``scale`` is the smallest scale of impulses.
    """
    size = 3 * contacts + servos
    sweeps, next_newton, ways, steps = 0, 0, 1, _FEW
    write_velocity(problem, size, p, u)
    while True:
        if sweeps >= next_newton or sweeps >= max_sweeps:
            for i in range(size):
                memory.saved_p[i] = p[i]
            for way in range(ways):
                residual = _newton(problem, contacts, servos, p, u, scale, tolerance, way, steps, memory)
                if residual <= tolerance:
                    return residual, sweeps
                for i in range(size):
                    p[i] = memory.saved_p[i]
                write_velocity(problem, size, p, u)
            next_newton, ways, steps = max(sweeps + 1, sweeps + sweeps // 2), _WAYS, _MANY
        if sweeps >= max_sweeps:
            residual, _ = natural_map(problem, contacts, servos, p, u, memory)
            return residual / _largest(size, scale, p), sweeps
        if signals_raise() != 0:
            raise Interrupted
        _sweep(problem, contacts, servos, p, u)
        sweeps += 1
        if sweeps % _REFRESH == 0:
            write_velocity(problem, size, p, u)


@no_new_arrays
def solve_cone(
    problem: ConeProblem,
    contacts: int,
    servos: int,
    p: Array,
    u: Array,
    tolerance: float,
    max_sweeps: int,
    memory: ConeMemory,
) -> tuple[float, int]:
    """Solve for the impulses ``p`` (capacity,), in place from a first guess; ``u`` (capacity,) receives the velocities.

    ``contacts`` is n and ``servos`` m: the problem is in the first 3 n + m rows. It ends at the ``tolerance``, or after
    ``max_sweeps`` from the first guess and as many from zero. Returns the natural residual relative to the largest
    impulse, and the number of sweeps; the caller compares the residual with the tolerance.
    """
    size = 3 * contacts + servos
    scale = impulse_scales(problem, contacts, servos, memory.step_length)
    residual, sweeps = _descend(problem, contacts, servos, p, u, scale, tolerance, max_sweeps, memory)
    if residual <= tolerance:
        return residual, sweeps
    for i in range(size):
        memory.best_p[i] = p[i]
        p[i] = 0.0
    second, used = _descend(problem, contacts, servos, p, u, scale, tolerance, max_sweeps, memory)
    if not second < residual:
        second = residual
        for i in range(size):
            p[i] = memory.best_p[i]
        write_velocity(problem, size, p, u)
    return second, sweeps + used
