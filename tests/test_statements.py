import itertools
import math

import numpy as np
import pandas as pd
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.papers.gains import CHOSEN, GAIN_LEVELS
from hexakin.papers.statements import claim, counts, robustness, statements, verdict_table, verdicts
from hexakin.papers.verdicts import Statement, change_percent, columns_of, judge

HEADER = "id,figure,scenario,factor,at,measure,statistic,kind,value,tolerance,wording\n"


def statement(kind, value=math.nan, tolerance=math.nan, at=(0.8,), statistic="median", measure="height", factor="k_z"):
    at = () if factor == "chosen" else at
    return Statement("id", "A 0", "ramp", factor, at, measure, statistic, kind, value, tolerance, "words")


def runs(by_level, factor="k_z", measure="height_median", **fixed):
    """One run per level and repeat; ``by_level`` maps a level, or a triple of gains, to one number per repeat."""
    rows = []
    for level, values in by_level.items():
        gains = dict(zip(("k_z", "k_alpha", "k_beta"), level if isinstance(level, tuple) else (0.0,) * 3, strict=True))
        if not isinstance(level, tuple):
            gains[factor] = level
        for seed, value in enumerate(values):
            rows.append(
                dict(scenario="ramp", engine="pybullet", time_step=0.001, seed=seed, layout=0, status="ok")
                | gains
                | {measure: value}
                | fixed
            )
    return pd.DataFrame(rows)


ONE = np.ones(10)
SPREAD = np.linspace(0.98, 1.02, 10)


@pytest.mark.parametrize(
    "kind, value, tolerance, after, verdict",
    [
        ("change_percent", 50.0, 0.005, np.linspace(1.4, 1.6, 10), "reproduced"),
        ("change_percent", 50.0, 0.005, np.linspace(1.1, 1.2, 10), "same direction"),
        ("change_percent", -10.0, 0.005, np.linspace(0.7, 1.3, 10), "not reproduced"),
        ("change_percent", -10.0, 0.005, np.linspace(1.1, 1.3, 10), "not reproduced"),
        ("direction", 1.0, math.nan, np.linspace(1.1, 1.3, 10), "reproduced"),
        ("direction", 1.0, math.nan, [0.9] + [1.1] * 9, "reproduced"),
        ("direction", 1.0, math.nan, [0.9] * 2 + [1.1] * 8, "not reproduced"),
        ("direction", -1.0, math.nan, np.linspace(1.1, 1.3, 10), "not reproduced"),
        ("unchanged", math.nan, 10.0, np.linspace(0.95, 1.05, 10), "reproduced"),
        ("unchanged", math.nan, 10.0, np.linspace(1.2, 1.5, 10), "not reproduced"),
        ("unchanged", math.nan, 10.0, np.linspace(0.5, 0.8, 10), "not reproduced"),
        ("inconclusive", math.nan, math.nan, np.linspace(0.9, 1.1, 10), "reproduced"),
        ("inconclusive", math.nan, math.nan, np.linspace(1.1, 1.3, 10), "not reproduced"),
        ("value", 1.2, 0.05, np.linspace(1.1, 1.3, 10), "reproduced"),
        ("value", 1.2, 0.05, np.linspace(1.24, 1.3, 10), "reproduced"),  # 1.2 printed with one digit may be 1.25
        ("value", 1.2, 0.05, np.linspace(1.26, 1.3, 10), "not reproduced"),
        ("never", math.nan, math.nan, np.zeros(10), "reproduced"),
        ("never", math.nan, math.nan, [0.0] * 5 + [0.1] * 5, "not reproduced"),
        ("occurs", math.nan, math.nan, np.full(10, 0.1), "reproduced"),
        ("occurs", math.nan, math.nan, [0.0] * 5 + [0.1] * 5, "not reproduced"),
    ],
)
def test_a_verdict_follows_from_the_repeats(kind, value, tolerance, after, verdict):
    assert judge(statement(kind, value, tolerance), runs({0.0: ONE, 0.8: after})).verdict == verdict


def test_a_number_inside_a_spread_of_both_signs_is_not_reproduced():
    """An interval that is wide enough holds every number; the repeats must agree on the sign."""
    table = runs({0.0: np.ones(4), 0.8: 1.0 + np.array([-0.6, -0.3, 0.2, 0.4])})
    assert judge(statement("change_percent", -10.0, 0.005), table).verdict == "not reproduced"


