"""The MuJoCo model of a robot on a terrain, and the parameters of its contacts."""

from __future__ import annotations

import math
import platform
import sys
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hexakin.checks import Array
from hexakin.exceptions import InvalidInputError, MissingPackageError
from hexakin.robot.mjcf import to_mjcf
from hexakin.robot.model import SEGMENT_NAMES, Robot
from hexakin.robot.urdf import TORSO
from hexakin.terrain.base import Box, HalfSpace, Terrain, TriangleMesh
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

    Raises InvalidInputError for a triangle mesh that is not a grid, and for a robot that MuJoCo refuses.
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
    else:
        grid = _heights(shape)
        lower, upper = grid.min(axis=(0, 1)), grid.max(axis=(0, 1))
        # MuJoCo's rows lie along y, and its triangles have the other diagonal of a cell. With the field turned by 90
        # degrees its columns (its x axis) point along y and its rows (its y axis) along -x.
        spec.add_hfield(
            name=name,
            nrow=grid.shape[0],
            ncol=grid.shape[1],
            size=[0.5 * (upper[1] - lower[1]), 0.5 * (upper[0] - lower[0]), _range(grid), _range(grid)],
            userdata=(grid[::-1, :, 2] - lower[2]).ravel(),
        )
        ground.type, ground.hfieldname = mujoco.mjtGeom.mjGEOM_HFIELD, name
        ground.pos = [*(0.5 * (lower + upper))[:2], lower[2]]
        ground.quat = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]


def _quat_wxyz(rotation: Array) -> Array:
    return Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2]]


def _range(grid: Array) -> float:
    """Return the range of the heights [m]; 1 m for level ground, because MuJoCo demands a range."""
    return float(np.ptp(grid[..., 2])) or 1.0


def _heights(mesh: TriangleMesh) -> Array:
    """Return the points (nx, ny, 3) [m] of a mesh that is a grid; raise InvalidInputError for another mesh."""
    vertices = mesh.vertices
    count = int(np.argmax(np.append(vertices[:, 0] != vertices[0, 0], True)))  # points with the first x
    if count > 1 and len(vertices) % count == 0 and len(vertices) > count:
        grid = vertices.reshape(-1, count, 3)
        steps = [np.diff(grid[..., axis], axis=axis) for axis in (0, 1)]
        even = all(step.min() > 0.0 and np.ptp(step) <= 1e-6 * step.max() for step in steps)
        along = not np.ptp(grid[..., 0], axis=1).any() and not np.ptp(grid[..., 1], axis=0).any()
        if even and along and _same_triangles(mesh, grid.shape[:2]):
            return grid
    raise InvalidInputError(
        'terrain: engine "mujoco" takes a triangle mesh only if it is an evenly spaced grid like that of HeightField'
    )


def _same_triangles(mesh: TriangleMesh, shape: Iterable[int]) -> bool:
    """Whether each cell of the grid is divided by the diagonal from its largest y to its largest x."""
    index = np.arange(len(mesh.vertices)).reshape(tuple(shape))
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]))
    expected = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)])
    if mesh.triangles.shape != expected.shape:
        return False
    if np.array_equal(mesh.triangles, expected):  # the order of HeightField; sorting takes seconds for large fields
        return True
    given, wanted = (np.sort(triangles, axis=1) for triangles in (mesh.triangles, expected))
    return bool(np.array_equal(given[np.lexsort(given.T)], wanted[np.lexsort(wanted.T)]))
