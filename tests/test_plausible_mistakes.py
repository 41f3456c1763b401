"""Mistakes that people make, each with its error: units, other robots, other terrains, wrong order."""

import dataclasses

import numpy as np
import pytest

import hexakin as hk
from hexakin.control.steering import SteeringController, Twist
from hexakin.exceptions import (
    FileError,
    HexakinError,
    InvalidInputError,
    JointLimitError,
    RecordingError,
    RobotFileError,
    TerrainFileError,
    UnknownNameError,
    UnreachableError,
)
from hexakin.terrain import Blocks, HeightField, LegCurves, Plane, Ramp

GRID = np.linspace(-1.0, 1.0, 5)


@pytest.fixture(scope="module")
def hwr():
    return hk.load_robot("hwr")


@pytest.fixture(scope="module")
def plan(athena):
    return hk.plan_walk(athena, Plane(), num_steps=2, samples_per_step=10)


@pytest.fixture(scope="module")
def walk(athena):
    return hk.feasibility.commanded_walk(hk.PostureController(athena), Plane(), num_cycles=1)


def lifted(walk, height):
    T = walk.T_world_body.copy()
    T[:, 2, 3] += height
    return dataclasses.replace(walk, T_world_body=T)


MISTAKES = {
    # another unit
    "foot in mm": (
        lambda m: hk.inverse_kinematics(m.athena, 1e3 * m.feet, on_unreachable="raise"),
        UnreachableError,
        "leg 1: foot target",
    ),
    "stride in mm": (
        lambda m: hk.PostureController(m.athena, stride=50.0),
        InvalidInputError,
        "stride: 50 m, expected",
    ),
    "apex in mm": (lambda m: hk.PostureController(m.athena, apex=30.0), InvalidInputError, "apex: 30 m, expected"),
    "reference height in mm": (
        lambda m: hk.PostureController(m.athena, reference_height=104.0),
        InvalidInputError,
        "reference_height: 104 m",
    ),
    "largest extension in mm": (
        lambda m: hk.PostureController(m.athena, max_extension=30.0),
        InvalidInputError,
        "max_extension: 30 m",
    ),
    "gain in percent": (
        lambda m: hk.PostureController(m.athena, k_z=80.0),
        InvalidInputError,
        "k_z: 80, expected at least 0 and at most 1",
    ),
    "speed in mm/s": (lambda m: SteeringController(m.athena, Twist(forward=20.0)), UnreachableError, "foot target"),
    "body height in mm": (
        lambda m: SteeringController(m.athena, Twist(), body_height=104.0),
        UnreachableError,
        "foot target",
    ),
    "step in mm": (lambda m: hk.plan_walk(m.athena, Plane(), step_length=50.0), UnreachableError, "foot target"),
    "planned height in mm": (
        lambda m: hk.plan_walk(m.athena, Plane(), body_height=104.0),
        UnreachableError,
        "foot target",
    ),
    "slope in degrees": (lambda m: Ramp(slope=10.0), InvalidInputError, "slope"),
    "slope in degrees in a design": (
        lambda m: hk.feasibility.best_posture(m.athena, slope=10.0),
        InvalidInputError,
        "slope",
    ),
    "heading of a ramp in degrees": (lambda m: Ramp(heading=90.0), InvalidInputError, "heading: 90 rad, expected"),
    "heading of a plan in degrees": (
        lambda m: hk.plan_walk(m.athena, Plane(), heading=90.0),
        InvalidInputError,
        "heading: 90 rad, expected",
    ),
    "yaw in degrees": (lambda m: hk.plan_walk(m.athena, Plane(), yaw=-90.0), InvalidInputError, "yaw: -90 rad"),
    "heading of a margin in degrees": (
        lambda m: hk.stance.longitudinal_margin(m.contacts, 90.0),
        InvalidInputError,
        "heading: 90 rad, expected",
    ),
    "perturbation in degrees": (lambda m: m.simulate(perturbation=2.0), InvalidInputError, "perturbation: 2 rad"),
    "phase in ms": (
        lambda m: hk.PostureController(m.athena, phase_duration=1000.0),
        InvalidInputError,
        "phase_duration: 1000 s, expected above 0 and at most 120",
    ),
    "cycle in ms": (
        lambda m: SteeringController(m.athena, Twist(), cycle_duration=2000.0),
        InvalidInputError,
        "cycle_duration: 2000 s",
    ),
    "rise in ms": (
        lambda m: SteeringController(m.athena, Twist(), rise_duration=1000.0),
        InvalidInputError,
        "rise_duration: 1000 s",
    ),
    "step duration in ms": (
        lambda m: hk.plan_walk(m.athena, Plane(), step_duration=2000.0),
        InvalidInputError,
        "step_duration: 2000 s",
    ),
    "heights of blocks in mm": (lambda m: Blocks(heights=(40.0, 130.0)), InvalidInputError, "highest: 130 m"),
    "steps of blocks in mm": (lambda m: Blocks(max_step=30.0), InvalidInputError, "max_step: 30 m"),
    "duty factor in percent": (
        lambda m: hk.gait.Gait("mine", 50.0, (0.0, 0.5) * 3),
        InvalidInputError,
        "duty_factor 50",
    ),
    "offsets in degrees": (lambda m: hk.gait.Gait("mine", 0.5, (0.0, 180.0) * 3), InvalidInputError, "offsets"),
    "time step in ms": (lambda m: m.simulate(time_step=1.0), InvalidInputError, "time_step: 1 s does not divide"),
    "duration in ns": (lambda m: m.simulate(duration=5e9), InvalidInputError, "duration: 5e\\+09 s at 20 Hz"),
    "control period for the rate": (
        lambda m: m.simulate(control_rate=0.05),
        InvalidInputError,
        "phase_duration: 1 s is not",
    ),
    "start angles in degrees": (
        lambda m: m.simulate(q_start=np.degrees(m.athena.standing_q)),
        JointLimitError,
        "leg 1",
    ),
    "blocks in mm": (lambda m: Blocks(size=200.0), InvalidInputError, "size"),
    # another robot
    "name for a robot": (
        lambda m: hk.forward_kinematics("athena", m.athena.standing_q),
        InvalidInputError,
        "robot: expected a Robot",
    ),
    "angles of eight legs": (
        lambda m: hk.forward_kinematics(m.athena, np.zeros((8, 3))),
        InvalidInputError,
        "q: expected shape",
    ),
    "angles for feet": (
        lambda m: hk.inverse_kinematics(m.athena, m.athena),
        InvalidInputError,
        "p_body_foot: expected numbers",
    ),
    "controller of another robot": (
        lambda m: hk.simulate(m.hwr, Plane(), hk.PostureController(m.athena)),
        InvalidInputError,
        "controller: made for another robot",
    ),
    "motion of another robot": (
        lambda m: hk.feasibility.check(m.hwr, m.walk, Plane()),
        InvalidInputError,
        "motion: not of",
    ),
    "plan of another robot": (lambda m: hk.walker.check_plan(m.hwr, m.plan), InvalidInputError, "motion: not of"),
    "animation of another robot": (
        lambda m: hk.animation.animate(m.hwr, m.plan, Plane()),
        InvalidInputError,
        "motion: not of",
    ),
    "configuration of another robot": (
        lambda m: hk.dynamics.mass_matrix(m.athena, np.zeros(7 + 24)),
        InvalidInputError,
        "configuration: expected",
    ),
    "missing robot file": (lambda m: hk.load_robot("my_robot.yaml"), RobotFileError, "my_robot.yaml"),
    "typing error in a robot's name": (lambda m: hk.load_robot("athenna"), UnknownNameError, "unknown robot 'athenna'"),
    # another terrain, or in its place something else
    "class for a terrain": (lambda m: m.simulate(terrain=Plane), InvalidInputError, "terrain: expected a Terrain"),
    "terrain and controller swapped": (
        lambda m: hk.simulate(m.athena, hk.PostureController(m.athena), Plane()),
        InvalidInputError,
        "terrain: expected a Terrain",
    ),
    "curves in a simulation": (
        lambda m: m.simulate(terrain=LegCurves()),
        InvalidInputError,
        "terrain: expected a Terrain",
    ),
    "curves for four legs": (
        lambda m: hk.plan_walk(m.athena, LegCurves(num_legs=4)),
        InvalidInputError,
        "terrain: curves for 4 legs",
    ),
    "heights transposed": (lambda m: HeightField(GRID, GRID[:4], np.zeros((4, 5))), InvalidInputError, "z"),
    "heights with a gap": (lambda m: HeightField(GRID, GRID, np.full((5, 5), np.nan)), InvalidInputError, "z"),
    "axis with a repeated value": (
        lambda m: HeightField([0.0, 0.0, 1.0], GRID, np.zeros((3, 5))),
        InvalidInputError,
        "x",
    ),
    "heights in three dimensions": (lambda m: HeightField(GRID, GRID, np.zeros((5, 5, 1))), InvalidInputError, "z"),
    "extent in the wrong order": (lambda m: Blocks(extent=(0.8, -0.8, -0.8, 4.0)), InvalidInputError, "extent"),
    # another shape or order
    "pose transposed": (
        lambda m: hk.kinematics.posed_inverse_kinematics(m.athena, m.body.T, m.feet),
        InvalidInputError,
        "T_world_body: expected poses",
    ),
    "rotation for a pose": (
        lambda m: hk.kinematics.posed_inverse_kinematics(m.athena, np.eye(3), m.feet),
        InvalidInputError,
        "T_world_body: expected shape",
    ),
    "feet with a gap": (
        lambda m: hk.inverse_kinematics(m.athena, np.where(m.feet > 0.0, np.nan, m.feet)),
        InvalidInputError,
        "p_body_foot: leg 1",
    ),
    "time backwards": (
        lambda m: hk.feasibility.check(m.athena, dataclasses.replace(m.walk, time=m.walk.time[::-1]), Plane()),
        InvalidInputError,
        "time must ascend",
    ),
    "leg 0": (lambda m: hk.sliders.posture_of_leg(m.athena, 0, [0.0, 0.0, 0.0]), InvalidInputError, "leg"),
    "polygon of two points": (
        lambda m: hk.stability.margin([0.0, 0.0], [[0.0, 0.0], [1.0, 0.0]]),
        InvalidInputError,
        "polygon",
    ),
    "robot for contacts": (
        lambda m: hk.stance.polygon_margin(m.athena),
        InvalidInputError,
        "contacts: expected a Contacts",
    ),
    "forces that pull": (
        lambda m: hk.stability.zero_moment_point(m.feet, [-1.0] * 6),
        InvalidInputError,
        "foot_force: -1 N",
    ),
    "mass matrix that is not symmetric": (
        lambda m: hk.contact.ContactProblem([[1.0, 2.0], [0.0, 1.0]], [0.0, 0.0], np.zeros((1, 3, 2))),
        InvalidInputError,
        "mass: not symmetric",
    ),
    # names, flags, numbers
    "unknown engine": (lambda m: m.simulate(engine="ode"), UnknownNameError, "unknown engine 'ode'"),
    "unknown branch": (
        lambda m: hk.inverse_kinematics(m.athena, m.feet, branch="elbow up"),
        UnknownNameError,
        "unknown branch 'elbow up'",
    ),
    "unknown gait": (
        lambda m: SteeringController(m.athena, Twist(), gait="trot"),
        UnknownNameError,
        "unknown gait 'trot'",
    ),
    "word for a flag": (
        lambda m: hk.animation.animate(m.athena, m.plan, Plane(), follow="no"),
        InvalidInputError,
        "follow: expected True or False",
    ),
    "text for a number": (
        lambda m: hk.PostureController(m.athena, stride="0.05"),
        InvalidInputError,
        "stride: expected a number, got '0.05'",
    ),
    "seed with a fraction": (lambda m: m.simulate(seed=0.5), InvalidInputError, "seed: expected a whole number"),
    "negative friction": (lambda m: m.simulate(friction=-0.9), InvalidInputError, "friction: -0.9"),
    "phase that is no whole number of ticks": (
        lambda m: hk.simulate(m.athena, Plane(), hk.PostureController(m.athena, phase_duration=1.03)),
        InvalidInputError,
        "phase_duration: 1.03 s is not a whole number",
    ),
    "controller whose start returns nothing": (
        lambda m: hk.simulate(m.athena, Plane(), Forgetful(m.athena)),
        InvalidInputError,
        "controller: start of Forgetful: None has no method 'command'",
    ),
    # files
    "missing recording": (lambda m: hk.load_recording("nowhere.npz"), RecordingError, "nowhere.npz"),
    "open file for a path": (lambda m: hk.load_recording(1), InvalidInputError, "path: expected"),
    "missing elevation data": (lambda m: HeightField.from_file("nowhere.npz"), TerrainFileError, "nowhere.npz"),
    "unknown format of an animation": (
        lambda m: hk.animation.animate(m.athena, m.plan, Plane()).save("walk.avi"),
        UnknownNameError,
        "unknown format '.avi'",
    ),
    "picture too large": (
        lambda m: hk.animation.animate(m.athena, m.plan, Plane()).save("walk.gif", size=(10**6, 10**6)),
        InvalidInputError,
        "size",
    ),
    "missing table of statements": (lambda m: hk.paper.statements(path="nowhere.csv"), FileError, "nowhere.csv"),
}


