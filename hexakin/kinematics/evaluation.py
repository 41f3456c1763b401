"""Which of a leg type's numeric codes is run: one pose at a time, NumPy in blocks, or compiled loops.

Up to ``FEW`` leg poses Python's own floats are the fastest, since each call of NumPy costs as much as dozens of
their operations. Beyond, NumPy works on blocks that stay in the cache. Compiled loops are five to ten times faster
still, but to load them takes a process about a second (and to compile them ten, once for an installation). A call with
``MANY`` leg poses loads them; smaller batches use them after ``prepare``. Only the size of a call decides, and not what
was called before it: equal arguments give equal bits. The results of the three agree to rounding, not to the last bit.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, read_only
from hexakin.kinematics.leg_functions import LegFunctions, leg_functions
from hexakin.numerics.trigonometry import PER_TURN, TURN
from hexakin.robot.model import Robot, check_robot

FEW = 48
"""Leg poses up to which Python's floats are used."""

MANY = 500_000
"""Leg poses of a call from which on compiled loops are loaded for it."""

LIMIT_TOLERANCE = 1e-9
"""[rad]: rounding must not push a pose on its limit out of it."""

REACH_TOLERANCE = 1e-12
"""Relative to the leg's squared length: a foot within about 1e-13 m of the boundary counts as reached, since a
stretched leg's own forward kinematics lands outside by rounding."""

_BLOCK = 12288  # leg poses: few enough for a cache, and a call of NumPy costs little beside its work
_NEAR = 3.14  # [rad]: a little less than half a turn
_TILE = 288  # leg poses of a compiled loop: enough that to start it costs little, few enough for the cache


def fits(robot: Robot, values: ArrayLike) -> bool:
    """Whether ``values`` are an array (..., L, 3) of floats already, and need no conversion."""
    return type(values) is np.ndarray and values.dtype == float and values.shape[-2:] == (robot.num_legs, 3)


def prepare(robot: Robot) -> bool:
    """Load the compiled loops of a robot's legs now, for batches of all sizes from here on.

    Returns whether there are any (False: no numba, or no place for machine code; NumPy then serves).
    """
    check_robot(robot)
    if leg_functions(robot.table).loops is None:
        return False
    _prepared.add(robot.table.type_key)
    return True


_prepared: set[str] = set()  # leg types


def _loops(functions: LegFunctions, count: int) -> ModuleType | None:
    return functions.loops if count >= MANY or functions.table.type_key in _prepared else None


