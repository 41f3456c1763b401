"""Forward kinematics, Jacobians and inverse kinematics of a robot, by one of three numeric codes of its leg type.

The formulas are those of A(12) and A(14)-(18), and of B(1)-(13), derived again for each leg type.

- *Floats*: Python's floats, leg by leg, for up to ``FEW`` leg poses. One call of NumPy costs as much as dozens of
  operations with floats.
- *Blocks*: NumPy, on blocks that fit the processor's cache.
- *Loops*: loops compiled by numba, five to ten times faster than NumPy. To load them takes a process about a second,
  and to compile them ten, once for an installation. A call with ``MANY`` leg poses loads them; after ``prepare`` all
  calls with more than ``FEW`` use them.

Apart from ``prepare``, only the size of a call decides which code is used, and not what was called before: equal
arguments give equal bits. The results of the three codes agree to rounding.

The functions here take arrays of floats with a checked shape. Each code checks the numbers as it reads them, and raises
``OutOfRangeError`` instead of returning a result. The public functions then look for the element and name it. To check
the numbers before would be to read them twice, which costs the loops up to a fifth of their time.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from types import ModuleType
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, checked, read_only
from hexakin.kinematics.bounds import Bounds, bounds_of
from hexakin.kinematics.leg_functions import LegFunctions, leg_functions
from hexakin.numerics.display import short_repr
from hexakin.numerics.trigonometry import PER_TURN, TURN
from hexakin.robot.model import Robot

FEW = 48
"""Largest number of leg poses for which Python's floats are used."""

MANY = 500_000
"""Smallest number of leg poses in a call that loads the compiled loops."""

_BLOCK = 12288  # leg poses: few enough for the cache, and enough that a call of NumPy costs little beside its work
_NEAR = 3.14  # [rad]: a little less than half a turn
_TILE = 288  # leg poses of a compiled loop: few enough for the cache, and enough that its start costs little


class OutOfRangeError(Exception):
    """An argument is out of the range of the code that is used; the public functions deal with it.

    A coordinate or an angle is not finite, or an angle of a batch is larger than ``LARGEST`` of
    ``hexakin.numerics.trigonometry``.
    """


def fits(values: ArrayLike, robot: Robot) -> TypeGuard[Array]:
    """Whether ``values`` are an array (..., L, 3) of floats already, for the L legs of ``robot``."""
    return type(values) is np.ndarray and values.dtype == float and values.shape[-2:] == (robot.num_legs, 3)


@checked
def prepare(robot: Robot) -> bool:
    """Load the compiled loops of a robot's legs now, for batches of all sizes from here on.

    Returns whether there are any. There are none without numba, or without a place for machine code; NumPy is used
    then. Raises InvalidInputError if ``robot`` is not a robot.
    """
    if leg_functions(robot.table).loops is None:
        return False
    _prepared.add(robot.table.type_key)
    return True


_prepared: set[str] = set()  # leg types


def _loops(functions: LegFunctions, count: int) -> ModuleType | None:
    """Return the compiled loops if a call of ``count`` leg poses uses them."""
    return functions.loops if count >= MANY or functions.table.type_key in _prepared else None


@dataclass(frozen=True)
class _OfAngles:
    """Foot positions or Jacobians of a robot's L legs.

    ``name`` is "forward" or "jacobian", and ``shape`` the shape of one leg's values. ``constants`` (k, L) are the legs'
    constants in the formulas.
    """

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
    def block(self) -> Array:
        return _tiled(self.constants, _BLOCK)

    @cached_property
    def tile(self) -> Array:
        return _tiled(self.constants, _TILE)

    def __call__(self, q: Array) -> Array:
        """Return the values (..., L, *shape) for angles ``q`` (..., L, 3) [rad].

        Raises OutOfRangeError for an angle that is not finite, or is too large for the polynomials of a batch.
        """
        result = np.empty(q.shape[:-1] + self.shape)
        if q.size <= 3 * FEW:
            angles = q.ravel().tolist()
            if not all(map(math.isfinite, angles)):
                raise OutOfRangeError
            result.ravel()[:] = self.scalar(self.rows, angles)
            return result
        count, flat = q.size // 3, q.ravel()
        loops = _loops(self.functions, count)
        if loops is None:
            self._blocks(flat.reshape(-1, 3), result.reshape(count, -1))
        elif getattr(loops, self.name)(self.tile, flat, result.ravel()):
            raise OutOfRangeError
        return result

    def _blocks(self, q: Array, result: Array) -> None:
        numeric, constants = self.functions.numeric, self.block
        arrays, rows = getattr(numeric, f"{self.name}_arrays"), getattr(numeric, f"{self.name.upper()}_ROWS")
        step = constants.shape[1]
        for start in range(0, len(q), step):
            part = q[start : start + step].T
            count = part.shape[1]
            try:
                arrays(constants[:, :count], part, workspace(rows, count), result[start : start + step].T)
            except ValueError as error:  # from hexakin.numerics.trigonometry.sincos
                raise OutOfRangeError from error


