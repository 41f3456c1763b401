"""Sliders in a notebook that move the body over fixed feet, or one leg, and a picture of the result.

::

    hk.sliders.body_pose(robot)  # as the last line of a cell
    hk.sliders.leg_angles(robot, leg=2)

A leg that cannot follow is drawn in red and named below the picture. The sliders need the package ipywidgets and no
network; a new picture takes about 0.15 s.
"""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_function, check_number, check_poses, check_shape, check_whole, checked
from hexakin.exceptions import InvalidInputError, MissingPackageError, UnreachableError, shown
from hexakin.figures.robot_3d import axes_3d, draw_robot, draw_terrain, draw_wireframe, set_equal_3d
from hexakin.figures.style import MM
from hexakin.kinematics.forward import forward_kinematics, standing_height
from hexakin.kinematics.inverse import posed_inverse_kinematics
from hexakin.kinematics.leg_functions import reach
from hexakin.motion.clearance import torso_gaps
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import Robot
from hexakin.terrain.planes import Plane
from hexakin.transforms import pose, rpy_rotation, transform_points

_FAULT = "#b2002d"  # differs from the colours of the legs
_BEYOND = 0.2  # share of a joint's range by which its slider exceeds the limits on both sides, to show them
_TILT = 45.0  # [deg], largest roll, pitch and yaw of the sliders


@checked
@dataclass(frozen=True, eq=False)
class Posture:
    """A robot over a level floor at z = 0, with its faults.

    ``T_world_body`` (4, 4) is the body's pose; ``q`` (L, 3) [rad] are the joint angles, of a leg out of reach the
    angles that it had before; ``p_world_foot`` (L, 3) [m] are the places where the centres of the feet should be;
    ``torso_clearance`` [m] is the distance from the floor to the torso, negative below the floor; ``faults`` has by
    leg (from 1; 0 is the torso) a message, such as a limit that is exceeded. Raises InvalidInputError for other shapes.
    """

    T_world_body: Array
    q: Array
    p_world_foot: Array
    torso_clearance: float
    faults: Mapping[int, str]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        check_poses("T_world_body", check_shape("T_world_body", self.T_world_body, (4, 4)))
        angles = check_shape("q", self.q, (None, NUM_JOINTS), ("leg", "joint"))
        check_shape("p_world_foot", self.p_world_foot, (len(angles), 3), ("leg", "coordinate"))
        check_number("torso_clearance", self.torso_clearance, unit="m")


@checked
def posture_of_body(robot: Robot, offset: ArrayLike, rpy: ArrayLike, q_before: ArrayLike | None = None) -> Posture:
    """Return the posture after the body has moved while the feet stay on their standing footholds.

    ``offset`` (3,) [m] is the way from the standing pose along the world's axes, ``rpy`` (3,) [rad] are roll, pitch and
    yaw about the body's x, y and z axes, B(2). A leg out of reach keeps its angles of ``q_before`` (L, 3) [rad]; None
    is the standing pose. Raises InvalidInputError if an array has another shape.
    """
    shift = check_shape("offset", offset, (3,), ("coordinate",)) + [0.0, 0.0, standing_height(robot)]
    T = pose(rpy_rotation(check_shape("rpy", rpy, (3,), ("angle",))), shift)
    standing = forward_kinematics(robot, robot.standing_q)
    feet = standing + [0.0, 0.0, standing_height(robot)]
    solution = posed_inverse_kinematics(robot, T, feet)
    before = robot.standing_q if q_before is None else q_before
    before = check_shape("q_before", before, (robot.num_legs, NUM_JOINTS), ("leg", "joint"))
    q = np.where(solution.reachable[:, None], solution.q, before)
    torso_clearance = float(torso_gaps(robot, Plane(), T))
    faults = _torso_faults(torso_clearance) | _limit_faults(robot, q)
    for leg in np.flatnonzero(~solution.reachable):
        low, high = (float(bound) for bound in solution.reach[leg])
        faults[int(leg) + 1] = str(UnreachableError(int(leg) + 1, float(solution.distance[leg]), (low, high)))
    return Posture(T, q, feet, torso_clearance, dict(sorted(faults.items())))


