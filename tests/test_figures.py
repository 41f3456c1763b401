"""Figures: blocks and what they hide, box plots, maps, bars, and the files that figures are written to."""

import dataclasses
import itertools

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from hexakin import figures
from hexakin.exceptions import FileError, InvalidInputError
from hexakin.figures.occlusion import cut_hidden, hiding_planes
from hexakin.figures.solids_3d import BlockFaces, SolidFaces, eye_of
from hexakin.simulation.closed_loop import starting_pose
from hexakin.terrain import Blocks, Box, HalfSpace, Plane, Ramp
from hexakin.walking.gait import GAITS

LEVELS = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
ROUGH = Blocks(size=0.1, max_step=None, extent=(-0.2, 0.2, -0.2, 0.2), level=0.0, seed=3)  # 5 x 5 blocks
WINDOW = (-0.25, -0.25), (0.25, 0.25)


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


@pytest.fixture
def ax():
    return plt.figure(layout="constrained").add_subplot()


def scene(terrain=ROUGH, window=WINDOW, *, elevation=28.0, azimuth=-50.0, projection="persp"):
    """3D axes with a terrain, drawn."""
    axes = figures.axes_3d(plt.figure(), elevation=elevation, azimuth=azimuth)
    axes.set_proj_type(projection)
    figures.draw_terrain(axes, terrain, *window)
    figures.set_equal_3d(axes, [*window[0], 0.0], [*window[1], 0.3])
    axes.figure.canvas.draw()
    return axes


def blocks_of(axes):
    (blocks,) = (artist for artist in axes.collections if isinstance(artist, BlockFaces))
    return blocks


def summaries(count, repeats=10, seed=0):
    """Five-number summaries (count, repeats, 5) of random samples."""
    samples = np.random.default_rng(seed).normal(100.0, 5.0, (count, repeats, 24))
    return np.moveaxis(np.quantile(samples, [0.0, 0.25, 0.5, 0.75, 1.0], axis=-1), 0, -1)


def test_tops_of_drawn_blocks_are_level_and_lie_at_the_tops_of_the_terrain():
    tops = blocks_of(scene()).faces[:, 0]
    assert np.ptp(tops[..., 2], axis=1).max() == 0.0
    assert tops[:, 0, 2].reshape(5, 5) == pytest.approx(1e3 * ROUGH.tops)
    assert tops[..., 0].min() == pytest.approx(-250.0) and tops[..., 1].max() == pytest.approx(250.0)


def test_sides_of_drawn_blocks_are_vertical_and_reach_from_the_ground_to_the_top():
    faces = blocks_of(scene()).faces
    for side in (faces[:, k] for k in range(1, 5)):
        assert min(np.ptp(side[..., axis], axis=1).max() for axis in (0, 1)) == 0.0
        assert side[..., 2].min(axis=1) == pytest.approx(np.zeros(25))
        assert side[..., 2].max(axis=1) == pytest.approx(faces[:, 0, 0, 2])


def test_blocks_are_cut_off_at_the_window():
    blocks = blocks_of(scene(window=((-0.13, -0.2), (0.24, 0.02))))
    assert blocks.lower.min(axis=0) == pytest.approx([-130.0, -200.0, 0.0])
    assert blocks.upper.max(axis=0)[:2] == pytest.approx([240.0, 20.0])
    centers = (blocks.lower + blocks.upper)[:, :2] / 2e3
    assert blocks.upper[:, 2] == pytest.approx(1e3 * ROUGH.height(*centers.T))