def test_a_percentage_over_several_levels_is_their_mean_in_each_repeat():
    table = runs({0.0: ONE, 0.4: 1.1 * SPREAD, 0.8: 1.3 * SPREAD})
    found = judge(statement("change_percent", 20.0, 0.005, at=(0.4, 0.8)), table)
    assert found.effect == pytest.approx(20.0) and found.unit == "%" and found.verdict == "reproduced"


def test_every_named_level_must_go_the_papers_way_in_a_repeat():
    table = runs({0.0: ONE, 0.4: 1.1 * ONE, 0.8: np.r_[[0.9] * 2, [2.0] * 8]})
    both = judge(statement("direction", 1.0, at=(0.4, 0.8)), table)
    assert (both.agreement, both.verdict) == (0.8, "not reproduced")
    assert judge(statement("direction", 1.0, at=(0.4,)), table).verdict == "reproduced"
    assert judge(statement("unchanged", tolerance=15.0, at=(0.4, 0.8)), table).agreement == 0.2
    assert judge(statement("inconclusive", at=(0.4, 0.8)), table).agreement == 0.5


def test_the_effect_of_a_direction_is_that_of_the_level_least_in_favour():
    table = runs({0.0: ONE, 0.4: 1.1 * ONE, 0.8: 1.5 * ONE})
    assert judge(statement("direction", 1.0, at=(0.4, 0.8)), table).effect == pytest.approx(10.0)
    assert judge(statement("direction", -1.0, at=(0.4, 0.8)), table).effect == pytest.approx(50.0)
    fall = runs({0.0: ONE, 0.4: 1.1 * ONE, 0.8: 0.5 * ONE})
    assert judge(statement("unchanged", tolerance=15.0, at=(0.4, 0.8)), fall).effect == pytest.approx(-50.0)
    assert judge(statement("unchanged", tolerance=15.0, at=(0.4, 0.8)), fall).verdict == "not reproduced"


@pytest.mark.parametrize("kind, sign", [("highest", 1.0), ("lowest", -1.0)])
def test_the_named_levels_must_be_exactly_the_most_extreme_of_all_six(kind, sign):
    table = runs({level: (2.0 + sign * level) * SPREAD for level in GAIN_LEVELS})
    top = judge(statement(kind, at=(0.8, 1.0)), table)
    assert top.verdict == "reproduced" and top.agreement == 1.0
    assert top.effect == pytest.approx(100.0 * (sign * 0.9 - sign * 0.3) / (2.0 + sign * 0.3))
    for other in ((1.0, 0.6), (0.8,), (0.0,)):
        assert judge(statement(kind, at=other), table).verdict == "not reproduced"
    without_simple = table[table["k_z"] > 0.0]
    assert judge(statement(kind, at=(1.0,)), without_simple).verdict == "no data"


def test_iqr_and_range_are_differences_of_columns():
    table = runs({0.0: ONE, 0.8: ONE}).assign(height_lower=1.0, height_min=0.0)
    table["height_upper"] = np.where(table["k_z"] == 0.0, 2.0, 1.5)
    table["height_max"] = np.where(table["k_z"] == 0.0, 2.0, 3.0)
    assert judge(statement("direction", -1.0, statistic="iqr"), table).effect == pytest.approx(-50.0)
    assert judge(statement("direction", 1.0, statistic="range"), table).effect == pytest.approx(50.0)
    assert judge(statement("value", 3.0, 0.5, statistic="max"), table).effect == 3.0


def test_the_chosen_gains_are_compared_with_simple_control():
    table = runs({(0.0, 0.0, 0.0): ONE, CHOSEN["ramp"]: 1.6 * SPREAD, (0.8, 0.0, 0.0): 9.0 * ONE})
    assert judge(statement("change_percent", 60.77, 0.005, factor="chosen"), table).verdict == "reproduced"
    assert judge(statement("value", 1.6, 0.05, factor="chosen"), table).effect == pytest.approx(1.6)


def test_repeats_are_paired_by_seed_and_layout_whatever_the_order_of_the_rows():
    start = np.array([1.0, 2.0, 4.0])
    table = pd.concat(
        [runs({0.0: start, 0.8: 1.1 * start}), runs({0.0: 10 * start, 0.8: 11 * start}, layout=1)], ignore_index=True
    ).sample(frac=1.0, random_state=0)
    found = judge(statement("change_percent", 10.0, 0.005), table)
    assert (found.repeats, found.left_out) == (6, 0)
    assert (found.low, found.high) == pytest.approx((10.0, 10.0))


