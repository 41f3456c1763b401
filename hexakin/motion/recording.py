"""What a simulation leaves behind: time series per control tick and the parameters that made them."""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array
from hexakin.exceptions import RecordingError

_FORMAT = "hexakin-recording-3"


def _plain(value: Any) -> Any:
    """NumPy numbers and arrays as JSON has them."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{value!r:.80} cannot be stored with a recording")


@dataclass(frozen=True, eq=False)
class Recording:
    """Time series of n control ticks of a robot with L legs; row k is the instant ``time[k]``.

    ==========================  ===========  =====  ==================================================
    field                       shape        unit
    ==========================  ===========  =====  ==================================================
    time                        (n,)         s      start of the tick
    T_world_body                (n, 4, 4)    m      pose of the body in the world
    body_velocity               (n, 3)       m/s    of the body's origin, in the world frame
    body_angular_velocity       (n, 3)       rad/s  in the body frame (the IMU)
    body_rate_moment            (n, 3, 3)    1/s^2  mean of w w^T over the steps of the tick before, w as above
    height                      (n,)         m      infrared range: body origin to ground, body downwards
    q                           (n, L, 3)    rad    joint angles
    q_command                   (n, L, 3)    rad    what the servos were told at this instant
    joint_torque                (n, L, 3)    N m    of the servos, last physics step before this instant
    p_body_foot                 (n, L, 3)    m      foot centres in the body frame
    foot_force                  (n, L)       N      normal, mean over the tick before
    foot_force_last             (n, L)       N      normal, in the last physics step before this instant
    torso_force, limb_force     (n,)         N      normal, mean over the tick before
    penetration                 (n,)         m      deepest contact of the tick before
    energy                      (n,)         J      kinetic and potential; NaN if the engine does not know
    servo_work, contact_work    (n,)         J      put in during the tick before; NaN likewise
    solver_residual             (n,)         1      largest of the tick before; NaN likewise
    phase                       (n,)         1      running number of the gait phase
    stance                      (n, L)       bool   legs commanded to carry
    extending                   (n,)         bool   feet are reaching for lost ground
    limited                     (n, L)       bool   foot target clipped (out of reach or joint limits)
    delta_z                     (n,)         m      height error in use
    delta_alpha, delta_beta     (n,)         rad    estimated slope in use, pitch and roll
    plane_misfit                (n,)         m      largest distance of another supporting foot from the plane
    ==========================  ===========  =====  ==================================================

    ``parameters`` is a JSON-like mapping: robot, terrain, controller, engine, steps, seed and versions.
    """

    time: Array
    T_world_body: Array
    body_velocity: Array
    body_angular_velocity: Array
    body_rate_moment: Array
    height: Array
    q: Array
    q_command: Array
    joint_torque: Array
    p_body_foot: Array
    foot_force: Array
    foot_force_last: Array
    torso_force: Array
    limb_force: Array
    penetration: Array
    energy: Array
    servo_work: Array
    contact_work: Array
    solver_residual: Array
    phase: NDArray[np.int_]
    stance: NDArray[np.bool_]
    extending: NDArray[np.bool_]
    limited: NDArray[np.bool_]
    delta_z: Array
    delta_alpha: Array
    delta_beta: Array
    plane_misfit: Array
    parameters: Mapping[str, Any]

    @property
    def num_legs(self) -> int:
        """Number of legs L."""
        return self.q.shape[1]

    @property
    def cycle(self) -> NDArray[np.int_]:
        """Running number (n,) of the gait cycle."""
        return self.phase // int(self.parameters["phases_per_cycle"])

    @property
    def forward(self) -> Array:
        """Unit vector (3,) of walking in the body frame."""
        return np.array(self.parameters["robot"]["forward"])

    @property
    def right(self) -> Array:
        """Unit vector (3,) to the right of walking in the body frame."""
        return np.cross(self.forward, [0.0, 0.0, 1.0])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a NumPy ``.npz`` archive; the file appears whole or not at all."""
        target = Path(path)
        if target.suffix != ".npz":
            target = target.with_name(target.name + ".npz")
        temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
        arrays = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "parameters"}
        try:
            with open(temporary, "wb") as stream:
                np.savez_compressed(
                    stream, format=_FORMAT, parameters=json.dumps(dict(self.parameters), default=_plain), **arrays
                )
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


_TRAILING: dict[str, tuple[str | int, ...]] = {
    "T_world_body": (4, 4), "body_velocity": (3,), "body_angular_velocity": (3,), "body_rate_moment": (3, 3),
    "q": ("L", 3), "q_command": ("L", 3), "joint_torque": ("L", 3), "p_body_foot": ("L", 3), "foot_force": ("L",),
    "foot_force_last": ("L",), "stance": ("L",), "limited": ("L",),
}  # fmt: skip
_KINDS = {"phase": "i", "stance": "b", "extending": "b", "limited": "b"}
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, KeyError, TypeError, NotImplementedError)


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read what ``Recording.save`` wrote.

    Raises RecordingError, naming file and fault, for a file that is missing, truncated, damaged or of another kind.
    """
    names = [field.name for field in fields(Recording) if field.name != "parameters"]
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            if "format" not in archive or str(archive["format"]) != _FORMAT:
                raise RecordingError(f"{path}: not a hexakin recording (expected format {_FORMAT})")
            missing = [name for name in [*names, "parameters"] if name not in archive]
            if missing:
                raise RecordingError(f"{path}: lacks {', '.join(missing)}")
            arrays = {name: archive[name] for name in names}
            parameters = json.loads(str(archive["parameters"]))
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: no such file") from error
    except RecordingError:
        raise
    except _DAMAGED as error:
        raise RecordingError(f"{path}: truncated or damaged, not readable as a recording ({error})") from error
    _check(str(path), arrays, parameters)
    return Recording(**arrays, parameters=parameters)


def _check(path: str, arrays: dict[str, np.ndarray], parameters: Any) -> None:
    """Raise RecordingError unless shapes, kinds and the parameters that others rely on are those of the table."""
    time = arrays["time"]
    legs = arrays["q"].shape[1] if arrays["q"].ndim == 3 else 0
    if time.ndim != 1 or len(time) == 0 or legs == 0:
        raise RecordingError(f"{path}: time {time.shape} and q {arrays['q'].shape} are not those of a recording")
    for name, array in arrays.items():
        shape = (len(time), *(legs if size == "L" else size for size in _TRAILING.get(name, ())))
        if array.shape != shape or array.dtype.kind != _KINDS.get(name, "f"):
            raise RecordingError(f"{path}: {name} has shape {array.shape} of {array.dtype}, expected {shape}")
    needed = ("robot", "phases_per_cycle", "controller", "control_rate")
    if not isinstance(parameters, dict) or any(name not in parameters for name in needed):
        raise RecordingError(f"{path}: its parameters lack one of {', '.join(needed)}")
