"""Kinematics as ratios to what a user would write or install, in interleaved runs.

    python tests/benchmarks/kinematics.py [python of an environment with roboticstoolbox-python]

Correctness first: forward kinematics against mpmath's 50 digits, the inverse by its residual (its flags are tested in
``tests/test_batch_kinematics.py``). Then medians over repetitions of the ratio of a run to the one right beside it, in
which the machine's own speed cancels. Times are the thread's own, so that what else runs does not count; caches and the
core's units are shared all the same, and a quiet machine shows smaller ratios.

- batches of ATHENA's legs against the textbook formulas in NumPy, with compiled loops and with NumPy alone;
- six legs in one pose against the C path of the Robotics Toolbox (``ETS.fkine``, and ``ETS.eval``, which returns
  bare matrices), in a process of its own;
- the derivation against multiplying out the table's matrices and ``sympy.simplify``.
"""

import contextlib
import statistics
import subprocess
import sys
import time

import mpmath
import numpy as np
import sympy as sp

import hexakin as hk
from hexakin import batch_kinematics

athena = hk.load_robot("athena")
RNG = np.random.default_rng(5)
EXACT_POSES = 100_000
LENGTH = athena.parameters[:, 1:].sum(axis=1).min()  # [m] from the body's origin to the stretched leg's foot

TOOLBOX = """
import sys, time, numpy as np
from roboticstoolbox import ET
legs = [ET.Rz(t) * ET.tx(a) * ET.Rz() * ET.tx(b) * ET.Rx(np.pi / 2) * ET.Rz() * ET.tx(c) * ET.Rz() * ET.tx(d)
        for t, a, b, c, d in eval(sys.argv[1])]
q = np.array(eval(sys.argv[2]))
print(repr([leg.fkine(x).t.tolist() for leg, x in zip(legs, q)]), flush=True)
runs = {
    "fkine": lambda: [leg.fkine(x) for leg, x in zip(legs, q)],
    "eval": lambda: [leg.eval(x) for leg, x in zip(legs, q)],
}
for line in sys.stdin:
    run = runs[line.strip()]
    run()
    start = time.thread_time()
    for _ in range(200):
        run()
    print((time.thread_time() - start) / 200, flush=True)
"""


def user_forward(p, q):
    """A(12) as one writes it."""
    theta_1, l_1, l_2, l_3, l_4 = p.T
    angle, femur = theta_1 + q[..., 0], q[..., 1]
    tibia = femur + q[..., 2]
    radius = l_2 + l_3 * np.cos(femur) + l_4 * np.cos(tibia)
    x = l_1 * np.cos(theta_1) + radius * np.cos(angle)
    y = l_1 * np.sin(theta_1) + radius * np.sin(angle)
    return np.stack([x, y, l_3 * np.sin(femur) + l_4 * np.sin(tibia)], axis=-1)


def user_inverse(p, foot, low, high):
    """A(14)-(18) as one writes them, the knee bent the standing way: angles, reachable, within the limits."""
    theta_1, l_1, l_2, l_3, l_4 = p.T
    x, y = foot[..., 0] - l_1 * np.cos(theta_1), foot[..., 1] - l_1 * np.sin(theta_1)
    z, radius = foot[..., 2], np.hypot(x, y) - l_2
    cosine = (radius**2 + z**2 - l_3**2 - l_4**2) / (2 * l_3 * l_4)
    reachable = np.abs(cosine) <= 1.0
    knee = -np.arccos(np.clip(cosine, -1.0, 1.0))
    femur = np.arctan2(z, radius) - np.arctan2(l_4 * np.sin(knee), l_3 + l_4 * np.cos(knee))
    first = np.arctan2(y, x) - theta_1
    q = np.stack([first, femur, knee], axis=-1)
    q = (q + np.pi) % (2 * np.pi) - np.pi
    q[~reachable] = np.nan
    return q, reachable, np.all((q >= low) & (q <= high), axis=-1)


