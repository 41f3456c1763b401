"""All errors that hexakin raises. A message names the faulty argument, its value and the allowed values."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any

__all__ = [
    "ClearanceError",
    "ContactError",
    "FileError",
    "HexakinError",
    "InvalidInputError",
    "JointLimitError",
    "MissingPackageError",
    "NoClosedFormError",
    "RecordingError",
    "RobotFileError",
    "SimulationError",
    "SolverError",
    "StudyError",
    "UnknownNameError",
    "UnreachableError",
]

_LONGEST = 80  # characters of a value in a message


def shown(value: object) -> str:
    """Return ``value`` in one line of at most 80 characters, for a message; a long array by its shape and type."""
    try:
        if type(value).__name__ == "ndarray" and getattr(value, "size", 0) > 4:
            return f"an array {getattr(value, 'shape', '')} of {getattr(value, 'dtype', '')}"
        text = " ".join(repr(value).split())
    except Exception:  # an object may raise anything; Python refuses to write integers of thousands of digits
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


class HexakinError(Exception):
    """Base of every error that hexakin raises on purpose."""

    def __reduce__(self) -> tuple:
        """Pickle by message and attributes, so that an error from a worker process keeps its attributes."""
        return _rebuild, (type(self), self.args, self.__dict__)


def _rebuild(kind: type[HexakinError], args: tuple, attributes: dict) -> HexakinError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error


class InvalidInputError(HexakinError, ValueError):
    """An argument has the wrong shape, a value that is not finite, or a value out of its range."""


class RobotFileError(HexakinError, ValueError):
    """A robot description cannot be read, or describes a robot that cannot exist."""


class UnknownNameError(HexakinError, LookupError):
    """There is no robot, engine, terrain or option of the given name.

    ``kind`` is what the name should stand for (such as "robot"), ``name`` the given name, ``known`` the valid names.
    They are kept as attributes.
    """

    def __init__(self, kind: str, name: object, known: list[str]):
        self.kind, self.name, self.known = kind, name, known
        super().__init__(f"unknown {kind} {shown(name)}; known: {', '.join(known)}")


class MissingPackageError(HexakinError, ImportError):
    """A feature needs an optional package that is not installed.

    ``package`` is the name of the package (kept as an attribute), ``feature`` what needs it, ``install`` the command
    that installs it, and ``instead`` what can be done without it. An empty ``install`` says that there is no package
    for this Python and platform.
    """

    def __init__(self, package: str, feature: str, install: str, instead: str = ""):
        self.package = package.partition(".")[0]  # an ImportError may name a module of it
        missing = f"install it with: {install}" if install else f"there is none for {_python_and_platform()}"
        super().__init__(
            f"{feature} needs the package {self.package!r}; {missing}" + (f"; or {instead}" if instead else "")
        )


def _python_and_platform() -> str:
    import platform  # here, since importing hexakin is to take no time

    return f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"


class NoClosedFormError(HexakinError):
    """The leg's Denavit-Hartenberg table has no closed-form inverse known to hexakin."""


class UnreachableError(HexakinError):
    """A foot target lies outside the leg's reach.

    Attributes: ``leg`` (1-based), ``distance`` [m] from the leg's second joint to the target,
    ``reach`` (min, max) [m], ``time`` [s] on a path, else None. ``where`` is the index of the target in a batch, as
    text for the message; it may be empty.
    """

    def __init__(
        self, leg: int, distance: float, reach: tuple[float, float], where: str = "", time: float | None = None
    ):
        self.leg, self.distance, self.reach, self.time = leg, distance, reach, time
        if distance > reach[1]:
            relation = f"exceeds its reach {reach[1]:.6g} m"
        elif distance < reach[0]:
            relation = f"is inside its inner reach {reach[0]:.6g} m"
        else:
            relation = "lies too close to the first joint's axis for the leg's offset"
        at = f" (at index {where})" if where else "" if time is None else f" (t = {time:.6g} s)"
        super().__init__(f"leg {leg}: foot target {distance:.6g} m from the second joint {relation}{at}")


