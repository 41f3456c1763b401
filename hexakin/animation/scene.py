"""The content of an animation, independent of how it is drawn: parts, poses, ground, forces, polygons, ZMP, traces."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from hexakin.animation.ground import Surface, ground_surfaces
from hexakin.checks import Array, check_poses
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.figures.style import LEG_COLOURS
from hexakin.kinematics.forward import forward_kinematics, segment_poses, standing_height
from hexakin.motion.motion import Motion, motion_of
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.numerics.display import short_repr
from hexakin.robot.model import SEGMENT_NAMES, Robot
from hexakin.stability.polygon import support_polygon
from hexakin.stability.time_series import zero_moment_point
from hexakin.terrain.base import Terrain
from hexakin.terrain.leg_curves import LegCurves
from hexakin.transforms import inverse_pose, pose, transform_points

SHOWN = ("forces", "polygon", "zmp", "traces")
FIELD_OF_VIEW = 40.0  # [deg], vertical angle of the camera
ARROW, EDGE = "#b2002d", "#8a5a00"  # colours of forces and of the polygon's edge; no leg has them

_RATE = 30.0  # [1/s], largest rate of keyframes; a recording has one instant per control tick, by default 20 per second
_LIFT = 0.003  # [m], height of polygon and ZMP above the contacts, so that the ground does not hide them
_TORSO, _DARK = "#8c8c8c", "#404040"


class Part(NamedTuple):
    """A box with edges ``size`` (3,) [m], or a sphere of diameter ``size[0]``, fixed in the frame of ``node``.

    ``node`` is ``(leg, segment)``, indices from 0, or None for the torso; ``T_node_part`` (4, 4) is the part's pose in
    this frame.
    """

    name: str
    node: tuple[int, int] | None
    kind: Literal["box", "sphere"]
    size: Array
    T_node_part: Array
    colour: str

    def __repr__(self) -> str:
        return short_repr(self)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Everything that an animation shows, at n instants; positions are in the world frame.

    Parameters
    ----------
    robot
        The robot.
    title
        Title of the animation.
    parts
        Boxes and spheres of the robot.
    surfaces
        The ground, as coloured triangles.
    time
        Time of the instants, (n,) [s].
    T_world_body
        Pose of the body, (n, 4, 4).
    T_body_segment
        Poses of the segments in the body frame, (n, L, 3, 4, 4).
    p_foot
        Centres of the feet as they are drawn, (n, L, 3) [m].
    held
        Legs without joint angles, which are drawn in their last pose, (n, L) bool.
    p_target
        Places where the centres of the feet should be, (n, L, 3) [m].
    p_contact, normal
        Contact points, (n, L, 3) [m], and unit normals of the ground there, (n, L, 3).
    force
        Normal forces, (n, L) [N]; None if they are not known or not shown.
    polygon
        Support polygons of the n instants, (m, 3) [m] each, None where there is none; None if they are not shown.
    zmp
        Zero-moment point, (n, 3) [m], NaN where it is undefined; None if it is not shown.
    traces
        Whether the paths of the feet are shown.
    ground_path
        Ground below each foot, (n, L, 3) [m], if only the ground's height below the feet is known; otherwise None.
    center
        Point that the camera looks at, (n, 3) [m].
    eye
        Place of the camera relative to ``center``, (3,) [m].
    newtons_per_metre
        Scale of the arrows [N/m].
    """

    robot: Robot
    title: str
    parts: tuple[Part, ...]
    surfaces: tuple[Surface, ...]
    time: Array
    T_world_body: Array
    T_body_segment: Array
    p_foot: Array
    held: NDArray[np.bool_]
    p_target: Array
    p_contact: Array
    normal: Array
    force: Array | None
    polygon: tuple[Array | None, ...] | None
    zmp: Array | None
    traces: bool
    ground_path: Array | None
    center: Array
    eye: Array
    newtons_per_metre: float

    __repr__ = short_repr

    @property
    def notes(self) -> list[str]:
        """Notes for the viewer: the scales of ground and forces, and the instants at which a leg is out of reach."""
        notes = [f"tiles: {1e3 * tile:g} mm" for tile in sorted({s.tile for s in self.surfaces} - {0.0})]
        if self.force is not None:
            notes.append(f"arrows: {0.1 * self.newtons_per_metre:.3g} N per 100 mm")
        for leg in np.flatnonzero(self.held.any(axis=0)):
            at = self.time[self.held[:, leg]]
            share = f"{len(at)} of {len(self.time)} instants ({at[0]:.3g} s to {at[-1]:.3g} s)"
            notes.append(f"leg {leg + 1}: out of reach at {share}")
        if self.held.any():
            notes.append("a leg out of reach keeps its last pose; a ball marks where its foot should be")
        return notes


