"""Damaged and impossible robot files: each gives a named error or a robot that is possible, and at once."""

import copy
import json
import pickle
import time

import numpy as np
import pytest
import yaml

import hexakin as hk
from hexakin.exceptions import HexakinError, RobotFileError
from hexakin.generated import MODULES
from hexakin.installation import DATA
from hexakin.robot.file import robot_from_tree, robot_names
from hexakin.robot.plausibility import most_inertia

TEXTS = {name: (DATA / "robots" / f"{name}.yaml").read_text(encoding="utf-8") for name in robot_names()}
TREES = {name: yaml.safe_load(text) for name, text in TEXTS.items()}


def edited(name, change):
    """The robot of a shipped file after ``change`` has edited its tree in place."""
    tree = copy.deepcopy(TREES[name])
    change(tree)
    return robot_from_tree(tree, "mine.yaml")


# What is refused -------------------------------------------------------------------------------------------------


def put(*path):
    """A change that sets the value (the last item) at the path of keys before it."""

    def change(tree):
        *keys, last, value = path
        for key in keys:
            tree = tree[key]
        tree[last] = value

    return change


def rename(*path):
    """A change that gives a key (the last but one) of the mapping at a path another name (the last)."""

    def change(tree):
        *keys, old, new = path
        for key in keys:
            tree = tree[key]
        tree[new] = tree.pop(old)

    return change


IMPOSSIBLE = {
    "metres for millimetres": (
        rename("leg_table", "parameters", "l_2_mm", "l_2"),
        r"leg_table.parameters.l_2: 64 m, expected -10 to 10; l_2 is in m; did you mean l_2_mm\?",
    ),
    "a leg's own length": (
        rename("legs", 1, "parameters", "l_1_mm", "l_1"),
        r"legs.2.parameters.l_1: 116.619 m, .*did you mean l_1_mm\?",
    ),
    "millimetres for metres": (
        put("leg_table", "parameters", "l_3_mm", 0.08),
        r"legs.1: its femur has no length \(8e-05 m\), expected at least 0.001; are the units right",
    ),
    "no femur and no tibia": (
        lambda tree: tree["leg_table"]["parameters"].update(l_3_mm=0, l_4_mm=0),
        r"legs.1: its femur has no length \(0 m\)",
    ),
    "degrees for radians": (
        put("joint_limits", "theta_3", [-85, 85]),
        r"joint_limits.theta_3: -85 rad, expected -12.5664 to 12.5664; theta_3 is in rad; did you mean theta_3_deg\?",
    ),
    "degrees in a fixed angle": (
        put("legs", 1, "parameters", "theta_1", 59.0),
        r"legs.2.parameters.theta_1: 59 rad, .*did you mean theta_1_deg\?",
    ),
    "a size in millimetres": (rename("torso", "size_mm", "size"), r"torso.size: 120 m, .*did you mean size_mm\?"),
    "a size in metres": (
        put("torso", "size_mm", [0.0012, 0.002, 0.00056]),
        r"torso.size: 1.2e-06 m, .*size_mm is in mm; did you mean size, in m\?",
    ),
    "grams": (put("torso", "mass", 700.0), r"torso.mass: 700 kg in a box of .* are 5.21e\+05 kg/m\^3, .*\(osmium\)"),
    "tonnes": (put("torso", "mass", 7e8), r"torso.mass: 7e\+08 kg, expected 1e-06 to 100000; are the units right"),
    "feathers": (put("segments", "femur", "mass", 1.36e-4), r"segments.femur.mass: .*expected 5 \(foam\)"),
    "a foot in grams": (put("foot", "mass", 8.9), r"foot.inertia: .*is it in kg m\^2"),
    "a foot of air": (put("foot", "mass", 8.9e-6), r"foot.mass: .*in a sphere of radius 0.02 m .*expected at least 5"),
    "an inertia in kg mm^2": (
        put("torso", "inertia", {"xx": 2520, "yy": 1020, "zz": 3170}),
        r"torso.inertia: 3.17e\+03 kg m\^2, expected about 0.00317 .*is it in kg m\^2",
    ),
    "a centre of mass in millimetres": (
        rename("segments", "femur", "center_of_mass_mm", "center_of_mass"),
        r"segments.femur.center_of_mass: 40 m, .*did you mean center_of_mass_mm",
    ),
    "a centre of mass far out": (
        put("segments", "femur", "center_of_mass_mm", [4000, 0, 0]),
        r"segments.femur.center_of_mass: 4 m away, expected at most",
    ),
    "no speed": (put("servo", "max_speed", 6500.0), "servo.max_speed: 6500 rad/s, expected 0.01 to 1000"),
    "a joint with a part's name": (
        lambda tree: rename_joint(tree, "theta_2", "foot"),
        "leg_table.joints: foot is already the name of a part of every leg",
    ),
    "a length that is an angle": (
        put("leg_table", "rows", 2, "alpha", "l_3"),
        "leg_table.rows: l_3 is both a length and an angle",
    ),
    "no name": (put("name", ""), "name: .*at least 1 character"),
    "too many legs": (put("num_legs", 10**9), "num_legs: .*less than or equal to 64"),
    "a source that is no text": (put("torso", "source", [1]), r"torso.source: expected text, got '\[1\]'"),
    "a truth for a number": (put("torso", "mass", True), "torso.mass: .*valid number"),
}  # fmt: skip


