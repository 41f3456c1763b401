"""Where the centre of mass may be for frictional contacts to hold it, on any ground (Bretl and Lall 2008).

T. Bretl and S. Lall, "Testing static equilibrium for legged robots", IEEE Trans. Robotics 24(4), 2008: at rest the
contact forces f_i in their friction cones balance the weight m g, and only the horizontal place c of the centre of mass
enters the balance, never its height. All such c form a convex set. Along one direction its furthest place is a linear
program; the polygon of the places found lies inside the set, and the lines across the directions enclose it.

Each friction cone is replaced by the pyramid of ``facets`` edges on it, one edge of which points uphill as steeply as
it can. The pyramid lies inside the cone, so that every place found is held by forces within Coulomb's law; it contains
the cone of the friction coefficient mu cos(pi / facets): 0.98 mu with 16 facets. A vertical force is held exactly up to
the friction angle.

With ``torque_limits`` the stance's inequalities on each force are kept too. They belong to one pose of the legs, and
hold for other places of the centre of mass only as far as these leave Jacobians and weights of the legs as they are
(R. Orsolino et al., "Feasible region: an actuation-aware extension of the support region", IEEE Trans. Robotics 36(4),
2020).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.sparse import block_diag

from hexakin.checks import Array, check_array, check_number, check_whole, read_only
from hexakin.exceptions import InvalidInputError, SolverError
from hexakin.robot.model import GRAVITY
from hexakin.stability.friction_pyramid import contact_frames, pyramid_edges
from hexakin.stability.polygon import margin, support_polygon
from hexakin.stability.stance import Contacts

FACETS = 16
"""Edges of the pyramid in each friction cone: at worst 2 % of the friction coefficient are given away.

On random uneven contacts of a standing ATHENA's width the region's edge then lies 0.1 mm too far inside on average and
5 mm at the most, compared with 192 facets; the error falls with the square of their number.
"""

REACH = 10.0
"""How far [m] from the contacts' mean places are looked for: twenty times the width of a standing ATHENA."""

_FEASIBILITY = 1e-10  # the least that HiGHS accepts
_BALANCE = 1e-9  # [weights] what may be missing from the balance: a force in or out of a cone's edge by rounding
_ROUNDS = 60  # each halves what is open at the least; few are ever needed


class Support(NamedTuple):
    """Furthest places of the centre of mass: ``point`` (..., 2) [m], at ``distance`` (...) [m] along the directions.

    The distance counts from the world's origin; -inf, and NaN for the point, where not ``defined`` (...), that is where
    there is no place at all.
    """

    distance: Array
    point: Array
    defined: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SupportRegion:
    """Places of the centre of mass, seen from above, that contact forces can hold at rest.

    ``vertices`` (m, 2) [m], counter-clockwise, of a polygon inside the region and nowhere further than the tolerance
    from its edge; two of a segment, one of a point, none if ``empty``. ``cut``: the region goes on further than was
    looked, as it does without end between walls that the feet can press apart, and the polygon ends there.
    """

    vertices: Array
    cut: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", read_only(self.vertices))

    @property
    def empty(self) -> bool:
        """Whether there is no place at all."""
        return len(self.vertices) == 0

    def margin(self, point: ArrayLike) -> float:
        """Signed distance [m] of ``point`` (2,) to the region's edge, negative outside.

        A segment or a point has no inside: 0 on it, negative off it. -inf if the region is empty. Where the region is
        cut, the distance to the cut counts as well, so that there may be more room than this.
        """
        p = check_array("point", point, (2,), ("coordinate",))
        if p.shape != (2,):
            raise InvalidInputError(f"point: expected shape (2,), got {p.shape}")
        if len(self.vertices) > 2:
            return margin(p, self.vertices)
        if self.empty:
            return float("-inf")
        start, way = self.vertices[0], self.vertices[-1] - self.vertices[0]
        share = np.clip((p - start) @ way / (way @ way), 0.0, 1.0) if way.any() else 0.0
        return 0.0 - float(np.linalg.norm(p - start - share * way))


