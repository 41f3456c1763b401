"""Sine and cosine together, and the angle of a vector, of whole arrays, in additions, multiplications and divisions.

NumPy leaves these functions to the C library, element by element, on most machines; that costs as much as a hundred of
NumPy's own multiplications. The formulas are free of branches, so that ``trigonometry_loops`` beside this module can
use the same ones in loops that become vector instructions.

- Sine and cosine of r follow from tan(r/2) = n/d as 2nd/(n^2 + d^2) and 1 - 2n^2/(n^2 + d^2). With y = r/2,
  n = y N(y^2) and d = D(y^2), polynomials of degree 4 that meet n cos y = d sin y in Chebyshev's points up to pi/2.
- The angle of a vector with smaller component b and larger one a is twice the arctangent of b/(a + |(a, b)|), which is
  at most tan(pi/8): t N(t^2)/D(t^2) of degrees 3 and 4. Both end in 1, which saves a multiplication each.

``tests/test_trigonometry.py`` derives the coefficients again. Errors: 7e-16 of sine and cosine of
arguments up to ``HALF_TURN``, 9e-16 up to ``LARGEST``, 1e-15 rad of an angle.
"""

from __future__ import annotations

import numpy as np
from numpy import add, divide, multiply, subtract

from hexakin.checks import Array, read_only

LARGEST = 3e6
"""[rad]: largest argument of sine and cosine; the turns taken off are then less than 2^19."""

HALF_TURN = 3.1416
"""[rad]: arguments up to here, a little more than pi, are used as they are."""

TURN = 2.0 * np.pi
PER_TURN = 1.0 / TURN
TURN_HIGH, TURN_LOW = float.fromhex("0x1.921fb544p+2"), 2.430840202602477e-10
"""A turn in two parts; the first has 31 bits, so that its product with a number of turns is exact (Cody and Waite)."""

ROUNDING = 1.5 * 2.0**52
"""Adding and taking this off rounds to the nearest whole number."""

TAN_NUMERATOR = (1.0, -0.13738798377541317, 0.00393865202951628, -2.9104109055730014e-05, 3.00279086521582e-08)
TAN_DENOMINATOR = (1.0, -0.4707213171087465, 0.02751242439909774, -0.0004053239291731998, 1.333804921739326e-06)
"""N and D, from the constant term up."""

ATAN_SCALE = 25.786588973609426
ATAN_NUMERATOR = (16.783198174448323, 25.05740034552689, 10.301806194858088, 1.0)
ATAN_DENOMINATOR = (216.39071649356546, 395.2026805597862, 221.28030457728576, 38.52581906567293, 1.0)
"""2 atan(t)/t is the scale times numerator / denominator, in powers of t^2 from the constant term up."""

TINY = 1e-300
"""A vector shorter than this has the angle 0."""


# A call of NumPy takes up to half a microsecond longer if it has to make an array of a number first.
def _ready(*values: float) -> list[Array]:
    return [read_only(np.array(value)) for value in values]


# From the last coefficient down; those of the tangent in powers of the angle's square instead of its half's.
_TAN_NUMERATOR = _ready(*(0.5 * value / 4.0**k for k, value in enumerate(TAN_NUMERATOR)))[::-1]
_TAN_DENOMINATOR = _ready(*(value / 4.0**k for k, value in enumerate(TAN_DENOMINATOR)))[::-1]
_ATAN_NUMERATOR, _ATAN_DENOMINATOR = _ready(*ATAN_NUMERATOR)[::-1], _ready(*ATAN_DENOMINATOR)[::-1]
_ZERO, _ONE, _TWO, _TINY = _ready(0.0, 1.0, 2.0, TINY)
_EIGHTH, _QUARTER, _ATAN_SCALE = _ready(0.25 * np.pi, 0.5 * np.pi, ATAN_SCALE)


def sincos(angles: Array, work: Array) -> tuple[Array, Array, list[Array]]:
    """Sine and cosine of ``angles`` (n, ...) [rad], which are left as they are.

    They are computed in ``work`` (4 n, ...); returned are its n rows with sines, n with cosines, and 2 n that are free.
    Raises ValueError for an angle beyond ``LARGEST`` or that is not a number.
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
    """Write the angle [rad] of vectors (``x``, ``y``) of known ``length``, in [-pi, pi], to ``result``.

    The zero vector's is 0. All arrays have the same shape; ``a``, ``b`` and ``c`` are worked on.
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
    # Mirrored at 45 degrees where y is the larger, then at 90 degrees where x is negative. A zero counts as positive.
    subtract(_EIGHTH, result, result)
    np.copysign(result, a, result)
    add(result, _EIGHTH, result)
    np.copysign(result, add(x, _ZERO, a), result)
    subtract(_QUARTER, result, result)
    np.copysign(result, add(y, _ZERO, a), result)


def _polynomial(x: Array, coefficients: list[Array], result: Array) -> None:
    """Write a polynomial to ``result``, given its coefficients from the last one down."""
    last, first, *rest = coefficients
    multiply(x, last, result)
    add(result, first, result)
    _horner(x, rest, result)


def _monic(x: Array, coefficients: list[Array], result: Array) -> None:
    """The same where the last coefficient is 1, which saves a multiplication."""
    _, first, *rest = coefficients
    add(x, first, result)
    _horner(x, rest, result)


def _horner(x: Array, coefficients: list[Array], result: Array) -> None:
    for coefficient in coefficients:
        multiply(result, x, result)
        add(result, coefficient, result)