class JointLimitError(HexakinError):
    """A commanded joint angle leaves its limits.

    Attributes: ``leg`` (1-based), ``joint`` (its name), ``angle`` and ``limits`` [rad], ``time`` [s].
    """

    def __init__(self, leg: int, joint: str, angle: float, limits: tuple[float, float], time: float):
        self.leg, self.joint, self.angle, self.limits, self.time = leg, joint, angle, limits, time
        low, high = limits
        super().__init__(
            f"leg {leg}: {joint} = {angle:.4g} rad leaves its limits [{low:.4g}, {high:.4g}] (t = {time:.6g} s)"
        )


class ClearanceError(HexakinError):
    """A swing cuts through the terrain.

    Attributes: ``leg`` (1-based), ``step`` (1-based), ``depth`` [m] of the cut. ``arch`` is the highest swing that was
    tried, as a multiple of the cycloid's height.
    """

    def __init__(self, leg: int, step: int, depth: float, arch: float):
        self.leg, self.step, self.depth = leg, step, depth
        super().__init__(
            f"leg {leg}: its swing in step {step} cuts {1e3 * depth:.3g} mm into the terrain even at {arch:g} times "
            "the cycloid's height"
        )


class SimulationError(HexakinError, RuntimeError):
    """A simulation cannot continue: the state is not finite any more, or the robot has left the scene."""


class TerrainFileError(HexakinError, ValueError):
    """A file of elevation data cannot be read, or its contents are not usable as a terrain."""


class FileError(HexakinError, OSError):
    """A file cannot be read or written: it is missing, damaged or too large, or its folder is missing or full."""


class RecordingError(HexakinError, ValueError):
    """A recording cannot be read: the file is truncated, is not a recording, or has another format."""


class ContactError(HexakinError, ArithmeticError):
    """No impulses were found that satisfy the contact laws to the tolerance.

    Attributes: the ``residual`` that was reached and the ``tolerance`` (both relative), and the number of
    ``iterations``.
    """

    def __init__(self, residual: float, tolerance: float, iterations: int):
        self.residual, self.tolerance, self.iterations = residual, tolerance, iterations
        super().__init__(
            f"contact problem not solved: relative residual {residual:.2g} after {iterations} iterations, "
            f"tolerance {tolerance:.2g}"
        )


class SolverError(HexakinError, ArithmeticError):
    """A solver stopped without a result: it found no solution and no proof that none exists."""


class StudyError(HexakinError, RuntimeError):
    """A study cannot start or continue: its files were made by other code, the disk is full, or a run failed."""


def renamed(module: str, new_names: Mapping[str, tuple[str, Any]]) -> Callable[[str], Any]:
    """Return a module's ``__getattr__`` that keeps old names for one release, with a DeprecationWarning.

    ``module`` is the module's name. ``new_names`` maps each old name to a pair: the new name and the object. The
    function raises AttributeError for any other name.
    """

    def old_name(name: str) -> Any:
        if name not in new_names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        new, value = new_names[name]
        warnings.warn(f"{module}.{name} is now called {new}", DeprecationWarning, stacklevel=2)
        return value

    return old_name


def exit_code(command: Callable[[], int | None]) -> int:
    """Run ``command``, a program of the command line, and return its exit code; None counts as 0.

    What stops it is said in one line on stderr: an error of hexakin or of the operating system (exit code 1), such as a
    closed pipe or a full disk, or an interrupt (130). Characters that a stream cannot encode are written as escapes.
    """
    if sys.stderr is None:  # closed by the caller
        sys.stderr = open(os.devnull, "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        try:
            return command() or 0
        finally:
            sys.stdout.flush()  # here, because an error at the interpreter's exit has a traceback
    except HexakinError as error:
        code, message = 1, f"hexakin: {error}"
    except OSError as error:
        code, message = 1, f"hexakin: {error.filename or 'standard output'}: {error.strerror or error}"
        _give_up(sys.stdout)
    except KeyboardInterrupt as error:
        code, message = 130, "; ".join(["\nhexakin: interrupted", *map(str, error.args)])
    try:
        print(message, file=sys.stderr, flush=True)
    except OSError:
        _give_up(sys.stderr)
    return code


def _give_up(stream: Any) -> None:
    """Drop what ``stream`` could not write, so that the interpreter does not try again at its exit."""
    with contextlib.suppress(AttributeError, OSError):  # closed, or a stream without a file
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
