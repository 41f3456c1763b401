"""Equations of a robot at rest on its feet: equilibrium, friction pyramids, and joint torques due to contact forces."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_whole
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility.casadi_legs import LegStates
from hexakin.kinematics.forward import contact_jacobian
from hexakin.numerics.display import short_repr
from hexakin.robot.model import GRAVITY, Robot
from hexakin.stability.friction_pyramid import contact_frames, pyramid_faces
from hexakin.transforms import cross_matrix

_LENGTH = 0.1  # [m] lever arm that scales moments to forces
_PER_INSTANT = ("equilibrium", "cone", "torque_map", "torque_free", "carrying", "frames", "center_of_mass")


@dataclass(frozen=True, eq=False)
class StaticProblem:
    """Data of n force problems, with forces in units of m g and moments in units of m g times 0.1 m.

    The variables f are the components of the forces in the contact frames (uphill, across, normal), 3 for each leg.

    Parameters
    ----------
    equilibrium, weight
        Matrices (n, 6, 3 L) and right side (6,) of the equilibrium: equilibrium @ f = weight.
    cone
        Faces (n, facets, 3) of the friction pyramids: cone @ f <= 0 for every foot.
    torque_map, torque_free
        Joint torques (n, L, 3) by the forces: torque / torque_unit = torque_free + torque_map @ f.
    carrying
        Which feet carry load, (n, L) bool.
    frames
        Axes (n, L, 3, 3) of the contact frames in the world, as columns.
    center_of_mass
        Centres of mass (n, 3) [m] in the world.
    unit
        Unit of force [N]: the weight m g.
    """

    equilibrium: Array
    weight: Array
    cone: Array
    torque_map: Array
    torque_free: Array
    carrying: NDArray[np.bool_]
    frames: Array
    center_of_mass: Array
    unit: float

    __repr__ = short_repr

    def at(self, instants: NDArray[np.int_]) -> StaticProblem:
        """Return the problems of the given ``instants`` (k,)."""
        return dataclasses.replace(self, **{name: getattr(self, name)[instants] for name in _PER_INSTANT})


def static_problem(
    robot: Robot,
    T_world_body: Array,
    states: LegStates,
    carrying: NDArray[np.bool_],
    normals: ArrayLike,
    *,
    friction: float,
    facets: int,
    torque_unit: float,
) -> StaticProblem:
    """Set up the force problems of n instants.

    ``states`` are the legs' states at these instants, and ``torque_unit`` [N m] is the unit of the torques. The other
    arguments are those of ``distribute``. Raises InvalidInputError for wrong ``normals`` or ``facets``.
    """
    check_whole("facets", facets, at_least=3)
    n, num_legs = carrying.shape
    normal = check_array("normals", normals, (3,), ("coordinate",))
    try:
        normal = np.broadcast_to(normal, (n, num_legs, 3))
    except ValueError as error:
        expected = f"(3,) or ({n}, {num_legs}, 3)"
        raise InvalidInputError(f"normals: expected shape {expected}, got {normal.shape}") from error
    if np.abs(np.linalg.norm(normal, axis=-1) - 1.0).max(initial=0.0) > 1e-6:
        raise InvalidInputError("normals: expected unit vectors")
    R = T_world_body[:, :3, :3]
    frames = contact_frames(normal)
    turn = np.einsum("nji,nljk->nlik", R, frames)  # contact frame in the body frame
    # The contact lies on the foot's sphere. Its lever arm about the foot's centre turns friction into a moment.
    lever = -robot.foot_radius * turn[..., 2]
    point = states.foot + lever
    slide = contact_jacobian(states.jacobian, states.axes, cross_matrix(lever))
    gravity = -GRAVITY * R[:, 2]  # acceleration of gravity in the body frame; the rows of R are the world's axes
    center = (robot.torso.mass * robot.torso.center_of_mass + states.moment.sum(axis=1)) / robot.mass
    unit = robot.weight

    equilibrium = np.zeros((n, 6, num_legs, 3))
    equilibrium[:, :3] = np.moveaxis(turn, 1, 2)
    arm = (point - center[:, None]) / _LENGTH
    equilibrium[:, 3:] = np.moveaxis(np.cross(arm[..., None], turn, axisa=-2, axisb=-2, axisc=-2), 1, 2)
    # Force and moment in the world frame, in which the weight is the same at every instant.
    equilibrium[:, :3] = np.einsum("nij,njlk->nilk", R, equilibrium[:, :3])
    equilibrium[:, 3:] = np.einsum("nij,njlk->nilk", R, equilibrium[:, 3:])
    torque_free = -np.einsum("nlij,ni->nlj", states.moment_slope, gravity) / torque_unit
    torque_map = -unit / torque_unit * np.einsum("nlij,nlik->nljk", slide, turn)
    torque_map = np.where(carrying[..., None, None], torque_map, 0.0)
    return StaticProblem(
        equilibrium.reshape(n, 6, -1),
        np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        pyramid_faces(np.full(n, friction), facets),
        torque_map,
        torque_free,
        carrying,
        frames,
        np.einsum("nij,nj->ni", R, center) + T_world_body[:, :3, 3],
        unit,
    )