class _Workspace(threading.local):
    """A thread's memory (about 2 MB) for the values between a block's input and output, kept from call to call.

    To ask the system for it at every call would take as long as the arithmetic.
    """

    values = np.empty(0)


_workspace = _Workspace()


def workspace(rows: int, count: int) -> Array:
    """Return an array (``rows``, ``count``) in the thread's memory. What was in it before is lost."""
    if _workspace.values.size < rows * count:
        _workspace.values = np.empty(rows * count)
    return _workspace.values[: rows * count].reshape(rows, count)


class Solved(NamedTuple):
    """Branches of the inverse: angles ``q`` (b, N, 3) [rad], flags and ``distance`` [m] (b, N), for N leg poses."""

    q: Array
    reachable: NDArray[np.bool_]
    within_limits: NDArray[np.bool_]
    distance: Array

    def __repr__(self) -> str:
        return short_repr(self)

    def at(self, index: Any) -> Solved:
        """Return the part at ``index`` of the axes b and N, as views."""
        return Solved(*[values[index] for values in self])


@dataclass(frozen=True)
class _Inverse:
    """Inverse of a robot's L legs on b branches.

    ``constants`` (b, k, L) are the legs' constants in the formulas; ``bounds`` are those of the L legs, as arrays.
    """

    functions: LegFunctions
    constants: Array
    bounds: Bounds

    @cached_property
    def rows(self) -> tuple[list[list[list[float]]], Bounds]:
        return np.swapaxes(self.constants, 1, 2).tolist(), self.bounds.each(lambda values: values.T.tolist())

    @cached_property
    def block(self) -> tuple[Array, Bounds]:
        return _tiled(self.constants, _BLOCK), self.bounds.each(partial(_tiled, size=_BLOCK))

    @cached_property
    def tile(self) -> Array:
        loops = self.functions.loops
        assert loops is not None
        return _tiled(np.array([loops.inverse_rows(constants, self.bounds) for constants in self.constants]), _TILE)

    def __call__(self, foot: Array, total: int = 0) -> Solved:
        """Solve for feet ``foot`` (..., L, 3) [m].

        ``total`` is the number of leg poses of the whole call, if ``foot`` is a part of them. Raises OutOfRangeError
        for a coordinate that is not finite.
        """
        count, branches = foot.size // 3, len(self.constants)
        if count <= FEW:
            return self._floats(foot)
        flat = foot.ravel()
        result = Solved(
            np.empty((branches, count, 3)),
            np.empty((branches, count), dtype=bool),
            np.empty((branches, count), dtype=bool),
            np.empty((branches, count)),
        )
        loops = _loops(self.functions, branches * max(count, total))
        if loops is not None:
            if loops.inverse(self.tile, flat, result.q.reshape(branches, -1), *result[1:]):
                raise OutOfRangeError
            return result
        if not np.isfinite(flat).all():
            raise OutOfRangeError
        # A foot that is too far for its square is not reached.
        with np.errstate(over="ignore", invalid="ignore"):
            self._blocks(flat.reshape(-1, 3), result)
        return result

    def _floats(self, foot: Array) -> Solved:
        feet = foot.ravel().tolist()
        if not all(map(math.isfinite, feet)):
            raise OutOfRangeError
        branches, bounds = self.rows
        found = [self.functions.numeric.inverse_scalar(rows, bounds, feet) for rows in branches]
        q, reachable, within, distance = (np.array(values) for values in zip(*found, strict=True))
        return Solved(q.reshape(len(branches), -1, 3), reachable, within, distance)

    def _blocks(self, foot: Array, result: Solved) -> None:
        constants, bounds = self.block
        step = constants.shape[-1]
        for start in range(0, len(foot), step):
            part = slice(start, min(start + step, len(foot)))
            count = part.stop - start
            rows = workspace(self.functions.numeric.INVERSE_ROWS + 4, count)
            feet, work = rows[:3], rows[3:]
            np.copyto(feet, foot[part].T)
            kept = bounds.first(count)
            for branch, every in enumerate(constants[..., :count]):
                self._block(every, kept, feet, work, result.at((branch, part)))

    def _block(self, constants: Array, bounds: Bounds, feet: Array, work: Array, result: Solved) -> None:
        """Solve for ``feet`` (3, n) on one branch and write ``result`` (n, ...), with the rows of ``work`` (m, n)."""
        q, reachable, within, distance = result
        *angles, clearance, outer, inner, square = self.functions.numeric.inverse_arrays(constants, feet, work)
        turns = work[-1]
        np.sqrt(square, distance)
        least = np.minimum(np.minimum(clearance, outer, out=clearance), inner, out=clearance)
        least += bounds.tolerance
        np.greater_equal(least, 0.0, reachable)
        np.copyto(within, reachable)
        for k, angle in enumerate(angles):
            np.subtract(bounds.middle[k], angle, turns)
            if turns.max() > _NEAR or turns.min() < -_NEAR:  # else there is no turn to take off
                turns *= PER_TURN
                np.rint(turns, turns)
                turns *= TURN
                angle += turns
            within &= np.greater_equal(angle, bounds.low[k])
            within &= np.less_equal(angle, bounds.high[k])
            q[:, k] = angle
        if not reachable.all():
            q[~reachable] = np.nan


