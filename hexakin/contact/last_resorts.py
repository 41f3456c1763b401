"""What is tried if ``hexakin.contact.cone.solve_cone`` fails: other first guesses.

Callers that rarely need ``solve_hard_cone`` should call it from Python, so that it is compiled only when needed.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import ConeMemory, ConeProblem, solve_cone
from hexakin.contact.lcp import solve_polyhedron
from hexakin.numerics.numba_cache import compiled, no_new_arrays

# Of 74 random problems that were not solved before, 8, 16 and 64 facets solve 72, and 12 facets one more.
_FACETS = (8, 12, 16, 24, 32, 64, 128)
_PIVOTS, _SWEEPS = 2000, 200  # more help hardly ever
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
    """Solve as ``solve_cone``, from solutions of softer contacts and of polyhedra with more and more facets.

    ``p`` needs no first guess. The servos' limits must be finite. The best of all results is kept.
    """
    size = 3 * contacts + servos
    x, w = np.zeros(size), np.zeros(size)
    best, sweeps = solve_softer_first(problem, contacts, servos, p, u, tolerance, memory)
    for facets in _FACETS:
        if best <= tolerance:
            break
        solve_polyhedron(problem, contacts, servos, facets, x, w, tolerance, _PIVOTS)
        residual, used = solve_cone(problem, contacts, servos, x, w, tolerance, _SWEEPS, memory)
        sweeps += used
        if residual < best:
            best = residual
            for i in range(size):
                p[i], u[i] = x[i], w[i]
    return best, sweeps


@compiled
def improve(
    problem: ConeProblem,
    contacts: int,
    servos: int,
    p: Array,
    u: Array,
    residual: float,
    tolerance: float,
    memory: ConeMemory,
) -> tuple[float, int]:
    """Solve as ``solve_hard_cone``, but keep ``p`` and ``u`` with their ``residual`` if the result is not better."""
    x, w = np.zeros(p.size), np.zeros(p.size)
    second, sweeps = solve_hard_cone(problem, contacts, servos, x, w, tolerance, memory)
    if not second < residual:
        return residual, sweeps
    for i in range(3 * contacts + servos):
        p[i], u[i] = x[i], w[i]
    return second, sweeps
