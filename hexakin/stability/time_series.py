"""Zero-moment point and stability margins of recordings and plans over time (A(32)-(33))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.stability.polygon import centroid_distance_and_margin, margins_in, support_polygon


class ZMP(NamedTuple):
    """Zero-moment point: ``xy`` (..., 2) [m], NaN where not ``defined`` (...), that is, where no foot carries."""

    xy: Array
    defined: NDArray[np.bool_]


def zero_moment_point(p_foot: ArrayLike, foot_force: ArrayLike) -> ZMP:
    """A(32): the mean of the feet weighted by their normal forces.

    ``p_foot`` (..., L, 2 or 3) [m], ``foot_force`` (..., L) [N], not negative; the result is in the frame of
    ``p_foot``. As a convex combination it cannot leave the hull of the loaded feet, and it leaves out any
    force on the torso, so that it means nothing while the torso drags.
    """
    feet = np.asarray(p_foot, dtype=float)
    if feet.ndim < 2 or feet.shape[-1] not in (2, 3):
        raise InvalidInputError(f"p_foot: expected shape (..., L, 2) or (..., L, 3), got {feet.shape}")
    feet = check_array("p_foot", feet, feet.shape[-2:], ("leg", "coordinate"))[..., :2]
    force = check_array("foot_force", foot_force, (feet.shape[-2],), ("leg",))
    force = np.broadcast_to(force, np.broadcast_shapes(force.shape, feet.shape[:-1]))
    if (force < 0.0).any():
        raise InvalidInputError(f"foot_force: {force.min():g} N, expected at least 0")
    total = force.sum(axis=-1)
    defined = total > 0.0
    # A(32)
    moment = np.einsum("...l,...lk->...k", force, feet)
    xy = np.divide(moment, total[..., None], out=np.full(moment.shape, np.nan), where=defined[..., None])
    return ZMP(xy, defined)


def zmp(recording: Recording) -> ZMP:
    """A(32) at every tick of a recording, (n, 2) [m] in the body frame (x to the right for ATHENA)."""
    return zero_moment_point(recording.p_body_foot, recording.foot_force)


def static_margin(plan: WalkPlan) -> Array:
    """Signed distance (n,) [m] of the body's origin, seen from above, to the edge of the carrying feet.

    For a slow walk, whose support must hold the body at every instant; the origin stands for the centre of mass.
    At a phase change the feet before it and the feet after it must both hold: the smaller margin counts.
    NaN where fewer than three feet carry, or feet in line.
    """
    origin, result = plan.T_world_body[:, :2, 3], np.full(len(plan.time), np.inf)
    held = plan.stance[1:] & plan.stance[:-1]  # the feet that carry from one sample to the next
    feet = np.where(held[..., None], plan.p_world_foot[1:, :, :2], np.inf)
    starts = np.flatnonzero(np.r_[True, (feet[1:] != feet[:-1]).any(axis=(1, 2))])
    for start, end in zip(starts, np.r_[starts[1:], len(feet)], strict=True):
        polygon = support_polygon(plan.p_world_foot[start + 1, held[start]])
        span = slice(start, end + 1)
        margins = np.full(end + 1 - start, np.nan) if polygon is None else margins_in(origin[span], polygon)
        result[span] = np.minimum(result[span], margins)  # NaN wins
    return result


@dataclass(frozen=True)
class StabilitySeries:
    """Stability at every tick of a recording, (n,) each.

    ``centroid_distance`` and ``margin`` [m] are NaN where not ``defined``: fewer than three feet or feet in
    line, or no foot loaded. ``body_touches`` marks ticks in which the torso or a limb carries too, where A(32)
    leaves out a force; leave these out of statistics.
    """

    centroid_distance: Array
    margin: Array
    defined: NDArray[np.bool_]
    body_touches: NDArray[np.bool_]


def series(recording: Recording, feet: Literal["loaded", "stance"] = "loaded") -> StabilitySeries:
    """Distance from the ZMP to the support polygon's centroid and stability margin (A Figs 18-19).

    The polygon is of the ``"loaded"`` feet, which the ZMP of A(32) cannot leave, or of the feet that are
    commanded to be in ``"stance"``, which it can.
    """
    if feet not in ("loaded", "stance"):
        raise UnknownNameError("feet", feet, ["loaded", "stance"])
    point = zmp(recording)
    if feet == "loaded":
        carrying = recording.foot_force > 0.0
    else:
        # The forces of row k were measured under the command of row k - 1.
        carrying = np.vstack([recording.stance[:1], recording.stance[:-1]])
    distance, edge = centroid_distance_and_margin(point.xy, recording.p_body_foot[..., :2], carrying)
    touches = (recording.torso_force > 0.0) | (recording.limb_force > 0.0)
    return StabilitySeries(distance, edge, np.isfinite(distance), touches)
