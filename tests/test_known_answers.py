"""Balls and blocks on the engine that walks the robot: what mechanics says must happen, to within the time step."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hexakin as hk
from hexakin.engines.free_bodies import Ball, Block, free_bodies
from hexakin.engines.moreau_stepper import MoreauStepper
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.robot.model import GRAVITY as G
from hexakin.terrain import Plane, Ramp


def scene(*bodies, terrain=None, **options):
    model, shapes = free_bodies(*bodies)
    return MoreauStepper(model, shapes, terrain or Plane(), groups=len(bodies), **options)


def on_slope(slope, height, heading=0.0, **options):
    """A 1 kg block resting on a ramp that rises along ``heading``, as a stepper and its axes along and across."""
    block = scene(Block(1.0, (0.2, 0.2, 2 * height)), terrain=Ramp(slope=slope, heading=heading), **options)
    turn = Rotation.from_euler("z", heading) * Rotation.from_euler("y", -slope)
    block.place([*turn.apply([0, 0, height]), *turn.as_quat()])
    return block


def heading_at(angle, slope):
    """Heading of a ramp whose fall line makes this angle with a contact's first generator, the x axis laid into it."""
    return np.arctan(np.cos(slope) * np.tan(angle))


# Sliding ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.3, 0.5, 0.9])
@pytest.mark.parametrize("share", [0.9, 0.999, 1.001, 1.1])
def test_a_block_sticks_exactly_up_to_the_friction_angle_and_then_slides(mu, share):
    slope = np.arctan(share * mu)
    block = on_slope(slope, 0.02, friction=mu)
    block.advance(500)
    along = max(0.0, G * (np.sin(slope) - mu * np.cos(slope))) * 0.5
    # Loaded contacts give way by compliance * g * h; nothing else lies between this and the exact answer.
    assert block.v[0] == pytest.approx(-along, abs=3e-6 * G * 1e-3)
    assert block.v[1:] == pytest.approx(np.zeros(5), abs=1e-6)


@pytest.mark.parametrize("speed", [0.5, 2.0])
@pytest.mark.parametrize("time_step", [1e-3, 1e-4])
def test_a_sliding_block_stops_after_its_braking_distance(speed, time_step):
    mu = 0.4
    block = scene(Block(1.0, (0.2, 0.2, 0.02)), friction=mu, time_step=time_step)
    block.place([0, 0, 0.01, 0, 0, 0, 1], [speed, 0, 0, 0, 0, 0])
    block.advance(round(1.2 * speed / (mu * G) / time_step))
    # The last step ends within mu g h of rest.
    assert block.q[0] == pytest.approx(speed**2 / (2 * mu * G), abs=mu * G * time_step**2 + 1e-7)
    assert np.abs(block.v).max() < 1e-6


def test_a_sphere_slides_and_then_rolls_at_five_sevenths_of_its_speed():
    mu, speed, radius, h = 0.3, 1.0, 0.05, 1e-4
    ball = scene(Ball(1.0, radius), friction=mu, time_step=h)
    ball.place([0, 0, radius, 0, 0, 0, 1], [speed, 0, 0, 0, 0, 0])
    slip = []
    for _ in range(1500):
        ball.advance(1)
        world = Rotation.from_quat(ball.q[3:]).apply(ball.v.reshape(2, 3))
        slip.append(world[0, 0] - radius * world[1, 1])
    slip = np.array(slip)
    rolling = np.argmax(slip < 1e-6) * h
    assert rolling == pytest.approx(2 * speed / (7 * mu * G), abs=2 * h)
    assert world[0, 0] == pytest.approx(5 * speed / 7, abs=1e-6)
    assert np.abs(slip[int(rolling / h) + 2 :]).max() < 1e-6