@pytest.mark.parametrize("projection", ["persp", "ortho"])
@pytest.mark.parametrize(("elevation", "azimuth"), [(28.0, -50.0), (25.0, 0.0), (12.0, 100.0), (70.0, 215.0)])
def test_every_ray_from_the_eye_ends_on_the_face_that_is_drawn_last(projection, elevation, azimuth, rng):
    axes = scene(elevation=elevation, azimuth=azimuth, projection=projection)
    blocks, eye = blocks_of(axes), eye_of(axes) / 1e3
    target = rng.uniform([-0.25, -0.25, 0.0], [0.25, 0.25, 0.1], (400, 3))
    direction = (target - eye) / np.linalg.norm(target - eye, axis=1, keepdims=True)
    hit = 1e3 * (eye + ROUGH.distance_along(eye, direction)[:, None] * direction)
    hit = hit[hit[:, 2] > 1e-3]  # the ground beside the blocks is not drawn
    assert len(hit) > 200
    faces = blocks.faces.reshape(-1, 4, 3)
    place = np.column_stack(proj3d.proj_transform(*faces.reshape(-1, 3).T, axes.get_proj())[:2]).reshape(-1, 4, 2)
    drawn = [path.vertices[:4] for path in blocks.get_paths()]
    for point, x, y in zip(hit, *proj3d.proj_transform(*hit.T, axes.get_proj())[:2], strict=True):
        last = [ring for ring in drawn if Outline(ring).contains_point((x, y))][-1]
        face = faces[np.abs(place - last).max(axis=(1, 2)).argmin()]
        assert (point > face.min(axis=0) - 0.01).all() and (point < face.max(axis=0) + 0.01).all()


def test_higher_blocks_are_lighter_and_sides_darker_than_tops():
    blocks = blocks_of(scene())
    light = blocks.get_facecolor()[:, :3].sum(axis=1)
    rings = np.array([path.vertices[:4] for path in blocks.get_paths()])
    proj = blocks.axes.get_proj()
    tops = blocks.faces[:, 0]
    places = np.column_stack(proj3d.proj_transform(*tops.reshape(-1, 3).T, proj)[:2]).reshape(-1, 1, 4, 2)
    of_top = np.abs(places - rings).max(axis=(2, 3)).argmin(axis=1)
    order = np.argsort(tops[:, 0, 2])
    assert (np.diff(light[of_top][order]) > 0.0).all()
    sides = np.setdiff1d(np.arange(len(light)), of_top)
    assert len(sides) == 50 and light[sides].max() < 0.8 * light[of_top].max()


def test_stairs_of_boxes_on_a_floor_are_drawn_as_blocks_too():
    class Stairs(Plane):
        def shapes(self):
            boxes = (Box((0.0, 0.0, -0.1), (0.2, 0.4, 0.05)), Box((0.1, 0.0, -0.1), (0.2, 0.4, 0.1)))
            return (HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), *boxes)

        def height(self, x, y):
            return np.where((y < 0.0) | (x < 0.0) | (x > 0.2), 0.0, np.where(x < 0.1, 0.05, 0.1))

    blocks = blocks_of(scene(Stairs(), ((-0.1, 0.0), (0.2, 0.4))))
    assert blocks.lower[:, 0] == pytest.approx([-100.0, 0.0, 100.0])
    assert blocks.upper[:, 2] == pytest.approx([0.0, 50.0, 100.0])


@pytest.mark.parametrize("terrain", [Plane(), Ramp(), Ramp(start=0.1)])
def test_terrains_of_planes_are_drawn_as_tiles_at_their_height(terrain):
    axes = figures.axes_3d(plt.figure())
    figures.draw_terrain(axes, terrain, (-0.2, -0.2), (0.2, 0.2), spacing=0.1)
    (tiles,) = axes.collections
    assert isinstance(tiles, Poly3DCollection) and not isinstance(tiles, BlockFaces)
    assert axes.get_zlim()[1] >= 1e3 * terrain.height(0.0, 0.2) - 1e-9


def test_a_window_turned_inside_out_is_named():
    with pytest.raises(InvalidInputError, match=r"low, high: \(0.2, 0\) m is not below \(0.1, 1\) m"):
        figures.draw_terrain(figures.axes_3d(plt.figure()), ROUGH, (0.2, 0.0), (0.1, 1.0))


@pytest.mark.parametrize("projection", ["persp", "ortho"])
def test_a_point_is_hidden_exactly_if_its_ray_to_the_eye_meets_the_terrain(projection, rng):
    axes = scene(projection=projection, elevation=10.0)
    blocks, eye = blocks_of(axes), eye_of(axes)
    point = rng.uniform([-250.0, -250.0, 1.0], [250.0, 250.0, 150.0], (800, 3))
    point = point[point[:, 2] > 1e3 * ROUGH.height(*point.T[:2] / 1e3)]
    direction = (eye - point) / np.linalg.norm(eye - point, axis=1, keepdims=True)
    free = np.isinf(ROUGH.distance_along(point / 1e3, direction))
    specks = point[:, None] + 1e-4 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    _, seen = cut_hidden(specks, hiding_planes(blocks.lower, blocks.upper, eye))
    assert 50 < free.sum() < len(free) - 50
    assert np.isin(np.arange(len(point)), seen).tolist() == free.tolist()