def test_failed_and_missing_runs_are_left_out_and_counted():
    table = runs({0.0: ONE, 0.8: 1.5 * ONE})
    treated = table["k_z"] == 0.8
    table.loc[treated & (table["seed"] == 0), "status"] = "left the scene"  # its number must not count
    table.loc[treated & (table["seed"] == 1), "height_median"] = np.nan
    table.loc[~treated & (table["seed"] == 2), "height_median"] = 0.0  # no percentage starts from zero
    table = table[~(treated & (table["seed"] == 3))]
    found = judge(statement("change_percent", 50.0, 0.005), table)
    assert (found.repeats, found.left_out, found.verdict) == (6, 4, "reproduced")
    assert judge(statement("value", 1.0, 0.1, at=(0.0,)), table).repeats == 10


@pytest.mark.parametrize("n", [0, 1])
def test_fewer_than_two_repeats_are_no_data(n):
    table = runs({0.0: ONE, 0.8: ONE})
    for kind in ("change_percent", "highest", "value", "never", "inconclusive"):
        value, tolerance = {"change_percent": (1.0, 1.0), "value": (1.0, 1.0)}.get(kind, (math.nan, math.nan))
        found = judge(statement(kind, value, tolerance), table[table["seed"] < n])
        assert found.verdict == "no data" and math.isnan(found.effect)
        assert found.repeats == (n if kind != "highest" else 0)


def test_a_rise_from_a_negative_margin_is_a_rise():
    table = runs({0.0: -2.0 * ONE, 0.8: -1.0 * ONE})
    assert judge(statement("direction", 1.0), table).effect == pytest.approx(50.0)


def test_changes_are_paired_and_never_start_from_zero():
    assert change_percent([1.0, 2.0], [2.0, 2.0]) == pytest.approx([100.0, 0.0])
    with pytest.raises(InvalidInputError, match="no before zero"):
        change_percent([0.0, 2.0], [2.0, 2.0])


def test_a_table_that_cannot_be_judged_is_named():
    table = runs({0.0: ONE, 0.8: ONE})
    s = statement("direction", 1.0)
    with pytest.raises(InvalidInputError, match=r"time step, got pybullet at 0\.001 s; rigid at"):
        judge(s, pd.concat([table, table.assign(engine="rigid")]))
    with pytest.raises(InvalidInputError, match="one engine and one time step"):
        judge(s, pd.concat([table, table.assign(time_step=0.005)]))
    with pytest.raises(InvalidInputError, match=r"1 runs are given twice; the first: scenario ramp, k_z 0\.8.*seed 3"):
        judge(s, pd.concat([table, table[(table["k_z"] == 0.8) & (table["seed"] == 3)]]))
    with pytest.raises(InvalidInputError, match="given twice"):
        verdicts(pd.concat([table, table]), [s])
    with pytest.raises(InvalidInputError, match="missing columns layout, height_median"):
        judge(s, table.drop(columns=["layout", "height_median"]))
    with pytest.raises(InvalidInputError, match=r"missing columns .*roll_angle_lower"):
        verdicts(table)
    with pytest.raises(InvalidInputError, match="seed is missing in 20 rows"):
        judge(s, table.assign(seed=np.nan))
    with pytest.raises(InvalidInputError, match="height_median: could not convert"):
        judge(s, table.assign(height_median="high"))


def whole_study(engines=("pybullet", "rigid"), steps=(0.001,), seeds=3):
    """A table with every run that the paper's statements need; its numbers are random but repeatable."""
    rng = np.random.default_rng(0)
    gains = {(0.0, 0.0, 0.0)}
    gains |= {tuple(level if i == k else 0.0 for i in range(3)) for k in range(3) for level in GAIN_LEVELS}
    rows = []
    for scenario in ("ramp", "testbed"):
        for engine, step, seed, g in itertools.product(
            engines, steps, range(seeds), sorted(gains | {CHOSEN[scenario]})
        ):
            row = dict(zip(("k_z", "k_alpha", "k_beta"), g, strict=True))
            row |= dict(scenario=scenario, engine=engine, time_step=step, seed=seed, layout=0, status="ok")
            rows.append(row | {c: rng.uniform(0.1, 1.0) for s in statements().values() for c in columns_of(s)})
    return pd.DataFrame(rows)


