"""The MuJoCo model of a robot on a terrain, and the parameters of its contacts."""

from __future__ import annotations

import math
import platform
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hexakin.checks import Array
from hexakin.exceptions import InvalidInputError, MissingPackageError
from hexakin.numerics.display import short_repr
from hexakin.robot.mjcf import to_mjcf
from hexakin.robot.model import SEGMENT_NAMES, Robot
from hexakin.robot.urdf import TORSO
from hexakin.terrain.base import Box, HalfSpace, Terrain, TriangleMesh
from hexakin.terrain.height_field import GridMesh
from hexakin.transforms import rotation_between


def _install() -> str:
    """Return the command that installs MuJoCo; empty if it has no wheel."""
    if (sys.platform, platform.machine()) != ("darwin", "x86_64"):
        return "pip install mujoco"
    return 'pip install "mujoco<3.7"' if sys.version_info < (3, 14) else ""


try:
    import mujoco
except ImportError as error:
    raise MissingPackageError("mujoco", 'engine "mujoco"', _install(), 'use engine="rigid"') from error

__all__ = ["SERVO_IMPEDANCE", "ContactParameters", "Scene", "build_scene", "mujoco"]

SERVO_IMPEDANCE = 0.9999
"""Weight of a servo's speed against the motion without it; the largest value that MuJoCo takes."""


class ContactParameters(NamedTuple):
    """How contacts give way: parameters of MuJoCo's contact model.

    A contact accelerates by the weighted mean of a reference acceleration (weight ``impedance``, at most 0.9999) and of
    the acceleration without contact force. ``impratio`` is how much stiffer friction is than the normal direction. The
    reference acceleration stops a body in one time step h, and moves it out of the ground with the stiffness
    1 / (2 h damping_ratio)^2; it then leaves with at most 1 / (2 damping_ratio)^2 of the speed of its impact.
    """

    impedance: float
    impratio: float
    damping_ratio: float


class Scene(NamedTuple):
    """A compiled model, and the ``group`` (g,) of each geom: its leg for a foot, L torso, L + 1 limbs, -1 ground."""

    model: mujoco.MjModel
    group: NDArray[np.int_]

    def __repr__(self) -> str:
        return short_repr(self)


def build_scene(
    robot: Robot,
    terrain: Terrain,
    *,
    time_step: float,
    friction: float,
    contact: ContactParameters,
    solver_tolerance: float,
    solver_iterations: int,
) -> Scene:
    """Return the model of ``robot`` on ``terrain`` with elliptic friction cones; see ``MujocoEngine``.

    Raises InvalidInputError for a triangle mesh that is not that of a HeightField, and for a robot that MuJoCo refuses.
    """
    spec = mujoco.MjSpec.from_string(to_mjcf(robot))
    spec.compiler.fusestatic = True  # the feet become parts of the tibiae
    option = spec.option
    option.timestep = time_step
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = contact.impratio
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a state that is not finite is an error
    option.tolerance, option.iterations = solver_tolerance, solver_iterations
    for geom in spec.geoms:
        geom.condim = 3
        geom.priority = 1  # the robot's parameters hold, whatever those of the ground are
        geom.friction = [friction, 0.0, 0.0]
        geom.solref = [2.0 * time_step, contact.damping_ratio]
        geom.solimp = [contact.impedance, contact.impedance, 1.0, 0.5, 1.0]  # the same at every depth
    for index, shape in enumerate(terrain.shapes()):
        _add_ground(spec, shape, f"ground_{index}")
    try:
        model = spec.compile()
    except ValueError as error:
        raise InvalidInputError(f"robot {robot.name!r}: MuJoCo refuses it: {error}") from error
    model.dof_solref[:] = 2.0 * time_step, 1.0  # a servo reaches its speed in one time step
    model.dof_solimp[:] = SERVO_IMPEDANCE, SERVO_IMPEDANCE, 1.0, 0.5, 1.0
    return Scene(model, _groups(robot, model))


def _groups(robot: Robot, model: mujoco.MjModel) -> NDArray[np.int_]:
    groups = {TORSO: robot.num_legs}
    for leg in range(robot.num_legs):
        groups |= {f"{segment}_{leg + 1}": robot.num_legs + 1 for segment in SEGMENT_NAMES}
        groups[f"foot_{leg + 1}"] = leg
    return np.array([groups.get(model.geom(index).name, -1) for index in range(model.ngeom)])


def _add_ground(spec: mujoco.MjSpec, shape: HalfSpace | TriangleMesh | Box, name: str) -> None:
    # A geom collides with others of which contype has the bit of its conaffinity: with the robot.
    ground = spec.worldbody.add_geom(name=name, contype=0, conaffinity=1)
    if isinstance(shape, HalfSpace):
        ground.type = mujoco.mjtGeom.mjGEOM_PLANE
        ground.size = [0.0, 0.0, 1.0]  # without end
        ground.pos, ground.quat = shape.point, _quat_wxyz(rotation_between([0.0, 0.0, 1.0], shape.normal))
    elif isinstance(shape, Box):
        lower, upper = np.array(shape.lower), np.array(shape.upper)
        ground.type = mujoco.mjtGeom.mjGEOM_BOX
        ground.size, ground.pos = 0.5 * (upper - lower), 0.5 * (lower + upper)
    elif isinstance(shape, GridMesh):
        _add_field(spec, ground, shape)
    else:
        raise InvalidInputError('terrain: engine "mujoco" takes no triangle mesh but that of a HeightField')


def _add_field(spec: mujoco.MjSpec, ground: mujoco.MjsGeom, grid: GridMesh) -> None:
    """Add a height field. MuJoCo stores heights in single precision, as shares of their range."""
    lowest, height = float(grid.z.min()), float(np.ptp(grid.z)) or 1.0  # MuJoCo demands a range, of level ground too
    half_x, half_y = 0.5 * (grid.x[-1] - grid.x[0]), 0.5 * (grid.y[-1] - grid.y[0])
    # MuJoCo's rows lie along its y axis, and its triangles have the other diagonal of a cell. The field is turned by 90
    # degrees about z: its columns, along its x axis, follow our y, and its rows follow our -x.
    spec.add_hfield(
        name=ground.name,
        nrow=len(grid.x),
        ncol=len(grid.y),
        size=[half_y, half_x, height, height],  # the last is the depth of the ground below the lowest point
        userdata=(grid.z[::-1] - lowest).ravel(),
    )
    ground.type, ground.hfieldname = mujoco.mjtGeom.mjGEOM_HFIELD, ground.name
    ground.pos = [grid.x[0] + half_x, grid.y[0] + half_y, lowest]
    ground.quat = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]


def _quat_wxyz(rotation: Array) -> Array:
    return Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2]]