class Forgetful:
    """A controller whose method ``start`` lacks ``return self``."""

    phases_per_cycle = 1

    def __init__(self, robot):
        self.robot = robot

    def parameters(self):
        return {}

    def start(self, observation, control_rate):
        pass


class Material:
    """What the mistakes are made with."""

    def __init__(self, athena, hwr, plan, walk):
        self.athena, self.hwr, self.plan, self.walk = athena, hwr, plan, walk
        self.feet, self.body = hk.forward_kinematics(athena, athena.standing_q), walk.T_world_body[0]
        self.contacts = hk.stance.contacts_of(athena, self.body, walk.q[0], walk.carrying[0], Plane())

    def simulate(self, terrain=None, **options):
        ground = Plane() if terrain is None else terrain
        return hk.simulate(self.athena, ground, hk.PostureController(self.athena), **{"engine": "rigid", **options})


@pytest.fixture(scope="module")
def material(athena, hwr, plan, walk):
    return Material(athena, hwr, plan, walk)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_plausible_mistake_is_told_by_name(material, mistake):
    call, error, message = MISTAKES[mistake]
    with pytest.raises(error, match=message) as raised:
        call(material)
    assert isinstance(raised.value, HexakinError)


@pytest.mark.parametrize("height", [0.05, 1.0, 100.0, -0.05])
def test_a_robot_off_the_ground_is_not_feasible(athena, walk, height):
    assert hk.feasibility.check(athena, walk, Plane()).feasible
    report = hk.feasibility.check(athena, lifted(walk, height), Plane())
    assert "ground contact" in report.binding
    assert f"its foot is {abs(height):g} m from the ground" in str(report)


def test_a_walk_made_for_another_terrain_is_not_feasible(athena, walk):
    assert "ground contact" in hk.feasibility.check(athena, walk, Ramp()).binding
    assert "ground contact" in hk.feasibility.check(athena, walk, Plane(z=-0.1)).binding


def test_a_plan_on_two_feet_is_said_to_have_no_static_balance(athena):
    gait = hk.gait.in_groups("two feet", ((0, 1, 3, 4), (2, 5)))
    plan = hk.plan_walk(athena, Plane(), num_steps=2, samples_per_step=10, step_length=0.01, gait=gait)
    assert hk.walker.check_plan(athena, plan).fewest_standing == 2
    report = hk.feasibility.check(athena, plan, Plane())
    assert "balance" in report.binding
    assert "only 2 feet carry load at some instant: no static balance without three" in str(report)
