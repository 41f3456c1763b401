"""Collision shapes on the joints of a Pinocchio model."""

from __future__ import annotations

from typing import NamedTuple

from hexakin.checks import Array
from hexakin.numerics.display import short_repr


class Sphere(NamedTuple):
    """A sphere that is fixed to the body of a joint.

    ``joint`` is the joint's index in the model. ``center`` (3,) [m] is in the joint's frame; ``radius`` in [m]. The
    impulses on the sphere are added to the group ``group`` (index from 0).
    """

    joint: int
    center: Array
    radius: float
    group: int

    def __repr__(self) -> str:
        return short_repr(self)


class Cuboid(NamedTuple):
    """A box that is fixed to the body of a joint.

    ``joint`` is the joint's index in the model. ``placement`` (4, 4) is the pose of the box's centre in the joint's
    frame; ``size`` (3,) [m] are the full edge lengths. The impulses on the box are added to the group ``group`` (index
    from 0).
    """

    joint: int
    placement: Array
    size: Array
    group: int

    def __repr__(self) -> str:
        return short_repr(self)
