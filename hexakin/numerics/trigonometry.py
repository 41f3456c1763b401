"""Sine and cosine, and the angle of a vector, for whole arrays, by additions, multiplications and divisions only.

On most machines NumPy calls the C library for each element of an array, which takes as long as about a hundred NumPy
multiplications. The formulas here have no branches, so that ``trigonometry_loops`` can use the same formulas in loops
that the compiler turns into vector instructions.

- Sine and cosine of r follow from tan(r/2) = n/d as 2nd/(n^2 + d^2) and 1 - 2n^2/(n^2 + d^2). With y = r/2,
  n = y N(y^2) and d = D(y^2), polynomials of degree 4 with n cos y = d sin y at the Chebyshev points up to pi/2.
- The angle of a vector with smaller component b and larger one a is twice the arctangent of b/(a + |(a, b)|), which is
  at most tan(pi/8): t N(t^2)/D(t^2) of degrees 3 and 4. The last coefficient of both is 1, which saves a
  multiplication each.

``tests/test_trigonometry.py`` calculates the coefficients again. Largest errors: 7e-16 for sine and cosine of
arguments up to ``HALF_TURN``, 9e-16 up to ``LARGEST``, 1e-15 rad for an angle.
"""

from __future__ import annotations

import numpy as np
from numpy import add, divide, multiply, subtract

from hexakin.checks import Array, read_only

LARGEST = 3e6
"""[rad] Largest argument of sine and cosine; fewer than 2^19 turns are then subtracted."""

HALF_TURN = 3.1416
"""[rad] Arguments up to this value, slightly above pi, are used without subtracting turns."""

TURN = 2.0 * np.pi
PER_TURN = 1.0 / TURN
TURN_HIGH, TURN_LOW = float.fromhex("0x1.921fb544p+2"), 2.430840202602477e-10
"""2 pi as a sum of two numbers; the first has 31 bits, so that multiples of it are exact (Cody and Waite 1980)."""

ROUNDING = 1.5 * 2.0**52
"""Adding and then subtracting this number rounds to the nearest whole number."""

TAN_NUMERATOR = (1.0, -0.13738798377541317, 0.00393865202951628, -2.9104109055730014e-05, 3.00279086521582e-08)
TAN_DENOMINATOR = (1.0, -0.4707213171087465, 0.02751242439909774, -0.0004053239291731998, 1.333804921739326e-06)
"""Coefficients of N and D; the constant term is first."""

ATAN_SCALE = 25.786588973609426
ATAN_NUMERATOR = (16.783198174448323, 25.05740034552689, 10.301806194858088, 1.0)
ATAN_DENOMINATOR = (216.39071649356546, 395.2026805597862, 221.28030457728576, 38.52581906567293, 1.0)
"""2 atan(t)/t = scale * numerator / denominator, in powers of t^2; the constant term is first."""

TINY = 1e-300
"""The angle of a vector shorter than this is 0."""


# A NumPy call takes up to half a microsecond longer if it must first convert a number to an array.
def _ready(*values: float) -> list[Array]:
    return [read_only(np.array(value)) for value in values]


# The last coefficient is first. Those of the tangent are for powers of the squared angle, not the squared half angle.
_TAN_NUMERATOR = _ready(*(0.5 * value / 4.0**k for k, value in enumerate(TAN_NUMERATOR)))[::-1]
_TAN_DENOMINATOR = _ready(*(value / 4.0**k for k, value in enumerate(TAN_DENOMINATOR)))[::-1]
_ATAN_NUMERATOR, _ATAN_DENOMINATOR = _ready(*ATAN_NUMERATOR)[::-1], _ready(*ATAN_DENOMINATOR)[::-1]
_ZERO, _ONE, _TWO, _TINY = _ready(0.0, 1.0, 2.0, TINY)
_EIGHTH, _QUARTER, _ATAN_SCALE = _ready(0.25 * np.pi, 0.5 * np.pi, ATAN_SCALE)


def sincos(angles: Array, work: Array) -> tuple[Array, Array, list[Array]]:
    """Return sines and cosines of ``angles`` (n, ...) [rad], which are not changed.

    ``work`` (4 n, ...) is memory for the calculation. Returned are views of it: the n rows with the sines, the n rows
    with the cosines, and the 2 n rows that are free again. Raises ValueError for an angle that is beyond ``LARGEST`` or
    not a number.
    """
    x, square, n, d = work.reshape(4, *angles.shape)
    np.copyto(x, angles)
    with np.errstate(over="ignore"):
        multiply(x, x, square)
    largest = np.maximum.reduce(square, axis=None, initial=0.0)
    if not largest <= HALF_TURN**2:
        if not largest <= LARGEST**2:
            raise ValueError(f"angles beyond {LARGEST:g} rad, or not a number")
        turns = np.rint(multiply(x, PER_TURN, n), n)
        subtract(x, multiply(turns, TURN_HIGH, d), x)
        subtract(x, multiply(turns, TURN_LOW, d), x)
        multiply(x, x, square)
    _polynomial(square, _TAN_NUMERATOR, n)
    _polynomial(square, _TAN_DENOMINATOR, d)
    multiply(n, x, n)
    multiply(n, d, x)
    multiply(n, n, n)
    multiply(d, d, d)
    add(d, n, d)
    divide(_TWO, d, d)
    multiply(x, d, x)
    multiply(n, d, n)
    subtract(_ONE, n, n)
    return x, n, [*square, *d]


def angle(y: Array, x: Array, length: Array, result: Array, a: Array, b: Array, c: Array) -> None:
    """Write the angles [rad] in [-pi, pi] of the vectors (``x``, ``y``) of known ``length`` to ``result``.

    The angle of a zero vector is 0. All arrays have the same shape; ``a``, ``b`` and ``c`` are memory for intermediate
    values.
    """
    np.abs(x, a)
    np.abs(y, b)
    np.minimum(a, b, out=result)
    np.maximum(a, b, out=c)
    subtract(a, b, a)
    add(c, length, c)
    np.maximum(c, _TINY, out=c)
    divide(result, c, result)
    multiply(result, result, c)
    _monic(c, _ATAN_NUMERATOR, b)
    multiply(result, b, result)
    _monic(c, _ATAN_DENOMINATOR, b)
    divide(result, b, result)
    multiply(result, _ATAN_SCALE, result)
    # Mirror at 45 degrees where y is larger than x, then at 90 degrees where x is negative. Zero counts as positive.
    subtract(_EIGHTH, result, result)
    np.copysign(result, a, result)
    add(result, _EIGHTH, result)
    np.copysign(result, add(x, _ZERO, a), result)
    subtract(_QUARTER, result, result)
    np.copysign(result, add(y, _ZERO, a), result)


def _polynomial(x: Array, coefficients: list[Array], result: Array) -> None:
    """Write a polynomial in ``x`` to ``result``; the last coefficient is first in ``coefficients``."""
    last, first, *rest = coefficients
    multiply(x, last, result)
    add(result, first, result)
    _horner(x, rest, result)


def _monic(x: Array, coefficients: list[Array], result: Array) -> None:
    """Like ``_polynomial`` for a last coefficient of 1, which saves a multiplication."""
    _, first, *rest = coefficients
    add(x, first, result)
    _horner(x, rest, result)


def _horner(x: Array, coefficients: list[Array], result: Array) -> None:
    for coefficient in coefficients:
        multiply(result, x, result)
        add(result, coefficient, result)
