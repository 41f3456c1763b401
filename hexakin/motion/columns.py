"""Columns of time series: fields of a dataclass that hold one row per instant, with their axes, units and meanings.

The description of a field is its metadata. The docstring of the class, its table in a notebook and its pandas
DataFrame are made from it.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import Field, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from hexakin.checks import Array, check_poses
from hexakin.exceptions import InvalidInputError
from hexakin.numerics.display import html_table, spread
from hexakin.robot.model import SEGMENT_NAMES

if TYPE_CHECKING:
    import pandas as pd

_Class = TypeVar("_Class", bound=type)

_SIZES: dict[str, tuple[str | int, ...]] = {"leg": ("L",), "joint": (3,), "axis": (3,), "pose": (4, 4)}
_LABELS = {"joint": SEGMENT_NAMES, "axis": ("x", "y", "z"), "pose": ("x", "y", "z", "qx", "qy", "qz", "qw")}


def column(axes: str, unit: str, text: str, kind: str = "f") -> dict[str, Any]:
    """Return the metadata of a column: the axes of a row, the unit, the meaning and NumPy's kind of number.

    ``axes`` are words out of "leg", "joint", "axis" and "pose"; empty for one number in each row.
    """
    return {"axes": tuple(axes.split()), "unit": unit, "text": text, "kind": kind}


def columns_of(kind: type) -> tuple[Field, ...]:
    """Return the fields of a dataclass that are columns."""
    return tuple(part for part in fields(kind) if "axes" in part.metadata)


def row_shape(part: Field) -> tuple[str | int, ...]:
    """Return the shape of one row of a column; "L" stands for the number of legs."""
    return tuple(size for axis in part.metadata["axes"] for size in _SIZES[axis])


def described(rows: str) -> Callable[[_Class], _Class]:
    """Return a decorator that adds a table of the columns to the docstring; ``rows`` is the letter of their number."""

    def decorated(kind: _Class) -> _Class:
        table = [("field", "shape", "unit", "")]
        for part in columns_of(kind):
            shape = ", ".join([rows, *map(str, row_shape(part))])
            comma = "," * (shape == rows)
            table.append((f"``{part.name}``", f"({shape}{comma})", part.metadata["unit"], part.metadata["text"]))
        widths = [max(len(row[k]) for row in table) for k in range(4)]
        line = "  ".join("=" * width for width in widths)
        head, *body = ("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in table)
        first, _, rest = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")
        kind.__doc__ = "\n".join([f"{first}\n", line, head, line, *body, line, f"\n{rest}"])
        return kind

    return decorated


def columns_table(value: Any, caption: str, more: Mapping[str, Array] | None = None) -> str:
    """Return the columns of ``value`` as an HTML table: name, shape, unit, range of the values and meaning.

    ``caption`` stands above the table. ``more`` are further columns by name, of unknown unit.
    """
    rows = []
    for part, array in _present(value):
        ranged = array[..., :3, 3] if part.metadata["axes"] == ("pose",) else array  # a rotation is not in metres
        rows.append((part.name, str(array.shape), part.metadata["unit"], spread(ranged), part.metadata["text"]))
    rows += [(name, str(np.shape(array)), "", spread(np.asarray(array)), "") for name, array in (more or {}).items()]
    return html_table(caption, ("column", "shape", "unit", "range", ""), rows)


def dataframe(value: Any, more: Mapping[str, Array] | None = None) -> pd.DataFrame:
    """Return the columns of ``value`` as a DataFrame with the index ``time`` [s], or the number of the row.

    An array with more than one axis becomes several columns, and their names end with leg, joint and axis:
    ``q_leg1_coxa`` [rad], ``p_body_foot_leg6_z`` [m]. A pose becomes a position and a quaternion with a scalar part
    that is not negative: ``T_world_body_x`` to ``_z`` [m] and ``_qx`` to ``_qw``. ``more`` are further columns by name,
    one number for each row. Raises InvalidInputError for shapes that do not go together and for names that occur twice.
    """
    import pandas as pd

    present = [(part.name, part.metadata["axes"], array) for part, array in _present(value)]
    present += [(name, (), np.asarray(array)) for name, array in (more or {}).items()]
    legs = next((array.shape[1] for _, axes, array in present if axes[:1] == ("leg",) and array.ndim > 1), 0)
    rows = len(present[0][2]) if present[0][2].ndim else 0
    series: dict[str, np.ndarray] = {}
    for name, axes, array in present:
        shape = (rows, *(legs if size == "L" else size for axis in axes for size in _SIZES[axis]))
        if array.shape != shape:
            raise InvalidInputError(f"{name}: shape {array.shape}, expected {shape}")
        for end, values in _numbers(name, axes, array):
            if name + end in series:
                raise InvalidInputError(f"{name}: the name {name + end} occurs twice")
            series[name + end] = values
    time = series.pop("time", None)
    index = pd.RangeIndex(rows) if time is None else pd.Index(time, name="time")
    return pd.DataFrame(series, index=index)


def _present(value: Any) -> Iterator[tuple[Field, np.ndarray]]:
    """Yield the columns that are not None."""
    for part in columns_of(type(value)):
        array = getattr(value, part.name)
        if array is not None:
            yield part, np.asarray(array)


def _numbers(name: str, axes: tuple[str, ...], array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the ending of the name and the values of each column of numbers in ``array`` (n, ...)."""
    if axes == ("pose",):
        poses = check_poses(name, array)
        quat_xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
        array = np.hstack([poses[:, :3, 3], quat_xyzw * np.copysign(1.0, quat_xyzw[:, 3:])])
    labels = [[f"leg{leg + 1}" for leg in range(array.shape[1])] if axis == "leg" else _LABELS[axis] for axis in axes]
    flat = array.reshape(len(array), -1)
    for number, ends in enumerate(itertools.product(*labels)):
        yield "".join(f"_{end}" for end in ends), flat[:, number]
