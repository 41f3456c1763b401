"""Lemke's method for linear complementarity problems, with lexicographic ratio tests, compiled.

The problem: find z >= 0 with w = A z + q >= 0 and z . w = 0. An artificial variable z_0 makes w positive. Complementary
pivots then follow a path of solutions that ends at z_0 = 0 or goes to infinity (Cottle, Pang and Stone, "The Linear
Complementarity Problem", 1992, section 4.4). Ties are broken as if q had tiny offsets that decrease from row to row
(only their order matters); so no cycle is possible.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import eliminate
from hexakin.numerics.numba_cache import Interrupted, Whole, compiled, signals_raise

SOLVED, RAY, TOO_LONG, INEXACT = 0, 1, 2, 3
"""How Lemke's method ends: solved, on an unbounded ray, after the allowed number of pivots, or with an inexact z."""

_TIE = 1e-11  # ratios that differ by less count as equal; 1e-13 leads to false rays, 1e-9 loses small impulses
_PIVOT = 1e-10  # smallest absolute value of a pivot
_FITS = 1e-8  # largest error of a z that is accepted as a solution


@compiled
def _comes_first(T: Array, column: Whole, i: int, r: int, s: int) -> bool:
    """Return whether row ``i`` leaves before row ``r`` of equal ratio.

    The order is that for offsets e >> e^2 >> ... > 0 of w_1, w_2, ...
    """
    for j in range(column.size):
        if column[j] >= 0:
            x, y = T[i, column[j]] / T[i, s], T[r, column[j]] / T[r, s]
        else:
            x = -1.0 / T[i, s] if ~column[j] == i else 0.0
            y = -1.0 / T[r, s] if ~column[j] == r else 0.0
        if abs(x - y) > _TIE * (1.0 + abs(x) + abs(y)):
            return x < y
    return T[i, s] < T[r, s]


@compiled
def follow(A: Array, q: Array, cover: Array, max_pivots: int, T: Array, basic: Whole, z: Array) -> tuple[int, int]:
    """Follow Lemke's path of w = A z + q + cover z_0 to z_0 = 0; return how it ends and the number of pivots.

    ``cover`` (n,) is positive. ``T`` (n, n + 2) is memory for the tableau. ``basic`` (n,) receives the last basis (w_1
    is 0, z_1 is n, z_0 is 2 n) and ``z`` (n,) its values, which need not be a solution. At most ``max_pivots`` are
    made.
    """
    n = q.size
    artificial = 2 * n  # each row of T gives one basic variable as a function of the non-basic ones
    other = np.empty(n + 1, dtype=np.int64)  # the non-basic variable of each column
    column = np.empty(n, dtype=np.int64)  # the column of w_j, or ~row if it is basic
    line = np.empty(n + 2)
    r, s, least = -1, n, 0.0
    for i in range(n):
        basic[i], other[i], column[i] = i, n + i, ~i
        for j in range(n):
            T[i, j] = A[i, j]
        T[i, n], T[i, n + 1] = cover[i], q[i]
        ratio = q[i] / cover[i]
        if ratio < least or (ratio == least and r >= 0):
            r, least = i, ratio
    other[n] = artificial
    pivots, status = 0, SOLVED
    while r >= 0:
        if pivots == max_pivots:
            status = TOO_LONG
            break
        if signals_raise() != 0:
            raise Interrupted
        pivots += 1
        f = 1.0 / T[r, s]
        for j in range(n + 2):
            line[j] = -f * T[r, j]
        line[s] = f
        for i in range(n):
            f = T[i, s]
            if f != 0.0 and i != r:
                T[i, s] = 0.0
                for j in range(n + 2):
                    T[i, j] += f * line[j]
        for j in range(n + 2):
            T[r, j] = line[j]
        out, into = basic[r], other[s]
        basic[r], other[s] = into, out
        if out < n:
            column[out] = s
        if into < n:
            column[into] = ~r
        if out == artificial:
            break
        enters = out + n if out < n else out - n
        for j in range(n + 1):
            if other[j] == enters:
                s = j
        r, least = -1, np.inf
        for i in range(n):
            if T[i, s] < -_PIVOT:
                ratio = max(T[i, n + 1], 0.0) / -T[i, s]
                tie = _TIE * (1.0 + least)
                if r < 0 or ratio < least - tie:
                    r, least = i, ratio
                elif ratio <= least + tie and basic[r] != artificial:
                    if basic[i] == artificial or _comes_first(T, column, i, r, s):
                        r, least = i, min(least, ratio)
        if r < 0:
            status = RAY
    for i in range(n):
        z[i] = 0.0
    for i in range(n):
        if n <= basic[i] < artificial:
            z[basic[i] - n] = 0.0 if T[i, n + 1] < 0.0 else T[i, n + 1]
    return status, pivots


@compiled
def _error(A: Array, q: Array, z: Array) -> float:
    """Return the largest |min(w, z)| relative to the largest of 1, |q| and |z|; infinite if a value is not finite."""
    worst, largest = 0.0, 1.0
    for i in range(q.size):
        w = q[i]
        for j in range(q.size):
            w += A[i, j] * z[j]
        error = abs(min(w, z[i]))
        if not error <= worst:
            worst = error if error == error else np.inf
        largest = max(largest, abs(q[i]), abs(z[i]))
    return worst / largest


@compiled
def sharpen(A: Array, q: Array, basic: Whole, z: Array) -> None:
    """Solve the last basis of ``follow`` again from ``A`` and ``q``, without the rounding errors of the pivots.

    The result replaces ``z`` if its error is smaller.
    """
    n, count = q.size, 0
    rows = np.empty(n, dtype=np.int64)
    for i in range(n):
        if n <= basic[i] < 2 * n:
            rows[count] = basic[i] - n
            count += 1
    block, x, trial = np.empty((count, count)), np.empty(count), np.empty(n)
    for i in range(n):
        trial[i] = 0.0
    for i in range(count):
        x[i] = -q[rows[i]]
        for j in range(count):
            block[i, j] = A[rows[i], rows[j]]
    if not eliminate(count, block, x):
        return
    for i in range(count):
        trial[rows[i]] = max(x[i], 0.0)
    if _error(A, q, trial) < _error(A, q, z):
        for i in range(n):
            z[i] = trial[i]


@compiled
def lemke(A: Array, q: Array, max_pivots: int) -> tuple[Array, int, int]:
    """Find z >= 0 with w = A z + q >= 0 and z . w = 0 by Lemke's method with lexicographic ratio tests.

    ``A`` is (n, n) and ``q`` (n,). Returns z (n,), how it ended (SOLVED, RAY, TOO_LONG or INEXACT) and the number of
    pivots, at most ``max_pivots``. If A is copositive-plus (for example positive semidefinite), RAY proves that there
    is no solution; for other A it proves nothing. Tolerances are absolute: the caller should scale entries far from 1.
    """
    n = q.size
    z, basic = np.empty(n), np.empty(n, dtype=np.int64)
    status, pivots = follow(A, q, np.ones(n), max_pivots, np.empty((n, n + 2)), basic, z)
    if status == SOLVED:
        sharpen(A, q, basic, z)
        if not _error(A, q, z) <= _FITS:
            status = INEXACT
    return z, status, pivots
