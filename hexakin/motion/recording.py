"""Recording of a simulated walk: time series with one row per control tick, and the parameters of the simulation."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_number, check_path, check_whole, checked
from hexakin.checks.files import Arrays, Header, opened_arrays, parse_json, whole_file
from hexakin.exceptions import FileError, InvalidInputError, RecordingError, shown
from hexakin.motion.columns import column, columns_of, columns_table, dataframe, described, row_shape

if TYPE_CHECKING:
    import pandas as pd

# A recording has about 1.2 kB per control tick: the largest is one of 12 hours at 20 ticks per second. The file of a
# walk has about three quarters of this size, that of a robot at rest less.
_LARGEST = 2**30  # [bytes] of all arrays, unpacked
MOST_TICKS = 864_000
"""Largest number of ticks of a walk."""
_RATIO, _SMALL = 200, 16 * 2**20  # a file of n bytes may unpack to _SMALL + _RATIO n
_LONGEST_PARAMETERS = 2**20  # [characters] those of ATHENA's walk have 4000

_FORMAT = "hexakin-recording-5"
_OF_0_1, _OF_0_2 = "hexakin-recording-3", "hexakin-recording-4"
# Columns that files of older formats do not have, each with a column of the same shape.
_ABSENT = {
    _OF_0_1: {"joint_velocity": "q", "unsolved_steps": "height"},
    _OF_0_2: {"unsolved_steps": "height"},
}
_DIAGNOSTIC = "diagnostics/"  # prefix of the diagnostics' names in a file
_FORMER_COLUMNS = ("delta_z", "delta_alpha", "delta_beta", "plane_misfit")  # diagnostics since format 4


@described("n")
@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """Recording of a simulated walk with L legs, at n control ticks (A section 5.2).

    Row k of each array belongs to ``time[k]``, the start of tick k. "The tick before" lasts from row k - 1 to row k.

    ``diagnostics`` maps the name of each diagnostic of the controller to an array (n,) [in the controller's unit];
    ``recording.name`` is the same array. ``parameters`` maps names to values that JSON can store: robot, terrain,
    controller, engine, time steps, seed and versions of the packages.
    """

    time: Array = field(metadata=column("", "s", "start of the tick"))
    T_world_body: Array = field(metadata=column("pose", "m", "pose of the body in the world"))
    body_velocity: Array = field(metadata=column("axis", "m/s", "velocity of the body's origin, in the world frame"))
    body_angular_velocity: Array = field(metadata=column("axis", "rad/s", "angular velocity, in the body frame (IMU)"))
    body_rate_moment: Array = field(
        metadata=column("axis axis", "1/s^2", "mean of w w^T over the steps of the tick before, w the angular velocity")
    )
    height: Array = field(
        metadata=column("", "m", "distance from the body's origin to the ground along its downward axis (infrared)")
    )
    q: Array = field(metadata=column("leg joint", "rad", "joint angles"))
    joint_velocity: Array = field(
        metadata=column("leg joint", "rad/s", "rates of the joint angles; NaN in recordings before 0.2")
    )
    q_command: Array = field(metadata=column("leg joint", "rad", "commanded joint angles at this instant"))
    joint_torque: Array = field(
        metadata=column("leg joint", "N m", "torques of the servos, in the last physics step before this instant")
    )
    p_body_foot: Array = field(metadata=column("leg axis", "m", "foot centres in the body frame"))
    foot_force: Array = field(metadata=column("leg", "N", "normal forces on the feet, mean over the tick before"))
    foot_force_last: Array = field(
        metadata=column("leg", "N", "normal forces on the feet, in the last physics step before this instant")
    )
    torso_force: Array = field(metadata=column("", "N", "normal force on the torso, mean over the tick before"))
    limb_force: Array = field(
        metadata=column("", "N", "sum of the normal forces on coxae, femora and tibiae, mean over the tick before")
    )
    penetration: Array = field(metadata=column("", "m", "largest penetration of any contact in the tick before"))
    energy: Array = field(metadata=column("", "J", "kinetic and potential energy; NaN if not computed"))
    servo_work: Array = field(metadata=column("", "J", "work of the servos in the tick before; NaN if not computed"))
    contact_work: Array = field(
        metadata=column("", "J", "work of the contacts in the tick before; NaN if not computed")
    )
    solver_residual: Array = field(
        metadata=column("", "1", "largest residual of the contact solver in the tick before; NaN if not computed")
    )
    unsolved_steps: Array = field(
        metadata=column(
            "", "1", "number of physics steps in the tick before whose residual is above the tolerance; NaN if unknown"
        )
    )
    phase: NDArray[np.int_] = field(metadata=column("", "1", "number of the gait phase, counted from 0", "i"))
    stance: NDArray[np.bool_] = field(metadata=column("leg", "bool", "whether the leg is in stance, as commanded", "b"))
    extending: NDArray[np.bool_] = field(metadata=column("", "bool", "whether feet move down to find the ground", "b"))
    limited: NDArray[np.bool_] = field(
        metadata=column("leg", "bool", "whether the foot target was clipped (reach or joint limits)", "b")
    )
    diagnostics: Mapping[str, Array] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        known = {name: self.parameters.get(name, "unknown") for name in ("robot", "terrain", "engine")}
        robot = known["robot"].get("name", "unknown") if isinstance(known["robot"], Mapping) else known["robot"]
        return (
            f"Recording(robot {robot}, terrain {known['terrain']}, engine {known['engine']}, {len(self.time)} ticks, "
            f"{self.time[-1] if len(self.time) else 0.0:g} s)"
        )

    def __getattr__(self, name: str) -> Array:
        """Return the diagnostic of this name, as in ``recording.delta_z``."""
        # The attribute is missing while an object is being copied or unpickled.
        diagnostics = self.__dict__.get("diagnostics", {})
        if name in diagnostics:
            return diagnostics[name]
        raise AttributeError(f"a recording has no {name!r}; the controller's diagnostics are: {sorted(diagnostics)}")

    def _repr_html_(self) -> str:
        return columns_table(self, repr(self), self.diagnostics)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns as a DataFrame with the index ``time`` [s]; values that are not known are NaN.

        Names end with the number of the leg, the segment that the joint moves and the axis, units are those of the
        columns: ``q_leg1_coxa`` [rad], ``foot_force_leg6`` [N], ``body_velocity_x`` [m/s]. The pose of the body is
        ``T_world_body_x``, ``_y``, ``_z`` [m] and its quaternion ``T_world_body_qx``, ``_qy``, ``_qz``, ``_qw``, whose
        scalar part is not negative. Diagnostics have their own names. Raises InvalidInputError for columns of different
        lengths and for a diagnostic with the name of another column.
        """
        return dataframe(self, self.diagnostics)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All columns by name, diagnostics included; the first axis of each array (n, ...) is time."""
        return {part.name: getattr(self, part.name) for part in _COLUMNS} | dict(self.diagnostics)

    @property
    def num_legs(self) -> int:
        """Number of legs L."""
        return self.q.shape[1]

    @property
    def cycle(self) -> NDArray[np.int_]:
        """Number (n,) of the gait cycle at each tick, counted from 0."""
        return self.phase // int(self.parameters["phases_per_cycle"])

    @property
    def forward(self) -> Array:
        """Unit vector (3,) of the walking direction, in the body frame."""
        return np.array(self.parameters["robot"]["forward"])

    @property
    def right(self) -> Array:
        """Unit vector (3,) to the right of the walking direction, in the body frame."""
        return np.cross(self.forward, [0.0, 0.0, 1.0])

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the recording to ``path`` as a NumPy ``.npz`` archive.

        The suffix ``.npz`` is added if it is missing. The file is written under another name and then renamed, so that
        it is never incomplete. Raises InvalidInputError if ``path`` is no path, FileError if the file cannot be
        written, and RecordingError if JSON cannot store one of the ``parameters``.
        """
        target = check_path("path", path, ".npz")
        arrays = {part.name: getattr(self, part.name) for part in _COLUMNS}
        arrays |= {_DIAGNOSTIC + name: values for name, values in self.diagnostics.items()}
        try:
            parameters = json.dumps(dict(self.parameters), default=as_json)
        except (TypeError, ValueError, RecursionError) as error:
            raise RecordingError(f"parameters: {error}") from error
        with whole_file(target) as temporary, open(temporary, "wb") as stream:
            np.savez_compressed(stream, format=_FORMAT, parameters=parameters, **arrays)


_COLUMNS = columns_of(Recording)


def as_json(value: Any) -> Any:
    """Return a NumPy number or array as a Python number or list, for JSON."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{shown(value)} cannot be stored with a recording")


@checked
def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read the recording that ``Recording.save`` wrote to ``path``; files of hexakin 0.1 and 0.2 can be read too.

    Columns that they do not have are NaN.

    Raises InvalidInputError if ``path`` is no path. Raises RecordingError, which names the file and the fault, if the
    file is missing, truncated, damaged or not a recording. Sizes and shapes are checked before arrays are unpacked.
    """
    file = check_path("path", path)
    try:
        most = min(_LARGEST, _SMALL + _RATIO * file.stat().st_size) if file.is_file() else _SMALL
        with opened_arrays(file, most) as archive:
            return _read(archive)
    except RecordingError:
        raise
    except (FileError, OSError) as error:
        raise RecordingError(str(error)) from error


def _read(archive: Arrays) -> Recording:
    path = archive.path
    made = _text(archive, "format", 100) if "format" in archive.headers else ""
    if made not in (_FORMAT, *_ABSENT):
        raise RecordingError(f"{path}: not a hexakin recording (expected format {_FORMAT})")
    # The name in the file of each column and diagnostic.
    names = {name: name for name in archive.headers if name.startswith(_DIAGNOSTIC)}
    names |= {part.name: part.name for part in _COLUMNS}
    absent = _ABSENT.get(made, {})
    for name in absent:
        del names[name]
    if made == _OF_0_1:
        names |= {_DIAGNOSTIC + name: name for name in _FORMER_COLUMNS}
    if missing := [name for name in (*names.values(), "parameters") if name not in archive.headers]:
        raise RecordingError(f"{path}: {', '.join(missing)} missing")
    _check_arrays(path, {name: archive.headers[stored] for name, stored in names.items()})
    parameters = _parameters(path, _text(archive, "parameters", _LONGEST_PARAMETERS))
    stored = {name: archive.read(name_in_file) for name, name_in_file in names.items()}
    columns = {name: values for name, values in stored.items() if not name.startswith(_DIAGNOSTIC)}
    diagnostics = {k.removeprefix(_DIAGNOSTIC): v for k, v in stored.items() if k.startswith(_DIAGNOSTIC)}
    columns |= {name: np.full(columns[like].shape, np.nan) for name, like in absent.items()}
    return Recording(**columns, diagnostics=diagnostics, parameters=parameters)


def _text(archive: Arrays, name: str, longest: int) -> str:
    """Return a text of at most ``longest`` characters from an archive."""
    shape, dtype = archive.headers[name]
    if shape != () or dtype.kind != "U" or dtype.itemsize > 4 * longest:
        raise RecordingError(f"{archive.path}: {name} has shape {shape} of {dtype}, expected a text up to {longest}")
    return str(archive.read(name))


def _check_arrays(path: Path, headers: Mapping[str, Header]) -> None:
    """Raise RecordingError unless all shapes and types match the fields."""
    time, q = headers["time"].shape, headers["q"].shape
    if len(time) != 1 or time[0] == 0 or len(q) != 3 or q[1] == 0:
        raise RecordingError(f"{path}: time {time} and q {q} are not the shapes of a recording")
    rows = {part.name: (row_shape(part), part.metadata["kind"]) for part in _COLUMNS}
    for name, (shape, dtype) in headers.items():
        trailing, kind = rows.get(name, ((), "f"))
        expected = (*time, *(q[1] if size == "L" else size for size in trailing))
        if shape != expected or dtype.kind != kind:
            raise RecordingError(f"{path}: {name} has shape {shape} of {dtype}, expected {expected}")


def _parameters(path: Path, text: str) -> dict[str, Any]:
    """Return the parameters of a recording; raise RecordingError unless those that its measures use are present."""
    try:
        parameters = parse_json(text)
    except ValueError as error:
        raise RecordingError(f"{path}: its parameters are not valid JSON ({error})") from error
    needed = ("robot", "phases_per_cycle", "controller", "control_rate")
    if not isinstance(parameters, dict) or any(name not in parameters for name in needed):
        raise RecordingError(f"{path}: its parameters must contain {', '.join(needed)}")
    try:
        check_whole("phases_per_cycle", parameters["phases_per_cycle"], at_least=1)
        check_number("control_rate", parameters["control_rate"], above=0.0, unit="1/s")
    except InvalidInputError as error:
        raise RecordingError(f"{path}: {error}") from error
    return parameters
