"""Precision of ATHENA's kinematics: the forward kinematics against 50 digits, the inverse by its residual.

    python tests/benchmarks/precision.py [leg poses]

All three codes are checked (one pose at a time, NumPy, compiled loops). The flags for reach and limits of the inverse
are tested in ``tests/test_evaluation.py``, with fewer poses. Nothing is timed here.
"""

import contextlib
import sys

import mpmath
import numpy as np

import hexakin as hk
from hexakin.kinematics import evaluation

athena = hk.load_robot("athena")
LENGTH = athena.parameters[:, 1:].sum(axis=1).min()  # [m] from the body's origin to the stretched leg's foot
FORWARD_ULP, INVERSE_RESIDUAL = 4.0, 1e-14  # units in the last place of LENGTH; [m]


@contextlib.contextmanager
def without_numba():
    """Switch the compiled loops off."""
    loops, evaluation._loops = evaluation._loops, lambda *_: None
    try:
        yield
    finally:
        evaluation._loops = loops


def forward_errors(rng, count):
    """Return the largest error of each code in ``count`` poses, in units in the last place of the leg's length."""
    q = rng.uniform(-np.pi, np.pi, (count, 6, 3))
    with without_numba():
        arrays = hk.forward_kinematics(athena, q)
    found = {"scalar": np.array([hk.forward_kinematics(athena, one) for one in q]), "arrays": arrays}
    found["compiled"] = hk.forward_kinematics(athena, q)
    worst = dict.fromkeys(found, 0.0)
    unit = np.spacing(LENGTH)
    with mpmath.workdps(50):
        for leg in range(6):
            theta_1, l_1, l_2, l_3, l_4 = (mpmath.mpf(float(value)) for value in athena.parameters[leg])
            for pose in range(count):
                a, b, c = (mpmath.mpf(float(value)) for value in q[pose, leg])
                (cos_1, sin_1), (cos_a, sin_a) = mpmath.cos_sin(theta_1), mpmath.cos_sin(theta_1 + a)
                (cos_b, sin_b), (cos_c, sin_c) = mpmath.cos_sin(b), mpmath.cos_sin(b + c)
                radius = l_2 + l_3 * cos_b + l_4 * cos_c
                exact = l_1 * cos_1 + radius * cos_a, l_1 * sin_1 + radius * sin_a, l_3 * sin_b + l_4 * sin_c
                for name, foot in found.items():
                    errors = (abs(mpmath.mpf(float(v)) - e) for v, e in zip(foot[pose, leg], exact, strict=True))
                    worst[name] = max(worst[name], float(max(errors)) / unit)
    return worst


def inverse_residuals(rng, count):
    """Return by code and branch the largest distance [m] between a foot and the foot of its angles."""
    target = hk.forward_kinematics(athena, rng.uniform(athena.q_min, athena.q_max, (count, 6, 3)))
    residuals = {}
    for name, context in (("compiled", contextlib.nullcontext), ("arrays", without_numba)):
        with context():
            every = hk.inverse_kinematics(athena, target, branch="all")
            for branch in range(4):
                there = every.reachable[..., branch]
                back = hk.forward_kinematics(athena, np.where(there[..., None], every.q[..., branch, :], 0.0))
                residuals[name, branch] = np.abs(back - target)[there].max()
    return residuals


def check(leg_poses=100_000):
    """Print the errors; raise AssertionError if one is too large."""
    rng = np.random.default_rng(5)
    evaluation.prepare(athena)
    count = leg_poses // 6 + 1
    for name, value in forward_errors(rng, count).items():
        print(f"forward, {name}: error at most {value:.2f} ulp of {LENGTH:.3f} m in {6 * count} leg poses")
        assert value <= FORWARD_ULP, f"forward, {name}: {value} ulp"
    for (name, branch), residual in inverse_residuals(rng, 10 * count).items():
        print(f"inverse, {name}, branch {branch}: residual at most {residual:.1e} m")
        assert residual <= INVERSE_RESIDUAL, f"inverse, {name}, branch {branch}: {residual} m"


if __name__ == "__main__":
    check(*map(int, sys.argv[1:2]))
