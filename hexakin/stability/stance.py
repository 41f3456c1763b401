"""What of a robot touches the ground where, and stability measures that hold on any contacts.

Every measure takes ``Contacts`` and says where it is undefined. The set of places where friction can hold the centre of
mass is in ``hexakin.support_region``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_number, read_only
from hexakin.exceptions import InvalidInputError, renamed
from hexakin.kinematics.forward import contact_jacobian, forward_kinematics, jacobian, joint_axes
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import Robot, check_robot
from hexakin.stability.polygon import margin, support_polygon
from hexakin.terrain.base import Terrain
from hexakin.transforms import cross_matrix, transform_points

_UNIT = 1e-6  # how far from 1 the length of a unit normal may be


@dataclass(frozen=True, eq=False)
class Contacts:
    """The k contacts of a robot with the ground, and its weight; any k from 0, in the world with z up.

    ``points`` (k, 3) [m]; ``normals`` (k, 3), unit, out of the ground; ``friction`` (k,), or one number for all;
    ``center_of_mass`` (3,) [m] of the whole robot; ``mass`` [kg]. With ``torque_rows`` (k, m, 3) [m] and
    ``torque_bounds`` (k, m) [N m] the joints bear the force f_i of the ground on foot i if
    ``torque_rows[i] @ f_i <= torque_bounds[i]``. Raises InvalidInputError naming the field and the value.
    """

    points: Array
    normals: Array
    friction: Array
    center_of_mass: Array
    mass: float
    torque_rows: Array | None = None
    torque_bounds: Array | None = None

    def __post_init__(self) -> None:
        points = check_array("Contacts: points", self.points, (3,), ("coordinate",))
        if points.ndim != 2:
            raise InvalidInputError(f"Contacts: points: expected shape (k, 3), got {points.shape}")
        k = len(points)
        normals = _exactly("Contacts: normals", self.normals, (k, 3), ("contact", "coordinate"))
        length = np.linalg.norm(normals, axis=1)
        for i in np.flatnonzero(np.abs(length - 1.0) > _UNIT)[:1]:
            raise InvalidInputError(f"Contacts: normals: contact {i + 1} has length {length[i]:g}, expected 1")
        friction = _one_or_each("Contacts: friction", self.friction, k, "contact")
        for i in np.flatnonzero(friction < 0.0)[:1]:
            raise InvalidInputError(f"Contacts: friction: contact {i + 1} has {friction[i]:g}, expected at least 0")
        center = _exactly("Contacts: center_of_mass", self.center_of_mass, (3,), ("coordinate",))
        object.__setattr__(self, "mass", check_number("Contacts: mass", self.mass, above=0.0, unit="kg"))
        arrays = {"points": points, "normals": normals, "friction": friction, "center_of_mass": center}
        if (self.torque_rows is None) != (self.torque_bounds is None):
            raise InvalidInputError("Contacts: torque_rows, torque_bounds: expected both or neither")
        if self.torque_rows is not None and self.torque_bounds is not None:
            rows = check_array("Contacts: torque_rows", self.torque_rows, (3,), ("coordinate",))
            if rows.ndim != 3 or len(rows) != k:
                raise InvalidInputError(f"Contacts: torque_rows: expected shape ({k}, m, 3), got {rows.shape}")
            bounds = _exactly("Contacts: torque_bounds", self.torque_bounds, rows.shape[:2], ("contact", "row"))
            arrays |= {"torque_rows": rows, "torque_bounds": bounds}
        for name, array in arrays.items():
            object.__setattr__(self, name, read_only(array))

    @property
    def num_contacts(self) -> int:
        """Number of contacts k."""
        return len(self.points)


def stance_of(
    robot: Robot,
    T_world_body: ArrayLike,
    q: ArrayLike,
    carrying: ArrayLike,
    terrain: Terrain,
    *,
    friction: ArrayLike = 0.9,
    torque_limits: bool = False,
) -> Contacts:
    """The stance of a robot at rest in a pose, on the feet that are said to carry.

    ``T_world_body`` (4, 4), ``q`` (L, 3) [rad], ``carrying`` (L,) bool, ``friction`` one number (that of
    ``hexakin.simulate`` by default) or (L,). A foot is a sphere that touches where the ground's normal below its centre
    leads out of it; whether it does touch is not asked. With ``torque_limits`` the torques of the carrying legs'
    servos at rest, g_leg(q) - J^T f with the Jacobian J of the contact point, stay within ``robot.servo.max_torque``.
    Swing legs bear only themselves; their torques are not bounded. Raises InvalidInputError for a wrong shape or value.
    """
    from hexakin import dynamics

    check_robot(robot)
    legs = robot.num_legs
    T = _exactly("T_world_body", T_world_body, (4, 4))
    angles = _exactly("q", q, (legs, NUM_JOINTS), ("leg", "joint"))
    flags = np.asarray(carrying)
    if flags.dtype != bool or flags.shape != (legs,):
        raise InvalidInputError(f"carrying: expected {legs} booleans, got {flags.dtype} of shape {flags.shape}")
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


def polygon_margin(stance: Contacts) -> float:
    """Signed distance [m], seen from above, of the centre of mass to the edge of the support polygon; negative outside.

    NaN without a polygon, that is with fewer than three contacts or with contacts in line. What the ground's slope,
    friction and the servos allow is not asked; see ``hexakin.support_region``.
    """
    return margin(stance.center_of_mass[:2], support_polygon(stance.points))


def longitudinal_margin(stance: Contacts, heading: float) -> float:
    """The smaller distance [m] from the centre of mass to the polygon's front and rear edge along ``heading``.

    ``heading`` [rad] from the world's x axis; seen from above. Outside the polygon it is negative: the way to go, along
    the heading or against it, until the centre of mass is above the polygon; -inf if neither leads there. NaN without a
    polygon, as ``polygon_margin``. McGhee and Iswandhi, "Adaptive locomotion of a multilegged robot over rough
    terrain", IEEE Trans. Systems, Man, and Cybernetics 9(4), 1979.
    """
    angle = check_number("heading", heading, unit="rad")
    polygon = support_polygon(stance.points)
    if polygon is None:
        return float("nan")
    edge = np.roll(polygon, -1, axis=0) - polygon
    inward = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1)[:, None]
    depth = ((stance.center_of_mass[:2] - polygon) * inward).sum(axis=1)
    rate = inward @ [np.cos(angle), np.sin(angle)]
    along = np.abs(rate) <= 1e-12  # this edge is parallel to the heading
    if (depth[along] < 0.0).any():
        return float("-inf")
    front = (-depth / np.where(along, 1.0, rate))[rate < -1e-12].min()
    rear = (-depth / np.where(along, 1.0, rate))[rate > 1e-12].max()
    return float(min(front, -rear)) if rear <= front else float("-inf")


class EnergyMargin(NamedTuple):
    """``margin`` [m], the least of ``per_edge`` (m,) [m]; NaN and empty where there is no polygon.

    ``edges`` (m, 2) are the contacts (indices from 0) at the ends of each edge, counter-clockwise.
    """

    margin: float
    per_edge: Array
    edges: NDArray[np.int_]


def energy_margin(stance: Contacts) -> EnergyMargin:
    """The least height [m] by which the centre of mass must rise for the robot to tip over an edge of its support.

    The edges run in space between the contacts that are neighbours on the support polygon seen from above, level or
    not; of contacts one above the other the lowest is taken. The robot turns about the edge as one rigid body until its
    centre of mass stands in the vertical plane through the edge. Where it has passed that plane, the height that it has
    lost since then counts, negative. NaN without a polygon, as ``polygon_margin``. Weight times height is the energy of
    Messuri and Klein, "Automatic body regulation for maintaining stability of a legged vehicle during rough-terrain
    locomotion", IEEE J. Robotics and Automation 1(3), 1985; height alone is the normalised margin of Hirose, Tsukagoshi
    and Yoneda, "Normalized energy stability margin and its contour of walking vehicles on rough terrain", 1998.
    """
    polygon = support_polygon(stance.points)
    if polygon is None:
        return EnergyMargin(float("nan"), np.empty(0), np.empty((0, 2), dtype=int))
    above = (stance.points[None, :, :2] == polygon[:, None]).all(axis=2)
    corner = np.where(above, stance.points[:, 2], np.inf).argmin(axis=1)
    edges = np.stack([corner, np.roll(corner, -1)], axis=1)
    start, end = stance.points[edges[:, 0]], stance.points[edges[:, 1]]
    way = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    reach = stance.center_of_mass - start
    radius = reach - (reach * way).sum(axis=1)[:, None] * way  # from the edge, at a right angle
    up = [0.0, 0.0, 1.0] - way[:, 2:] * way
    # The circle about the edge has its highest point where the radius points along ``up``.
    rise = np.linalg.norm(radius, axis=1) * np.linalg.norm(up, axis=1) - (radius * up).sum(axis=1)
    inside = way[:, 0] * reach[:, 1] - way[:, 1] * reach[:, 0] >= 0.0
    per_edge = np.where(inside, rise, -rise)
    return EnergyMargin(float(per_edge.min()), per_edge, edges)


class PlaneZMP(NamedTuple):
    """Zero-moment point: ``point`` (..., 3) [m], NaN where not ``defined`` (...): nothing presses on the plane."""

    point: Array
    defined: NDArray[np.bool_]


def zmp_on_plane(
    points: ArrayLike, forces: ArrayLike, origin: ArrayLike, normal: ArrayLike, moments: ArrayLike | None = None
) -> PlaneZMP:
    """The point of a declared plane about which the moment of all contact forces is parallel to the plane's normal.

    ``points`` (..., k, 3) [m], ``forces`` (..., k, 3) [N] of the ground on the robot with their tangential parts, and
    ``moments`` (..., k, 3) [N m] of contacts that bear some; the plane passes through ``origin`` (..., 3) [m] with the
    unit ``normal`` (..., 3). Undefined where the total force along the normal is not positive. On a level plane and
    with vertical forces this is A(32). Sardain and Bessonnet, "Forces acting on a biped robot. Center of pressure -
    zero moment point", IEEE Trans. Systems, Man, and Cybernetics A 34(5), 2004.
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


def _exactly(name: str, value: ArrayLike, shape: tuple[int, ...], labels: tuple[str, ...] = ()) -> Array:
    """Check as ``check_array`` does, and that there are no leading axes."""
    array = check_array(name, value, shape, labels)
    if array.ndim != len(shape):
        raise InvalidInputError(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def _one_or_each(name: str, value: ArrayLike, count: int, label: str) -> Array:
    """Return the values (count,) that are given as one number for all or one by one."""
    return _exactly(name, np.full(count, value) if np.ndim(value) == 0 else value, (count,), (label,))


__getattr__ = renamed(__name__, {"Stance": ("Contacts", Contacts)})