def area(polygons):
    """Area of each plane polygon (n, k, 3)."""
    fan = np.cross(polygons[:, 1:-1] - polygons[:, :1], polygons[:, 2:] - polygons[:, :1])
    return np.linalg.norm(fan.sum(axis=1), axis=1) / 2.0


def test_a_wall_half_behind_a_box_is_cut_along_the_shadow_of_the_box():
    """Seen from 10 in front of the box's front, a wall 2 behind that front is hidden over 12/10 of the box's size."""
    wall = np.array([[[-3.0, 2.0, 0.0], [3.0, 2.0, 0.0], [3.0, 2.0, 3.0], [-3.0, 2.0, 3.0]]])
    planes = hiding_planes([[-1.0, 0.0, -1.0]], [[1.0, 1.0, 1.0]], [0.0, -10.0, 0.0])
    parts, origin = cut_hidden(wall, planes)
    assert area(parts).sum() == pytest.approx(18.0 - 2.4 * 1.2, abs=1e-4)
    assert set(origin) == {0} and len(parts) > 1


def test_what_nothing_hides_stays_whole():
    wall = np.array([[[-3.0, -2.0, 0.0], [3.0, -2.0, 0.0], [3.0, -2.0, 3.0], [-3.0, -2.0, 3.0]]])  # before the box
    parts, origin = cut_hidden(wall, hiding_planes([[-1.0, 0.0, -1.0]], [[1.0, 1.0, 1.0]], [0.0, -10.0, 0.0]))
    assert parts.tolist() == wall.tolist() and origin.tolist() == [0]


def robot_faces(axes):
    (solid,) = (artist for artist in axes.collections if isinstance(artist, SolidFaces))
    axes.figure.canvas.draw()
    return len(solid.get_paths())


def test_a_robot_above_the_blocks_is_drawn_whole_and_one_below_them_not_at_all(athena):
    T = np.eye(4)
    count = []
    for z in (0.5, -0.5):
        axes = scene(Blocks(extent=(-2.0, 2.0, -2.0, 2.0)), ((-2.0, -2.0), (2.0, 2.0)))
        T[2, 3] = z
        figures.draw_robot(axes, athena, athena.standing_q, T, labels=False)
        count.append(robot_faces(axes))
    bare = figures.axes_3d(plt.figure())
    figures.draw_robot(bare, athena, athena.standing_q, T, labels=False)
    assert count == [robot_faces(bare), 0]


def test_a_robot_on_the_blocks_keeps_its_colours_and_is_drawn_over_them(athena):
    axes = scene(Blocks(), ((-0.5, -0.5), (0.5, 0.5)))
    q = athena.standing_q
    T = starting_pose(athena, Blocks(), q)
    figures.draw_robot(axes, athena, q, T, labels=False)
    bare = figures.axes_3d(plt.figure())
    figures.draw_robot(bare, athena, q, T, labels=False)
    robot_faces(axes), robot_faces(bare)
    colours = [{tuple(c) for c in a.collections[-1].get_facecolor().round(6)} for a in (axes, bare)]
    assert colours[0] <= colours[1]
    assert axes.collections[-1].get_zorder() == 3 > blocks_of(axes).get_zorder()


def drawn_boxes(ax):
    return [patch for patch in ax.patches if isinstance(patch, PathPatch)]


@pytest.mark.parametrize("levels", [LEVELS, ["simple", "chosen"]])
def test_boxes_show_the_medians_over_repeats(ax, levels):
    given = {"pybullet": summaries(len(levels)), "rigid": summaries(len(levels), seed=1)}
    figures.draw_boxes(ax, given, levels, "height [mm]")
    medians = [line for line in ax.lines if line.get_linewidth() == 1.6]
    shown = np.array([line.get_ydata()[0] for line in medians]).reshape(2, -1)
    assert shown == pytest.approx(np.median([s[..., 2] for s in given.values()], axis=-1))
    ends = [box.get_path().get_extents() for box in drawn_boxes(ax)]
    for k, name in ((1, "y0"), (3, "y1")):
        shown = np.array([getattr(end, name) for end in ends]).reshape(2, -1)
        assert shown == pytest.approx(np.median([s[..., k] for s in given.values()], axis=-1))
    whiskers = np.concatenate([line.get_ydata() for line in ax.lines if line.get_linewidth() == 0.7])
    for k, extreme in ((0, np.min), (4, np.max)):
        assert extreme(whiskers) == pytest.approx(extreme([np.median(s[..., k], axis=1) for s in given.values()]))


