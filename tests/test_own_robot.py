"""A robot of one's own, of four, six and eight legs, goes through every room."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import hexakin as hk
from hexakin.control.steering import SteeringController, Twist
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility import check, commanded_walk, longest_stride
from hexakin.kinematics import standing_height
from hexakin.robot.file import robot_from_tree
from hexakin.walking.gait import in_groups, wave

ROOT = Path(__file__).resolve().parent.parent
PLANE = hk.terrain.Plane()
SECTION = (ROOT / "README.md").read_text(encoding="utf-8").split("## Your own robot")[1]
TREE = yaml.safe_load(SECTION.split("```yaml\n")[1].split("```")[0])


def with_legs(count):
    """The README's robot with other legs: half of them to each side, pointing outwards."""
    legs = []
    for side in (-1.0, 1.0):
        for x in np.linspace(120.0, -120.0, count // 2).tolist():
            heading = float(np.degrees(np.arctan2(140.0 * side, x)))
            place = {"x_mm": x, "y_mm": 65.0 * side, "heading_deg": heading}
            legs.append({"name": f"leg {len(legs) + 1}", "parameters": place})
    return robot_from_tree({**TREE, "name": f"{count} legs", "num_legs": count, "legs": legs}, "mine")


ROBOTS = {count: with_legs(count) for count in (4, 6, 8)}
WALKS = {4: ("wave", 4.0), 6: ("ripple", 2.4), 8: ("ripple", 2.4)}  # gait and its cycle [s]
SPEED = 0.015  # [m/s]


def steered(count):
    gait, cycle = WALKS[count]
    return SteeringController(ROBOTS[count], Twist(SPEED), gait, cycle_duration=cycle, response=0.5, rise_duration=0.2)


@pytest.fixture(scope="module")
def planned():
    return {count: commanded_walk(steered(count), PLANE, num_cycles=2) for count in ROBOTS}


@pytest.mark.parametrize("count", ROBOTS)
def test_angles_come_back_through_forward_and_inverse_kinematics(count, rng):
    robot = ROBOTS[count]
    q = rng.uniform(robot.q_min, robot.q_max, (200, count, 3))
    feet = hk.forward_kinematics(robot, q)
    near = hk.inverse_kinematics(robot, feet, near=q)
    assert near.reachable.all() and near.within_limits.all() and not near.numerical
    np.testing.assert_allclose(near.q, q, atol=1e-7)
    every = hk.inverse_kinematics(robot, feet, branch="all")
    for branch in range(4):
        there = every.reachable[..., branch]
        back = hk.forward_kinematics(robot, np.where(there[..., None], every.q[..., branch, :], 0.0))
        np.testing.assert_allclose(back[there], feet[there], atol=1e-9)


@pytest.mark.parametrize("count", ROBOTS)
def test_the_walker_plans_a_wave_and_refuses_gaits_of_six_legs_by_name(count):
    robot = ROBOTS[count]
    plan = hk.plan_walk(robot, PLANE, num_steps=2, step_length=0.03, gait=wave(robot))
    advance = plan.T_world_body[-1, :3, 3] - plan.T_world_body[0, :3, 3]
    np.testing.assert_allclose(advance, [0.06, 0.0, 0.0], atol=1e-9)
    if count == 6:
        assert hk.plan_walk(robot, PLANE, num_steps=1).reachable.all()
        return
    for refused in (lambda: hk.plan_walk(robot, PLANE), lambda: longest_stride(robot)):
        with pytest.raises(InvalidInputError, match=f"tripod gait: {count} legs has {count} legs, expected 6"):
            refused()


@pytest.mark.parametrize("engine", ["rigid", "pybullet", "mujoco"])
@pytest.mark.parametrize("count", ROBOTS)
def test_a_simulated_robot_goes_as_far_as_it_is_told_and_does_not_fall(count, engine, planned):
    robot, controller = ROBOTS[count], steered(count)
    walk = hk.simulate(
        robot, PLANE, controller, engine=engine, time_step=0.005, max_cycles=2, settling_time=0.5
    )  # fmt: skip
    forward, left, _ = walk.T_world_body[-1, :3, 3] - walk.T_world_body[0, :3, 3]
    told = planned[count].T_world_body[-1, 0, 3] - planned[count].T_world_body[0, 0, 3]
    assert told == pytest.approx(SPEED * 1.75 * controller.cycle_duration, rel=0.15)
    assert forward == pytest.approx(told, rel=0.15) and abs(left) < 0.1 * told
    assert walk.torso_force.max() == 0.0 and walk.T_world_body[:, 2, 2].min() > np.cos(np.radians(8.0))
    assert np.abs(walk.height - standing_height(robot)).max() < 0.01


@pytest.mark.parametrize("count", ROBOTS)
def test_a_commanded_walk_is_checked(count, planned):
    report = check(ROBOTS[count], planned[count], PLANE)
    slack = {name: constraint.worst for name, constraint in report.constraints.items()}
    if count == 4:  # a crawl of duty factor 3/4 is on the edge
        assert report.binding == ("balance",) and -0.003 < slack["balance"] < 0.0
    else:
        assert report.feasible and slack["balance"] > 0.05
    assert slack["joint speed"] > 0.0 and slack["torque"] > 0.5
    slippery = check(ROBOTS[count], planned[count], hk.terrain.Ramp(0.3), friction=0.1)
    assert not slippery.feasible


def test_four_legs_are_stable_on_their_way_with_a_longer_stance():
    robot = ROBOTS[4]
    controller = SteeringController(robot, Twist(0.007), wave(robot, 0.85), cycle_duration=20.0 / 3.0, response=0.5)
    plan = commanded_walk(controller, PLANE, num_cycles=3, control_rate=10.0)
    balance = check(robot, plan, PLANE).constraints["balance"].slack
    last = plan.time > plan.time[-1] - controller.cycle_duration
    assert balance[last].min() > 0.001 > balance[~last].min()


COMPILED = """
import json, sys
import numpy as np
import hexakin as hk
from hexakin.kinematics.leg_functions import leg_functions
from numba.core import event

robot = hk.load_robot(sys.argv[1])
with event.install_recorder("numba:compile") as compilations:
    assert hk.kinematics.prepare(robot)
    q = np.tile(robot.standing_q, (20, 1, 1))
    found = hk.inverse_kinematics(robot, hk.forward_kinematics(robot, q))
    hk.jacobian(robot, q)
loops = leg_functions(robot.table).loops
hits = {name: sum(getattr(loops, name).stats.cache_hits.values()) for name in ("forward", "jacobian", "inverse")}
print(json.dumps({"compilations": len(compilations.buffer), "hits": hits, "q": found.q.tolist()}))
"""


def test_the_compiled_code_of_ones_own_leg_type_is_loaded_by_the_next_process(tmp_path):
    """The second joint is displaced along the first axis: no shipped robot has such legs."""
    pytest.importorskip("numba")
    tree = json.loads(json.dumps(TREE))
    tree["leg_table"]["rows"][1]["d"] = "h"
    tree["leg_table"]["parameters"]["h_mm"] = 10
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(tree), encoding="utf-8")

    def used():
        done = subprocess.run(
            [sys.executable, "-c", COMPILED, tmp_path / "mine.yaml"], capture_output=True, text=True,
            env={**os.environ, "HEXAKIN_CACHE": str(tmp_path / "cache")},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout), done.stderr

    first, said = used()
    assert first["compilations"] > 0 and set(first["hits"].values()) == {0}
    assert said.startswith("hexakin: compiling the kinematics of large batches")
    second, said = used()
    assert second == {"compilations": 0, "hits": {"forward": 1, "jacobian": 1, "inverse": 1}, "q": first["q"]}
    assert said == ""


def test_a_pace_has_a_report_too():
    """The robot stands on the feet of one side: a force problem that HiGHS' simplex leaves open."""
    robot = robot_from_tree(TREE, "mine")
    controller = SteeringController(robot, Twist(0.05), in_groups("pace", ((0, 1, 2), (3, 4, 5))))
    report = check(robot, commanded_walk(controller, PLANE, num_cycles=2), PLANE)
    assert report.binding == ("balance",) and report.constraints["balance"].worst < -0.1


def test_the_readmes_robot_is_that_of_its_notebook():
    notebook = json.loads((ROOT / "notebooks" / "d1_your_robot.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    (mine,) = (cell for cell in cells if cell.startswith('MINE = """'))
    assert yaml.safe_load(mine.split('"""\\\n')[1].split('"""')[0]) == TREE
