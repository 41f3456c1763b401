"""Stances and the stability measures that take one, against known answers, finite differences and Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

import hexakin as hk
from hexakin import dynamics
from hexakin.exceptions import InvalidInputError
from hexakin.stability.polygon import margin, support_polygon
from hexakin.stability.stance import (
    Contacts,
    contacts_of,
    energy_margin,
    longitudinal_margin,
    polygon_margin,
    zmp_on_plane,
)
from hexakin.stability.time_series import zero_moment_point
from hexakin.transforms import pose, rpy_rotation

UP = [0.0, 0.0, 1.0]
RECTANGLE = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 2.0, 0.0], [1.0, 0.0, 0.0]])


def standing_on(points, center_of_mass, **changes):
    points = np.asarray(points, dtype=float)
    fields = {"normals": np.tile(UP, (len(points), 1)), "friction": 0.9, "mass": 2.0} | changes
    return Contacts(points=points, center_of_mass=center_of_mass, **fields)


@pytest.fixture(params=["athena", "athena_physical", "hwr"])
def posed(request, rng):
    """A robot somewhere over a ramp, with angles that mean nothing."""
    robot = hk.load_robot(request.param)
    T = pose(rpy_rotation(rng.uniform(-0.5, 0.5, 3)), rng.uniform(-1, 1, 3))
    return robot, T, rng.uniform(robot.q_min, robot.q_max)


def test_a_standing_athena_touches_the_ground_one_radius_below_its_feet(athena):
    T = pose(np.eye(3), [0.3, -0.2, 0.084 + athena.foot_radius])
    carrying = np.array([True, False, True, True, False, True])
    contacts = contacts_of(athena, T, athena.standing_q, carrying, hk.terrain.Plane())
    feet = hk.forward_kinematics(athena, athena.standing_q)[carrying]
    assert contacts.points == pytest.approx(np.column_stack([feet[:, :2] + [0.3, -0.2], np.zeros(4)]), abs=1e-12)
    assert np.array_equal(contacts.normals, np.tile(UP, (4, 1)))
    assert np.array_equal(contacts.friction, np.full(4, 0.9))
    assert contacts.mass == athena.mass and contacts.num_contacts == 4
    assert contacts.center_of_mass[:2] == pytest.approx([0.3, -0.2], abs=1e-9), "six equal legs all around"
    assert contacts.torque_rows is None and contacts.torque_bounds is None


def test_on_a_ramp_the_contacts_lie_along_the_normal_from_the_feet(athena):
    ramp = hk.terrain.Ramp(slope=0.3)
    normal = ramp.normal(0.0, 0.0)
    contacts = contacts_of(athena, pose(np.eye(3), [0, 0, 0.2]), athena.standing_q, np.ones(6, dtype=bool), ramp)
    feet = hk.forward_kinematics(athena, athena.standing_q) + [0, 0, 0.2]
    assert contacts.points == pytest.approx(feet - athena.foot_radius * normal, abs=1e-12)
    assert contacts.normals == pytest.approx(np.tile(normal, (6, 1)))


def test_each_leg_can_have_its_own_friction_and_no_leg_need_carry(athena):
    each = np.linspace(0.1, 0.6, 6)
    carrying = np.array([False, True, False, False, True, False])
    contacts = contacts_of(athena, np.eye(4), athena.standing_q, carrying, hk.terrain.Plane(), friction=each)
    assert np.array_equal(contacts.friction, [0.2, 0.5])
    nothing = contacts_of(
        athena, np.eye(4), athena.standing_q, ~np.ones(6, dtype=bool), hk.terrain.Plane(), torque_limits=True
    )
    assert nothing.num_contacts == 0 and nothing.torque_rows.shape == (0, 6, 3)
    assert np.isnan(polygon_margin(nothing))


def test_the_center_of_mass_is_where_the_potential_energy_has_it(posed):
    robot, T, q = posed
    still, weight = np.zeros(24), robot.mass * dynamics.GRAVITY
    center = dynamics.center_of_mass(robot, dynamics.configuration(robot, T, q))
    for axis, turn in enumerate([[0, -np.pi / 2, 0], [np.pi / 2, 0, 0], [0, 0, 0]]):
        # The world is turned so that each of its axes in turn points up.
        turned = pose(rpy_rotation(turn), np.zeros(3))
        potential = dynamics.energies(robot, dynamics.configuration(robot, turned @ T, q), still).potential
        assert (turned[:3, :3] @ np.eye(3)[axis]) == pytest.approx(UP, abs=1e-12)
        assert potential == pytest.approx(weight * center[axis], abs=1e-9)


def test_torques_of_the_legs_are_those_of_inverse_dynamics_with_the_forces_at_the_contacts(posed, rng):
    """max_torque less what is left of the bounds, against Pinocchio's recursion with forces on the tibiae."""
    robot, T, q = posed
    contacts = contacts_of(
        robot, T, q, np.ones(6, dtype=bool), hk.terrain.Ramp(slope=0.4, heading=0.7), torque_limits=True
    )
    force = rng.normal(size=(6, 3)) * 10.0
    left = contacts.torque_bounds - np.einsum("imc,ic->im", contacts.torque_rows, force)
    limit = robot.servo.max_torque
    model, at = dynamics.build_model(robot), dynamics.configuration(robot, T, q)
    data = model.createData()
    pin.framesForwardKinematics(model, data, at)
    outer = [pin.Force.Zero() for _ in range(model.njoints)]
    for leg in range(6):
        joint = model.frames[model.getFrameId(f"foot_{leg + 1}")].parentJoint
        in_world = pin.Force(force[leg], np.cross(contacts.points[leg], force[leg]))
        outer[joint] = data.oMi[joint].actInv(in_world)
    torque = pin.rnea(model, data, at, np.zeros(24), np.zeros(24), outer)[6:].reshape(6, 3)
    assert limit - left[:, :3] == pytest.approx(torque, abs=1e-9)
    assert left[:, 3:] - limit == pytest.approx(torque, abs=1e-9)