@checked
def posture_of_leg(robot: Robot, leg: int, angles: ArrayLike) -> Posture:
    """Return the standing posture, in which one leg has other angles.

    ``leg`` is the number of the leg, from 1; ``angles`` (3,) [rad]. Raises InvalidInputError if the robot does not have
    the leg or ``angles`` have another shape.
    """
    _check_leg(robot, leg)
    q = np.array(robot.standing_q)
    q[leg - 1] = check_shape("angles", angles, (NUM_JOINTS,), ("joint",))
    T = pose(np.eye(3), [0.0, 0.0, standing_height(robot)])
    torso_clearance = float(torso_gaps(robot, Plane(), T))
    faults = _torso_faults(torso_clearance) | _limit_faults(robot, q)
    return Posture(T, q, transform_points(T, forward_kinematics(robot, q)), torso_clearance, faults)


def _limit_faults(robot: Robot, q: Array) -> dict[int, str]:
    faults: dict[int, str] = {}
    beyond = np.maximum(robot.q_min - q, q - robot.q_max)
    for leg in np.flatnonzero((beyond > 1e-9).any(axis=1)):
        joint = int(np.argmax(beyond[leg]))
        angle, low, high = np.degrees([q[leg, joint], robot.q_min[leg, joint], robot.q_max[leg, joint]])
        name = robot.table.joints[joint]
        faults[int(leg) + 1] = f"leg {leg + 1}: {name} = {angle:.1f} deg leaves its limits [{low:.1f}, {high:.1f}] deg"
    return faults


def _torso_faults(torso_clearance: float) -> dict[int, str]:
    return {0: f"torso: {-1e3 * torso_clearance:.1f} mm below the floor"} if torso_clearance < 0.0 else {}


class _Range(NamedTuple):
    """Range, start and step of a slider in its ``unit``; ``scale`` converts to SI units."""

    low: float
    high: float
    start: float
    step: float
    unit: str
    scale: float


@checked
class Sliders:
    """Sliders and a picture of the robot, as `body_pose` and `leg_angles` return them; a notebook shows them.

    ``sliders`` are the ipywidgets sliders by name, in mm and degrees: to move one, set its ``value``. ``text`` is the
    text below the picture.

    Parameters
    ----------
    robot
        The robot that is drawn.
    ranges
        By name the range, start, step and unit of each slider.
    posture
        Function that returns the `Posture` for the values of all sliders, (n,) [m or rad], and the joint angles before,
        (L, 3) [rad]. The attribute ``posture`` is the posture that is shown.
    """

    def __init__(self, robot: Robot, ranges: Mapping[str, _Range], posture: Callable[[Array, Array], Posture]):
        check_function("posture", posture, "values", "q_before")
        widgets = _ipywidgets()
        self._robot, self._ranges, self._posture = robot, ranges, posture
        self._figure = Figure(figsize=(5.6, 3.6), dpi=90)
        self._figure.set_layout_engine("none")  # a layout takes time, and would move the axes when their numbers change
        FigureCanvasAgg(self._figure)
        self.sliders = {
            name: widgets.FloatSlider(
                value=r.start, min=r.low, max=r.high, step=r.step, description=f"{name} [{r.unit}]",
                readout_format=".1f", style={"description_width": "9em"}, layout={"width": "25em"},
            )
            for name, r in ranges.items()
        }  # fmt: skip
        self.reset = widgets.Button(description="standing pose")
        self._picture, self._said = widgets.Image(format="png"), widgets.HTML()
        handles = widgets.VBox([*self.sliders.values(), self.reset])
        self.widget = widgets.HBox([handles, widgets.VBox([self._picture, self._said])])
        self.reset.on_click(self._stand)
        for slider in self.sliders.values():
            slider.observe(self._follow, names="value")
        self._q_before = np.array(robot.standing_q)
        self._follow(None)

    @property
    def text(self) -> str:
        """The text below the picture: one line for each fault."""
        return "\n".join(self.posture.faults.values()) or "every foot within reach, every angle within its limits"

    @property
    def png(self) -> bytes:
        """The picture, as the content of a PNG file."""
        return bytes(self._picture.value)

    def _follow(self, _: Any) -> None:
        """Draw the posture that the sliders are set to."""
        values = np.array([self._ranges[name].scale * slider.value for name, slider in self.sliders.items()])
        self.posture = self._posture(values, self._q_before)
        if not isinstance(self.posture, Posture):
            raise InvalidInputError(f"posture: expected a function that returns a Posture, got {shown(self.posture)}")
        self._q_before = self.posture.q
        self._picture.value = _picture(self._figure, self._robot, self.posture)
        colour = _FAULT if self.posture.faults else "inherit"
        lines = html.escape(self.text).replace("\n", "<br>")
        self._said.value = f'<span style="color: {colour}">{lines}</span>'

    def _stand(self, _: Any) -> None:
        """Set all sliders to the standing pose, and draw one picture at the end."""
        for slider in self.sliders.values():
            slider.unobserve(self._follow, names="value")
        for name, slider in self.sliders.items():
            slider.value = self._ranges[name].start
        for slider in self.sliders.values():
            slider.observe(self._follow, names="value")
        self._q_before = np.array(self._robot.standing_q)
        self._follow(None)

    def _repr_mimebundle_(self, **options: Any) -> dict[str, Any]:
        """Return the sliders and, for pages that have no kernel, the picture."""
        return {**self.widget._repr_mimebundle_(**options), "image/png": base64.b64encode(self.png).decode()}


