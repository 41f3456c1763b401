"""The one error family of hexakin: every error names the culprit, its value and the bound."""

from __future__ import annotations


class HexakinError(Exception):
    """Base of every error that hexakin raises on purpose."""

    def __reduce__(self) -> tuple:
        """Pickle by message and attributes, so that an error comes back whole from a worker process."""
        return _rebuild, (type(self), self.args, self.__dict__)


def _rebuild(kind: type[HexakinError], args: tuple, attributes: dict) -> HexakinError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error


class InvalidInputError(HexakinError, ValueError):
    """An argument has the wrong shape, a value that is not finite, or a value out of its range."""


class RobotFileError(HexakinError, ValueError):
    """A robot description cannot be read or does not describe a possible robot."""


class UnknownNameError(HexakinError, LookupError):
    """A robot, engine, terrain or option was asked for by a name that does not exist."""

    def __init__(self, kind: str, name: object, known: list[str]):
        self.kind, self.name, self.known = kind, name, known
        super().__init__(f"unknown {kind} {name!r}; known: {', '.join(known)}")


class MissingPackageError(HexakinError, ImportError):
    """A feature needs an optional package that is not installed."""

    def __init__(self, package: str, feature: str, install: str):
        self.package = package
        super().__init__(f"{feature} needs the package {package!r}; install it with: {install}")


class NoClosedFormError(HexakinError):
    """The leg's Denavit-Hartenberg table has no closed-form inverse known to hexakin."""


class UnreachableError(HexakinError):
    """A foot target lies outside the leg's reach.

    Attributes: ``leg`` (1-based), ``distance`` [m] from the leg's second joint to the target,
    ``reach`` (min, max) [m].
    """

    def __init__(self, leg: int, distance: float, reach: tuple[float, float], where: str = ""):
        self.leg, self.distance, self.reach = leg, distance, reach
        if distance > reach[1]:
            relation = f"exceeds its reach {reach[1]:.6g} m"
        elif distance < reach[0]:
            relation = f"is inside its inner reach {reach[0]:.6g} m"
        else:
            relation = "lies too close to the first joint's axis for the leg's offset"
        at = f" (at index {where})" if where else ""
        super().__init__(f"leg {leg}: foot target {distance:.6g} m from the second joint {relation}{at}")


class SimulationError(HexakinError, RuntimeError):
    """A simulation cannot go on: the state is no longer finite or the robot has left the scene."""


class RecordingError(HexakinError, ValueError):
    """A recording cannot be read: truncated, not a recording, or of another format."""