def make_scene(
    robot: Robot,
    motion: Recording | WalkPlan | Motion,
    terrain: Terrain | LegCurves | None,
    show: Sequence[str],
    follow: bool,
) -> Scene:
    """Return the scene that `hexakin.animation.animate` shows; arguments and errors are those of `animate`."""
    wanted = _check_show(show)
    ground = None if isinstance(terrain, LegCurves) else terrain
    course = motion_of(robot, motion)
    chosen = _keyframes(course.time)
    T = check_poses("motion: T_world_body", course.T_world_body)[chosen]
    q, held = _held(course.q[chosen], course.time[chosen])
    p_foot = transform_points(T, forward_kinematics(robot, q))
    normal = np.zeros_like(p_foot) + [0.0, 0.0, 1.0]
    if ground is not None:
        normal = ground.normal(p_foot[..., 0], p_foot[..., 1])
    p_contact = p_foot - robot.foot_radius * normal
    force = motion.foot_force[chosen] if isinstance(motion, Recording) else None
    center, eye = _camera(T, p_foot, follow)
    below = None
    if ground is None and course.ground_height is not None:
        below = np.concatenate([p_foot[..., :2], course.ground_height[chosen][..., None]], axis=-1)
    return Scene(
        robot=robot,
        title=robot.name if terrain is None else f"{robot.name}, {_short(repr(terrain))}",
        parts=tuple(_parts(robot)),
        surfaces=() if ground is None else ground_surfaces(ground, p_foot),
        time=course.time[chosen],
        T_world_body=T,
        T_body_segment=segment_poses(robot, q),
        p_foot=p_foot,
        held=held,
        p_target=transform_points(T, course.p_body_foot[chosen]),
        p_contact=p_contact,
        normal=normal,
        force=force if "forces" in wanted else None,
        polygon=_polygons(p_contact, course.carrying[chosen]) if "polygon" in wanted else None,
        zmp=_zmp(p_contact, force) if "zmp" in wanted and force is not None else None,
        traces="traces" in wanted,
        ground_path=below,
        center=center,
        eye=eye,
        # A third of the weight is a leg's load in a tripod; the arrow of this force is as long as the standing height.
        newtons_per_metre=robot.weight / 3.0 / standing_height(robot),
    )


def _short(text: str) -> str:
    """Return a text in which numbers with many digits are rounded."""
    return re.sub(r"\d+\.\d{5,}(e-?\d+)?", lambda number: f"{float(number[0]):.4g}", text)


def _check_show(show: Sequence[str]) -> tuple[str, ...]:
    for name in show:
        if name not in SHOWN:
            raise UnknownNameError("show", name, list(SHOWN))
    return tuple(show)


def _keyframes(time: Array) -> NDArray[np.int_]:
    """Return the indices of the instants shown: all, or evenly spaced ones with the first and the last."""
    if len(time) < 2:
        raise InvalidInputError(f"motion: time has shape {time.shape}, expected at least two instants (n,)")
    count = min(len(time), 1 + int(np.ceil(_RATE * (time[-1] - time[0]))))
    return np.unique(np.round(np.linspace(0, len(time) - 1, max(count, 2))).astype(int))


