"""Walks near their limits: what is predicted, what is measured, and how often a margin was right."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility import commanded_walk
from hexakin.papers import near_limits


def test_study_covers_every_range_evenly_and_is_the_same_each_time():
    study = near_limits.study(runs=40, on_pybullet=5)
    for name, (low, high) in near_limits.RANGES.items():
        values = np.array([run[name] for run in study.runs if run["engine"] == "rigid"])
        share = np.log(values / low) / np.log(high / low) if name == "max_torque" else (values - low) / (high - low)
        assert (np.histogram(share, 40, (0, 1))[0] == 1).all(), name
    assert sum(run["engine"] == "pybullet" for run in study.runs) == 5
    assert near_limits.study(runs=40, on_pybullet=5).runs == study.runs


def test_margins_of_a_walk_on_level_ground_are_the_known_ones():
    robot = hk.load_robot("athena")
    plane = hk.terrain.Plane()
    found = near_limits.predict(robot, commanded_walk(hk.PostureController(robot), plane, num_cycles=1), plane, 0.9)
    assert found["feasible"] == 1.0
    assert found["margin_friction"] == pytest.approx(0.9, abs=2e-3), "vertical forces hold it"
    assert found["margin_region"] == pytest.approx(found["margin_polygon"], abs=2e-4)
    assert 0.0 < found["margin_energy"] < found["margin_longitudinal"]
    assert set(found) == {*near_limits.MARGINS, "feasible"}


def test_slip_is_the_way_of_a_loaded_foot_in_stance_since_its_first_loaded_tick():
    n, T = 6, np.broadcast_to(np.eye(4), (6, 4, 4))
    feet = np.zeros((n, 2, 3))
    feet[:, 0, 0] = [0.0, 1.0, 2.0, 2.0, 2.0, 2.0]  # loaded from its second tick on: slides by 1
    feet[:, 1, 1] = np.arange(n)  # swings, then is loaded but searched for: not counted
    recording = SimpleNamespace(
        T_world_body=T, p_body_foot=feet, phase=np.array([0, 0, 0, 1, 1, 1]), num_legs=2,
        stance=np.array([[1, 0]] * 3 + [[1, 1]] * 3, dtype=bool),
        foot_force=np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0], [1.0, 1.0]]),
        extending=np.array([0, 0, 0, 0, 1, 1], dtype=bool),
    )  # fmt: skip
    np.testing.assert_allclose(near_limits.slips.__wrapped__(recording), [1.0, 0.0])


def made_up(margin):
    n = len(margin)
    columns = {name: margin for name in near_limits.MARGINS}
    return pd.DataFrame({**columns, "feasible": (np.asarray(margin) > 0).astype(float), "slip": np.zeros(n)})


def test_foresight_of_a_perfect_a_reversed_and_a_blind_margin():
    failed = np.array([True, True, True, False])
    perfect = near_limits.foresight(made_up([-1.0, -2.0, -3.0, 1.0]), failed).loc["margin_energy"]
    assert perfect.to_dict() == {"right": 1.0, "missed": 0.0, "false_alarms": 0.0, "ranked": 1.0}
    reversed_ = near_limits.foresight(made_up([1.0, 2.0, 3.0, -1.0]), failed).loc["feasible"]
    assert reversed_.to_dict() == {"right": 0.0, "missed": 1.0, "false_alarms": 1.0, "ranked": 0.0}
    blind = near_limits.foresight(made_up([1.0, 1.0, 1.0, 1.0]), failed).loc["margin_polygon"]
    assert blind.to_dict() == {"right": 0.25, "missed": 1.0, "false_alarms": 0.0, "ranked": 0.5}
    with pytest.raises(InvalidInputError, match="0 of 4"):
        near_limits.foresight(made_up([1.0, 1.0, 1.0, 1.0]), np.zeros(4))


def test_what_counts_as_failure():
    table = pd.DataFrame(
        {
            "torso_contact": [0, 0.1, 0, 0, 1],
            "slip": [0.01, 0.01, 0.03, 0.01, np.nan],
            "advance": [0.9, 0.9, 0.9, 0.4, 0],
        }
    )
    assert near_limits.failures(table).tolist() == [False, True, True, True, True]


def test_an_easy_walk_succeeds_as_predicted_and_one_on_a_slippery_slope_slides_as_predicted():
    easy = near_limits.near_limit(0.17, 0.9, 1.89, 0.05, 0, "rigid", num_cycles=2)
    assert easy["feasible"] == 1.0 and easy["torso_contact"] == 0.0 and easy["slip"] < 0.01 and easy["advance"] > 0.8
    slippery = near_limits.near_limit(0.6, 0.4, 1.89, 0.05, 0, "rigid", num_cycles=2)
    assert slippery["feasible"] == 0.0 and slippery["margin_friction"] == pytest.approx(0.4 - np.tan(0.6), abs=2e-3)
    assert slippery["slip"] > 0.1
