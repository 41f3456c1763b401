"""What one does with hexakin, each once: kinematics, a plan, a check, walks on both engines, a recording, a figure.

    python tests/wheel/use.py ENGINE

ENGINE is the engine that hk.simulate must choose by itself: pybullet, or rigid where PyBullet is not installed.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import hexakin as hk
from hexakin.figures import robot_3d

default = sys.argv[1]
assert Path(hk.__file__).is_relative_to(sys.prefix), f"{hk.__file__} is not the installed package"

robot, ramp = hk.load_robot("athena"), hk.terrain.Ramp()
feet = hk.forward_kinematics(robot, robot.standing_q)
solution = hk.inverse_kinematics(robot, feet)
assert solution.reachable.all()
np.testing.assert_allclose(hk.forward_kinematics(robot, solution.q), feet, atol=1e-12)

plan = hk.plan_walk(hk.load_robot("hwr"), ramp, num_steps=2, step_length=0.05, heading=1.57)
assert np.isfinite(plan.q).all()

controller = hk.PostureController(robot, k_z=0.8)
assert hk.feasibility.check(robot, hk.feasibility.commanded_walk(controller, ramp), ramp).feasible

motion = hk.feasibility.commanded_walk(controller, ramp, num_cycles=1)
try:
    dataclasses.replace(motion, carrying=motion.carrying.astype(int))
except hk.exceptions.InvalidInputError as error:  # the annotations of arrays are checked with this NumPy
    assert "carrying: expected an array of True and False" in str(error), error
else:
    raise AssertionError("numbers passed as flags")

walks = {"": hk.simulate(robot, ramp, controller, duration=1.0, seed=0)}
for engine in ("rigid", "mujoco", "pybullet"):
    try:
        walks[engine] = hk.simulate(robot, ramp, controller, engine=engine, duration=1.0, seed=0)
    except hk.exceptions.MissingPackageError as error:
        assert (engine, default) == ("pybullet", "rigid"), f"{engine} does not run: {error}"
        assert "'pybullet'" in str(error) and 'engine="rigid"' in str(error), error
assert walks[""].parameters["engine"] == default
assert np.array_equal(walks[""].T_world_body, walks[default].T_world_body), "equal runs give equal walks"

walks["rigid"].save("walk.npz")
assert np.array_equal(hk.load_recording("walk.npz").q, walks["rigid"].q)

figure = Figure()
axes = robot_3d.axes_3d(figure)
robot_3d.draw_robot(axes, robot, robot.standing_q, np.eye(4))
figure.savefig("robot.png")
assert Path("robot.png").stat().st_size > 10_000

print(f"{default} is the default")
