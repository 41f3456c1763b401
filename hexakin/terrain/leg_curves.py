"""Paper B's terrain: six curves, one for each leg, derived from one reference curve (B(14)-(16))."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_function, check_whole, checked, read_only
from hexakin.exceptions import InvalidInputError
from hexakin.terrain.base import check_positions

_MOST_LEGS = 100  # more than any robot file may have


def _zero(*arguments: Array) -> Array:
    """Return zeros of the shape of the first argument (...) [m]: the default reference, level and straight ahead."""
    return np.zeros_like(arguments[0])


@checked
@dataclass(frozen=True, eq=False)
class LegCurves:
    """A reference curve, and coefficients that give each leg's curve (B(14)-(16)).

    At the distance s [m] along the walk, the reference curve is y = ``reference_y(s)`` [m] to the left and
    z = ``reference_z(s, y)`` [m] high (B(14): f_x and f_xy). Leg j follows (k[0, j] s, k[1, j] y, k[2, j] z), measured
    from its own standing foothold (B(16)).

    The curves are not one height over the plane: two legs may pass the same place at different heights. With k[0, j]
    other than 1 a leg lags behind the body or runs ahead of it until it is out of reach.

    Raises InvalidInputError if a reference is not a function of these arguments, for a ``k`` of wrong shape or not
    finite, and for more than 100 legs.

    Parameters
    ----------
    reference_y
        Function of s (...) [m], an array; returns y (...) [m]. The default is 0 everywhere.
    reference_z
        Function of s (...) [m] and y (...) [m]; returns z (...) [m]. The default is 0 everywhere.
    k
        Coefficients (3, L), numbers without unit; None sets all to 1.
    num_legs
        Number of legs L.
    """

    reference_y: Callable[[Array], Array] = _zero
    reference_z: Callable[[Array, Array], Array] = _zero
    k: ArrayLike | None = None
    num_legs: int = 6

    def __post_init__(self) -> None:
        if check_whole("LegCurves: num_legs", self.num_legs, at_least=1) > _MOST_LEGS:
            raise InvalidInputError(f"LegCurves: num_legs: {self.num_legs}, expected at most {_MOST_LEGS}")
        check_function("LegCurves: reference_y", self.reference_y, "s")
        check_function("LegCurves: reference_z", self.reference_z, "s", "y")
        k = np.ones((3, self.num_legs)) if self.k is None else self.k
        object.__setattr__(self, "k", read_only(check_array("LegCurves: k", k, (3, self.num_legs), ("row", "leg"))))

    def __repr__(self) -> str:
        try:
            sample = self.displacement(np.linspace(0.0, 1.0, 101)[:, None])
            curves = hashlib.sha256(sample.tobytes()).hexdigest()[:12]
        except InvalidInputError:
            curves = "not finite everywhere"
        return f"LegCurves(k={np.asarray(self.k).tolist()}, curves {curves})"

    def _reference(self, name: str, *arguments: Array) -> Array:
        try:
            values = np.asarray(getattr(self, name)(*arguments))
            if values.dtype.kind not in "biuf":
                raise TypeError(f"got {values.dtype}")
            result = np.broadcast_to(values, arguments[0].shape).astype(float)
        except (TypeError, ValueError) as error:
            raise InvalidInputError(
                f"LegCurves: {name} must return numbers of its argument's shape ({error})"
            ) from error
        if not np.isfinite(result).all():
            raise InvalidInputError(f"LegCurves: {name} is not finite everywhere along the walk")
        return result

    def displacement(self, s: ArrayLike) -> Array:
        """Return the displacement (..., L, 3) [m] (ahead, left, up) of each leg's curve from its standing foothold.

        ``s`` (..., L) or (..., 1) [m] is the distance along the walk, for each leg or for all. Raises InvalidInputError
        for another shape, or if a reference curve does not return finite numbers of its argument's shape.
        """
        distance = check_positions("s", s)
        if distance.ndim == 0 or distance.shape[-1] not in (1, self.num_legs):
            raise InvalidInputError(f"s: expected shape (..., {self.num_legs}) or (..., 1), got {distance.shape}")
        y = self._reference("reference_y", distance)
        z = self._reference("reference_z", distance, y)
        k = np.asarray(self.k)
        return np.stack(np.broadcast_arrays(k[0] * distance, k[1] * y, k[2] * z), axis=-1)
