"""A scene as one HTML file: meshcat's viewer, its commands, and controls to play, pause and move in time.

The viewer is a JavaScript file in the meshcat package. It is read without an import of the package, because an import
would load IPython and ZeroMQ, and ``Visualizer`` would start a server, which the page does not need. The commands are
those of meshcat's protocol (https://github.com/meshcat-dev/meshcat), as JSON.
"""

from __future__ import annotations

import html
import importlib.util
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hexakin.animation.scene import ARROW, EDGE, FIELD_OF_VIEW, Part, Scene
from hexakin.checks import Array
from hexakin.exceptions import MissingPackageError
from hexakin.figures.style import GREEN, LEG_COLOURS, ORANGE, RED
from hexakin.kinematics.forward import standing_height
from hexakin.robot.model import SEGMENT_NAMES
from hexakin.transforms import rotation_between

_TEMPLATE = Path(__file__).with_name("page.html")
_DIGITS = 5  # decimals of lengths [m] and quaternions in the page
_DISCRETE = 2300  # in three.js: the value of a track stays until the next keyframe
_UP = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]  # y axis of three.js upwards


def page_of(scene: Scene, speed: float, follow: bool) -> str:
    """Return the page of a scene, as HTML.

    ``speed`` is a multiple of the real speed; with ``follow`` the camera follows the robot. Raises MissingPackageError
    without meshcat.
    """
    content = {
        "time": _plain(scene.time - scene.time[0]),
        "start": float(scene.time[0]),
        "commands": [*_robot(scene), *_ground(scene), *_overlays(scene)],
        "animations": [*_moving_robot(scene), *_moving_overlays(scene)],
        "eye": _plain(scene.eye),
        "field_of_view": FIELD_OF_VIEW,
        "radius": round(float(np.linalg.norm(scene.eye)) / 3.0, _DIGITS),
        "speed": speed,
        "follow": follow,
    }
    legs = "".join(
        f'<b style="color:{LEG_COLOURS[leg % len(LEG_COLOURS)]}">{leg + 1}</b>' for leg in range(scene.robot.num_legs)
    )
    notes = "".join(f"<br>{html.escape(note)}" for note in scene.notes)
    page = _TEMPLATE.read_text(encoding="utf-8")
    for name, text in {
        "title": html.escape(scene.title),
        "legs": legs,
        "notes": notes,
        "content": json.dumps(content, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"),
        "viewer": _viewer(),
    }.items():
        page = page.replace(f"@{name}@", text)
    return page


def _viewer() -> str:
    """Return the source code of meshcat's viewer."""
    found = importlib.util.find_spec("meshcat")
    folders = [] if found is None else found.submodule_search_locations or []
    for folder in folders:
        bundle = Path(folder) / "viewer" / "dist" / "main.min.js"
        if bundle.is_file():
            return bundle.read_text(encoding="utf-8").replace("</script", "<\\/script")
    raise MissingPackageError("meshcat", "an animation in a page", "pip install meshcat")


def _plain(values: ArrayLike) -> list:
    """Return rounded numbers for JSON; -0 becomes 0."""
    return (np.round(np.asarray(values, dtype=float), _DIGITS) + 0.0).tolist()


def _flat(values: ArrayLike) -> list:
    return _plain(np.ravel(values))


def _colour(name: str) -> int:
    return int(name.lstrip("#"), 16)


def _object(
    path: str, geometry: dict[str, Any], colour: str, kind: str = "Mesh", order: int = 0, **material: Any
) -> dict[str, Any]:
    """Return the command that adds an object to the viewer's tree; objects of higher ``order`` are drawn later.

    The viewer draws objects that are marked ``transparent`` after all others, even if their opacity is 1.
    """
    look = {"type": "MeshPhongMaterial", "color": _colour(colour), "shininess": 12, "side": 2} | material
    return {
        "type": "set_object",
        "path": path,
        "object": {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [geometry | {"uuid": f"{path}#geometry"}],
            "materials": [look | {"uuid": f"{path}#material"}],
            "object": {
                "uuid": path,
                "type": kind,
                "renderOrder": order,
                "geometry": f"{path}#geometry",
                "material": f"{path}#material",
                # In three.js the axis of a cylinder is y.
                "matrix": _UP if "Cylinder" in geometry["type"] else np.eye(4).ravel().tolist(),
            },
        },
    }


def _mesh(vertices: Array, triangles: ArrayLike | None = None) -> dict[str, Any]:
    data: dict[str, Any] = {
        "attributes": {"position": {"itemSize": 3, "type": "Float32Array", "array": _flat(vertices)}}
    }
    if triangles is not None:
        data["index"] = {"type": "Uint32Array", "array": np.ravel(triangles).tolist()}
    return {"type": "BufferGeometry", "data": data}


def _sphere(radius: float) -> dict[str, Any]:
    return {"type": "SphereGeometry", "radius": round(radius, _DIGITS), "widthSegments": 20, "heightSegments": 14}


def _animation(path: str, **tracks: tuple[str, ArrayLike]) -> dict[str, Any]:
    """Return the tracks of one node, given as property = (kind, values); their times are the page's ``time``."""
    made = []
    for name, (kind, values) in tracks.items():
        numbers = np.asarray(values)
        track: dict[str, Any] = {"name": f".{name.replace('__', '.')}", "type": kind}
        track["values"] = numbers.tolist() if numbers.dtype.kind in "bi" else _flat(numbers)
        if kind in ("count", "start"):
            track |= {"name": f".drawRange[{kind}]", "type": "number", "interpolation": _DISCRETE}
        made.append(track)
    return {"path": path, "clip": {"name": path, "fps": 1, "tracks": made}}


def _posed(path: str, position: ArrayLike, rotation: Array, **more: tuple[str, ArrayLike]) -> dict[str, Any]:
    """Return the animation of poses: ``position`` (n, 3) [m], ``rotation`` (n, 3, 3)."""
    quat_xyzw = Rotation.from_matrix(rotation).as_quat()
    return _animation(path, position=("vector3", position), quaternion=("quaternion", quat_xyzw), **more)


def _node(part: Part) -> str:
    return "/robot" if part.node is None else f"/robot/leg {part.node[0] + 1}/{SEGMENT_NAMES[part.node[1]]}"


def _robot(scene: Scene) -> Iterable[dict[str, Any]]:
    for part in scene.parts:
        path = f"{_node(part)}/{part.name}"
        box = dict(zip(("width", "height", "depth"), _plain(part.size), strict=True))
        sphere = part.kind == "sphere"
        shape = _sphere(part.size[0] / 2.0) if sphere else {"type": "BoxGeometry"} | box
        yield _object(path, shape, part.colour, order=3, transparent=True)
        yield {"type": "set_transform", "path": path, "matrix": _flat(part.T_node_part.T)}


def _moving_robot(scene: Scene) -> Iterable[dict[str, Any]]:
    yield _animation("/center", position=("vector3", scene.center))
    yield _posed("/robot", scene.T_world_body[:, :3, 3], scene.T_world_body[:, :3, :3])
    for leg in range(scene.robot.num_legs):
        for k, name in enumerate(SEGMENT_NAMES):
            T = scene.T_body_segment[:, leg, k]
            yield _posed(f"/robot/leg {leg + 1}/{name}", T[:, :3, 3], T[:, :3, :3])


def _ground(scene: Scene) -> Iterable[dict[str, Any]]:
    for k, surface in enumerate(scene.surfaces):
        yield _object(f"/ground/{k + 1}", _mesh(surface.vertices, surface.triangles), surface.colour, shininess=0)
    if scene.ground_path is not None:
        for leg in range(scene.robot.num_legs):
            colour = LEG_COLOURS[leg % len(LEG_COLOURS)]
            line = _mesh(scene.ground_path[:, leg])
            yield _object(f"/overlay/ground/leg {leg + 1}", line, colour, "Line", type="LineBasicMaterial")


def _overlays(scene: Scene) -> Iterable[dict[str, Any]]:
    size = 0.16 * standing_height(scene.robot)
    flat: dict[str, Any] = {"type": "MeshBasicMaterial"}
    # Drawn over the ground even if it is rough, and before the robot, which hides it.
    painted: dict[str, Any] = {"transparent": True, "depthTest": False, "depthWrite": False, "order": 1}
    over = flat | painted | {"opacity": 0.85, "order": 4}  # drawn over the legs, which are at the same place
    for leg in range(scene.robot.num_legs):
        name, colour = f"leg {leg + 1}", LEG_COLOURS[leg % len(LEG_COLOURS)]
        if scene.force is not None:
            thin, tip = 0.22 * size, 0.55 * size
            shaft = {"type": "CylinderGeometry", "radiusTop": thin, "radiusBottom": thin, "height": 1.0}
            head = {"type": "CylinderGeometry", "radiusTop": 0.0, "radiusBottom": tip, "height": 2.5 * tip}
            yield _object(f"/overlay/forces/{name}/shaft", shaft | {"radialSegments": 16}, ARROW, **over)
            yield _object(f"/overlay/forces/{name}/head", head | {"radialSegments": 24}, ARROW, **over)
        if scene.traces:
            ribbon = _ribbon(scene.p_foot[:, leg], 0.12 * size)
            yield _object(f"/overlay/traces/{name}", ribbon, colour, order=2, transparent=True, **flat)
        if scene.held[:, leg].any():
            yield _object(f"/overlay/out of reach/{name}", _sphere(1.5 * size), RED, **over | {"opacity": 0.6})
    if scene.polygon is not None and any(p is not None for p in scene.polygon):
        fans = [np.stack([np.broadcast_to(p[0], p[1:-1].shape), p[1:-1], p[2:]], axis=1) for p in _shown(scene)]
        edges = [np.stack([p, np.roll(p, -1, axis=0)], axis=1) for p in _shown(scene)]
        yield _object("/overlay/polygon/area", _mesh(np.concatenate(fans)), ORANGE, opacity=0.35, **painted, **flat)
        line = _mesh(np.concatenate(edges))
        yield _object("/overlay/polygon/edge", line, EDGE, "LineSegments", type="LineBasicMaterial", **painted)
    if scene.zmp is not None:
        yield _object("/overlay/zmp", _sphere(0.6 * size), GREEN, **flat | painted | {"order": 2})


def _shown(scene: Scene) -> list[Array]:
    return [p for p in scene.polygon or () if p is not None]


def _ribbon(path: Array, half: float) -> dict[str, Any]:
    """Return two crossed ribbons along a path (n, 3) [m]; each step has twelve indices, so that a part can be drawn."""
    way = path[-1] - path[0]
    across = np.array([-way[1], way[0], 0.0]) / max(float(np.hypot(way[0], way[1])), 1e-9)
    offsets = half * np.array([across, -across, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    first = 4 * np.arange(len(path) - 1)[:, None]
    return _mesh(path[:, None] + offsets, first + [0, 1, 4, 1, 5, 4, 2, 3, 6, 3, 7, 6])


def _moving_overlays(scene: Scene) -> Iterable[dict[str, Any]]:
    n = len(scene.time)
    for leg in range(scene.robot.num_legs):
        name = f"leg {leg + 1}"
        if scene.force is not None:
            at, normal = scene.p_contact[:, leg], scene.normal[:, leg]
            long = scene.force[:, leg, None] / scene.newtons_per_metre
            seen, turned = ("bool", long[:, 0] > 0.0), rotation_between([0.0, 0.0, 1.0], normal)
            grown = np.concatenate([np.ones((n, 2)), np.maximum(long, 1e-3)], axis=1)
            path = f"/overlay/forces/{name}"
            yield _posed(f"{path}/shaft", at + 0.5 * long * normal, turned, scale=("vector3", grown), visible=seen)
            yield _posed(f"{path}/head", at + long * normal, turned, visible=seen)
        if scene.traces:
            yield _animation(f"/overlay/traces/{name}/<object>", count=("count", 12 * np.arange(n)))
        if scene.held[:, leg].any():
            path = f"/overlay/out of reach/{name}"
            yield _animation(path, position=("vector3", scene.p_target[:, leg]), visible=("bool", scene.held[:, leg]))
    if scene.polygon is not None and _shown(scene):
        corners = np.array([0 if p is None else len(p) for p in scene.polygon])
        for part, count in (("area", 3 * np.maximum(corners - 2, 0)), ("edge", 2 * corners)):
            start = np.cumsum(count) - count
            path = f"/overlay/polygon/{part}/<object>"
            yield _animation(path, start=("start", start), count=("count", count))
    if scene.zmp is not None:
        known = np.asarray(np.isfinite(scene.zmp).all(axis=-1))
        place = np.where(known[:, None], scene.zmp, scene.center)
        yield _animation("/overlay/zmp", position=("vector3", place), visible=("bool", known))
