"""Time the check of a long walk at once and instant by instant, in turn: medians and the ratio.

Run with ``python tests/benchmarks/feasibility_check.py [repeats] [instants]``. The walk is paper B's, on a ramp; each
check has all constraints, the force distribution (friction cones as pyramids of 16 sides) included. Set-up (the leg
functions, the solvers) is made before. One by one, each call has two instants: a joint's speed needs the one before.
The answers are compared first.
"""

import dataclasses
import statistics
import sys
import time

import numpy as np

import hexakin as hk
from hexakin.feasibility import check
from hexakin.feasibility.motion import motion_of

LIMIT = 1.0  # [s] for 1000 instants of six legs


def main() -> None:
    """Print the medians, the median of the paired ratios and their range."""
    given = [int(argument) for argument in sys.argv[1:]]
    repeats, instants = given + [5, 1000][len(given) :]
    robot, ramp = hk.load_robot("hwr"), hk.terrain.Ramp(heading=0.0)
    steps = -(-instants // 40)
    plan = hk.plan_walk(robot, ramp, num_steps=steps, step_length=0.05, samples_per_step=40)
    motion = cut(motion_of(plan), slice(0, instants))
    pairs = [cut(motion, slice(max(k - 1, 0), k + 1)) for k in range(instants)]  # a speed needs the instant before

    def at_once():
        return check(robot, motion, ramp)

    def one_by_one():
        return [check(robot, pair, ramp) for pair in pairs]

    whole, single = at_once(), one_by_one()
    assert whole.feasible and all(report.feasible for report in single)
    costs = np.array([report.forces.cost[-1] for report in single])
    np.testing.assert_allclose(whole.forces.cost, costs, rtol=1e-7)
    times = [(seconds(at_once), seconds(one_by_one)) for _ in range(repeats)]
    batch, loop = (statistics.median(column) for column in zip(*times, strict=True))
    ratios = sorted(a / b for a, b in times)
    print(f"check of {instants} instants of {robot.num_legs} legs, {repeats} pairs; answers equal")
    print(f"  at once {batch:.3f} s (bar for 1000: {LIMIT:g} s), one by one {loop:.2f} s")
    print(f"  ratio {statistics.median(ratios):.4f} (pairs {ratios[0]:.4f} to {ratios[-1]:.4f})")


def seconds(work) -> float:
    """Wall time of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def cut(motion, span):
    """Part of a motion."""
    arrays = {f.name: getattr(motion, f.name) for f in dataclasses.fields(motion)}
    return dataclasses.replace(motion, **{n: a[span] for n, a in arrays.items() if isinstance(a, np.ndarray)})


if __name__ == "__main__":
    main()
