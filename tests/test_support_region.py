"""The support region against polygons, the three-force theorem and linear programs written in another way."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linprog

import hexakin as hk
from hexakin import support_region as room
from hexakin.exceptions import InvalidInputError, SolverError
from hexakin.robot.model import GRAVITY
from hexakin.stability.polygon import margin, support_polygon
from hexakin.stability.stance import Contacts, contacts_of
from hexakin.stability.support_region import region_margin, support, support_region
from hexakin.transforms import pose, rpy_rotation

UP = [0.0, 0.0, 1.0]


def standing(points, normals=UP, friction=0.6, center_of_mass=(0.0, 0.0, 0.1), **changes):
    points = np.asarray(points, dtype=float)
    return Contacts(points, np.broadcast_to(normals, points.shape), friction, center_of_mass, 2.0, **changes)


def uneven(rng, k=6, tilt=0.3, friction=0.6):
    """Contacts about a circle of 0.2 m, at different heights and with different normals."""
    angle = np.arange(k) * 2.0 * np.pi / k
    points = 0.2 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(k)]) + rng.normal(size=(k, 3)) * 0.03
    normals = UP + tilt * rng.normal(size=(k, 3))
    return standing(points, normals / np.linalg.norm(normals, axis=1)[:, None], friction)


def bent_athena(athena, rng, max_torque=1.89):
    """ATHENA in a pose near standing, on ground whose normal differs from foot to foot; torques [N m] are limited."""
    robot = dataclasses.replace(athena, servo=dataclasses.replace(athena.servo, max_torque=max_torque))
    T = pose(rpy_rotation(rng.uniform(-0.2, 0.2, 3)), [0.0, 0.0, 0.1])
    q = robot.standing_q + rng.uniform(-0.3, 0.3, (6, 3))
    unused = dict.fromkeys(("height", "distance_along", "shapes"), len)
    ground = SimpleNamespace(normal=lambda x, y: uneven(rng).normals, **unused)
    return contacts_of(robot, T, q, np.ones(6, dtype=bool), ground, friction=0.6, torque_limits=True)


def directions(rng, count):
    way = rng.normal(size=(count, 2))
    return way / np.linalg.norm(way, axis=1)[:, None]


def apart(polygon, other):
    """Hausdorff distance of two convex polygons."""
    return max(-margin(p, to) for a, to in ((polygon, other), (other, polygon)) for p in a)


def furthest(contacts, ways, facets=16, torque_limits=False):
    """The support function written for forces in newtons along x, y, z, friction by the pyramid's faces; or None."""
    k, weight = contacts.num_contacts, contacts.mass * GRAVITY
    faces = []
    for i, (n, mu) in enumerate(zip(contacts.normals, contacts.friction, strict=True)):
        first = np.array(UP) - n[2] * n if abs(n[2]) < 1.0 else np.array([1.0, 0.0, 0.0])
        first = first / np.linalg.norm(first)
        second = np.cross(n, first)
        for j in range(facets):
            middle = (2 * j + 1) * np.pi / facets
            across = np.cos(middle) * first + np.sin(middle) * second
            row = np.zeros(3 * k)
            row[3 * i : 3 * i + 3] = across - mu * np.cos(np.pi / facets) * n
            faces.append(row)
    rows, limits = np.array(faces), np.zeros(len(faces))
    if torque_limits:
        blocks = np.zeros((k * contacts.torque_rows.shape[1], 3 * k))
        for i, block in enumerate(contacts.torque_rows):
            blocks[i * len(block) : (i + 1) * len(block), 3 * i : 3 * i + 3] = block
        rows, limits = np.vstack([rows, blocks]), np.r_[limits, contacts.torque_bounds.ravel()]
    x, y, z = contacts.points.T
    zero = np.zeros(k)
    balance = np.array(
        [np.tile([1, 0, 0], k), np.tile([0, 1, 0], k), np.tile([0, 0, 1], k), np.stack([-y, x, zero], axis=1).ravel()]
    )
    # c_x m g = sum x f_z - z f_x, c_y m g = sum y f_z - z f_y
    place = np.array([np.stack([-z, zero, x], axis=1).ravel(), np.stack([zero, -z, y], axis=1).ravel()]) / weight
    accuracy = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    for way in ways:
        result = linprog(-way @ place, rows, limits, balance, [0, 0, weight, 0], bounds=(None, None), options=accuracy)
        assert result.status in (0, 2)
        yield -result.fun if result.status == 0 else None


@pytest.mark.parametrize("friction", [0.0, 0.3, 2.0])
def test_on_level_ground_the_region_is_the_support_polygon(rng, friction):
    for k in (3, 4, 5, 6, 6, 6):
        feet = np.column_stack([0.2 * rng.normal(size=(k, 2)), np.full(k, 0.7)])
        region = support_region(standing(feet, friction=friction))
        assert not region.empty and not region.cut
        assert apart(region.vertices, support_polygon(feet)) < 1e-6


