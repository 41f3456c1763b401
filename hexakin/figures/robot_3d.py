"""Robots, legs, frames, terrains and planned walks on 3D axes.

Positions are given in metres and shown in millimetres. Only what a drawing needs is computed here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import FigureBase
from matplotlib.gridspec import SubplotSpec
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_poses, check_shape, check_whole, checked
from hexakin.exceptions import InvalidInputError
from hexakin.figures.solids_3d import BlockFaces, SolidFaces
from hexakin.figures.style import (
    BLUE,
    GREEN,
    GREY,
    LEG_COLOURS,
    MM,
    ORANGE,
    RED,
    check_colours,
)
from hexakin.kinematics.forward import forward_kinematics, segment_poses
from hexakin.motion.motion import motion_of
from hexakin.motion.walk_plan import WalkPlan
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import SEGMENT_NAMES, Body, Robot
from hexakin.terrain.base import Terrain
from hexakin.terrain.columns import block_columns
from hexakin.transforms import transform_points

_MOST_TILES = 250_000  # matplotlib takes several seconds to draw them


@checked
def axes_3d(
    figure: FigureBase,
    position: int | tuple[int, int, int | tuple[int, int]] | SubplotSpec = 111,
    *,
    elevation: float = 22.0,
    azimuth: float = -60.0,
) -> Axes3D:
    """Add 3D axes with labels in millimetres to ``figure`` and return them.

    ``position`` is the place of the axes in the figure, as for matplotlib's ``add_subplot``; ``elevation`` and
    ``azimuth`` [deg] are the direction from which they are seen. Objects are drawn in the order of their ``zorder``.
    Raises InvalidInputError for a place that a figure does not have, and for angles that are not finite.
    """
    seen_from = {"elev": check_number("elevation", elevation), "azim": check_number("azimuth", azimuth)}
    try:
        ax = figure.add_subplot(position, projection="3d", computed_zorder=False)
    except ValueError as error:
        raise InvalidInputError(f"position: {error}") from error
    ax.view_init(**seen_from)
    ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    ax.patch.set_visible(False)  # it would cover the labels of the panel beside it
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.pane.set_alpha(0.0)
        axis.set_major_locator(plt.MaxNLocator(4))
    return ax


@checked
def set_equal_3d(ax: Axes3D, low: ArrayLike, high: ArrayLike) -> None:
    """Show the box from ``low`` (3,) [m] to ``high`` (3,) [m] on the 3D axes ``ax``, with equal scales.

    Raises InvalidInputError if ``low`` is not below ``high``.
    """
    lower, upper = (MM * corner for corner in _corners(low, high, 3))
    ax.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), zlim=(lower[2], upper[2]))
    ax.set_box_aspect(upper - lower, zoom=1.05)


def _corners(low: ArrayLike, high: ArrayLike, dimensions: int) -> tuple[Array, Array]:
    """Return two opposite corners [m] of a part of space; raise InvalidInputError if it is empty."""
    lower, upper = (check_shape(n, v, (dimensions,), ("coordinate",)) for n, v in (("low", low), ("high", high)))
    if not (lower < upper).all():
        texts = [", ".join(f"{value:g}" for value in corner) for corner in (lower, upper)]
        raise InvalidInputError(f"low, high: ({texts[0]}) m is not below ({texts[1]}) m")
    return lower, upper


def _pose(T_world_body: ArrayLike | None) -> Array:
    """Return the pose (4, 4) at which a robot is drawn."""
    if T_world_body is None:
        return np.eye(4)
    return check_poses("T_world_body", check_shape("T_world_body", T_world_body, (4, 4)))


def _angles(robot: Robot, q: ArrayLike) -> Array:
    """Return the joint angles (L, 3) [rad] of one posture."""
    return check_shape("q", q, (robot.num_legs, NUM_JOINTS), ("leg", "joint"))


def _prism(T: Array, body: Body) -> Array:
    """Return the six faces (6, 4, 3) [m] of a body's box in the world."""
    corners = transform_points(T, body.corners)
    faces = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return corners[np.array(faces)]


