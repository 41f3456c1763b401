"""One pose, blocks of NumPy and compiled loops give the same, to rounding; and exactly what mpmath gives, to ulps.

The unit tests compare 2000 poses with mpmath; ``tests/benchmarks/kinematics.py`` does so with 100000.
"""

import copy
import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError
from hexakin.kinematics import BRANCH_SIGNS, code_cache, evaluation, forward
from hexakin.kinematics.bounds import LIMIT_TOLERANCE, REACH_TOLERANCE, Bounds
from hexakin.kinematics.evaluation import OutOfRangeError, forward_of, inverse_of, jacobian_of
from hexakin.kinematics.leg_functions import leg_functions, within_half_turn
from hexakin.numerics.trigonometry import LARGEST
from hexakin.robot.leg_table import DHRow, LegTable, pi_multiple

CODES = ("scalar", "arrays", "loops")


@pytest.fixture(params=CODES)
def code(request, monkeypatch):
    """Make every call use one of the three codes."""
    if request.param == "loops":
        pytest.importorskip("numba")
        monkeypatch.setattr(evaluation, "_loops", lambda functions, _: functions.loops)
    else:
        monkeypatch.setattr(evaluation, "_loops", lambda *_: None)
    monkeypatch.setattr(evaluation, "FEW", 10**9 if request.param == "scalar" else 0)
    return request.param


@pytest.fixture(params=["athena", "hwr", "phantomx"])
def robot(request):
    return hk.load_robot(request.param)


def plain_forward(robot, q):
    """Foot positions by multiplying the table's motions, with the precision of ``q``."""
    kind = q.dtype
    result = np.empty(q.shape, dtype=kind)
    for leg in range(robot.num_legs):
        place, axes = np.zeros((*q.shape[:-2], 3), kind), np.broadcast_to(np.eye(3, dtype=kind), (*q.shape[:-2], 3, 3))
        for motion, entry in robot.table.motions:
            exact = pi_multiple(entry)
            if entry in robot.table.joints:
                value = q[..., leg, robot.table.joints.index(entry)]
            elif exact is not None:
                value = kind.type(exact.numerator) / kind.type(exact.denominator) * kind.type(np.pi)
            else:
                value = kind.type(robot.legs[leg].values[str(entry)])
            axis = "xyz".index(motion[1])
            if motion[0] == "t":
                place = place + axes[..., axis] * np.asarray(value)[..., None]
                continue
            i, j = [(1, 2), (2, 0), (0, 1)][axis]
            c, s = np.cos(value)[..., None], np.sin(value)[..., None]
            turned = np.array(axes)
            turned[..., i] = c * axes[..., i] + s * axes[..., j]
            turned[..., j] = c * axes[..., j] - s * axes[..., i]
            axes = turned
        result[..., leg, :] = place
    return result


def test_forward_kinematics_are_the_tables_motions(code, robot, rng):
    q = rng.uniform(-np.pi, np.pi, (300, robot.num_legs, 3))
    exact = plain_forward(robot, q.astype(np.longdouble))
    assert np.abs(hk.forward_kinematics(robot, q) - exact).max() < 1e-15


def test_forward_kinematics_are_exact_to_four_units_in_the_last_place(code, athena):
    """Of the leg's length from the body's origin to its stretched foot, of 2000 leg poses in a whole turn."""
    mpmath.mp.dps = 50
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (334, 6, 3))
    foot = hk.forward_kinematics(athena, q)
    for leg in range(6):
        theta_1, l_1, l_2, l_3, l_4 = (mpmath.mpf(float(value)) for value in athena.parameters[leg])
        unit = np.spacing(float(l_1 + l_2 + l_3 + l_4))
        for pose in range(len(q)):
            a, b, c = (mpmath.mpf(float(value)) for value in q[pose, leg])
            radius = l_2 + l_3 * mpmath.cos(b) + l_4 * mpmath.cos(b + c)
            exact = (
                l_1 * mpmath.cos(theta_1) + radius * mpmath.cos(theta_1 + a),
                l_1 * mpmath.sin(theta_1) + radius * mpmath.sin(theta_1 + a),
                l_3 * mpmath.sin(b) + l_4 * mpmath.sin(b + c),
            )
            assert max(abs(mpmath.mpf(float(v)) - e) for v, e in zip(foot[pose, leg], exact, strict=True)) <= 4 * unit


