"""Zero-moment point and stability margins of recordings and plans over time (A(32)-(33))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_arrays, checked
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.numerics.display import short_repr
from hexakin.stability.polygon import centroid_distance_and_margin, margins_in, support_polygon


class ZMP(NamedTuple):
    """Zero-moment point A(32): ``xy`` (..., 2) [m], NaN where ``defined`` (...) bool is False: no foot is loaded."""

    xy: Array
    defined: NDArray[np.bool_]

    def __repr__(self) -> str:
        return short_repr(self)


def zero_moment_point(p_foot: ArrayLike, foot_force: ArrayLike) -> ZMP:
    """Zero-moment point A(32): the mean of the foot positions, weighted by the normal forces.

    ``p_foot`` (..., L, 2) or (..., L, 3) [m] are the positions of the feet, and ``foot_force`` (..., L) [N] their
    normal forces. The result is in the frame of ``p_foot``. As a convex combination it cannot leave the hull of the
    loaded feet. It does not include forces on the torso, so that it is not valid while the torso touches the ground.
    Raises InvalidInputError for a wrong shape and for a negative force.
    """
    feet = check_array("p_foot", p_foot, (None, None), ("leg", "coordinate"))
    if feet.shape[-1] not in (2, 3):
        raise InvalidInputError(f"p_foot: expected shape (..., L, 2) or (..., L, 3), got {feet.shape}")
    legs, feet = feet.shape[-2], feet[..., :2]
    force = check_array("foot_force", foot_force, (legs,), ("leg",))
    check_arrays(("p_foot", feet, (legs, 2)), ("foot_force", force, (legs,)))
    force = np.broadcast_to(force, np.broadcast_shapes(force.shape, feet.shape[:-1]))
    if (force < 0.0).any():
        raise InvalidInputError(f"foot_force: {force.min():g} N, expected at least 0")
    total = force.sum(axis=-1)
    defined = total > 0.0
    # A(32)
    moment = np.einsum("...l,...lk->...k", force, feet)
    xy = np.divide(moment, total[..., None], out=np.full(moment.shape, np.nan), where=defined[..., None])
    return ZMP(xy, defined)


@checked
def zmp(recording: Recording) -> ZMP:
    """Zero-moment point A(32), (n, 2) [m], of every tick of a ``recording``, in the body frame (ATHENA's x: right)."""
    return zero_moment_point(recording.p_body_foot, recording.foot_force)


@checked
def static_margin(plan: WalkPlan) -> Array:
    """Signed distance (n,) [m] of the body's origin to the edge of the support polygon of a ``plan``, seen from above.

    It is meant for slow walks, in which the feet must hold the body at rest at every instant. The origin takes the
    place of the centre of mass, and the distance is computed as A(33). At a phase change the feet before it and the
    feet after it must both hold the body, so that the smaller margin counts. NaN where fewer than three feet carry
    load, or where all of them are on one line.
    """
    origin, result = plan.T_world_body[:, :2, 3], np.full(len(plan.time), np.inf)
    held = plan.stance[1:] & plan.stance[:-1]  # the feet in stance from one sample to the next
    feet = np.where(held[..., None], plan.p_world_foot[1:, :, :2], np.inf)
    starts = np.flatnonzero(np.r_[True, (feet[1:] != feet[:-1]).any(axis=(1, 2))])
    for start, end in zip(starts, np.r_[starts[1:], len(feet)], strict=True):
        polygon = support_polygon(plan.p_world_foot[start + 1, held[start]])
        span = slice(start, end + 1)
        margins = np.full(end + 1 - start, np.nan) if polygon is None else margins_in(origin[span], polygon)
        result[span] = np.minimum(result[span], margins)  # NaN if one of the two is NaN
    return result


@dataclass(frozen=True)
class StabilitySeries:
    """Stability at every tick of a recording (A Figs 18-19), as ``series`` returns it.

    Parameters
    ----------
    centroid_distance
        Distance (n,) [m] from the zero-moment point to the centroid of the support polygon; NaN where not ``defined``.
    margin
        Stability margin A(33), (n,) [m]; NaN where not ``defined``.
    defined
        False where no foot is loaded, or where fewer than three feet or feet on one line span no polygon; (n,) bool.
    body_touches
        True where the torso or a limb touches the ground, (n,) bool. There A(32) lacks a force; leave these ticks out
        of statistics.
    """

    centroid_distance: Array
    margin: Array
    defined: NDArray[np.bool_]
    body_touches: NDArray[np.bool_]

    __repr__ = short_repr


@checked
def series(recording: Recording, feet: Literal["loaded", "stance"] = "loaded") -> StabilitySeries:
    """Distance from the zero-moment point to the polygon's centroid and stability margin at every tick (A Figs 18-19).

    ``recording`` is a recorded walk with n ticks. ``feet`` selects the feet that span the polygon. The zero-moment
    point of A(32) cannot leave the polygon of the ``"loaded"`` feet; it can leave that of the feet that are commanded
    to be in ``"stance"``. Raises UnknownNameError for another value of ``feet``.
    """
    if feet not in ("loaded", "stance"):
        raise UnknownNameError("feet", feet, ["loaded", "stance"])
    point = zmp(recording)
    if feet == "loaded":
        carrying = recording.foot_force > 0.0
    else:
        # The forces in row k were measured while the command of row k - 1 was carried out.
        carrying = np.vstack([recording.stance[:1], recording.stance[:-1]])
    distance, edge = centroid_distance_and_margin(point.xy, recording.p_body_foot[..., :2], carrying)
    touches = (recording.torso_force > 0.0) | (recording.limb_force > 0.0)
    return StabilitySeries(distance, edge, np.isfinite(distance), touches)
