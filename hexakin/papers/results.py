"""Tables of paper A's full studies, and the numbers that the figures show."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from hexakin.checks import Array, check_columns
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.installation import DATA
from hexakin.papers.gains import GAINS
from hexakin.papers.scenarios import SCENARIOS
from hexakin.papers.statements import verdict_table, verdicts
from hexakin.study.tables import read_table


def load_results(name: str) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Table of a full study in data/results, and its provenance (call, versions, code). Raises UnknownNameError."""
    folder = DATA / "results"
    if not (folder / f"{name}.csv").is_file():
        raise UnknownNameError("results", name, sorted(path.stem for path in folder.glob("*.csv")))
    about = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return read_table(folder / f"{name}.csv"), about


def five_numbers(table: pd.DataFrame, measure: str, gains: Sequence[Mapping[str, float]]) -> Array:
    """Minimum, quartiles and maximum of a measure in the runs of one engine, (gains, repeats, 5), in SI units.

    ``table`` has one row per run, and ``gains`` are the gains to choose from it. Repeats (starts or layouts) in which
    the run with one of the gains is missing or failed are left out. Raises InvalidInputError for missing columns, and
    if no repeat is left.
    """
    columns = [f"{measure}_{statistic}" for statistic in ("min", "lower", "median", "upper", "max")]
    check_columns("table", table, [*GAINS, "status", "seed", "layout", *columns])
    per_setting = []
    for setting in gains:
        chosen = table[np.logical_and.reduce([np.isclose(table[name], setting[name]) for name in GAINS])]
        per_setting.append(chosen[chosen["status"] == "ok"].set_index(["seed", "layout"])[columns].dropna())
    common = per_setting[0].index
    for runs in per_setting[1:]:
        common = common.intersection(runs.index)
    if len(common) == 0:
        raise InvalidInputError(f"table: no start or layout has {measure} with all of the {len(gains)} gains")
    return np.array([runs.loc[common.sort_values()].to_numpy() for runs in per_setting])


def panels(tables: Mapping[str, pd.DataFrame], gains: Sequence[Mapping[str, float]]) -> dict[str, dict[str, Array]]:
    """``five_numbers`` of height, pitch rate and roll rate in several tables, in the form for ``figures.draw_sweep``.

    A table that lacks the runs of one of the ``gains`` is left out.
    """
    held = {n: t for n, t in tables.items() if all(len(t.merge(pd.DataFrame([setting]))) for setting in gains)}
    measures = ("height", "pitch_rate", "roll_rate")
    return {m: {name: five_numbers(table, m, gains) for name, table in held.items()} for m in measures}


def statement_verdicts() -> pd.DataFrame:
    """Verdicts on every statement of paper A from the stored sweeps (``hexakin.papers.statements.verdicts``)."""
    return verdicts(pd.concat([load_results(f"{scenario}_sweeps")[0] for scenario in SCENARIOS]))


def statements_table() -> str:
    """Every statement of paper A with its verdict from the stored sweeps, as the markdown table of the README."""
    return verdict_table(statement_verdicts())