@pytest.mark.parametrize("facets", [4, 8, 16])
def test_between_two_generators_a_polyhedron_slides_from_a_fraction_of_the_friction_on(facets):
    """cos(pi/k) of mu N holds there; along a generator, and in every direction with the cone, all of it does."""
    mu, weak = 0.5, np.cos(np.pi / facets)
    for share, angle, sides, slides in [
        (0.995 * weak, np.pi / facets, facets, False),
        (1.005 * weak, np.pi / facets, facets, True),
        (0.995, np.pi / facets, facets, True),
        (0.995, 0.0, facets, False),
        (0.995, np.pi / facets, None, False),
    ]:
        slope = np.arctan(share * mu)
        block = on_slope(slope, 0.02, heading_at(angle, slope), friction=mu, facets=sides)
        block.advance(100)
        expected = G * 0.1 * (np.sin(slope) - weak * mu * np.cos(slope)) if slides else 0.0
        # One of the two generators may act alone, and the block then leave the fall line sideways.
        assert -block.v[0] == pytest.approx(expected, rel=1e-3, abs=1e-6)


def test_the_polyhedron_becomes_the_cone_as_its_facets_grow():
    mu, slope = 0.3, np.arctan(0.6)
    along = []
    for facets in (4, 8, 16, 32, None):
        angle = np.pi / (facets or 32)
        block = on_slope(slope, 0.02, heading_at(angle, slope), friction=mu, facets=facets)
        block.advance(1)
        along.append(-block.v[0])
    excess = np.array(along[:-1]) - along[-1]
    assert (excess > 0.0).all()
    # 1 - cos(pi/k): a quarter for twice the facets.
    assert excess[1:] / excess[:-1] == pytest.approx([0.25, 0.25, 0.25], abs=0.02)


# Impacts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["poisson", "newton"])
@pytest.mark.parametrize("time_step", [1e-3, 2e-4])
@pytest.mark.parametrize("xi", [0.5, 0.8])
def test_a_dropped_ball_returns_to_the_square_of_its_restitution(law, time_step, xi):
    drop, radius = 0.5, 0.05
    ball = scene(Ball(1.0, radius), restitution=xi, restitution_law=law, time_step=time_step)
    ball.place([0, 0, radius + drop, 0, 0, 0, 1])
    ending = np.sqrt(2 * drop / G) * (1 + xi) / (1 - xi)
    height = np.array([ball.advance(1) and ball.q[2] - radius for _ in range(round(1.1 * ending / time_step))])
    top = (height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])
    apexes = height[1:-1][top][:4]
    count = np.arange(1, 5)
    # A bounce comes up to half a step early or late, higher or deeper by v h / 2; so it does at each.
    speed = np.sqrt(2 * G * drop)
    assert apexes == pytest.approx(drop * xi ** (2 * count), abs=speed * time_step)
    # Its speed is then wrong by up to g h / 2, which every later bounce feels: by 2 (g h / 2) / g / (1 - xi) in all.
    # The bounces end under 5 g h, when 2 (5 g h) / g / (1 - xi) are missing.
    bounces = np.log(speed / (5 * G * time_step)) / np.log(1 / xi)
    moving = np.flatnonzero(height > 0.5 * G * (5 * time_step) ** 2)[-1] * time_step
    assert moving == pytest.approx(ending, abs=(bounces + 10) / (1 - xi) * time_step)
    assert abs(height[-1]) < speed * time_step


@pytest.mark.parametrize("width, tall", [(0.1, 0.2), (0.1, 0.3), (0.06, 0.3)])
def test_a_rocking_block_keeps_the_share_of_its_spin_that_housner_found(width, tall):
    """Plastic and without slip: 1 - 1.5 sin^2 alpha, alpha from the vertical side to the diagonal (Housner 1963)."""
    alpha, h = np.arctan(width / tall), 1e-4
    block = scene(Block(1.0, (width, 0.1, tall)), friction=50.0, restitution=0.0, time_step=h)
    turn = Rotation.from_euler("y", 0.5 * alpha)
    center = turn.apply([-width / 2, 0, tall / 2])
    block.place([*center, *turn.as_quat()])
    spin, tilt = [0.0], [0.5 * alpha]
    while tilt[-1] > -0.01:
        block.advance(1)
        spin.append(block.v[4])
        tilt.append(2 * np.arctan2(block.q[4], block.q[6]))
    strike = int(np.argmax(np.diff(spin)))
    # Within a step gravity changes the spin by g h / (4/3 of the half diagonal) sin(alpha).
    assert spin[strike + 1] / spin[strike] == pytest.approx(1 - 1.5 * np.sin(alpha) ** 2, abs=5e-3)


