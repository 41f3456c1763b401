"""Contacts of a robot with the ground, and stability margins that are defined for any contacts.

Every function documents where its margin is undefined. The margins come from paper A and from the literature of 1979 to
2004 that their docstrings name. The positions of the centre of mass that friction can hold are in
``hexakin.support_region``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import (
    Array,
    check_angle,
    check_array,
    check_flags,
    check_number,
    check_poses,
    check_shape,
    checked,
    read_only,
)
from hexakin.exceptions import InvalidInputError, renamed
from hexakin.kinematics.forward import contact_jacobian, forward_kinematics, jacobian, joint_axes
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import Robot
from hexakin.stability.polygon import margin, support_polygon
from hexakin.terrain.base import Terrain
from hexakin.transforms import cross_matrix, transform_points

_UNIT = 1e-6  # how far from 1 the length of a unit normal may be


@checked
@dataclass(frozen=True, eq=False)
class Contacts:
    """The k contacts of a robot with the ground, with its centre of mass and its mass; k may be 0.

    All fields are in the world frame, whose z axis points up. Raises InvalidInputError that names the field and the
    value. Torque limits as linear inequalities on the contact force are those of R. Orsolino et al., "Feasible region:
    an actuation-aware extension of the support region", IEEE Trans. Robotics 36(4), 2020.

    Parameters
    ----------
    points
        Positions (k, 3) [m] of the contacts.
    normals
        Unit vectors (k, 3) that point out of the ground.
    friction
        Coefficients of friction (k,), or one number for all contacts.
    center_of_mass
        Centre of mass (3,) [m] of the whole robot.
    mass
        Mass [kg] of the whole robot.
    torque_rows, torque_bounds
        Torque limits of the joints, or None for both: (k, m, 3) [m] and (k, m) [N m]. The joints can bear the force f_i
        of the ground on foot i if ``torque_rows[i] @ f_i <= torque_bounds[i]``.
    """

    points: Array
    normals: Array
    friction: Array
    center_of_mass: Array
    mass: float
    torque_rows: Array | None = None
    torque_bounds: Array | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        points = check_array("Contacts: points", self.points, (3,), ("coordinate",))
        if points.ndim != 2:
            raise InvalidInputError(f"Contacts: points: expected shape (k, 3), got {points.shape}")
        k = len(points)
        normals = check_shape("Contacts: normals", self.normals, (k, 3), ("contact", "coordinate"))
        length = np.linalg.norm(normals, axis=1)
        for i in np.flatnonzero(np.abs(length - 1.0) > _UNIT)[:1]:
            raise InvalidInputError(f"Contacts: normals: contact {i + 1} has length {length[i]:g}, expected 1")
        friction = _one_or_each("Contacts: friction", self.friction, k, "contact")
        for i in np.flatnonzero(friction < 0.0)[:1]:
            raise InvalidInputError(f"Contacts: friction: contact {i + 1} has {friction[i]:g}, expected at least 0")
        center = check_shape("Contacts: center_of_mass", self.center_of_mass, (3,), ("coordinate",))
        object.__setattr__(self, "mass", check_number("Contacts: mass", self.mass, above=0.0, unit="kg"))
        arrays = {"points": points, "normals": normals, "friction": friction, "center_of_mass": center}
        if (self.torque_rows is None) != (self.torque_bounds is None):
            raise InvalidInputError("Contacts: torque_rows, torque_bounds: expected both or neither")
        if self.torque_rows is not None and self.torque_bounds is not None:
            rows = check_array("Contacts: torque_rows", self.torque_rows, (3,), ("coordinate",))
            if rows.ndim != 3 or len(rows) != k:
                raise InvalidInputError(f"Contacts: torque_rows: expected shape ({k}, m, 3), got {rows.shape}")
            bounds = check_shape("Contacts: torque_bounds", self.torque_bounds, rows.shape[:2], ("contact", "row"))
            arrays |= {"torque_rows": rows, "torque_bounds": bounds}
        for name, array in arrays.items():
            object.__setattr__(self, name, read_only(array))

    @property
    def num_contacts(self) -> int:
        """Number of contacts k."""
        return len(self.points)


@checked
def contacts_of(
    robot: Robot,
    T_world_body: ArrayLike,
    q: ArrayLike,
    carrying: ArrayLike,
    terrain: Terrain,
    *,
    friction: ArrayLike = 0.9,
    torque_limits: bool = False,
) -> Contacts:
    """Contacts of a robot at rest in a given pose, on the feet that are given as carrying load.

    The centre of a foot's sphere lies one foot radius from the contact, along the normal of the ground below the
    centre. Whether the foot touches the ground is not checked. Raises InvalidInputError for a wrong shape or value. The
    torque limits are those of Orsolino et al. 2020 (see ``Contacts``).

    Parameters
    ----------
    T_world_body
        Pose (4, 4) of the body in the world.
    q
        Joint angles (L, 3) [rad].
    carrying
        Which feet carry load, (L,) bool.
    terrain
        The ground; its normals are taken at the feet.
    friction
        Coefficient of friction: one number (by default that of ``hexakin.simulate``), or one per leg, (L,).
    torque_limits
        If True, the result limits the servo torques of the carrying legs at rest to ``robot.servo.max_torque``. These
        are g_leg(q) - J^T f with the Jacobian J of the contact point. Swing legs carry only their own weight; their
        torques are not limited.
    """
    from hexakin import dynamics

    legs = robot.num_legs
    T = check_poses("T_world_body", check_shape("T_world_body", T_world_body, (4, 4)))
    angles = check_shape("q", q, (legs, NUM_JOINTS), ("leg", "joint"))
    flags = check_flags("carrying", carrying, (legs,))
    each = _one_or_each("friction", friction, legs, "leg")
    feet = transform_points(T, forward_kinematics(robot, angles))
    normals = terrain.normal(feet[:, 0], feet[:, 1])
    lever = -robot.foot_radius * normals
    configuration = dynamics.configuration(robot, T, angles)
    rows = bounds = None
    if torque_limits:
        R = T[:3, :3]
        slide = contact_jacobian(R @ jacobian(robot, angles), R @ joint_axes(robot, angles), cross_matrix(lever))
        weight = dynamics.gravity(robot, configuration)[6:].reshape(legs, NUM_JOINTS)
        # |g - J^T f| <= max_torque
        rows = np.concatenate([-slide, slide], axis=2).swapaxes(1, 2)[flags]
        bounds = robot.servo.max_torque + np.concatenate([-weight, weight], axis=1)[flags]
    center = dynamics.center_of_mass(robot, configuration)
    return Contacts((feet + lever)[flags], normals[flags], each[flags], center, robot.mass, rows, bounds)


@checked
def polygon_margin(contacts: Contacts) -> float:
    """Signed distance [m] of the centre of mass to the edge of the support polygon, seen from above.

    This is A(33) with the centre of mass of ``contacts`` in place of the zero-moment point. It is negative outside the
    polygon, and NaN without a polygon: with fewer than three contacts or with all contacts on one line. The ground's
    slope, friction and the servos' torques are not taken into account; ``hexakin.support_region`` does that.
    """
    return margin(contacts.center_of_mass[:2], support_polygon(contacts.points))


@checked
def longitudinal_margin(contacts: Contacts, heading: float) -> float:
    """The smaller distance [m] from the centre of mass to the polygon's front and rear edge along ``heading``.

    ``heading`` [rad] is measured from the world's x axis; the margin of ``contacts`` is seen from above. Outside the
    polygon it is negative: its size is the distance along the heading, or against it, to the polygon. It is -inf if the
    line along the heading does not meet the polygon, and NaN without a polygon, as for ``polygon_margin``. McGhee and
    Iswandhi, "Adaptive locomotion of a multilegged robot over rough
    terrain", IEEE Trans. Systems, Man, and Cybernetics 9(4), 1979.
    """
    angle = check_angle("heading", heading)
    polygon = support_polygon(contacts.points)
    if polygon is None:
        return float("nan")
    edge = np.roll(polygon, -1, axis=0) - polygon
    inward = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1)[:, None]
    depth = ((contacts.center_of_mass[:2] - polygon) * inward).sum(axis=1)
    rate = inward @ [np.cos(angle), np.sin(angle)]
    along = np.abs(rate) <= 1e-12  # this edge is parallel to the heading
    if (depth[along] < 0.0).any():
        return float("-inf")
    front = (-depth / np.where(along, 1.0, rate))[rate < -1e-12].min()
    rear = (-depth / np.where(along, 1.0, rate))[rate > 1e-12].max()
    return float(min(front, -rear)) if rear <= front else float("-inf")


class EnergyMargin(NamedTuple):
    """Energy margin of contacts (Hirose, Tsukagoshi and Yoneda 1998), as ``energy_margin`` returns it.

    ``margin`` [m] is the smallest of ``per_edge`` (m,) [m], the margins of the edges. ``edges`` (m, 2) are the indices
    (from 0) of the contacts at the ends of each edge, counter-clockwise. Without a polygon ``margin`` is NaN and the
    arrays are empty.
    """

    margin: float
    per_edge: Array
    edges: NDArray[np.int_]

    def __repr__(self) -> str:
        return short_repr(self)


@checked
def energy_margin(contacts: Contacts) -> EnergyMargin:
    """The smallest height [m] by which the centre of mass must rise before the robot tips over an edge of its support.

    The edges connect ``contacts`` that are neighbours on the support polygon seen from above; an edge need not be
    level. Of contacts at the same horizontal position the lowest is used. The robot turns about the edge as one rigid
    body until its centre of mass is in the vertical plane through the edge. If the centre of mass is already beyond
    that plane, the margin is minus the height that it has lost since. NaN without a polygon, as for ``polygon_margin``.
    Weight times height is the energy of Messuri and Klein, "Automatic body regulation for maintaining stability of a
    legged vehicle during rough-terrain locomotion", IEEE J. Robotics and Automation 1(3), 1985; height alone is the
    normalised margin of Hirose, Tsukagoshi and Yoneda, "Normalized energy stability margin and its contour of walking
    vehicles on rough terrain", 1998.
    """
    polygon = support_polygon(contacts.points)
    if polygon is None:
        return EnergyMargin(float("nan"), np.empty(0), np.empty((0, 2), dtype=int))
    above = (contacts.points[None, :, :2] == polygon[:, None]).all(axis=2)
    corner = np.where(above, contacts.points[:, 2], np.inf).argmin(axis=1)
    edges = np.stack([corner, np.roll(corner, -1)], axis=1)
    start, end = contacts.points[edges[:, 0]], contacts.points[edges[:, 1]]
    way = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    reach = contacts.center_of_mass - start
    radius = reach - (reach * way).sum(axis=1)[:, None] * way  # perpendicular to the edge
    up = [0.0, 0.0, 1.0] - way[:, 2:] * way
    # The centre of mass moves on a circle about the edge. It is highest where the radius is parallel to ``up``.
    rise = np.linalg.norm(radius, axis=1) * np.linalg.norm(up, axis=1) - (radius * up).sum(axis=1)
    inside = way[:, 0] * reach[:, 1] - way[:, 1] * reach[:, 0] >= 0.0
    per_edge = np.where(inside, rise, -rise)
    return EnergyMargin(float(per_edge.min()), per_edge, edges)


class PlaneZMP(NamedTuple):
    """Zero-moment point on a plane (Sardain and Bessonnet 2004), as ``zmp_on_plane`` returns it.

    ``point`` (..., 3) [m] is NaN where ``defined`` (...) bool is False, that is, where no force presses on the plane.
    """

    point: Array
    defined: NDArray[np.bool_]

    def __repr__(self) -> str:
        return short_repr(self)


def zmp_on_plane(
    points: ArrayLike, forces: ArrayLike, origin: ArrayLike, normal: ArrayLike, moments: ArrayLike | None = None
) -> PlaneZMP:
    """Zero-moment point: the point of a plane about which the contacts' total moment is parallel to the plane's normal.

    It is undefined where the total force along the normal is not positive. On a level plane and with vertical forces
    it is A(32). Sardain and Bessonnet, "Forces acting on a biped robot. Center of pressure - zero moment point", IEEE
    Trans. Systems, Man, and Cybernetics A 34(5), 2004. Raises InvalidInputError for a wrong shape, a value that is not
    finite or a normal whose length is not 1.

    Parameters
    ----------
    points
        Contact points (..., k, 3) [m].
    forces
        Forces (..., k, 3) [N] of the ground on the robot, tangential parts included.
    origin
        A point (..., 3) [m] of the plane.
    normal
        Unit vector (..., 3) normal to the plane.
    moments
        Moments (..., k, 3) [N m] that the contacts transmit, or None if they transmit none.
    """
    where = check_array("points", points, (3,), ("coordinate",))
    if where.ndim < 2:
        raise InvalidInputError(f"points: expected shape (..., k, 3), got {where.shape}")
    force = check_array("forces", forces, where.shape[-2:], ("contact", "coordinate"))
    through, n = check_array("origin", origin, (3,)), check_array("normal", normal, (3,))
    length = np.linalg.norm(n, axis=-1)
    if (np.abs(length - 1.0) > _UNIT).any():
        raise InvalidInputError(f"normal: length {length.flat[np.abs(length - 1.0).argmax()]:g}, expected 1")
    moment = np.cross(where - through[..., None, :], force)
    if moments is not None:
        moment = moment + check_array("moments", moments, where.shape[-2:], ("contact", "coordinate"))
    total = (force.sum(axis=-2) * n).sum(axis=-1)
    arm = np.cross(n, moment.sum(axis=-2))
    total = np.broadcast_to(total, arm.shape[:-1])
    defined = total > 0.0
    shift = np.divide(arm, total[..., None], out=np.full(arm.shape, np.nan), where=defined[..., None])
    return PlaneZMP(through + shift, defined)


def _one_or_each(name: str, value: ArrayLike, count: int, label: str) -> Array:
    """Return values (count,) that were given as one number for all or as an array (count,)."""
    values = check_array(name, value, (), finite=False)
    return check_shape(name, np.full(count, values) if values.ndim == 0 else values, (count,), (label,))


if not TYPE_CHECKING:  # type checkers know the new names only
    __getattr__ = renamed(__name__, {"Stance": ("Contacts", Contacts), "stance_of": ("contacts_of", contacts_of)})
