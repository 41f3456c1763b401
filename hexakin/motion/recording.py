"""Recording of a simulated walk: time series with one row per control tick, and the parameters of the simulation."""

from __future__ import annotations

import inspect
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.exceptions import RecordingError

_FORMAT = "hexakin-recording-4"
_OLDER = ("hexakin-recording-3",)
_DIAGNOSTIC = "diagnostics/"  # prefix of the diagnostics' names in a file
_FORMER_COLUMNS = ("delta_z", "delta_alpha", "delta_beta", "plane_misfit")  # diagnostics since format 4


def _column(shape: tuple[str | int, ...], unit: str, text: str, kind: str = "f") -> dict[str, Any]:
    """Describe a column: the shape of one row ("L" is the number of legs), the unit, the meaning and NumPy's kind."""
    return {"shape": shape, "unit": unit, "text": text, "kind": kind}


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """Recording of a simulated walk with L legs, at n control ticks (A section 5.2).

    Row k of each array belongs to ``time[k]``, the start of tick k. "The tick before" lasts from row k - 1 to row k.
    """

    time: Array = field(metadata=_column((), "s", "start of the tick"))
    T_world_body: Array = field(metadata=_column((4, 4), "m", "pose of the body in the world"))
    body_velocity: Array = field(metadata=_column((3,), "m/s", "velocity of the body's origin, in the world frame"))
    body_angular_velocity: Array = field(metadata=_column((3,), "rad/s", "angular velocity, in the body frame (IMU)"))
    body_rate_moment: Array = field(
        metadata=_column((3, 3), "1/s^2", "mean of w w^T over the steps of the tick before, w the angular velocity")
    )
    height: Array = field(
        metadata=_column((), "m", "distance from the body's origin to the ground along its downward axis (infrared)")
    )
    q: Array = field(metadata=_column(("L", 3), "rad", "joint angles"))
    joint_velocity: Array = field(
        metadata=_column(("L", 3), "rad/s", "rates of the joint angles; NaN in recordings before 0.2")
    )
    q_command: Array = field(metadata=_column(("L", 3), "rad", "commanded joint angles at this instant"))
    joint_torque: Array = field(
        metadata=_column(("L", 3), "N m", "torques of the servos, in the last physics step before this instant")
    )
    p_body_foot: Array = field(metadata=_column(("L", 3), "m", "foot centres in the body frame"))
    foot_force: Array = field(metadata=_column(("L",), "N", "normal forces on the feet, mean over the tick before"))
    foot_force_last: Array = field(
        metadata=_column(("L",), "N", "normal forces on the feet, in the last physics step before this instant")
    )
    torso_force: Array = field(metadata=_column((), "N", "normal force on the torso, mean over the tick before"))
    limb_force: Array = field(
        metadata=_column((), "N", "sum of the normal forces on coxae, femora and tibiae, mean over the tick before")
    )
    penetration: Array = field(metadata=_column((), "m", "largest penetration of any contact in the tick before"))
    energy: Array = field(metadata=_column((), "J", "kinetic and potential energy; NaN if not computed"))
    servo_work: Array = field(metadata=_column((), "J", "work of the servos in the tick before; NaN if not computed"))
    contact_work: Array = field(
        metadata=_column((), "J", "work of the contacts in the tick before; NaN if not computed")
    )
    solver_residual: Array = field(
        metadata=_column((), "1", "largest residual of the contact solver in the tick before; NaN if not computed")
    )
    phase: NDArray[np.int_] = field(metadata=_column((), "1", "number of the gait phase, counted from 0", "i"))
    stance: NDArray[np.bool_] = field(
        metadata=_column(("L",), "bool", "whether the leg is in stance, as commanded", "b")
    )
    extending: NDArray[np.bool_] = field(metadata=_column((), "bool", "whether feet move down to find the ground", "b"))
    limited: NDArray[np.bool_] = field(
        metadata=_column(("L",), "bool", "whether the foot target was clipped (reach or joint limits)", "b")
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

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All columns by name, diagnostics included; the first axis of each array (n, ...) is time."""
        return {column.name: getattr(self, column.name) for column in _COLUMNS} | dict(self.diagnostics)

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

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the recording to ``path`` as a NumPy ``.npz`` archive.

        The suffix ``.npz`` is added if it is missing. The file is written under another name and then renamed, so that
        it is never incomplete. Raises OSError if it cannot be written.
        """
        target = Path(path)
        if target.suffix != ".npz":
            target = target.with_name(target.name + ".npz")
        temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
        arrays = {column.name: getattr(self, column.name) for column in _COLUMNS}
        arrays |= {_DIAGNOSTIC + name: values for name, values in self.diagnostics.items()}
        try:
            with open(temporary, "wb") as stream:
                np.savez_compressed(
                    stream, format=_FORMAT, parameters=json.dumps(dict(self.parameters), default=as_json), **arrays
                )
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


_COLUMNS: tuple[Field, ...] = tuple(column for column in fields(Recording) if column.metadata)


def _described() -> str:
    """Return the docstring of Recording with a table of its columns."""
    rows = []
    for column in _COLUMNS:
        shape = ", ".join(["n", *map(str, column.metadata["shape"])])
        rows.append(
            (f"``{column.name}``", f"({shape}{',' * (shape == 'n')})", column.metadata["unit"], column.metadata["text"])
        )
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    line = "  ".join("=" * width for width in widths)
    head = "  ".join(text.ljust(width) for text, width in zip(("field", "shape", "unit", ""), widths, strict=True))
    table = "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows)
    return f"""{inspect.cleandoc(Recording.__doc__ or "")}

{line}
{head.rstrip()}
{line}
{table}
{line}

``diagnostics`` maps the name of each diagnostic of the controller to an array (n,) [in the controller's unit];
``recording.name`` is the same array. ``parameters`` maps names to values that JSON can store: robot, terrain,
controller, engine, time steps, seed and versions of the packages.
"""


Recording.__doc__ = _described()


def as_json(value: Any) -> Any:
    """Return a NumPy number or array as a Python number or list, for JSON."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{value!r:.80} cannot be stored with a recording")


_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, KeyError, TypeError, NotImplementedError)


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read the recording that ``Recording.save`` wrote to ``path``; files of hexakin 0.1 can be read too.

    Raises RecordingError, which names the file and the fault, if the file is missing, truncated, damaged or not a
    recording.
    """
    names = [column.name for column in _COLUMNS]
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            made = str(archive["format"]) if "format" in archive else ""
            if made not in (_FORMAT, *_OLDER):
                raise RecordingError(f"{path}: not a hexakin recording (expected format {_FORMAT})")
            stored = {name: archive[name] for name in archive.files if name not in ("format", "parameters")}
            expected = (
                [name for name in names if name != "joint_velocity"] + [*_FORMER_COLUMNS] if made in _OLDER else names
            )
            missing = [name for name in expected if name not in stored] + ["parameters"] * ("parameters" not in archive)
            if not missing and made in _OLDER:
                stored = _brought_up(stored)
            if missing:
                raise RecordingError(f"{path}: {', '.join(missing)} missing")
            parameters = json.loads(str(archive["parameters"]))
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: no such file") from error
    except RecordingError:
        raise
    except _DAMAGED as error:
        raise RecordingError(f"{path}: truncated or damaged, not readable as a recording ({error})") from error
    columns = {name: stored[name] for name in names}
    diagnostics = {k.removeprefix(_DIAGNOSTIC): v for k, v in stored.items() if k.startswith(_DIAGNOSTIC)}
    _check(str(path), columns, diagnostics, parameters)
    return Recording(**columns, diagnostics=diagnostics, parameters=parameters)


def _brought_up(stored: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Convert columns of an older format to the current one; joint rates, which it does not contain, become NaN."""
    columns = {_DIAGNOSTIC + name if name in _FORMER_COLUMNS else name: values for name, values in stored.items()}
    return columns | {"joint_velocity": np.full(stored["q"].shape, np.nan)}


def _check(path: str, columns: dict[str, np.ndarray], diagnostics: dict[str, np.ndarray], parameters: Any) -> None:
    """Raise RecordingError unless all shapes and types match the fields and all required parameters are present."""
    time = columns["time"]
    legs = columns["q"].shape[1] if columns["q"].ndim == 3 else 0
    if time.ndim != 1 or len(time) == 0 or legs == 0:
        raise RecordingError(f"{path}: time {time.shape} and q {columns['q'].shape} are not the shapes of a recording")
    expected = {column.name: (column.metadata["shape"], column.metadata["kind"]) for column in _COLUMNS}
    for name, array in {**columns, **diagnostics}.items():
        trailing, kind = expected.get(name, ((), "f"))
        shape = (len(time), *(legs if size == "L" else size for size in trailing))
        if array.shape != shape or array.dtype.kind != kind:
            raise RecordingError(f"{path}: {name} has shape {array.shape} of {array.dtype}, expected {shape}")
    needed = ("robot", "phases_per_cycle", "controller", "control_rate")
    if not isinstance(parameters, dict) or any(name not in parameters for name in needed):
        raise RecordingError(f"{path}: its parameters must contain {', '.join(needed)}")
