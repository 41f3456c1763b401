"""The mass matrix of free bodies that carry legs: its factors, and velocities that impulses cause, compiled.

A leg has non-zero elements with itself and with its body alone. The legs' coordinates are therefore eliminated first
(L L^T of each leg's block), then each body's six. Coordinates whose velocity is known, such as joints that are held by
their servos, are left out. A dense mass matrix is a single leg without a body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, inlined, no_new_arrays


class Mass(NamedTuple):
    """Mass matrix of bodies b with legs l of joints j; w is the largest number of joints of a leg.

    Parameters
    ----------
    base_v
        Index (b,) of each body's first coordinate in the velocity (nv,).
    joint_v
        Index (j,) of each joint's coordinate.
    leg_base
        The body (l,) that carries each leg, -1 for none.
    leg_start
        The joints of leg l are those from ``leg_start[l]`` to ``leg_start[l + 1]``, (l + 1,).
    composite
        Inertia (b, 10) of each body with its legs: mass [kg], mass times centre of mass [kg m], and moments about the
        origin [kg m^2] in the order xx, xy, xz, yy, yz, zz.
    coupling
        Elements (j, 6) between each joint and its body.
    block
        Elements (j, w) between each joint and those before it in its leg, itself included.
    """

    base_v: Whole
    joint_v: Whole
    leg_base: Whole
    leg_start: Whole
    composite: Array
    coupling: Array
    block: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Factor(NamedTuple):
    """Factors of a mass matrix, and the right side in their coordinates.

    Parameters
    ----------
    free
        Whether each joint's velocity is unknown (1) or given (0), (j,).
    loose
        Number (l,) of such joints of each leg.
    leg, across
        Lower factor (j, w) of each leg's block, and its product with the coupling (j, 6). Joints that are not free have
        unit rows.
    base
        Lower factor (b, 6, 6) of each body's block without the legs' part; reciprocals on its diagonal.
    y_base, y_joint
        The right side (b, 6) and (j,).
    """

    free: Whole
    loose: Whole
    leg: Array
    across: Array
    base: Array
    y_base: Array
    y_joint: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Rows(NamedTuple):
    """Rows of a Jacobian, each with one or two sides: a body with at most one of its legs.

    Parameters
    ----------
    sides
        Number (r,) of sides.
    base, leg
        Body and leg (r, 2) of each side, as indices; -1 for none.
    on_base, on_leg
        Elements (r, 2, 6) and (r, 2, w) for their coordinates.
    y_base, y_leg
        The same in the coordinates of the factors, as ``project`` computes them.
    """

    sides: Whole
    base: Whole
    leg: Whole
    on_base: Array
    on_leg: Array
    y_base: Array
    y_leg: Array

    def __repr__(self) -> str:
        return short_repr(self)


def factor_memory(mass: Mass) -> Factor:
    """Return the arrays of ``Factor`` for ``mass``; all joints are free."""
    b, (j, width), legs = len(mass.base_v), mass.block.shape, len(mass.leg_base)
    return Factor(
        np.ones(j, dtype=np.int64), np.zeros(legs, dtype=np.int64), np.zeros((j, width)), np.zeros((j, 6)),
        np.zeros((b, 6, 6)), np.zeros((b, 6)), np.zeros(j),
    )  # fmt: skip


def row_memory(mass: Mass, rows: int) -> Rows:
    """Return the arrays of ``Rows`` for a number of ``rows``, filled with zeros."""
    width = mass.block.shape[1]
    sides = np.full((rows, 2), -1, dtype=np.int64)
    arrays = (np.zeros((rows, 2, size)) for size in (6, width, 6, width))
    return Rows(np.zeros(rows, dtype=np.int64), sides, sides.copy(), *arrays)


@no_new_arrays
def multiply(mass: Mass, x: Array, out: Array) -> None:
    """Write M x to ``out`` (nv,), for ``x`` (nv,)."""
    for b in range(mass.base_v.size):
        i, C = mass.base_v[b], mass.composite[b]
        v0, v1, v2, w0, w1, w2 = x[i], x[i + 1], x[i + 2], x[i + 3], x[i + 4], x[i + 5]
        m, c0, c1, c2 = C[0], C[1], C[2], C[3]
        out[i] = m * v0 + w1 * c2 - w2 * c1
        out[i + 1] = m * v1 + w2 * c0 - w0 * c2
        out[i + 2] = m * v2 + w0 * c1 - w1 * c0
        out[i + 3] = C[4] * w0 + C[5] * w1 + C[6] * w2 + c1 * v2 - c2 * v1
        out[i + 4] = C[5] * w0 + C[7] * w1 + C[8] * w2 + c2 * v0 - c0 * v2
        out[i + 5] = C[6] * w0 + C[8] * w1 + C[9] * w2 + c0 * v1 - c1 * v0
    for leg in range(mass.leg_base.size):
        b, start, end = mass.leg_base[leg], mass.leg_start[leg], mass.leg_start[leg + 1]
        for j in range(start, end):
            out[mass.joint_v[j]] = 0.0
        for j in range(start, end):
            rate, total = x[mass.joint_v[j]], 0.0
            if b >= 0:
                k = mass.base_v[b]
                for a in range(6):
                    out[k + a] += mass.coupling[j, a] * rate
                    total += mass.coupling[j, a] * x[k + a]
            for i in range(start, j):
                total += mass.block[j, i - start] * x[mass.joint_v[i]]
                out[mass.joint_v[i]] += mass.block[j, i - start] * rate
            out[mass.joint_v[j]] += total + mass.block[j, j - start] * rate


@no_new_arrays
def factorise(mass: Mass, factor: Factor) -> bool:
    """Compute the factors for the joints that ``factor.free`` names; return false if the matrix is not positive."""
    for b in range(mass.base_v.size):
        _write_base(mass.composite, b, factor.base)
    for leg in range(mass.leg_base.size):
        b, start, end = mass.leg_base[leg], mass.leg_start[leg], mass.leg_start[leg + 1]
        loose = 0
        for j in range(start, end):
            loose += factor.free[j]
        factor.loose[leg] = loose
        if loose == 0:
            continue
        for j in range(start, end):
            last = j - start
            for i in range(last):
                value = mass.block[j, i] if factor.free[j] and factor.free[start + i] else 0.0
                for k in range(i):
                    value -= factor.leg[j, k] * factor.leg[start + i, k]
                factor.leg[j, i] = value / factor.leg[start + i, i]
            value = mass.block[j, last] if factor.free[j] else 1.0
            for k in range(last):
                value -= factor.leg[j, k] * factor.leg[j, k]
            if not value > 0.0:
                return False
            factor.leg[j, last] = np.sqrt(value)
            if b < 0:
                continue
            for a in range(6):
                value = mass.coupling[j, a] if factor.free[j] else 0.0
                for k in range(last):
                    value -= factor.leg[j, k] * factor.across[start + k, a]
                factor.across[j, a] = value / factor.leg[j, last]
            for a in range(6):
                for c in range(a + 1):
                    factor.base[b, a, c] -= factor.across[j, a] * factor.across[j, c]
    for b in range(mass.base_v.size):
        for c in range(6):
            value = factor.base[b, c, c]
            for k in range(c):
                value -= factor.base[b, c, k] * factor.base[b, c, k]
            if not value > 0.0:
                return False
            inverse = 1.0 / np.sqrt(value)
            factor.base[b, c, c] = inverse
            for a in range(c + 1, 6):
                value = factor.base[b, a, c]
                for k in range(c):
                    value -= factor.base[b, a, k] * factor.base[b, c, k]
                factor.base[b, a, c] = value * inverse
    return True


@inlined
def _write_base(composite: Array, b: int, base: Array) -> None:
    """Write the lower half of the mass matrix (6, 6) of body ``b``."""
    m, c0, c1, c2 = composite[b, 0], composite[b, 1], composite[b, 2], composite[b, 3]
    for a in range(6):
        for c in range(a + 1):
            base[b, a, c] = 0.0
    for a in range(3):
        base[b, a, a] = m
    base[b, 3, 1], base[b, 3, 2] = -c2, c1
    base[b, 4, 0], base[b, 4, 2] = c2, -c0
    base[b, 5, 0], base[b, 5, 1] = -c1, c0
    base[b, 3, 3], base[b, 4, 3], base[b, 5, 3] = composite[b, 4], composite[b, 5], composite[b, 6]
    base[b, 4, 4], base[b, 5, 4], base[b, 5, 5] = composite[b, 7], composite[b, 8], composite[b, 9]


@no_new_arrays
def load(mass: Mass, r: Array, factor: Factor) -> None:
    """Compute the right side ``factor.y_base``, ``factor.y_joint`` of the momentum ``r`` (nv,)."""
    for b in range(mass.base_v.size):
        for a in range(6):
            factor.y_base[b, a] = r[mass.base_v[b] + a]
    for leg in range(mass.leg_base.size):
        if factor.loose[leg] == 0:
            continue
        b, start, end = mass.leg_base[leg], mass.leg_start[leg], mass.leg_start[leg + 1]
        for j in range(start, end):
            value = r[mass.joint_v[j]] if factor.free[j] else 0.0
            for k in range(j - start):
                value -= factor.leg[j, k] * factor.y_joint[start + k]
            value /= factor.leg[j, j - start]
            factor.y_joint[j] = value
            if b >= 0:
                for a in range(6):
                    factor.y_base[b, a] -= factor.across[j, a] * value
    for b in range(mass.base_v.size):
        for a in range(6):
            value = factor.y_base[b, a]
            for c in range(a):
                value -= factor.base[b, a, c] * factor.y_base[b, c]
            factor.y_base[b, a] = value * factor.base[b, a, a]


@no_new_arrays
def project(mass: Mass, factor: Factor, rows: Rows, count: int, G: Array, g: Array) -> None:
    """Compute G = J M^-1 J^T and g = J M^-1 r for the first ``count`` rows, over the free coordinates."""
    for i in range(count):
        g[i] = 0.0
        for side in range(rows.sides[i]):
            b, leg = rows.base[i, side], rows.leg[i, side]
            loose = leg >= 0 and factor.loose[leg] > 0
            if loose:
                start = mass.leg_start[leg]
                for j in range(start, mass.leg_start[leg + 1]):
                    value = rows.on_leg[i, side, j - start] if factor.free[j] else 0.0
                    for k in range(j - start):
                        value -= factor.leg[j, k] * rows.y_leg[i, side, k]
                    value /= factor.leg[j, j - start]
                    rows.y_leg[i, side, j - start] = value
                    g[i] += value * factor.y_joint[j]
            if b >= 0:
                for a in range(6):
                    value = rows.on_base[i, side, a]
                    if loose:
                        for j in range(start, mass.leg_start[leg + 1]):
                            value -= factor.across[j, a] * rows.y_leg[i, side, j - start]
                    for c in range(a):
                        value -= factor.base[b, a, c] * rows.y_base[i, side, c]
                    value *= factor.base[b, a, a]
                    rows.y_base[i, side, a] = value
                    g[i] += value * factor.y_base[b, a]
        for k in range(i + 1):
            G[i, k] = G[k, i] = _product(mass, factor, rows, i, k)


@inlined
def _product(mass: Mass, factor: Factor, rows: Rows, i: int, k: int) -> float:
    """Return the element of J M^-1 J^T for two rows."""
    total = 0.0
    for side in range(rows.sides[i]):
        b, leg = rows.base[i, side], rows.leg[i, side]
        for other in range(rows.sides[k]):
            if b >= 0 and rows.base[k, other] == b:
                for a in range(6):
                    total += rows.y_base[i, side, a] * rows.y_base[k, other, a]
            if leg >= 0 and rows.leg[k, other] == leg and factor.loose[leg] > 0:
                for j in range(mass.leg_start[leg + 1] - mass.leg_start[leg]):
                    total += rows.y_leg[i, side, j] * rows.y_leg[k, other, j]
    return total


@no_new_arrays
def velocities(mass: Mass, factor: Factor, rows: Rows, count: int, p: Array, v: Array) -> None:
    """Write the free coordinates of the velocity ``v`` (nv,) after the impulses ``p`` of the first ``count`` rows.

    The right side of ``factor`` is used up: it receives the impulses too.
    """
    for i in range(count):
        for side in range(rows.sides[i]):
            b, leg = rows.base[i, side], rows.leg[i, side]
            if b >= 0:
                for a in range(6):
                    factor.y_base[b, a] += rows.y_base[i, side, a] * p[i]
            if leg >= 0 and factor.loose[leg] > 0:
                start = mass.leg_start[leg]
                for j in range(start, mass.leg_start[leg + 1]):
                    factor.y_joint[j] += rows.y_leg[i, side, j - start] * p[i]
    for b in range(mass.base_v.size):
        k = mass.base_v[b]
        for a in range(5, -1, -1):
            value = factor.y_base[b, a]
            for c in range(a + 1, 6):
                value -= factor.base[b, c, a] * v[k + c]
            v[k + a] = value * factor.base[b, a, a]
    for leg in range(mass.leg_base.size):
        if factor.loose[leg] == 0:
            continue
        b, start, end = mass.leg_base[leg], mass.leg_start[leg], mass.leg_start[leg + 1]
        for j in range(end - 1, start - 1, -1):
            value = factor.y_joint[j]
            if b >= 0:
                for a in range(6):
                    value -= factor.across[j, a] * v[mass.base_v[b] + a]
            for i in range(j + 1, end):
                if factor.free[i]:
                    value -= factor.leg[i, j - start] * v[mass.joint_v[i]]
            if factor.free[j]:
                v[mass.joint_v[j]] = value / factor.leg[j, j - start]


@inlined
def row_speed(mass: Mass, rows: Rows, i: int, v: Array) -> float:
    """Return row ``i`` of the Jacobian times the velocity ``v`` (nv,)."""
    total = 0.0
    for side in range(rows.sides[i]):
        b, leg = rows.base[i, side], rows.leg[i, side]
        if b >= 0:
            for a in range(6):
                total += rows.on_base[i, side, a] * v[mass.base_v[b] + a]
        if leg >= 0:
            start = mass.leg_start[leg]
            for j in range(start, mass.leg_start[leg + 1]):
                total += rows.on_leg[i, side, j - start] * v[mass.joint_v[j]]
    return total


@inlined
def add_impulse(mass: Mass, rows: Rows, i: int, p: float, r: Array) -> None:
    """Add row ``i`` of the Jacobian times ``p`` to the momentum ``r`` (nv,)."""
    for side in range(rows.sides[i]):
        b, leg = rows.base[i, side], rows.leg[i, side]
        if b >= 0:
            for a in range(6):
                r[mass.base_v[b] + a] += rows.on_base[i, side, a] * p
        if leg >= 0:
            start = mass.leg_start[leg]
            for j in range(start, mass.leg_start[leg + 1]):
                r[mass.joint_v[j]] += rows.on_leg[i, side, j - start] * p