def test_boxes_of_the_engines_stand_side_by_side_at_their_level(ax):
    figures.draw_boxes(ax, {"pybullet": summaries(6), "rigid": summaries(6)}, LEVELS, "height [mm]")
    spans = np.array([box.get_path().get_extents().intervalx for box in drawn_boxes(ax)]).reshape(2, 6, 2)
    assert (spans[0, :, 1] < spans[1, :, 0]).all()  # pybullet on the left of rigid
    assert (spans[1, :-1, 1] < spans[0, 1:, 0]).all()
    assert spans.mean(axis=(0, 2)) == pytest.approx(LEVELS)
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0", "0.2", "0.4", "0.6", "0.8", "1"]


def test_every_repeat_has_a_dot_at_its_median_within_its_box_and_always_at_the_same_place():
    given = {"pybullet": summaries(6), "rigid": summaries(6, seed=1)}
    found = []
    for _ in range(2):
        axes = plt.figure().add_subplot()
        figures.draw_boxes(axes, given, LEVELS, "height [mm]")
        dots = [line.get_xydata().reshape(6, 10, 2) for line in axes.lines if line.get_marker() == "o"]
        spans = [box.get_path().get_extents().intervalx for box in drawn_boxes(axes)]
        for (left, right), x in zip(spans, np.concatenate(dots)[..., 0], strict=True):
            assert (x > left).all() and (x < right).all() and len(np.unique(x)) == 10
        found.append(np.array(dots))
    assert (found[0] == found[1]).all()
    assert found[0][..., 1] == pytest.approx(np.array([s[..., 2] for s in given.values()]))


def test_each_engine_has_one_colour_in_every_chart():
    for engines in (("pybullet", "rigid"), ("rigid", "pybullet"), ("rigid",)):
        axes = plt.figure().subplots(1, 2)
        figures.draw_boxes(axes[0], {name: summaries(2) for name in engines}, ["a", "b"], "height [mm]")
        lengths = np.ones((len(engines), 1))
        figures.bar_effects(axes[1], ["k"], lengths, lengths, lengths, "effect [mm]", engines=engines)
        for chart in axes:
            handles, labels = chart.get_legend_handles_labels()
            for handle, label in zip(handles, labels, strict=True):
                if label in engines:
                    patch = handle if isinstance(handle, PathPatch) else handle.patches[0]
                    assert patch.get_facecolor() == matplotlib.colors.to_rgba(figures.ENGINE_COLOURS[label])
    assert figures.ENGINE_COLOURS == {"pybullet": figures.ORANGE, "rigid": figures.BLUE, "mujoco": figures.GREEN}


@pytest.mark.parametrize(
    ("levels", "paper", "place"),
    [(LEVELS, [(0.6, 98.0), (0.0, 90.0)], [[0.6, 98.0], [0.0, 90.0]]), (["a", "b"], [("b", 98.0)], [[1.0, 98.0]])],
)
def test_the_paper_is_marked_at_its_values_and_named_in_the_legend(ax, levels, paper, place):
    given = {"pybullet": summaries(len(levels)), "rigid": summaries(len(levels))}
    figures.draw_boxes(ax, given, levels, "height [mm]", paper=paper)
    (marks,) = (line for line in ax.lines if line.get_marker() == "D")
    assert marks.get_xydata() == pytest.approx(np.array(place))
    assert ax.get_legend_handles_labels()[1] == ["pybullet", "rigid", "median of one repeat", "paper"]


