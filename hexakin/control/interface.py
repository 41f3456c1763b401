"""The interface of controllers: an observation in and a command out, once per control tick (A section 1)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from numbers import Real
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_function, check_number, check_shape, check_whole, checked
from hexakin.exceptions import InvalidInputError, shown
from hexakin.motion.recording import Recording, as_json
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import Robot

_LARGEST_PHASE = 2**31 - 1


class Observation(NamedTuple):
    """The sensor values that a controller receives: joints, foot forces, height and an IMU (A section 1).

    Parameters
    ----------
    time
        Start of the control tick [s].
    q
        Joint angles (L, 3) [rad].
    joint_velocity
        Joint rates (L, 3) [rad/s].
    foot_force
        Normal force on each foot (L,) [N], by default the mean over the last control tick (see ``simulate``).
    height
        Distance [m] from the body's origin to the ground along the body's downward axis (infrared sensor).
    body_angular_velocity
        Angular velocity of the body (3,) [rad/s], in the body frame.
    up_in_body
        Unit vector (3,) that points upwards, against gravity, in the body frame.
    """

    time: float
    q: Array
    joint_velocity: Array
    foot_force: Array
    height: float
    body_angular_velocity: Array
    up_in_body: Array

    def __repr__(self) -> str:
        return short_repr(self)

    @classmethod
    @checked
    def at_rest(cls, time: float, q: ArrayLike, foot_force: ArrayLike, height: float) -> Observation:
        """Return the observation of an upright robot that does not move.

        ``time`` [s], ``q`` (L, 3) [rad], ``foot_force`` (L,) [N] and ``height`` [m] are the fields of the same names.
        """
        angles, upwards = check_shape("q", q, (None, NUM_JOINTS)), np.array([0.0, 0.0, 1.0])
        force = check_shape("foot_force", foot_force, (len(angles),), ("leg",))
        check_number("time", time, unit="s")
        check_number("height", height, unit="m")
        return cls(time, angles, np.zeros_like(angles), force, height, np.zeros(3), upwards)


class Command(NamedTuple):
    """What a controller commands for one control tick (A section 4).

    With q alone, the robot's servos turn the joints to these angles. If torque, kp or kd is given, the servos are off
    and each joint applies the torque "torque + kp (q - angle) - kd rate" at every time step, limited to the max_torque
    of the servo. Of the three, those that are None count as zero. The engine ``rigid`` does not stop a joint at its
    limits, so a controller must keep them.

    Parameters
    ----------
    q
        Wanted joint angles (L, 3) [rad].
    stance
        Whether each leg is in stance, (L,) bool.
    phase
        Number of the current gait phase, counted from 0 at the start of the walk. It ends a walk of n gait cycles when
        it reaches n times the phases per cycle.
    extending
        Whether feet without contact are moving down to find the ground (A Fig. 6).
    limited
        Whether each leg's foot target was out of reach or beyond the joint limits and was clipped, (L,) bool; None if
        no target was.
    diagnostics
        Numbers by name, which become columns of the recording. The names must be identifiers that ``Recording`` does
        not use for its members, and the same at every tick.
    torque
        Torques (L, 3) [N m] that are added, or None.
    kp
        Stiffness (L, 3) [N m/rad], not negative, or None.
    kd
        Damping (L, 3) [N m s/rad], not negative, or None.
    """

    q: Array
    stance: NDArray[np.bool_]
    phase: int
    extending: bool = False
    limited: NDArray[np.bool_] | None = None
    diagnostics: Mapping[str, float] = MappingProxyType({})
    torque: Array | None = None
    kp: Array | None = None
    kd: Array | None = None

    def __repr__(self) -> str:
        return short_repr(self)


def check_command(command: object, num_legs: int) -> Command:
    """Return ``command`` with own copies of its arrays, of the right shapes and kinds, for ``num_legs`` legs.

    Raises InvalidInputError, which names the field, for an object that is no Command, for a wrong shape, a value that
    is not finite, flags that are not bool, a phase that is no whole number from 0, a negative gain, and for diagnostics
    that are no numbers or whose names cannot be columns of a recording.
    """
    if not isinstance(command, Command):
        raise InvalidInputError(f"expected a hexakin.Command, got {shown(command)}")
    shape, given = (num_legs, NUM_JOINTS), command._asdict()
    for name in ("q", "torque", "kp", "kd"):
        if given[name] is not None:
            given[name] = _exact(name, given[name], shape)
    for name in ("kp", "kd"):
        if given[name] is not None and (given[name] < 0.0).any():
            raise InvalidInputError(f"{name}: {given[name].min():g}, expected at least 0")
    for name in ("stance", "limited"):
        absent = name == "limited" and given[name] is None
        try:
            flags = np.zeros(num_legs, dtype=bool) if absent else np.array(given[name])
        except Exception as error:  # an object may raise anything when it is converted
            raise InvalidInputError(f"{name}: expected {num_legs} booleans, got {shown(given[name])}") from error
        if flags.shape != (num_legs,) or flags.dtype != bool:
            raise InvalidInputError(f"{name}: expected {num_legs} booleans, got {flags.dtype} of shape {flags.shape}")
        given[name] = flags
    if not isinstance(command.extending, (bool, np.bool_)):
        raise InvalidInputError(f"extending: {shown(command.extending)}, expected True or False")
    given["extending"] = bool(command.extending)
    given["phase"] = check_whole("phase", command.phase)
    if given["phase"] > _LARGEST_PHASE:
        raise InvalidInputError(f"phase: {given['phase']}, expected at most {_LARGEST_PHASE}")
    if not isinstance(command.diagnostics, Mapping):
        raise InvalidInputError(f"diagnostics: {shown(command.diagnostics)}, expected a mapping of names to numbers")
    given["diagnostics"] = {name: _number(name, value) for name, value in command.diagnostics.items()}
    return Command(**given)


def check_answer(controller: Controller, command: object, time: float, first: Command | None = None) -> Command:
    """Return the checked ``command`` that ``controller`` gave at ``time`` [s]; ``first`` is its first one.

    Raises InvalidInputError that names the controller and the time, as ``check_command`` and for diagnostics that the
    first command did not have, or had in addition.
    """
    try:
        checked = check_command(command, controller.robot.num_legs)
        if first is not None and checked.diagnostics.keys() != first.diagnostics.keys():
            odd = sorted(checked.diagnostics.keys() ^ first.diagnostics.keys())
            raise InvalidInputError(f"diagnostics: {', '.join(odd)} not at every tick")
    except InvalidInputError as error:
        raise InvalidInputError(f"command of {type(controller).__name__} at t = {time:g} s: {error}") from error
    return checked


def check_controller(controller: Any, control_rate: float) -> dict[str, Any]:
    """Return the parameters of ``controller`` as a recording keeps them, with the name of its class as "name".

    Raises InvalidInputError for an object without a robot, that lacks a member of ``Controller``, that has no gait
    phases, whose parameters cannot be written as JSON, or that cannot work at ``control_rate`` [Hz].
    """
    kind = type(controller).__name__
    if not isinstance(getattr(controller, "robot", None), Robot):
        raise InvalidInputError(
            f"controller: expected one such as hexakin.PostureController(robot), got {shown(controller)}"
        )
    for name, arguments in (("parameters", ()), ("start", ("observation", "control_rate"))):
        _check_method(f"controller: {kind}", controller, name, *arguments)
    phases = getattr(controller, "phases_per_cycle", None)
    try:
        check_whole("phases_per_cycle", phases, at_least=1)
        parameters = {**controller.parameters(), "name": kind}
        json.dumps(parameters, default=as_json)
    except (InvalidInputError, TypeError, ValueError, RecursionError) as error:
        raise InvalidInputError(f"controller: {kind}: {error}") from error
    if callable(check_rate := getattr(controller, "check_control_rate", None)):
        check_function(f"controller: {kind}: check_control_rate", check_rate, "control_rate")
        check_rate(control_rate)
    return parameters


def started(controller: Controller, observation: Observation, control_rate: float) -> ControlRun:
    """Return the run of ``controller`` that begins with ``observation``; it is commanded at ``control_rate`` [Hz].

    Raises InvalidInputError if the controller's ``start`` returns an object without the method ``command``.
    """
    run = controller.start(observation, control_rate)
    _check_method(f"controller: start of {type(controller).__name__}: {shown(run)}", run, "command", "observation")
    return run


def _check_method(owner: str, value: object, name: str, *arguments: str) -> None:
    """Raise InvalidInputError unless ``value``, which is called ``owner``, has a method ``name`` of ``arguments``."""
    method = getattr(value, name, None)
    if not callable(method):
        raise InvalidInputError(f"{owner} has no method '{name}', see hexakin.Controller")
    check_function(f"{owner}: {name}", method, *arguments)


def _exact(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    array = check_array(name, value, shape, ("leg", "joint"))
    if array.ndim != 2:
        raise InvalidInputError(f"{name}: expected shape {shape}, got {array.shape}")
    return array.copy()


def _number(name: object, value: Any) -> float:
    if not isinstance(name, str) or not name.isidentifier():
        raise InvalidInputError(f"diagnostics: {shown(name)} as a name, expected a string such as 'battery_voltage'")
    if _is_a_member(name):
        raise InvalidInputError(f"diagnostics: {name!r}: a recording has a member of that name")
    if type(value) is float:
        return value
    if not isinstance(value, (bool, np.bool_, Real, np.number)) or isinstance(value, np.complexfloating):
        raise InvalidInputError(f"diagnostics: {name}: expected a number, got {shown(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise InvalidInputError(f"diagnostics: {name}: {shown(value)} is too large") from error


@lru_cache(maxsize=1024)
def _is_a_member(name: str) -> bool:
    return hasattr(Recording, name) or name in Recording.__dataclass_fields__


class ControlRun(Protocol):
    """One run of a controller; it keeps the controller's state from tick to tick (A section 4)."""

    def command(self, observation: Observation) -> Command:
        """Return the command for the control tick that begins with ``observation``."""


class Controller(Protocol):
    """A controller: a value that can start any number of runs (A section 4).

    Two runs that receive equal observations return equal commands. A controller may also have a method
    ``check_control_rate(control_rate)``. It is called before the robot is placed, and raises InvalidInputError if the
    controller cannot work at this rate [Hz].
    """

    @property
    def robot(self) -> Robot:
        """The robot that the controller was made for."""

    @property
    def phases_per_cycle(self) -> int:
        """Number of gait phases in a cycle."""

    def parameters(self) -> dict[str, Any]:
        """Return all parameters except the robot, by name, as values that JSON can store."""

    def start(self, observation: Observation, control_rate: float) -> ControlRun:
        """Begin a run at ``observation``; its ``command`` will be called ``control_rate`` [Hz] times per second."""
