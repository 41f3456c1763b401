import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.paper import Statement, change_percent, judge, statements


def statement(kind, value, tolerance=None):
    return Statement("id", "A 0", "ramp", "height", "median", kind, value, tolerance, "")


BEFORE = np.ones(10)


@pytest.mark.parametrize(
    "kind, value, tolerance, after, verdict",
    [
        ("change_percent", 50.0, None, np.linspace(1.4, 1.6, 10), "reproduced"),
        ("change_percent", 50.0, None, np.linspace(1.1, 1.2, 10), "same direction"),
        ("change_percent", -10.0, None, np.linspace(0.7, 1.3, 10), "not reproduced"),
        ("change_percent", -10.0, None, np.linspace(1.1, 1.3, 10), "not reproduced"),
        ("direction", 1.0, None, np.linspace(1.1, 1.3, 10), "reproduced"),
        ("direction", -1.0, None, np.linspace(1.1, 1.3, 10), "not reproduced"),
        ("unchanged", 0.0, 10.0, np.linspace(0.95, 1.05, 10), "reproduced"),
        ("unchanged", 0.0, 10.0, np.linspace(1.2, 1.5, 10), "not reproduced"),
    ],
)
def test_a_verdict_follows_from_the_repeats(kind, value, tolerance, after, verdict):
    assert judge(statement(kind, value, tolerance), BEFORE, after).verdict == verdict


def test_a_number_inside_a_spread_of_both_signs_is_not_reproduced():
    """An interval that is wide enough holds every number; the repeats must agree on the sign."""
    after = 1.0 + np.array([-0.6, -0.3, 0.2, 0.4])
    assert judge(statement("change_percent", -10.0), np.ones(4), after).verdict == "not reproduced"


def test_changes_are_paired():
    assert change_percent([1.0, 2.0], [2.0, 2.0]) == pytest.approx([100.0, 0.0])


def test_one_repeat_makes_no_verdict():
    with pytest.raises(InvalidInputError, match="at least two repeats"):
        judge(statement("direction", 1.0), [1.0], [2.0])


def test_the_papers_values_are_those_of_its_text():
    found = hk.paper.statements()
    assert found["A16a-median"].value == 60.77
    assert found["A16b-median"].value == -11.92
    assert found["A16c-median"].value == -35.98
    assert {s.scenario for s in found.values()} == {"ramp"}


def test_an_unknown_paper_or_a_bad_row_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match="unknown paper 'c'"):
        statements("c")
    path = tmp_path / "bad.csv"
    path.write_text(
        "id,figure,scenario,measure,statistic,kind,value,tolerance,wording\n"
        "a,A 1,ramp,height,median,change_percent,much,,text\n"
    )
    with pytest.raises(InvalidInputError, match=r"bad\.csv: line 2"):
        statements(path=path)
