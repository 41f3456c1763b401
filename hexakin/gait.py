"""Which legs swing when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexakin.exceptions import InvalidInputError
from hexakin.robot import Robot


@dataclass(frozen=True)
class Gait:
    """A gait of equal phases: ``groups[k]`` are the legs (index from 0) that swing in phase k of a cycle."""

    name: str
    num_legs: int
    groups: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        legs = [leg for group in self.groups for leg in group]
        if sorted(legs) != list(range(self.num_legs)) or not all(self.groups):
            raise InvalidInputError(
                f"gait {self.name!r}: groups {self.groups} must hold each of the legs 0 to {self.num_legs - 1} once"
            )

    @property
    def phases_per_cycle(self) -> int:
        """Number of phases in a gait cycle."""
        return len(self.groups)

    def swinging(self, phase: int) -> NDArray[np.bool_]:
        """Whether each leg swings in the phase with this running number, (L,)."""
        swing = np.zeros(self.num_legs, dtype=bool)
        swing[list(self.groups[phase % self.phases_per_cycle])] = True
        return swing


def tripod(robot: Robot) -> Gait:
    """Tripod gait: legs {1, 3, 5} swing, then {2, 4, 6}, numbered around the body (A section 4.1, B(15)).

    Raises InvalidInputError for a robot that has not six legs.
    """
    if robot.num_legs != 6:
        raise InvalidInputError(f"tripod gait: {robot.name} has {robot.num_legs} legs, expected 6")
    return Gait("tripod", 6, ((0, 2, 4), (1, 3, 5)))
