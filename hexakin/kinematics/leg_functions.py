"""The numeric functions of a leg type, shipped or derived when first used, and a leg's reach."""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np

from hexakin.checks import Array
from hexakin.exceptions import MissingPackageError, NoClosedFormError
from hexakin.generated import MODULES
from hexakin.kinematics.code_cache import code_files, derived, executed, loaded
from hexakin.numerics.trigonometry import LARGEST
from hexakin.robot.leg_table import LegTable
from hexakin.robot.model import Robot


def within_half_turn(angles: Array) -> Array:
    """Return ``angles`` (...) [rad], finite and of any size, plus whole turns, so that they lie in [-pi, pi].

    Angles beyond ``hexakin.numerics.trigonometry.LARGEST`` are too large for its polynomials. The C library's sine and
    cosine, which are used here, take angles of any size.
    """
    return np.arctan2(np.sin(angles), np.cos(angles))


@dataclass(frozen=True)
class LegFunctions:
    """Kinematics of a leg type, the legs' parameters being arguments.

    ``table`` is the leg type's table, and ``numeric`` the module of its generated code (``hexakin.symbolic.generate``).
    ``loops_at`` is the name or the file of the module of its compiled loops, None if there is none.
    """

    table: LegTable
    numeric: ModuleType
    loops_at: str | Path | None

    def forward(self, p: Array, q: Array) -> Array:
        """Return the foot positions (..., 3) [m]; NaN where an angle is not finite.

        ``p`` (..., n) [m, rad] are the legs' parameters, ``q`` (..., 3) [rad] the angles. They are broadcast against
        each other.
        """
        return self._of_angles("forward", p, q, (3,))

    def jacobian(self, p: Array, q: Array) -> Array:
        """Return the derivatives (..., 3, 3) [m/rad] of the foot positions by the angles; NaN where one is not finite.

        ``p`` (..., n) [m, rad] are the legs' parameters, ``q`` (..., 3) [rad] the angles. They are broadcast against
        each other.
        """
        return self._of_angles("jacobian", p, q, (3, 3))

    def _of_angles(self, name: str, p: Array, q: Array, entries: tuple[int, ...]) -> Array:
        constants = getattr(self.numeric, f"{name}_constants")(np.moveaxis(p, -1, 0))
        shape = np.broadcast_shapes(p.shape[:-1], q.shape[:-1])
        many = shape or (1,)  # the rows of a result are arrays
        angles = np.moveaxis(np.broadcast_to(q, (*many, 3)), -1, 0)
        finite = np.isfinite(angles).all(axis=0)
        if not finite.all() or np.abs(angles).max(initial=0.0) > LARGEST:
            angles = within_half_turn(np.where(finite, angles, 0.0))
        work = np.empty((getattr(self.numeric, f"{name.upper()}_ROWS"), *many))
        result = np.empty((math.prod(entries), *many))
        getattr(self.numeric, f"{name}_arrays")(constants, angles, work, result)
        result[:, ~finite] = np.nan
        return np.moveaxis(result, 0, -1).reshape(*shape, *entries)

    @property
    def closed_form(self) -> bool:
        """Whether the inverse is known in closed form."""
        return self.numeric.CLOSED_FORM

    def check_closed_form(self) -> None:
        """Raise NoClosedFormError unless the inverse is known in closed form."""
        if not self.closed_form:
            raise NoClosedFormError(f"no closed-form inverse is known for the leg table {self.table.rows}")

    @cached_property
    def loops(self) -> ModuleType | None:
        """The module of the compiled loops; None without numba, or without a place for machine code.

        To load them takes about a second, and to compile them about ten, once for an installation.
        """
        if self.loops_at is None:
            return None
        try:
            from hexakin.numerics.numba_cache import announced

            with announced("the kinematics of large batches"):
                if isinstance(self.loops_at, Path):
                    return loaded(self.loops_at)
                return importlib.import_module(self.loops_at)
        except (MissingPackageError, OSError, RuntimeError):
            # numba raises RuntimeError where it finds no place for its cache: each process would compile anew.
            return None


@lru_cache(maxsize=64)
def leg_functions(table: LegTable) -> LegFunctions:
    """Return the functions of the leg type of ``table``: shipped, or from the user's cache, or derived now."""
    if table.type_key in MODULES:
        numeric, loops = MODULES[table.type_key]
        return LegFunctions(table, importlib.import_module(numeric), loops)
    try:
        paths = code_files(table)
        return LegFunctions(table, loaded(paths["numeric"]), paths["loops"])
    except OSError:
        text = derived(table)["numeric"]
        return LegFunctions(table, executed(text, f"<leg type {table.type_key}>", "derived"), None)


def closed_form(table: LegTable) -> bool:
    """Return whether the inverse of the leg type of ``table`` is known in closed form."""
    return leg_functions(table).closed_form


def reach(robot: Robot, *, limited: bool = False) -> Array:
    """Return the least and largest distance (L, 2) [m] of each foot of ``robot`` from its leg's second joint.

    With ``limited`` only angles within the joint limits count. The square of the distance is a sum of a constant and
    multiples of the third angle's sine and cosine, so that its values at three angles are enough.
    """
    q = np.zeros((3, robot.num_legs, 3))
    q[..., 2] = np.array([[0.0], [0.5], [1.0]]) * np.pi
    poses = np.array([robot.fixed_poses(leg) for leg in range(robot.num_legs)])
    second = (poses[:, 0] @ poses[:, 1])[:, :3, 3]
    feet = leg_functions(robot.table).forward(robot.parameters, q)
    at_0, at_90, at_180 = ((feet - second) ** 2).sum(axis=-1)
    mean, cosine = 0.5 * (at_0 + at_180), 0.5 * (at_0 - at_180)
    sine = at_90 - mean
    bounds = np.empty((robot.num_legs, 2))
    for leg in range(robot.num_legs):
        low, high = robot.joint_limits[leg, 2] if limited else (-np.pi, np.pi)
        extreme = np.arctan2(sine[leg], cosine[leg]) + np.pi * np.arange(-6, 7)
        angles = np.array([low, high, *extreme[(extreme >= low) & (extreme <= high)]])
        squares = mean[leg] + cosine[leg] * np.cos(angles) + sine[leg] * np.sin(angles)
        bounds[leg] = np.sqrt(np.maximum([squares.min(), squares.max()], 0.0))
    return bounds
