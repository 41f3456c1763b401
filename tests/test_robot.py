"""Robot descriptions: ATHENA's values, and bad files that are named errors."""

import pickle

import numpy as np
import pytest
import yaml

import hexakin as hk
from hexakin.exceptions import InvalidInputError, RobotFileError, UnknownNameError
from hexakin.installation import DATA
from hexakin.robot.leg_table import pi_multiple

ATHENA = DATA / "robots" / "athena.yaml"


def write(tmp_path, change):
    """ATHENA's file after ``change`` has edited its tree in place."""
    tree = yaml.safe_load(ATHENA.read_text())
    change(tree)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(tree))
    return path


def test_athena_has_the_mass_and_legs_of_the_paper(athena):
    assert athena.num_legs == 6
    assert athena.mass == pytest.approx(2.1334, abs=1e-12)
    assert [leg.name for leg in athena.legs][:2] == ["right middle", "right front"]


def test_every_value_of_a_shipped_robot_has_a_source():
    for path in sorted((DATA / "robots").glob("*.yaml")):
        sources = hk.load_robot(path).sources
        texts = {"name", "reference"} | {key for key in sources if key.endswith(".name")}
        assert [key for key, source in sources.items() if not source and key not in texts] == []


def test_leg_angles_follow_a13_from_the_assumed_joint_positions(athena):
    l_0, w = 0.1, 0.06
    corner = np.arctan(l_0 / w)
    expected = [0, corner, np.pi - corner, np.pi, np.pi + corner, -corner]
    assert [leg.values["theta_1"] for leg in athena.legs] == pytest.approx(expected, abs=1e-15)
    assert [leg.values["l_1"] for leg in athena.legs] == pytest.approx(
        [w, *[np.hypot(l_0, w)] * 2, w, *[np.hypot(l_0, w)] * 2]
    )


def test_inertias_are_those_of_uniform_prisms_of_the_printed_size(athena):
    """Table 2 holds only in 1e-3 kg m^2, and only with a tibia of 13.0 g."""
    for body in [athena.torso, *athena.segments.values()]:
        squares = body.size**2
        prism = body.mass / 12.0 * (squares.sum() - squares)
        assert np.diag(body.inertia) == pytest.approx(prism, rel=6e-3)
    assert np.diag(athena.foot.inertia) == pytest.approx(0.4 * athena.foot.mass * athena.foot_radius**2, rel=1e-12)


def test_a_users_file_with_plain_values_loads_the_same_way(tmp_path, athena):
    def strip(node):
        if isinstance(node, dict):
            if "value" in node:
                return node["value"]
            return {key: strip(value) for key, value in node.items() if key != "source"}
        return [strip(item) for item in node] if isinstance(node, list) else node

    path = tmp_path / "plain.yml"
    path.write_text(yaml.safe_dump(strip(yaml.safe_load(ATHENA.read_text()))))
    plain = hk.load_robot(path)
    assert plain.mass == athena.mass
    assert np.array_equal(plain.parameters, athena.parameters)


@pytest.mark.parametrize("num_legs", [4, 8])
def test_the_number_of_legs_is_the_descriptions(tmp_path, num_legs):
    def change(tree):
        legs = [{"name": f"leg {i}", "parameters": {"theta_1": i * 0.7, "l_1": 0.1}} for i in range(num_legs)]
        tree.update(num_legs=num_legs, legs=legs)

    robot = hk.load_robot(write(tmp_path, change))
    q = np.zeros((5, num_legs, 3))
    assert hk.forward_kinematics(robot, q).shape == (5, num_legs, 3)