@pytest.mark.parametrize("facets", [3, 8, 16])
@pytest.mark.parametrize("share", [0.5, 0.999, 1.0])
def test_on_a_slope_up_to_the_friction_angle_the_region_is_the_support_polygon(rng, share, facets):
    friction = 0.6
    for heading in rng.uniform(-np.pi, np.pi, 3):
        ramp = hk.terrain.Ramp(slope=share * np.arctan(friction), heading=heading)
        xy = 0.2 * rng.normal(size=(6, 2))
        feet = np.column_stack([xy, ramp.height(*xy.T)])
        region = support_region(standing(feet, ramp.normal(0.0, 0.0), friction), facets=facets)
        assert apart(region.vertices, support_polygon(feet)) < 1e-6


@pytest.mark.parametrize("facets", [3, 8, 16])
def test_on_a_slope_above_the_friction_angle_the_region_is_empty(rng, facets):
    for heading in rng.uniform(-np.pi, np.pi, 3):
        ramp = hk.terrain.Ramp(slope=np.arctan(0.6) + 1e-6, heading=heading)
        xy = 0.2 * rng.normal(size=(6, 2))
        contacts = standing(np.column_stack([xy, ramp.height(*xy.T)]), ramp.normal(0.0, 0.0), 0.6)
        region = support_region(contacts, facets=facets)
        assert region.empty and region.vertices.shape == (0, 2) and region_margin(contacts, facets=facets) == -np.inf


def test_on_uneven_ground_all_of_1000_directions_agree_with_another_linear_program(rng):
    agreed = held = 0
    for case in range(50):
        contacts = uneven(rng, k=3 + case % 4)
        ways = directions(rng, 20)
        result, polygon = support(contacts, ways), support_region(contacts).vertices
        others = furthest(contacts, ways)
        for way, distance, defined, expected in zip(ways, result.distance, result.defined, others, strict=True):
            if expected is None:
                agreed += not defined and len(polygon) == 0
                continue
            assert distance == pytest.approx(expected, abs=1e-7)
            assert -1e-6 <= (polygon @ way).max() - expected < 1e-7, "the polygon's own support function"
            agreed, held = agreed + 1, held + 1
    assert agreed == 1000 and held > 900


def test_with_torque_limits_all_of_200_directions_agree_with_another_linear_program(athena, rng):
    for torque in (0.4, 0.7, 1.0, 1.89):
        for _ in range(5):
            contacts, ways = bent_athena(athena, rng, torque), directions(rng, 10)
            result = support(contacts, ways, torque_limits=True)
            polygon = support_region(contacts, torque_limits=True).vertices
            others = furthest(contacts, ways, torque_limits=True)
            for way, distance, defined, expected in zip(ways, result.distance, result.defined, others, strict=True):
                assert defined == (expected is not None) == (len(polygon) > 0)
                if expected is not None:
                    assert distance == pytest.approx(expected, abs=1e-7)
                    assert -1e-6 <= (polygon @ way).max() - expected < 1e-7


def test_weaker_servos_hold_the_center_of_mass_in_fewer_places_and_at_last_in_none(athena):
    sizes = []
    for torque in (50.0, 1.89, 0.8, 0.5, 0.05):
        contacts = bent_athena(athena, np.random.default_rng(3), torque)
        free, limited = support_region(contacts), support_region(contacts, torque_limits=True)
        assert all(margin(p, free.vertices) > -1e-6 for p in limited.vertices)
        sizes.append(0.0 if limited.empty else np.ptp(limited.vertices, axis=0).prod())
    assert sizes[0] > sizes[2] > sizes[3] > sizes[4] == 0.0
    assert sizes[0] == pytest.approx(np.ptp(free.vertices, axis=0).prod(), abs=1e-6), (
        "50 N m hold whatever friction holds"
    )


def test_two_inward_contacts_hold_less_than_the_segment_between_them_by_the_three_force_theorem():
    """Normals at 45 degrees, friction angle 15 degrees: the lines of force meet where tan 60 and tan 30 allow."""
    tilted = np.array([[np.sin(np.pi / 4), 0, np.cos(np.pi / 4)], [-np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]])
    region = support_region(standing([[-1.0, 0, 0], [1, 0, 0]], tilted, np.tan(np.pi / 12)))
    assert np.sort(region.vertices, axis=0) == pytest.approx(np.array([[-0.5, 0.0], [0.5, 0.0]]), abs=1e-6)
    assert region.region_margin_at([0.2, 0.0]) == pytest.approx(0.0, abs=1e-9)
    assert region.region_margin_at([0.2, 0.1]) == pytest.approx(-0.1)
    assert region.region_margin_at([0.9, 0.3]) == pytest.approx(-0.5)


