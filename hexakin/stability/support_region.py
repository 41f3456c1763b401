"""Support region: where the centre of mass may be so that frictional contacts hold the robot (Bretl and Lall 2008).

T. Bretl and S. Lall, "Testing static equilibrium for legged robots", IEEE Trans. Robotics 24(4), 2008: at rest the
contact forces f_i in their friction cones balance the weight m g. Only the horizontal position c of the centre of mass
enters the balance, not its height. All such c form a convex set, the support region. The furthest point of the region
along a given direction is the solution of a linear program. The polygon of the points found lies inside the region. The
lines through these points, at right angles to the given directions, enclose the region.

Each friction cone is replaced by the inscribed pyramid of ``facets`` edges, one of which points uphill. The pyramid
lies inside the cone, so that every position found is held by forces within Coulomb's law. The pyramid contains the cone
of the friction coefficient mu cos(pi / facets), which is 0.98 mu with 16 facets. Because one edge points uphill, the
pyramid contains the vertical force on every slope up to the friction angle.

With ``torque_limits`` the torque inequalities of the contacts apply too. These inequalities belong to one pose of the
legs. For other positions of the centre of mass they hold only while the Jacobians and the weights of the legs stay the
same (R. Orsolino et al., "Feasible region: an actuation-aware extension of the support region", IEEE Trans. Robotics
36(4), 2020).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.sparse import block_diag, coo_array

from hexakin.checks import Array, check_array, check_number, check_shape, check_whole, checked, read_only
from hexakin.exceptions import InvalidInputError, SolverError
from hexakin.numerics.display import short_repr
from hexakin.robot.model import GRAVITY
from hexakin.stability.friction_pyramid import contact_frames, pyramid_edges
from hexakin.stability.polygon import margin, support_polygon
from hexakin.stability.stance import Contacts

FACETS = 16
"""Number of edges of the pyramid in each friction cone; 16 edges reduce the friction coefficient by at most 2 %.

For random uneven contacts as wide as a standing ATHENA, the region's edge then lies 0.1 mm too far inside on average
and 5 mm at most, compared with 192 facets. The error is inversely proportional to the square of the number of edges.
"""

REACH = 10.0
"""Distance [m] from the mean of the contacts up to which the region is computed: over twenty times ATHENA's width."""

_FEASIBILITY = 1e-10  # the smallest tolerance that HiGHS accepts
_BALANCE = 1e-9  # [weights] largest residual of a balance that is due to rounding errors
_ROUNDS = 60  # each round at least halves the largest height of ``_open_edges``; a few are enough


class Support(NamedTuple):
    """Furthest positions of the centre of mass along given directions, as ``support`` returns them.

    ``point`` (..., 2) [m] are the positions, and ``distance`` (...) [m] their distances along the directions from the
    world's origin. ``defined`` (...) bool is False where the region is empty; there ``distance`` is -inf and ``point``
    NaN.
    """

    distance: Array
    point: Array
    defined: NDArray[np.bool_]

    def __repr__(self) -> str:
        return short_repr(self)