@pytest.mark.parametrize("law, mu", [("poisson", 0.6), ("poisson", 0.0), ("newton", 0.0)])
def test_energy_never_rises_without_actuation(law, mu, rng):
    rises = []
    for h in (1e-3, 2.5e-4):
        worst = 0.0
        for _ in range(3):
            block = scene(
                Block(1.0, (0.2, 0.1, 0.05)), terrain=Ramp(slope=0.1), friction=mu, restitution=0.7,
                restitution_law=law, time_step=h,
            )  # fmt: skip
            block.place([0, 0, 0.3, *Rotation.random(random_state=rng).as_quat()], rng.normal(0, 2, 6))
            energy = [block.energy()]
            for _ in range(round(0.8 / h)):
                block.advance(1)
                energy.append(block.energy())
            energy = np.array(energy)
            worst = max(worst, float((energy - np.minimum.accumulate(energy)).max()) / energy[0])
        rises.append(worst)
    # What is left is the configuration's motion within a step: of second order, and gone with the step.
    assert rises[0] < 2e-4
    assert rises[1] < max(0.5 * rises[0], 2e-5)


def test_a_tumbling_block_keeps_energy_and_momentum_in_flight():
    block = scene(Block(1.0, (0.2, 0.1, 0.05)))
    block.place([0, 0, 50.0, 0, 0, 0, 1], [1, 0, 0, 5, 20, 3])
    inertia = np.array([0.1**2 + 0.05**2, 0.2**2 + 0.05**2, 0.2**2 + 0.1**2]) / 12

    def momentum():
        return Rotation.from_quat(block.q[3:]).apply(inertia * block.v[3:])

    energy, spin = block.energy(), momentum()
    block.advance(1000)
    assert block.energy() == pytest.approx(energy, rel=1e-5)
    # Of second order in the turn per step, 0.02 rad.
    assert momentum() == pytest.approx(spin, abs=1e-3 * np.linalg.norm(spin))


# Loads -----------------------------------------------------------------------------------------------------------


def test_stacked_blocks_hand_down_their_weights():
    stack = scene(Block(1.0, (0.2, 0.2, 0.1)), Block(2.0, (0.15, 0.1, 0.1)), friction=0.4)
    stack.place([0, 0, 0.05, 0, 0, 0, 1, 0.02, 0, 0.15, 0, 0, 0, 1])
    stack.advance(500)
    force = stack.advance(100).normal_impulse / 0.1
    assert force == pytest.approx([3.0 * G, 2.0 * G], rel=1e-6)
    assert np.abs(stack.v).max() < 1e-6


def test_a_block_on_the_edge_of_another_topples():
    stack = scene(Block(1.0, (0.2, 0.2, 0.1)), Block(0.2, (0.2, 0.1, 0.05)), friction=0.4)
    stack.place([0, 0, 0.05, 0, 0, 0, 1, 0.12, 0, 0.125, 0, 0, 0, 1])
    stack.advance(300)
    upper = stack.q[7:]
    assert upper[2] < 0.1 and abs(Rotation.from_quat(upper[3:]).as_euler("xyz")[1]) > 0.2


def test_the_work_of_contacts_is_the_energy_lost():
    mu, speed = 0.4, 1.0
    block = scene(Block(1.0, (0.2, 0.2, 0.02)), friction=mu)
    block.place([0, 0, 0.01, 0, 0, 0, 1], [speed, 0, 0, 0, 0, 0])
    work = block.advance(500).contact_work
    assert work == pytest.approx(-0.5 * speed**2, abs=1e-6)