def test_one_contact_holds_the_center_of_mass_above_itself_or_nowhere():
    slope = [0.0, -np.sin(0.5), np.cos(0.5)]
    rough, smooth = (support_region(standing([[0.3, 0.1, 0.2]], slope, friction)) for friction in (0.6, 0.5))
    assert rough.vertices == pytest.approx(np.array([[0.3, 0.1]]), abs=1e-9) and not rough.cut
    assert rough.region_margin_at([0.3, 0.5]) == pytest.approx(-0.4)
    assert smooth.empty and smooth.region_margin_at([0.3, 0.1]) == -np.inf


def test_without_contacts_nothing_is_held():
    nothing = standing(np.zeros((0, 3)))
    assert support_region(nothing).empty and region_margin(nothing) == -np.inf
    result = support(nothing, [[1.0, 0.0], [0.0, 1.0]])
    assert not result.defined.any() and (result.distance == -np.inf).all() and np.isnan(result.point).all()


def test_contacts_in_line_on_level_ground_hold_their_segment_and_in_one_place_a_point():
    line = np.outer([0.0, 0.3, 1.0, 0.7], [1.0, 2.0, 0.0])
    region = support_region(standing(line))
    assert region.vertices[np.argsort(region.vertices[:, 0])] == pytest.approx(np.array([[0, 0], [1.0, 2.0]]), abs=1e-6)
    assert region.region_margin_at([2.0, -1.0]) == pytest.approx(-np.sqrt(5.0))
    assert support_region(standing(np.tile([0.4, 0.5, 0.6], (3, 1)))).vertices == pytest.approx(np.array([[0.4, 0.5]]))


def test_between_walls_that_can_be_pressed_apart_the_region_goes_on_and_is_cut():
    feet = [[-0.5, -0.2, 0.0], [-0.5, 0.2, 0.1], [0.5, -0.2, 0.1], [0.5, 0.2, -0.1]]
    walls = np.array([[1.0, 0, 0], [1, 0, 0], [-1, 0, 0], [-1, 0, 0]])
    for reach in (10.0, 50.0):
        region = support_region(standing(feet, walls, 1.0), reach=reach)
        assert region.cut and np.abs(region.vertices).max() == pytest.approx(reach)
    assert support_region(standing(feet, walls, 0.0)).empty, "without friction walls hold nothing"
    assert support_region(standing(feet, -walls, 1.0)).cut, "from outside, as a gripper"


def test_two_opposite_contacts_hold_a_center_of_mass_only_in_the_vertical_plane_through_them():
    region = support_region(standing([[-0.5, 0, 0], [0.5, 0, 0]], [[1.0, 0, 0], [-1, 0, 0]], 1.0))
    assert region.cut and np.abs(region.vertices[:, 1]).max() < 1e-6
    assert region.region_margin_at([0.0, 0.3]) == pytest.approx(-0.3)


def test_torque_limits_end_what_walls_leave_open():
    feet = [[-0.5, -0.2, 0.0], [-0.5, 0.2, 0.1], [0.5, -0.2, 0.1], [0.5, 0.2, -0.1]]
    walls = np.array([[1.0, 0, 0], [1, 0, 0], [-1, 0, 0], [-1, 0, 0]])
    rows = np.tile(np.vstack([np.eye(3), -np.eye(3)]), (4, 1, 1))
    contacts = standing(feet, walls, 1.0, torque_rows=rows, torque_bounds=np.full((4, 6), 20.0))
    region = support_region(contacts, torque_limits=True)
    assert not region.cut and not region.empty
    weak = dataclasses.replace(contacts, torque_bounds=np.full((4, 6), 0.24 * contacts.mass * GRAVITY))
    assert support_region(weak, torque_limits=True).empty, "four forces of less than a quarter of the weight"


def test_more_facets_and_more_friction_hold_more_and_the_pyramid_keeps_98_percent_of_the_friction(rng):
    for _ in range(5):
        contacts = uneven(rng)
        inner = dataclasses.replace(contacts, friction=contacts.friction * np.cos(np.pi / 16))
        least, usual, finer = (
            support_region(inner, facets=64),
            support_region(contacts),
            support_region(contacts, facets=64),
        )
        assert all(margin(p, usual.vertices) > -1e-6 for p in least.vertices)
        assert all(margin(p, finer.vertices) > -1e-6 for p in usual.vertices)