def rename_joint(tree, old, new):
    table = tree["leg_table"]
    table["joints"] = [new if joint == old else joint for joint in table["joints"]]
    for row in table["rows"]:
        row["theta"] = new if row["theta"] == old else row["theta"]
    for field in ("joint_limits", "standing"):
        tree[field][new] = tree[field].pop(old)


@pytest.mark.parametrize("change, message", IMPOSSIBLE.values(), ids=IMPOSSIBLE.keys())
def test_an_impossible_value_is_refused_with_its_field_and_what_was_expected(change, message):
    with pytest.raises(RobotFileError, match=message) as caught:
        edited("athena", change)
    assert str(caught.value).startswith("mine.yaml: ")


@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_a_unit_that_is_wrong_by_a_thousand_is_refused(name, factor):
    """Each mass, box and inertia, the femur and the tibia; a coxa or an offset may be as short as it likes."""

    def scaled(node):
        if isinstance(node, dict):
            return {key: node[key] if key == "source" else scaled(node[key]) for key in node}
        return [scaled(item) for item in node] if isinstance(node, list) else factor * float(node)

    tree = TREES[name]
    bodies = [("torso",), *(("segments", limb) for limb in tree["segments"] if limb != "source")]
    places = [(*body, field) for body in bodies for field in ("mass", "size_mm", "inertia")]
    places += [("foot", "mass")] * name.startswith(
        "athena"
    )  # others' feet are too small for a mass that is theirs alone
    lengths = [key for key in tree["leg_table"]["parameters"] if key.endswith("_mm")][-2:]
    places += [("leg_table", "parameters", key) for key in lengths]
    for path in places:

        def change(tree, path=path):
            for key in path[:-1]:
                tree = tree[key]
            tree[path[-1]] = scaled(tree[path[-1]])

        with pytest.raises(RobotFileError, match="expected"):
            edited(name, change)


def test_keys_and_values_of_any_size_keep_an_error_short():
    for change in (put("n" * 50_000, 1), put("name", "n" * 50_000), put("torso", "mass", "9" * 50_000)):
        with pytest.raises(RobotFileError) as caught:
            edited("athena", change)
        assert len(str(caught.value)) < 1000


def test_a_file_that_is_no_file_or_too_long_is_refused_unread(tmp_path):
    long = tmp_path / "long.yaml"
    long.write_text("a: " + "x" * 70_000)
    with pytest.raises(RobotFileError, match=r"long.yaml: longer than 65536 bytes"):
        hk.load_robot(long)
    with pytest.raises(RobotFileError, match="not a file"):
        hk.load_robot(tmp_path)


def test_a_tree_is_left_as_it_is():
    tree = copy.deepcopy(TREES["phantomx"])
    robot_from_tree(tree, "mine.yaml")
    assert tree == TREES["phantomx"]


# Ten thousand mutations --------------------------------------------------------------------------------------------


def nested(depth, kind):
    value = 1.0
    for _ in range(depth):
        value = [value] if kind else {"value": value, "x": 1}
    return value


JUNK = [
    None, True, -1, 0, 1, 1e300, -1e300, 10**400, float("nan"), float("inf"), -float("inf"), "x", "", "pi/3", "1e-3",
    "pi/0", "l_2", "\u2028\x00", b"\xff", [], {}, [[]], [1, 2], [1, 2, 3], [float("nan")] * 3, {"value": 3},
    {"value": None, "source": 3}, {"source": "a"}, {1: 2, None: 3}, {"xx": 1, "yy": 1, "zz": 1}, {1, 2}, (1, 2),
    nested(40, 0), nested(40, 1), nested(3000, 0), nested(3000, 1), "n" * 5000, list(range(2000)),
]  # fmt: skip


