"""Paper A's trial and studies, and the committed results of the full ones."""

import numpy as np
import pandas as pd
import pytest

import hexakin as hk
from hexakin import experiments, paper, studies
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.installation import DATA
from hexakin.papers.gains import settings, swept
from hexakin.papers.results import five_numbers, load_results
from hexakin.papers.verdicts import columns_of

# speed.csv is no study's table: tests/test_benchmarks.py.
RESULTS = sorted({path.stem for path in (DATA / "results").glob("*.csv")} - {"speed"})


@pytest.fixture(scope="module")
def one_cycle():
    return experiments.simulate_walk("ramp", dict(k_z=0.8, k_alpha=0.6, k_beta=0.0), num_cycles=2, time_step=0.002)


def test_measures_are_those_of_the_recording(one_cycle):
    recording, ground = one_cycle
    found = experiments.measure(recording, ground, 2)
    cycles = hk.measures.per_cycle(recording)
    assert found["cycles"] == 2
    assert found["height_median"] == pytest.approx(np.median(cycles.height), rel=1e-5)
    assert found["pitch_rate_max"] == pytest.approx(cycles.pitch_rate.max(), rel=1e-5)
    series = hk.stability.series(recording)
    assert found["zmp_distance_all_median"] == pytest.approx(np.nanmedian(series.centroid_distance), rel=1e-5)
    assert found["distance"] == pytest.approx(0.2, abs=0.03), "two cycles of two strokes of 50 mm"
    assert found["torso_contact"] == 0.0
    assert abs(found["pitch_angle_median"]) < np.radians(2), "the torso is parallel to the ramp"


def test_every_measure_that_a_statement_needs_is_measured(one_cycle):
    found = experiments.measure(*one_cycle, 2)
    needed = {column for s in paper.statements().values() for column in columns_of(s)}
    assert needed <= set(found)


def test_a_walk_with_too_few_cycles_is_an_error(one_cycle):
    with pytest.raises(SimulationError, match="only 2 of 3 gait cycles"):
        experiments.measure(*one_cycle, 3)


def test_a_sample_without_values_has_missing_numbers_not_wrong_ones():
    assert all(np.isnan(value) for value in experiments.five_columns("x", []).values())
    assert experiments.five_columns("x", [1.0, 2.0, 3.0])["x_median"] == 2.0
    with pytest.warns(DeprecationWarning, match="now called five_columns"):
        assert experiments.summary is experiments.five_columns


def test_unknown_scenarios_and_layouts_are_named():
    with pytest.raises(UnknownNameError, match="scenario 'moon'"):
        experiments.simulate_walk("moon", dict(k_z=0, k_alpha=0, k_beta=0))
    with pytest.raises(InvalidInputError, match="layout: 3"):
        experiments.simulate_walk("ramp", dict(k_z=0, k_alpha=0, k_beta=0), layout=3)


def test_what_the_paper_leaves_open_reaches_the_simulation():
    recording, ground = experiments.simulate_walk(
        "testbed", dict(k_z=0, k_alpha=0, k_beta=0), num_cycles=1, time_step=0.0025, layout=2, seed=1,
        stride=0.04, apex=0.05, start_from="command", reference_offset=0.01, servo_rate=15.0, foot_radius=0.015,
        mount_scale=1.1, friction=0.7, force_sampling="last", max_step=0.05, block_size=0.1,
    )  # fmt: skip
    p = recording.parameters
    assert (p["friction"], p["force_sampling"], p["seed"]) == (0.7, "last", 1)
    assert p["controller"]["stride"] == 0.04 and p["controller"]["start_from"] == "command"
    assert p["controller"]["reference_height"] == pytest.approx(0.084 + 0.015 + 0.01)
    assert p["robot"]["servo"]["rate"] == 15.0 and p["robot"]["foot"]["size"] == [0.03] * 3
    assert p["robot"]["legs"][0]["values"]["l_1"] == pytest.approx(0.066)
    assert (ground.size, ground.max_step, ground.seed) == (0.1, 0.05, 2)


