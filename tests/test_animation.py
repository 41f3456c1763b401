"""Animations: the content of a page, compared with kinematics and recording, and the files that are written."""

import dataclasses
import html
import itertools
import json
import re
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import hexakin as hk
from hexakin.animation import animate
from hexakin.animation.ground import ground_surfaces
from hexakin.exceptions import FileError, InvalidInputError, MissingPackageError, UnknownNameError
from hexakin.kinematics import segment_poses
from hexakin.motion.motion import motion_of
from hexakin.stability.polygon import support_polygon
from hexakin.terrain import Blocks, HeightField, LegCurves, Plane, Ramp
from hexakin.transforms import transform_points

SMALL = (96, 72)


@pytest.fixture(scope="module")
def hwr():
    return hk.load_robot("hwr")


@pytest.fixture(scope="module")
def walk(athena, short_walk):
    return animate(athena, short_walk, Ramp())


@pytest.fixture(scope="module")
def content(walk):
    return content_of(walk.html())


@pytest.fixture(scope="module")
def marked(hwr):
    """A plan with steps that are too long, so that legs are out of reach at some instants."""
    return hk.plan_walk(hwr, Plane(), 2, 0.36, heading=1.57, samples_per_step=30, on_failure="mark")


def content_of(page):
    return json.loads(re.search(r'<script id="content" type="application/json">(.*?)</script>', page, re.DOTALL)[1])


def track(content, path, name):
    """Values (n, k) of one property of one node."""
    (animation,) = (a for a in content["animations"] if a["path"] == path)
    (values,) = (t["values"] for t in animation["clip"]["tracks"] if t["name"] == f".{name}")
    return np.array(values).reshape(len(content["time"]), -1).squeeze()


def poses(content, path):
    return track(content, path, "position"), Rotation.from_quat(track(content, path, "quaternion")).as_matrix()


def vertices(content, path):
    (command,) = (c for c in content["commands"] if c["type"] == "set_object" and c["path"] == path)
    data = command["object"]["geometries"][0]["data"]
    return np.array(data["attributes"]["position"]["array"]).reshape(-1, 3)


def test_a_page_is_one_file_that_loads_nothing(walk, tmp_path):
    path = walk.save(tmp_path / "walk.html")
    assert list(tmp_path.iterdir()) == [path]
    tags = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attributes: tags.append((tag, dict(attributes)))
    page = path.read_text(encoding="utf-8")
    parser.feed(page)
    assert "script" in {tag for tag, _ in tags} and "link" not in {tag for tag, _ in tags}
    assert not [tag for tag, attributes in tags if {"src", "href", "data"} & set(attributes)]
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    assert "url(" not in style and "@import" not in style
    # The only addresses in the viewer and the page are XML's namespace and addresses in comments.
    for address in re.findall(r"(?:https?|wss?):/+[\w.$]*", re.sub(r"<!--.*?-->", "", page)):
        assert address in ("http://www.w3.org", "ws://$")  # the second one is in connect(), which is not called
    assert "viewer.connect" not in page
    assert 0.8e6 < path.stat().st_size < 3e6


def test_a_page_starts_no_server_and_does_not_import_its_viewer(walk):
    walk.html()
    assert "meshcat" not in sys.modules


def test_the_page_has_keyframes_of_every_moving_part_at_the_kinematics_poses(athena, short_walk, content):
    assert content["start"] + np.array(content["time"]) == pytest.approx(short_walk.time, abs=1e-5)
    position, rotation = poses(content, "/robot")
    assert position == pytest.approx(short_walk.T_world_body[:, :3, 3], abs=1e-5)
    assert rotation == pytest.approx(short_walk.T_world_body[:, :3, :3], abs=5e-5)
    for k in range(0, len(short_walk.time), 25):
        expected = segment_poses(athena, short_walk.q[k])
        for leg in range(6):
            for segment, name in enumerate(("coxa", "femur", "tibia")):
                position, rotation = poses(content, f"/robot/leg {leg + 1}/{name}")
                assert position[k] == pytest.approx(expected[leg, segment, :3, 3], abs=1e-5)
                assert rotation[k] == pytest.approx(expected[leg, segment, :3, :3], abs=5e-5)