@pytest.mark.parametrize("terrain, ground", [(Plane(), 0.0), (hk.terrain.Blocks(level=0.35), None)])
def test_torso_sized_blocks_lie_on_blocks_and_planes_alike(terrain, ground):
    base = float(terrain.height(0.0, 0.0))
    block = scene(Block(1.0, (0.12, 0.2, 0.056)), terrain=terrain, restitution=0.0)
    block.place([0.05, 0.02, base + 0.028 + 0.02, *Rotation.from_euler("xyz", [0.1, -0.1, 0.3]).as_quat()])
    force = [block.advance(500).normal_impulse[0] / 0.5 for _ in range(3)][-1]
    assert force == pytest.approx(G, rel=1e-3)
    assert block.q[2] == pytest.approx(base + 0.028, abs=2e-4)
    assert np.abs(block.v).max() < 1e-3


def test_a_block_rests_with_its_edge_across_the_edge_of_a_step():
    """Two boxes that touch edge to edge only: neither has a corner in the other."""
    terrain = hk.terrain.Blocks(size=0.2, heights=(0.1, 0.1), level=0.0, extent=(-0.1, 0.1, -0.1, 0.1))
    plank = scene(Block(1.0, (0.5, 0.06, 0.02)), terrain=terrain, friction=0.9, restitution=0.0)
    # It leans on the block's upper edge and stands on the ground.
    angle = np.radians(40.0)
    turn = Rotation.from_euler("y", angle)
    plank.place([*(np.array([0.1, 0, 0.1]) + turn.apply([0.05, 0.0, 0.0105])), *turn.as_quat()])
    plank.advance(1500)
    corners = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.03, 0.03) for z in (-0.01, 0.01)])
    points = Rotation.from_quat(plank.q[3:]).apply(corners) + plank.q[:3]
    assert points[:, 2].min() > -1.2e-3
    inside = (
        Rotation.from_quat(plank.q[3:])
        .inv()
        .apply(np.array([[0.1, y, 0.1] for y in np.linspace(-0.09, 0.09, 19)]) - plank.q[:3])
    )
    depth = (np.array([0.25, 0.03, 0.01]) - np.abs(inside)).min(axis=1)
    assert depth.max() < 1.2e-3


# Terrain ---------------------------------------------------------------------------------------------------------


def rolling_ball(terrain, radius=0.02):
    ball = scene(Ball(0.1, radius), terrain=terrain, restitution=0.0, friction=0.0)
    return ball


def test_a_ball_glides_over_the_seams_of_level_blocks():
    terrain = hk.terrain.Blocks(size=0.1, heights=(0.05, 0.05), level=0.0, extent=(-0.5, 0.5, -0.5, 0.5))
    ball = rolling_ball(terrain)
    ball.place([-0.3, 0.03, 0.05 + 0.02, 0, 0, 0, 1], [1.0, 0.3, 0, 0, 0, 0])
    ball.advance(500)
    assert ball.v[:3] == pytest.approx([1.0, 0.3, 0.0], abs=1e-6)


def test_a_ball_glides_over_the_seams_of_a_height_field():
    grid = np.linspace(-1, 1, 41)
    slope = 0.2
    z = slope * grid[:, None] + 0.0 * grid[None, :]
    terrain = hk.terrain.HeightField(grid, grid, z)
    normal = terrain.normal(0.0, 0.0)
    ball = rolling_ball(terrain)
    ball.place([*(0.02 * normal), 0, 0, 0, 1], [0, 0.5, 0, 0, 0, 0])
    ball.advance(400)
    down = np.array([normal[2], 0.0, -normal[0]]) * -np.sign(slope)
    expected = 0.4 * G * np.sin(np.arctan(slope)) * down + [0, 0.5, 0]
    assert ball.v[:3] == pytest.approx(expected, abs=1e-6)


def test_a_ball_stops_at_the_side_of_a_block():
    terrain = hk.terrain.Blocks(size=0.2, heights=(0.1, 0.1), level=0.0, extent=(-0.1, 0.1, -0.1, 0.1))
    ball = rolling_ball(terrain)
    ball.place([0.3, 0.01, 0.02, 0, 0, 0, 1], [-1.0, 0, 0, 0, 0, 0])
    ball.advance(600)
    assert ball.q[0] == pytest.approx(0.12, abs=1e-3)
    assert ball.v == pytest.approx(np.zeros(6), abs=1e-5)


