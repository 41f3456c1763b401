"""Vectors and matrices of three dimensions as tuples of numbers, for compiled loops.

A vector is (x, y, z) and a matrix nine numbers, row by row. LLVM keeps them in registers, where small arrays would be
written to memory and read again. A symmetric matrix is (xx, xy, xz, yy, yz, zz).
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.numerics.numba_cache import inlined

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
Symmetric = tuple[float, float, float, float, float, float]


@inlined
def entries(a: Array, first: int) -> Vector:
    """Return the three numbers of ``a`` (n,) from ``first`` on."""
    return a[first], a[first + 1], a[first + 2]


@inlined
def vector(a: Array, row: int, column: int) -> Vector:
    """Return the three numbers of ``a`` (n, k) in ``row``, from ``column`` on."""
    return a[row, column], a[row, column + 1], a[row, column + 2]


@inlined
def symmetric(a: Array, row: int, column: int) -> Symmetric:
    """Return the six numbers of ``a`` (n, k) in ``row``, from ``column`` on."""
    return (
        a[row, column], a[row, column + 1], a[row, column + 2], a[row, column + 3], a[row, column + 4],
        a[row, column + 5],
    )  # fmt: skip


@inlined
def matrix(a: Array, row: int) -> Matrix:
    """Return the first nine numbers of ``a`` (n, k) in ``row``."""
    return a[row, 0], a[row, 1], a[row, 2], a[row, 3], a[row, 4], a[row, 5], a[row, 6], a[row, 7], a[row, 8]


@inlined
def write_vector(x: Vector, a: Array, row: int, column: int) -> None:
    """Write ``x`` to ``a`` (n, k) in ``row``, from ``column`` on."""
    a[row, column], a[row, column + 1], a[row, column + 2] = x[0], x[1], x[2]


@inlined
def write_symmetric(s: Symmetric, a: Array, row: int, column: int) -> None:
    """Write ``s`` to ``a`` (n, k) in ``row``, from ``column`` on."""
    a[row, column], a[row, column + 1], a[row, column + 2] = s[0], s[1], s[2]
    a[row, column + 3], a[row, column + 4], a[row, column + 5] = s[3], s[4], s[5]


@inlined
def write_matrix(R: Matrix, a: Array, row: int) -> None:
    """Write ``R`` to ``a`` (n, k) in ``row``."""
    a[row, 0], a[row, 1], a[row, 2] = R[0], R[1], R[2]
    a[row, 3], a[row, 4], a[row, 5] = R[3], R[4], R[5]
    a[row, 6], a[row, 7], a[row, 8] = R[6], R[7], R[8]


@inlined
def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(s: float, a: Vector) -> Vector:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def rotated(R: Matrix, a: Vector) -> Vector:
    """Return R a."""
    return (
        R[0] * a[0] + R[1] * a[1] + R[2] * a[2],
        R[3] * a[0] + R[4] * a[1] + R[5] * a[2],
        R[6] * a[0] + R[7] * a[1] + R[8] * a[2],
    )


@inlined
def rotated_back(R: Matrix, a: Vector) -> Vector:
    """Return R^T a."""
    return (
        R[0] * a[0] + R[3] * a[1] + R[6] * a[2],
        R[1] * a[0] + R[4] * a[1] + R[7] * a[2],
        R[2] * a[0] + R[5] * a[1] + R[8] * a[2],
    )


@inlined
def product(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    return (
        A[0] * B[0] + A[1] * B[3] + A[2] * B[6],
        A[0] * B[1] + A[1] * B[4] + A[2] * B[7],
        A[0] * B[2] + A[1] * B[5] + A[2] * B[8],
        A[3] * B[0] + A[4] * B[3] + A[5] * B[6],
        A[3] * B[1] + A[4] * B[4] + A[5] * B[7],
        A[3] * B[2] + A[4] * B[5] + A[5] * B[8],
        A[6] * B[0] + A[7] * B[3] + A[8] * B[6],
        A[6] * B[1] + A[7] * B[4] + A[8] * B[7],
        A[6] * B[2] + A[7] * B[5] + A[8] * B[8],
    )


@inlined
def turned_about_z(R: Matrix, angle: float) -> Matrix:
    """Return R Rz(angle)."""
    s, c = np.sin(angle), np.cos(angle)
    return (
        R[0] * c + R[1] * s, R[1] * c - R[0] * s, R[2],
        R[3] * c + R[4] * s, R[4] * c - R[3] * s, R[5],
        R[6] * c + R[7] * s, R[7] * c - R[6] * s, R[8],
    )  # fmt: skip


@inlined
def rotation_of(x: float, y: float, z: float, w: float) -> Matrix:
    """Return the rotation matrix of a unit quaternion."""
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@inlined
def symmetric_times(S: Symmetric, a: Vector) -> Vector:
    """Return S a for a symmetric matrix."""
    return (
        S[0] * a[0] + S[1] * a[1] + S[2] * a[2],
        S[1] * a[0] + S[3] * a[1] + S[4] * a[2],
        S[2] * a[0] + S[4] * a[1] + S[5] * a[2],
    )


@inlined
def in_frame(R: Matrix, S: Symmetric) -> Symmetric:
    """Return R S R^T for a symmetric matrix."""
    x = symmetric_times(S, (R[0], R[1], R[2]))
    y = symmetric_times(S, (R[3], R[4], R[5]))
    z = symmetric_times(S, (R[6], R[7], R[8]))
    return (
        x[0] * R[0] + x[1] * R[1] + x[2] * R[2],
        x[0] * R[3] + x[1] * R[4] + x[2] * R[5],
        x[0] * R[6] + x[1] * R[7] + x[2] * R[8],
        y[0] * R[3] + y[1] * R[4] + y[2] * R[5],
        y[0] * R[6] + y[1] * R[7] + y[2] * R[8],
        z[0] * R[6] + z[1] * R[7] + z[2] * R[8],
    )