def test_the_rows_do_the_work_of_the_force_on_the_moving_contact(posed):
    """Virtual work: minus the rows are finite differences of the point of the foot that touches."""
    robot, T, q = posed
    contacts = contacts_of(robot, T, q, np.ones(6, dtype=bool), hk.terrain.Ramp(slope=0.4), torque_limits=True)
    model, at, h = dynamics.build_model(robot), dynamics.configuration(robot, T, q), 1e-6
    data = model.createData()

    def foot(leg, configuration):
        pin.framesForwardKinematics(model, data, configuration)
        return data.oMf[model.getFrameId(f"foot_{leg + 1}")].copy()

    for leg in range(6):
        touching = foot(leg, at).actInv(contacts.points[leg])
        for joint in range(3):
            rate = np.zeros(24)
            rate[6 + 3 * leg + joint] = h
            ahead, behind = (foot(leg, pin.integrate(model, at, s * rate)).act(touching) for s in (1, -1))
            assert -contacts.torque_rows[leg, joint] == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)


def test_a_stance_cannot_be_written_to_and_keeps_nothing_of_its_input():
    points = RECTANGLE.copy()
    contacts = standing_on(points, [0.2, 0.7, 1.0])
    points[0] = 9.0
    assert np.array_equal(contacts.points, RECTANGLE)
    with pytest.raises(ValueError, match="read-only"):
        contacts.points[0] = 1.0


def test_polygon_margin_is_seen_from_above(rng):
    feet = np.column_stack([RECTANGLE[:, :2], rng.normal(size=4)])
    assert polygon_margin(standing_on(feet, [0.2, 0.7, 5.0])) == pytest.approx(0.2)
    assert polygon_margin(standing_on(feet, [-0.3, 0.7, -5.0])) == pytest.approx(-0.3)


@pytest.mark.parametrize("feet", [np.zeros((0, 3)), RECTANGLE[:2], [[0, 0, 0], [1, 1, 0], [2, 2, 1.0]]])
def test_without_a_polygon_the_margins_are_undefined(feet):
    contacts = standing_on(feet, [0.2, 0.7, 1.0])
    energy = energy_margin(contacts)
    assert (
        np.isnan(polygon_margin(contacts)) and np.isnan(longitudinal_margin(contacts, 0.3)) and np.isnan(energy.margin)
    )
    assert energy.per_edge.shape == (0,) and energy.edges.shape == (0, 2)


