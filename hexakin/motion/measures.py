"""Paper A's measures: root mean squares per gait cycle, medians and quartiles over cycles (A section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, read_only
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.motion.recording import Recording
from hexakin.transforms import transform_points


class Quartiles(NamedTuple):
    """Lower quartile, median and upper quartile of a sample."""

    lower: float
    median: float
    upper: float

    @property
    def iqr(self) -> float:
        """Interquartile range."""
        return self.upper - self.lower


@dataclass(frozen=True)
class CycleMeasures:
    """Root mean square in each whole gait cycle, (n_cycles,) each.

    ``height`` [m] of the torso, ``pitch_rate`` and ``roll_rate`` [rad/s]. ``torso_contact`` and ``limb_contact``
    are the shares of the cycle's ticks in which the torso, or a limb other than a foot, touched the ground.
    """

    height: Array
    pitch_rate: Array
    roll_rate: Array
    torso_contact: Array
    limb_contact: Array

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, read_only(getattr(self, name)))


def rms(values: ArrayLike) -> float:
    """Root mean square of a sample (n,)."""
    sample = check_array("values", values, ())
    if sample.size == 0:
        raise InvalidInputError("values: the root mean square of an empty sample is not defined")
    return float(np.sqrt(np.mean(sample**2)))


def quartiles(values: ArrayLike) -> Quartiles:
    """Quartiles of a sample (n,), linearly interpolated; raises InvalidInputError for an empty one or a NaN."""
    sample = check_array("values", values, ())
    if sample.size == 0:
        raise InvalidInputError("values: the quartiles of an empty sample are not defined")
    return Quartiles(*(float(value) for value in np.percentile(sample, [25, 50, 75])))


def body_rates(recording: Recording) -> tuple[Array, Array]:
    """Pitch rate about the axis to the right and roll rate about the axis ahead, (n,) each [rad/s], at the ticks."""
    omega = recording.body_angular_velocity
    return omega @ recording.right, omega @ recording.forward


def mean_square_rates(recording: Recording) -> tuple[Array, Array]:
    """Mean squares of pitch and roll rate over the physics steps of the tick before, (n,) each [rad^2/s^2]."""
    axes = (recording.right, recording.forward)
    pitch, roll = (np.einsum("i,nij,j->n", axis, recording.body_rate_moment, axis) for axis in axes)
    return pitch, roll


def per_cycle(recording: Recording, *, rates: Literal["steps", "ticks"] = "steps") -> CycleMeasures:
    """Measures of every gait cycle that the recording holds whole.

    ``rates`` are taken over every physics ``"steps"`` or, as an IMU read at the control rate would have them, at the
    ``"ticks"`` alone: these miss most of the motion, since the torso tips for a few hundredths of a second after a
    change of phase and is at rest again by the next tick.

    Raises InvalidInputError if there is no whole cycle.
    """
    if rates not in ("steps", "ticks"):
        raise UnknownNameError("rates", rates, ["steps", "ticks"])
    cycle = recording.cycle
    # The last cycle is whole if its last phase is there and as long as the shortest before it.
    per_phase = np.bincount(recording.phase)
    ended = (recording.phase[-1] + 1) % recording.parameters["phases_per_cycle"] == 0
    ended = ended and len(per_phase) > 1 and per_phase[-1] >= per_phase[:-1].min()
    whole = [k for k in range(cycle[-1] + 1) if k < cycle[-1] or ended]
    if not whole:
        raise InvalidInputError(f"recording: {recording.time[-1]:g} s hold no whole gait cycle")
    squares = mean_square_rates(recording) if rates == "steps" else [rate**2 for rate in body_rates(recording)]
    ticks = [cycle == k for k in whole]
    return CycleMeasures(
        height=np.array([rms(recording.height[t]) for t in ticks]),
        pitch_rate=np.array([np.sqrt(np.mean(squares[0][t])) for t in ticks]),
        roll_rate=np.array([np.sqrt(np.mean(squares[1][t])) for t in ticks]),
        torso_contact=np.array([np.mean(recording.torso_force[t] > 0.0) for t in ticks]),
        limb_contact=np.array([np.mean(recording.limb_force[t] > 0.0) for t in ticks]),
    )


def slips(recording: Recording) -> Array:
    """Largest way (p,) [m] that a foot in stance slid in each phase, from the first tick in which it was loaded."""
    feet = transform_points(recording.T_world_body, recording.p_body_foot)
    found = []
    for phase in np.unique(recording.phase):
        ticks = np.flatnonzero((recording.phase == phase) & ~recording.extending)
        slid = [0.0]
        for leg in range(recording.num_legs):
            held = ticks[recording.stance[ticks, leg] & (recording.foot_force[ticks, leg] > 0.0)]
            if len(held) > 1:
                slid.append(float(np.linalg.norm(feet[held[1:], leg] - feet[held[0], leg], axis=-1).max()))
        found.append(max(slid))
    return np.array(found)
