"""Diagrams: gaits over time, joint angles over time and in a leg, and flow charts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_same_length, check_shape, check_whole, checked
from hexakin.exceptions import UnknownNameError
from hexakin.figures.style import BLUE, GREY, MM, RED
from hexakin.kinematics.forward import forward_kinematics, segment_poses
from hexakin.robot.leg_table import NUM_JOINTS
from hexakin.robot.model import Robot
from hexakin.walking.gait import Gait

_MOST_CYCLES = 100  # more could not be told apart


@checked
def draw_gait(ax: Axes, gait: Gait, names: Sequence[str], cycles: float = 2.0) -> None:
    """Draw the diagram of ``gait`` on ``ax``: for each leg a bar while its foot is on the ground.

    ``names`` are the names of the legs, from top to bottom; ``cycles`` is the number of gait cycles shown, at most 100.
    The time axis counts cycles. Raises InvalidInputError for another number of names or cycles.
    """
    check_same_length(names=names, legs=gait.offsets)
    cycles = check_number("cycles", cycles, above=0.0, at_most=_MOST_CYCLES)
    for leg, (offset, name) in enumerate(zip(gait.offsets, names, strict=True)):
        lands = offset + 1.0 - gait.duty_factor
        starts = np.arange(np.floor(-lands) - 1.0, cycles + 1.0) + lands
        left, right = np.clip(starts, 0.0, cycles), np.clip(starts + gait.duty_factor, 0.0, cycles)
        seen = right > left
        ax.barh(leg, (right - left)[seen], left=left[seen], height=0.62, color="0.25", label=name)
    ax.set_yticks(range(gait.num_legs), names)
    ax.invert_yaxis()
    ax.set(xlim=(0.0, cycles), xlabel="cycles", title=f"{gait.name}, duty factor {gait.duty_factor:.2g}")
    ax.set_facecolor("w")
    ax.grid(axis="x", color=GREY, alpha=0.4)
    ax.grid(axis="y", visible=False)


@checked
def plot_leg_angles(ax: Axes, x: ArrayLike, q: ArrayLike, robot: Robot) -> None:
    """Plot one leg's three angles ``q`` (n, 3) [rad] on ``ax``, in degrees, with the names of the robot's joints.

    ``x`` (n,), in the unit of the horizontal axis, which the caller labels. Raises InvalidInputError for other shapes.
    """
    across = check_shape("x", x, (None,))
    angles = check_shape("q", q, (len(across), NUM_JOINTS), ("sample", "joint"))
    for name, angle, style in zip(robot.table.joints, np.degrees(angles).T, ("-", "--", "-."), strict=True):
        ax.plot(across, angle, style, label=_symbol(name))
    ax.set_ylabel("angle [deg]")
    ax.margins(x=0.0)


def _symbol(name: str) -> str:
    """Return a joint's name for print: theta_2 becomes the Greek letter with its index, other names stay."""
    greek = re.fullmatch(r"(alpha|beta|gamma|delta|theta|phi|psi)(?:_([A-Za-z0-9]+))?", name)
    return name if greek is None else rf"$\{greek[1]}_{{{greek[2] or ''}}}$"


@checked
def draw_joint_angles(top: Axes, side: Axes, robot: Robot, q: ArrayLike, leg: int) -> None:
    """Draw a leg's angles as in A Fig. 4: from above on ``top``, and in the leg's plane on ``side``.

    ``top`` shows the mounting angle and the first joint, ``side`` the second and third joint. ``q`` (L, 3) [rad] are
    the angles of all legs, ``leg`` is the index of the leg, from 0. The drawing is right for legs of paper A's kind,
    whose first axis is vertical and whose angles count from the direction of the mount and upwards. Raises
    InvalidInputError if ``q`` has another shape or the robot does not have the leg.
    """
    q = check_shape("q", q, (robot.num_legs, NUM_JOINTS), ("leg", "joint"))
    check_whole("leg", leg, at_most=robot.num_legs - 1)
    poses, foot = segment_poses(robot, q)[leg], forward_kinematics(robot, q)[leg]
    points = np.vstack([np.zeros(3), poses[:, :3, 3], foot]) * MM
    mount = float(np.arctan2(points[1, 1], points[1, 0]))
    _angle_arcs(top, points[:, :2], [0.0, mount], [mount, mount + q[leg, 0]], ("mount", robot.table.joints[0]))
    top.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[1:, :2], axis=0), axis=1))])
    plane = np.column_stack([along, points[1:, 2]])
    first = q[leg, 1]
    _angle_arcs(side, plane, [0.0, first], [first, first + q[leg, 2]], robot.table.joints[1:])
    side.set(xlabel="from the first joint along the leg [mm]", ylabel="height [mm]", aspect="equal")
    side.margins(0.1)