@pytest.mark.parametrize(
    ("summary", "message"),
    [
        (np.ones((5, 10, 5)), r"summaries: rigid: expected shape \(6, n, 5\), got \(5, 10, 5\)"),
        (np.ones((6, 5)), r"summaries: rigid: expected shape \(6, n, 5\), got \(6, 5\)"),
        (np.ones((6, 0, 5)), "summaries: rigid: no repeat"),
        (np.ones((6, 10, 4)), r"summaries: rigid: expected shape \(6, n, 5\), got \(6, 10, 4\)"),
        (np.full((6, 10, 5), np.nan), r"summaries: rigid: level 1, repeat 1, number 1 is nan"),
        (np.tile([0.0, 1.0, 3.0, 2.0, 4.0], (6, 10, 1)), r"level 1, repeat 1: median 3 exceeds upper quartile 2"),
    ],
)
def test_summaries_of_a_wrong_shape_or_order_are_named(ax, summary, message):
    with pytest.raises(InvalidInputError, match=message):
        figures.draw_boxes(ax, {"rigid": summary}, LEVELS, "height [mm]")


@pytest.mark.parametrize(
    ("levels", "paper", "message"),
    [
        ([0.0, 0.0], [], "levels: .* contain a level twice"),
        ([], [], "levels: expected at least one"),
        ([0.0, "a"], [], "levels: expected a sequence, each a number or a sequence, each text"),
        (["a", "b"], [("c", 1.0)], r"paper: level 'c' is not one of \['a', 'b'\]"),
    ],
)
def test_levels_that_make_no_axis_are_named(ax, levels, paper, message):
    with pytest.raises(InvalidInputError, match=message):
        figures.draw_boxes(ax, {"rigid": summaries(2)}, levels, "height [mm]", paper=paper)


def test_a_map_has_its_first_row_at_the_bottom_and_prints_every_value(ax):
    values = np.arange(36.0).reshape(6, 6) / 100.0
    figures.heat_map(ax, values, LEVELS, LEVELS, "rate [rad/s]", mark=(0.4, 0.2))
    assert np.asarray(ax.collections[0].get_array()) == pytest.approx(values)
    assert ax.get_ylim() == (-0.5, 5.5)
    printed = {text.get_position(): float(text.get_text()) for text in ax.texts}
    assert len(printed) == 36
    assert all(printed[column, row] == pytest.approx(value) for (row, column), value in np.ndenumerate(values))
    (star,) = ax.lines
    assert star.get_xydata().round().tolist() == [[2.0, 1.0]] and star.get_marker() == "*"
    assert ax.get_legend_handles_labels()[1] == ["paper"]
    assert ax.child_axes[0].get_ylabel() == "rate [rad/s]"


def test_a_map_of_many_cells_prints_none_and_maps_can_share_their_colours(ax):
    figures.heat_map(ax, np.ones((6, 21)), range(21), LEVELS, "rate [rad/s]", limits=(0.0, 2.0))
    assert not ax.texts and ax.collections[0].get_clim() == (0.0, 2.0)


@pytest.mark.parametrize("largest", [1234.5, 87.6, 0.123, 0.0])
def test_values_in_a_map_have_three_digits_of_the_largest(largest):
    axes = plt.figure().add_subplot()
    figures.heat_map(axes, [[0.0, largest]], [0.0, 1.0], [0.0], "x [-]")
    assert axes.texts[1].get_text() == {1234.5: "1234", 87.6: "87.6", 0.123: "0.123", 0.0: "0"}[largest]


@pytest.mark.parametrize(
    ("values", "mark", "message"),
    [
        (np.ones((6, 5)), None, r"values: expected shape \(6, 6\), got \(6, 5\)"),
        (np.ones((2, 6, 6)), None, r"values: expected shape \(6, 6\), got \(2, 6, 6\)"),
        (np.ones((6, 6)), (0.5, 0.2), r"mark: x = 0.5 is not one of the levels"),
        (np.ones((6, 6)), (0.4, 0.3), r"mark: y = 0.3 is not one of the levels"),
    ],
)
def test_a_map_of_a_wrong_shape_or_mark_is_named(ax, values, mark, message):
    with pytest.raises(InvalidInputError, match=message):
        figures.heat_map(ax, values, LEVELS, LEVELS, "rate [rad/s]", mark=mark)


