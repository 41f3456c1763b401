"""Balls and blocks that meet each other on the rigid engine, against known answers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hexakin.engines.free_bodies import Ball, Block, free_bodies
from hexakin.engines.moreau_stepper import MoreauStepper
from hexakin.robot.model import GRAVITY as G
from hexakin.terrain import Plane

LEVEL = (0.0, 0.0, 0.0, 1.0)


def scene(*bodies, **options):
    model, shapes = free_bodies(*bodies)
    return MoreauStepper(model, shapes, Plane(), groups=len(bodies), **options)


def heights(stepper):
    return stepper.q[2::7]


@pytest.mark.parametrize("ball_first", [True, False])
def test_a_ball_falls_on_a_block_and_rests_on_it(ball_first):
    ball, block = Ball(0.2, 0.03), Block(1.0, (0.2, 0.2, 0.1))
    poses = [[0.01, 0.02, 0.2, *LEVEL], [0.0, 0.0, 0.05, *LEVEL]]
    order = 1 if ball_first else -1
    pair = scene(*(ball, block)[::order], restitution=0.3, friction=0.5)
    pair.place(np.concatenate(poses[::order]))
    pair.advance(1500)
    assert heights(pair)[::order] == pytest.approx([0.13, 0.05], abs=1e-4)
    assert np.abs(pair.v).max() < 1e-5
    force = pair.advance(100).normal_impulse / 0.1
    # The force between two bodies counts for the later one.
    assert force == pytest.approx([0.0, 1.4 * G] if ball_first else [1.2 * G, 0.2 * G], rel=1e-6)


def test_a_ball_rests_on_the_edges_of_two_blocks():
    block = Block(5.0, (0.1, 0.1, 0.2))
    trio = scene(block, block, Ball(0.1, 0.05), friction=0.5, restitution=0.0)
    trio.place([-0.08, 0, 0.1, *LEVEL, 0.08, 0, 0.1, *LEVEL, 0, 0, 0.245, *LEVEL])
    trio.advance(500)
    assert trio.q[[0, 7, 14]] == pytest.approx([-0.08, 0.08, 0.0], abs=1e-5)
    # Each edge is 0.03 m from the middle.
    assert heights(trio) == pytest.approx([0.1, 0.1, 0.24], abs=1e-4)
    assert np.abs(trio.v).max() < 1e-5


def test_balls_exchange_their_speeds():
    pair = scene(Ball(0.1, 0.02), Ball(0.1, 0.02), restitution=1.0, friction=0.0, compliance=0.0)
    pair.place([-0.1, 0, 1.0, *LEVEL, 0.1, 0, 1.0, *LEVEL], [1.0, 0, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 0])
    pair.advance(200)
    assert pair.v[[0, 6]] == pytest.approx([-0.5, 1.0], abs=1e-9)
    assert pair.v[[2, 8]] == pytest.approx([-0.2 * G, -0.2 * G], abs=1e-9)


def test_three_blocks_stay_stacked():
    blocks = [Block(1.0, (0.2, 0.2, 0.1)), Block(2.0, (0.1, 0.16, 0.08)), Block(0.5, (0.15, 0.1, 0.02))]
    stack = scene(*blocks, friction=0.5)
    turn = Rotation.from_euler("z", 0.4).as_quat()
    start = [0, 0, 0.05, *LEVEL, 0.02, -0.01, 0.14, *turn, 0.01, 0, 0.19, *LEVEL]
    stack.place(start)
    stack.advance(1000)
    assert stack.q == pytest.approx(start, abs=5e-5)
    assert stack.advance(100).normal_impulse / 0.1 == pytest.approx(np.array([3.5, 2.5, 0.5]) * G, rel=1e-6)


@pytest.mark.parametrize("law", ["poisson", "newton"])
def test_energy_never_rises_when_bodies_fall_on_each_other(law, rng):
    bodies = [Block(1.0, (0.2, 0.15, 0.1)), Ball(0.3, 0.05), Block(0.4, (0.1, 0.1, 0.1)), Ball(0.1, 0.03)]
    heap = scene(*bodies, friction=0.5, restitution=0.4, restitution_law=law)
    turns = Rotation.random(4, random_state=rng).as_quat()
    places = np.column_stack([rng.uniform(-0.03, 0.03, (4, 2)), [0.15, 0.35, 0.55, 0.75]])
    heap.place(np.column_stack([places, turns]).ravel())
    energy, first = heap.energy(), heap.energy()
    for _ in range(150):
        heap.advance(10)
        assert heap.energy() < energy + 1e-3
        energy = heap.energy()
    assert energy < 0.5 * first
    # No body has fallen through another one or the ground.
    assert (heights(heap) > [0.049, 0.049, 0.049, 0.029]).all()
