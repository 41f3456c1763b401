"""Collision shapes on the joints of a Pinocchio model."""

from __future__ import annotations

from typing import NamedTuple

from hexakin.checks import Array


class Sphere(NamedTuple):
    """A sphere on a joint's body: ``center`` (3,) [m] in the joint's frame, ``radius`` [m], ``group`` it counts to."""

    joint: int
    center: Array
    radius: float
    group: int


class Cuboid(NamedTuple):
    """A box on a joint's body: ``placement`` (4, 4) of its centre in the joint's frame, full ``size`` (3,) [m]."""

    joint: int
    placement: Array
    size: Array
    group: int
