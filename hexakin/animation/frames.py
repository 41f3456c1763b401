"""Frames of a GIF or MP4 file: a picture of the scene for each instant, with forces, polygon, ZMP and traces.

Polygon, ZMP and traces lie on the ground: they are drawn only at the pixels that show ground, so that the robot hides
them.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image, ImageDraw

from hexakin.animation.renderer import Camera, box, looking_at, picture, sphere
from hexakin.animation.scene import ARROW, EDGE, FIELD_OF_VIEW, Part, Scene
from hexakin.checks import Array
from hexakin.exceptions import MissingPackageError, SimulationError
from hexakin.figures.style import GREEN, LEG_COLOURS, ORANGE, RED
from hexakin.transforms import transform_points

_FINER = 1.5  # rendered pixels per pixel shown, along each side, for smooth edges; 2 takes twice as long
_LINE = 3  # [rendered px], width of traces and arrows
_NEAREST = 0.05  # share of the camera's distance; lines that come closer to the camera's plane are not drawn
_BACKGROUND = np.array([0.886, 0.918, 0.945])


def instants(scene: Scene, speed: float, frame_rate: float) -> list[int]:
    """Return for each frame the index of its keyframe: the keyframe that is nearest to its instant.

    ``speed`` is the walk's speed as a multiple of the real speed; ``frame_rate`` [1/s].
    """
    span = scene.time[-1] - scene.time[0]
    shown = scene.time[0] + np.arange(int(np.floor(span * frame_rate / speed + 1e-9)) + 1) * speed / frame_rate
    after = np.clip(np.searchsorted(scene.time, shown), 1, len(scene.time) - 1)
    nearer = shown - scene.time[after - 1] < scene.time[after] - shown
    return [int(k) for k in after - nearer]


def write_gif(path: Path, scene: Scene, speed: float, frame_rate: float, size: tuple[int, int]) -> None:
    """Write a GIF that repeats without end; all its frames have the 256 colours of the middle frame.

    ``frame_rate`` [1/s]; ``size`` (width, height) [px].
    """
    chosen = instants(scene, speed, frame_rate)
    (middle,) = _images(scene, [chosen[len(chosen) // 2]], size)
    palette = middle.quantize(256, kmeans=3)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in _images(scene, chosen, size)]
    images[0].save(path, save_all=True, append_images=images[1:], duration=round(1000.0 / frame_rate), loop=0)


def write_mp4(path: Path, scene: Scene, speed: float, frame_rate: float, size: tuple[int, int]) -> None:
    """Write an MP4 file with ffmpeg.

    ``frame_rate`` [1/s]; ``size`` (width, height) [px], even numbers. Raises MissingPackageError without ffmpeg and
    SimulationError if it fails.
    """
    command = [_encoder(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{size[0]}x{size[1]}", "-r", f"{frame_rate:g}", "-i", "-", "-an", "-pix_fmt", "yuv420p"]
    command += ["-movflags", "+faststart", str(path)]
    with tempfile.TemporaryFile() as messages:
        encoder = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=messages)
        assert encoder.stdin is not None  # because of stdin=PIPE
        try:
            with contextlib.suppress(BrokenPipeError):  # ffmpeg has ended; its message gives the reason
                for image in _images(scene, instants(scene, speed, frame_rate), size):
                    encoder.stdin.write(image.tobytes())
            with contextlib.suppress(BrokenPipeError):
                encoder.stdin.close()
            encoder.wait()
        finally:
            encoder.kill()
            encoder.wait()
        if encoder.returncode != 0:
            messages.seek(0)
            raise SimulationError(f"ffmpeg could not write {path.name}: {messages.read().decode(errors='replace')}")


def _encoder() -> str:
    """Return the path of ffmpeg: from the PATH, otherwise from the package imageio-ffmpeg."""
    if found := shutil.which("ffmpeg"):
        return found
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingPackageError("imageio-ffmpeg", "an MP4 file", "pip install imageio-ffmpeg") from error
    return str(imageio_ffmpeg.get_ffmpeg_exe())


def _images(scene: Scene, chosen: list[int], size: tuple[int, int]) -> Iterator[Image.Image]:
    """Yield the pictures of the chosen keyframes."""
    stage = _Stage(scene, (round(_FINER * size[0]), round(_FINER * size[1])))
    for k in chosen:
        yield stage.picture(k).resize(size, Image.Resampling.HAMMING)


class _Stage:
    """The triangles of the ground and of the robot's parts, which move from picture to picture."""

    def __init__(self, scene: Scene, size: tuple[int, int]):
        self._scene, self._size = scene, size
        ground = [surface.vertices[surface.triangles] for surface in scene.surfaces]
        self._ground = np.concatenate([*ground, np.empty((0, 3, 3))])
        self._parts = [box(part.size) if part.kind == "box" else sphere(part.size[0]) for part in scene.parts]
        colour = [surface.colour for surface in scene.surfaces] + [part.colour for part in scene.parts]
        counts = [len(triangles) for triangles in (*ground, *self._parts)]
        self._colours = np.repeat([to_rgb(name) for name in colour], counts, axis=0)
        self._moves = np.arange(len(self._colours)) >= len(self._ground)

    def picture(self, k: int) -> Image.Image:
        """Return the picture of keyframe k."""
        scene = self._scene
        placed = [
            transform_points(self._pose(k, part), corners.reshape(-1, 3)).reshape(-1, 3, 3)
            for part, corners in zip(scene.parts, self._parts, strict=True)
        ]
        corners = np.concatenate([self._ground, *placed])
        camera = looking_at(scene.center[k], scene.center[k] + scene.eye, np.radians(FIELD_OF_VIEW), self._size)
        image, triangle = picture(camera, corners, self._colours, self._moves, _BACKGROUND)
        shown, on_ground = Image.fromarray(image), Image.fromarray(triangle < len(self._ground))
        flat = shown.copy()
        self._draw_on_ground(ImageDraw.Draw(flat, "RGBA"), k, camera)
        shown.paste(flat, mask=on_ground)
        self._draw_over(ImageDraw.Draw(shown, "RGBA"), k, camera)
        return shown

    def _pose(self, k: int, part: Part) -> Array:
        T = self._scene.T_world_body[k]
        if part.node is not None:
            T = T @ self._scene.T_body_segment[k, part.node[0], part.node[1]]
        return T @ part.T_node_part

    def _lines(self, points: Array, camera: Camera) -> list[list[tuple[float, float]]]:
        """Return the lines through points (k, 3) [m], as places [px]: one for each run of points before the camera."""
        x, y, z = camera.local(points).T
        before = z > _NEAREST * float(np.linalg.norm(self._scene.eye))
        runs = np.split(np.arange(len(z)), np.flatnonzero(np.diff(before)) + 1)
        middle = 0.5 * np.array(self._size)
        places = [middle + np.column_stack([x[run], y[run]]) / z[run, None] for run in runs if before[run[0]]]
        return [[(float(u), float(v)) for u, v in place] for place in places]

    def _draw_on_ground(self, draw: ImageDraw.ImageDraw, k: int, camera: Camera) -> None:
        scene, thick = self._scene, _LINE
        polygon = None if scene.polygon is None else scene.polygon[k]
        if polygon is not None:
            for edge in self._lines(polygon[[*range(len(polygon)), 0]], camera):
                if len(edge) > len(polygon):
                    draw.polygon(edge, fill=_rgba(ORANGE, 0.35))
                draw.line(edge, fill=_rgba(EDGE, 0.9), width=thick // 2)
        for leg in range(scene.robot.num_legs):
            colour = LEG_COLOURS[leg % len(LEG_COLOURS)]
            if scene.ground_path is not None:
                for line in self._lines(scene.ground_path[:, leg], camera):
                    draw.line(line, fill=_rgba(colour, 0.6), width=thick // 2)
            if scene.traces:
                for line in self._lines(scene.p_foot[: k + 1, leg], camera):
                    draw.line(line, fill=_rgba(colour, 1.0), width=thick)
        if scene.zmp is not None and np.isfinite(scene.zmp[k]).all():
            self._dot(draw, scene.zmp[k], _rgba(GREEN, 1.0), 3 * thick, camera)

    def _draw_over(self, draw: ImageDraw.ImageDraw, k: int, camera: Camera) -> None:
        scene, thick = self._scene, _LINE
        for leg in range(scene.robot.num_legs):
            if scene.held[k, leg]:
                self._dot(draw, scene.p_target[k, leg], _rgba(RED, 0.7), 4 * thick, camera)
            if scene.force is not None and scene.force[k, leg] > 0.0:
                along = scene.force[k, leg] / scene.newtons_per_metre * scene.normal[k, leg]
                arrow = self._lines(scene.p_contact[k, leg] + np.outer([0.0, 1.0], along), camera)
                for foot, tip in (np.array(line) for line in arrow if len(line) == 2):
                    way = (tip - foot) / max(float(np.linalg.norm(tip - foot)), 1e-9) * 2.5 * thick
                    side = 0.5 * np.array([-way[1], way[0]])
                    draw.line([*foot, *tip], fill=_rgba(ARROW, 0.9), width=thick + 1)
                    draw.polygon([tuple(tip + way), tuple(tip + side), tuple(tip - side)], fill=_rgba(ARROW, 0.9))

    def _dot(self, draw: ImageDraw.ImageDraw, p: Array, colour: tuple[int, ...], radius: int, camera: Camera) -> None:
        for ((x, y),) in self._lines(p[None], camera):
            draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colour)


def _rgba(colour: str, opacity: float) -> tuple[int, ...]:
    return tuple(round(255 * share) for share in (*to_rgb(colour), opacity))


__all__ = ["instants", "write_gif", "write_mp4"]
