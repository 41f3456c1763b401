"""What is tried if ``hexakin.contact.cone.solve_cone`` fails: other first guesses.

Callers that rarely need ``solve_hard_cone`` should call it from Python, so that it is compiled only when needed.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import ConeMemory, ConeProblem, solve_cone
from hexakin.contact.lcp import solve_polyhedron
from hexakin.numerics.numba_cache import compiled, no_new_arrays

# Of 2803 problems of walks with friction 3 and 50 at which ``solve_cone`` had failed, the first three polyhedra help
# with 98 %, the others and softer contacts with all but 15, and at most 700 random first guesses with these.
_FACETS = (8, 16, 64, 12, 24, 32, 128)
_PIVOTS, _SWEEPS = 2000, 20  # more sweeps help hardly ever
_RANDOM, _FEW_SWEEPS = 1500, 5
_SOFTEST = 8  # there are as many stages, with compliances from 1 to 1e-7 of the mean of G's diagonal


@no_new_arrays
def soften(G: Array, size: int, compliance: float) -> None:
    """Add ``compliance`` times the mean of the diagonal of ``G`` to its first ``size`` diagonal elements."""
    mean = 0.0
    for i in range(size):
        mean += G[i, i] / size
    for i in range(size):
        G[i, i] += compliance * mean


@compiled
def solve_softer_first(
    problem: ConeProblem, contacts: int, servos: int, p: Array, u: Array, tolerance: float, memory: ConeMemory
) -> tuple[float, int]:
    """Solve as ``solve_cone``, after contacts of decreasing compliance; each solution is the next first guess.

    Softer contacts are easier. ``p`` needs no first guess.
    """
    size, residual, sweeps = 3 * contacts + servos, np.inf, 0
    for i in range(size):
        p[i] = 0.0
    for stage in range(_SOFTEST + 1):
        G = problem.G.copy()
        if stage < _SOFTEST:
            soften(G, size, 10.0 ** (-stage))
        softer = ConeProblem(G, problem.g, problem.mu, problem.p_min, problem.low, problem.high)
        residual, used = solve_cone(softer, contacts, servos, p, u, tolerance, _SWEEPS, memory)
        sweeps += used
    return residual, sweeps


@compiled
def solve_hard_cone(
    problem: ConeProblem, contacts: int, servos: int, p: Array, u: Array, tolerance: float, memory: ConeMemory
) -> tuple[float, int]:
    """Solve as ``solve_cone``, from solutions of polyhedra and of softer contacts, then from random numbers.

    ``p`` needs no first guess. The servos' limits must be finite. The best of all results is kept.
    """
    size = 3 * contacts + servos
    x, w, middle = np.zeros(size), np.zeros(size), np.zeros(size)
    best, sweeps, largest, number = np.inf, 0, 0.0, 1
    for attempt in range(len(_FACETS) + 1 + _RANDOM):
        if attempt < len(_FACETS):
            solve_polyhedron(problem, contacts, servos, _FACETS[attempt], x, w, tolerance, _PIVOTS)
            largest = 0.0
            for i in range(size):
                middle[i] = x[i]
                largest = max(largest, abs(x[i]))
            residual, used = solve_cone(problem, contacts, servos, x, w, tolerance, _SWEEPS, memory)
        elif attempt == len(_FACETS):
            residual, used = solve_softer_first(problem, contacts, servos, x, w, tolerance, memory)
        else:
            for i in range(size):
                number = 16807 * number % 2147483647  # Park and Miller's generator (1988): equal on all machines
                random = number / 1073741823.5 - 1.0  # from -1 to 1
                x[i] = middle[i] * (1.0 + 2.0 * random) if attempt % 2 == 0 else largest * random**3
            residual, used = solve_cone(problem, contacts, servos, x, w, tolerance, _FEW_SWEEPS, memory)
        sweeps += used
        if attempt == 0 or residual < best:
            best = residual
            for i in range(size):
                p[i], u[i] = x[i], w[i]
        if best <= tolerance:
            break
    return best, sweeps