def test_every_statement_is_judged_on_every_engine_and_step():
    table = verdicts(whole_study(steps=(0.001, 0.005)))
    assert len(table) == 4 * len(statements())
    assert list(table["id"].unique()) == list(statements())
    assert set(table["verdict"]) <= {"reproduced", "same direction", "not reproduced"}
    assert (table["repeats"] == 3).all() and (table["left_out"] == 0).all()
    row = table.iloc[0]
    assert row["id"] == "A10a-simple" and row["paper"] == 0.068 and row["unit"] == "m" and "0.068 m" in row["wording"]


def test_a_scenario_that_an_engine_did_not_run_has_no_rows_and_a_part_has_no_data():
    study = whole_study()
    study = study[(study["engine"] == "rigid") | (study["scenario"] == "ramp")]
    study = study[(study["engine"] == "pybullet") | (study["k_beta"] == 0.0)]
    table = verdicts(study)
    assert set(table.loc[table["engine"] == "pybullet", "scenario"]) == {"ramp"}
    assert (table.loc[(table["engine"] == "rigid") & (table["factor"] == "k_beta"), "verdict"] == "no data").all()
    lines = verdict_table(table).splitlines()
    assert lines[0] == "| figure | the paper says | pybullet | rigid |"
    assert [line.split(" | ")[1] for line in lines[2:]] == [claim(s) for s in statements().values()]
    assert verdict_table(table) == verdict_table(table.sample(frac=1.0, random_state=0).sort_index())


def test_the_summary_says_effect_interval_and_verdict_to_three_digits():
    after = 1.519 + 0.001 * np.linspace(-15.0, 15.0, 11)
    table = runs({0.0: np.ones(11), 0.8: after})
    shares = runs({0.8: np.zeros(11)}, measure="torso_contact")
    table = table.merge(shares, how="left")
    never = Statement(*("n", "A 17", "ramp", "k_z", (0.8,), "torso_contact", "mean", "never", math.nan, math.nan, ""))
    height = Statement(*("h", "A 10a", "ramp", "k_z", (0.8,), "height", "median", "value", 1.52, 0.005, ""))
    missing = Statement(*("m", "A 10a", "ramp", "k_z", (1.0,), "height", "median", "highest", math.nan, math.nan, ""))
    found = verdicts(table, [statement("change_percent", 60.0, 0.005), never, height, missing])
    assert verdict_table(found).splitlines()[2:] == [
        "| A 0, ramp | k_z = 0.8: height median +60 % | +51.9 % [50.5, 53.2] same direction |",
        "| A 17, ramp | k_z = 0.8: torso contact at no tick | 0 [0, 0] reproduced |",
        "| A 10a, ramp | k_z = 0.8: height median 1.52 m | 1.52 m [1.51, 1.53] reproduced |",
        "| A 10a, ramp | k_z = 1: height median highest | no data |",
    ]
    nudged = table.assign(height_median=table["height_median"] * (1.0 + 1e-12))
    assert verdict_table(verdicts(nudged, [height])) == verdict_table(verdicts(table, [height]))


def test_counts_and_robustness_compare_engines_and_steps():
    def case(after, **fixed):
        return runs({0.0: ONE, 0.8: after * SPREAD}, **fixed)

    s = [statement("direction", 1.0)]
    agree = verdicts(pd.concat([case(1.5), case(1.3, engine="rigid")]), s)
    assert robustness(agree).loc["id"].to_list() == ["agree", "one", "reproduced"]
    engines = verdicts(pd.concat([case(1.5), case(0.5, engine="rigid")]), s)
    assert robustness(engines).loc["id"].to_list() == ["differ", "one", ""]
    steps = verdicts(pd.concat([case(1.5), case(0.5, time_step=0.005)]), s)
    assert robustness(steps).loc["id"].to_list() == ["one", "differ", ""]
    assert verdict_table(steps).startswith("| figure | the paper says | pybullet, 1 ms | pybullet, 5 ms |\n")
    assert counts(engines).loc["reproduced"].to_dict() == {"pybullet": 1, "rigid": 0}
    assert counts(engines).loc["not reproduced"].to_dict() == {"pybullet": 0, "rigid": 1}
    assert counts(agree).index.to_list() == ["reproduced", "same direction", "not reproduced", "no data"]