def _held(q: Array, time: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return angles without gaps, and flags (n, L) of the gaps; a gap has the last known pose, or else the first."""
    known = np.asarray(np.isfinite(q).all(axis=-1))
    if not known.any(axis=0).all():
        leg = int(np.argmin(known.any(axis=0)))
        span = f"between {time[0]:g} s and {time[-1]:g} s"
        raise InvalidInputError(f"motion: leg {leg + 1} has no joint angles at any instant {span} and cannot be drawn")
    last = np.maximum.accumulate(np.where(known, np.arange(len(q))[:, None], -1), axis=0)
    last = np.where(last < 0, known.argmax(axis=0), last)
    return np.take_along_axis(q, last[..., None], axis=0), ~known


def _parts(robot: Robot) -> list[Part]:
    """Return the torso with a mark at its front, and for each leg three slim boxes, three joints and the foot."""
    torso = robot.torso
    across = float(np.abs(robot.right) @ torso.size)
    along = float(np.abs(robot.forward) @ torso.size)
    middle = torso.center_of_mass + robot.forward * 0.38 * along + [0.0, 0.0, 0.5 * torso.size[2]]
    turned = pose(np.column_stack([robot.forward, -robot.right, [0.0, 0.0, 1.0]]), middle)
    mark = np.array([0.16 * along, 0.5 * across, 0.06 * torso.size[2]])
    parts = [
        Part("box", None, "box", torso.size, pose(np.eye(3), torso.center_of_mass), _TORSO),
        Part("front", None, "box", mark, turned, _DARK),
    ]
    straight = np.zeros((robot.num_legs, 3))
    feet, frames = forward_kinematics(robot, straight), segment_poses(robot, straight)
    for leg in range(robot.num_legs):
        colour = LEG_COLOURS[leg % len(LEG_COLOURS)]
        for k, name in enumerate(SEGMENT_NAMES):
            body = robot.segments[name]
            slim = body.size * [1.0, 0.5, 0.5]  # as in the figures, so that the joints are visible
            parts.append(Part("box", (leg, k), "box", slim, pose(np.eye(3), body.center_of_mass), colour))
            parts.append(Part("joint", (leg, k), "sphere", np.full(3, 1.2 * slim[1:].max()), np.eye(4), _DARK))
        p_tibia_foot = transform_points(inverse_pose(frames[leg, 2]), feet[leg, None])[0]
        if robot.foot_radius > 0.0:  # otherwise the foot is a point
            ball = np.full(3, 2.0 * robot.foot_radius)
            parts.append(Part("foot", (leg, 2), "sphere", ball, pose(np.eye(3), p_tibia_foot), _DARK))
    return parts


def _polygons(p_contact: Array, carrying: NDArray[np.bool_]) -> tuple[Array | None, ...]:
    polygons: list[Array | None] = []
    for points, carry in zip(p_contact, carrying, strict=True):
        hull = support_polygon(points[carry])
        if hull is not None:  # the polygon is 2D; its corners have the heights of their feet
            corner = [int(np.argmax((points[:, :2] == vertex).all(axis=-1) & carry)) for vertex in hull]
            hull = points[corner] + [0.0, 0.0, _LIFT]
        polygons.append(hull)
    return tuple(polygons)


def _zmp(p_contact: Array, force: Array) -> Array:
    """Return the ZMP (n, 3) [m]; its height is the mean of the contact heights, weighted by the forces."""
    plan, side = (zero_moment_point(p_contact[..., axes], force).xy for axes in ([0, 1], [0, 2]))
    return np.column_stack([plan, side[:, 1] + _LIFT])


def _camera(T_world_body: Array, p_foot: Array, follow: bool) -> tuple[Array, Array]:
    """Return the point (n, 3) that the camera looks at and the camera's place relative to it (3,), both in [m].

    The camera is in front of the robot, to its right and above it.
    """
    path = T_world_body[:, :3, 3]
    reach = np.linalg.norm((p_foot - path[:, None])[..., :2], axis=-1).max()
    if follow:
        center = uniform_filter1d(path, max(1, len(path) // 8), axis=0, mode="nearest")
    else:
        low, high = path.min(axis=0), path.max(axis=0)
        center = np.tile((low + high) / 2.0, (len(path), 1))
        reach += 0.5 * np.linalg.norm(high - low)
    center = center - [0.0, 0.0, 0.15 * reach]
    walked = path[-1, :2] - path[0, :2]
    ahead = np.arctan2(*walked[::-1]) if np.hypot(*walked) > 1e-3 else np.pi / 2.0
    azimuth, elevation = ahead - np.radians(50.0), np.radians(28.0)
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    return center, 1.25 * reach / np.tan(np.radians(FIELD_OF_VIEW / 2.0)) * away