def test_bars_run_from_the_top_in_the_order_given_with_their_intervals(ax):
    values, names = np.array([3.0, -1.0, 2.0]), ["k_z", "k_alpha", "k_beta"]
    figures.bar_effects(ax, names, values, values - 0.5, values + 1.0, "effect [mm]")
    assert [bar.get_width() for bar in ax.patches] == values.tolist()
    height = [ax.transData.transform((0.0, bar.get_y() + bar.get_height() / 2.0))[1] for bar in ax.patches]
    assert height == sorted(height, reverse=True)
    assert [label.get_text() for label in ax.get_yticklabels()] == names
    (intervals,) = ax.collections
    ends = np.array([segment[:, 0] for segment in intervals.get_segments()])
    assert ends == pytest.approx(np.column_stack([values - 0.5, values + 1.0]))
    assert ax.get_xlabel() == "effect [mm]"


def test_bars_of_two_engines_do_not_overlap(ax):
    values = np.arange(6.0).reshape(2, 3)
    figures.bar_effects(ax, list("abc"), values, values, values, "effect [mm]", engines=("pybullet", "rigid"))
    spans = sorted((bar.get_y(), bar.get_y() + bar.get_height()) for bar in ax.patches)
    assert len(spans) == 6 and all(end < begin for (_, end), (begin, _) in itertools.pairwise(spans))
    assert ax.get_legend_handles_labels()[1] == ["pybullet", "rigid"]


@pytest.mark.parametrize(
    ("values", "low", "high", "engines", "message"),
    [
        (np.ones(2), np.ones(3), np.ones(3), (), r"values: expected shape \(3,\), got \(2,\)"),
        (np.ones(3), np.ones((2, 3)), np.ones(3), (), r"low: expected shape \(3,\), got \(2, 3\)"),
        (np.ones(3), np.ones(3), np.ones(3), ("rigid",), r"values: expected shape \(1, 3\), got \(3,\)"),
        (np.ones(3), np.ones(3), np.array([1.0, 0.0, 1.0]), (), r"low, high: b: low 1 exceeds high 0"),
    ],
)
def test_bars_of_a_wrong_shape_or_interval_are_named(ax, values, low, high, engines, message):
    with pytest.raises(InvalidInputError, match=message):
        figures.bar_effects(ax, list("abc"), values, low, high, "effect [mm]", engines=engines)


def test_a_figure_is_written_as_vectors_with_its_fonts_and_at_its_own_size(tmp_path):
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 3.0), layout="constrained")
    figures.draw_boxes(axes[0], {"pybullet": summaries(6)}, LEVELS, "height [mm]")
    figures.heat_map(axes[1], np.eye(6), LEVELS, LEVELS, "rate [rad/s]", mark=(0.4, 0.2))
    path = figures.save_pdf(figure, tmp_path / "a.fig")
    content = path.read_bytes()
    assert path == tmp_path / "a.fig.pdf" and content.startswith(b"%PDF")
    assert b"/Subtype /Image" not in content
    assert b"/FontFile2" in content and b"/Type3" not in content
    assert b"/MediaBox [ 0 0 720 216 ]" in content
    assert list(tmp_path.iterdir()) == [path]


def test_an_image_would_be_found_in_the_file(tmp_path, ax):
    ax.imshow(np.eye(3))
    assert b"/Subtype /Image" in figures.save_pdf(ax.figure, tmp_path / "a").read_bytes()


def test_equal_figures_make_equal_files_under_a_name_that_is_kept(tmp_path):
    contents = []
    for name in ("a.pdf", "b.PDF"):
        figure, axes = plt.subplots()
        figures.draw_boxes(axes, {"rigid": summaries(2)}, ["a", "b"], "height [mm]")
        path = figures.save_pdf(figure, str(tmp_path / name))
        assert path.name == name
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(FileError, match=r"a\.pdf: cannot be written \(the folder .*nowhere does not exist\)"):
        figures.save_pdf(plt.figure(), tmp_path / "nowhere" / "a")


def test_a_figure_that_cannot_be_drawn_leaves_the_file_before_as_it_was(tmp_path):
    path = tmp_path / "a.pdf"
    path.write_bytes(b"before")
    figure, axes = plt.subplots()
    axes.set_title(r"$\nonsense$")
    with pytest.raises(ValueError, match="nonsense"):
        figures.save_pdf(figure, path)
    assert path.read_bytes() == b"before" and list(tmp_path.iterdir()) == [path]