def test_every_figure_of_the_paper_that_holds_measurements_has_statements():
    figures = {s.figure for s in statements().values()}
    for number, panels in dict.fromkeys(range(10, 18), "abc").items() | {18: "ab", 19: "ab"}.items():
        assert {f"A {number}{panel}" for panel in panels} <= figures
    assert {s.scenario for s in statements().values() if int(s.figure[2:4]) in (10, 11, 12, 16, 18)} == {"ramp"}
    assert {s.scenario for s in statements().values() if int(s.figure[2:4]) in (13, 14, 15, 17, 19)} == {"testbed"}
    assert all(s.wording for s in statements().values())


def test_the_papers_values_are_those_of_its_text():
    found = hk.paper.statements()
    values = {name: s.value for name, s in found.items() if s.kind in ("change_percent", "value")}
    assert values == {
        "A10a-simple": 0.068, "A10a-median": 58.42, "A10a-value": 0.112,
        "A10b-median": -18.91, "A10b-value": 0.064, "A10c-median": -30.74,
        "A11b-median": -39.56, "A11c-median": -35.7, "A12b-value": 0.077,
        "A12c-median-0.4": -14.54, "A12c-median-0.6": -2.32, "A12c-median-1.0": -15.0,
        "A13a-value": 0.107, "A13b-median": 66.66, "A14c-median-0.4": -8.43, "A14c-median-0.6": -16.0,
        "A15a-median-0.2": -14.85, "A15b-median-0.2": -20.39, "A15b-median-0.4": -38.8,
        "A16a-median": 60.77, "A16b-median": -11.92, "A16c-median": -35.98,
        "A17a-simple": 0.03, "A17a-value": 0.1, "A17b-median": 54.33, "A17c-median": 82.16,
    }  # fmt: skip
    assert found["A10b-median"].at == (0.2, 0.4, 0.6, 0.8) and found["A13b-median"].at == (0.4, 0.6, 0.8, 1.0)


def test_an_unknown_paper_is_named():
    with pytest.raises(UnknownNameError, match="unknown paper 'c'"):
        statements("c")


@pytest.mark.parametrize(
    "row, message",
    [
        ("a,A 1,ramp,k_z,0.8,height,median,change_percent,much,0.1,text", "could not convert"),
        (
            "a,A 1,ramp,k_z,0.8,height,median,change_percent,,0.1,text",
            "value: nan with kind 'change_percent', expected a number",
        ),
        ("a,A 1,ramp,k_z,0.8,height,median,direction,2,,text", "value: 2 with kind 'direction', expected 1 or -1"),
        (
            "a,A 1,ramp,k_z,0.8,height,median,unchanged,,,text",
            "tolerance: nan with kind 'unchanged', expected at least 0",
        ),
        ("a,A 1,ramp,k_z,0.8,height,median,better,,,text", "kind 'better'; known"),
        ("a,A 1,moon,k_z,0.8,height,median,highest,,,text", "scenario 'moon'; known: ramp, testbed"),
        ("a,A 1,ramp,k_z,0.8,width,median,highest,,,text", "measure 'width'; known"),
        ("a,A 1,ramp,k_z,0.7,height,median,highest,,,text", "at: (0.7,) with factor 'k_z', expected different levels"),
        ("a,A 1,ramp,chosen,0.8,height,median,direction,1,,text", "at: (0.8,) with factor 'chosen', expected none"),
        (
            "a,A 1,ramp,k_z,0.0 0.8,height,median,direction,1,,text",
            "at: (0.0, 0.8) with kind 'direction', expected levels above 0",
        ),
        ("a,A 1,ramp,chosen,,height,median,highest,,,text", "at: () with kind 'highest', expected some"),
        ("a,A 1,ramp", "expected 11 fields"),
        ("good,A 1,ramp,k_z,0.8,height,median,highest,,,text\n" * 2, "'good' is given twice"),
    ],
)
def test_a_bad_row_is_named_with_its_line(tmp_path, row, message):
    path = tmp_path / "bad.csv"
    path.write_text(HEADER + row + "\n")
    with pytest.raises(InvalidInputError, match=r"bad\.csv: line [23]: ") as error:
        statements(path=path)
    assert message in str(error.value)


def test_a_file_with_other_columns_is_named(tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text("id,figure\na,A 1\n")
    with pytest.raises(InvalidInputError, match=r"bad\.csv: line 1: expected the columns id, figure, scenario"):
        statements(path=path)


def test_the_verdict_table_keeps_its_old_name_for_a_release():
    with pytest.warns(DeprecationWarning, match="now called verdict_table"):
        assert hk.paper.summary is verdict_table
