"""Time the feasibility check of a long walk in one call, and the same check with one call per instant.

    python tests/benchmarks/feasibility_check.py [--quick]

The walk is paper B's, on a ramp. Each check has all constraints, with the force distribution (friction cones as
pyramids with 16 sides). Leg functions and solvers are set up before. With one call per instant, each call has two
instants, because the speed of a joint needs the instant before. The results are compared first.
"""

import dataclasses

import numpy as np
from comparison import alone, compared, interleaved, timed

import hexakin as hk
from hexakin.feasibility import check
from hexakin.motion.motion import motion_of

INSTANTS = 1000


def measure(quick=False):
    """Return one row."""
    robot, ramp = hk.load_robot("hwr"), hk.terrain.Ramp(heading=0.0)
    plan = hk.plan_walk(robot, ramp, num_steps=INSTANTS // 40, step_length=0.05, samples_per_step=40)
    motion = cut(motion_of(robot, plan), slice(0, INSTANTS))
    pairs = [cut(motion, slice(max(k - 1, 0), k + 1)) for k in range(INSTANTS)]  # a speed needs the instant before

    def at_once():
        return check(robot, motion, ramp)

    def one_by_one():
        return [check(robot, pair, ramp) for pair in pairs]

    whole, single = at_once(), one_by_one()
    assert whole.feasible and all(report.feasible for report in single)
    costs = np.array([report.forces.cost[-1] for report in single])
    np.testing.assert_allclose(whole.forces.cost, costs, rtol=1e-7)
    times = interleaved({"at once": timed(at_once), "one by one": timed(one_by_one)}, 2 if quick else 7)
    return compared("feasibility check", INSTANTS, "instant", times, {("at once", "one by one"): None})


def cut(motion, span):
    """Return the part of a motion in a slice of instants."""
    arrays = {f.name: getattr(motion, f.name) for f in dataclasses.fields(motion)}
    return dataclasses.replace(motion, **{n: a[span] for n, a in arrays.items() if isinstance(a, np.ndarray)})


if __name__ == "__main__":
    alone(measure)
