"""Walks of ATHENA at friction coefficients at which contact problems are hard."""

import numpy as np

import hexakin as hk

FRICTION = (3.0, 50.0)
GROUNDS = {"level": hk.terrain.Plane, "blocks": hk.terrain.Blocks}
CYCLES = 20
COLUMNS = ("friction", "ground", "seed", "cycles", "unsolved steps", "worst residual", "stopped")


def walk(friction, ground, seed):
    """Return a row of the table: of a walk of 20 gait cycles from a start with this ``seed``."""
    robot = hk.load_robot("athena")
    controller = hk.PostureController(robot)
    try:
        recording = hk.simulate(
            robot, GROUNDS[ground](), controller, engine="rigid", friction=friction, max_cycles=CYCLES, seed=seed,
            duration=120.0,
        )  # fmt: skip
    except hk.exceptions.SimulationError as error:
        return friction, ground, seed, 0, 0, np.inf, str(error)
    cycles = len(hk.measures.per_cycle(recording).height)
    return friction, ground, seed, cycles, int(recording.unsolved_steps.sum()), recording.solver_residual.max(), ""