def test_every_animated_node_has_an_object_or_holds_some(content):
    objects = {c["path"] for c in content["commands"] if c["type"] == "set_object"}
    for animation in content["animations"]:
        path = animation["path"].removesuffix("/<object>")
        assert path == "/center" or any(name == path or name.startswith(f"{path}/") for name in objects)


def test_parts_of_the_robot_have_their_sizes_and_the_legs_their_colours(athena, content):
    objects = {c["path"]: c["object"] for c in content["commands"] if c["type"] == "set_object"}
    for leg, colour in enumerate(hk.figures.LEG_COLOURS[:6]):
        tibia = objects[f"/robot/leg {leg + 1}/tibia/box"]
        assert tibia["geometries"][0]["width"] == pytest.approx(athena.segments["tibia"].size[0])
        assert tibia["materials"][0]["color"] == int(colour[1:], 16)
        assert objects[f"/robot/leg {leg + 1}/tibia/foot"]["geometries"][0]["radius"] == pytest.approx(
            athena.foot_radius
        )


def test_a_foot_lies_where_the_forward_kinematics_puts_it(athena, walk, short_walk):
    feet = [part for part in walk.scene.parts if part.name == "foot"]
    T = short_walk.T_world_body[40] @ walk.scene.T_body_segment[40, :, 2]
    p_world_foot = np.array([(T[part.node[0]] @ part.T_node_part)[:3, 3] for part in feet])
    expected = transform_points(short_walk.T_world_body[40], hk.forward_kinematics(athena, short_walk.q[40]))
    assert p_world_foot == pytest.approx(expected, abs=1e-12)


def test_arrows_are_as_long_as_the_forces_and_along_the_ramps_normal(walk, short_walk, content):
    normal = Ramp().normal(0.0, 0.0)
    for leg in (0, 3):
        path = f"/overlay/forces/leg {leg + 1}/shaft"
        loaded = short_walk.foot_force[:, leg] > 0.0
        assert (track(content, path, "visible") == loaded).all() and 0 < loaded.sum() < len(loaded)
        long = track(content, path, "scale")[loaded, 2] * walk.scene.newtons_per_metre
        assert long == pytest.approx(np.maximum(short_walk.foot_force[loaded, leg], 0.1), abs=0.1)
        assert poses(content, path)[1][..., 2] == pytest.approx(np.tile(normal, (len(loaded), 1)), abs=5e-5)


def test_the_polygon_drawn_at_each_instant_is_that_of_the_loaded_feet(athena, short_walk):
    force = short_walk.foot_force.copy()
    force[5, :4], force[6] = 0.0, 0.0  # two feet, then none, carry load: no polygon, and in the second case no ZMP
    shown = animate(athena, dataclasses.replace(short_walk, foot_force=force), Ramp(), show=("polygon", "zmp"))
    content = content_of(shown.html())
    points, path = vertices(content, "/overlay/polygon/edge"), "/overlay/polygon/edge/<object>"
    start, count = (track(content, path, f"drawRange[{name}]").astype(int) for name in ("start", "count"))
    assert (count[5:7] == 0).all() and count.max() >= 8
    assert not track(content, "/overlay/zmp", "visible")[6]
    for k in range(len(short_walk.time)):
        hull = support_polygon(shown.scene.p_contact[k, force[k] > 0.0])
        corners = points[start[k] : start[k] + count[k] : 2, :2]
        assert corners == pytest.approx(np.empty((0, 2)) if hull is None else hull, abs=1e-5)


def test_the_zmp_is_the_mean_of_the_contacts_weighted_by_their_forces(walk, short_walk, content):
    total = short_walk.foot_force.sum(axis=1)
    carried = total > 0.0
    assert (track(content, "/overlay/zmp", "visible") == carried).all()
    mean = np.einsum("nl,nlk->nk", short_walk.foot_force, walk.scene.p_contact)[carried] / total[carried, None]
    assert track(content, "/overlay/zmp", "position")[carried] == pytest.approx(mean + [0.0, 0.0, 0.003], abs=2e-5)


def test_only_what_is_asked_for_is_shown(athena, short_walk):
    content = content_of(animate(athena, short_walk, Ramp(), show=["polygon"]).html())
    overlays = {c["path"].split("/")[2] for c in content["commands"] if c["path"].startswith("/overlay")}
    assert overlays == {"polygon"}
    bare = content_of(animate(athena, short_walk, Ramp(), show=()).html())
    assert not [c for c in bare["commands"] if c["path"].startswith("/overlay")]


