"""Animate a recording, a plan or a `Motion`: as an HTML page, in a notebook, as a GIF or as an MP4 file.

::

    walk = hk.simulate(robot, terrain, controller)
    hk.animation.animate(robot, walk, terrain).save("walk.html")

The page is one file that opens without a network. To make it, the package meshcat is needed; a GIF does not need it.
"""

from __future__ import annotations

import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hexakin.animation.page import page_of
from hexakin.animation.scene import SHOWN, Scene, make_scene
from hexakin.checks import check_number, check_path, check_whole, checked
from hexakin.checks.files import whole_file
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.motion.motion import Motion
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain
from hexakin.terrain.leg_curves import LegCurves

__all__ = ["Animation", "animate"]

_HEIGHT = 480  # [px], height of an animation in a notebook
_MOST_PIXELS = 3840 * 2160  # of a frame; drawing one takes 1.4 GB of memory
_MOST_FRAMES = 100_000  # nearly three hours at 10 frames per second; drawing them takes longer
_MOST_IN_GIF = 2 * 10**9  # [px] of all frames, which are in memory, one byte each, until a GIF is written


@checked
def animate(
    robot: Robot,
    motion: Recording | WalkPlan | Motion,
    terrain: Terrain | LegCurves | None,
    *,
    speed: float = 1.0,
    follow: bool = True,
    show: Sequence[str] = SHOWN,
) -> Animation:
    """Animate a walk.

    Raises InvalidInputError if the motion is one of another robot, has fewer than two instants, a time that does not
    ascend or a leg without angles at all instants, or if an argument is out of its range; UnknownNameError for an
    unknown terrain or an unknown name in ``show``.

    Parameters
    ----------
    robot
        The robot that moves.
    motion
        A recording, a plan or a `hexakin.feasibility.Motion`, with at least two instants.
    terrain
        The ground, which is shown around the walk. With None, or with paper B's curves, which have no surface, no
        ground is shown; if a plan contains the ground's height below the feet, lines show it.
    speed
        The walk's speed in the animation, as a multiple of the real speed: 0.5 is half as fast. The page has a control
        for it.
    follow
        Whether the camera follows the robot. In the page, the mouse can turn, move and zoom the view in both cases.
    show
        Any of ``"forces"`` (normal forces, as arrows along the ground's normal) and ``"zmp"`` (zero-moment point,
        A(32)), which only recordings contain; ``"polygon"``, the support polygon of the feet that carry load;
        ``"traces"``, the paths of the feet up to the instant shown.

    Returns
    -------
    Animation
        Legs have the same colours as in the figures. A leg without angles, whose foot is out of reach, keeps its last
        pose; a red ball shows where the foot should be, and the heading of the page names the instants.
    """
    return Animation(make_scene(robot, motion, terrain, show, follow), speed, follow)


@checked
@dataclass(frozen=True, eq=False)
class Animation:
    """An animation, as `animate` returns it: a notebook shows it, and `save` writes it to a file.

    ``scene`` contains all that is shown; ``speed`` is the walk's speed in the animation, as a multiple of the real
    speed; ``follow`` is whether the camera follows the robot. Raises InvalidInputError for a speed out of its range.
    """

    scene: Scene
    speed: float
    follow: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "speed", check_number("speed", self.speed, at_least=1e-3, at_most=1e3))

    def __repr__(self) -> str:
        return f"<Animation of {self.scene.title}, {self.scene.time[-1] - self.scene.time[0]:.3g} s>"

    def html(self) -> str:
        """Return the page: one HTML document that needs no other file. Raises MissingPackageError without meshcat."""
        return page_of(self.scene, self.speed, self.follow)

    @checked
    def save(
        self, path: str | os.PathLike[str], *, frame_rate: float = 10.0, size: tuple[int, int] = (640, 480)
    ) -> Path:
        """Write the animation to a file and return its path; the ending of ``path`` is .html, .gif or .mp4.

        ``frame_rate`` [1/s] and ``size`` (width, height) [px], two even numbers, are for GIF and MP4 files, whose
        frames show the instants k * speed / frame_rate after the start, up to the end. If writing fails, no file is
        left, and a file that was there before stays as it was.

        Raises MissingPackageError (a page needs meshcat, an MP4 file the encoder ffmpeg), UnknownNameError for another
        ending, FileError if the file cannot be written, and InvalidInputError if ``path`` is no path, a number is out
        of its range, or frames are too large (3840 x 2160 pixels) or too many for the memory. SimulationError is raised
        if ffmpeg fails.
        """
        target = check_path("path", path)
        ending = target.suffix.lower()
        if ending not in (".html", ".gif", ".mp4"):
            raise UnknownNameError("format", ending, [".html", ".gif", ".mp4"])
        check_number("frame_rate", frame_rate, at_least=0.1, at_most=50.0, unit="1/s")
        for name, pixels in zip(("width", "height"), size, strict=True):
            if check_whole(f"size: {name}", pixels, at_least=32) % 2:
                raise InvalidInputError(f"size: {name}: {pixels}, expected an even number")
        size = (int(size[0]), int(size[1]))
        if ending != ".html":
            self._check_frames(ending, frame_rate, size)
        with whole_file(target) as temporary:
            if ending == ".html":
                temporary.write_text(self.html(), encoding="utf-8")
            else:
                from hexakin.animation.frames import write_gif, write_mp4

                write = write_gif if ending == ".gif" else write_mp4
                write(temporary, self.scene, self.speed, frame_rate, size)
        return target

    def _check_frames(self, ending: str, frame_rate: float, size: tuple[int, int]) -> None:
        """Raise InvalidInputError for frames that are too large or too many."""
        pixels = size[0] * size[1]
        if pixels > _MOST_PIXELS:
            raise InvalidInputError(f"size: {size}, {pixels:.3g} pixels, expected at most {_MOST_PIXELS}")
        frames = float(self.scene.time[-1] - self.scene.time[0]) * frame_rate / self.speed
        if frames > _MOST_FRAMES:
            raise InvalidInputError(
                f"frame_rate: {frame_rate:g} 1/s at a speed of {self.speed:g} makes {frames:.3g} frames, expected at "
                f"most {_MOST_FRAMES}"
            )
        if ending == ".gif" and frames * pixels > _MOST_IN_GIF:
            raise InvalidInputError(
                f"size, frame_rate: {frames:.3g} frames of {size} pixels do not fit into a GIF, whose frames may have "
                f"{_MOST_IN_GIF:.1g} pixels together; an MP4 file may be longer"
            )

    def _repr_html_(self) -> str:
        """Return the page in a frame, for a notebook."""
        style = f"width: 100%; height: {_HEIGHT}px; border: 1px solid #ccc"
        return f'<iframe srcdoc="{html.escape(self.html())}" style="{style}" title="animation"></iframe>'
