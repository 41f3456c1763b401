import numpy as np
import pandas as pd
import pytest

from hexakin.exceptions import InvalidInputError
from hexakin.study.factorial import cells, standing, variance_shares


def test_an_additive_response_has_no_interactions(rng):
    a, b = np.array([0.0, 1.0, 2.0]), np.array([0.0, 3.0])
    values = np.add.outer(a, b)[..., None] + np.zeros(4)
    shares = variance_shares(values, ["a", "b"])
    assert shares["a"] == pytest.approx(a.var() / (a.var() + b.var()))
    assert shares["b"] == pytest.approx(b.var() / (a.var() + b.var()))
    assert shares["a, b"] == pytest.approx(0.0, abs=1e-15) and shares["repeats"] == 0.0


def test_a_product_of_centred_factors_is_all_interaction():
    values = np.multiply.outer([-1.0, 1.0], [-1.0, 0.0, 1.0])[..., None]
    assert variance_shares(values, ["a", "b"])["a, b"] == pytest.approx(1.0)


def test_shares_add_up_and_noise_is_repeats(rng):
    values = rng.normal(size=(6, 6, 6, 200))
    shares = variance_shares(values, ["a", "b", "c"])
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["repeats"] > 0.98
    assert len(shares) == 8


def test_missing_runs_are_passed_over_and_missing_settings_named():
    rows = [dict(a=a, b=b, seed=s, layout=0, status="ok", y=a + 10 * b) for a in (0, 1) for b in (0, 1) for s in (0, 1)]
    table = pd.DataFrame(rows)
    table.loc[0, "status"] = "SimulationError: fell"
    found = cells(table, "y", ["a", "b"])
    assert found.shape == (2, 2, 2) and np.isnan(found[0, 0, 0]) and found[0, 0, 1] == 0
    assert variance_shares(found, ["a", "b"])["b"] == pytest.approx(100 / 101)
    with pytest.raises(InvalidInputError, match="1 settings without a run; the first: a 0, b 1"):
        cells(table[~((table.a == 0) & (table.b == 1))], "y", ["a", "b"])
    with pytest.raises(InvalidInputError, match="given twice"):
        cells(pd.concat([table, table]), "y", ["a", "b"])
    with pytest.raises(InvalidInputError, match="missing columns z"):
        cells(table, "z", ["a", "b"])


def test_a_setting_stands_behind_those_that_are_better():
    costs = {"x": np.array([[3.0, 1.0], [2.0, 5.0]]), "y": np.array([[3.0, 4.0], [2.0, 5.0]])}
    assert standing(costs, (0, 0)) == {"x": 2, "y": 1, "in all": 1}
