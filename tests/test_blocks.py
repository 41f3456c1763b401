"""Paper A's testbed of blocks: how it lies, how it is seen along rays, and that PyBullet holds the same ground."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.engines import engine_class
from hexakin.exceptions import InvalidInputError
from hexakin.simulation.closed_loop import starting_pose
from hexakin.terrain import Blocks, Box, HalfSpace

SIZES = [0.1, 0.2]


def largest_step(tops):
    return max(np.abs(np.diff(tops, axis=axis)).max() for axis in (0, 1))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("max_step", [0.005, 0.03, 0.06])
def test_neighbours_differ_by_at_most_max_step(size, max_step):
    for seed in range(40):
        blocks = Blocks(size=size, max_step=max_step, seed=seed)
        assert 0.9 * max_step < largest_step(blocks.tops) <= max_step + 1e-12
        assert blocks.tops.min() >= 0.04 and blocks.tops.max() <= 0.13


@pytest.mark.parametrize("size", SIZES)
def test_the_whole_range_of_heights_is_used(size):
    """Every ninth of the range holds blocks; a layout covers nearly all of it; high and low are alike."""
    layouts = [Blocks(size=size, seed=seed).tops for seed in range(60)]
    tops = np.concatenate([layout.ravel() for layout in layouts])
    share = np.histogram(tops, bins=9, range=(0.04, 0.13))[0] / tops.size
    assert share.min() > 0.04 and share.max() < 0.19
    assert share == pytest.approx(share[::-1], abs=0.02)
    assert np.median([np.ptp(layout) for layout in layouts]) > 0.085
    assert min(np.ptp(layout) for layout in layouts) > 0.075
    assert tops.std() > 0.75 * 0.09 / np.sqrt(12.0)  # of independent heights


def test_without_a_bound_heights_are_independent_and_uniform():
    layouts = [Blocks(size=0.1, max_step=None, level=0.0, seed=seed).tops for seed in range(30)]
    tops = np.stack(layouts)
    assert np.histogram(tops, bins=9, range=(0.04, 0.13))[0] / tops.size == pytest.approx(np.full(9, 1 / 9), abs=0.01)
    assert np.abs(np.corrcoef(tops[:, :-1].ravel(), tops[:, 1:].ravel())[0, 1]) < 0.02
    assert largest_step(tops[0]) > 0.07


def test_a_bound_of_nothing_is_one_height_and_one_of_the_range_is_no_bound():
    assert np.ptp(Blocks(max_step=0.0).tops) == 0.0
    assert np.array_equal(Blocks(max_step=1.0).tops, Blocks(max_step=None).tops)


def test_equal_arguments_make_equal_terrain_and_another_seed_another():
    one, same, other = Blocks(seed=3), Blocks(heights=[0.04, 0.13], max_step=np.float64(0.03), seed=3), Blocks(seed=4)
    assert one == same and repr(one) == repr(same) and hash(one) == hash(same)
    assert np.array_equal(one.tops, same.tops) and one.shapes() == same.shapes()
    assert one != other and repr(one) != repr(other) and not np.array_equal(one.tops, other.tops)
    assert eval(repr(one)) == one
    with pytest.raises(ValueError, match="read-only"):
        one.tops[0, 0] = 1.0


def test_one_block_is_centred_on_the_origin_and_the_extent_is_covered_by_whole_blocks():
    blocks = Blocks()
    assert blocks.tops.shape == (9, 25)
    assert blocks.x_edges[[0, -1]] == pytest.approx([-0.9, 0.9]) and blocks.y_edges[[0, -1]] == pytest.approx(
        [-0.9, 4.1]
    )
    exact = Blocks(size=0.1, extent=(-0.25, 0.35, 0.05, 0.15))
    assert exact.x_edges == pytest.approx(np.arange(-0.25, 0.36, 0.1)) and exact.y_edges == pytest.approx([0.05, 0.15])
    assert Blocks(size=1.0, extent=(2.6, 2.7, -0.1, 0.1)).tops.shape == (1, 1)


@pytest.mark.parametrize("size", SIZES)
def test_the_start_is_level_and_large_enough_for_the_standing_robot(athena, size):
    feet = hk.forward_kinematics(athena, athena.standing_q)[:, :2]
    rim = athena.foot_radius * np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [0, 0]])
    starts = []
    for seed in range(20):
        blocks, points = Blocks(size=size, seed=seed), (feet[:, None] + rim).reshape(-1, 2)
        start = blocks.height(0.0, 0.0)
        assert (blocks.height(points[:, 0], points[:, 1]) == start).all()
        assert np.ptp(Blocks(size=size, seed=seed, level=0.0).height(points[:, 0], points[:, 1])) > 0.0
        starts.append(start)
    assert np.ptp(starts) > 0.06


def test_around_the_blocks_the_ground_is_level_at_zero(rng):
    blocks = Blocks()
    angle = rng.uniform(0, 2 * np.pi, 50)
    x, y = 5.0 * np.cos(angle), 5.0 * np.sin(angle)
    assert (blocks.height(x, y) == 0.0).all()
    assert blocks.normal(x, y[:, None]).shape == (50, 50, 3)
    assert (blocks.normal(x, y) == [0.0, 0.0, 1.0]).all()


def test_on_an_edge_the_higher_block_counts():
    blocks = Blocks()
    x, y, tops = blocks.x_edges, blocks.y_edges, blocks.tops
    middle = 0.5 * (y[1:] + y[:-1])
    assert np.array_equal(blocks.height(x[1:-1, None], middle), np.maximum(tops[1:], tops[:-1]))
    assert np.array_equal(blocks.height(x[[0, -1], None], middle), tops[[0, -1]])
    corners = np.max([tops[1:, 1:], tops[1:, :-1], tops[:-1, 1:], tops[:-1, :-1]], axis=0)
    assert np.array_equal(blocks.height(x[1:-1, None], y[1:-1]), corners)
    assert blocks.distance_along([x[3], middle[3], 1.0], [0, 0, -1]) == 1.0 - max(tops[2, 3], tops[3, 3])


@pytest.mark.parametrize("size", SIZES)
def test_straight_down_the_distance_is_the_height(size, rng):
    blocks = Blocks(size=size)
    x, y = rng.uniform(-1.2, 1.2, (40, 50)), rng.uniform(-1.2, 4.4, (40, 50))
    for z in (0.5, 0.08, -0.3):
        p = np.stack([x, y, np.full(x.shape, z)], axis=-1)
        assert blocks.distance_along(p, [0, 0, -1]) == pytest.approx(z - blocks.height(x, y), abs=1e-15)


def test_a_level_ray_ends_on_the_side_of_the_first_higher_block():
    blocks = Blocks()
    assert blocks.distance_along([0.0, -2.0, 0.01], [0, 1, 0]) == pytest.approx(1.1)
    row = blocks.tops[4]  # the blocks along x = 0
    first = int(np.argmax(row > 0.11))
    assert first > 0
    z, y = 0.11, blocks.y_edges[0] - 1.0
    assert blocks.distance_along([0.0, y, z], [0, 1, 0]) == pytest.approx(blocks.y_edges[first] - y, abs=1e-12)
    assert blocks.distance_along([0.0, y, 0.2], [0, 1, 0]) == np.inf
    assert blocks.distance_along([0.0, 0.0, 0.2], [0, 0, 1]) == np.inf
    assert blocks.distance_along([0.0, 0.0, 0.01], [0, 0, 1]) < 0.0


def first_hit(shapes, origin, direction):
    """Distance to the nearest of the shapes, one by one: slabs of boxes, and the level half space."""
    nearest = np.full(len(origin), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for shape in shapes:
            if isinstance(shape, HalfSpace):
                t = -origin[:, 2] / direction[:, 2]
                hit = t >= 0.0
            else:
                to_lower, to_upper = ((np.array(c) - origin) / direction for c in (shape.lower, shape.upper))
                t = np.minimum(to_lower, to_upper).max(axis=1)
                hit = (t >= 0.0) & (t <= np.maximum(to_lower, to_upper).min(axis=1))
            nearest = np.where(hit, np.minimum(nearest, t), nearest)
    return nearest


@pytest.mark.parametrize("blocks", [Blocks(), Blocks(size=0.1, max_step=None, extent=(-0.5, 0.5, -0.5, 1.0))], ids=repr)
def test_a_ray_ends_on_the_first_of_the_shapes(blocks, rng):
    origin = np.column_stack([rng.uniform(-1.5, 1.5, 3000), rng.uniform(-1.5, 4.5, 3000), rng.uniform(0.0, 0.3, 3000)])
    origin = origin[origin[:, 2] > blocks.height(origin[:, 0], origin[:, 1])]
    direction = rng.normal(size=origin.shape) * [1.0, 1.0, 0.2]
    for axis in range(3):
        direction[axis::10, axis] = 0.0
    direction = unit(direction)
    distance = blocks.distance_along(origin, direction)
    assert distance == pytest.approx(first_hit(blocks.shapes(), origin, direction), abs=1e-12)
    seen = np.isfinite(distance)
    end = origin[seen] + distance[seen, None] * direction[seen]
    on_a_side = end[:, 2] < blocks.height(end[:, 0], end[:, 1]) - 1e-9
    assert 0.05 < on_a_side.mean() < 0.95 and not seen.all()


def test_the_shapes_are_the_level_ground_and_a_box_for_each_block():
    blocks = Blocks()
    ground, *boxes = blocks.shapes()
    assert ground == HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert len(boxes) == blocks.tops.size and all(isinstance(box, Box) for box in boxes)
    lower, upper = np.array([box.lower for box in boxes]), np.array([box.upper for box in boxes])
    assert (lower < upper).all() and (lower[:, 2] < 0.0).all()
    center = 0.5 * (lower + upper)
    assert np.array_equal(blocks.height(center[:, 0], center[:, 1]), upper[:, 2])
    assert (upper - lower)[:, :2] == pytest.approx(np.full((len(boxes), 2), 0.2))


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"size": 0.0}, r"Blocks: size: 0 m, expected above 0"),
        ({"size": np.nan}, r"Blocks: size: nan"),
        ({"size": 1e-4}, r"Blocks: size: 0.0001 m makes about 7.68e\+08 blocks .* expected at most 100000"),
        ({"heights": (0.13, 0.04)}, r"Blocks: heights: highest: 0.04 m, expected at least 0.13"),
        ({"heights": (-0.01, 0.04)}, r"Blocks: heights: lowest: -0.01 m, expected at least 0"),
        ({"heights": (0.01, np.inf)}, r"Blocks: heights: number 2 is inf"),
        ({"heights": 0.1}, r"heights: expected 2 values, each a number, got 0.1"),
        ({"heights": [(0.0, 0.1)]}, r"heights: expected 2 values, each a number, got \[\(0.0, 0.1\)\]"),
        ({"max_step": -0.01}, r"Blocks: max_step: -0.01 m, expected at least 0"),
        ({"extent": (0.5, 0.5, 0.0, 1.0)}, r"Blocks: extent: x_max: 0.5 m, expected above 0.5"),
        ({"extent": (0.0, 1.0, 1.0, 0.0)}, r"Blocks: extent: y_max: 0 m, expected above 1"),
        ({"extent": (0.0, 1.0)}, r"extent: expected 4 values, each a number, got \(0.0, 1.0\)"),
        ({"level": -1.0}, r"Blocks: level: -1 m, expected at least 0"),
        ({"seed": 0.5}, r"seed: expected a whole number, got 0.5"),
        ({"seed": -1}, r"Blocks: seed: -1, expected a whole number of at least 0"),
    ],
)
def test_impossible_blocks_are_refused_by_name(arguments, message):
    with pytest.raises(InvalidInputError, match=message):
        Blocks(**arguments)


def test_a_ray_that_is_vertical_but_for_rounding_meets_the_block_below():
    blocks = Blocks()
    down = np.array([1e-17, -3e-17, -1.0])
    assert blocks.distance_along([0.0, 0.0, 1.0], down) == pytest.approx(1.0 - blocks.height(0.0, 0.0))


@pytest.mark.pybullet
@pytest.mark.parametrize("size", SIZES)
def test_pybullet_sees_the_same_heights(athena, size, rng):
    """Bullet rounds the edges of its boxes by up to 0.4 mm for rays; 1 mm from every edge it agrees."""
    import pybullet

    blocks = Blocks(size=size, max_step=None)
    x, y = rng.uniform(-1.2, 1.2, 5000), rng.uniform(-1.2, 4.4, 5000)
    far = (np.abs(x[:, None] - blocks.x_edges) > 1e-3).all(axis=1) & (np.abs(y[:, None] - blocks.y_edges) > 1e-3).all(
        axis=1
    )
    top = np.column_stack([x, y, np.full(5000, 0.5)])[far]
    with engine_class("pybullet")(athena, blocks) as engine:
        engine.place(hk.transforms.pose(np.eye(3), [0, 0, 5.0]), athena.standing_q)
        hits = pybullet.rayTestBatch(top.tolist(), (top - [0, 0, 1.0]).tolist(), physicsClientId=engine._client)
    assert len(top) > 4500
    assert [hit[3][2] for hit in hits] == pytest.approx(blocks.height(top[:, 0], top[:, 1]), abs=2e-6)


@pytest.mark.pybullet
@pytest.mark.parametrize("size", SIZES)
def test_athena_stands_still_on_blocks_and_its_feet_carry_its_weight(athena, size):
    blocks, q = Blocks(size=size), athena.standing_q
    with engine_class("pybullet")(athena, blocks) as engine:
        engine.place(starting_pose(athena, blocks, q), q)
        engine.advance(q, 1000)
        readings = [engine.advance(q, 500) for _ in range(4)]
    for reading in readings:
        assert reading.foot_force.sum() == pytest.approx(athena.weight, rel=0.01)
        assert (reading.foot_force > 0.0).all() and reading.torso_force == reading.limb_force == 0.0
    places = np.array([reading.T_world_body[:3, 3] for reading in readings])
    assert np.linalg.norm(places - places[0], axis=1).max() < 1e-3
    assert blocks.distance_along(places, [0, 0, -1]) == pytest.approx(np.full(4, 0.104), abs=1e-3)


def test_athena_walks_onto_blocks_of_other_heights_and_the_recording_names_them(athena):
    blocks = Blocks(size=0.1)
    recording = hk.simulate(athena, blocks, hk.PostureController(athena), duration=5.0, time_step=0.005)
    assert recording.parameters["terrain"] == repr(blocks)
    assert recording.T_world_body[-1, 1, 3] > 0.15
    assert np.isfinite(recording.height).all() and recording.penetration.max() < 5e-3
    under = blocks.height(recording.T_world_body[:, 0, 3], recording.T_world_body[:, 1, 3])
    feet = recording.p_body_foot[-1] @ recording.T_world_body[-1, :3, :3].T + recording.T_world_body[-1, :3, 3]
    assert np.ptp([*under, *blocks.height(feet[:, 0], feet[:, 1])]) > 0.0


def test_a_walk_is_planned_over_blocks(athena):
    blocks = Blocks()
    plan = hk.plan_walk(athena, blocks, num_steps=3, step_length=0.04, heading=np.pi / 2, samples_per_step=20)
    stance = plan.p_world_foot[plan.stance]
    assert stance[:, 2] == pytest.approx(blocks.height(stance[:, 0], stance[:, 1]) + athena.foot_radius, abs=1e-9)
