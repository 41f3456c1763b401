"""The formulas of ``hexakin.elementary`` for one number each, for compiled loops that become vector instructions.

For LLVM to vectorise it a loop must have no branch, call or exception: hence rounding by an addition, and a largest of
two as a choice. Products and sums may be fused, so that the last bits differ from NumPy's.
"""

from __future__ import annotations

import math

from hexakin.compiled import contracted, kernel
from hexakin.elementary import (
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
from hexakin.transforms import Array

__all__ = ["angle", "contracted", "kernel", "maximum", "rounded", "sincos", "to_half_turn"]

_N1, _N2, _N3, _N4 = TAN_NUMERATOR[1:]
_D1, _D2, _D3, _D4 = TAN_DENOMINATOR[1:]
_P0, _P1, _P2, _ = ATAN_NUMERATOR
_Q0, _Q1, _Q2, _Q3, _ = ATAN_DENOMINATOR


@contracted
def sincos(x: float) -> tuple[float, float]:
    """Sine and cosine of an angle up to ``HALF_TURN`` [rad]."""
    y = 0.5 * x
    z = y * y
    # Short chains of operations, many at once (Estrin's scheme).
    zz = z * z
    n = (((_N4 * zz + (_N3 * z + _N2)) * zz) + (_N1 * z + 1.0)) * y
    d = ((_D4 * zz + (_D3 * z + _D2)) * zz) + (_D1 * z + 1.0)
    scale = 1.0 / (d * d + n * n)
    return (n + n) * d * scale, (d * d - n * n) * scale


@contracted
def rounded(x: float) -> float:
    """The nearest whole number."""
    return (x + ROUNDING) - ROUNDING


@contracted
def maximum(a: float, b: float) -> float:
    """The larger of two numbers."""
    return a if a > b else b


@contracted
def angle(y: float, x: float, length: float) -> float:
    """Angle [rad] of the vector (``x``, ``y``) of known ``length``; 0 of the zero vector."""
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


@contracted
def to_half_turn(angles: Array, scratch: Array) -> int:
    """Say whether all ``angles`` are at most ``HALF_TURN`` (0); if not, write them less whole turns into ``scratch``.

    Returns 1 then, and 2 if one is beyond ``LARGEST`` or not a number.
    """
    far, lost = 0, 0
    for k in range(angles.shape[0]):
        far += not (abs(angles[k]) <= HALF_TURN)
    if far == 0:
        return 0
    for k in range(angles.shape[0]):
        lost += not (abs(angles[k]) <= LARGEST)
        turns = rounded(angles[k] * PER_TURN)
        scratch[k] = (angles[k] - turns * TURN_HIGH) - turns * TURN_LOW
    return 2 if lost > 0 else 1
