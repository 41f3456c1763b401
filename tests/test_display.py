"""What is shown of objects with long arrays: one line in a terminal, a small table in a notebook."""

import copy
import dataclasses
import html.parser
import importlib
import inspect
import pickle
import re

import numpy as np
import pytest

import hexakin as hk
from hexakin import installation
from hexakin.motion.motion import motion_of
from hexakin.numerics.display import html_table, short_repr, spread

LONGEST = 2000  # characters
LARGEST = 10_000  # characters


@pytest.fixture(scope="module")
def walk(athena):
    ground = hk.terrain.Plane()
    return hk.simulate(athena, ground, hk.PostureController(athena), engine="rigid", duration=0.3, time_step=0.002)


@pytest.fixture(scope="module")
def report(athena):
    ground = hk.terrain.Plane()
    return hk.feasibility.check(athena, hk.plan_walk(athena, ground, num_steps=2, step_length=0.03), ground)


def test_results_are_printed_in_one_line_and_not_by_their_arrays(athena, walk, report):
    plan = hk.plan_walk(athena, hk.terrain.Plane(), num_steps=2, step_length=0.03)
    assert repr(walk) == "Recording(robot athena, terrain Plane(z=0.0), engine rigid, 6 ticks, 0.25 s)"
    assert repr(report) == f"FeasibilityReport(feasible; {len(plan.time)} instants)"
    assert repr(athena) == "Robot('athena', 6 legs, 2.133 kg)"
    assert repr(motion_of(athena, walk)).startswith(
        "Motion(time (6,), T_world_body (6, 4, 4), p_body_foot (6, 6, 3), q (6, 6, 3)"
    )
    shown = [walk, plan, report, report.motion, report.forces, *report.constraints.values()]
    assert all("\n" not in repr(value) and len(repr(value)) < 800 for value in shown)


def test_a_recording_without_parameters_is_printed_and_copied(walk):
    named = {name: values for name, values in walk.columns.items() if name not in walk.diagnostics}
    bare = hk.Recording(**named)
    assert repr(bare) == "Recording(robot unknown, terrain unknown, engine unknown, 6 ticks, 0.25 s)"
    for again in (copy.deepcopy(bare), pickle.loads(pickle.dumps(bare))):
        assert repr(again) == repr(bare) and np.array_equal(again.q, bare.q)


def record_classes():
    """Every dataclass and NamedTuple whose name has no underscore in front; those of ``checks`` are not results."""
    found = {}
    for module in installation.modules():
        if module.startswith("hexakin.checks"):
            continue
        for name, value in vars(importlib.import_module(module)).items():
            if inspect.isclass(value) and value.__module__ == module and not name.startswith("_"):
                if "__dataclass_fields__" in vars(value) or hasattr(value, "_fields"):
                    found[f"{module}.{name}"] = value
    return found


def filled(kind, robot):
    """An object of this class with long values, made without its checks."""

    def long(name, annotation):
        if name == "robot":
            return robot
        if "Array" in annotation:
            return np.zeros((400,) if name in ("x", "y", "time") else (400, 6))
        if "Mapping" in annotation or "dict" in annotation:
            return {f"{name}_{k}": np.zeros(100) for k in range(1000)}
        if "tuple" in annotation or "list" in annotation or "Sequence" in annotation:
            return tuple(range(1000))
        return "word" if "str" in annotation else 1.0

    if dataclasses.is_dataclass(kind):
        made = object.__new__(kind)
        for part in dataclasses.fields(kind):
            object.__setattr__(made, part.name, long(part.name, str(part.type)))
        return made
    return kind._make(long(name, str(kind.__annotations__[name])) for name in kind._fields)


# Classes whose repr is their call, with few and short values.
CALLS = {
    "Block", "Blocks", "Box", "Card", "DHRow", "Design", "Figure", "Gait", "HalfSpace", "Judged", "Leg", "LegTable",
    "Page", "Picture", "Scenario", "Servos", "Statement", "Verdict", "WalkReport",
}  # fmt: skip
# Classes whose repr needs values that go together. Tests above and below show them.
CHECKED = {"Animation", "FeasibilityReport", "LegCurves", "Robot", "Study"}


