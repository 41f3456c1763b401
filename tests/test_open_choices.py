"""Sensitivity to the open choices: the sample, and the effects of made-up walks whose answer is known."""

import numpy as np
import pandas as pd
import pytest

from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.papers import open_choices

TRAJECTORIES = 4
NAMES = list(open_choices.CHOICES)


@pytest.fixture(scope="module")
def table():
    """Walks whose height is 1 m and 3 mm for each mm of stride, less 0.2 m if the last force is taken."""
    runs = open_choices.sensitivity("ramp", trajectories=TRAJECTORIES).runs
    rows = pd.DataFrame(list(runs)).assign(status="ok")
    return rows.assign(height=1.0 + 3.0 * rows.stride - 0.2 * (rows.force_sampling == "last"))


def effects(table, **keywords):
    return open_choices.elementary_effects(
        table, "ramp", lambda simple, chosen: simple["height"], trajectories=TRAJECTORIES, **keywords
    )


def test_neighbours_in_a_trajectory_differ_in_one_choice():
    shares = open_choices.points(TRAJECTORIES).reshape(TRAJECTORIES, len(NAMES) + 1, len(NAMES))
    assert ((np.diff(shares, axis=1) != 0).sum(axis=2) == 1).all()
    assert ((np.diff(shares, axis=1) != 0).sum(axis=1) == 1).all(), "every choice is changed once"


def test_effects_of_an_additive_outcome_are_its_slopes_over_the_range(table):
    found = effects(table)
    assert found.mu_star["stride"] == pytest.approx(3.0 * 0.030)
    assert found.sigma["stride"] == pytest.approx(0.0, abs=1e-6)  # strides are rounded to 1e-6 m
    # Morris' step is 2/3 of the range and takes either value to the other: their difference counts 3/2.
    assert found.mu["force_sampling"] == pytest.approx(-0.2 * 1.5)
    others = [name for name in NAMES if name not in ("stride", "force_sampling")]
    assert (found.mu_star[others] < 1e-12).all()


def test_a_failed_run_takes_its_trajectory_out(table):
    failed = table.copy()
    failed.loc[0, ["status", "height"]] = ["SimulationError: fell", np.nan]
    assert effects(failed).mu_star["stride"] == pytest.approx(3.0 * 0.030)
    failed.loc[failed.index[: -2 * (len(NAMES) + 1)], "status"] = "SimulationError: fell"
    with pytest.raises(InvalidInputError, match="1 trajectories without a failed run"):
        effects(failed)


def test_changes_of_one_choice_are_between_walks_that_differ_in_it_alone(table):
    found = open_choices.changes_of_one(
        table, "ramp", "stride", ["height", "stride", "apex"], trajectories=TRAJECTORIES
    )
    assert (found["stride"].high > found["stride"].low).all()
    assert (found["apex"].high == found["apex"].low).all()
    np.testing.assert_allclose(found["height"].high - found["height"].low, 3.0 * (found["stride"] @ [-1.0, 1.0]))
    with pytest.raises(UnknownNameError, match="strid"):
        open_choices.changes_of_one(table, "ramp", "strid", ["height"])