@pytest.mark.parametrize("size", [1e2, 1e6, 1e9])
def test_large_angles_are_as_exact_as_small_ones(code, athena, rng, size):
    """Beyond 3e6 rad a batch takes its sines from the C library."""
    mpmath.mp.dps = 50
    q = rng.uniform(-size, size, (20, 6, 3))
    turn = 2 * mpmath.pi
    reduced = np.array([float(mpmath.fmod(mpmath.mpf(value), turn)) for value in q.ravel().tolist()]).reshape(q.shape)
    expected = plain_forward(athena, reduced.astype(np.longdouble))
    assert np.abs(hk.forward_kinematics(athena, q) - expected).max() < 1e-15
    assert np.abs(hk.jacobian(athena, q) - hk.jacobian(athena, reduced)).max() < 1e-15


def test_jacobians_are_differences_of_forward_kinematics(code, robot, rng):
    q, h = rng.uniform(-3.0, 3.0, (200, robot.num_legs, 3)).astype(np.longdouble), np.longdouble(1e-6)
    steps = h * np.eye(3, dtype=np.longdouble)
    numeric = np.stack([(plain_forward(robot, q + e) - plain_forward(robot, q - e)) / (2 * h) for e in steps], axis=-1)
    assert np.abs(hk.jacobian(robot, q.astype(float)) - numeric).max() < 1e-11


def test_the_inverse_brings_the_foot_to_its_target_on_every_branch(code, robot, rng):
    foot = hk.forward_kinematics(robot, rng.uniform(robot.q_min, robot.q_max, (2000, robot.num_legs, 3)))
    every = hk.inverse_kinematics(robot, foot, branch="all")
    assert every.within_limits.any(axis=-1).all()
    for branch in range(4):
        there = every.reachable[..., branch]
        back = hk.forward_kinematics(robot, np.where(there[..., None], every.q[..., branch, :], 0.0))
        assert there.any() and np.abs(back - foot)[there].max() < 1e-14
        assert np.array_equal(np.isnan(every.q[..., branch, :]).any(axis=-1), ~there)


def test_the_three_codes_agree_on_every_result(robot, rng, monkeypatch):
    pytest.importorskip("numba")
    q = rng.uniform(-3.0, 3.0, (1500, robot.num_legs, 3))
    foot = hk.forward_kinematics(robot, q) + rng.normal(0.0, 0.03, q.shape)
    found = {}
    for code in CODES:
        monkeypatch.setattr(evaluation, "_loops", lambda f, _, code=code: f.loops if code == "loops" else None)
        monkeypatch.setattr(evaluation, "FEW", 10**9 if code == "scalar" else 0)
        every = hk.inverse_kinematics(robot, foot, branch="all")
        standing, near = hk.inverse_kinematics(robot, foot), hk.inverse_kinematics(robot, foot, near=q)
        found[code] = [hk.forward_kinematics(robot, q), hk.jacobian(robot, q)]
        for solution in (every, standing, near):
            # Half a turn more or less is the same angle; near a stretched leg rounding is amplified.
            found[code] += [np.exp(1j * solution.q), solution.distance, solution.reachable, solution.within_limits]
            found[code] += [solution.branch, solution.reach]
    for code in ("arrays", "loops"):
        for one, other in zip(found["scalar"], found[code], strict=True):
            assert one.shape == other.shape and one.dtype == other.dtype
            if one.dtype == bool or one.dtype == int:
                assert np.array_equal(one, other)
            else:
                assert np.array_equal(np.isnan(one), np.isnan(other))
                assert np.nanmax(np.abs(one - other)) < (1e-12 if one.dtype == float else 1e-9)


