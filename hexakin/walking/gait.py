"""Gaits: duty factor and phase offset of each leg, and the well-known gaits by name.

A gait is described as in R. B. McGhee and A. A. Frank, "On the stability properties of quadruped creeping gaits",
Mathematical Biosciences 3, 1968. The tripod is that of A section 4.1 and B(15); wave gaits are those of Song and
Waldron, "Machines that walk", 1989.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_number, checked
from hexakin.exceptions import InvalidInputError, UnknownNameError, shown
from hexakin.kinematics.forward import forward_kinematics
from hexakin.robot.model import Robot

_ROUNDING = 1e-9  # of a cycle

LONGEST_PHASE = 120.0
"""Longest duration [s] of a step, a phase or a gait cycle; assumed: a longer one was meant in milliseconds."""


@checked
@dataclass(frozen=True)
class Gait:
    """A periodic gait: leg i lifts off at ``offsets[i]`` of a cycle and touches down 1 - duty_factor later.

    ``name`` is used in messages. ``duty_factor`` in (0, 1) is the share of the cycle in which a foot is in stance.
    ``offsets`` (L,) in [0, 1) are the phase offsets, as shares of a cycle. Raises InvalidInputError for values outside
    these ranges.
    """

    name: str
    duty_factor: float
    offsets: tuple[float, ...]

    def __post_init__(self) -> None:
        check_number(f"gait {self.name!r}: duty_factor", self.duty_factor, above=0.0)
        offsets = check_array(f"gait {self.name!r}: offsets", self.offsets, ())
        if offsets.ndim != 1 or not len(offsets):
            raise InvalidInputError(f"gait {self.name!r}: offsets of shape {offsets.shape}, expected one for each leg")
        if self.duty_factor >= 1.0:
            raise InvalidInputError(f"gait {self.name!r}: duty_factor {self.duty_factor:g}, expected less than 1")
        if (offsets < 0.0).any() or (offsets >= 1.0).any():
            raise InvalidInputError(f"gait {self.name!r}: offsets {self.offsets}, expected shares of a cycle in [0, 1)")
        object.__setattr__(self, "offsets", tuple(float(offset) for offset in offsets))

    @property
    def num_legs(self) -> int:
        """Number of legs L."""
        return len(self.offsets)

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Groups of legs (indices from 0) that lift off together, in the order of the cycle."""
        times = np.array(self.offsets)
        starts = np.unique(times.round(9))
        return tuple(tuple(int(i) for i in np.flatnonzero(np.abs(times - start) < _ROUNDING)) for start in starts)

    @property
    def phases_per_cycle(self) -> int:
        """Number of phases of a cycle: the number of groups."""
        return len(self.groups)

    @property
    def has_equal_phases(self) -> bool:
        """Whether the groups swing one after the other, in phases of equal length and without pauses."""
        count = self.phases_per_cycle
        first = [self.offsets[group[0]] for group in self.groups]
        even = np.allclose(first, np.arange(count) / count, atol=_ROUNDING)
        return bool(even and abs(1.0 - self.duty_factor - 1.0 / count) < _ROUNDING)

    @checked
    def swinging(self, phase: int) -> NDArray[np.bool_]:
        """Whether each leg swings in a phase of a gait with equal phases, (L,) bool.

        ``phase`` is the running number of the phase, counted from 0; it may exceed the number of phases per cycle.
        """
        swing = np.zeros(self.num_legs, dtype=bool)
        swing[list(self.groups[phase % self.phases_per_cycle])] = True
        return swing

    def swing_share(self, cycle: ArrayLike) -> Array:
        """Share (..., L) of its swing, in [0, 1), that each leg has completed; NaN in stance.

        ``cycle`` (...) are times as numbers of cycles.
        """
        times = check_array("cycle", cycle, ())
        since = np.mod(times[..., None] - np.array(self.offsets) + _ROUNDING, 1.0) - _ROUNDING
        share = since / (1.0 - self.duty_factor)
        return np.where(share < 1.0 - _ROUNDING, np.maximum(share, 0.0), np.nan)

    @property
    def fewest_carrying(self) -> int:
        """Smallest number of legs in stance at any time."""
        instants = np.array([*self.offsets, *np.mod(np.array(self.offsets) + 1.0 - self.duty_factor, 1.0)])
        between = np.mod(np.sort(instants) + 0.5 * np.diff(np.sort(instants), append=np.sort(instants)[0] + 1.0), 1.0)
        return int(np.isnan(self.swing_share(np.concatenate([instants, between]))).sum(axis=-1).min())


