"""One gap between robot and ground for checks, design questions, sliders, simulations and summaries."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.feasibility import best_posture, check, commanded_walk, longest_stride, steepest_slope
from hexakin.figures.sliders import posture_of_body
from hexakin.motion.clearance import foot_gaps, torso_gaps, way_to_ground
from hexakin.motion.motion import Motion
from hexakin.robot_summary import remarks, summarise
from hexakin.simulation.closed_loop import starting_pose
from hexakin.transforms import axis_rotation, pose, transform_points

TENTH_OF_A_MM = 1e-4


@pytest.fixture
def slung(edited):
    """ATHENA with its torso's mass and box beside, behind and below the body's origin."""
    return edited("athena", lambda tree: tree["torso"].update(center_of_mass_mm=[12.0, -20.0, -90.0]))


def standing(robot, rotation=None, height=None):
    height = hk.kinematics.standing_height(robot) if height is None else height
    return pose(np.eye(3) if rotation is None else rotation, [0.0, 0.0, height])


def resting(robot, T_world_body):
    """A motion of two instants at one pose, on all feet."""
    q = np.array([robot.standing_q] * 2)
    carrying = np.ones((2, robot.num_legs), dtype=bool)
    feet = hk.forward_kinematics(robot, q)
    return Motion(np.array([0.0, 1.0]), np.array([T_world_body] * 2), feet, q, carrying, ~carrying)


def test_the_torsos_corners_stand_around_its_centre_of_mass(slung):
    low, high = slung.torso_corners.min(axis=0), slung.torso_corners.max(axis=0)
    np.testing.assert_allclose(high - low, slung.torso.size)
    np.testing.assert_allclose(0.5 * (high + low), [0.012, -0.020, -0.090])
    np.testing.assert_allclose(slung.torso_corners[::2, 2], low[2])
    assert slung.torso_corners.shape == (8, 3) and len(np.unique(slung.torso_corners, axis=0)) == 8


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.2, -0.15, 0.4)])
def test_a_torso_off_the_origin_has_one_clearance(slung, rpy):
    ground, height = hk.terrain.Plane(), hk.kinematics.standing_height(slung)
    T = standing(slung, hk.transforms.rpy_rotation(rpy))
    lowest = transform_points(T, slung.torso_corners)[:, 2].min()
    assert lowest < 0.0
    assert torso_gaps(slung, ground, T) == pytest.approx(lowest, abs=1e-12)
    assert check(slung, resting(slung, T), ground).constraints["torso clearance"].worst == pytest.approx(lowest)
    posture = posture_of_body(slung, np.zeros(3), rpy)
    assert posture.torso_clearance == pytest.approx(lowest)
    assert posture.faults[0] == f"torso: {-1e3 * lowest:.1f} mm below the floor"
    if not any(rpy):
        assert f"torso's underside {1e3 * lowest:.1f} mm above the ground" in summarise(slung)
        assert any("torso's underside is" in remark for remark in remarks(slung))
        start = starting_pose(slung, ground, slung.standing_q)
        assert start[2, 3] - height == pytest.approx(1e-3 - lowest, abs=TENTH_OF_A_MM)


@pytest.mark.parametrize("engine", ["rigid", "pybullet", "mujoco"])
def test_an_engines_torso_lies_on_the_ground_where_its_clearance_is_zero(slung, engine):
    ground = hk.terrain.Plane()
    controller = hk.PostureController(slung, apex=0.01)
    walk = hk.simulate(slung, ground, controller, engine=engine, duration=0.2, time_step=0.002, settling_time=0.5)
    assert (walk.torso_force > 0.0).all()
    # PyBullet and MuJoCo let boxes sink in a little.
    assert np.abs(torso_gaps(slung, ground, walk.T_world_body)).max() < (1 if engine == "rigid" else 10) * TENTH_OF_A_MM


def test_a_torso_above_the_origin_is_not_in_the_ground(edited):
    """The body's origin at ground level, as in many robots' files: what counts is where the box is."""
    high = edited("athena", lambda tree: tree["torso"].update(center_of_mass_mm=[0.0, 0.0, 90.0]))
    ground = hk.terrain.Plane()
    report = check(high, resting(high, standing(high)), ground)
    clearance = hk.kinematics.standing_height(high) + 0.090 - 0.5 * high.torso.size[2]
    assert report.constraints["torso clearance"].worst == pytest.approx(clearance)


def test_design_questions_know_where_the_torso_is(edited):
    low = edited("athena", lambda tree: tree["torso"].update(center_of_mass_mm=[0.0, 0.0, -70.0]))
    under = 0.070 + 0.5 * low.torso.size[2]
    for question in (longest_stride, steepest_slope):
        answer = question(low, under - 0.001)
        assert not answer.feasible and np.isnan(answer.value) and answer.active == ("torso clearance",)
        assert question(low, under + 0.001).feasible
    assert best_posture(low).variables["height"] >= under - 1e-9


def test_design_questions_without_a_torso_in_the_way_are_as_before(athena):
    assert longest_stride(athena).value == pytest.approx(0.0675088741)
    assert best_posture(athena).value == pytest.approx(1.8899828088)


def test_uneven_ground_between_the_torsos_corners_counts(athena):
    """A bump under the middle of the torso, which no corner is near."""
    grid = np.linspace(-0.6, 0.6, 121)
    bump = np.where(np.hypot.outer(grid, grid) < 0.03, 0.09, 0.0)
    ground, T = hk.terrain.HeightField(grid, grid, bump), standing(athena)
    assert torso_gaps(athena, ground, T) == pytest.approx(athena.torso_corners[:, 2].min() + T[2, 3] - 0.09)
    assert torso_gaps(athena, ground, np.array([T, T])).shape == (2,)


def test_a_gap_is_counted_along_the_grounds_normal(athena):
    for slope in (0.0, 0.3, 0.7):
        ramp = hk.terrain.Ramp(slope=slope)
        T = pose(axis_rotation([1.0, 0.0, 0.0], slope), np.zeros(3))
        feet = T[:3, :3] @ [0.1, 0.2, athena.foot_radius + 0.004]
        assert foot_gaps(athena, ramp, feet) == pytest.approx(0.004)


class Listening:
    """A controller that keeps what it was told, and what it commanded."""

    def __init__(self, controller):
        self.controller, self.seen = controller, []
        self.robot, self.phases_per_cycle = controller.robot, controller.phases_per_cycle
        self.parameters = controller.parameters

    def start(self, observation, control_rate):
        self.run = self.controller.start(observation, control_rate)
        return self

    def command(self, observation):
        command = self.run.command(observation)
        self.seen.append((observation, command))
        return command


@pytest.mark.parametrize("slope", np.arange(0.0, 0.71, 0.1))
def test_landed_feet_are_loaded_on_every_slope(athena, slope):
    ramp = hk.terrain.Ramp(slope=slope)
    listening = Listening(hk.PostureController(athena))
    motion = commanded_walk(listening, ramp, num_cycles=2)
    gaps = foot_gaps(athena, ramp, transform_points(motion.T_world_body, motion.p_body_foot))
    told = np.array([observation.foot_force > 0.0 for observation, _ in listening.seen[1:]])
    landed = gaps[: len(told)] < 2e-3
    np.testing.assert_array_equal(told, landed | motion.carrying[: len(told)])
    phase = np.array([command.phase for _, command in listening.seen])
    changes = np.flatnonzero(np.diff(phase) > 0)
    assert len(changes) >= 3 and told[changes].all(), "at a change of phase every foot stands"


def test_terrains_of_other_kinds_are_named_everywhere(athena):
    controller, curves = hk.PostureController(athena), hk.terrain.LegCurves()
    motion = commanded_walk(controller, hk.terrain.Plane(), num_cycles=1)
    for wrong in ("ramp", hk.terrain.Ramp, None):
        for call in (
            lambda ground: hk.simulate(athena, ground, controller),
            lambda ground: commanded_walk(controller, ground),
            lambda ground: check(athena, motion, ground),
            lambda ground: hk.plan_walk(athena, ground),
        ):
            with pytest.raises(hk.exceptions.InvalidInputError, match="terrain: expected a Terrain"):
                call(wrong)
    with pytest.raises(hk.exceptions.InvalidInputError, match="terrain: expected a Terrain, got LegCurves"):
        commanded_walk(controller, curves)


@pytest.mark.parametrize("rise", [0.5, 1.0, 2.0])
def test_a_start_on_a_bank_is_just_above_the_ground(athena, rise):
    """Level ground in the middle and a bank beside it: the lowest foot or the torso is a millimetre above it."""
    grid, q = np.linspace(-3.0, 3.0, 301), athena.standing_q
    bank = rise * np.maximum(grid - 0.1, 0.0)[:, None] + np.zeros_like(grid)
    for height in (bank, np.maximum(bank, 0.3 * np.hypot.outer(grid, grid))):
        ground = hk.terrain.HeightField(grid, grid, height)
        T = starting_pose(athena, ground, q)
        feet = transform_points(T, hk.forward_kinematics(athena, q))
        gaps = foot_gaps(athena, ground, feet)
        assert min(gaps.min(), torso_gaps(athena, ground, T)) == pytest.approx(1e-3, abs=1e-8)
        up = T[:3, 2]
        way = way_to_ground(athena, ground, T, q, up, gap=0.0, torso=False)
        assert foot_gaps(athena, ground, feet + way * up).min() == pytest.approx(0.0, abs=1e-8)


def test_a_robot_whose_origin_is_below_the_ground_has_a_best_posture(edited):
    """Legs that start 180 mm above the body's origin, and the torso's box there too."""

    def raise_all(tree):
        tree["torso"]["center_of_mass_mm"] = [0.0, 0.0, 180.0]
        tree["leg_table"]["mount"] = ["x", "y", "z"]
        tree["leg_table"].setdefault("parameters", {}).update(x=0.0, y=0.0, z_mm=180.0)

    raised, plain = edited("athena", raise_all), hk.load_robot("athena")
    assert hk.kinematics.standing_height(raised) == pytest.approx(hk.kinematics.standing_height(plain) - 0.180)
    answer, expected = best_posture(raised), best_posture(plain)
    assert answer.feasible and answer.value == pytest.approx(expected.value, abs=1e-3)
    height = hk.kinematics.standing_height(raised)
    assert longest_stride(raised, height).value == pytest.approx(longest_stride(plain).value, abs=1e-5)