def test_flags_of_a_million_targets_are_those_of_the_exact_distance(athena, code):
    """Computed with extended floats, up to the tolerance that is part of the contract; a quarter lies on the edges."""
    rng = np.random.default_rng(7)
    count = 170_000 if code != "scalar" else 2000
    foot = rng.uniform(-0.4, 0.4, (count, 6, 3))
    edge = count // 4
    straight = rng.uniform(athena.q_min, athena.q_max, (edge, 6, 3))
    straight[..., 2] = rng.choice([0.0, np.pi], (edge, 6))
    foot[:edge] = hk.forward_kinematics(athena, straight) * (1.0 + rng.choice([-1e-11, 0.0, 1e-11], (edge, 6, 1)))
    solution = hk.inverse_kinematics(athena, foot)
    theta_1, l_1, l_2, l_3, l_4 = athena.parameters.astype(np.longdouble).T
    x = foot[..., 0] - l_1 * np.cos(theta_1)
    y = foot[..., 1] - l_1 * np.sin(theta_1)
    square = (np.sqrt(x * x + y * y) - l_2) ** 2 + foot[..., 2].astype(np.longdouble) ** 2
    tolerance = REACH_TOLERANCE * (l_3 + l_4) ** 2
    room = np.minimum((l_3 + l_4) ** 2 - square, square - (l_3 - l_4) ** 2) + tolerance
    # An extended float is exact to 1e-19 here, and the code to 1e-16: no target may lie between.
    assert np.abs(room).min() > 1e-17 and (np.abs(room) < 1e-11).sum() > 100
    assert np.array_equal(solution.reachable, room > 0)
    assert np.array_equal(np.isnan(solution.q).any(axis=-1), ~solution.reachable)
    assert np.isfinite(solution.distance).all() and not solution.within_limits[~solution.reachable].any()


def test_singular_targets_are_solved(code, athena):
    """On the first axis its angle is 0; a leg is straight, or folded as far as it can be; each is reached exactly."""
    theta_1, l_1 = athena.parameters[:, 0], athena.parameters[:, 1]
    axis = np.stack([l_1 * np.cos(theta_1), l_1 * np.sin(theta_1), np.full(6, -0.1)], axis=-1)
    q = np.repeat(athena.standing_q[None], 3, axis=0)
    q[0, :, 2], q[1, :, 2], q[2, :, 1:] = 0.0, np.pi, (0.3, 1e-9)
    foot = np.concatenate([axis[None], hk.forward_kinematics(athena, q)])
    every = hk.inverse_kinematics(athena, foot, branch="all")
    assert every.reachable[:, :, :2].all()
    for branch in (0, 1):
        back = hk.forward_kinematics(athena, every.q[:, :, branch])
        # 1e-13 m beyond a straight leg counts as reached.
        assert np.abs(back - foot).max() < 1e-13
    assert np.array_equal(every.q[0, ..., 0], np.where(every.reachable[0], 0.0, np.nan), equal_nan=True)


def test_a_foot_in_the_second_joint_of_equal_links_is_solved(code):
    """HWR's femur and tibia are equally long: the second angle is free."""
    hwr = hk.load_robot("hwr")
    q = np.array(hwr.standing_q)
    q[:, 2] = np.pi
    foot = hk.forward_kinematics(hwr, q)
    solution = hk.inverse_kinematics(hwr, np.stack([foot] * 20))
    assert solution.reachable.all()
    assert np.abs(hk.forward_kinematics(hwr, solution.q) - foot).max() < 1e-14


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("count", [1, 2, 10, 500, 5000])
@pytest.mark.parametrize("last", [True, False])
def test_what_is_not_finite_is_named_in_a_batch(code, athena, bad, count, last):
    q, at = np.zeros((count, 6, 3)), count - 1 if last else 0
    q[at, 2, 1] = bad
    place = rf" \(at index {at}\)$"
    for call in (hk.forward_kinematics, hk.jacobian):
        with pytest.raises(InvalidInputError, match=rf"^q: leg 3, joint 2 is {bad}.*{place}") as caught:
            call(athena, q)
        assert caught.value.__context__ is None, "no other error is shown with it"
    for options in ({}, {"branch": "all"}, {"near": np.zeros((count, 6, 3))}, {"on_unreachable": "raise"}):
        with pytest.raises(InvalidInputError, match=rf"^p_body_foot: leg 3, coordinate 2 is {bad}.*{place}") as caught:
            hk.inverse_kinematics(athena, q, **options)
        assert caught.value.__context__ is None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_out_of_range_in_every_code(code, athena, bad):
    """The functions behind the public ones return no values then."""
    q = np.zeros((100, 6, 3))
    q[3, 2, 1] = bad
    for function in (forward_of(athena), jacobian_of(athena), inverse_of(athena, BRANCH_SIGNS)):
        with pytest.raises(OutOfRangeError):
            function(q)