def test_the_camera_goes_along_or_stays(athena, short_walk, walk):
    assert walk.scene.center[-1, 1] - walk.scene.center[0, 1] > 0.5 * np.ptp(short_walk.T_world_body[:, 1, 3])
    fixed = animate(athena, short_walk, Ramp(), follow=False)
    assert np.ptp(fixed.scene.center, axis=0) == pytest.approx(0.0)
    assert content_of(fixed.html())["follow"] is False


def test_a_leg_out_of_reach_is_held_and_marked_where_its_foot_should_be(hwr, marked):
    shown = animate(hwr, marked, Plane())
    held = shown.scene.held
    assert held.any() and not held.all(axis=0).any()
    assert np.isfinite(shown.scene.T_body_segment).all()
    at = [int(np.argmin(np.abs(marked.time - t))) for t in shown.scene.time]
    assert (held == ~marked.reachable[at]).all()
    leg = int(np.argmax(held.any(axis=0)))
    first = int(np.argmax(held[:, leg]))
    if first > 0:
        assert (shown.scene.T_body_segment[first, leg] == shown.scene.T_body_segment[first - 1, leg]).all()
    page = shown.html()
    content = content_of(page)
    path = f"/overlay/out of reach/leg {leg + 1}"
    assert (track(content, path, "visible") == held[:, leg]).all()
    assert track(content, path, "position") == pytest.approx(marked.p_world_foot[at, leg], abs=1e-5)
    assert f"leg {leg + 1}: out of reach at {held[:, leg].sum()} of {len(held)} instants" in page


def test_a_leg_that_never_has_angles_is_refused_by_name(hwr, marked):
    q = marked.q.copy()
    q[:, 3] = np.nan
    with pytest.raises(InvalidInputError, match="leg 4 has no joint angles at any instant"):
        animate(hwr, dataclasses.replace(marked, q=q), Plane())


def test_plans_and_motions_are_animated_too_without_forces(hwr, marked):
    for motion in (marked, motion_of(hwr, marked)):
        scene = animate(hwr, motion, Plane()).scene
        assert scene.force is None and scene.zmp is None and scene.polygon is not None
        assert scene.time[[0, -1]] == pytest.approx(marked.time[[0, -1]])


def test_a_fine_plan_has_thirty_keyframes_a_second(hwr):
    plan = hk.plan_walk(hwr, Plane(), num_steps=1, step_length=0.05, samples_per_step=300)
    scene = animate(hwr, plan, Plane(), show=()).scene
    assert scene.time[[0, -1]] == pytest.approx([0.0, 2.0]) and len(scene.time) == 61
    assert np.isin(scene.time, plan.time).all()


def test_curves_without_a_surface_are_lines_below_the_feet(hwr):
    curves = LegCurves(reference_z=lambda s, y: 0.02 * np.sin(8.0 * s))
    plan = hk.plan_walk(hwr, curves, num_steps=1, step_length=0.05, samples_per_step=20)
    shown = animate(hwr, plan, curves)
    assert shown.scene.surfaces == ()
    assert np.ptp(vertices(content_of(shown.html()), "/overlay/ground/leg 2")[:, 2]) > 1e-3
    assert animate(hwr, plan, None).scene.ground_path is not None


X = np.linspace(-1.0, 1.0, 41)
FIELD = HeightField(X, X, 0.03 * np.sin(6.0 * X[:, None]) * np.cos(5.0 * X))


@pytest.mark.parametrize("terrain", [Plane(0.02), Ramp(start=0.13, heading=0.7, slope=0.4), FIELD, Blocks()])
def test_the_ground_shown_is_the_terrain_and_lies_under_every_foot(athena, terrain):
    p_foot = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 6, 3))
    surfaces = ground_surfaces(terrain, p_foot)
    corners = np.concatenate([s.vertices[s.triangles] for s in surfaces])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upper = normal[:, 2] > 1e-9 * np.linalg.norm(normal, axis=-1)
    assert (normal[:, 2] > -1e-12).all()  # counter-clockwise from above, or upright
    middle = corners[upper].mean(axis=1)
    assert middle[:, 2] == pytest.approx(terrain.height(middle[:, 0], middle[:, 1]), abs=1e-9)
    area = 0.5 * normal[upper, 2].sum()
    assert area > 0.7**2
    assert corners[..., :2].min() < -0.3 and corners[..., :2].max() > 0.3