def places(node, found, depth=0):
    """The (container, key) pairs of a tree, but not those far down in junk."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else []
    for key, child in items if depth < 8 and len(found) < 1000 else ():
        found.append((node, key))
        places(child, found, depth + 1)
    return found


def mutate_tree(tree, rng):
    spots = places(tree, [])
    numbers = [spot for spot in spots if isinstance(spot[0][spot[1]], (int, float))]
    node, key = spots[rng.integers(len(spots))]
    kind = rng.integers(8)
    if kind == 0 and isinstance(node, dict):
        del node[key]
    elif kind == 1 and isinstance(node, dict):
        node[str(rng.choice(["_mm", "_deg", "x", "value", "source", f"{key}_mm", f"{key}_deg"]))] = node[key]
    elif kind == 2:
        other, name = spots[rng.integers(len(spots))]
        node[key] = other[name]  # an ancestor makes it a tree without end
    elif kind == 3 and isinstance(node, list):
        node.insert(int(key), node[key])
    elif kind in (4, 5, 6):
        node, key = numbers[rng.integers(len(numbers))]
        node[key] = node[key] * float(rng.choice([-1.0, 1e3, 1e-3, 1e6, 0.0, 1.1, 0.9, np.nan, np.inf]))
    else:
        node[key] = JUNK[rng.integers(len(JUNK))]


BOMB = "a: &a [x, x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
SNIPPETS = [
    "mass: 1\n", "- 1\n", "*x", "&x ", "!!python/object:os.system ", "!!binary ", "!!set ", "{", "[", "]", "}", ": ",
    "\t", "\n", "? ", "| ", "---\n", "...\n", "%YAML 9.9\n", "\x00", "\ufeff", "\ud7ff", "#", "'", '"', "<<: {a: 1}\n",
    ".nan", "-.inf", "0x" + "f" * 6000, "9" * 6000, "1:" * 3000 + "1", BOMB, "[" * 2000, "{a: " * 2000, "- " * 2000,
]  # fmt: skip


def mutate_text(text, rng):
    start, stop = np.sort(rng.integers(len(text), size=2))
    lines = text.splitlines(keepends=True)
    kind = rng.integers(6)
    if kind == 0:
        return text[:start]
    if kind == 1:
        return text[:start] + text[stop:]
    if kind == 2:
        line = int(rng.integers(len(lines)))
        return "".join([*lines[: line + 1], lines[int(rng.integers(len(lines)))], *lines[line + 1 :]])
    if kind == 3:
        return text[:start] + str(rng.choice(SNIPPETS)) + text[start:]
    if kind == 4:
        return text[:start] + text[start:stop] + text[start:]
    return text[:start] + bytes(rng.integers(32, 127, size=20).tolist()).decode() + text[start + 20 :]


def check(robot):
    """What holds of every robot that loads."""
    assert robot.num_legs == len({leg.name for leg in robot.legs}) and robot.name
    assert np.isfinite(robot.parameters).all() and np.isfinite(robot.mass)
    for body in (robot.torso, *robot.segments.values(), robot.foot):
        moments = np.linalg.eigvalsh(body.inertia)
        assert body.mass > 0.0 and moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-6)
        assert (body is robot.foot or moments[2] < 100.0 * most_inertia(body).max()) and np.isfinite(moments).all()
    assert (robot.q_min < robot.q_max).all() and np.abs(robot.joint_limits).max() < 13.0
    assert ((robot.q_min <= robot.standing_q) & (robot.standing_q <= robot.q_max)).all()
    assert np.linalg.norm(robot.forward) == pytest.approx(1.0) and robot.servo.max_torque > 0.0
    poses = np.array([robot.fixed_poses(leg) for leg in range(robot.num_legs)])
    lengths = np.linalg.norm(poses[:, 2:, :3, 3], axis=-1)
    assert np.isfinite(poses).all() and (lengths >= 1e-3).all() and (lengths <= 10.0).all()
    if robot.table.type_key in MODULES:  # another would be derived first, for a second
        assert np.isfinite(hk.forward_kinematics(robot, robot.standing_q)).all()
    json.dumps(robot.description(), allow_nan=False)


def outcomes(attempts):
    """How many attempts gave a robot, after a check of each that no error is raw, long or late."""
    loaded = 0
    for attempt in attempts:
        start = time.process_time()
        try:
            robot = attempt()
        except HexakinError as error:
            assert isinstance(error, RobotFileError) and "mine.yaml: " in str(error) and len(str(error)) < 3000
        else:
            check(robot)
            loaded += 1
        assert time.process_time() - start < 2.0
    return loaded


def test_eight_thousand_mutated_descriptions_load_or_give_a_named_error(rng):
    stored = [pickle.dumps(tree) for tree in TREES.values()]  # copied twenty times as fast as by copy.deepcopy

    def attempt():
        tree = pickle.loads(stored[rng.integers(len(stored))])
        for _ in range(int(rng.integers(1, 4))):
            mutate_tree(tree, rng)
        return robot_from_tree(tree, "mine.yaml")

    assert 800 < outcomes(attempt for _ in range(8000)) < 4000


def test_two_thousand_mutated_files_load_or_give_a_named_error(tmp_path, rng):
    path = tmp_path / "mine.yaml"

    def attempt():
        text = TEXTS[str(rng.choice(list(TEXTS)))]
        for _ in range(int(rng.integers(1, 3))):
            text = mutate_text(text, rng) or "x"
        path.write_bytes(text.encode())
        return hk.load_robot(path)

    assert 100 < outcomes(attempt for _ in range(2000)) < 1500


def test_random_bytes_give_a_named_error(tmp_path, rng):
    path = tmp_path / "mine.yaml"
    for size in rng.integers(0, 20_000, size=100):
        path.write_bytes(rng.bytes(int(size)))
        with pytest.raises(RobotFileError, match=r"mine\.yaml"):
            hk.load_robot(path)