@checked
@dataclass(frozen=True, eq=False)
class SupportRegion:
    """Positions of the centre of mass, seen from above, that contact forces can hold at rest.

    Parameters
    ----------
    vertices
        Vertices (m, 2) [m], counter-clockwise, of a polygon inside the region. The distance between the edges of the
        polygon and of the region is at most the tolerance. A segment has two vertices, a point one, and an empty region
        none.
    cut
        True if the region extends beyond ``reach``, where the polygon ends. For example, the region is unbounded if the
        feet can press outwards against two opposite walls.
    """

    vertices: Array
    cut: bool

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", read_only(check_shape("vertices", self.vertices, (None, 2))))

    @property
    def empty(self) -> bool:
        """Whether no position of the centre of mass can be held."""
        return len(self.vertices) == 0

    def region_margin_at(self, point: ArrayLike) -> float:
        """Signed distance [m] of ``point`` (2,) [m] to the region's edge, negative outside.

        A segment or a single point has no inside: the margin is 0 on it and negative elsewhere. If the region is empty,
        the margin is -inf. If the region is cut, the distance to the cut counts as well, so that the true margin may be
        larger. Raises InvalidInputError for another shape or a value that is not finite.
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

    def margin(self, point: ArrayLike) -> float:
        """Old name of ``region_margin_at``: the margin [m] of ``point`` (2,) [m], with a DeprecationWarning."""
        warnings.warn("SupportRegion.margin is now called region_margin_at", DeprecationWarning, stacklevel=2)
        return self.region_margin_at(point)


@checked
def support_region(
    contacts: Contacts,
    *,
    torque_limits: bool = False,
    facets: int = FACETS,
    tolerance: float = 1e-6,
    reach: float = REACH,
) -> SupportRegion:
    """Support region of contacts: positions of the centre of mass, seen from above, that the contacts can hold at rest.

    Raises InvalidInputError for ``torque_limits`` without torque limits in ``contacts`` and for a value out of its
    range. Raises SolverError if a linear program is not solved: the result is an empty region only if a solved linear
    program shows that no contact forces balance the weight.

    Parameters
    ----------
    contacts
        The contacts, with normals, friction and, where needed, torque limits.
    torque_limits
        Whether the torque limits of ``contacts`` apply.
    facets
        Number of edges of the pyramid in each friction cone.
    tolerance
        Largest distance [m] between the edges of the polygon and of the region.
    reach
        Distance [m] from the mean of the contacts, along x and along y, up to which the region is computed.
    """
    check_number("tolerance", tolerance, at_least=1e-8, unit="m")
    balance = _balance(contacts, torque_limits, facets, reach)
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


@checked
def region_margin(
    contacts: Contacts,
    *,
    torque_limits: bool = False,
    facets: int = FACETS,
    tolerance: float = 1e-6,
    reach: float = REACH,
) -> float:
    """Signed distance [m] of the centre of mass of ``contacts``, seen from above, to the edge of their support region.

    ``torque_limits``, ``facets``, ``tolerance`` [m] and ``reach`` [m] as well as the errors are those of
    ``support_region``. For regions that are not polygons see ``SupportRegion.region_margin_at``.
    """
    region = support_region(contacts, torque_limits=torque_limits, facets=facets, tolerance=tolerance, reach=reach)
    return region.region_margin_at(contacts.center_of_mass[:2])


@checked
def support(
    contacts: Contacts,
    direction: ArrayLike,
    *,
    torque_limits: bool = False,
    facets: int = FACETS,
    reach: float = REACH,
) -> Support:
    """Furthest points of the support region of ``contacts`` along each ``direction``.

    ``direction`` (..., 2) are vectors in the horizontal plane, in any unit; only their directions matter. The options
    ``torque_limits``, ``facets`` and ``reach`` [m] are those of ``support_region``. All directions are solved as one
    linear program. Raises InvalidInputError for a direction of length 0; the other errors are those of
    ``support_region``.
    """
    way = check_array("direction", direction, (2,), ("coordinate",))
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    if (length == 0.0).any():
        raise InvalidInputError("direction: its length is 0, expected more")
    unit = way / length
    balance = _balance(contacts, torque_limits, facets, reach)
    if balance is None:
        shape = unit.shape[:-1]
        return Support(np.full(shape, -np.inf), np.full(unit.shape, np.nan), np.zeros(shape, dtype=bool))
    point = balance.furthest(unit.reshape(-1, 2)).reshape(unit.shape)
    return Support((unit * point).sum(axis=-1), point, np.ones(unit.shape[:-1], dtype=bool))


@dataclass(frozen=True, eq=False)
class _Balance:
    """Conditions of rest as a linear program: equal @ x = right, upper @ x <= limit, and bounds on x.

    x holds the position (2) of the centre of mass and then one force along each pyramid edge. The position is measured
    from ``center`` (2,) [m] in units of ``length`` [m], and forces in weights, so that all rows are of order 1.
    """

    equal: Array
    right: Array
    upper: Array
    limit: Array
    bound: Array
    center: Array
    length: float

    def furthest(self, across: Array) -> Array:
        """Furthest positions (d, 2) [m] along directions (d, 2): separate problems, solved as one to save overhead."""
        count, width = len(across), self.equal.shape[1]
        cost = np.zeros((count, width))
        cost[:, :2] = -across
        x = _solved(
            cost.ravel(),
            equal=(block_diag([coo_array(self.equal)] * count, format="csc"), np.tile(self.right, count)),
            upper=(block_diag([coo_array(self.upper)] * count, format="csc"), np.tile(self.limit, count)),
            bound=np.tile(self.bound, (count, 1)),
        )
        return self.center + self.length * x.reshape(count, width)[:, :2]


def _balance(contacts: Contacts, torque_limits: bool, facets: int, reach: float) -> _Balance | None:
    """Conditions of rest, relaxed by the rounding errors of one solution; None if no contact forces satisfy them."""
    check_whole("facets", facets, at_least=3)
    check_number("reach", reach, above=0.0, unit="m")
    if torque_limits and contacts.torque_rows is None:
        raise InvalidInputError("torque_limits: the contacts have none; expected torque_rows and torque_bounds")
    k = contacts.num_contacts
    if k == 0:
        return None
    mean = contacts.points.mean(axis=0)
    arm = contacts.points - mean
    length = float(np.linalg.norm(arm, axis=1).max()) or 1.0
    # Forces along the pyramid edges, in the world frame, (k, facets, 3).
    force = pyramid_edges(contacts.friction, facets) @ np.swapaxes(contact_frames(contacts.normals), -1, -2)
    moment = np.cross(arm[:, None] / length, force)
    width = 2 + k * facets
    equal, right = np.zeros((6, width)), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    equal[:3, 2:], equal[3:, 2:] = force.reshape(-1, 3).T, moment.reshape(-1, 3).T
    # The weight's moment about the mean: c x (0, 0, -1) = (-c_y, c_x, 0).
    equal[3, 1], equal[4, 0] = -1.0, 1.0
    upper, limit = np.zeros((0, width)), np.zeros(0)
    if torque_limits and contacts.torque_rows is not None and contacts.torque_bounds is not None:
        size = np.linalg.norm(contacts.torque_rows, axis=2)
        size = np.where(size > 0.0, size, 1.0)
        rows = np.einsum("imc,ifc->imf", contacts.torque_rows / size[..., None], force)
        upper = np.hstack(
            [np.zeros((rows[..., 0].size, 2)), block_diag([coo_array(block) for block in rows]).toarray()]
        )
        limit = (contacts.torque_bounds / size).ravel() / (contacts.mass * GRAVITY)
    bound = np.tile([0.0, np.inf], (width, 1))
    bound[:2] = np.array([-reach, reach]) / length
    # Minimise the residual of the balance: this problem always has a solution, whatever the contacts.
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
    """Solution of a linear program that is known to have one; if HiGHS fails, its other methods are tried."""
    accuracy = {"primal_feasibility_tolerance": _FEASIBILITY, "dual_feasibility_tolerance": _FEASIBILITY}
    for method, presolve in (("highs-ds", False), ("highs-ds", True), ("highs-ipm", True)):
        options = {**accuracy, "presolve": presolve}
        result = linprog(cost, *upper, *equal, bounds=bound, method=method, options=options)
        if result.status == 0:
            return result.x
    raise SolverError(f"support region: a linear program was not solved: {result.message} (status {result.status})")


def _open_edges(point: Array, across: Array) -> tuple[Array, Array]:
    """How far the region may extend beyond each edge of the polygon ``point`` (n, 2), found in directions ``across``.

    Returns the outward normals (n, 2) of the edges and the heights (n,) [m]. At each vertex the region lies behind the
    line at right angles to the vertex's direction. The edge and the lines of its two ends form a triangle; the height
    is that of this triangle over the edge.
    """
    way, following = np.roll(point, -1, axis=0) - point, np.roll(across, -1, axis=0)
    size = np.linalg.norm(way, axis=1)
    normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.where(size > 0.0, size, 1.0)[:, None]
    first, last, whole = _sine(across, normal), _sine(normal, following), _sine(across, following)
    wide = (first > 0.0) & (last > 0.0) & (whole > 0.0)
    return normal, np.where(wide, size * first * last / np.where(wide, whole, 1.0), 0.0)


def _sine(a: Array, b: Array) -> Array:
    """Sines (n,) of the angles from unit vectors ``a`` (n, 2) to ``b`` (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _vertices(point: Array, apart: float) -> Array:
    """Vertices of the hull of points (n, 2); points closer than ``apart`` [m] to each other count as one."""
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
