"""Pictures that move: a recording, a plan or a `Motion` as a page, in a notebook, as a GIF or as an MP4 file.

::

    walk = hk.simulate(robot, terrain, controller)
    hk.animation.animate(robot, walk, terrain).save("walk.html")

The page is one file that opens offline; it needs the package meshcat, a GIF does not.
"""

from __future__ import annotations

import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hexakin.animation.page import page_of
from hexakin.animation.scene import SHOWN, Scene, make_scene
from hexakin.checks import check_number, check_whole
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.motion.motion import Motion
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.robot.model import Robot
from hexakin.terrain.base import Terrain
from hexakin.terrain.leg_curves import LegCurves

__all__ = ["Animation", "animate"]

_HEIGHT = 480  # [px] of an animation in a notebook


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

    Raises InvalidInputError for a motion of another robot, of fewer than two instants, whose time does not ascend, or
    with a leg that has no angles throughout, and for arguments out of their range; UnknownNameError for an unknown
    terrain or name in ``show``.

    Parameters
    ----------
    robot
        The robot that moves.
    motion
        What it did, plans or is told: a recording, a plan or a `hexakin.feasibility.Motion`, of at least two instants.
    terrain
        The ground, of which the surroundings of the walk are shown. None, or paper B's curves, which have no surface,
        leave it out; the ground that a plan says is below each foot is then a line.
    speed
        How much faster than it is the walk is shown; 0.5 is half as fast. The page has a control for it.
    follow
        Whether the camera goes along. In the page it can be turned, moved and zoomed with the mouse in either case.
    show
        Any of ``"forces"`` (normal forces as arrows along the ground's normal) and ``"zmp"`` (A(32)), which only a
        recording knows; ``"polygon"``, the support polygon of the feet that the ground carries; ``"traces"``, the paths
        of the feet so far.

    Returns
    -------
    Animation
        Legs are coloured as in the figures. A leg without angles, because its foot is out of reach, stays in its last
        pose, a red ball marks where the foot should be, and the page's heading says when.
    """
    factor = check_number("speed", speed, above=0.0)
    if not isinstance(follow, bool):
        raise InvalidInputError(f"follow: expected True or False, got {follow!r:.80}")
    return Animation(make_scene(robot, motion, terrain, show, follow), factor, follow)


@dataclass(frozen=True, eq=False)
class Animation:
    """What `animate` returns: save it, or let a notebook show it."""

    scene: Scene
    speed: float
    follow: bool

    def __repr__(self) -> str:
        return f"<Animation of {self.scene.title}, {self.scene.time[-1] - self.scene.time[0]:.3g} s>"

    def html(self) -> str:
        """Return the page: one HTML document without any other file; raises MissingPackageError without meshcat."""
        return page_of(self.scene, self.speed, self.follow)

    def save(
        self, path: str | os.PathLike[str], *, frame_rate: float = 10.0, size: tuple[int, int] = (640, 480)
    ) -> Path:
        """Write ``.html``, ``.gif`` or ``.mp4``, as ``path`` ends, and return where; it appears whole or not at all.

        ``frame_rate`` [1/s] and ``size`` (width, height) [px], even numbers, are those of a GIF or MP4 file: its
        frames show the instants k * speed / frame_rate after the start, up to the end.

        Raises MissingPackageError: a page needs meshcat, an MP4 file the encoder ffmpeg; UnknownNameError for another
        ending; InvalidInputError for a folder that does not exist or numbers out of their range.
        """
        target = Path(path)
        ending = target.suffix.lower()
        if ending not in (".html", ".gif", ".mp4"):
            raise UnknownNameError("format", ending, [".html", ".gif", ".mp4"])
        if not target.parent.is_dir():
            raise InvalidInputError(f"path: the folder {target.parent} of {target.name} does not exist")
        check_number("frame_rate", frame_rate, above=0.0, at_most=50.0, unit="1/s")
        if not isinstance(size, tuple) or len(size) != 2:
            raise InvalidInputError(f"size: expected (width, height), got {size!r:.80}")
        for name, pixels in zip(("width", "height"), size, strict=True):
            if check_whole(f"size: {name}", pixels, at_least=32) % 2:
                raise InvalidInputError(f"size: {name}: {pixels}, expected an even number")
        temporary = target.with_name(f".{target.stem}.{os.getpid()}.part{ending}")
        try:
            if ending == ".html":
                temporary.write_text(self.html(), encoding="utf-8")
            else:
                from hexakin.animation.frames import write_gif, write_mp4  # loads PyBullet

                write = write_gif if ending == ".gif" else write_mp4
                write(temporary, self.scene, self.speed, frame_rate, size)
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
        return target

    def _repr_html_(self) -> str:
        """Show the page in a notebook, in a frame of its own."""
        style = f"width: 100%; height: {_HEIGHT}px; border: 1px solid #ccc"
        return f'<iframe srcdoc="{html.escape(self.html())}" style="{style}" title="animation"></iframe>'
