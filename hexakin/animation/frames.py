"""Frames of a GIF or MP4 file: PyBullet's software renderer draws the scene, and forces and traces are added.

The renderer needs no display. Polygon, ZMP and traces lie on the ground: they are drawn only at the pixels that show
ground, so that the robot hides them.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.spatial.transform import Rotation

from hexakin.animation.scene import ARROW, EDGE, FIELD_OF_VIEW, Part, Scene
from hexakin.checks import Array
from hexakin.engines.pybullet_engine import pybullet
from hexakin.exceptions import MissingPackageError, SimulationError
from hexakin.figures.style import GREEN, LEG_COLOURS, ORANGE, RED

_FINER = 1.5  # rendered pixels per pixel shown, along each side, for smooth edges; 2 takes twice as long
_LINE = 3  # [rendered px], width of traces and arrows
_LIGHT = {"lightAmbientCoeff": 0.55, "lightDiffuseCoeff": 0.5, "lightSpecularCoeff": 0.02, "lightDistance": 5.0}
_BACKGROUND = (226, 234, 241)


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
    try:
        for k in chosen:
            yield stage.picture(k).resize(size, Image.Resampling.HAMMING)
    finally:
        stage.close()


class _Stage:
    """A PyBullet world without physics. Its first bodies are the ground, and the robot's parts follow."""

    def __init__(self, scene: Scene, size: tuple[int, int]):
        self._scene, self._size = scene, size
        self._client = pybullet.connect(pybullet.DIRECT)
        try:
            for surface in scene.surfaces:
                self._body(
                    surface.colour,
                    shapeType=pybullet.GEOM_MESH,
                    vertices=surface.vertices.tolist(),
                    indices=surface.triangles.ravel().tolist(),
                    normals=_normals(surface.vertices, surface.triangles).tolist(),
                )
            self._parts = [self._part(part) for part in scene.parts]
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        pybullet.disconnect(physicsClientId=self._client)

    def _body(self, colour: str, **shape: Any) -> int:
        visual = pybullet.createVisualShape(rgbaColor=[*to_rgb(colour), 1.0], physicsClientId=self._client, **shape)
        return pybullet.createMultiBody(baseVisualShapeIndex=visual, physicsClientId=self._client)

    def _part(self, part: Part) -> int:
        if part.kind == "sphere":
            return self._body(part.colour, shapeType=pybullet.GEOM_SPHERE, radius=part.size[0] / 2.0)
        return self._body(part.colour, shapeType=pybullet.GEOM_BOX, halfExtents=(part.size / 2.0).tolist())

    def picture(self, k: int) -> Image.Image:
        """Return the picture of keyframe k."""
        scene, (width, height) = self._scene, self._size
        for part, body in zip(scene.parts, self._parts, strict=True):
            T = scene.T_world_body[k]
            if part.node is not None:
                T = T @ scene.T_body_segment[k, part.node[0], part.node[1]]
            T = T @ part.T_node_part
            quat_xyzw = Rotation.from_matrix(T[:3, :3]).as_quat()
            pybullet.resetBasePositionAndOrientation(
                body, T[:3, 3].tolist(), quat_xyzw.tolist(), physicsClientId=self._client
            )
        center, far = scene.center[k], 10.0 * float(np.linalg.norm(scene.eye))
        view = pybullet.computeViewMatrix((center + scene.eye).tolist(), center.tolist(), [0.0, 0.0, 1.0])
        lens = pybullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, width / height, far / 500.0, far)
        _, _, colours, _, mask = pybullet.getCameraImage(
            width,
            height,
            view,
            lens,
            lightDirection=[0.6, -0.4, 2.0],
            shadow=1,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
            **_LIGHT,
        )
        image = np.asarray(colours, dtype=np.uint8).reshape(height, width, 4)[..., :3].copy()
        ids = np.asarray(mask).reshape(height, width)
        image[ids < 0] = _BACKGROUND
        camera = np.reshape(lens, (4, 4), order="F") @ np.reshape(view, (4, 4), order="F")
        picture, on_ground = Image.fromarray(image), Image.fromarray(ids < (self._parts[0]))
        flat = picture.copy()
        self._draw_on_ground(ImageDraw.Draw(flat, "RGBA"), k, camera)
        picture.paste(flat, mask=on_ground)
        self._draw_over(ImageDraw.Draw(picture, "RGBA"), k, camera)
        return picture

    def _pixels(self, points: Array, camera: Array) -> list[tuple[float, float]]:
        """Return the places (k, 2) [px] of points (k, 3) [m]."""
        p = np.column_stack([points, np.ones(len(points))]) @ camera.T
        place = (p[:, :2] / p[:, 3:] * [0.5, -0.5] + 0.5) * self._size
        return [(float(x), float(y)) for x, y in place]

    def _draw_on_ground(self, draw: ImageDraw.ImageDraw, k: int, camera: Array) -> None:
        scene, thick = self._scene, _LINE
        polygon = None if scene.polygon is None else scene.polygon[k]
        if polygon is not None:
            corners = self._pixels(polygon, camera)
            draw.polygon(corners, fill=_rgba(ORANGE, 0.35))
            draw.line([*corners, corners[0]], fill=_rgba(EDGE, 0.9), width=thick // 2)
        for leg in range(scene.robot.num_legs):
            colour = LEG_COLOURS[leg % len(LEG_COLOURS)]
            if scene.ground_path is not None:
                draw.line(self._pixels(scene.ground_path[:, leg], camera), fill=_rgba(colour, 0.6), width=thick // 2)
            if scene.traces and k > 0:
                draw.line(self._pixels(scene.p_foot[: k + 1, leg], camera), fill=_rgba(colour, 1.0), width=thick)
        if scene.zmp is not None and np.isfinite(scene.zmp[k]).all():
            self._dot(draw, scene.zmp[k], _rgba(GREEN, 1.0), 3 * thick, camera)

    def _draw_over(self, draw: ImageDraw.ImageDraw, k: int, camera: Array) -> None:
        scene, thick = self._scene, _LINE
        for leg in range(scene.robot.num_legs):
            if scene.held[k, leg]:
                self._dot(draw, scene.p_target[k, leg], _rgba(RED, 0.7), 4 * thick, camera)
            if scene.force is not None and scene.force[k, leg] > 0.0:
                along = scene.force[k, leg] / scene.newtons_per_metre * scene.normal[k, leg]
                foot, tip = np.array(self._pixels(scene.p_contact[k, leg] + np.outer([0.0, 1.0], along), camera))
                way = (tip - foot) / max(float(np.linalg.norm(tip - foot)), 1e-9) * 2.5 * thick
                side = 0.5 * np.array([-way[1], way[0]])
                draw.line([*foot, *tip], fill=_rgba(ARROW, 0.9), width=thick + 1)
                draw.polygon([tuple(tip + way), tuple(tip + side), tuple(tip - side)], fill=_rgba(ARROW, 0.9))

    def _dot(self, draw: ImageDraw.ImageDraw, p: Array, colour: tuple[int, ...], radius: int, camera: Array) -> None:
        ((x, y),) = self._pixels(p[None], camera)
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colour)


def _rgba(colour: str, opacity: float) -> tuple[int, ...]:
    return tuple(round(255 * share) for share in (*to_rgb(colour), opacity))


def _normals(vertices: Array, triangles: NDArray[np.int_]) -> Array:
    """Return the unit normal (v, 3) at each vertex: the normal of its face, since faces do not share vertices."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    result = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    for corner in range(3):
        result[triangles[:, corner]] = normal
    return result


__all__ = ["instants", "write_gif", "write_mp4"]