def test_the_page_says_how_long_tiles_and_arrows_are(walk):
    assert walk.scene.notes == ["tiles: 100 mm", "arrows: 6.71 N per 100 mm"]
    assert all(note in walk.html() for note in walk.scene.notes)
    for surface in walk.scene.surfaces:
        edge = np.linalg.norm(np.diff(surface.vertices.reshape(-1, 4, 3)[:, :2, :2], axis=1), axis=-1)
        assert edge == pytest.approx(0.1)


def test_sides_of_blocks_face_outwards():
    terrain = Blocks(size=0.1, extent=(-0.05, 0.05, -0.05, 0.05))  # one block
    (surface,) = ground_surfaces(terrain, np.array([[[-0.2, -0.2, 0.0], [0.2, 0.2, 0.0]]]))[-1:]
    corners = surface.vertices[surface.triangles]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upright = np.abs(sides[:, 2]) < 1e-12
    outward = np.einsum("ti,ti->t", sides, corners.mean(axis=1) * [1.0, 1.0, 0.0])
    assert upright.sum() == 8 and (outward[upright] > 0.0).all()


def test_a_gif_has_a_frame_for_each_tenth_of_a_second_and_all_differ(walk, tmp_path):
    shown = dataclasses.replace(walk, speed=4.0)
    path = shown.save(tmp_path / "walk.gif", size=SMALL)
    assert list(tmp_path.iterdir()) == [path]
    with Image.open(path) as gif:
        span = walk.scene.time[-1] - walk.scene.time[0]
        assert gif.n_frames == int(span / 4.0 * 10.0) + 1
        assert gif.size == SMALL and gif.info["duration"] == 100 and gif.info["loop"] == 0
        frames = []
        for k in range(gif.n_frames):
            gif.seek(k)
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
    for before, after in itertools.pairwise(frames):
        assert (np.abs(after - before).max(axis=-1) > 20).sum() > 20
    # Colours of the legs are there: the blue of leg 1, shaded, and the orange of leg 2.
    red, blue = frames[0][..., 0], frames[0][..., 2]
    assert ((blue > 1.8 * red) & (blue > 60)).sum() > 20 and ((red > 2.5 * blue) & (red > 80)).sum() > 20


def test_a_notebook_gets_the_same_page_in_a_frame(walk):
    shown = walk._repr_html_()
    (inner,) = re.findall(r'srcdoc="([^"]*)"', shown)
    assert html.unescape(inner) == walk.html()


def test_missing_packages_are_named_and_no_file_is_left(walk, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshcat", None)
    with pytest.raises(MissingPackageError, match=r"needs the package 'meshcat'.*pip install meshcat"):
        walk.save(tmp_path / "walk.html")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingPackageError, match="an MP4 file needs the package 'imageio-ffmpeg'"):
        walk.save(tmp_path / "walk.mp4")
    assert list(tmp_path.iterdir()) == []


def test_an_encoder_that_fails_says_why_and_leaves_no_file(walk, tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    fake = tmp_path / "bin" / "ffmpeg"
    fake.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    with pytest.raises(hk.exceptions.SimulationError, match="no such codec"):
        dataclasses.replace(walk, speed=30.0).save(tmp_path / "walk.mp4", size=SMALL)
    assert list(tmp_path.iterdir()) == [tmp_path / "bin"]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"speed": 0.0}, InvalidInputError, "speed: 0, expected at least 0.001 and at most 1000"),
        ({"follow": "yes"}, InvalidInputError, "follow: expected True or False, got 'yes'"),
        ({"show": "forces"}, InvalidInputError, "show: expected a sequence, each text, got 'forces'"),
        (
            {"show": ("forces", "shadow")},
            UnknownNameError,
            "unknown show 'shadow'; known: forces, polygon, zmp, traces",
        ),
        ({"terrain": Ramp}, InvalidInputError, "terrain: expected a Terrain, a LegCurves or None, got <class"),
        ({"terrain": "ramp"}, InvalidInputError, "terrain: .* got 'ramp'"),
        (
            {"robot": "athena"},
            InvalidInputError,
            "robot: expected a Robot, as hexakin.load_robot returns",
        ),
        ({"motion": 3}, InvalidInputError, "motion: expected a Recording, a WalkPlan or a Motion, got 3"),
    ],
)
def test_wrong_arguments_are_named(athena, short_walk, options, error, message):
    given = {"robot": athena, "motion": short_walk, "terrain": Ramp()} | options
    with pytest.raises(error, match=message):
        animate(**given)


