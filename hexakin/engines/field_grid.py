"""A height field for the compiled search: its heights, and bounds of heights and slopes in blocks of cells."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from hexakin.checks import Array
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, part
from hexakin.terrain.height_field import GridMesh

_UNEVEN = 1e-5  # of a cell: ten times the error that HeightField allows in the spacing of an axis


class Field(NamedTuple):
    """A height field for the compiled search.

    Blocks of level 0 have 4 x 4 cells of the field, those of each next level 4 x 4 blocks of the level below; the last
    level is one block.

    Parameters
    ----------
    x, y, z
        Axes (nx,), (ny,) and heights (nx, ny) [m], read-only. Without a height field they are empty.
    bounds
        Smallest and largest height [m], slope in x and slope in y (n, 6) of each block; the slopes are those in the
        block and in the cells around it.
    levels
        Number of the first block, and numbers of blocks in x and in y (k, 3), of each level. Block (i, j) of level k
        has the number ``levels[k, 0] + i * levels[k, 2] + j``.
    """

    x: Array
    y: Array
    z: Array
    bounds: Array
    levels: Whole

    def __repr__(self) -> str:
        return short_repr(self)


_FIELDS: WeakKeyDictionary[GridMesh, Field] = WeakKeyDictionary()


def compile_field(mesh: GridMesh) -> Field:
    """Return a mesh as a Field. It is made once for each mesh."""
    if mesh not in _FIELDS:
        _FIELDS[mesh] = _field(mesh.x, mesh.y, mesh.z)
    return _FIELDS[mesh]


def no_field() -> Field:
    """Return a field without points, for ground without height field."""
    axis, heights = np.zeros(0), np.zeros((0, 0))
    for array in (axis, heights):
        array.setflags(write=False)  # compiled code takes read-only arrays for another type
    return Field(axis, axis, heights, np.zeros((0, 6)), np.zeros((0, 3), dtype=np.int64))


def _field(x: Array, y: Array, z: Array) -> Field:
    slopes_x, slopes_y = np.diff(z, axis=0) / (x[1] - x[0]), np.diff(z, axis=1) / (y[1] - y[0])
    shape = (-(-(len(x) - 1) // 4), -(-(len(y) - 1) // 4))
    # Points 0 to 4 of a block; its edges along an axis, with one cell more on all sides.
    parts = [
        _blocks(values, along_x, along_y, shape)
        for values, along_x, along_y in (
            (z, range(5), range(5)),
            (slopes_x, range(-1, 5), range(-1, 6)),
            (slopes_y, range(-1, 6), range(-1, 5)),
        )
    ]
    level = np.stack([bound for part in parts for bound in part], axis=-1)
    pyramid = [level]
    while level.shape[0] * level.shape[1] > 1:
        shape = (-(-shape[0] // 4), -(-shape[1] // 4))
        parts = [_blocks(level[..., k], range(4), range(4), shape) for k in range(6)]
        level = np.stack([parts[k][k % 2] for k in range(6)], axis=-1)
        pyramid.append(level)
    first = np.cumsum([0] + [level.shape[0] * level.shape[1] for level in pyramid[:-1]])
    levels = np.array([[n, *level.shape[:2]] for n, level in zip(first, pyramid, strict=True)], dtype=np.int64)
    return Field(x, y, np.ascontiguousarray(z), np.concatenate([level.reshape(-1, 6) for level in pyramid]), levels)


def _blocks(values: Array, along_x: range, along_y: range, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Return smallest and largest of the values (n, m) at the given places of each block of 4 x 4, if they exist."""
    found = []
    for extreme in (np.minimum, np.maximum):
        block = values
        for axis, places in ((0, along_x), (1, along_y)):
            first, last = 4 * np.arange(shape[axis]), block.shape[axis] - 1
            rows = [np.take(block, (first + place).clip(0, last), axis=axis) for place in places]
            block = rows[0]
            for row in rows[1:]:
                extreme(block, row, out=block)
        found.append(block)
    return found[0], found[1]


@part
def field_cells(axis: Array, place: float, reach: float) -> tuple[int, int]:
    """First and last cell along an axis within ``reach`` [m] of a place [m]; the range is empty if there is none."""
    last = axis.size - 2
    step = (axis[last + 1] - axis[0]) / (last + 1)
    low, high = (place - reach - axis[0]) / step - _UNEVEN, (place + reach - axis[0]) / step + _UNEVEN
    if not (high >= 0.0 and low <= last + 1.0):  # also for NaN
        return 0, -1
    return int(max(low, 0.0)), int(min(high, last + 0.5))


@part
def first_block(field: Field, window: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """Level and place (i, j) of the first block for a search in a window of cells, and this level once more.

    The window (first and last i, first and last j) is in one to four blocks of this level. The level is -1 if the
    window is empty.
    """
    i0, i1, j0, j1 = window
    if i0 > i1 or j0 > j1:
        return -1, 0, 0, -1
    top = 0
    while (i1 >> 2 * top + 2) - (i0 >> 2 * top + 2) > 1 or (j1 >> 2 * top + 2) - (j0 >> 2 * top + 2) > 1:
        top += 1
    return top, i0 >> 2 * top + 2, j0 >> 2 * top + 2, top


@part
def next_block(
    window: tuple[int, int, int, int], top: int, level: int, i: int, j: int, inside: bool
) -> tuple[int, int, int]:
    """Level and place (i, j) of the block that follows block (``i``, ``j``) of ``level`` in the search of a window.

    ``inside`` leads to the first block in this block, which must not be of level 0. Otherwise the next one beside it
    follows. The level is -1 at the end.
    """
    i0, i1, j0, j1 = window
    if inside:
        return level - 1, max(4 * i, i0 >> 2 * level), max(4 * j, j0 >> 2 * level)
    while level <= top:
        shift = 2 * level + 2
        if j < j1 >> shift and (level == top or j & 3 != 3):
            return level, i, j + 1
        j = j0 >> shift if level == top else max(4 * (j >> 2), j0 >> shift)
        if i < i1 >> shift and (level == top or i & 3 != 3):
            return level, i + 1, j
        level, i, j = level + 1, i >> 2, j >> 2
    return -1, 0, 0


@part
def block_cells(window: tuple[int, int, int, int], level: int, i: int, j: int) -> tuple[int, int, int, int]:
    """First and last i, first and last j of the cells of block (``i``, ``j``) of ``level`` that are in a window."""
    shift = 2 * level + 2
    return (
        max(i << shift, window[0]),
        min((i + 1 << shift) - 1, window[1]),
        max(j << shift, window[2]),
        min((j + 1 << shift) - 1, window[3]),
    )


@part
def field_triangle(field: Field, i: int, j: int, far: int, T: Array) -> None:
    """Write the vertices [m] of a triangle of cell (``i``, ``j``) to the first nine numbers of ``T`` (12,).

    ``far`` is 0 for the triangle with the corner (i, j) of the cell, 1 for the other one.
    """
    x0, x1, y0, y1 = field.x[i], field.x[i + 1], field.y[j], field.y[j + 1]
    T[3], T[4], T[6], T[7], T[8] = x1, y0, x0, y1, field.z[i, j + 1]
    if far == 0:
        T[0], T[1], T[2], T[5] = x0, y0, field.z[i, j], field.z[i + 1, j]
    else:
        T[0], T[1], T[2], T[4], T[5] = x1, y0, field.z[i + 1, j], y1, field.z[i + 1, j + 1]