def test_longitudinal_margin_is_the_smaller_way_to_the_front_and_rear_edge():
    contacts = standing_on(RECTANGLE, [0.2, 0.7, 1.0])
    assert longitudinal_margin(contacts, 0.0) == pytest.approx(0.2), "to the rear, where the edge is nearer"
    assert longitudinal_margin(contacts, np.pi) == pytest.approx(0.2), "walking the other way the same edge is in front"
    assert longitudinal_margin(contacts, np.pi / 2) == pytest.approx(0.7)
    assert longitudinal_margin(contacts, np.pi / 4) == pytest.approx(0.2 * np.sqrt(2.0))


def test_outside_the_longitudinal_margin_is_the_way_back_or_there_is_none():
    behind, beside = standing_on(RECTANGLE, [-0.3, 0.7, 1.0]), standing_on(RECTANGLE, [0.5, 2.4, 1.0])
    assert longitudinal_margin(behind, 0.0) == pytest.approx(-0.3)
    assert longitudinal_margin(behind, np.pi) == pytest.approx(-0.3)
    assert longitudinal_margin(behind, np.pi / 2) == -np.inf
    assert longitudinal_margin(beside, 0.0) == -np.inf
    assert longitudinal_margin(beside, np.pi / 2) == pytest.approx(-0.4)
    assert longitudinal_margin(standing_on(RECTANGLE, [0.0, 0.7, 1.0]), 0.0) == 0.0
    assert longitudinal_margin(standing_on(RECTANGLE, [0.0, 0.7, 1.0]), np.pi / 2) == pytest.approx(0.7), "on an edge"


def test_the_distance_to_the_edge_is_the_least_longitudinal_margin_over_all_headings(rng):
    for _ in range(20):
        feet, center = rng.normal(size=(6, 3)), rng.normal(size=3) * 0.3
        if margin(center[:2], support_polygon(feet)) > 0.0:
            contacts = standing_on(feet, center)
            least = min(longitudinal_margin(contacts, angle) for angle in np.linspace(0.0, np.pi, 301))
            assert least == pytest.approx(polygon_margin(contacts), rel=1e-4)


def test_energy_margins_of_the_reference_rectangle():
    contacts = standing_on(RECTANGLE, [0.2, 0.7, 1.0])
    result = energy_margin(contacts)
    middle = RECTANGLE[result.edges].mean(axis=1)[:, :2].tolist()
    distance = {(0.0, 1.0): 0.2, (0.5, 2.0): 1.3, (1.0, 1.0): 0.8, (0.5, 0.0): 0.7}
    height = {(0.0, 1.0): 0.019804, (0.5, 2.0): 0.640122, (1.0, 1.0): 0.280625, (0.5, 0.0): 0.220656}
    assert result.per_edge == pytest.approx([height[tuple(m)] for m in middle], abs=5e-7)
    assert result.per_edge == pytest.approx([np.hypot(1.0, distance[tuple(m)]) - 1.0 for m in middle], abs=1e-12)
    assert result.margin == result.per_edge.min()


def test_energy_margin_is_the_climb_of_a_robot_that_is_turned_about_each_edge(rng):
    """Edges that are not level: the robot is turned in small steps until its centre of mass goes down."""
    for _ in range(5):
        feet = np.column_stack([rng.normal(size=(5, 2)), rng.uniform(-0.3, 0.3, 5)])
        center = np.r_[support_polygon(feet).mean(axis=0), rng.uniform(0.5, 1.5)]
        result = energy_margin(standing_on(feet, center))
        for (i, j), height in zip(result.edges, result.per_edge, strict=True):
            way = (feet[j] - feet[i]) / np.linalg.norm(feet[j] - feet[i])
            turns = [hk.transforms.axis_rotation(way, angle) for angle in np.linspace(0.0, np.pi / 2, 1501)]
            climb = max((turn @ (center - feet[i]))[2] for turn in turns) - (center - feet[i])[2]
            assert height == pytest.approx(climb, abs=1e-6)


def test_energy_margin_is_zero_over_an_edge_and_negative_beyond_it():
    assert energy_margin(standing_on(RECTANGLE, [0.0, 0.7, 1.0])).margin == 0.0
    outside = energy_margin(standing_on(RECTANGLE, [-0.2, 0.7, 1.0]))
    assert outside.margin == pytest.approx(1.0 - np.hypot(1.0, 0.2)), "the height lost since it stood over the edge"
    assert (outside.per_edge < 0.0).sum() == 1