def _sphere(center: Array, radius: float) -> Array:
    """Return facets (m, 4, 3) [m] of a sphere."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 11), np.linspace(0, np.pi, 7), indexing="ij")
    p = center + radius * np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    return np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 3)


@checked
def draw_robot(
    ax: Axes3D, robot: Robot, q: ArrayLike, T_world_body: ArrayLike | None = None, *, labels: bool = True
) -> None:
    """Draw the robot on the 3D axes ``ax``, as boxes and spheres.

    ``q`` (L, 3) [rad] are the joint angles, ``T_world_body`` (4, 4) is the body's pose (None: the identity). With
    ``labels`` the numbers of the legs, from 1, are written beside the feet. Blocks that `draw_terrain` drew on the
    same axes hide the parts of the robot behind them. Raises InvalidInputError for other shapes, and for a matrix that
    is no pose.
    """
    T, q = _pose(T_world_body), _angles(robot, q)
    feet = transform_points(T, forward_kinematics(robot, q))
    segments = segment_poses(robot, q)
    faces = [_prism(T, robot.torso)]
    colours = [(0.6, 0.6, 0.6, 0.55)] * 6  # so that the legs behind can be seen
    for leg in range(robot.num_legs):
        colour = LEG_COLOURS[leg % len(LEG_COLOURS)]
        for k, name in enumerate(SEGMENT_NAMES):
            body = robot.segments[name]
            slim = replace(body, size=body.size * [1.0, 0.5, 0.5])  # half as thick, so that the joints can be seen
            faces.append(_prism(T @ segments[leg, k], slim))
            colours += [to_rgba(colour)] * 6
        sphere = _sphere(feet[leg], robot.foot_radius)
        faces.append(sphere)
        colours += [to_rgba("#404040")] * len(sphere)
    polygons = np.concatenate(faces) * MM
    ax.add_collection3d(SolidFaces(polygons, colours, edgecolors="k", linewidths=0.15, zorder=3))
    if labels:
        for leg, foot in enumerate(feet):
            outward = (foot - T[:3, 3]) * [1.0, 1.0, 0.0]
            ax.text(
                *((foot + 0.05 * outward / np.linalg.norm(outward)) * MM),
                str(leg + 1),
                ha="center",
                va="center",
                zorder=4,
                fontweight="bold",
            )


@checked
def draw_skeleton(
    ax: Axes3D, robot: Robot, q: ArrayLike, leg: int, *, frames: bool = True, length: float = 0.03
) -> None:
    """Draw one leg on the 3D axes ``ax``, as lines between its joints.

    ``q`` (L, 3) [rad] are the angles of all legs, ``leg`` is the index of the leg, from 0. With ``frames`` the body's
    frame and the frame at each joint are drawn with axes ``length`` [m] long, and named. Raises InvalidInputError if
    ``q`` has another shape or the robot does not have the leg.
    """
    q = _angles(robot, q)
    check_whole("leg", leg, at_most=robot.num_legs - 1)
    check_number("length", length, above=0.0, unit="m")
    poses = segment_poses(robot, q)[leg]
    foot = forward_kinematics(robot, q)[leg]
    points = np.vstack([np.zeros(3), poses[:, :3, 3], foot]) * MM
    ax.plot(*points.T, "-", color="k", lw=2.5, zorder=2)
    ax.plot(*points[1:-1].T, "o", color="w", mec="k", ms=8, zorder=3)
    ax.plot(*points[-1:].T, "o", color="#404040", ms=10, zorder=3)
    if frames:
        for T in [np.eye(4), *poses]:
            draw_frame(ax, T, length)
        for point, name in zip(points, ("B", *(f"joint {k + 1}" for k in range(len(poses))), "foot"), strict=True):
            ax.text(*(point + [0.0, 0.0, -1.6 * MM * 0.01]), name, ha="left", va="top", fontsize=8, zorder=5)


@checked
def draw_wireframe(
    ax: Axes3D,
    robot: Robot,
    q: ArrayLike,
    T_world_body: ArrayLike | None = None,
    *,
    legs: Sequence[int] | None = None,
    torso: bool = True,
    colour: str | Sequence[float] = GREY,
    width: float = 1.2,
) -> None:
    """Draw the robot as lines: the torso's edges and, for each leg, the line through its joints to the foot.

    Parameters
    ----------
    ax
        3D axes to draw on.
    robot
        The robot.
    q
        Joint angles, (L, 3) [rad].
    T_world_body
        Pose of the body, (4, 4); None is the identity.
    legs
        Indices, from 0, of the legs that are drawn; None draws all.
    torso
        Whether the torso is drawn.
    colour, width
        Colour and width (in points) of the lines.

    Raises
    ------
    InvalidInputError
        For other shapes, a matrix that is no pose, a leg that the robot does not have, or a colour that is none.
    """
    T, q = _pose(T_world_body), _angles(robot, q)
    check_colours("colour", [colour])
    check_number("width", width, above=0.0)
    drawn = range(robot.num_legs) if legs is None else legs
    for leg in drawn:
        check_whole("legs", leg, at_most=robot.num_legs - 1)
    joints, feet = segment_poses(robot, q)[..., :3, 3], forward_kinematics(robot, q)
    lines = transform_points(T, np.concatenate([joints, feet[:, None]], axis=1).reshape(-1, 3))
    lines = lines.reshape(robot.num_legs, -1, 3) * MM
    # Lines may leave the panel. The layout ignores them, because it would read 3D points as points on the page.
    unclipped: dict[str, Any] = {"zorder": 5, "clip_on": False, "in_layout": False}
    for leg in drawn:
        ax.plot(*lines[leg].T, "o-", color=colour, ms=1.6 * width, lw=width, **unclipped)
    if torso:
        faces = _prism(T, robot.torso) * MM
        ax.add_collection3d(Line3DCollection(faces[:, [0, 1, 2, 3, 0]], colors=colour, linewidths=width, **unclipped))


@checked
def draw_frame(ax: Axes3D, T: ArrayLike, length: float = 0.03) -> None:
    """Draw a frame on the 3D axes ``ax``: its x (red), y (green) and z (blue) axes, ``length`` [m] long.

    ``T`` (4, 4) is the pose of the frame in the world. Raises InvalidInputError if it is none.
    """
    T = check_poses("T", check_shape("T", T, (4, 4)))
    check_number("length", length, above=0.0, unit="m")
    segments = [np.stack([T[:3, 3], T[:3, 3] + length * T[:3, k]]) * MM for k in range(3)]
    ax.add_collection3d(Line3DCollection(segments, colors=[RED, GREEN, BLUE], linewidths=1.8, zorder=4))


@checked
def draw_terrain(
    ax: Axes3D, terrain: Terrain, low: tuple[float, float], high: tuple[float, float], *, spacing: float = 0.05
) -> None:
    """Draw the part of ``terrain`` between ``low`` (x, y) [m] and ``high`` (x, y) [m] on the 3D axes ``ax``.

    A terrain of boxes is drawn as blocks, which are lighter if they are higher. The blocks end at ``low`` and
    ``high``, and hide the parts behind them of robots on the same axes. Other terrains are drawn as tiles that are
    ``spacing`` [m] wide. Raises InvalidInputError if ``low`` is not below ``high``, and for a spacing that gives more
    than 250000 tiles.
    """
    (x_low, y_low), (x_high, y_high) = _corners(low, high, 2)
    check_number("spacing", spacing, above=0.0, unit="m")
    columns = block_columns(terrain, (x_low, y_low), (x_high, y_high))
    if columns is not None:
        ax.add_collection3d(blocks := BlockFaces(*(corners * MM for corners in columns), zorder=0))
        ax.auto_scale_xyz(*blocks.corners.T)
        return
    if (tiles := (x_high - x_low) / spacing * (y_high - y_low) / spacing) > _MOST_TILES:
        raise InvalidInputError(f"spacing: {spacing:g} m gives {tiles:.0f} tiles, expected at most {_MOST_TILES}")
    x = np.arange(x_low, x_high + spacing / 2, spacing)
    y = np.arange(y_low, y_high + spacing / 2, spacing)
    X, Y = np.meshgrid(x, y)
    p = np.stack([X, Y, terrain.height(X, Y)], axis=-1) * MM
    corners = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    checker = (np.add.outer(np.arange(len(y) - 1), np.arange(len(x) - 1)) % 2).ravel()
    colours = np.where(checker[:, None] == 0, [0.93, 0.91, 0.85], [0.85, 0.82, 0.74])
    ax.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors="none", zorder=0))


@checked
def draw_plane(ax: Axes3D, points: ArrayLike, normal: ArrayLike, *, colour: str = ORANGE, arrow: float = 0.1) -> None:
    """Draw a plane through three feet on the 3D axes ``ax``, as a triangle and an arrow along its normal.

    ``points`` (3, 3) [m] are the feet, ``normal`` (3,) is the unit normal, ``arrow`` [m] the length of its arrow,
    ``colour`` the colour of both. Raises InvalidInputError for other shapes.
    """
    triangle = check_shape("points", points, (3, 3), ("point", "coordinate")) * MM
    way = check_number("arrow", arrow, unit="m") * MM * check_shape("normal", normal, (3,), ("coordinate",))
    check_colours("colour", [colour])
    ax.add_collection3d(Poly3DCollection([triangle], facecolors=colour, alpha=0.4, edgecolors=colour, zorder=1))
    ax.quiver(*triangle.mean(axis=0), *way, color=colour, lw=2, arrow_length_ratio=0.15, zorder=5)


@checked
def draw_plan(ax: Axes3D, robot: Robot, plan: WalkPlan, samples: Sequence[int], *, ground: bool = True) -> None:
    """Draw paper B's ``plan`` of a walk on the 3D axes ``ax``: the paths of feet and body, and the robot itself.

    ``samples`` are the indices of the samples at which the robot is drawn. The paths of the feet have the colours of
    the legs. With ``ground`` a dashed line joins the footholds of each leg, for terrains without a surface to draw.
    Raises InvalidInputError for a sample that the plan does not have, and for the plan of a robot with other legs.
    """
    for sample in samples:
        check_whole("samples", sample, at_most=len(plan.time) - 1)
    motion_of(robot, plan)  # refuses a plan of another robot
    for leg in range(robot.num_legs):
        colour = LEG_COLOURS[leg % len(LEG_COLOURS)]
        ax.plot(*(plan.p_world_foot[:, leg].T * MM), color=colour, lw=0.9, zorder=2)
        if ground:
            ax.plot(*(plan.footholds[:, leg].T * MM), ".--", color=colour, lw=0.6, ms=4, zorder=1)
    ax.plot(*(plan.T_world_body[:, :3, 3].T * MM), color="k", lw=1.2, zorder=2)
    for sample in samples:
        draw_robot(ax, robot, plan.q[sample], plan.T_world_body[sample])
    points = np.concatenate([plan.p_world_foot.reshape(-1, 3), plan.T_world_body[:, :3, 3]])
    room = np.array([0.05, 0.05, robot.foot_radius + 0.02])
    set_equal_3d(ax, points.min(axis=0) - room, points.max(axis=0) + [0.05, 0.05, 0.08])
