"""Analysis of full factorial studies: the effects of factors and interactions, and the rank of one setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_columns
from hexakin.exceptions import InvalidInputError


def cells(table: pd.DataFrame, measure: str, factors: Sequence[str]) -> Array:
    """Return the values of a full factorial study as an array (levels of each factor ..., repeats).

    ``table`` is the study's table, ``measure`` the name of the column with the values (in its unit), and ``factors``
    the names of the factors' columns. A repeat is a pair of ``seed`` and ``layout``; runs that failed are NaN. Raises
    InvalidInputError for a combination of levels without any run, a run given twice, or a missing column.
    """
    check_columns("table", table, [*factors, measure, "seed", "layout", "status"])
    if table.duplicated([*factors, "seed", "layout"]).any():
        raise InvalidInputError("table: a run is given twice")
    values = table[measure].where(table["status"] == "ok").to_numpy(dtype=float)
    codes = [pd.factorize(table[name], sort=True) for name in factors]
    repeat, repeats = pd.factorize(pd.MultiIndex.from_frame(table[["seed", "layout"]]))
    result = np.full((*(len(levels) for _, levels in codes), len(repeats)), np.nan)
    result[(*(code for code, _ in codes), repeat)] = values
    empty = np.argwhere(np.isnan(result).all(axis=-1))
    if len(empty):
        setting = ", ".join(f"{n} {levels[k]}" for n, (_, levels), k in zip(factors, codes, empty[0], strict=True))
        raise InvalidInputError(f"table: {len(empty)} settings without a run; the first: {setting}")
    return result


def variance_shares(values: ArrayLike, factors: Sequence[str]) -> dict[str, float]:
    """Return the share of the variance over all runs that each factor and each interaction explains; the sum is 1.

    ``values`` (levels of each factor ..., repeats) may have any unit; ``factors`` are the names of the factors. This is
    the analysis of variance of a balanced design: an effect is the mean over all other factors minus the effects of
    fewer factors. Keys are ``"a"``, ``"a, b"``, ...; ``"repeats"`` is the share of the differences between runs of one
    setting. Missing runs (NaN) are ignored. Raises InvalidInputError if the shape does not fit the factors or a setting
    has no value.
    """
    data = np.asarray(values, dtype=float)
    if data.ndim != len(factors) + 1:
        raise InvalidInputError(f"values: expected {len(factors)} factors and repeats, got shape {data.shape}")
    mean = check_array("values: mean over repeats", np.nanmean(data, axis=-1), ())
    axes = range(len(factors))
    effects: dict[tuple[int, ...], Array] = {(): mean.mean(keepdims=True)}
    sums: dict[str, float] = {}
    for size in range(1, len(factors) + 1):
        for term in combinations(axes, size):
            others = tuple(axis for axis in axes if axis not in term)
            effect = mean.mean(axis=others, keepdims=True) - effects[()]
            for lower, known in effects.items():
                if lower and set(lower) < set(term):
                    effect = effect - known
            effects[term] = effect
            name = ", ".join(factors[axis] for axis in term)
            sums[name] = float(np.sum(np.broadcast_to(effect, mean.shape) ** 2)) / mean.size
    sums["repeats"] = float(np.nanmean((data - mean[..., None]) ** 2))
    total = sum(sums.values())
    return {name: share / total if total > 0.0 else 0.0 for name, share in sums.items()}


def standing(costs: Mapping[str, ArrayLike], setting: tuple[int, ...]) -> dict[str, int]:
    """Return how many settings are better than one setting: for each cost, and for all costs together ("in all").

    ``costs`` are arrays (levels of each factor ...) by name, in any unit; a smaller cost is better. ``setting`` is the
    index of the one setting.
    """
    better = {name: np.asarray(cost) < np.asarray(cost)[setting] for name, cost in costs.items()}
    counted = {name: int(is_better.sum()) for name, is_better in better.items()}
    return {**counted, "in all": int(np.logical_and.reduce(list(better.values())).sum())}