def test_arrows_of_forces_begin_at_the_feet_and_are_to_scale(ax):
    points, forces = np.array([[0.1, 0.2], [0.3, 0.4], [0.0, 0.0]]), np.array([[1.0, 2.0], [0.0, -1.0], [0.0, 0.0]])
    figures.draw_forces(ax, points, forces, scale=0.01)
    (arrows,) = ax.collections
    np.testing.assert_allclose(arrows.get_offsets(), 1e3 * points[:2])
    np.testing.assert_allclose(np.stack([arrows.U, arrows.V], axis=1), 10.0 * forces[:2])
    assert arrows.scale == 1.0
    space = figures.axes_3d(plt.figure())
    figures.draw_forces(space, np.zeros((1, 3)), [[0.0, 0.0, 5.0]], scale=0.01)
    shaft = np.array(space.collections[0]._segments3d[0])
    np.testing.assert_allclose(np.sort(shaft[:, 2]), [0.0, 50.0])
    with pytest.raises(InvalidInputError, match=r"forces: expected shape \(3, 2\), got \(2, 2\)"):
        figures.draw_forces(ax, points, forces[:2], scale=0.01)


def test_regions_are_drawn_in_millimetres_with_a_name_each_and_may_be_empty(ax):
    square = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    regions = {"friction": square, "torque": np.empty((0, 2))}
    figures.draw_regions(ax, np.c_[square, np.ones(4)], regions, [0.05, 0.04, 0.2], polygon=square)
    polygon, friction, torque = ax.patches
    for patch in (polygon, friction):
        np.testing.assert_allclose(patch.get_xy()[:4], 1e3 * square)
    assert len(torque.get_xy()) == 0 and not polygon.get_fill()
    assert ax.get_legend_handles_labels()[1] == ["polygon", "friction", "torque", "feet", "centre of mass"]
    np.testing.assert_allclose(ax.lines[-1].get_xydata(), [[50.0, 40.0]])


def test_samples_tell_what_is_possible_by_shape_as_well_as_by_colour(ax):
    figures.draw_samples(ax, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [True, False, True])
    possible, impossible = ax.lines
    np.testing.assert_allclose(possible.get_xydata(), [[1.0, 4.0], [3.0, 6.0]])
    np.testing.assert_allclose(impossible.get_xydata(), [[2.0, 5.0]])
    assert possible.get_marker() != impossible.get_marker()


@pytest.mark.parametrize("name", ["tripod", "ripple", "wave"])
def test_a_gait_diagram_shows_each_foot_on_the_ground_for_its_share_of_time(athena, name):
    gait = GAITS[name](athena)
    _, ax = plt.subplots()
    figures.draw_gait(ax, gait, [leg.name for leg in athena.legs], cycles=3.0)
    shown = np.zeros(6)
    for bar in ax.patches:
        shown[round(bar.get_y() + 0.5 * bar.get_height())] += bar.get_width()
        middle = bar.get_x() + 0.5 * bar.get_width()
        assert np.isnan(gait.swing_share(middle)[round(bar.get_y() + 0.5 * bar.get_height())])
    np.testing.assert_allclose(shown, 3.0 * gait.duty_factor, atol=1e-9)
    plt.close("all")


def test_joints_may_have_any_names(athena):
    """Names that are not Greek letters are printed as they are."""
    names = dict(zip(athena.table.joints, ("coxa", "hip_pitch", "phi_3"), strict=True))
    rows = tuple(dataclasses.replace(row, theta=names.get(row.theta, row.theta)) for row in athena.table.rows)
    table = dataclasses.replace(athena.table, rows=rows, joints=tuple(names.values()))
    robot = dataclasses.replace(athena, table=table)
    figure, axes = plt.subplots(3)
    figures.plot_leg_angles(axes[0], [0.0, 1.0], np.zeros((2, 3)), robot)
    axes[0].legend()
    figures.draw_joint_angles(axes[1], axes[2], robot, robot.standing_q, 0)
    figure.canvas.draw()
    assert [line.get_label() for line in axes[0].lines] == ["coxa", "hip_pitch", r"$\phi_{3}$"]
    plt.close(figure)