def test_roll_gain_alone_moves_nothing(athena):
    """A(29)-(30) with k_z = k_alpha = 0 turn a vector along y about y: A Figs 12 and 15 are simple control."""
    feet = hk.forward_kinematics(athena, athena.standing_q)
    simple, roll = (hk.PostureController(athena, k_z=0.0, k_alpha=0.0, k_beta=k) for k in (0.0, 1.0))
    for delta_beta in (-0.3, 0.2):
        moved = roll.stance_displacement(feet, -0.01, 0.1, delta_beta)
        assert np.array_equal(moved, simple.stance_displacement(feet, -0.01, 0.1, delta_beta))


def test_the_sweeps_hold_each_setting_once_and_every_repeat():
    study = studies.sweeps("testbed", count=3, engines=("rigid",))
    assert len(settings("testbed")) == 17  # simple control, 15 of single gains, the chosen ones
    assert len(study) == 17 * 3
    assert {(run["seed"], run["layout"]) for run in study.runs} == {(0, 0), (1, 1), (2, 2)}
    assert {run["layout"] for run in studies.sweeps("ramp").runs} == {0}
    assert len(studies.gain_grid("ramp")) == 216 * 5
    for make in studies.STUDIES.values():
        assert len(make()) > 0


def table(values):
    rows = [
        dict(k_z=k_z, k_alpha=0.0, k_beta=0.0, seed=seed, layout=0, status="ok")
        | {f"height_{s}": value + d for d, s in enumerate(("min", "lower", "median", "upper", "max"))}
        for (k_z, seed), value in values.items()
    ]
    return pd.DataFrame(rows)


def test_five_numbers_leave_out_repeats_that_lack_a_setting():
    runs = table({(0.0, 0): 1.0, (0.0, 1): 2.0, (1.0, 1): 3.0})
    gains = [dict(k_z=k, k_alpha=0.0, k_beta=0.0) for k in (0.0, 1.0)]
    numbers = five_numbers(runs, "height", gains)
    assert numbers.shape == (2, 1, 5)
    assert numbers[:, 0, 0].tolist() == [2.0, 3.0]
    runs.loc[2, "status"] = "SimulationError: fell"
    with pytest.raises(InvalidInputError, match="no start or layout"):
        five_numbers(runs, "height", gains)


def test_unknown_results_and_gains_are_named():
    with pytest.raises(UnknownNameError, match="results 'none'"):
        load_results("none")
    with pytest.raises(UnknownNameError, match="gain 'k_h'"):
        swept("k_h")


@pytest.mark.parametrize("name", RESULTS)
def test_committed_results_are_runs_of_the_study_of_their_name_and_say_what_made_them(name):
    found, about = load_results(name)
    study = studies.STUDIES[name]()
    arguments = list(study.runs[0])
    wanted = {tuple(run[a] for a in arguments) for run in study.runs}
    made = {tuple(row) for row in found[arguments].astype(object).itertuples(index=False)}
    assert made <= wanted and len(made) == len(found)
    assert about["study"] == name and about["runs"] == len(found)
    assert about["trial"] == f"{study.trial.__module__}:{study.trial.__qualname__}" and len(about["code"]) == 12
    assert {"python", "numpy", "pin"} <= set(about["versions"])
    assert (found.status == "ok").mean() > 0.95


def test_a_committed_run_can_be_repeated():
    found, _ = load_results("ramp_sweeps")
    row = found[(found.engine == "rigid") & (found.k_z == 0.8) & (found.k_alpha == 0) & (found.seed == 0)].iloc[0]
    arguments = {name: row[name] for name in studies.sweeps("ramp").runs[0]}
    again = experiments.walk(**{n: v.item() if hasattr(v, "item") else v for n, v in arguments.items()})
    assert again["height_median"] == pytest.approx(row.height_median, abs=5e-4)
    assert again["distance"] == pytest.approx(row.distance, rel=0.05)
    assert set(again) == set(found.columns) - set(arguments) - {"status", "wall_time"}