@pytest.mark.parametrize("count", [1, 2, 10, 500, 5000])
def test_angles_of_any_size_are_taken(code, athena, rng, count):
    """Where one is too large for the polynomials of a batch, all angles are brought within half a turn first."""
    q = rng.uniform(athena.q_min, athena.q_max, (count, 6, 3))
    q[-1, 4, 2], q[0, 0, 0] = 1e300, -1.7e308
    for call in (hk.forward_kinematics, hk.jacobian):
        found, small = call(athena, q), call(athena, within_half_turn(q))
        assert np.array_equal(found, small) if code != "scalar" else np.abs(found - small).max() < 1e-15
    q[0, 3, 1] = np.nan
    with pytest.raises(InvalidInputError, match="q: leg 4, joint 2 is nan"):
        hk.forward_kinematics(athena, q)


@pytest.mark.parametrize("largest", [LARGEST, np.nextafter(LARGEST, np.inf)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_magnitude_alone_decides_which_batches_are_brought_within_half_a_turn(
    code, athena, rng, largest, sign, monkeypatch
):
    brought = []
    monkeypatch.setattr(forward, "within_half_turn", lambda q: brought.append(q) or within_half_turn(q))
    q = rng.uniform(athena.q_min, athena.q_max, (300, 6, 3))
    q[77, 1, 0] = sign * largest
    foot = hk.forward_kinematics(athena, q)
    assert len(brought) == (largest > LARGEST and code != "scalar")
    assert np.abs(foot - hk.forward_kinematics(athena, within_half_turn(q))).max() < 1e-15


@pytest.mark.parametrize("count", [1, 2, 200])
def test_a_foot_whose_square_overflows_is_out_of_reach(code, athena, count):
    foot = np.full((count, 6, 3), 1e200)
    solution = hk.inverse_kinematics(athena, foot)
    assert not solution.reachable.any() and np.isinf(solution.distance).all() and np.isnan(solution.q).all()


# --- bounds ------------------------------------------------------------------------------------------------


def test_bounds_are_those_of_the_robot(robot):
    bounds = inverse_of(robot, BRANCH_SIGNS).bounds
    reach = np.abs(leg_functions(robot.table).numeric.reach(robot.parameters.T)[1])
    assert np.array_equal(bounds.tolerance, REACH_TOLERANCE * np.broadcast_to(reach, robot.num_legs) ** 2)
    assert np.array_equal(bounds.middle.T, 0.5 * (robot.q_min + robot.q_max))
    assert np.array_equal(bounds.low.T, robot.q_min - LIMIT_TOLERANCE)
    assert np.array_equal(bounds.high.T, robot.q_max + LIMIT_TOLERANCE)
    every = bounds.each(lambda values: np.concatenate([values, values], axis=-1)).first(robot.num_legs)
    assert all(np.array_equal(one, other) for one, other in zip(bounds, every, strict=True))


@pytest.mark.parametrize("joint", range(3))
def test_each_bound_is_compared_with_its_own_angle(code, athena, rng, joint):
    """In each code a change of one field changes what it bounds, and nothing else."""
    inverse = inverse_of(athena, BRANCH_SIGNS[1:2])
    q = rng.uniform(athena.q_min + 0.1, athena.q_max - 0.1, (50, 6, 3))
    q[..., 2] = np.minimum(q[..., 2], -0.1)  # the branch of the standing pose
    foot = hk.forward_kinematics(athena, q)
    right = inverse(foot)
    angle = right.q[0, :, joint]
    assert right.within_limits.sum() > 100

    def changed(name, value):
        values = getattr(inverse.bounds, name).copy()
        values[joint] = value
        found = replace(inverse, bounds=inverse.bounds._replace(**{name: values}))(foot)
        assert np.array_equal(found.reachable, right.reachable) and np.array_equal(found.distance, right.distance)
        return found

    median = np.median(angle)
    high, low = changed("high", median), changed("low", median)
    assert np.array_equal(high.within_limits[0], right.within_limits[0] & (angle <= median))
    assert np.array_equal(low.within_limits[0], right.within_limits[0] & (angle >= median))
    assert np.array_equal(high.q, right.q) and np.array_equal(low.q, right.q)
    turned = changed("middle", inverse.bounds.middle[joint] + 2.0 * np.pi).q - right.q
    expected = np.zeros(3)
    expected[joint] = 2.0 * np.pi
    assert np.abs(turned - expected).max() < 1e-14


def test_the_tolerance_is_added_to_the_reach(code, athena):
    """A straight leg is 1 mm too short; its squared distance is 0.33e-3 m^2 out of reach."""
    inverse = inverse_of(athena, BRANCH_SIGNS[1:2])
    q = np.zeros((20, 6, 3))
    theta_1 = athena.parameters[:, 0]
    foot = hk.forward_kinematics(athena, q) + 1e-3 * np.stack([np.cos(theta_1), np.sin(theta_1), 0 * theta_1], axis=-1)
    assert not inverse(foot).reachable.any()
    for tolerance, reached in ((3e-4, False), (4e-4, True)):
        bounds = inverse.bounds._replace(tolerance=np.full(6, tolerance))
        found = replace(inverse, bounds=bounds)(foot)
        assert (found.reachable == reached).all() and (np.isfinite(found.q) == reached).all()


def test_the_generated_code_reads_every_field_of_the_bounds_by_its_name(robot):
    numeric = leg_functions(robot.table).numeric
    assert set(numeric.inverse_scalar.__code__.co_names) >= set(Bounds._fields)
    loops = pytest.importorskip("numba") and leg_functions(robot.table).loops
    inverse = inverse_of(robot, BRANCH_SIGNS)
    rows = loops.inverse_rows(inverse.constants[0], inverse.bounds)
    assert np.array_equal(rows, np.vstack([inverse.constants[0], *inverse.bounds]))


def test_empty_strided_and_read_only_arrays_are_taken(code, athena, rng):
    assert hk.forward_kinematics(athena, np.zeros((0, 6, 3))).shape == (0, 6, 3)
    assert hk.jacobian(athena, np.zeros((2, 0, 6, 3))).shape == (2, 0, 6, 3, 3)
    assert hk.inverse_kinematics(athena, np.zeros((0, 6, 3)), branch="all").q.shape == (0, 6, 4, 3)
    assert hk.inverse_kinematics(athena, np.zeros((0, 6, 3)), near=np.zeros((6, 3))).q.shape == (0, 6, 3)
    q = rng.uniform(-1.0, 1.0, (300, 6, 3))
    expected = hk.forward_kinematics(athena, q)
    strided = np.repeat(q, 2, axis=0)[::2]
    strided.setflags(write=False)
    by_twos = np.repeat(q, 2, axis=-1)[..., ::2]
    for same in (strided, by_twos, np.asfortranarray(q), q.tolist(), q.astype(">f8")):
        assert np.array_equal(hk.forward_kinematics(athena, same), expected)


@pytest.mark.parametrize("legs", [4, 8])
def test_robots_with_other_numbers_of_legs(edited, code, legs, rng):
    def change(tree):
        tree["num_legs"] = legs
        tree["legs"] = [{**copy.deepcopy(tree["legs"][k % 6]), "name": f"leg {k}"} for k in range(legs)]

    robot = edited("athena", change)
    q = rng.uniform(robot.q_min, robot.q_max, (2000, legs, 3))
    foot = hk.forward_kinematics(robot, q)
    assert np.abs(foot - plain_forward(robot, q.astype(np.longdouble))).max() < 1e-15
    assert np.abs(hk.inverse_kinematics(robot, foot, near=q).q - q).max() < 1e-6


def test_one_pose_and_small_batches_do_not_load_numba():
    code = (
        "import sys, numpy as np, hexakin as hk\n"
        "robot = hk.load_robot('athena')\n"
        "foot = hk.forward_kinematics(robot, np.zeros((5000, 6, 3)))\n"
        "hk.inverse_kinematics(robot, foot[0]), hk.inverse_kinematics(robot, foot)\n"
        "print('numba' in sys.modules, 'sympy' in sys.modules)\n"
        "sys.modules['numba'] = None\n"
        "from hexakin.kinematics.evaluation import prepare\n"
        "print(prepare(robot))\n"
        "print(hk.forward_kinematics(robot, np.zeros((5000, 6, 3))).shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert done.splitlines() == ["False False", "False", "(5000, 6, 3)"]


@pytest.fixture
def loops_used(athena, monkeypatch):
    """Say of a call whether it used compiled loops; nothing was prepared before."""
    pytest.importorskip("numba")
    monkeypatch.setattr(evaluation, "_prepared", set())
    chosen, choose = [], evaluation._loops

    def watched(*arguments):
        chosen.append(choose(*arguments) is not None)
        return choose(*arguments)

    monkeypatch.setattr(evaluation, "_loops", watched)

    def used(call, *arguments):
        chosen.clear()
        call(*arguments)
        assert len(set(chosen)) == 1
        return chosen[0]

    return used


def test_the_size_of_a_call_decides_whether_loops_are_used(athena, loops_used, monkeypatch):
    monkeypatch.setattr(evaluation, "MANY", 6000)
    q = np.zeros((1000, 6, 3)) + athena.standing_q
    foot = hk.forward_kinematics(athena, q)
    calls = {
        "forward": lambda n: hk.forward_kinematics(athena, q[:n]),
        "jacobian": lambda n: hk.jacobian(athena, q[:n]),
        "inverse": lambda n: hk.inverse_kinematics(athena, foot[:n]),
        "four branches": lambda n: hk.inverse_kinematics(athena, foot[: n // 4], branch="all"),
        "nearest branch": lambda n: hk.inverse_kinematics(athena, foot[: n // 4], near=q[: n // 4]),
    }
    for call in calls.values():
        assert not loops_used(call, 996)
        assert loops_used(call, 1000)
        assert not loops_used(call, 996), "what was called before does not count"


def test_prepared_loops_are_used_for_batches_of_all_sizes(athena, loops_used):
    q = np.zeros((20, 6, 3))
    assert not loops_used(hk.forward_kinematics, athena, q)
    assert evaluation.prepare(athena)
    assert loops_used(hk.forward_kinematics, athena, q)


# --- leg types that are not shipped ------------------------------------------------------------------------


TABLE = LegTable(
    "classical", (DHRow("a", 0, "u", "pi/2"), DHRow("b", "d", "v", 0), DHRow("c", 0, "w", 0)), tuple("abc")
)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HEXAKIN_CACHE", str(tmp_path / "cache"))
    leg_functions.cache_clear()
    yield tmp_path / "cache" / "leg_types"
    leg_functions.cache_clear()


def one_foot():
    functions = leg_functions(TABLE)
    return functions.forward(np.array([0.05, 0.02, 0.1, 0.12]), np.array([0.1, 0.2, 0.3]))


def test_a_leg_type_is_derived_once(cache, monkeypatch):
    foot = one_foot()
    assert len(list(cache.glob("leg_*.py"))) == 2 and not list(cache.glob("*.tmp"))
    leg_functions.cache_clear()
    monkeypatch.setattr(code_cache, "derived", lambda table: pytest.fail("derived again"))
    assert np.array_equal(one_foot(), foot)


@pytest.mark.parametrize("damage", [b"", b"raise SystemExit\n", b"\xff\xfe"])
def test_a_damaged_file_is_derived_again(cache, damage):
    foot = one_foot()
    for path in cache.glob("leg_*.py"):
        path.write_bytes(damage)
    leg_functions.cache_clear()
    assert np.array_equal(one_foot(), foot)
    assert all(len(path.read_bytes()) > 1000 for path in cache.glob("leg_*.py"))


def test_a_file_that_was_cut_off_is_derived_again(cache):
    foot = one_foot()
    for path in cache.glob("leg_*.py"):
        path.write_text(path.read_text()[:-200])
    leg_functions.cache_clear()
    assert np.array_equal(one_foot(), foot)


@pytest.mark.skipif(os.name != "posix", reason="only POSIX systems tell who may write to a folder")
def test_code_in_a_folder_that_others_may_write_to_is_not_run(cache, capsys):
    foot = one_foot()
    for path in cache.glob("leg_*.py"):
        text = "raise SystemExit\n"
        path.write_text(f"# sha256 {hashlib.sha256(text.encode()).hexdigest()}\n{text}", encoding="utf-8")
    cache.chmod(0o777)
    for _ in range(2):
        leg_functions.cache_clear()
        assert np.array_equal(one_foot(), foot)
    assert capsys.readouterr().err.count(f"other users may write to {cache} (chmod go-w forbids it)") == 1


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HEXAKIN_CACHE", str(tmp_path / "file" / "cache"))
    leg_functions.cache_clear()
    assert np.isfinite(one_foot()).all()
    assert leg_functions(TABLE).loops is None
    leg_functions.cache_clear()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_functions_of_a_leg_type_give_nan_for_angles_that_are_not_finite(athena, bad):
    functions, q = leg_functions(athena.table), np.zeros((3, 6, 3))
    q[1, 2, 0] = bad
    for values, right in (
        (functions.forward(athena.parameters, q), hk.forward_kinematics(athena, np.zeros((6, 3)))),
        (functions.jacobian(athena.parameters, q), hk.jacobian(athena, np.zeros((6, 3)))),
    ):
        whole = np.isfinite(values).reshape(3, 6, -1).all(axis=-1)
        assert whole[1, 2] == np.isfinite(bad) and whole.sum() == 18 - (not np.isfinite(bad))
        assert np.abs(values[0] - right).max() < 1e-15


def test_another_generator_has_another_file(cache, monkeypatch):
    one_foot()
    leg_functions.cache_clear()
    monkeypatch.setattr(code_cache, "_generator", lambda: "another")
    one_foot()
    assert len(list(cache.glob("leg_*.py"))) == 4


def test_two_processes_may_derive_at_once(cache):
    code = (
        "from hexakin.robot.leg_table import DHRow, LegTable\n"
        "from hexakin.kinematics.leg_functions import leg_functions\n"
        f"from numpy import array\ntable = {TABLE!r}\n"
        "print(leg_functions(table).forward(array([0.05, 0.02, 0.1, 0.12]), array([0.1, 0.2, 0.3])).tolist())"
    )
    runs = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(3)]
    assert [run.communicate()[0].strip() for run in runs] == [str(one_foot().tolist())] * 3
    assert len(list(cache.glob("leg_*.py"))) == 2 and not list(cache.glob("*.tmp"))


def test_a_leg_type_of_ones_own_has_compiled_loops(cache, edited, rng, monkeypatch):
    pytest.importorskip("numba")
    raised = edited("athena", lambda tree: (
        tree["leg_table"]["rows"][1].update(d="h"), tree["leg_table"]["parameters"].update(h=0.01)
    ))  # fmt: skip
    monkeypatch.setattr(evaluation, "_prepared", set())
    assert evaluation.prepare(raised)
    q = rng.uniform(raised.q_min, raised.q_max, (500, 6, 3))
    foot = hk.forward_kinematics(raised, q)
    assert np.abs(foot - plain_forward(raised, q.astype(np.longdouble))).max() < 1e-15
    every = hk.inverse_kinematics(raised, foot, branch="all")
    assert every.q.shape == (500, 6, *BRANCH_SIGNS.shape[:1], 3) and every.reachable.any(axis=-1).all()
    assert list(cache.glob("__pycache__/machine_code/*.nbc")), "the machine code lies beside its source"


def test_threads_do_not_meet_in_their_workspaces(code, athena, rng):
    angles = rng.uniform(athena.q_min, athena.q_max, (8, 1500, 6, 3))

    def both(q):
        foot = hk.forward_kinematics(athena, q)
        return foot, hk.jacobian(athena, q), hk.inverse_kinematics(athena, foot).q

    alone = [both(q) for q in angles]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(both, np.concatenate([angles] * 3)))
    for k, found in enumerate(together):
        assert all((a == b).all() for a, b in zip(found, alone[k % 8], strict=True))


def test_a_result_keeps_its_values_when_the_next_is_computed(code, athena, rng):
    first, second = rng.uniform(athena.q_min, athena.q_max, (2, 100, 6, 3))
    foot = hk.forward_kinematics(athena, first)
    solution, kept = hk.inverse_kinematics(athena, foot), foot.copy()
    q, distance = solution.q.copy(), solution.distance.copy()
    hk.inverse_kinematics(athena, hk.forward_kinematics(athena, second))
    assert (foot == kept).all() and (solution.q == q).all() and (solution.distance == distance).all()