def test_a_steeper_slope_leaves_less_energy_margin_downhill_than_the_polygon_shows():
    """The same square, its polygon's margin kept: higher above the lower edge it is easier to tip."""
    level = standing_on([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [0.0, 0.0, 1.0])
    slope = standing_on([[-1, -1, -1], [1, -1, 1], [1, 1, 1], [-1, 1, -1]], [0.0, 0.0, 1.0])
    assert polygon_margin(level) == polygon_margin(slope) == 1.0
    assert energy_margin(slope).margin == pytest.approx(np.hypot(1.0, 2.0) - 2.0)
    assert energy_margin(slope).margin < energy_margin(level).margin


def test_of_contacts_one_above_the_other_the_lowest_is_tipped_over():
    feet = np.vstack([RECTANGLE + [0, 0, 0.5], RECTANGLE])
    assert energy_margin(standing_on(feet, [0.2, 0.7, 1.0])).margin == pytest.approx(0.019804, abs=5e-7)
    assert (energy_margin(standing_on(feet, [0.2, 0.7, 1.0])).edges >= 4).all()


def test_with_vertical_forces_on_level_ground_the_zmp_is_that_of_a32(rng):
    feet = np.column_stack([rng.normal(size=(6, 2)), np.zeros(6)])
    force = rng.exponential(size=6)
    result = zmp_on_plane(feet, force[:, None] * np.array(UP), np.zeros(3), UP)
    assert result.point[:2] == pytest.approx(zero_moment_point(feet, force).xy, abs=1e-12)
    assert result.point[2] == 0.0 and result.defined


def test_the_zmp_of_an_accelerated_point_mass_is_the_textbooks(rng):
    """x_zmp = x - (z - z_0) a_x / (g + a_z): the forces of uneven contacts add up to m (a + g) through the mass."""
    g, mass = 9.81, 2.1
    for _ in range(20):
        feet, center, acceleration = rng.normal(size=(6, 3)), rng.normal(size=3) + [0, 0, 2], rng.normal(size=3)
        total = mass * (acceleration + [0, 0, g])
        # Any forces with this sum and no moment about the mass; here those of least squares.
        arm = feet - center
        wrench = np.hstack([np.vstack([np.eye(3), pin.skew(a)]) for a in arm])
        force = np.linalg.lstsq(wrench, np.r_[total, 0, 0, 0], rcond=None)[0].reshape(6, 3)
        z = rng.normal()
        expected = center[:2] - (center[2] - z) * acceleration[:2] / (g + acceleration[2])
        result = zmp_on_plane(feet, force, [0.4, -0.7, z], UP)
        assert result.point == pytest.approx(np.r_[expected, z], abs=1e-9)


def test_about_the_zmp_the_moment_is_parallel_to_the_normal_of_an_inclined_plane(rng):
    feet, force, moments = rng.normal(size=(50, 6, 3)), rng.normal(size=(50, 6, 3)), rng.normal(size=(50, 6, 3))
    normal = rpy_rotation([0.2, -0.5, 0.3])[:, 2]
    force += 4.0 * normal
    origin = rng.normal(size=3)
    result = zmp_on_plane(feet, force, origin, normal, moments)
    assert result.point.shape == (50, 3) and result.defined.all()
    assert (result.point - origin) @ normal == pytest.approx(0.0, abs=1e-9)
    about = (np.cross(feet - result.point[:, None], force) + moments).sum(axis=1)
    assert np.cross(about, normal) == pytest.approx(0.0, abs=1e-9)
    one = zmp_on_plane(feet[3], force[3], origin, normal, moments[3])
    assert one.point == pytest.approx(result.point[3])


def test_where_nothing_presses_on_the_plane_the_zmp_is_undefined():
    force = np.array([[[0.0, 0, 1]] * 4, [[1.0, 0, 0]] * 4, [[0.0, 0, -1]] * 4, [[0.0, 0, 0]] * 4])
    result = zmp_on_plane(RECTANGLE, force, np.zeros(3), UP)
    assert result.defined.tolist() == [True, False, False, False]
    assert np.isnan(result.point[1:]).all() and result.point[0] == pytest.approx([0.5, 1.0, 0.0])


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("points", np.zeros((4, 2)), r"Contacts: points: expected shape \(\.\.\., 3\), got \(4, 2\)"),
        ("points", np.zeros(3), r"Contacts: points: expected shape \(k, 3\), got \(3,\)"),
        ("points", RECTANGLE * [1, np.nan, 1], "Contacts: points: coordinate 2 is nan"),
        ("normals", np.tile(UP, (3, 1)), r"Contacts: normals: expected shape"),
        ("normals", np.tile([0, 0, 1.1], (4, 1)), "Contacts: normals: contact 1 has length 1.1, expected 1"),
        ("friction", -0.1, "Contacts: friction: contact 1 has -0.1, expected at least 0"),
        ("friction", [0.1, 0.2, np.inf, 0.1], "Contacts: friction: contact 3 is inf"),
        ("friction", [0.1, 0.2], r"Contacts: friction: expected shape"),
        ("friction", "high", "friction: expected an array of numbers"),
        ("center_of_mass", [0.0, 0.0], "Contacts: center_of_mass: expected shape"),
        ("mass", 0.0, "Contacts: mass: 0 kg, expected above 0"),
        ("torque_rows", np.zeros((4, 6, 3)), "expected both or neither"),
    ],
)
def test_bad_fields_are_named(field, value, message):
    good = {"points": RECTANGLE, "normals": np.tile(UP, (4, 1)), "friction": 0.5, "center_of_mass": UP, "mass": 1.0}
    with pytest.raises(InvalidInputError, match=message):
        Contacts(**(good | {field: value}))


