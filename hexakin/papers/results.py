"""Tables of paper A's full studies, and what the figures draw of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from hexakin.checks import Array
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.installation import DATA
from hexakin.papers.gains import GAINS
from hexakin.papers.scenarios import SCENARIOS
from hexakin.papers.statements import summary, verdicts
from hexakin.study.tables import read_table


def load_results(name: str) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Table of a full study in data/results and what made it (call, versions, code). Raises UnknownNameError."""
    folder = DATA / "results"
    if not (folder / f"{name}.csv").is_file():
        raise UnknownNameError("results", name, sorted(path.stem for path in folder.glob("*.csv")))
    about = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return read_table(folder / f"{name}.csv"), about


def five_numbers(table: pd.DataFrame, measure: str, gains: Sequence[Mapping[str, float]]) -> Array:
    """Minimum, quartiles and maximum of a measure in runs of one engine: (settings, repeats, 5).

    Repeats (starts, layouts) in which a setting is missing or failed are left out. Raises InvalidInputError if none is
    left.
    """
    columns = [f"{measure}_{statistic}" for statistic in ("min", "lower", "median", "upper", "max")]
    per_setting = []
    for setting in gains:
        chosen = table[np.logical_and.reduce([np.isclose(table[name], setting[name]) for name in GAINS])]
        per_setting.append(chosen[chosen["status"] == "ok"].set_index(["seed", "layout"])[columns].dropna())
    common = per_setting[0].index
    for runs in per_setting[1:]:
        common = common.intersection(runs.index)
    if len(common) == 0:
        raise InvalidInputError(f"table: no start or layout has {measure} at all of the {len(gains)} settings")
    return np.array([runs.loc[common.sort_values()].to_numpy() for runs in per_setting])


def panels(tables: Mapping[str, pd.DataFrame], gains: Sequence[Mapping[str, float]]) -> dict[str, dict[str, Array]]:
    """``five_numbers`` of height, pitch rate and roll rate in several tables, as ``figures.draw_sweep`` takes them.

    A table without any of the ``gains``' runs is left out.
    """
    held = {n: t for n, t in tables.items() if all(len(t.merge(pd.DataFrame([setting]))) for setting in gains)}
    measures = ("height", "pitch_rate", "roll_rate")
    return {m: {name: five_numbers(table, m, gains) for name, table in held.items()} for m in measures}


def statement_verdicts() -> pd.DataFrame:
    """Every statement of paper A judged from the committed sweeps, as ``hexakin.papers.statements.verdicts`` does."""
    return verdicts(pd.concat([load_results(f"{scenario}_sweeps")[0] for scenario in SCENARIOS]))


def statements_table() -> str:
    """Every statement of paper A beside what the committed sweeps found, as the README's markdown table."""
    return summary(statement_verdicts())
