"""A robot at rest on its feet, as equations: equilibrium, friction pyramids and joint torques by the contact forces."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_whole
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility.casadi_legs import LegStates
from hexakin.kinematics.forward import contact_jacobian
from hexakin.robot.model import GRAVITY, Robot
from hexakin.stability.friction_pyramid import contact_frames, pyramid_faces
from hexakin.transforms import cross_matrix

_LENGTH = 0.1  # [m] lever by which moments are scaled to forces
_PER_INSTANT = ("equilibrium", "cone", "torque_map", "torque_free", "carrying", "frames", "center_of_mass")


@dataclass(frozen=True, eq=False)
class StaticProblem:
    """The data of n force problems, forces in units of m g and moments in m g times 0.1 m.

    The variables are the forces' components in the contact frames (uphill, across, normal), 3 for each leg.
    ``equilibrium`` (n, 6, 3 L) and its right side ``weight`` (6,); ``cone`` (n, facets, 3): cone @ f <= 0;
    ``torque_map`` (n, L, 3, 3) and ``torque_free`` (n, L, 3): torque / max_torque = torque_free + torque_map @ f;
    ``carrying`` (n, L); ``frames`` (n, L, 3, 3) the contact frames' axes in the world, as columns; ``center_of_mass``
    (n, 3) [m] in the world; ``unit`` [N], the weight m g.
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

    def at(self, instants: NDArray[np.int_]) -> StaticProblem:
        """Problems of some instants."""
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
    """Set up the force problems of n instants; see ``distribute`` for the arguments."""
    check_whole("facets", facets, at_least=3)
    n, num_legs = carrying.shape
    normal = check_array("normals", normals, (3,), ("coordinate",))
    normal = np.broadcast_to(normal, (n, num_legs, 3))
    if np.abs(np.linalg.norm(normal, axis=-1) - 1.0).max(initial=0.0) > 1e-6:
        raise InvalidInputError("normals: expected unit vectors")
    R = T_world_body[:, :3, :3]
    frames = contact_frames(normal)
    turn = np.einsum("nji,nljk->nlik", R, frames)  # contact frame in the body frame
    # The contact lies on the foot's sphere: its lever about the foot's centre turns friction into a moment.
    lever = -robot.foot_radius * turn[..., 2]
    point = states.foot + lever
    slide = contact_jacobian(states.jacobian, states.axes, cross_matrix(lever))
    gravity = -GRAVITY * R[:, 2]  # acceleration of gravity in the body frame: rows of R are the world's axes
    center = (robot.torso.mass * robot.torso.center_of_mass + states.moment.sum(axis=1)) / robot.mass
    unit = robot.weight

    equilibrium = np.zeros((n, 6, num_legs, 3))
    equilibrium[:, :3] = np.moveaxis(turn, 1, 2)
    arm = (point - center[:, None]) / _LENGTH
    equilibrium[:, 3:] = np.moveaxis(np.cross(arm[..., None], turn, axisa=-2, axisb=-2, axisc=-2), 1, 2)
    # Force and moment in the world's axes, in which the weight is the same at every instant.
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
