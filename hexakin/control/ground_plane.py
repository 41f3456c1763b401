"""Paper A's perception of the ground: which feet carry (A Fig. 6) and the plane through three of them (A(24)-(26))."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array
from hexakin.robot.model import Robot

MIN_SLENDERNESS = 0.2
"""Smallest altitude of a usable triple over its longest side.

Assumed: an equilateral triangle has 0.87; the three feet of one side of ATHENA, whose plane says
nothing about roll, have 0.16; every other triple of its standing feet has at least 0.35.
"""


class GroundPlane(NamedTuple):
    """A plane through three feet, in the body frame.

    ``legs`` (3,) indices, unit ``normal`` (3,) pointing up, ``offset`` [m] with normal @ p = offset on
    the plane, ``misfit`` [m] the largest distance of another supporting foot from it (NaN without one).
    """

    legs: tuple[int, ...]
    normal: Array
    offset: float
    misfit: float


def supporting_feet(foot_force: ArrayLike, threshold: float = 0.0) -> NDArray[np.bool_]:
    """Feet whose normal force (..., L) [N] is above ``threshold`` (A Fig. 6: above zero)."""
    return np.asarray(foot_force, dtype=float) > threshold


def slenderness(p: ArrayLike) -> float:
    """Smallest altitude of a triangle (3, 3) over its longest side: 0 if collinear, 0.87 if equilateral."""
    corners = np.asarray(p, dtype=float)
    longest = max(float(np.linalg.norm(corners[i] - corners[j])) for i, j in ((0, 1), (1, 2), (2, 0)))
    twice_area = float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])))
    return twice_area / longest**2 if longest > 0.0 else 0.0


def usable_triples(p_body_foot: ArrayLike, support: ArrayLike) -> list[tuple[int, ...]]:
    """Triples of supporting legs whose feet are far enough from a line to define a plane."""
    feet = np.asarray(p_body_foot, dtype=float)
    legs = [int(leg) for leg in np.flatnonzero(support)]
    return [triple for triple in combinations(legs, 3) if slenderness(feet[list(triple)]) >= MIN_SLENDERNESS]


def ground_plane(p_body_foot: ArrayLike, support: ArrayLike, rng: np.random.Generator) -> GroundPlane | None:
    """Plane through a random usable triple of the supporting feet (A(24)), or None if there is none.

    ``p_body_foot`` (L, 3) [m], ``support`` (L,) bool. With exactly three supporting feet these are used.
    """
    feet = np.asarray(p_body_foot, dtype=float)
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
    """Pitch and roll (delta_alpha, delta_beta) [rad] of the ground relative to the torso, signed.

    ``normal`` (3,) is the ground's in the body frame, pointing up. A(25)-(26) with the components in
    the right places and with atan2 instead of arccos, which loses the sign. Ground that rises ahead
    has delta_alpha > 0; ground that falls to the right has delta_beta > 0.
    """
    n = np.asarray(normal, dtype=float)
    delta_alpha = np.arctan2(-n @ robot.forward, n[2])
    delta_beta = np.arctan2(n @ robot.right, n[2])
    return float(delta_alpha), float(delta_beta)
