"""Time ``plan_walk`` (7 steps, 6 legs, 100 samples per step) and a plain loop over samples and legs.

    python tests/benchmarks/plan_walk.py [--quick]

The loop uses no arrays: for each sample and leg it computes a point of a cycloid, a change of frame and the paper's
inverse formulas with ``math``, for flat ground only and without checks. The results of both are compared first.
"""

import math

import numpy as np
from comparison import alone, compared, interleaved, timed

import hexakin as hk

NUM_STEPS, STEP, SAMPLES = 7, 0.05, 100


def loop(robot, footholds, height):
    """Return joint angles (n, 6, 3) [rad] on flat ground, computed one number at a time, as in B(12)-(13)."""
    _, _, r_1, l_2, l_3 = (float(value) for value in robot.parameters[0])
    mounts = robot.parameters[:, :2].tolist()
    q = []
    for sample in range(NUM_STEPS * SAMPLES + 1):
        progress = sample / SAMPLES
        step = min(int(progress), NUM_STEPS - 1)
        part = progress - step
        before, after = footholds[step], footholds[step + 1]
        bx = sum((1 - part) * a[0] + part * b[0] for a, b in zip(before, after, strict=True)) / 6
        by = sum((1 - part) * a[1] + part * b[1] for a, b in zip(before, after, strict=True)) / 6
        row = []
        for leg in range(6):
            phase = min(max(2 * part - (leg % 2), 0.0), 1.0)
            start, end = before[leg], after[leg]
            dx, dy = end[0] - start[0], end[1] - start[1]
            length = math.hypot(dx, dy)
            radius, angle = length / (2 * math.pi), 2 * math.pi * phase
            along, z = radius * (angle - math.sin(angle)), radius * (1 - math.cos(angle))
            x = start[0] + along * dx / length - bx - mounts[leg][0]
            y = start[1] + along * dy / length - by - mounts[leg][1]
            up = z - height - r_1
            reach = math.hypot(x, y)
            square = reach**2 + up**2
            knee = math.acos((square - l_2**2 - l_3**2) / (2 * l_2 * l_3))
            hip = math.atan2(-up, reach) - math.atan2(l_3 * math.sin(knee), l_2 + l_3 * math.cos(knee))
            row.append((math.atan2(y, x), hip, knee))
        q.append(row)
    return np.array(q)


def measure(quick=False):
    """Return one row."""
    robot = hk.load_robot("hwr")

    def planned():
        return hk.plan_walk(robot, hk.terrain.Plane(), NUM_STEPS, STEP, samples_per_step=SAMPLES)

    plan = planned()
    footholds, height = plan.footholds.tolist(), float(plan.T_world_body[0, 2, 3])
    assert np.abs(loop(robot, footholds, height) - plan.q).max() < 1e-9
    timings = {"plan_walk": timed(planned), "plain loop": timed(lambda: loop(robot, footholds, height))}
    times = interleaved(timings, 5 if quick else 31)
    return compared("walk plan", len(plan.q), "sample", times, {("plan_walk", "plain loop"): None})


if __name__ == "__main__":
    alone(measure)