BAD = {
    "missing field": (lambda t: t.pop("torso"), "torso: Field required"),
    "missing nested field": (lambda t: t["foot"].pop("mass"), "foot.mass: Field required"),
    "negative mass": (
        lambda t: t["segments"]["femur"].update(mass=-0.1),
        "segments.femur.mass: .*greater than 0.*-0.1",
    ),
    "NaN mass": (lambda t: t["torso"].update(mass=float("nan")), "torso.mass: .*finite"),
    "text for a number": (lambda t: t["torso"].update(mass="heavy"), "torso.mass: .*number.*heavy"),
    "wrong number of legs": (lambda t: t["legs"].pop(), "legs: 5 given, expected num_legs = 6"),
    "unknown field": (lambda t: t.update(colour="red"), "colour: Extra inputs"),
    "misspelt length": (lambda t: t["leg_table"]["parameters"].pop("l_3_mm"), "legs.1.parameters: no value for l_3"),
    "unused parameter": (lambda t: t["leg_table"]["parameters"].update(l_9=1.0), "l_9 does not occur"),
    "limits reversed": (
        lambda t: t["joint_limits"].update(theta_3=[1.0, -1.0]),
        "joint_limits.theta_3 of leg 1: lower limit 1",
    ),
    "standing outside limits": (
        lambda t: t["joint_limits"].update(theta_4=[-1.0, 1.0]),
        "standing.theta_4 of leg 1: -1.57",
    ),
    "impossible inertia": (lambda t: t["torso"]["inertia"].update(zz=9.0), "torso.inertia: violates the triangle"),
    "indefinite inertia": (lambda t: t["torso"]["inertia"].update(xy=1.0), "torso.inertia: not positive definite"),
    "forward not horizontal": (lambda t: t.update(forward=[0, 0, 1]), "forward: expected a horizontal unit vector"),
    "equal leg names": (lambda t: t["legs"][1].update(name="right middle"), "legs: names must differ"),
    "number in the table": (lambda t: t["leg_table"]["rows"][2].update(a=1), "rows.3.a.*needs a name"),
    "joint not in the table": (lambda t: t["leg_table"]["rows"][3].update(theta="phi"), "joint theta_4 must be"),
    "joints out of order": (
        lambda t: t["leg_table"].update(joints=["theta_3", "theta_2", "theta_4"]),
        "leg_table.joints: must be in the order",
    ),
    "unknown convention": (
        lambda t: t["leg_table"].update(convention="screw"),
        "convention: .*'classical' or 'modified'",
    ),
    "no length": (lambda t: t["leg_table"]["parameters"].update(l_4_mm=0), "legs.1: its tibia has no length"),
    "metres for millimetres": (lambda t: t["leg_table"]["parameters"].update(l_4_mm=84e6), "are the units right"),
    "huge number": (lambda t: t["torso"].update(size_mm=[1, 1, 10**400]), "torso.size_mm: number too large"),
    "legs that differ": (
        lambda t: (
            (t["leg_table"]["parameters"].pop("l_2_mm"), t["segments"]["coxa"].pop("center_of_mass_mm"))
            and [leg["parameters"].update(l_2_mm=60 + i) for i, leg in enumerate(t["legs"])]
        ),
        "segments.coxa.center_of_mass: needed, since the legs' lengths differ",
    ),
    "two units": (lambda t: t["foot"].update(radius=0.02), "foot.radius: given twice"),
}


@pytest.mark.parametrize("change, message", BAD.values(), ids=BAD.keys())
def test_a_bad_file_is_an_error_that_names_file_and_field(tmp_path, change, message):
    path = write(tmp_path, change)
    with pytest.raises(RobotFileError, match=message) as caught:
        hk.load_robot(path)
    assert "mine.yaml" in str(caught.value)


FAULTY = {
    "empty": "",
    "a list": "- 1\n- 2\n",
    "unfinished": "name: [",
    "a field twice": "a: 1\na: 2\n",
    "a NUL": "\x00",
    "a list as a key": "? [a, b]\n: 1\n",
    "an endless alias": "a: &x [*x]\n",
    "aliases that explode": "a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]\n",
    "an impossible tag": "a: !!bool abc\n",
    "an impossible time": "a: !!timestamp abc\n",
    "nesting without end": "[" * 5000,
    "a number of 5000 digits": f"num_legs: 0x{'f' * 5000}\n",
}


@pytest.mark.parametrize("text", FAULTY.values(), ids=FAULTY.keys())
def test_a_file_that_is_no_mapping_is_a_named_error(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(RobotFileError, match=r"mine\.yaml"):
        hk.load_robot(path)


def test_missing_files_and_unknown_names_are_named_errors(tmp_path):
    with pytest.raises(RobotFileError, match="no such file"):
        hk.load_robot(tmp_path / "absent.yaml")
    with pytest.raises(UnknownNameError, match="unknown robot 'atena'; known: athena"):
        hk.load_robot("atena")


def test_numbers_in_scientific_notation_without_a_dot_are_numbers(tmp_path):
    path = write(tmp_path, lambda t: t["torso"]["inertia"].update(zz="3e-3"))
    assert hk.load_robot(path).torso.inertia[2, 2] == 3e-3


def test_a_robot_cannot_be_changed_and_can_be_pickled(athena):
    with pytest.raises(ValueError, match="read-only"):
        athena.joint_limits[0, 0, 0] = 1.0
    with pytest.raises(TypeError):
        athena.segments["coxa"] = athena.torso
    with pytest.raises(TypeError):
        athena.legs[0].values["l_1"] = 9.0
    twin = pickle.loads(pickle.dumps(athena))
    assert twin.mass == athena.mass
    assert np.array_equal(twin.parameters, athena.parameters)


@pytest.mark.parametrize("text, value", [("pi", 1), ("-pi/2", -0.5), ("3*pi/4", 0.75), ("2pi", 2), (0, 0)])
def test_multiples_of_pi_are_exact(text, value):
    assert pi_multiple(text) == value


@pytest.mark.parametrize("text", ["l_1", "pi/0", "pip", "1.5", ""])
def test_other_text_is_no_multiple_of_pi(text):
    assert pi_multiple(text) is None


@pytest.mark.parametrize("name", [None, 3, b"athena", "a\0.yaml"])
def test_what_is_no_name_and_no_path_is_a_named_error(name):
    with pytest.raises(InvalidInputError, match=r"name: expected (text or a PathLike|a path), got"):
        hk.load_robot(name)
