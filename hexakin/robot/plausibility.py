"""Checks that bodies can exist: mass, inertia and centre of mass must fit together and fit the size of the box."""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.robot.model import Body
from hexakin.robot.schema import FieldError

DENSITY = (5.0, 22_600.0)
"""Allowed mass per volume of the box [kg/m^3]: from the lightest foam to osmium, the densest solid."""

GYRATION = (2e-3, 1e2)
"""Allowed ratio of the largest moment of inertia to the largest that mass within the box can have. A uniform box has
1/3, a servo in the corner of a large box 1/50; a value in a unit that is wrong by a factor of 1000 is outside."""

_FOOT_GYRATION = (2e-3, 1e3)  # the sphere is only the foot's contact surface; its mass may extend further
_CENTER = 10.0  # times the size of box and segment: a centre of mass further away is in another unit


def principal_moments(body: Body) -> Array:
    """Return the principal moments of inertia (3,) [kg m^2] of ``body``, ascending."""
    return np.asarray(np.linalg.eigvalsh(body.inertia), dtype=float)


def most_inertia(body: Body) -> Array:
    """Return the largest moments (3,) [kg m^2] about x, y, z that mass within the box of ``body`` can have.

    They are those of a mass that is all at the corners.
    """
    squares = body.size**2
    return 0.25 * body.mass * (squares.sum() - squares)


def check_body(body: Body, where: str, length: float) -> None:
    """Raise FieldError unless ``body`` can exist; ``where`` is its field, ``length`` [m] that of its segment."""
    _check_inertia(body, where)
    volume = float(np.prod(body.size))
    density = body.mass / volume
    if not DENSITY[0] <= density <= DENSITY[1]:
        box = " x ".join(f"{edge:g}" for edge in body.size)
        raise FieldError(
            f"{where}.mass: {body.mass:g} kg in a box of {box} m are {density:.3g} kg/m^3, expected "
            f"{DENSITY[0]:g} (foam) to {DENSITY[1]:g} (osmium); are the units of mass and size right?"
        )
    _check_gyration(body, where, float(most_inertia(body).max()), GYRATION)
    reach = _CENTER * (float(np.linalg.norm(body.size)) + length)
    distance = float(np.linalg.norm(body.center_of_mass))
    if distance > reach:
        raise FieldError(
            f"{where}.center_of_mass: {distance:g} m away, expected at most {reach:g} m, {_CENTER:g} times the body's "
            "size; are the units right?"
        )


def check_foot(foot: Body) -> None:
    """Raise FieldError unless the spherical ``foot`` can exist."""
    _check_inertia(foot, "foot")
    radius = 0.5 * float(foot.size[0])
    if radius == 0.0:
        return
    density = foot.mass / (4.0 / 3.0 * np.pi * radius**3)
    if density < DENSITY[0]:
        raise FieldError(
            f"foot.mass: {foot.mass:g} kg in a sphere of radius {radius:g} m are {density:.3g} kg/m^3, expected "
            f"at least {DENSITY[0]:g} (foam); are the units of mass and radius right?"
        )
    _check_gyration(foot, "foot", foot.mass * radius**2, _FOOT_GYRATION)


def _check_inertia(body: Body, where: str) -> None:
    moments = principal_moments(body)
    shown = "[" + ", ".join(f"{moment:.4g}" for moment in moments) + "]"
    if not moments[0] > 0.0:
        raise FieldError(f"{where}.inertia: not positive definite, principal moments {shown} kg m^2")
    if not moments[0] + moments[1] >= moments[2] * (1.0 - 1e-9):
        raise FieldError(f"{where}.inertia: violates the triangle inequality, principal moments {shown} kg m^2")


def _check_gyration(body: Body, where: str, most: float, share: tuple[float, float]) -> None:
    largest = float(principal_moments(body)[2])
    if not share[0] * most <= largest <= share[1] * most:
        raise FieldError(
            f"{where}.inertia: {largest:.3g} kg m^2, expected about {most / 3.0:.3g} for {body.mass:g} kg of this size "
            f"({share[0] * most:.2g} to {share[1] * most:.2g}); is it in kg m^2?"
        )
