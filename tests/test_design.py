"""Design questions against brute force: sampling and bisection with the inverse kinematics and the force programmes."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.feasibility import distribute, force_solver, statics
from hexakin.feasibility.casadi_legs import leg_states
from hexakin.feasibility.design import best_posture, highest_step, longest_stride, steepest_slope
from hexakin.kinematics import standing_height
from hexakin.walking.swing import bezier, swing_control_points

FIRST, SECOND = [0, 2, 4], [1, 3, 5]


@pytest.fixture(scope="module")
def athena():
    return hk.load_robot("athena")


def tilted(robot, slope):
    """Rotation of a body that stands parallel to a slope, its front uphill."""
    return hk.transforms.axis_rotation(robot.right, slope)


def cycle(robot, stride, apex, height, full, samples=41):
    """Feet in the body frame (2 * samples, L, 3) of a cycle of the tripod gait, and which ones carry."""
    standing = hk.forward_kinematics(robot, robot.standing_q)
    standing[:, 2] = robot.foot_radius - height
    middle = np.zeros(6)
    middle[FIRST], middle[SECOND] = (0.5, -0.5) if full else (0.0, 0.0)
    feet, carrying = [], []
    for swinging, carried in ((FIRST, SECOND), (SECOND, FIRST)):
        start = standing + ((middle - 0.5) * stride)[:, None] * robot.forward
        start[carried] += stride * robot.forward
        for share in np.linspace(0.0, 1.0, samples):
            now = start - share * stride * robot.forward
            points = swing_control_points(start, stride * robot.forward, robot.forward, stride, apex)
            now[swinging] = bezier(points, share)[swinging]
            feet.append(now)
            carrying.append([leg in carried for leg in range(6)])
    return np.array(feet), np.array(carrying)


def walks(robot, stride, *, apex=0.03, height=None, slope=0.0, full=True, friction=0.9, max_torque=None, facets=16):
    feet, carrying = cycle(robot, stride, apex, standing_height(robot) if height is None else height, full)
    solution = hk.inverse_kinematics(robot, feet)
    if not solution.within_limits.all():
        return False
    T = np.broadcast_to(hk.transforms.pose(tilted(robot, slope), np.zeros(3)), (len(feet), 4, 4))
    found = distribute(
        robot, T, solution.q, carrying, T[0, :3, 2], friction=friction, max_torque=max_torque, facets=facets
    )
    return bool(found.feasible.all())


def largest(feasible, low, high, steps=12):
    """Largest feasible value by bisection; the low end must be feasible and the high end not."""
    assert feasible(low) and not feasible(high)
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if feasible(middle) else (low, middle)
    return low, high


@pytest.mark.parametrize(
    "case",
    [
        {},
        {"full": False},
        {"height": 0.07, "full": False},
        {"slope": np.radians(30.0)},
        {"height": 0.12, "friction": 0.4},
    ],
)
def test_longest_stride_is_where_bisection_ends(athena, case):
    keywords = {
        "body_height": case.get("height"),
        "slope": case.get("slope", 0.0),
        "friction": case.get("friction", 0.9),
    }
    phase = "full_stride" if case.get("full", True) else "half_stride"
    found = longest_stride(athena, **keywords, first_phase=phase)
    low, high = largest(lambda stride: walks(athena, stride, **case), 0.001, 0.3)
    assert low - 1e-4 < found.value < high + 1e-4
    assert found.active and found.variables["stride"] == pytest.approx(found.value)


def test_the_papers_stride_is_possible_and_65_mm_is_about_the_longest_from_the_standing_footholds(athena):
    assert 0.065 < longest_stride(athena).value < 0.070
    assert longest_stride(athena, first_phase="half_stride").value == pytest.approx(
        2 * longest_stride(athena).value, rel=1e-4
    )


@pytest.mark.parametrize("full", [True, False])
def test_highest_step_is_where_bisection_ends(athena, full):
    stride = 0.05
    feet, _ = cycle(athena, stride, 0.0, standing_height(athena), full, samples=2)

    def reaches(height):
        for swinging, instant in ((FIRST, feet[1]), (SECOND, feet[3])):
            raised = instant + np.isin(range(6), swinging)[:, None] * [0.0, 0.0, height]
            if not hk.inverse_kinematics(athena, raised).within_limits[swinging].all():
                return False
        return True

    low, high = largest(reaches, 0.0, 0.3, steps=16)
    found = highest_step(athena, stride=stride, first_phase="full_stride" if full else "half_stride")
    assert low - 1e-4 < found.value < high + 1e-4


def test_standing_ends_at_the_friction_angle_if_the_servos_are_strong(athena):
    for friction in (0.3, 0.9):
        found = steepest_slope(athena, friction=friction)
        assert found.value == pytest.approx(np.arctan(friction), abs=1e-6)
        assert all(name.startswith("friction") for name in found.active)


@pytest.mark.parametrize(("max_torque", "ends"), [(None, "unloading"), (0.6, "torque")])
def test_steepest_ramp_to_walk_up_is_where_bisection_ends(athena, max_torque, ends):
    found = steepest_slope(athena, walking=True, max_torque=max_torque)
    low, high = largest(lambda slope: walks(athena, 0.05, slope=slope, max_torque=max_torque), 0.1, 1.3)
    assert low - 2e-3 < found.value < high + 2e-3
    assert any(name.startswith(ends) for name in found.active)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 35.0])
def test_no_sampled_posture_needs_less_torque_than_the_best(athena, degrees):
    slope, rng = np.radians(degrees), np.random.default_rng(4)
    found = best_posture(athena, slope)
    standing = hk.forward_kinematics(athena, athena.standing_q)
    standing[:, 2] = athena.foot_radius
    best = -np.inf
    near = [found.variables[name] for name in ("height", "pitch", "shift")]
    for k in range(400):
        # Half of them near the answer, half anywhere.
        height, pitch, shift = (
            near + rng.normal(0, [4e-3, 0.03, 6e-3]) if k % 2 else rng.uniform([0.05, -0.4, -0.06], [0.18, 0.4, 0.06])
        )
        T_plane = hk.transforms.pose(tilted(athena, pitch), shift * athena.forward + [0.0, 0.0, height])
        solution = hk.inverse_kinematics(
            athena, hk.transforms.transform_points(hk.transforms.inverse_pose(T_plane), standing)
        )
        if not solution.within_limits.all():
            continue
        T = hk.transforms.pose(tilted(athena, slope), np.zeros(3)) @ T_plane
        problem = statics.static_problem(
            athena, T[None], leg_states(athena, solution.q[None]), np.ones((1, 6), dtype=bool),
            tilted(athena, slope)[:, 2], friction=0.9, facets=16, torque_unit=athena.servo.max_torque,
        )  # fmt: skip
        share = force_solver.smallest_torque(problem, 0)
        best = max(best, -np.inf if share is None else athena.servo.max_torque * (1.0 - share))
    assert 0.9 * found.value < best < found.value + 1e-4


def test_what_is_impossible_is_said_to_be(athena):
    found = longest_stride(athena, 0.3)
    assert not found.feasible and np.isnan(found.value) and found.active == ()


def test_arguments_that_cannot_be_used_are_named(athena):
    with pytest.raises(UnknownNameError, match="first_phase"):
        longest_stride(athena, first_phase="half")
    for keywords in ({"body_height": np.inf}, {"slope": 3.0}, {"friction": -1.0}, {"apex": np.nan}):
        with pytest.raises(InvalidInputError, match=next(iter(keywords))):
            longest_stride(athena, **keywords)
    with pytest.raises(InvalidInputError, match="stride"):
        highest_step(athena, stride=-0.1)
    with pytest.raises(InvalidInputError, match="max_torque"):
        steepest_slope(athena, max_torque=0.0)
