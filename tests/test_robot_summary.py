"""The page about a robot and the page about its file: what they say is so."""

import copy
import re

import numpy as np
import pytest
import yaml

import hexakin as hk
from hexakin import robot_summary
from hexakin.installation import DATA
from hexakin.kinematics.leg_functions import reach
from hexakin.robot.file import robot_from_tree, robot_names
from hexakin.robot.schema import MASS
from hexakin.robot.schema_page import example, page, paths
from hexakin.robot_summary import remarks, summarise

ATHENA = yaml.safe_load((DATA / "robots" / "athena.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def lines(athena):
    return summarise(athena).splitlines()


def test_the_masses_of_the_bodies_sum_to_the_robots(athena, lines):
    rows = [re.match(r"  \S+ +(?:(\d+) x )?([\d.]+) kg +([\d.]+) %", line) for line in lines]
    found = [(int(row[1] or 1) * float(row[2]), float(row[3])) for row in rows if row]
    assert len(found) == 5 and lines[0] == "athena: 6 legs, 2.133 kg"
    assert sum(mass for mass, _ in found) == pytest.approx(athena.mass, abs=1e-9)
    assert sum(share for _, share in found) == pytest.approx(100.0, abs=0.3)


def test_the_standing_pose_and_its_margins_are_those_of_the_description(lines):
    assert "standing, the body's origin 104.0 mm above the ground" in lines
    # 90 degrees of the knee against -150 and 85.03; 0 of the coxa against 0.612 rad.
    assert "  right middle    foot at (204.0, 0.0, -84.0) mm, 35.1 deg from the nearest joint limit" in lines


@pytest.mark.parametrize("name", robot_names())
def test_reach_is_what_sweeping_the_third_joint_gives(name):
    robot = hk.load_robot(name)
    every = np.zeros((2001, robot.num_legs, 3))
    second = np.array([(robot.fixed_poses(leg)[0] @ robot.fixed_poses(leg)[1])[:3, 3] for leg in range(robot.num_legs)])
    for limited in (False, True):
        low, high = robot.joint_limits[:, 2].T if limited else (-np.pi, np.pi)
        every[..., 2] = np.linspace(low, high, 2001) if limited else np.linspace(low, high, 2001)[:, None]
        distance = np.linalg.norm(hk.forward_kinematics(robot, every) - second, axis=-1)
        swept = np.stack([distance.min(axis=0), distance.max(axis=0)], axis=-1)
        assert reach(robot, limited=limited) == pytest.approx(swept, abs=2e-6)


def test_reach_agrees_with_the_closed_forms_bounds(athena):
    bounds = hk.inverse_kinematics(athena, hk.forward_kinematics(athena, athena.standing_q)).reach
    assert reach(athena) == pytest.approx(bounds, abs=1e-12)


UNUSUAL = {
    "feet at different heights": (
        lambda tree: tree["legs"][2].update(standing={"theta_3": 0.2}),
        r"standing: the feet are not level, leg 3's is .* mm above the lowest",
    ),
    "a torso on the ground": (
        lambda tree: tree["standing"].update(theta_4=0),
        "standing: the torso's underside is 8 mm below the ground",
    ),
    "a joint near its limit": (
        lambda tree: tree["joint_limits"].update(theta_3=[-0.01, 1.0]),
        r"standing.theta_3 of leg 1: 0.57 deg from its limit",
    ),
    "more inertia than the box holds": (
        lambda tree: tree["torso"]["inertia"].update(yy=4.6e-3, zz=5.5e-3),
        "torso.inertia.yy: 1.5 times the largest that mass within its box can have",
    ),
    "a mass in a point": (
        lambda tree: tree["torso"].update(inertia={"xx": 1e-4, "yy": 1e-4, "zz": 1e-4}),
        "torso.inertia: less than 0.2 of a uniform box's",
    ),
    "a point foot": (lambda tree: tree["foot"].update(radius_mm=0), "foot.radius: 0, a point"),
    "two legs in one place": (
        lambda tree: tree["legs"][1].update(parameters=tree["legs"][0]["parameters"]),
        "legs: legs 1 and 2 start at the same place",
    ),
    "a torque in N mm": (
        lambda tree: tree["servo"].update(max_torque=1890.0),
        r"servo.max_torque: 1890 N m is 39\d times what one stretched leg needs .*; is it in N m\?",
    ),
    "a coxa in metres": (
        lambda tree: tree["leg_table"]["parameters"].update(l_2_mm=0.064),
        r"parameters.l_2: 6.4e-05 m; is it in m\?",
    ),
    "no speed": (lambda tree: tree["servo"].pop("max_speed"), "servo.max_speed: not given"),
}


@pytest.mark.parametrize("change, message", UNUSUAL.values(), ids=UNUSUAL.keys())
def test_what_is_unusual_is_remarked_on_and_not_refused(change, message):
    tree = copy.deepcopy(ATHENA)
    change(tree)
    robot = robot_from_tree(tree, "mine.yaml")
    found = [remark for remark in remarks(robot) if re.match(message, remark)]
    assert len(found) == 1 and f"remark: {found[0]}\n" in summarise(robot)


def test_legs_that_are_not_listed_around_the_body_are_remarked_on():
    tree = copy.deepcopy(ATHENA)
    order = ("right front", "left front", "right middle", "left middle", "right rear", "left rear")
    legs = {leg["name"]: leg for leg in tree["legs"]}
    tree["legs"] = [legs[name] for name in order]
    robot = robot_from_tree(tree, "mine.yaml")
    assert [remark[:50] for remark in remarks(robot)] == ["legs: the tripod gait stands on legs 1, 3, 5, whic"]
    walk = hk.feasibility.commanded_walk(hk.PostureController(robot), hk.terrain.Plane(), num_cycles=1)
    assert "balance" in hk.feasibility.check(robot, walk, hk.terrain.Plane()).binding


@pytest.mark.parametrize("name", robot_names())
def test_shipped_robots_list_their_legs_around_the_body(name):
    assert not any(remark.startswith("legs: the tripod") for remark in remarks(hk.load_robot(name)))


def test_athena_is_not_remarked_on(athena):
    assert remarks(athena) == ()


def test_the_old_name_of_summarise_still_works_and_warns():
    with pytest.warns(DeprecationWarning, match=r"hexakin\.robot_summary\.summary is now called summarise"):
        old = robot_summary.summary
    assert old is summarise
    with pytest.raises(AttributeError, match="no attribute 'page'"):
        robot_summary.page  # noqa: B018


# The page about the file -------------------------------------------------------------------------------------------


def test_every_field_is_documented_and_the_optional_ones_say_what_is_assumed():
    text = page()
    for path, field in paths().items():
        assert field.description, path
        extra = field.json_schema_extra
        assert bool(extra["assumed"]) == (not field.is_required()), path
        assert field.description in text and (not extra["assumed"] or f"Without it: {extra['assumed']}." in text), path
        if not path.startswith(("segments.coxa.", "segments.femur.", "segments.tibia.", "foot.inertia.")):
            bounds = extra["bounds"]
            assert re.search(rf"^{re.escape(path + (f' [{bounds.unit}]' if bounds else ''))}$", text, re.MULTILINE), (
                path
            )


def test_every_number_has_a_unit_and_bounds():
    free = {
        "num_legs",
        "forward",
        "leg_table.parameters",
        "legs.1.parameters",
    }  # bounded otherwise, or by what they are
    for path, field in paths().items():
        if "float" in str(field.annotation) and path not in free:
            assert field.json_schema_extra["bounds"].unit, path


def test_every_example_is_within_its_bounds_and_the_example_file_loads():
    robot = robot_from_tree(example(), "example")
    assert robot.num_legs == 6 and remarks(robot) == (
        "servo.max_speed: not given; feasibility checks then do not check joint speeds",
    )
    for path, field in paths().items():
        value, bounds = field.examples[0], field.json_schema_extra["bounds"]
        if bounds and not isinstance(value, dict):
            assert not any(bounds.outside(number) for number in np.ravel(value)), path


def test_every_key_of_the_shipped_files_is_on_the_page():
    known = set(paths())

    def keys(node, path):
        if isinstance(node, dict) and not set(node) <= {"value", "source"}:
            for key, child in node.items():
                name = re.sub("_(mm|deg)$", "", key)
                open_ended = path.split(".")[-2:-1] in (["parameters"], ["joint_limits"], ["standing"])
                if key != "source" and not open_ended:
                    assert f"{path}{name}" in known, f"{path}{name}"
                    keys(child, f"{path}{name}.")
        elif isinstance(node, list):
            for child in node:
                keys(child, f"{path}1.")

    for name in robot_names():
        keys(yaml.safe_load((DATA / "robots" / f"{name}.yaml").read_text(encoding="utf-8")), "")


def test_bounds_are_inclusive_and_hints_fit_the_key():
    assert not MASS.outside(MASS.low) and MASS.outside(0.99 * MASS.low) and MASS.outside(float("nan"))
    assert MASS.hint("mass", 1e9) == "are the units right?"