@checked
def body_pose(robot: Robot) -> Sliders:
    """Return sliders for x, y, z, roll, pitch and yaw of the body; the feet stay on their standing footholds.

    x, y and z are distances from the standing pose along the world's axes. The angles are about the body's x, y and z
    axes, as in B(2), for every direction of walking. Raises MissingPackageError without ipywidgets.
    """
    far = round(0.5e3 * float(reach(robot)[:, 1].max()))
    ranges = {name: _Range(-far, far, 0.0, 1.0, "mm", 1e-3) for name in "xyz"}
    tilts = ("roll, about x", "pitch, about y", "yaw, about z")
    ranges |= {name: _Range(-_TILT, _TILT, 0.0, 0.5, "deg", np.pi / 180.0) for name in tilts}
    return Sliders(robot, ranges, lambda values, q: posture_of_body(robot, values[:3], values[3:], q))


@checked
def leg_angles(robot: Robot, leg: int = 1) -> Sliders:
    """Return sliders for the three angles of one leg; their ranges go a little beyond its joint limits.

    ``leg`` is the number of the leg, from 1. Raises MissingPackageError without ipywidgets, InvalidInputError if the
    robot does not have the leg.
    """
    _check_leg(robot, leg)
    ranges = {}
    limits = zip(robot.table.joints, np.degrees(robot.joint_limits[leg - 1]), strict=True)
    for (joint, (low, high)), start in zip(limits, np.degrees(robot.standing_q[leg - 1]), strict=True):
        more = _BEYOND * (high - low)
        ranges[joint] = _Range(round(low - more, 1), round(high + more, 1), float(start), 0.5, "deg", np.pi / 180.0)
    return Sliders(robot, ranges, lambda values, _: posture_of_leg(robot, leg, values))


def _check_leg(robot: Robot, leg: int) -> None:
    if check_whole("leg", leg, at_least=1) > robot.num_legs:
        raise InvalidInputError(f"leg: {leg}, but {robot.name} has {robot.num_legs} legs")


def _picture(figure: Figure, robot: Robot, posture: Posture) -> bytes:
    """Draw a posture in a box of fixed size and place, and return the PNG file's content."""
    figure.clear()
    ax = axes_3d(figure, elevation=25, azimuth=-50)
    ax.set_position((-0.08, -0.08, 1.12, 1.24))  # 3D axes have wide margins of their own
    standing = forward_kinematics(robot, robot.standing_q)
    side = 1.2 * float(np.abs(standing[:, :2]).max())
    top = standing_height(robot) + 0.8 * float(reach(robot)[:, 1].max())
    draw_terrain(ax, Plane(), (-side, -side), (side, side), spacing=side / 4.0)
    draw_robot(ax, robot, posture.q, posture.T_world_body)
    bad = [leg - 1 for leg in posture.faults if leg]
    draw_wireframe(
        ax, robot, posture.q, posture.T_world_body, legs=bad, torso=0 in posture.faults, colour=_FAULT, width=4.0
    )
    ax.plot(*(MM * posture.p_world_foot[bad].T), "o", color=_FAULT, ms=7, zorder=6)
    set_equal_3d(ax, [-side, -side, 0.0], [side, side, top])
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def _ipywidgets() -> ModuleType:
    try:
        import ipywidgets
    except ImportError as error:
        raise MissingPackageError("ipywidgets", "sliders", "pip install ipywidgets") from error
    return ipywidgets
