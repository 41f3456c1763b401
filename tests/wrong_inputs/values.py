"""Wrong values: what people pass by mistake, and what nobody should."""

import datetime
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd


class Awkward:
    """An object that raises whenever it is used."""

    def __array__(self, *args, **kwargs):
        raise RuntimeError("no array")

    def __float__(self):
        raise RuntimeError("no float")

    def __repr__(self):
        raise RuntimeError("no text")

    def __len__(self):
        raise RuntimeError("no length")

    def __eq__(self, other):
        raise RuntimeError("not comparable")

    __hash__ = None


def _of_itself():
    values = [1.0]
    values.append(values)
    return values


GENERAL = {
    "None": lambda: None,
    "True": lambda: True,
    "zero": lambda: 0,
    "minus one": lambda: -1,
    "half": lambda: 0.5,
    "thousand": lambda: 1000,
    "nan": lambda: float("nan"),
    "inf": lambda: float("inf"),
    "minus inf": lambda: float("-inf"),
    "1e300": lambda: 1e300,
    "1e-300": lambda: 1e-300,
    "10**400": lambda: 10**400,
    "-10**5000": lambda: -(10**5000),
    "2**63": lambda: 2**63,
    "complex": lambda: 1j,
    "Decimal": lambda: Decimal("0.1"),
    "Fraction": lambda: Fraction(1, 3),
    "numeric text": lambda: "1.0",
    "text": lambda: "athena",
    "empty text": lambda: "",
    "null character": lambda: "\0",
    "long text": lambda: "x" * 5000,
    "bytes": lambda: b"1.0",
    "date": lambda: datetime.date(2024, 1, 1),
    "object": object,
    "class": lambda: int,
    "function": lambda: len,
    "generator": lambda: (i for i in range(3)),
    "awkward object": Awkward,
    "list of itself": _of_itself,
    "empty list": list,
    "ragged list": lambda: [[1.0, 2.0], [3.0]],
    "list of texts": lambda: ["1", "2", "3"],
    "list of None": lambda: [None, None, None],
    "empty dict": dict,
    "dict": lambda: {"robot": 1, 2: "x"},
    "set": lambda: {1.0, 2.0},
    "empty array": lambda: np.zeros(0),
    "array (3,)": lambda: np.arange(3.0),
    "array (2, 2)": lambda: np.ones((2, 2)),
    "array (3, 3, 3, 3)": lambda: np.zeros((3, 3, 3, 3)),
    "array (6, 3) of nan": lambda: np.full((6, 3), np.nan),
    "array of objects": lambda: np.array([object(), None]),
    "array of texts": lambda: np.array(["a", "b"]),
    "array of dates": lambda: np.array(["2024-01-01"], dtype="datetime64[D]"),
    "masked array": lambda: np.ma.masked_array([1.0, 2.0, 3.0], mask=[0, 1, 0]),
    "huge whole array": lambda: np.array([10**30, 1, 2], dtype=object),
    "0-d array": lambda: np.array(1.0),
}
"""Values of every kind by name; each is wrong for most arguments."""


def derived(value):
    """Yield names and wrong forms of a valid argument: what a slip makes of it."""
    if isinstance(value, (list, tuple)) and value and all(isinstance(item, (int, float)) for item in value):
        value = np.asarray(value)
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size:
        yield from _of_an_array(value)
    elif isinstance(value, pd.DataFrame):
        yield from _of_a_table(value).items()
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield from {"in millimetres": 1000.0 * value, "negated": -value, "as text": str(value)}.items()


def _of_a_table(table):
    return {
        "no rows": table.iloc[:0],
        "no columns": table[[]],
        "one column missing": table.drop(columns=table.columns[len(table.columns) // 2]),
        "first column missing": table.drop(columns=table.columns[0]),
        "other names of columns": table.add_prefix("the "),
        "numbers for columns": table.set_axis(range(len(table.columns)), axis=1),
        "all as texts": table.astype(str),
        "all missing": table.mask(np.ones(table.shape, dtype=bool)),
        "rows twice": pd.concat([table, table]),
        "transposed table": table.T,
        "one column": table.iloc[:, 0],
    }


def _of_an_array(value):
    numbers = value.astype(float)
    broken = numbers.copy()
    broken.flat[-1] = np.nan
    yield "last is nan", broken
    yield "in millimetres", 1000.0 * numbers
    yield "transposed", numbers.T
    yield "flat", numbers.ravel()
    if numbers.ndim:
        yield "last row missing", numbers[:-1]
        yield "last column missing", numbers[..., :-1]
        yield "read backwards", value[::-1]
    yield "one more axis", numbers[None]
    yield "three more axes", numbers[None, None, None]
    yield "as texts", value.astype(str)
    yield "single precision", numbers.astype(np.float32)
    yield "zeros", np.zeros_like(numbers)
    yield "huge", np.full_like(numbers, 1e300)
    yield "nested lists", value.tolist()
    yield "other order in memory", np.asfortranarray(value)