@contextlib.contextmanager
def without_numba():
    loops, batch_kinematics._loops = batch_kinematics._loops, lambda *_: None
    yield
    batch_kinematics._loops = loops


def seconds(run, repeats):
    start = time.thread_time()
    for _ in range(repeats):
        run()
    return (time.thread_time() - start) / repeats


def compared(title, runs, base, bars, repetitions=15, repeats=1):
    """Time the ``runs`` in turn and print the median of the paired ratios to the run ``base``."""
    times = {name: [] for name in runs}
    for repetition in range(repetitions + 1):
        for name, run in runs.items():
            taken = run(None) if name.startswith("toolbox") else seconds(run, repeats)
            if repetition:
                times[name].append(taken)
    for name, values in times.items():
        ratios = sorted(a / b for a, b in zip(values, times[base], strict=True))
        bar = f"   bar {bars[name]:.2f}" if name in bars else ""
        middle, spread = statistics.median(ratios), f"{ratios[0]:.3f} to {ratios[-1]:.3f}"
        print(f"{title:34s} {name:14s} {1e6 * statistics.median(values):12.1f} us   {middle:7.4f} ({spread}){bar}")


def check_precision():
    """Errors of forward kinematics in units in the last place of the leg's length, and residuals of the inverse."""
    mpmath.mp.dps = 50
    count = EXACT_POSES // 6 + 1
    q = RNG.uniform(-np.pi, np.pi, (count, 6, 3))
    with without_numba():
        arrays = hk.forward_kinematics(athena, q)
    found = {"scalar": np.array([hk.forward_kinematics(athena, one) for one in q]), "arrays": arrays}
    found["compiled"] = hk.forward_kinematics(athena, q)
    worst = dict.fromkeys(found, 0.0)
    unit = np.spacing(LENGTH)
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
    print(f"forward, {6 * count} leg poses, largest error in ulp of {LENGTH:.3f} m:  bar 4")
    for name, value in worst.items():
        print(f"    {name}: {value:.2f}")
        assert value <= 4.0, f"{name}: {value} ulp"
    target = hk.forward_kinematics(athena, RNG.uniform(athena.q_min, athena.q_max, (170_000, 6, 3)))
    for name, context in (("compiled", contextlib.nullcontext), ("arrays", without_numba)):
        with context():
            every = hk.inverse_kinematics(athena, target, branch="all")
            for branch in range(4):
                there = every.reachable[..., branch]
                back = hk.forward_kinematics(athena, np.where(there[..., None], every.q[..., branch, :], 0.0))
                residual = np.abs(back - target)[there].max()
                print(f"inverse, {name}, branch {branch}: largest residual {residual:.1e} m   bar 1e-14")
                assert residual <= 1e-14


def batches():
    low, high, p = athena.q_min, athena.q_max, athena.parameters
    for count, repetitions, repeats in ((10**3, 41, 3), (10**5, 11, 1), (10**6, 5, 1)):
        q = RNG.uniform(low, high, (count, 6, 3))
        foot = user_forward(p, q)

        def numpy_forward(q=q):
            with without_numba():
                return hk.forward_kinematics(athena, q)

        def numpy_inverse(foot=foot):
            with without_numba():
                return hk.inverse_kinematics(athena, foot)

        def numpy_jacobian(q=q):
            with without_numba():
                return hk.jacobian(athena, q)

        forward = {
            "user": lambda q=q: user_forward(p, q),
            "compiled": lambda q=q: hk.forward_kinematics(athena, q),
            "arrays": numpy_forward,
            "J compiled": lambda q=q: hk.jacobian(athena, q),
            "J arrays": numpy_jacobian,
        }
        inverse = {
            "user": lambda foot=foot: user_inverse(p, foot, low, high),
            "compiled": lambda foot=foot: hk.inverse_kinematics(athena, foot),
            "arrays": numpy_inverse,
        }
        assert np.abs(forward["compiled"]() - foot).max() < 1e-15 and np.abs(forward["arrays"]() - foot).max() < 1e-15
        solution, (users, reachable, _) = inverse["compiled"](), inverse["user"]()
        same = solution.reachable & reachable & (foot_in_front(p, foot))
        # A nearly straight leg amplifies rounding in its angles.
        assert same.mean() > 0.8 and np.abs(solution.q - users)[same].max() < 1e-6
        compared(f"forward, {count} poses", forward, "user", {"compiled": 0.05, "arrays": 0.3}, repetitions, repeats)
        compared(f"inverse, {count} poses", inverse, "user", {"compiled": 0.07, "arrays": 0.4}, repetitions, repeats)