@dataclass(frozen=True)
class _OfAngles:
    """Foot positions or Jacobians of a robot's legs; ``shape`` is that of one leg's."""

    functions: LegFunctions
    name: str
    shape: tuple[int, ...]
    constants: Array

    @cached_property
    def scalar(self) -> Callable[[list, list], list]:
        return getattr(self.functions.numeric, f"{self.name}_scalar")

    @cached_property
    def rows(self) -> list[list[float]]:
        return self.constants.T.tolist()

    @cached_property
    def tiled(self) -> dict[int, Array]:
        return {size: _tiled(self.constants, size) for size in (_BLOCK, _TILE)}

    def __call__(self, q: Array) -> Array | None:
        """Values for angles ``q`` (..., L, 3) [rad]; None if one is not finite, or too large for a batch."""
        if q.size <= 3 * FEW:
            many = self.rows if q.ndim == 2 else self.rows * (q.size // (3 * len(self.rows)))
            try:
                values = self.scalar(many, q.tolist() if q.ndim == 2 else q.reshape(-1, 3).tolist())
            except ValueError:  # the sine of an infinite angle
                return None
            if not math.isfinite(sum(values)):
                return None
            result = np.empty(q.shape[:-1] + self.shape)
            result.reshape(-1)[:] = values  # in half the time of np.array(values).reshape(...)
            return result
        count, flat = q.size // 3, q.ravel()
        result = np.empty(q.shape[:-1] + self.shape)
        loops = _loops(self.functions, count)
        if loops is not None:
            lost = getattr(loops, self.name)(self.tiled[_TILE], flat, result.ravel()) > 0
            return None if lost else result
        return result if self._blocks(flat.reshape(-1, 3), result.reshape(count, -1)) else None

    def _blocks(self, q: Array, result: Array) -> bool:
        numeric, constants = self.functions.numeric, self.tiled[_BLOCK]
        arrays, rows = getattr(numeric, f"{self.name}_arrays"), getattr(numeric, f"{self.name.upper()}_ROWS")
        step = constants.shape[1]
        for start in range(0, len(q), step):
            part = q[start : start + step].T
            count = part.shape[1]
            try:
                arrays(constants[:, :count], part, workspace(rows, count), result[start : start + step].T)
            except ValueError:  # too large, or not a number
                return False
        return True


class _Workspace(threading.local):
    """A thread's memory (about 2 MB) for the values between a block's input and output, kept from call to call.

    To ask the system for it at every call would take as long as the arithmetic.
    """

    values = np.empty(0)


_workspace = _Workspace()


def workspace(rows: int, count: int) -> Array:
    """Rows (``rows``, ``count``) of the thread's memory; what was in them before is lost."""
    if _workspace.values.size < rows * count:
        _workspace.values = np.empty(rows * count)
    return _workspace.values[: rows * count].reshape(rows, count)


class Solved(NamedTuple):
    """Branches of the inverse: angles ``q`` (b, N, 3) [rad], flags and ``distance`` [m] (b, N), for N leg poses."""

    q: Array
    reachable: NDArray[np.bool_]
    within_limits: NDArray[np.bool_]
    distance: Array


@dataclass(frozen=True)
class _Inverse:
    """Inverse of a robot's legs on b branches, with ``constants`` (b, k, L); the last ten are ``bounds``."""

    functions: LegFunctions
    constants: Array

    @cached_property
    def rows(self) -> list[list[list[float]]]:
        return np.swapaxes(self.constants, 1, 2).tolist()

    @cached_property
    def tiled(self) -> dict[int, Array]:
        return {size: _tiled(self.constants, size) for size in (_BLOCK, _TILE)}

    def __call__(self, foot: Array, total: int = 0) -> Solved:
        """Solve for feet (..., L, 3) [m], a part of ``total`` leg poses if that is more."""
        count, branches = foot.size // 3, len(self.constants)
        if count <= FEW:
            feet, number = foot.reshape(-1, 3).tolist(), count // self.constants.shape[-1]
            found = [self.functions.numeric.inverse_scalar(rows * number, feet) for rows in self.rows]
            q, reachable, within, distance = (np.array(values) for values in zip(*found, strict=True))
            return Solved(q.reshape(branches, count, 3), reachable, within, distance)
        flat = foot.ravel()
        result = Solved(
            np.empty((branches, count, 3)),
            np.empty((branches, count), dtype=bool),
            np.empty((branches, count), dtype=bool),
            np.empty((branches, count)),
        )
        loops = _loops(self.functions, branches * max(count, total))
        if loops is not None:
            loops.inverse(self.tiled[_TILE], flat, result.q.reshape(branches, -1), *result[1:])
        else:
            # A foot that is too far for its square is not reached.
            with np.errstate(over="ignore", invalid="ignore"):
                self._blocks(flat.reshape(-1, 3), result)
        return result

    def _blocks(self, foot: Array, result: Solved) -> None:
        constants = self.tiled[_BLOCK]
        step = constants.shape[-1]
        for start in range(0, len(foot), step):
            part = slice(start, min(start + step, len(foot)))
            rows = workspace(self.functions.numeric.INVERSE_ROWS + 4, part.stop - start)
            feet, work = rows[:3], rows[3:]
            np.copyto(feet, foot[part].T)
            for branch, every in enumerate(constants[:, :, : feet.shape[1]]):
                self._block(
                    every,
                    feet,
                    work,
                    result.q[branch, part],
                    result.reachable[branch, part],
                    result.within_limits[branch, part],
                    result.distance[branch, part],
                )

    def _block(
        self,
        constants: Array,
        feet: Array,
        work: Array,
        q: Array,
        reachable: NDArray[np.bool_],
        within: NDArray[np.bool_],
        distance: Array,
    ) -> None:
        *angles, clearance, outer, inner, square = self.functions.numeric.inverse_arrays(constants[:-10], feet, work)
        bounds, turns = constants[-10:], work[-1]
        np.sqrt(square, distance)
        least = np.minimum(np.minimum(clearance, outer, out=clearance), inner, out=clearance)
        least += bounds[0]
        np.greater_equal(least, 0.0, reachable)
        np.copyto(within, reachable)
        for k, angle in enumerate(angles):
            np.subtract(bounds[1 + k], angle, turns)
            if turns.max() > _NEAR or turns.min() < -_NEAR:  # else there is no turn to take off
                turns *= PER_TURN
                np.rint(turns, turns)
                turns *= TURN
                angle += turns
            within &= np.greater_equal(angle, bounds[4 + k])
            within &= np.less_equal(angle, bounds[7 + k])
            q[:, k] = angle
        if not reachable.all():
            q[~reachable] = np.nan


@lru_cache(maxsize=64)
def forward_of(robot: Robot) -> _OfAngles:
    """Foot positions of a robot's legs as a function of its angles."""
    functions = leg_functions(robot.table)
    constants = functions.numeric.forward_constants(robot.parameters.T)
    return _OfAngles(functions, "forward", (3,), _rows(constants, robot.num_legs))


@lru_cache(maxsize=64)
def jacobian_of(robot: Robot) -> _OfAngles:
    """Jacobians of a robot's legs as a function of its angles."""
    functions = leg_functions(robot.table)
    constants = functions.numeric.jacobian_constants(robot.parameters.T)
    return _OfAngles(functions, "jacobian", (3, 3), _rows(constants, robot.num_legs))


def inverse_of(robot: Robot, signs: NDArray[np.int_]) -> _Inverse:
    """Inverse of a robot's legs on the branches of ``signs`` (b, 2) or (L, b, 2): side and knee."""
    functions = leg_functions(robot.table)
    functions.check_closed_form()
    p = robot.parameters.T
    sides = np.broadcast_to(signs, (robot.num_legs, *signs.shape[-2:])).astype(float)
    tolerance = REACH_TOLERANCE * reach_of(robot)[:, 1] ** 2
    middle = 0.5 * (robot.q_min + robot.q_max)
    bounds = [tolerance, *middle.T, *(robot.q_min - LIMIT_TOLERANCE).T, *(robot.q_max + LIMIT_TOLERANCE).T]
    every = [
        _rows([*functions.numeric.inverse_constants(p, sides[:, b, 0], sides[:, b, 1]), *bounds], robot.num_legs)
        for b in range(sides.shape[1])
    ]
    return _Inverse(functions, np.array(every))


@lru_cache(maxsize=64)
def reach_of(robot: Robot) -> Array:
    """Inner and outer reach (L, 2) [m] of each leg with a closed-form inverse; read-only."""
    bounds = leg_functions(robot.table).numeric.reach(robot.parameters.T)
    return read_only(_rows([*bounds], robot.num_legs).T)


def _rows(constants: list, num_legs: int) -> Array:
    rows = [np.broadcast_to(np.asarray(value, dtype=float), num_legs) for value in constants]
    return np.array(rows).reshape(-1, num_legs)


def _tiled(constants: Array, size: int) -> Array:
    """Repeat the legs (..., L) up to about ``size`` leg poses."""
    return np.ascontiguousarray(np.tile(constants, max(1, size // constants.shape[-1])))