def test_a_ball_in_a_valley_touches_both_sides():
    grid = np.linspace(-1, 1, 41)
    valley = hk.terrain.HeightField(grid, grid, np.abs(grid)[:, None] + 0.0 * grid[None, :])
    ball = rolling_ball(valley)
    ball.place([0.01, 0.013, 0.05, 0, 0, 0, 1])
    ball.advance(1500)
    assert ball.q[2] == pytest.approx(0.02 * np.sqrt(2), abs=1e-3)
    force = ball.advance(100).normal_impulse / 0.1
    assert force[0] == pytest.approx(0.1 * G * np.sqrt(2), rel=1e-3)


def test_a_peak_holds_up_the_middle_of_a_plate():
    grid = np.linspace(-0.5, 0.5, 21)
    z = np.zeros((21, 21))
    z[10, 10] = 0.05
    plate = scene(Block(1.0, (0.3, 0.3, 0.02)), terrain=hk.terrain.HeightField(grid, grid, z), restitution=0.0)
    plate.place([0, 0, 0.0605, 0, 0, 0, 1])
    force = plate.advance(200).normal_impulse / 0.2
    assert plate.q[2] == pytest.approx(0.06, abs=1e-4)
    assert force[0] == pytest.approx(G, rel=0.1)


def test_a_plate_lies_on_a_rough_field(rng):
    """Hundreds of peaks under one plate: it comes to rest on them, and none pokes deep into it."""
    grid = np.linspace(-0.5, 0.5, 101)
    field = hk.terrain.HeightField(grid, grid, 0.003 * rng.random((101, 101)))
    plate = scene(Block(1.0, (0.12, 0.2, 0.056)), terrain=field, restitution=0.0)
    plate.place([0, 0, 0.04, 0, 0, 0, 1])
    plate.advance(600)
    sums = plate.advance(100)
    assert sums.normal_impulse[0] == pytest.approx(0.1 * G, rel=1e-3)
    assert sums.penetration < 5e-4
    assert np.abs(plate.v).max() < 1e-4


# Errors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, culprit",
    [
        ({"time_step": 0.0}, "time_step"),
        ({"friction": -0.1}, "friction"),
        ({"restitution": 1.5}, "restitution"),
        ({"facets": 5}, "facets"),
        ({"facets": 2}, "facets"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"compliance": -1.0}, "compliance"),
    ],
)
def test_impossible_options_are_named(options, culprit):
    with pytest.raises(InvalidInputError, match=culprit):
        scene(Ball(1.0, 0.1), **options)


def test_unknown_laws_and_bad_bodies_are_named():
    with pytest.raises(UnknownNameError, match="stronge"):
        scene(Ball(1.0, 0.1), restitution_law="stronge")
    with pytest.raises(InvalidInputError, match="body 2: mass"):
        free_bodies(Ball(1.0, 0.1), Ball(-1.0, 0.1))
    with pytest.raises(InvalidInputError, match="command"):
        scene(Ball(1.0, 0.1)).advance(1, [0.0])


def test_a_free_body_goes_straight_and_turns_at_its_rate(rng):
    model, shapes = free_bodies(Block(1.0, (0.1, 0.1, 0.1)))
    turn = Rotation.random(random_state=rng)
    for scale in (1e-9, 1e-3, 1.0, 50.0):
        v, t = scale * rng.normal(size=6), 0.03
        stepper = MoreauStepper(model, shapes, Plane(), time_step=0.01)
        stepper.place([0, 0, 1000.0, *turn.as_quat()], v)
        stepper.advance(3)
        fall = [0, 0, 1000.0 - 0.5 * G * t**2]
        assert stepper.q[:3] == pytest.approx(fall + turn.apply(v[:3]) * t, abs=1e-11)
        expected = turn * Rotation.from_rotvec(v[3:] * t)
        assert (Rotation.from_quat(stepper.q[3:]) * expected.inv()).magnitude() < 1e-11
        assert Rotation.from_quat(stepper.q[3:]).apply(stepper.v[:3]) == pytest.approx(
            turn.apply(v[:3]) - [0, 0, G * t], abs=1e-9 * (1 + scale)
        )
