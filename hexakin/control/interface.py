"""What a controller is given and what it answers, once per control tick."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.robot.model import Robot


class Observation(NamedTuple):
    """All that a controller may see (A section 1): joint angles, foot forces and the torso's height.

    ``time`` [s], ``q`` (L, 3) [rad], ``foot_force`` (L,) [N] normal, mean over the last control tick,
    ``height`` [m] from the body's origin to the ground along its downward axis (infrared range).
    """

    time: float
    q: Array
    foot_force: Array
    height: float


class Command(NamedTuple):
    """A controller's answer and what it believes.

    ``q`` (L, 3) [rad] goes to the servos. ``stance`` (L,) are the legs commanded to carry, ``phase`` the
    running number of the gait phase, ``extending`` whether legs are reaching for lost ground,
    ``limited`` (L,) the legs whose foot target was out of reach or of the joint limits and was clipped.
    ``delta_z`` [m], ``delta_alpha`` and ``delta_beta`` [rad] are the estimates in use, ``plane_misfit`` [m]
    the largest distance of another supporting foot from the estimated ground plane (NaN without one).
    """

    q: Array
    stance: NDArray[np.bool_]
    phase: int
    extending: bool
    limited: NDArray[np.bool_]
    delta_z: float
    delta_alpha: float
    delta_beta: float
    plane_misfit: float


class ControlRun(Protocol):
    """One run of a controller: holds its state from tick to tick."""

    def command(self, observation: Observation) -> Command:
        """Return the command for the tick that begins with ``observation``."""


class Controller(Protocol):
    """A controller is a value that can be started any number of times; equal runs give equal commands."""

    @property
    def robot(self) -> Robot:
        """The robot that it was made for."""

    @property
    def phases_per_cycle(self) -> int:
        """Gait phases in a cycle."""

    def parameters(self) -> dict[str, Any]:
        """Every parameter but the robot, by name, fit for JSON."""

    def start(self, observation: Observation, control_rate: float) -> ControlRun:
        """Begin a run; ``control_rate`` [Hz] is how often ``command`` will be called."""