def test_the_region_does_not_depend_on_the_height_of_the_center_of_mass_and_turns_with_the_world(rng):
    contacts = uneven(rng)
    region = support_region(contacts)
    raised = dataclasses.replace(contacts, center_of_mass=contacts.center_of_mass + [0, 0, 5.0])
    assert np.array_equal(support_region(raised).vertices, region.vertices)
    R, shift = rpy_rotation([0.0, 0.0, 1.1]), np.array([30.0, -20.0, 4.0])
    moved = dataclasses.replace(contacts, points=contacts.points @ R.T + shift, normals=contacts.normals @ R.T)
    expected = region.vertices @ R[:2, :2].T + shift[:2]
    assert apart(support_region(moved).vertices, expected) < 1e-6


def test_contacts_of_every_kind_give_a_region_or_a_name(rng):
    """Points in one place or in line, normals all alike, opposite or random: no linear program is left unsolved."""
    kinds = set()
    for case in range(120):
        k = int(rng.integers(1, 7))
        points, normals = rng.normal(size=(k, 3)) * rng.choice([0.01, 0.2, 2.0]), rng.normal(size=(k, 3))
        if case % 4 == 1:
            points = points[:1] + np.outer(rng.normal(size=k), rng.normal(size=3))
            normals = UP + 0.1 * normals
        elif case % 4 == 2:
            normals[1::2] = -normals[0]
        elif case % 4 == 3:
            points[-1], normals[:] = points[0], UP
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        region = support_region(standing(points, normals, rng.choice([0.0, 0.6, 2.0])), facets=8)
        kinds.add("cut" if region.cut else min(len(region.vertices), 3))
        following = np.roll(region.vertices, -1, axis=0)
        twice_area = (region.vertices[:, 0] * following[:, 1] - following[:, 0] * region.vertices[:, 1]).sum()
        assert len(region.vertices) < 3 or twice_area > 0.0
    assert kinds == {0, 1, 2, 3, "cut"}


def test_region_margin_is_signed_like_the_polygons(rng):
    feet = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]]
    assert region_margin(standing(feet, center_of_mass=[0.5, 0.4, 1])) == pytest.approx(0.4, abs=1e-6)
    assert region_margin(standing(feet, center_of_mass=[2.3, 1.4, 1])) == pytest.approx(-0.5, abs=1e-6)


@pytest.mark.parametrize("status", [1, 2, 3, 4])
def test_a_solver_that_fails_is_never_taken_for_an_empty_region(monkeypatch, rng, status):
    contacts, failed = uneven(rng), SimpleNamespace(status=status, message="made up")
    monkeypatch.setattr(room, "linprog", lambda *_, **__: failed)
    for call in (support_region, region_margin, lambda s: support(s, [1.0, 0.0])):
        with pytest.raises(SolverError, match=rf"was not solved: made up \(status {status}\)"):
            call(contacts)


def test_a_solver_that_fails_once_is_asked_again(monkeypatch, rng):
    contacts = uneven(rng)
    expected, asked = support_region(contacts).vertices, []

    def unreliable(*arguments, **options):
        asked.append(options["options"]["presolve"])
        return linprog(*arguments, **options) if asked[-1] else SimpleNamespace(status=4, message="made up")

    monkeypatch.setattr(room, "linprog", unreliable)
    assert apart(support_region(contacts).vertices, expected) < 1e-6
    assert set(asked) == {False, True}


def test_bad_options_are_named(rng):
    contacts = uneven(rng)
    for options, message in (
        ({"facets": 2}, "facets: 2, expected a whole number of at least 3"),
        ({"reach": 0.0}, "reach: 0 m, expected above 0"),
        ({"torque_limits": True}, "torque_limits: the contacts have none"),
    ):
        for call in (support_region, region_margin, lambda s, **o: support(s, [1.0, 0.0], **o)):
            with pytest.raises(InvalidInputError, match=message):
                call(contacts, **options)
    with pytest.raises(InvalidInputError, match="tolerance: 0 m, expected at least 1e-08"):
        support_region(contacts, tolerance=0.0)
    with pytest.raises(InvalidInputError, match="direction: its length is 0"):
        support(contacts, [[1.0, 0.0], [0.0, 0.0]])
    with pytest.raises(InvalidInputError, match="direction: coordinate 1 is nan"):
        support(contacts, [np.nan, 1.0])
    with pytest.raises(InvalidInputError, match=r"point: expected shape \(2,\)"):
        support_region(contacts).region_margin_at([[0.0, 0.0]])


def test_the_old_name_of_the_margin_at_a_point_warns_and_still_works():
    region = support_region(uneven(np.random.default_rng(1)))
    with pytest.warns(DeprecationWarning, match="region_margin_at"):
        assert region.margin([0.1, 0.0]) == region.region_margin_at([0.1, 0.0])
