"""Paper A's measures: root mean squares of each gait cycle, median and quartiles over the cycles (A section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, checked, read_only
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.motion.columns import column, columns_table, dataframe, described
from hexakin.motion.recording import Recording
from hexakin.numerics.display import short_repr
from hexakin.transforms import transform_points

if TYPE_CHECKING:
    import pandas as pd


class Quartiles(NamedTuple):
    """Quartiles of a sample: ``lower`` quartile, ``median`` and ``upper`` quartile, in the unit of the sample."""

    lower: float
    median: float
    upper: float

    @property
    def iqr(self) -> float:
        """Interquartile range, in the unit of the sample."""
        return self.upper - self.lower


@described("c")
@dataclass(frozen=True)
class CycleMeasures:
    """Measures of each of c whole gait cycles (A section 5.2)."""

    height: Array = field(metadata=column("", "m", "root mean square of the torso's height"))
    pitch_rate: Array = field(metadata=column("", "rad/s", "root mean square of the pitch rate"))
    roll_rate: Array = field(metadata=column("", "rad/s", "root mean square of the roll rate"))
    torso_contact: Array = field(metadata=column("", "1", "share of the ticks at which the torso touched the ground"))
    limb_contact: Array = field(
        metadata=column("", "1", "share of the ticks at which a coxa, femur or tibia touched the ground")
    )

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, read_only(getattr(self, name), name))

    def _repr_html_(self) -> str:
        return columns_table(self, f"CycleMeasures, {len(self.height)} gait cycles")

    def to_dataframe(self) -> pd.DataFrame:
        """Return the measures as a DataFrame, one row for each whole gait cycle; the index ``cycle`` counts from 0.

        Names and units of the columns are those of the fields: ``height`` [m], ``pitch_rate`` [rad/s]. Raises
        InvalidInputError for fields of different lengths.
        """
        return dataframe(self).rename_axis("cycle")


def rms(values: ArrayLike) -> float:
    """Root mean square of a sample.

    ``values`` (n,) is the sample, in any unit; the result has the same unit. Raises InvalidInputError if the sample is
    empty or if a value is not finite.
    """
    sample = check_array("values", values, ())
    if sample.size == 0:
        raise InvalidInputError("values: the root mean square of an empty sample is not defined")
    return float(np.sqrt(np.mean(sample**2)))


def quartiles(values: ArrayLike) -> Quartiles:
    """Quartiles of a sample, linearly interpolated.

    ``values`` (n,) is the sample, in any unit; the result has the same unit. Raises InvalidInputError if the sample is
    empty or if a value is not finite.
    """
    sample = check_array("values", values, ())
    if sample.size == 0:
        raise InvalidInputError("values: the quartiles of an empty sample are not defined")
    return Quartiles(*(float(value) for value in np.percentile(sample, [25, 50, 75])))


@checked
def body_rates(recording: Recording) -> tuple[Array, Array]:
    """Pitch rate and roll rate, (n,) [rad/s] each, at the n ticks of ``recording``.

    The pitch rate is about the body's axis to the right, the roll rate about its axis forward.
    """
    omega = recording.body_angular_velocity
    return omega @ recording.right, omega @ recording.forward


@checked
def mean_square_rates(recording: Recording) -> tuple[Array, Array]:
    """Mean squares of the pitch rate and of the roll rate, (n,) [rad^2/s^2] each, for the n ticks of ``recording``.

    Each mean is over the physics steps of the tick before.
    """
    axes = (recording.right, recording.forward)
    pitch, roll = (np.einsum("i,nij,j->n", axis, recording.body_rate_moment, axis) for axis in axes)
    return pitch, roll


@checked
def per_cycle(recording: Recording, *, rates: Literal["steps", "ticks"] = "steps") -> CycleMeasures:
    """Measures of all whole gait cycles of ``recording`` (A section 5.2).

    ``rates`` selects the samples of the pitch and roll rates: all physics ``"steps"``, or only the ``"ticks"``, as for
    an IMU that is read at the control rate. The ticks miss most of the motion, because the torso tips for a few
    hundredths of a second after a change of phase and is at rest again by the next tick.

    Raises InvalidInputError if there is no whole cycle, and UnknownNameError for other ``rates``.
    """
    if rates not in ("steps", "ticks"):
        raise UnknownNameError("rates", rates, ["steps", "ticks"])
    cycle = recording.cycle
    # The last cycle is whole if it contains its last phase, and if this phase is as long as the shortest phase before.
    per_phase = np.bincount(recording.phase)
    ended = (recording.phase[-1] + 1) % recording.parameters["phases_per_cycle"] == 0
    ended = ended and len(per_phase) > 1 and per_phase[-1] >= per_phase[:-1].min()
    whole = [k for k in range(cycle[-1] + 1) if k < cycle[-1] or ended]
    if not whole:
        raise InvalidInputError(f"recording: no whole gait cycle in {recording.time[-1]:g} s")
    squares = mean_square_rates(recording) if rates == "steps" else [rate**2 for rate in body_rates(recording)]
    ticks = [cycle == k for k in whole]
    return CycleMeasures(
        height=np.array([rms(recording.height[t]) for t in ticks]),
        pitch_rate=np.array([np.sqrt(np.mean(squares[0][t])) for t in ticks]),
        roll_rate=np.array([np.sqrt(np.mean(squares[1][t])) for t in ticks]),
        torso_contact=np.array([np.mean(recording.torso_force[t] > 0.0) for t in ticks]),
        limb_contact=np.array([np.mean(recording.limb_force[t] > 0.0) for t in ticks]),
    )


@checked
def slips(recording: Recording) -> Array:
    """Largest distance (p,) [m] by which a foot in stance slips in each of the p gait phases of ``recording``.

    The distance is measured from the foot's position at the first tick of the phase at which it carries load. Ticks at
    which feet are moving down to find the ground are left out.
    """
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
