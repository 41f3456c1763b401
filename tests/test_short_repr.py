"""What is printed of objects with long arrays."""

import copy
import pickle

import numpy as np

import hexakin as hk
from hexakin.motion.motion import motion_of


def test_results_are_printed_in_one_line_and_not_by_their_arrays(athena):
    ground = hk.terrain.Plane()
    controller = hk.PostureController(athena)
    walk = hk.simulate(athena, ground, controller, engine="rigid", duration=0.3, time_step=0.002)
    plan = hk.plan_walk(athena, ground, num_steps=2, step_length=0.03)
    report = hk.feasibility.check(athena, plan, ground)
    assert repr(walk) == "Recording(robot athena, terrain Plane(z=0.0), engine rigid, 6 ticks, 0.25 s)"
    assert repr(report) == f"FeasibilityReport(feasible; {len(plan.time)} instants)"
    assert repr(motion_of(walk)).startswith(
        "Motion(time (6,), T_world_body (6, 4, 4), p_body_foot (6, 6, 3), q (6, 6, 3)"
    )
    shown = [walk, plan, report, report.motion, report.forces, *report.constraints.values()]
    assert all("\n" not in repr(value) and len(repr(value)) < 800 for value in shown)


def test_a_recording_without_parameters_is_printed_and_copied(athena):
    walk = hk.simulate(
        athena, hk.terrain.Plane(), hk.PostureController(athena), engine="rigid", duration=0.1, time_step=0.002
    )
    named = {name: values for name, values in walk.columns.items() if name not in walk.diagnostics}
    bare = hk.Recording(**named)
    assert repr(bare) == "Recording(robot unknown, terrain unknown, engine unknown, 2 ticks, 0.05 s)"
    for again in (copy.deepcopy(bare), pickle.loads(pickle.dumps(bare))):
        assert repr(again) == repr(bare) and np.array_equal(again.q, bare.q)