def _angle_arcs(ax: Axes, points: Array, starts: list[float], ends: list[float], names: Sequence[str]) -> None:
    """Draw the line through ``points`` (k, 2) [mm] and arcs at two corners: 0 and 1 with the mount, else 1 and 2."""
    ax.plot(*points.T, "k-", lw=2.5, zorder=2)
    ax.plot(*points[:-1].T, "o", color="w", mec="k", ms=8, zorder=3)
    ax.plot(*points[-1], "o", color="#404040", ms=10, zorder=3)
    corners = points[:2] if names[0] == "mount" else points[1:3]
    for corner, start, end, name, colour in zip(corners, starts, ends, names, (BLUE, RED), strict=True):
        arc = np.linspace(start, end, 40)
        ax.plot(corner[0] + 28 * np.cos(arc), corner[1] + 28 * np.sin(arc), color=colour)
        ax.plot(corner[0] + [0, 45 * np.cos(start)], corner[1] + [0, 45 * np.sin(start)], ":", color=colour)
        middle = (start + end) / 2
        text = r"$\theta_1$" if name == "mount" else _symbol(name)
        ax.text(
            corner[0] + 40 * np.cos(middle),
            corner[1] + 40 * np.sin(middle),
            text,
            color=colour,
            ha="center",
            va="center",
        )


@checked
def flow_chart(ax: Axes, steps: Mapping[str, tuple[float, float, str]], arrows: Sequence[tuple[str, str, str]]) -> None:
    """Draw a flow chart on ``ax``.

    ``steps`` gives for each name (x, y, text), with x and y from 0 to 1 across the axes; a text that ends in "?" gets
    the colour of a decision. ``arrows`` are (name, name, label), from the first step to the second. Raises
    InvalidInputError for a place outside the axes, and UnknownNameError for an arrow to or from an unknown step.
    """
    for name, (x, y, _) in steps.items():
        check_number(f"steps: {name}: x", x, at_least=0.0, at_most=1.0)
        check_number(f"steps: {name}: y", y, at_least=0.0, at_most=1.0)
    for name in (name for start, end, _ in arrows for name in (start, end)):
        if name not in steps:
            raise UnknownNameError("step", name, list(steps))
    ax.axis("off")
    ax.set(xlim=(0, 1), ylim=(0, 1))
    drawn = {}
    for name, (x, y, text) in steps.items():
        colour = "#fff3d6" if text.endswith("?") else "#e3eef7"
        drawn[name] = ax.text(
            x, y, text, ha="center", va="center", fontsize=8, zorder=3,
            bbox={"boxstyle": "round,pad=0.5", "facecolor": colour, "edgecolor": "k", "linewidth": 0.8},
        )  # fmt: skip
    ax.figure.canvas.draw()
    for start, end, label in arrows:
        (x0, y0, _), (x1, y1, _) = steps[start], steps[end]
        patches: list[FancyBboxPatch | None] = [drawn[start].get_bbox_patch(), drawn[end].get_bbox_patch()]
        ax.annotate(
            "", (x1, y1), (x0, y0),
            arrowprops={"arrowstyle": "-|>", "color": "k", "lw": 0.9, "patchA": patches[0], "patchB": patches[1]},
        )  # fmt: skip
        if label:
            ax.text((x0 + x1) / 2, (y0 + y1) / 2, label, fontsize=8, ha="center", va="center",
                    bbox={"facecolor": "w", "edgecolor": "none", "pad": 1})  # fmt: skip