@checked
def in_groups(name: str, groups: Sequence[Sequence[int]]) -> Gait:
    """Gait of equal phases: ``groups[k]`` are the legs (indices from 0) that swing in phase k of a cycle.

    ``name`` is the name of the gait. Raises InvalidInputError if the groups do not contain each leg once.
    """
    legs = [leg for group in groups for leg in group]
    if not legs or sorted(legs) != list(range(len(legs))) or not all(len(group) for group in groups):
        expected = f"must contain each of the legs 0 to {max(len(legs), 1) - 1} once"
        raise InvalidInputError(f"gait {name!r}: groups {groups} {expected}")
    offsets = np.empty(len(legs))
    for k, group in enumerate(groups):
        offsets[list(group)] = k / len(groups)
    return Gait(name, 1.0 - 1.0 / len(groups), tuple(offsets))


@checked
def tripod(robot: Robot) -> Gait:
    """Tripod gait: legs {1, 3, 5} swing, then {2, 4, 6}, numbered around the body (A section 4.1, B(15)).

    Raises InvalidInputError for a robot that does not have six legs.
    """
    if robot.num_legs != 6:
        raise InvalidInputError(f"tripod gait: {robot.name} has {robot.num_legs} legs, expected 6")
    return in_groups("tripod", ((0, 2, 4), (1, 3, 5)))


@checked
def wave(robot: Robot, duty_factor: float | None = None, name: str = "wave") -> Gait:
    """Wave gait: on each side the legs swing from rear to front, and the two sides are half a cycle apart.

    A leg lifts off ``duty_factor`` of a cycle after the leg in front of it, which is when the leg behind it touches
    down (McGhee and Iswandhi 1979; Song and Waldron 1989). None is 1 - 1 / L, so that one leg swings at a time. With
    1/2 the groups are those of the tripod. ``name`` is the name of the gait. Raises InvalidInputError for a duty factor
    outside (0, 1), and for a robot without the same number of legs on both sides.
    """
    sides = _sides(robot)
    beta = 1.0 - 1.0 / robot.num_legs if duty_factor is None else check_number("duty_factor", duty_factor)
    offsets = np.empty(robot.num_legs)
    for side, legs in enumerate(sides):
        offsets[list(legs)] = np.mod(0.5 * side + beta * np.arange(len(legs)) + _ROUNDING, 1.0) - _ROUNDING
    return Gait(name, beta, tuple(np.maximum(offsets, 0.0)))


@checked
def ripple(robot: Robot) -> Gait:
    """Ripple gait: the wave gait with duty factor 2/3, in which the swings of the two sides overlap by half."""
    return wave(robot, 2.0 / 3.0, "ripple")


@checked
def tetrapod(robot: Robot) -> Gait:
    """Tetrapod gait of six legs: three pairs, each of a left and a right leg, swing one after the other.

    Raises InvalidInputError for a robot that does not have six legs.
    """
    if robot.num_legs != 6:
        raise InvalidInputError(f"tetrapod gait: {robot.name} has {robot.num_legs} legs, expected 6")
    left, right = _sides(robot)
    return in_groups("tetrapod", ((left[2], right[0]), (left[1], right[2]), (left[0], right[1])))


GAITS = {"tripod": tripod, "tetrapod": tetrapod, "ripple": ripple, "wave": wave}
"""Functions that return the named gaits for a robot."""


@checked
def gait_of(robot: Robot, gait: str | Gait) -> Gait:
    """Return the gait of a given name for a robot, or check a ``Gait`` and return it.

    ``gait`` is a name in ``GAITS`` or a ``Gait``. Raises UnknownNameError for a name that is not in ``GAITS``, and
    InvalidInputError if the numbers of legs differ or if at some time fewer than three legs are in stance.
    """
    if isinstance(gait, str):
        if gait not in GAITS:
            raise UnknownNameError("gait", gait, list(GAITS))
        gait = GAITS[gait](robot)
    if not isinstance(gait, Gait):
        raise InvalidInputError(f"gait: expected a hexakin.gait.Gait or one of {', '.join(GAITS)}, got {shown(gait)}")
    if gait.num_legs != robot.num_legs:
        raise InvalidInputError(f"gait: {gait.name} is for {gait.num_legs} legs, {robot.name} has {robot.num_legs}")
    if gait.fewest_carrying < 3:
        said = f"{gait.name} leaves {gait.fewest_carrying} legs on the ground, expected at least 3"
        raise InvalidInputError(f"gait: {said} for {robot.name} to stand on")
    return gait


def _sides(robot: Robot) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Indices of the left and of the right legs, each from front to rear, by the positions of the standing feet."""
    feet = forward_kinematics(robot, robot.standing_q)
    ahead, across = feet @ robot.forward, feet @ robot.right
    order = np.argsort(-ahead, kind="stable")
    left, right = tuple(int(i) for i in order if across[i] < 0.0), tuple(int(i) for i in order if across[i] >= 0.0)
    if len(left) != len(right):
        raise InvalidInputError(f"gait: {robot.name} has {len(left)} legs to the left and {len(right)} to the right")
    return left, right