def foot_in_front(p, foot):
    """Where the standing branch is the textbook's: the knee down, the foot before the second joint."""
    theta_1, l_1, l_2 = p.T[:3]
    hip = np.stack([l_1 * np.cos(theta_1), l_1 * np.sin(theta_1)], axis=-1)
    return np.linalg.norm(foot[..., :2] - hip, axis=-1) > l_2


def one_pose(python):
    q = RNG.uniform(athena.q_min[0], athena.q_max[0], (6, 3))
    arguments = [python, "-c", TOOLBOX, repr(athena.parameters.tolist()), repr(q.tolist())]
    runs = {"hexakin": lambda: hk.forward_kinematics(athena, q), "user": lambda: user_forward(athena.parameters, q)}
    try:
        child = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        feet = np.array(eval(child.stdout.readline()))
    except SyntaxError:
        print("one pose: no roboticstoolbox-python in", python)
        return
    assert np.abs(feet - hk.forward_kinematics(athena, q)).max() < 1e-12

    def ask(what):
        child.stdin.write(f"{what}\n")
        child.stdin.flush()
        return float(child.stdout.readline())

    runs |= {"toolbox fkine": lambda _: ask("fkine"), "toolbox eval": lambda _: ask("eval")}
    compared("forward, six legs, one pose", runs, "toolbox fkine", {"hexakin": 0.08}, 21, 200)
    foot = hk.forward_kinematics(athena, q)
    others = {
        "inverse": lambda: hk.inverse_kinematics(athena, foot),
        "all branches": lambda: hk.inverse_kinematics(athena, foot, branch="all"),
        "nearest": lambda: hk.inverse_kinematics(athena, foot, near=q),
        "Jacobian": lambda: hk.jacobian(athena, q),
        "user": lambda: user_inverse(athena.parameters, foot, athena.q_min, athena.q_max),
    }
    compared("six legs, one pose", others, "user", {}, 21, 100)
    child.stdin.close()
    child.wait()


def derivation():
    def ours():
        leg = hk.symbolic.derive(athena.table)
        return leg.forward, leg.jacobian, leg.inverse

    def simplified():
        leg = hk.symbolic.derive(athena.table)
        rows = [leg.transform(k, k + 1) for k in range(4)]
        forward = sp.simplify(rows[0] * rows[1] * rows[2] * rows[3])
        jacobian = sp.simplify(forward[:3, 3].jacobian(leg.joints))
        # The foot in the first joint's frame, from which the three angles are read.
        return forward, jacobian, sp.simplify((rows[0] * rows[1]).inv() * forward)

    times = {"ours": [], "simplify": []}
    for _ in range(3):
        for name, run in (("ours", ours), ("simplify", simplified)):
            sp.core.cache.clear_cache()
            times[name].append(seconds(run, 1))
    ratio = statistics.median(a / b for a, b in zip(times["ours"], times["simplify"], strict=True))
    own, other = min(times["ours"]), min(times["simplify"])
    print(f"derivation {own:.3f} s, by simplify {other:.2f} s, ratio {ratio:.4f}   bar 0.02")


def main():
    start = time.perf_counter()
    if not batch_kinematics.prepare(athena):
        raise SystemExit("numba is not installed")
    print(f"compiled loops ready after {time.perf_counter() - start:.1f} s")
    check_precision()
    batches()
    one_pose(sys.argv[1] if len(sys.argv) > 1 else sys.executable)
    derivation()


if __name__ == "__main__":
    main()
