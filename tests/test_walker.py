"""Paper B's walker: what a plan promises, on the paper's terrains, on random ones, and where it must refuse."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hexakin as hk
from hexakin.exceptions import (
    ClearanceError,
    HexakinError,
    InvalidInputError,
    JointLimitError,
    UnknownNameError,
    UnreachableError,
)
from hexakin.walking.foot_tracks import start_offset
from hexakin.walking.planner import check_plan

IRREGULAR = hk.terrain.LegCurves(
    lambda s: 0.02 * np.sin(8.0 * s),
    lambda s, y: 0.02 * np.sin(20.0 * s),
    k=[[1] * 6, [1] * 6, [1, 0.5, 0, -0.5, -1, 1]],
)
PAPER_WALKS = {
    "flat, fixed height": (hk.terrain.Plane(), {}),
    "flat, sinusoidal height": (hk.terrain.Plane(), {"body_motion": "sinusoidal"}),
    "inclined, body parallel": (
        hk.terrain.Ramp(heading=0.0),
        {"body_motion": "sinusoidal", "body_orientation": "parallel"},
    ),
    "irregular, fixed height": (IRREGULAR, {"height_reference": "start"}),
    "irregular, sinusoidal height": (IRREGULAR, {"body_motion": "sinusoidal"}),
    "irregular, oriented body": (IRREGULAR, {"body_motion": "sinusoidal", "body_orientation": [0.08, -0.06, 0.1]}),
    "along y": (hk.terrain.Plane(), {"heading": np.pi / 2}),
    "backwards": (hk.terrain.Plane(), {"heading": np.pi}),
    "turned": (hk.terrain.Ramp(heading=0.3), {"yaw": 1.0, "heading": -0.4, "start": (0.5, -0.2)}),
}


@pytest.fixture(scope="module", params=["hwr", "athena"])
def robot(request):
    return hk.load_robot(request.param)


def assert_promises_hold(robot, plan):
    report = check_plan(robot, plan)
    assert report.stance_drift <= 1e-12
    assert report.closure <= 1e-12
    assert report.limit_margin >= -1e-9
    assert report.advance_error <= 1e-12
    return report


@pytest.mark.parametrize("terrain, options", PAPER_WALKS.values(), ids=PAPER_WALKS.keys())
def test_the_papers_walks_keep_every_promise(robot, terrain, options):
    plan = hk.plan_walk(robot, terrain, **options)
    assert_promises_hold(robot, plan)
    assert plan.time.shape == (701,) and plan.q.shape == (701, 6, 3) and plan.T_world_body.shape == (701, 4, 4)


@pytest.mark.parametrize("terrain, options", PAPER_WALKS.values(), ids=PAPER_WALKS.keys())
def test_paths_are_continuous_the_largest_change_halves_when_the_samples_double(robot, terrain, options):
    coarse, fine = (check_plan(robot, hk.plan_walk(robot, terrain, samples_per_step=n, **options)) for n in (200, 400))
    assert fine.largest_joint_step == pytest.approx(coarse.largest_joint_step / 2, rel=0.05)
    assert fine.largest_foot_step == pytest.approx(coarse.largest_foot_step / 2, rel=0.05)


amplitudes = st.floats(0.0, 0.06)
waves = st.floats(2.0, 40.0)


@settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    heights=st.tuples(amplitudes, waves, st.floats(0.0, 6.3)),
    sideways=st.tuples(st.floats(0.0, 0.05), waves),
    heading=st.floats(-np.pi, np.pi),
    step_length=st.floats(0.005, 0.12),
    scale=st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6),
    name=st.sampled_from(["hwr", "athena"]),
    num_steps=st.integers(1, 8),
    samples=st.integers(40, 60),
    first_group=st.integers(0, 1),
    yaw=st.floats(-np.pi, np.pi),
)
def test_random_terrain_is_walked_with_every_promise_kept_or_refused_by_name(
    heights, sideways, heading, step_length, scale, name, num_steps, samples, first_group, yaw
):
    robot = hk.load_robot(name)
    (a, f, shift), (b, g) = heights, sideways
    curves = hk.terrain.LegCurves(
        lambda s: b * np.sin(g * s), lambda s, y: a * np.sin(f * s + shift), k=[[1] * 6, [1] * 6, scale]
    )
    walk = {
        "num_steps": num_steps,
        "step_length": step_length,
        "heading": heading,
        "first_group": first_group,
        "yaw": yaw,
    }
    try:
        plan = hk.plan_walk(robot, curves, samples_per_step=samples, **walk)
    except UnreachableError as error:
        assert 1 <= error.leg <= 6 and error.time >= 0.0
        assert not error.reach[0] <= error.distance <= error.reach[1]
        return
    except JointLimitError as error:
        assert not error.limits[0] <= error.angle <= error.limits[1]
        return
    report = assert_promises_hold(robot, plan)
    fine = check_plan(robot, hk.plan_walk(robot, curves, samples_per_step=2 * samples, on_failure="mark", **walk))
    assert fine.largest_joint_step <= 0.75 * report.largest_joint_step + 1e-9


def test_random_terrain_is_not_only_refused():
    """The property above would be empty if everything were refused: count over a grid of its parameters."""
    robot, planned = hk.load_robot("hwr"), 0
    for amplitude in (0.0, 0.02, 0.04, 0.06):
        for step_length in (0.03, 0.06, 0.09):
            curves = hk.terrain.LegCurves(reference_z=lambda s, y, a=amplitude: a * np.sin(15.0 * s))
            try:
                hk.plan_walk(robot, curves, 4, step_length)
                planned += 1
            except HexakinError:
                pass
    assert planned >= 8


def test_swings_alternate_and_everyone_stands_at_the_changes(robot):
    plan = hk.plan_walk(robot, hk.terrain.Plane(), num_steps=2, samples_per_step=10)
    assert plan.stance[::5].all()
    assert np.array_equal(plan.stance[2], [False, True] * 3)
    assert np.array_equal(plan.stance[7], [True, False] * 3)
    other = hk.plan_walk(robot, hk.terrain.Plane(), num_steps=2, samples_per_step=10, first_group=1)
    assert np.array_equal(other.stance[2], [True, False] * 3)


def test_the_body_rides_at_its_height_and_sways_as_told(robot):
    height = hk.kinematics.standing_height(robot)
    fixed = hk.plan_walk(robot, hk.terrain.Plane())
    assert fixed.T_world_body[:, 2, 3] == pytest.approx(np.full(701, height))
    sway = hk.plan_walk(robot, hk.terrain.Plane(), body_motion="sinusoidal", amplitude=0.008, period=1.0)
    expected = height + 0.008 * np.sin(np.pi * sway.time)  # a step takes 2 s
    assert sway.T_world_body[:, 2, 3] == pytest.approx(expected, abs=1e-12)


def test_a_body_parallel_to_an_incline_is_turned_by_its_slope(robot):
    plan = hk.plan_walk(robot, hk.terrain.Ramp(), body_orientation="parallel")
    assert plan.T_world_body[:, :3, 2] == pytest.approx(
        np.broadcast_to(hk.terrain.Ramp().normal(0, 0), (701, 3)), abs=1e-9
    )


def test_feet_touch_the_ground_in_stance_with_their_spheres(robot):
    ramp = hk.terrain.Ramp()
    plan = hk.plan_walk(robot, ramp)
    gap = plan.p_world_foot @ ramp.normal(0, 0)
    assert gap[plan.stance] == pytest.approx(np.full(plan.stance.sum(), robot.foot_radius), abs=1e-12)


def first_unstable_step(robot, offsets):
    """Shortest step length [m] at which the body leaves the feet in stance, by bisection."""
    low, high = 0.02, 0.6
    while high - low > 1e-4:
        step = 0.5 * (low + high)
        walk = {"start_offsets": offsets, "on_failure": "mark", "samples_per_step": 20}
        margin = hk.stability.static_margin(hk.plan_walk(robot, hk.terrain.Plane(), 1, step, **walk))
        assert np.isfinite(margin).all()
        unstable = margin.min() < 0.0
        low, high = (low, step) if unstable else (step, high)
    return high


def test_offsets_as_printed_lose_static_stability_at_a_third_of_the_step_of_the_stable_ones():
    """B-E2: the supporting triangle is 90 mm deep; the body goes 3/4 of a step past its middle, or 1/4."""
    hwr = hk.load_robot("hwr")
    assert first_unstable_step(hwr, "B15") == pytest.approx(0.120, abs=2e-4)
    assert first_unstable_step(hwr, "stable") == pytest.approx(0.360, abs=2e-4)


def test_start_offsets_are_the_printed_ones_and_turn_with_the_heading():
    hwr = hk.load_robot("hwr")
    gait = hk.gait.tripod(hwr)
    assert start_offset(gait, 0.1, "B15") == pytest.approx([0, -0.05, 0, -0.05, 0, -0.05])
    assert start_offset(gait, 0.1, "B16") == pytest.approx([0, 0.05, 0, -0.05, 0, -0.05])
    assert start_offset(gait, 0.1, "stable") == pytest.approx([0, 0.05, 0, 0.05, 0, 0.05])
    assert start_offset(gait, 0.1, "stable", first_group=1) == pytest.approx([0.05, 0, 0.05, 0, 0.05, 0])
    plan = hk.plan_walk(hwr, hk.terrain.Plane(), heading=np.pi / 2)
    standing = hk.forward_kinematics(hwr, hwr.standing_q)
    assert plan.footholds[0, 1] - standing[1] == pytest.approx([0, 0.025, 0.15], abs=1e-12)


def bump(height, width=0.006, at=(0.205, 0.22)):
    x = y = np.linspace(-0.6, 0.9, 751)
    X, Y = np.meshgrid(x, y, indexing="ij")
    return hk.terrain.HeightField(x, y, height * np.exp(-((X - at[0]) ** 2 + (Y - at[1]) ** 2) / (2 * width**2)))


def test_the_papers_cycloid_cuts_through_a_bump_and_a_higher_arch_clears_it():
    hwr = hk.load_robot("hwr")
    low = hk.plan_walk(hwr, bump(0.03), num_steps=1)
    report = check_plan(hwr, low)
    assert report.lowest_clearance < -0.005
    assert report.clearance_leg == 1
    high = hk.plan_walk(hwr, bump(0.03), num_steps=1, arch="clear")
    assert check_plan(hwr, high).lowest_clearance > -1e-6
    assert high.arch[0, 0] > 1.0 and (high.arch[0, 1:] == 1.0).all()
    with pytest.raises(ClearanceError, match=r"leg 1: its swing in step 1 cuts .* mm into the terrain even at 4 times"):
        hk.plan_walk(hwr, bump(0.12), num_steps=1, arch="clear")


def test_an_unreachable_instant_is_named_with_leg_time_and_distance(robot):
    with pytest.raises(
        UnreachableError, match=r"leg \d: foot target .* m from the second joint exceeds .* \(t = .* s\)"
    ) as caught:
        hk.plan_walk(robot, hk.terrain.Plane(), body_height=0.3)
    assert caught.value.time == 0.0
    marked = hk.plan_walk(robot, hk.terrain.Plane(), body_height=0.3, on_failure="mark")
    assert not marked.reachable.any() and np.isnan(marked.q).all()


def test_legs_with_a_coefficient_of_their_own_drift_until_they_are_out_of_reach():
    """B-E10: k_1j of one leg other than 1."""
    hwr = hk.load_robot("hwr")
    k = np.ones((3, 6))
    k[0, 2] = 1.5
    with pytest.raises((UnreachableError, JointLimitError), match="leg 3"):
        hk.plan_walk(hwr, hk.terrain.LegCurves(k=k), num_steps=10)


def test_a_joint_beyond_its_limit_is_named():
    with pytest.raises(JointLimitError, match=r"leg \d: theta_\d = .* rad leaves its limits \[.*\] \(t = .* s\)"):
        hk.plan_walk(hk.load_robot("athena"), hk.terrain.Plane(), body_orientation=[0.0, 0.0, 0.65])


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        ({"num_steps": 0}, InvalidInputError, "num_steps: 0, expected a whole number of at least 1"),
        ({"num_steps": 2.5}, InvalidInputError, "num_steps: expected a whole number, got 2.5"),
        ({"samples_per_step": 3}, InvalidInputError, "samples_per_step: 3, expected a whole number of at least 4"),
        ({"num_steps": True}, InvalidInputError, "num_steps: expected a whole number, got True"),
        ({"first_group": 2}, InvalidInputError, "first_group: 2, but tripod has 2 groups"),
        ({"first_group": 0.5}, InvalidInputError, "first_group: expected a whole number, got 0.5"),
        ({"gait": "wave"}, InvalidInputError, "gait: expected a Gait or None, got 'wave'"),
        ({"terrain": hk.terrain.Plane}, InvalidInputError, "terrain: expected a Terrain or a LegCurves, got <class"),
        ({"terrain": hk.terrain.LegCurves(num_legs=4)}, InvalidInputError, "terrain: curves for 4 legs"),
        ({"step_length": np.nan}, InvalidInputError, "step_length: nan m"),
        ({"heading": np.inf}, InvalidInputError, "heading: inf"),
        ({"body_height": -0.1}, InvalidInputError, "body_height: -0.1 m"),
        ({"body_motion": "hop"}, UnknownNameError, "unknown body_motion 'hop'; known: fixed, sinusoidal"),
        ({"body_orientation": "upright"}, UnknownNameError, "body_orientation"),
        (
            {"body_orientation": np.zeros((5, 3))},
            InvalidInputError,
            r"body_orientation: expected shape \(3,\) or \(701, 3\)",
        ),
        ({"start_offsets": "B17"}, UnknownNameError, "start_offsets"),
        ({"arch": 0.0}, InvalidInputError, "arch"),
        ({"start": (0.0, np.nan)}, InvalidInputError, "start: coordinate 2 is nan"),
        ({"terrain": "moon"}, InvalidInputError, "terrain: expected a Terrain or a LegCurves, got 'moon'"),
    ],
)
def test_bad_arguments_are_named(robot, arguments, error, message):
    with pytest.raises(error, match=message):
        hk.plan_walk(robot, **{"terrain": hk.terrain.Plane(), **arguments})


def test_a_walk_off_the_map_is_named():
    x = np.linspace(-0.4, 0.4, 9)
    field = hk.terrain.HeightField(x, x, np.zeros((9, 9)))
    with pytest.raises(InvalidInputError, match=r"\(.*\) m lies outside the HeightField"):
        hk.plan_walk(hk.load_robot("hwr"), field, num_steps=20)


def test_plans_of_unreachable_walks_are_measured_too():
    hwr = hk.load_robot("hwr")
    report = check_plan(hwr, hk.plan_walk(hwr, hk.terrain.Plane(), body_height=5.0, on_failure="mark"))
    assert np.isnan([report.limit_margin, report.closure, report.largest_joint_step]).all()
    assert report.stance_drift == 0.0


def test_a_body_that_does_not_stand_over_the_mean_of_its_feet_starts_in_its_standing_pose(edited):
    def change(tree):
        for leg in tree["legs"]:
            leg["parameters"]["x_0_mm"] += 60

    shifted = edited("hwr", change)
    plan = hk.plan_walk(shifted, hk.terrain.Plane(), step_length=0.0, start=(1.0, -2.0), yaw=0.7)
    assert plan.q == pytest.approx(np.broadcast_to(shifted.standing_q, plan.q.shape), abs=1e-9)
    assert plan.T_world_body[0, :2, 3] == pytest.approx([1.0, -2.0])


def test_a_leg_that_points_backwards_walks_across_half_a_turn(edited):
    """Angles are wrapped about the middle of their limits, not cut at +-pi."""

    def change(tree):
        tree["legs"][3]["parameters"] = {"theta_1": 0, "l_1_mm": -60}
        tree["legs"][3]["standing"] = {"theta_2": "pi"}
        tree["legs"][3]["joint_limits"] = {"theta_2": ["5*pi/6", "7*pi/6"]}

    turned, plain = edited("athena", change), hk.load_robot("athena")
    plan, expected = (hk.plan_walk(robot, hk.terrain.Plane()) for robot in (turned, plain))
    assert plan.q[:, 3, 0].max() > np.pi > plan.q[:, 3, 0].min()
    assert plan.q[:, 3] == pytest.approx(expected.q[:, 3] + [np.pi, 0, 0], abs=1e-9)


def test_the_body_advances_by_the_mean_step_on_uneven_ground_whatever_its_orientation(robot):
    for orientation in ("level", "parallel", [0.05, 0.04, 0.0]):
        plan = hk.plan_walk(robot, IRREGULAR, body_orientation=orientation)
        assert check_plan(robot, plan).advance_error < 1e-12


@pytest.mark.parametrize("samples", [12, 25, 120])
def test_a_gait_of_six_phases_stands_on_five_legs_between_its_changes(samples):
    hwr = hk.load_robot("hwr")
    wave = hk.gait.wave(hwr)
    plan = hk.plan_walk(hwr, hk.terrain.Plane(), step_length=0.04, gait=wave, samples_per_step=samples)
    swinging = (~plan.stance).sum(axis=1)
    changes = np.arange(len(plan.time)) * 6 % samples == 0
    assert (swinging[changes] == 0).all() and (swinging[~changes] == 1).all()
    assert_promises_hold(hwr, plan)


def test_the_plan_knows_everything_that_made_it():
    plan = hk.plan_walk(hk.load_robot("hwr"), IRREGULAR, amplitude=0.007, yaw=0.3)
    assert plan.parameters["amplitude"] == 0.007 and plan.parameters["yaw"] == 0.3
    assert repr(IRREGULAR) == plan.parameters["terrain"] and "0x" not in repr(IRREGULAR)


@pytest.mark.parametrize(
    "groups", [((0, 2), (1, 4)), ((0, 1, 2), (3, 4, 7)), ((0, 1, 2), (2, 3, 4, 5)), ((0, 1, 2, 3, 4, 5), ())]
)
def test_a_gait_must_hold_every_leg_once(groups):
    with pytest.raises(InvalidInputError, match=r"must contain each of the legs 0 to \d once"):
        hk.gait.in_groups("odd", groups)


def test_a_gait_whose_swings_overlap_is_refused(robot):
    with pytest.raises(InvalidInputError, match="ripple overlap"):
        hk.plan_walk(robot, hk.terrain.Plane(), gait=hk.gait.ripple(robot))