def support_region(
    stance: Contacts,
    *,
    torque_limits: bool = False,
    facets: int = FACETS,
    tolerance: float = 1e-6,
    reach: float = REACH,
) -> SupportRegion:
    """The support region of a stance within ``reach`` [m] of the contacts' mean, to ``tolerance`` [m].

    Raises InvalidInputError for torque limits that the stance does not have or a value out of its range, SolverError
    if a linear program is not solved: the region is called empty only on the solution of one, which shows how much
    of the balance stays missing.
    """
    check_number("tolerance", tolerance, at_least=1e-8, unit="m")
    balance = _balance(stance, torque_limits, facets, reach)
    if balance is None:
        return SupportRegion(np.empty((0, 2)), False)
    angle = np.arange(8) * np.pi / 4.0
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    point = balance.furthest(across)
    for _ in range(_ROUNDS):
        normal, height = _open_edges(point, across)
        edge = np.flatnonzero(height > 0.9 * tolerance)
        if len(edge) == 0:
            break
        new = balance.furthest(normal[edge])
        point, across = np.insert(point, edge + 1, new, axis=0), np.insert(across, edge + 1, normal[edge], axis=0)
    else:
        raise SolverError(f"support region not closed to {tolerance:g} m in {_ROUNDS} rounds")
    cut = bool((np.abs(point - balance.center) >= reach - tolerance).any())
    return SupportRegion(_vertices(point, 0.1 * tolerance), cut)


def region_margin(
    stance: Contacts,
    *,
    torque_limits: bool = False,
    facets: int = FACETS,
    tolerance: float = 1e-6,
    reach: float = REACH,
) -> float:
    """Signed distance [m] of the centre of mass, seen from above, to the edge of its support region.

    Options and errors as for ``support_region``; see ``SupportRegion.margin`` for regions that are no polygon.
    """
    region = support_region(stance, torque_limits=torque_limits, facets=facets, tolerance=tolerance, reach=reach)
    return region.margin(stance.center_of_mass[:2])


def support(
    stance: Contacts,
    direction: ArrayLike,
    *,
    torque_limits: bool = False,
    facets: int = FACETS,
    reach: float = REACH,
) -> Support:
    """The support region's furthest places along ``direction`` (..., 2), of any length but 0.

    Options and errors as for ``support_region``. All directions make one linear program.
    """
    way = check_array("direction", direction, (2,), ("coordinate",))
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    if (length == 0.0).any():
        raise InvalidInputError("direction: its length is 0, expected more")
    unit = way / length
    balance = _balance(stance, torque_limits, facets, reach)
    if balance is None:
        shape = unit.shape[:-1]
        return Support(np.full(shape, -np.inf), np.full(unit.shape, np.nan), np.zeros(shape, dtype=bool))
    point = balance.furthest(unit.reshape(-1, 2)).reshape(unit.shape)
    return Support((unit * point).sum(axis=-1), point, np.ones(unit.shape[:-1], dtype=bool))


@dataclass(frozen=True, eq=False)
class _Balance:
    """Equal @ x = right, upper @ x <= limit, and bounds, for x: the place (2), then a force along each pyramid edge.

    Places count from ``center`` (2,) [m] in units of ``length`` [m], forces in weights: all rows are of order 1.
    """

    equal: Array
    right: Array
    upper: Array
    limit: Array
    bound: Array
    center: Array
    length: float

    def furthest(self, across: Array) -> Array:
        """Furthest places (d, 2) [m] in directions (d, 2): separate problems, solved as one to save overhead."""
        count, width = len(across), self.equal.shape[1]
        cost = np.zeros((count, width))
        cost[:, :2] = -across
        x = _solved(
            cost.ravel(),
            equal=(block_diag([self.equal] * count, format="csc"), np.tile(self.right, count)),
            upper=(block_diag([self.upper] * count, format="csc"), np.tile(self.limit, count)),
            bound=np.tile(self.bound, (count, 1)),
        )
        return self.center + self.length * x.reshape(count, width)[:, :2]