def test_bad_torque_limits_are_named():
    rows, bounds = np.zeros((4, 6, 3)), np.ones((4, 6))
    with pytest.raises(InvalidInputError, match=r"torque_rows: expected shape \(4, m, 3\), got \(3, 6, 3\)"):
        standing_on(RECTANGLE, UP, torque_rows=rows[:3], torque_bounds=bounds)
    with pytest.raises(InvalidInputError, match="torque_bounds: expected shape"):
        standing_on(RECTANGLE, UP, torque_rows=rows, torque_bounds=bounds[:, :5])


def test_bad_poses_and_planes_are_named(athena):
    every, ground = np.ones(6, dtype=bool), hk.terrain.Plane()
    with pytest.raises(InvalidInputError, match="carrying: expected True or False for each element"):
        contacts_of(athena, np.eye(4), athena.standing_q, np.full(6, 2), ground)
    with pytest.raises(InvalidInputError, match="q: expected shape"):
        contacts_of(athena, np.eye(4), np.zeros((2, 6, 3)), every, ground)
    with pytest.raises(InvalidInputError, match=r"friction: expected shape \(6,\), got \(5,\)"):
        contacts_of(athena, np.eye(4), athena.standing_q, every, ground, friction=np.ones(5))
    with pytest.raises(InvalidInputError, match="robot: expected a Robot"):
        contacts_of("athena", np.eye(4), athena.standing_q, every, ground)
    with pytest.raises(InvalidInputError, match="heading: nan"):
        longitudinal_margin(standing_on(RECTANGLE, UP), np.nan)
    with pytest.raises(InvalidInputError, match="normal: length 2, expected 1"):
        zmp_on_plane(RECTANGLE, RECTANGLE, np.zeros(3), [0, 0, 2.0])
    with pytest.raises(InvalidInputError, match="forces: expected shape"):
        zmp_on_plane(RECTANGLE, np.ones(4), np.zeros(3), UP)
    with pytest.raises(InvalidInputError, match=r"points: expected shape \(\.\.\., k, 3\)"):
        zmp_on_plane(UP, UP, np.zeros(3), UP)


def test_the_class_of_contacts_keeps_its_old_name_for_a_release():
    with pytest.warns(DeprecationWarning, match="now called Contacts"):
        assert hk.stance.Stance is Contacts
    with pytest.warns(DeprecationWarning, match="contacts_of"):
        assert hk.stance.stance_of is contacts_of
    with pytest.raises(AttributeError, match="no attribute 'Posture'"):
        _ = hk.stance.Posture