def test_a_motion_of_another_robot_or_without_course_of_time_is_named(athena, hwr, marked):
    motion = motion_of(hwr, marked)
    with pytest.raises(InvalidInputError, match=r"motion: q has shape \(\d+, 4, 3\), expected \(\d+, 6, 3\)"):
        animate(athena, dataclasses.replace(motion, q=motion.q[:, :4]), Plane())
    with pytest.raises(InvalidInputError, match=r"motion: T_world_body has shape \(\d+, 4, 4\), expected \(1, 4, 4\)"):
        animate(hwr, dataclasses.replace(motion, time=motion.time[:1]), Plane())
    names = ("time", "T_world_body", "p_body_foot", "q", "carrying", "clipped")
    first = {name: getattr(motion, name)[:1] for name in names}
    with pytest.raises(InvalidInputError, match=r"time has shape \(1,\), expected at least two instants"):
        animate(hwr, dataclasses.replace(motion, **first), Plane())
    none = {name: getattr(motion, name)[:0] for name in names}
    with pytest.raises(InvalidInputError, match=r"time has shape \(0,\), expected \(n,\) with at least one instant"):
        animate(hwr, dataclasses.replace(motion, **none), Plane())
    with pytest.raises(InvalidInputError, match=r"time must ascend, but .* s follows .* s \(index 1\)"):
        animate(hwr, dataclasses.replace(motion, time=motion.time[::-1]), Plane())
    four = {name: getattr(motion, name)[:, :4] for name in ("p_body_foot", "q", "carrying", "clipped")}
    with pytest.raises(InvalidInputError, match="motion: for 4 legs, but athena has 6"):
        animate(athena, dataclasses.replace(motion, **four), Plane())


@pytest.mark.parametrize(
    ("name", "options", "error", "message"),
    [
        ("walk.avi", {}, UnknownNameError, r"unknown format '.avi'; known: .html, .gif, .mp4"),
        ("no/walk.gif", {}, FileError, r"walk\.gif: cannot be written \(the folder .*no does not exist\)"),
        (
            "walk.gif",
            {"frame_rate": 100.0},
            InvalidInputError,
            "frame_rate: 100 1/s, expected at least 0.1 and",
        ),
        ("walk.gif", {"size": 640}, InvalidInputError, r"size: expected 2 values, each a whole number, got 640"),
        ("walk.gif", {"size": (10**6, 10**6)}, InvalidInputError, r"size: .* 1e\+12 pixels, expected at most 8294400"),
        ("walk.mp4", {"size": (10**6, 32)}, InvalidInputError, "size: .* 3.2e.07 pixels, expected at most 8294400"),
        ("walk.gif", {"size": (640, 481)}, InvalidInputError, "size: height: 481, expected an even number"),
    ],
)
def test_wrong_files_are_named(walk, tmp_path, name, options, error, message):
    with pytest.raises(error, match=message):
        walk.save(tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_frames_that_are_too_many_are_named_before_they_are_drawn(walk, tmp_path):
    slow = dataclasses.replace(walk, speed=1e-3)
    long = dataclasses.replace(slow, scene=dataclasses.replace(walk.scene, time=1e3 * walk.scene.time))
    with pytest.raises(
        InvalidInputError, match=r"frame_rate: 50 1/s at a speed of 0\.001 makes .* frames, expected at m"
    ):
        long.save(tmp_path / "walk.mp4", frame_rate=50.0)
    with pytest.raises(InvalidInputError, match=r"frames of \(1920, 1080\) pixels do not fit into a GIF"):
        slow.save(tmp_path / "walk.gif", size=(1920, 1080))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("speed", [0.0, 1e-300, 1e300, np.nan])
def test_absurd_speeds_are_named(athena, short_walk, speed):
    with pytest.raises(InvalidInputError, match=r"speed: .*expected at least 0\.001 and at most 1000"):
        animate(athena, short_walk, None, speed=speed)