@lru_cache(maxsize=64)
def forward_of(robot: Robot) -> _OfAngles:
    """Return the foot positions of a robot's legs as a function of the angles."""
    functions = leg_functions(robot.table)
    constants = functions.numeric.forward_constants(robot.parameters.T)
    return _OfAngles(functions, "forward", (3,), _rows(constants, robot.num_legs))


@lru_cache(maxsize=64)
def jacobian_of(robot: Robot) -> _OfAngles:
    """Return the Jacobians of a robot's legs as a function of the angles."""
    functions = leg_functions(robot.table)
    constants = functions.numeric.jacobian_constants(robot.parameters.T)
    return _OfAngles(functions, "jacobian", (3, 3), _rows(constants, robot.num_legs))


def inverse_of(robot: Robot, signs: NDArray[np.int_]) -> _Inverse:
    """Return the inverse of a robot's legs as a function of the feet.

    ``signs`` (b, 2), or (L, b, 2) if they differ from leg to leg, are the signs (side, knee) of the b branches. Raises
    NoClosedFormError if the leg type has no closed form.
    """
    functions = leg_functions(robot.table)
    functions.check_closed_form()
    p = robot.parameters.T
    sides = np.broadcast_to(signs, (robot.num_legs, *signs.shape[-2:])).astype(float)
    every = [
        _rows(functions.numeric.inverse_constants(p, sides[:, b, 0], sides[:, b, 1]), robot.num_legs)
        for b in range(sides.shape[1])
    ]
    return _Inverse(functions, np.array(every), bounds_of(robot, reach_of(robot)[:, 1]))


@lru_cache(maxsize=64)
def reach_of(robot: Robot) -> Array:
    """Return the inner and outer reach (L, 2) [m] of each leg with a closed-form inverse; read-only."""
    bounds = leg_functions(robot.table).numeric.reach(robot.parameters.T)
    return read_only(_rows([*bounds], robot.num_legs).T)


def _rows(constants: list, num_legs: int) -> Array:
    rows = [np.broadcast_to(np.asarray(value, dtype=float), num_legs) for value in constants]
    return np.array(rows).reshape(-1, num_legs)


def _tiled(values: Array, size: int) -> Array:
    """Repeat the legs (..., L) up to about ``size`` leg poses."""
    return np.ascontiguousarray(np.tile(values, max(1, size // values.shape[-1])))
