"""Sine and cosine together, and the angle of a vector, of whole arrays, in additions, multiplications and divisions.

NumPy leaves these functions to the C library, element by element, on most machines; that costs as much as a hundred of
NumPy's own multiplications. The formulas are free of branches, so that ``hexakin.compiled_elementary`` can use the same
ones in loops that become vector instructions.

- Sine and cosine of r follow from tan(r/2) = n/d as 2nd/(n^2 + d^2) and (d^2 - n^2)/(n^2 + d^2). With y = r/2,
  n = y N(y^2) and d = D(y^2), polynomials of degree 4 that meet n cos y = d sin y in Chebyshev's points up to pi/2.
- The angle of a vector with smaller component b and larger one a is twice the arctangent of b/(a + |(a, b)|), which is
  at most tan(pi/8): t N(t^2)/D(t^2) of degrees 3 and 4. Both end in 1, which saves a multiplication each.

``tests/test_elementary.py`` derives the coefficients again. Errors: 5e-16 of sine and cosine of
arguments up to ``HALF_TURN``, 8e-16 up to ``LARGEST``, 1e-15 rad of an angle.
"""

from __future__ import annotations

import numpy as np

from hexakin.transforms import Array

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


def to_half_turn(x: Array) -> tuple[Array, bool]:
    """Return angles [rad] that are at most ``HALF_TURN``, whole turns away from ``x``, and whether all were possible.

    Beyond ``LARGEST`` they are not, nor for what is no number.
    """
    largest = max(x.max(initial=0.0), -x.min(initial=0.0))
    if largest <= HALF_TURN:
        return x, True
    if not largest <= LARGEST:
        return x, False
    turns = np.rint(x * PER_TURN)
    return (x - turns * TURN_HIGH) - turns * TURN_LOW, True


def sincos(x: Array) -> tuple[Array, Array]:
    """Sine and cosine of angles ``x`` up to ``HALF_TURN`` [rad], of any shape."""
    # Every operation in place: a temporary costs more than the arithmetic.
    n = np.multiply(x, 0.5, order="C")
    square = n * n
    d = _polynomial(square, TAN_DENOMINATOR)
    n *= _polynomial(square, TAN_NUMERATOR)
    sine = n * d
    sine += sine
    n *= n
    d *= d
    cosine = d - n
    d += n
    sine /= d
    cosine /= d
    return sine, cosine


def angle(y: Array, x: Array, length: Array) -> Array:
    """Angle [rad] of vectors (``x``, ``y``) of known ``length`` in [-pi, pi]; 0 of the zero vector."""
    a, b = np.abs(x), np.abs(y)
    t = np.minimum(a, b)
    divisor = np.maximum(a, b)
    divisor += length
    np.maximum(divisor, TINY, out=divisor)
    t /= divisor
    square = t * t
    t *= _monic(square, ATAN_NUMERATOR)
    t /= _monic(square, ATAN_DENOMINATOR)
    t *= ATAN_SCALE
    # Mirrored at 45 degrees where b is the larger, then at 90 degrees where x is negative.
    np.subtract(0.25 * np.pi, t, out=t)
    a -= b
    np.copysign(t, a, out=t)
    t += 0.25 * np.pi
    np.copysign(t, np.add(x, 0.0, out=a), out=t)
    np.subtract(0.5 * np.pi, t, out=t)
    return np.copysign(t, np.add(y, 0.0, out=a), out=t)


def _polynomial(x: Array, coefficients: tuple[float, ...]) -> Array:
    *rest, last = coefficients
    result = x * last
    for coefficient in rest[:0:-1]:
        result += coefficient
        result *= x
    result += rest[0]
    return result


def _monic(x: Array, coefficients: tuple[float, ...]) -> Array:
    """Value of a polynomial whose last coefficient is 1."""
    *rest, last, _ = coefficients
    result = x + last
    for coefficient in rest[::-1]:
        result *= x
        result += coefficient
    return result