def _balance(stance: Contacts, torque_limits: bool, facets: int, reach: float) -> _Balance | None:
    """The conditions of rest, with rounding taken out of the way; None if they contradict each other."""
    check_whole("facets", facets, at_least=3)
    check_number("reach", reach, above=0.0, unit="m")
    if torque_limits and stance.torque_rows is None:
        raise InvalidInputError("torque_limits: the stance has none; expected torque_rows and torque_bounds")
    k = stance.num_contacts
    if k == 0:
        return None
    mean = stance.points.mean(axis=0)
    arm = stance.points - mean
    length = float(np.linalg.norm(arm, axis=1).max()) or 1.0
    # In the world's axes, (k, facets, 3).
    force = pyramid_edges(stance.friction, facets) @ np.swapaxes(contact_frames(stance.normals), -1, -2)
    moment = np.cross(arm[:, None] / length, force)
    width = 2 + k * facets
    equal, right = np.zeros((6, width)), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    equal[:3, 2:], equal[3:, 2:] = force.reshape(-1, 3).T, moment.reshape(-1, 3).T
    # The weight's moment about the mean: c x (0, 0, -1) = (-c_y, c_x, 0).
    equal[3, 1], equal[4, 0] = -1.0, 1.0
    upper, limit = np.zeros((0, width)), np.zeros(0)
    if torque_limits and stance.torque_rows is not None and stance.torque_bounds is not None:
        size = np.linalg.norm(stance.torque_rows, axis=2)
        size = np.where(size > 0.0, size, 1.0)
        rows = np.einsum("imc,ifc->imf", stance.torque_rows / size[..., None], force)
        upper = np.hstack([np.zeros((rows[..., 0].size, 2)), block_diag(list(rows)).toarray()])
        limit = (stance.torque_bounds / size).ravel() / (stance.mass * GRAVITY)
    bound = np.tile([0.0, np.inf], (width, 1))
    bound[:2] = np.array([-reach, reach]) / length
    # The least that is missing from the balance has always a solution, whatever the contacts.
    n, m = len(equal), len(upper)
    x = _solved(
        np.r_[np.zeros(width), np.ones(2 * n + m)],
        equal=(np.hstack([equal, np.eye(n), -np.eye(n), np.zeros((n, m))]), right),
        upper=(np.hstack([upper, np.zeros((m, 2 * n)), -np.eye(m)]), limit),
        bound=np.vstack([bound, np.tile([0.0, np.inf], (2 * n + m, 1))]),
    )
    if x[width:].sum() > _BALANCE:
        return None
    held = x[:width]
    return _Balance(equal, equal @ held, upper, np.maximum(limit, upper @ held), bound, mean[:2], length)


def _solved(cost: Array, equal: tuple, upper: tuple, bound: Array) -> Array:
    """The solution of a linear program known to have one; HiGHS is asked again, in other ways, if it gives up."""
    accuracy = {"primal_feasibility_tolerance": _FEASIBILITY, "dual_feasibility_tolerance": _FEASIBILITY}
    for method, presolve in (("highs-ds", False), ("highs-ds", True), ("highs-ipm", True)):
        options = {**accuracy, "presolve": presolve}
        result = linprog(cost, *upper, *equal, bounds=bound, method=method, options=options)
        if result.status == 0:
            return result.x
    raise SolverError(f"support region: a linear program was not solved: {result.message} (status {result.status})")


def _open_edges(point: Array, across: Array) -> tuple[Array, Array]:
    """How far the region may yet reach over each edge of the polygon ``point`` (n, 2) found in directions ``across``.

    Returns the edges' outward normals (n, 2) and heights (n,) [m]: at each end the region stays behind the line across
    its direction, and the height is that of the triangle between these lines and the edge.
    """
    way, following = np.roll(point, -1, axis=0) - point, np.roll(across, -1, axis=0)
    size = np.linalg.norm(way, axis=1)
    normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.where(size > 0.0, size, 1.0)[:, None]
    first, last, whole = _sine(across, normal), _sine(normal, following), _sine(across, following)
    wide = (first > 0.0) & (last > 0.0) & (whole > 0.0)
    return normal, np.where(wide, size * first * last / np.where(wide, whole, 1.0), 0.0)


def _sine(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _vertices(point: Array, apart: float) -> Array:
    """Corners of the hull of points (n, 2), those closer than ``apart`` [m] to another taken as one."""
    kept: list[Array] = []
    for p in point:
        if all(np.linalg.norm(p - other) > apart for other in kept):
            kept.append(p)
    corners = np.array(kept)
    polygon = support_polygon(corners)
    if polygon is not None:
        return polygon
    gap = np.linalg.norm(corners[:, None] - corners, axis=-1)
    ends = np.unravel_index(gap.argmax(), gap.shape)
    return corners[np.unique(ends)]
