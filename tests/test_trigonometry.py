"""Sine, cosine and the angle of a vector: their coefficients derived again, and their errors against mpmath."""

import mpmath
import numpy as np
import pytest

from hexakin.numerics import trigonometry


def solved(rows, right):
    return [1.0, *map(float, mpmath.lu_solve(mpmath.matrix(rows), mpmath.matrix(right)))]


def chebyshev_points(top, count):
    """Points of [0, top] in which to interpolate, with the first one moved to 0."""
    points = [top / 2 * (1 - mpmath.cos((2 * k + 1) * mpmath.pi / (2 * count + 2))) for k in range(count + 1)]
    return [(point - points[0]) * top / (top - points[0]) for point in points[1:]]


def sincos(x):
    """The sine and cosine of a list of angles."""
    (sine,), (cosine,), _ = trigonometry.sincos(x[None], np.empty((4, len(x))))
    return sine, cosine


def angle(y, x, length):
    result = np.empty(len(x))
    trigonometry.angle(y, x, length, result, *np.empty((3, len(x))))
    return result


def test_the_coefficients_of_the_tangent_are_those_of_an_interpolation():
    mpmath.mp.dps = 50
    top = (mpmath.pi / 2 * mpmath.mpf("1.0001")) ** 2
    rows, right = [], []
    for z in chebyshev_points(top, 8):
        s, c = mpmath.sin(mpmath.sqrt(z)) / mpmath.sqrt(z), mpmath.cos(mpmath.sqrt(z))
        # (1 + n_1 z + ...) c = (1 + d_1 z + ...) s
        rows.append([c * z**k for k in range(1, 5)] + [-s * z**k for k in range(1, 5)])
        right.append(s - c)
    found = solved(rows, right)
    assert found[:5] == list(trigonometry.TAN_NUMERATOR)
    assert [1.0, *found[5:]] == list(trigonometry.TAN_DENOMINATOR)


def test_the_coefficients_of_the_arctangent_are_those_of_an_interpolation():
    mpmath.mp.dps = 40
    top = mpmath.tan(mpmath.pi / 8) ** 2 * mpmath.mpf("1.0001")
    rows, right = [], []
    for z in chebyshev_points(top, 7):
        f = mpmath.atan(mpmath.sqrt(z)) / mpmath.sqrt(z)
        # 1 + n_1 z + ... = (1 + d_1 z + ...) f
        rows.append([z**k for k in range(1, 4)] + [-f * z**k for k in range(1, 5)])
        right.append(f - 1)
    found = [mpmath.mpf(1), *mpmath.lu_solve(mpmath.matrix(rows), mpmath.matrix(right))]
    numerator, denominator = found[:4], [mpmath.mpf(1), *found[4:]]
    assert [float(value / numerator[-1]) for value in numerator] == list(trigonometry.ATAN_NUMERATOR)
    assert [float(value / denominator[-1]) for value in denominator] == list(trigonometry.ATAN_DENOMINATOR)
    assert float(2 * numerator[-1] / denominator[-1]) == trigonometry.ATAN_SCALE


def test_a_turn_is_split_so_that_whole_turns_are_taken_off_exactly():
    mpmath.mp.dps = 50
    rest = 2 * mpmath.pi - mpmath.mpf(trigonometry.TURN_HIGH) - mpmath.mpf(trigonometry.TURN_LOW)
    turns = int(trigonometry.LARGEST / trigonometry.TURN) + 1
    assert abs(rest) * turns < 1e-19
    mantissa, _ = np.frexp(trigonometry.TURN_HIGH)
    assert mantissa * 2.0**31 % 1.0 == 0.0 and turns < 2**19


@pytest.mark.parametrize("size", [1.6, np.pi, 50.0, 1e6, trigonometry.LARGEST])
def test_sine_and_cosine_of_small_and_large_angles(rng, size):
    mpmath.mp.dps = 50
    x = np.concatenate([rng.uniform(-size, size, 2000), [0.0, -0.0, size, -size], np.pi / 2 * np.arange(-2, 3)])
    # The remainder of whole turns is rounded once, to 2^-52 at most.
    bound = 7e-16 if size <= trigonometry.HALF_TURN else 9e-16
    for value, sine, cosine in zip(x.tolist(), *sincos(x), strict=True):
        c, s = mpmath.cos_sin(mpmath.mpf(value))
        assert abs(sine - s) < bound and abs(cosine - c) < bound


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3.1e6, -1e300])
def test_angles_that_cannot_be_reduced_are_refused(bad):
    with pytest.raises(ValueError, match="beyond 3e"):
        sincos(np.array([0.1, bad, 4.0]))


def test_angles_are_left_as_they_are_and_the_workspace_is_all_that_is_written():
    x = np.array([[0.1, 5.0], [-2.0, 100.0]])
    before, work = x.copy(), np.empty((8, 2))
    sines, cosines, spare = trigonometry.sincos(x, work)
    assert (x == before).all() and len(spare) == 4
    assert np.abs(sines - np.sin(x)).max() < 1e-15 and np.abs(cosines - np.cos(x)).max() < 1e-15
    assert all(np.shares_memory(row, work) and not np.shares_memory(row, sines) for row in spare)


def test_the_angle_of_a_vector(rng):
    direction = np.concatenate([rng.uniform(-np.pi, np.pi, 5000), np.pi / 4 * np.arange(-4, 5)])
    length = 10.0 ** rng.uniform(-12, 3, len(direction))
    x, y = length * np.cos(direction), length * np.sin(direction)
    assert np.abs(angle(y, x, np.hypot(x, y)) - np.arctan2(y, x)).max() < 1e-15


@pytest.mark.parametrize("y", [0.0, -0.0])
@pytest.mark.parametrize("x", [0.0, -0.0])
def test_the_zero_vector_has_the_angle_zero(x, y):
    assert angle(np.array([y]), np.array([x]), np.array([0.0])) == 0.0