@pytest.mark.pybullet  # all modules are imported
def test_every_record_is_printed_in_one_short_line(athena):
    classes = record_classes()
    assert len(classes) > 60 and CALLS | CHECKED <= {name.rpartition(".")[2] for name in classes}
    for name, kind in classes.items():
        if kind.__name__ not in CALLS | CHECKED:
            text = repr(filled(kind, athena))
            assert "\n" not in text and len(text) < LONGEST, name
            assert text.startswith(kind.__name__), name


def test_records_that_are_printed_as_their_call_are_short(athena):
    from hexakin.study import Study, grid

    study = Study("mine", spread, grid(k=range(5000)))
    assert repr(study) == "Study('mine', 5000 runs of hexakin.numerics.display.spread)"
    shown = [
        study, athena.table, athena.legs[0], athena.torso, athena.servo, hk.gait.tripod(athena), hk.terrain.Blocks(),
        hk.terrain.LegCurves(), hk.PostureController(athena), hk.steering.SteeringController(athena),
        hk.feasibility.longest_stride(athena), *hk.experiments.SCENARIOS.values(),
        next(iter(hk.paper.statements().values())),
    ]  # fmt: skip
    for value in shown:
        assert "\n" not in repr(value) and len(repr(value)) < LONGEST, type(value)


def test_few_numbers_are_printed_and_other_values_counted():
    @dataclasses.dataclass(repr=False)
    class Record:
        few: np.ndarray
        many: np.ndarray
        flags: np.ndarray
        by_name: dict
        text: str
        hidden: int = dataclasses.field(default=0, repr=False)

    value = Record(np.array([1 / 3, 2.0, np.nan]), np.zeros((2, 2)), np.array([True]), {"a": 1, "b": 2}, "a\nb" * 99)
    assert short_repr(value).startswith(
        "Record(few [0.3333, 2. , nan], many (2, 2), flags [ True], by_name {a, b}, text 'a"
    )
    assert "hidden" not in short_repr(value) and short_repr(value).endswith("...)")


@pytest.mark.parametrize(
    "values, text",
    [
        (np.array([1.0, -2.5]), "-2.5 to 1"),
        (np.array([1.0, np.nan, 3.0, np.inf]), "1 to 3, 50.000% not finite"),
        (np.array([2, 2]), "2"),
        (np.full(3, np.nan), "not finite"),
        (np.array([True, False, False, False]), "25 % true"),
        (np.zeros((0, 3)), "empty"),
        (np.array(["a"]), ""),
    ],
)
def test_the_range_of_an_array_is_told(values, text):
    assert spread(values) == text


class Page(html.parser.HTMLParser):
    """The texts of a page's cells; every tag must be closed, and none but those of a table is allowed."""

    ALLOWED = ("table", "caption", "thead", "tbody", "tr", "th", "td")

    def __init__(self, text):
        super().__init__()
        self.open, self.cells = [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        assert tag in self.ALLOWED and {name for name, _ in attrs} <= {"style"}
        self.open.append(tag)
        if tag in ("th", "td", "caption"):
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("th", "td", "caption"):
            self.cells[-1] += data


def test_notebooks_show_small_tables(athena, short_walk, walk, report):
    shown = [athena, short_walk, walk, report, report.motion, hk.measures.per_cycle(short_walk)]
    shown.append(hk.plan_walk(athena, hk.terrain.Plane(), num_steps=2, step_length=0.03))
    for value in shown:
        text = value._repr_html_()
        assert len(text) < LARGEST
        assert type(value).__name__ in Page(text).cells[0]
    cells = Page(short_walk._repr_html_()).cells
    at = cells.index("foot_force")
    assert cells[at + 1] == str(short_walk.foot_force.shape) and cells[at + 2] == "N"
    assert re.fullmatch(r"0 to \d+(\.\d+)?", cells[at + 3])
    assert set(short_walk.diagnostics) < set(cells)
    cells = Page(report._repr_html_()).cells
    assert cells[cells.index("reach") + 1] == "yes" and cells[cells.index("joint speed") + 3] == "rad/s"
    assert "2.133 kg" in Page(athena._repr_html_()).cells[0]


def test_a_table_is_escaped_and_never_large():
    text = html_table("<script>alert(1)</script>", ["a", "&"], [("<b>", "x" * 5000)] * 5000)
    page = Page(text)
    assert len(text) < LARGEST and page.cells[0] == "<script>alert(1)</script>" and page.cells[3] == "<b>"
    rows = text.count("<tr>") - 2  # without the head and the last row
    assert page.cells[-1] == f"... and {5000 - rows} more"
