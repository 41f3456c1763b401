"""Time the set-up and a step on a height field of 2001 x 2001 points against one of 61 x 61 points, on each engine.

    python tests/benchmarks/height_fields.py [--quick]

Both fields are 6 m x 6 m of the same hills, in cells of 3 mm and of 100 mm. ATHENA follows the same commands of a walk
on both. It is checked first that the bodies stay within a few millimetres of each other. A set-up makes the engine and
places the robot; the first one of a terrain also prepares the terrain. ``rigid_engine.py`` takes these rows into its
own.
"""

import sys
import time

import numpy as np
from comparison import compared, interleaved

import hexakin as hk
from hexakin.engines import engine_class
from hexakin.simulation.closed_loop import starting_pose

FINE, COARSE = 2001, 61
TICKS, STEPS_PER_TICK = 40, 50
LONGEST_STEP = 1.5  # bar: time of a step on the fine field / time on the coarse one
FIRST, AGAIN = 1.0, 0.1  # [s] bars for the set-up, for the first time and for the same terrain again
APART = 0.01  # [m], largest distance between the bodies on the two fields

athena = hk.load_robot("athena")


def hills(points):
    """Return the field with this number of points along each side."""
    grid = np.linspace(-3.0, 3.0, points)
    return hk.terrain.HeightField(grid, grid, 0.05 * np.sin(3.0 * grid[:, None]) * np.cos(2.0 * grid))


def set_up(name, terrain):
    """Return an engine with the robot in place, and the time that this takes [s]."""
    T = starting_pose(athena, terrain, athena.standing_q)
    start = time.thread_time()
    engine = engine_class(name)(athena, terrain)
    engine.place(T, athena.standing_q)
    return engine, time.thread_time() - start


def closed(name, terrain):
    """Return the time of a set-up [s]."""
    engine, taken = set_up(name, terrain)
    engine.close()
    return taken


def walked(name, terrain, commands):
    """Return the time of a step [s] and the path (n, 3) [m] of the body under ``commands``."""
    engine, _ = set_up(name, terrain)
    engine.advance(commands[0], 500)
    start = time.thread_time()
    path = [engine.advance(command, STEPS_PER_TICK).T_world_body[:3, 3] for command in commands]
    taken = time.thread_time() - start
    engine.close()
    return taken / (len(commands) * STEPS_PER_TICK), np.array(path)


def measure(quick=False):
    """Return the rows of set-up and step on both engines."""
    repetitions, rows = 2 if quick else 7, []
    fields = {points: hills(points) for points in (COARSE, FINE)}
    controller = hk.PostureController(athena)
    commands = hk.simulate(athena, fields[COARSE], controller, engine="rigid", duration=4.0).q_command[:TICKS]
    size = len(commands) * STEPS_PER_TICK
    for name in ("rigid", "pybullet"):
        codes = {points: f"{name}, {points} x {points} points" for points in fields}
        coarse, fine = (walked(name, field, commands)[1] for field in fields.values())
        apart = np.abs(coarse - fine).max()
        print(f"  {name}: bodies at most {1e3 * apart:.1f} mm apart")
        assert apart < APART, f"{name}: {apart} m between the paths on the two fields"
        timings = {
            codes[points]: lambda name=name, field=field: size * walked(name, field, commands)[0]
            for points, field in fields.items()
        }
        times, pair = interleaved(timings, repetitions), {(codes[FINE], codes[COARSE]): LONGEST_STEP}
        rows += compared("step, hills", size, "step", times, pair)
        timings = {
            f"{name}, first": lambda name=name: closed(name, hills(FINE)),
            f"{name}, again": lambda name=name: closed(name, fields[FINE]),
        }
        rows += compared(
            f"set-up, hills of {FINE} x {FINE} points", 1, "set-up", interleaved(timings, repetitions),
            {(f"{name}, first", f"{name}, again"): None},
        )  # fmt: skip
        for what, seconds, bar in (("first", rows[-1].seconds, FIRST), ("again", rows[-1].seconds_against, AGAIN)):
            print(f"  {name}: set-up {what} {seconds:.3f} s, bar {bar} s: {'met' if seconds <= bar else 'not met'}")
    return rows


if __name__ == "__main__":
    for row in measure("--quick" in sys.argv[1:]):
        print(row)
