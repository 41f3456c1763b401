"""The formulas of ``trigonometry`` for single numbers, for compiled loops that become vector instructions.

LLVM vectorises a loop only if it has no branch, call or exception. Rounding is therefore done by an addition, and
``maximum`` by a conditional expression. Products and sums may be fused, so that the last bits differ from NumPy's.
"""

from __future__ import annotations

import math

from hexakin.checks import Array
from hexakin.numerics.numba_cache import contracted, kernel
from hexakin.numerics.trigonometry import (
    ATAN_DENOMINATOR,
    ATAN_NUMERATOR,
    ATAN_SCALE,
    HALF_TURN,
    LARGEST,
    PER_TURN,
    ROUNDING,
    TAN_DENOMINATOR,
    TAN_NUMERATOR,
    TINY,
    TURN_HIGH,
    TURN_LOW,
)

__all__ = ["angle", "contracted", "kernel", "maximum", "rounded", "sincos"]

# Coefficients for the angle instead of the half angle.
_N0, _N1, _N2, _N3, _N4 = (0.5 * value / 4.0**k for k, value in enumerate(TAN_NUMERATOR))
_D1, _D2, _D3, _D4 = (value / 4.0**k for k, value in enumerate(TAN_DENOMINATOR) if k)
_P0, _P1, _P2, _ = ATAN_NUMERATOR
_Q0, _Q1, _Q2, _Q3, _ = ATAN_DENOMINATOR


@contracted
def _sincos(x: float) -> tuple[float, float]:
    z = x * x
    # Estrin's scheme: short chains of operations, so that many run at the same time.
    zz = z * z
    n = (((_N4 * zz + (_N3 * z + _N2)) * zz) + (_N1 * z + _N0)) * x
    d = ((_D4 * zz + (_D3 * z + _D2)) * zz) + (_D1 * z + 1.0)
    scale = 1.0 / (d * d + n * n)
    return (n + n) * d * scale, (d * d - n * n) * scale


@contracted
def sincos(angles: Array, sines: Array, cosines: Array) -> int:
    """Write the sines and cosines of ``angles`` (n,) [rad] to ``sines`` and ``cosines`` (n,).

    Return 1 if an angle is beyond ``LARGEST`` or not a number, otherwise 0. This is a separate loop because a short
    loop body lets the processor work on more angles at the same time.
    """
    far, lost = 0, 0
    for k in range(angles.shape[0]):
        far += not (abs(angles[k]) <= HALF_TURN)
        sines[k], cosines[k] = _sincos(angles[k])
    if far > 0:
        for k in range(angles.shape[0]):
            lost += not (abs(angles[k]) <= LARGEST)
            turns = rounded(angles[k] * PER_TURN)
            sines[k], cosines[k] = _sincos((angles[k] - turns * TURN_HIGH) - turns * TURN_LOW)
    return lost > 0


@contracted
def rounded(x: float) -> float:
    """Return the whole number nearest to ``x``."""
    return (x + ROUNDING) - ROUNDING


@contracted
def maximum(a: float, b: float) -> float:
    """Return the larger of ``a`` and ``b``."""
    return a if a > b else b


@contracted
def angle(y: float, x: float, length: float) -> float:
    """Return the angle [rad] of the vector (``x``, ``y``) of known ``length``; 0 for the zero vector."""
    a, b = abs(x), abs(y)
    larger, smaller = (a, b) if a > b else (b, a)
    t = smaller / maximum(larger + length, TINY)
    z = t * t
    zz = z * z
    n = (z + _P2) * zz + (_P1 * z + _P0)
    d = (zz + (_Q3 * z + _Q2)) * zz + (_Q1 * z + _Q0)
    t *= ATAN_SCALE * n / d
    t = 0.5 * math.pi - t if b > a else t
    t = math.pi - t if x < 0.0 else t
    return -t if y < 0.0 else t
