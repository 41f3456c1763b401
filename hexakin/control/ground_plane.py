"""Paper A's estimate of the ground: feet that carry load (A Fig. 6), the plane through three of them (A(24)-(26))."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_flags, check_number, check_shape
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot

MIN_SLENDERNESS = 0.2
"""Smallest slenderness at which three feet are used to define a plane.

Assumed: an equilateral triangle has 0.87; the three feet of one side of ATHENA, whose plane does not
determine the roll angle, have 0.16; every other triple of its standing feet has at least 0.35.
"""


class GroundPlane(NamedTuple):
    """A plane through three feet, in the body frame (A(24)).

    ``legs`` (3,) are the indices of the three legs. ``normal`` (3,) is the unit normal that points up. Points p of the
    plane satisfy normal @ p = ``offset`` [m]. ``misfit`` [m] is the largest distance of the other supporting feet from
    the plane, NaN if there are none.
    """

    legs: tuple[int, ...]
    normal: Array
    offset: float
    misfit: float

    def __repr__(self) -> str:
        return short_repr(self)


def supporting_feet(foot_force: ArrayLike, threshold: float = 0.0) -> NDArray[np.bool_]:
    """Whether each foot carries load, (..., L) bool: its normal force is above a threshold (A Fig. 6: above zero).

    ``foot_force`` (..., L) [N] are the normal forces, ``threshold`` [N] is the same for all feet.
    """
    return check_array("foot_force", foot_force, (None,), ("leg",)) > check_number("threshold", threshold, unit="N")


def slenderness(p: ArrayLike) -> float:
    """Ratio of the smallest altitude of a triangle to its longest side: 0 if collinear, 0.87 if equilateral.

    ``p`` (3, 3) [m] are the corners, one per row.
    """
    corners = check_shape("p", p, (3, 3))
    longest = max(float(np.linalg.norm(corners[i] - corners[j])) for i, j in ((0, 1), (1, 2), (2, 0)))
    twice_area = float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])))
    return twice_area / longest**2 if longest > 0.0 else 0.0


def usable_triples(p_body_foot: ArrayLike, support: ArrayLike) -> list[tuple[int, ...]]:
    """Triples of supporting legs whose feet are far enough from collinear to define a plane.

    ``p_body_foot`` (L, 3) [m] are the feet, ``support`` (L,) bool tells which of them carry load. Returns tuples of
    three leg indices; their slenderness is at least ``MIN_SLENDERNESS``.
    """
    feet = check_shape("p_body_foot", p_body_foot, (None, 3))
    legs = [int(leg) for leg in np.flatnonzero(check_flags("support", support, (len(feet),)))]
    return [triple for triple in combinations(legs, 3) if slenderness(feet[list(triple)]) >= MIN_SLENDERNESS]


def ground_plane(p_body_foot: ArrayLike, support: ArrayLike, rng: np.random.Generator) -> GroundPlane | None:
    """Plane through a random usable triple of the supporting feet (A(24)), or None if there is no such triple.

    ``p_body_foot`` (L, 3) [m] are the feet in the body frame, ``support`` (L,) bool tells which of them carry load.
    ``rng`` draws the triple; if there is only one, nothing is drawn.
    """
    feet = check_shape("p_body_foot", p_body_foot, (None, 3))
    triples = usable_triples(feet, support)
    if not triples:
        return None
    triple = triples[int(rng.integers(len(triples)))] if len(triples) > 1 else triples[0]
    a, b, c = feet[list(triple)]
    normal = np.cross(b - a, c - a)
    normal *= np.copysign(1.0, normal[2]) / np.linalg.norm(normal)
    offset = float(normal @ a)
    others = [leg for leg in np.flatnonzero(support) if leg not in triple]
    misfit = float(np.abs(feet[others] @ normal - offset).max()) if others else float("nan")
    return GroundPlane(triple, normal, offset, misfit)


def slope_angles(robot: Robot, normal: ArrayLike) -> tuple[float, float]:
    """Signed pitch and roll angles (delta_alpha, delta_beta) [rad] of the ground relative to the torso.

    ``normal`` (3,) is the unit normal of the ground in the body frame, pointing up. The angles are those of A(25)-(26)
    with two corrections: the right components of the normal, and atan2 in place of arccos, which loses the sign.
    Ground that rises ahead has delta_alpha > 0; ground that falls to the right has delta_beta > 0.
    """
    n = check_shape("normal", normal, (3,))
    delta_alpha = np.arctan2(-n @ robot.forward, n[2])
    delta_beta = np.arctan2(n @ robot.right, n[2])
    return float(delta_alpha), float(delta_beta)
