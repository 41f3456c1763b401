"""Solvers of one step's contact problem: exact cone, polyhedron by Lemke's method, and Pinocchio's ADMM.

The random problems are those of six feet on the ground at an impact: free joints, servos with limited torque, and
joints whose speeds are given, so that only the body moves and eighteen impulses act on six coordinates.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from hexakin import dynamics
from hexakin.contact import ContactProblem
from hexakin.contact import solve as solve_problem
from hexakin.contact.admm import solve_admm
from hexakin.contact.cone import ConeProblem, cone_memory, solve_cone
from hexakin.contact.lcp import nearest_in_polygon, solve_polyhedron
from hexakin.contact.lemke import RAY, SOLVED, TOO_LONG, lemke
from hexakin.exceptions import InvalidInputError

COUNT = 1000
FRICTION = 0.9
TIME_STEP = 1e-3  # [s]
SERVO_LIMIT = 1.89e-3  # [N m s]: the servos' 1.89 N m over a step
FEET = 6


class Problem(NamedTuple):
    """Velocities G p + g; ``rows`` maps coordinates to them, so that ``rows``.T p is the resultant impulse."""

    G: np.ndarray
    g: np.ndarray
    low: np.ndarray
    high: np.ndarray
    rows: np.ndarray
    M: np.ndarray
    r: np.ndarray
    target: np.ndarray


def random_problem(robot, rng, joints):
    configuration = dynamics.configuration(robot, np.eye(4), robot.standing_q + rng.uniform(-0.3, 0.3, (FEET, 3)))
    v = np.concatenate([rng.normal(0.0, 0.2, 3), rng.normal(0.0, 0.5, 3), rng.normal(0.0, 1.0, 18)])
    M = dynamics.mass_matrix(robot, configuration)
    r = M @ v - TIME_STEP * dynamics.bias(robot, configuration, v)
    rows = dynamics.foot_jacobians(robot, configuration).reshape(3 * FEET, 24)
    known, limit, target = np.zeros(3 * FEET), np.empty(0), np.empty(0)
    if joints == "servos":
        target, limit = rng.normal(0.0, 0.3, 18), np.full(18, SERVO_LIMIT)
        rows, known = np.vstack([rows, np.eye(24)[6:]]), np.concatenate([known, -target])
    elif joints == "locked":
        target = rng.normal(0.0, 0.3, 18)
        known, r = rows[:, 6:] @ target, r[:6] - M[:6, 6:] @ target
        rows, M = rows[:, :6].copy(), M[:6, :6].copy()
    half = np.linalg.solve(np.linalg.cholesky(M), np.column_stack([rows.T, r]))
    return Problem(
        half[:, :-1].T @ half[:, :-1], half[:, :-1].T @ half[:, -1] + known, -limit, limit, rows, M, r, target
    )


@pytest.fixture(scope="module", params=["free", "servos", "locked"])
def problems(request, athena):
    rng = np.random.default_rng(1)
    return [random_problem(athena, rng, request.param) for _ in range(COUNT)]


def residual(problem, p):
    """Distance by which Coulomb's law fails, relative to the largest impulse; apart from the library's own."""
    G, g, n = problem.G, problem.g, 3 * FEET
    u = G @ p + g
    rho = np.concatenate([np.repeat(3.0 / np.diag(G)[:n].reshape(-1, 3).sum(1), 3), 1.0 / np.diag(G)[n:]])
    y = p - rho * u
    foot, servo = y[:n].reshape(-1, 3), np.clip(y[n:], problem.low, problem.high)
    bound, normal = FRICTION * np.maximum(p[2:n:3], 0.0), np.maximum(foot[:, 2], 0.0)
    length = np.hypot(foot[:, 0], foot[:, 1])
    share = np.divide(bound, length, out=np.ones(FEET), where=length > bound)
    slip = np.linalg.norm(foot[:, :2] * share[:, None] - p[:n].reshape(-1, 3)[:, :2], axis=1)
    moved = np.concatenate([slip, normal - p[2:n:3], servo - p[n:]])
    return np.abs(moved).max() / max(np.abs(p).max(), 1e-3 * np.abs(rho * g).max())


def solve(problem, p=None, tolerance=1e-10):
    """The exact cone: through the servos' active sets where there are servos and no first guess, else directly."""
    contacts, zero = np.full(FEET, FRICTION), np.zeros(FEET)
    if problem.low.size > 0 and p is None:
        J = problem.rows[: 3 * FEET].reshape(FEET, 3, -1)
        given = ContactProblem(
            problem.M, problem.r, J, FRICTION, servo=np.arange(6, 24), servo_velocity=problem.target,
            servo_limit=problem.high,
        )  # fmt: skip
        solution = solve_problem(given, tolerance=tolerance, max_iterations=2000)
        return np.concatenate([solution.impulse.ravel(), solution.servo_impulse])
    p = np.zeros(problem.g.size) if p is None else p.copy()
    u = np.empty(p.size)
    cone = ConeProblem(problem.G, problem.g, contacts, zero, problem.low, problem.high)
    solve_cone(cone, FEET, problem.low.size, p, u, tolerance, 2000, cone_memory(p.size))
    return p


def polyhedron(problem, facets, tolerance=1e-10, max_pivots=2000):
    p, u = np.empty(problem.g.size), np.empty(problem.g.size)
    cone = ConeProblem(problem.G, problem.g, np.full(FEET, FRICTION), np.zeros(FEET), problem.low, problem.high)
    error, pivots = solve_polyhedron(cone, FEET, problem.low.size, facets, p, u, tolerance, max_pivots)
    return p, u, error, pivots


def particle(velocity, friction=FRICTION, p_min=0.0, facets=4):
    """Impulse and velocity of a unit mass at a contact, by polyhedron and by cone."""
    g, none, out = np.array(velocity, dtype=float), np.empty(0), []
    problem = ConeProblem(np.eye(3), g, np.array([friction]), np.array([p_min]), none, none)
    for solver, options, memory in ((solve_polyhedron, (facets,), ()), (solve_cone, (), (cone_memory(3),))):
        p, u = np.zeros(3), np.zeros(3)
        error, _ = solver(problem, 1, 0, *options, p, u, 1e-12, 100, *memory)
        assert error <= 1e-12
        out += [p, u]
    return out


def distance(problem, p, other):
    """Difference of the resultant impulses, relative to the larger."""
    a, b = problem.rows.T @ p, problem.rows.T @ other
    return np.abs(a - b).max() / max(np.abs(a).max(), np.abs(b).max(), 1e-12)


# The default: exact cone.


def test_cone_solves_every_random_problem(problems):
    errors = [residual(problem, solve(problem)) for problem in problems]
    assert sum(error <= 1e-8 for error in errors) == COUNT


def test_cone_and_pinocchio_agree_or_are_both_right(problems):
    compared, apart = 0, []
    for problem in problems:
        ours, theirs = (
            solve(problem),
            solve_admm(problem.G, problem.g, np.full(FEET, FRICTION), problem.low, problem.high),
        )
        assert theirs.residual == pytest.approx(residual(problem, theirs.p), rel=1e-3, abs=1e-13)
        if theirs.residual <= 1e-8:
            compared += 1
            if distance(problem, ours, theirs.p) > 1e-6:
                apart.append((problem, ours, theirs.p))
    assert compared >= 0.99 * COUNT  # all, on the machine where this was written
    # Coulomb's law may have several solutions; here 9 of 1000 problems with servos show a second one.
    assert len(apart) <= (0.02 * COUNT if problems[0].low.size > 0 else 0)
    for problem, ours, theirs in apart:
        # Neither is an approximation of the other: each is next to an exact solution, and these are far apart.
        exact, other = solve(problem, ours, 1e-13), solve(problem, theirs, 1e-13)
        assert max(residual(problem, exact), residual(problem, other)) <= 1e-12
        moved = max(distance(problem, exact, ours), distance(problem, other, theirs))
        assert moved <= 1e-6 and distance(problem, exact, other) > 1000.0 * moved


def test_pinocchio_leaves_feet_in_flight_alone(athena):
    problem = random_problem(athena, np.random.default_rng(1), "free")
    g = np.tile([0.1, 0.2, 3.0], FEET)
    solution = solve_admm(problem.G, g, np.full(FEET, FRICTION))
    np.testing.assert_allclose(solution.u, g, atol=1e-9)
    assert np.abs(solution.p).max() <= 1e-10
    assert solve_admm(problem.G, 0.0 * g, np.full(FEET, FRICTION)).iterations == 0


def test_pinocchio_gets_no_bad_problem():
    with pytest.raises(InvalidInputError, match="G: expected shape"):
        solve_admm(np.eye(2), np.zeros(3), [0.5])
    with pytest.raises(InvalidInputError, match=r"mu: -0\.5"):
        solve_admm(np.eye(3), np.zeros(3), [-0.5])
    with pytest.raises(InvalidInputError, match="low: 1 of row 1 is above high 0"):
        solve_admm(np.eye(4), np.zeros(4), [0.5], [1.0], [0.0])


# The polyhedron.


@pytest.mark.parametrize("facets", [4, 8])
def test_lemkes_first_path_solves_every_random_problem(problems, facets):
    errors = [polyhedron(problem, facets, tolerance=np.inf)[2] for problem in problems]
    assert sum(error <= 1e-8 for error in errors) == COUNT


def test_polyhedron_meets_its_complementarity_conditions(problems):
    facets, n = 8, 3 * FEET
    angle = 2.0 * np.pi * np.arange(facets) / facets
    D = np.column_stack([np.cos(angle), np.sin(angle)])
    for problem in problems[:100]:
        p, u, _, _ = polyhedron(problem, facets)
        np.testing.assert_allclose(u, problem.G @ p + problem.g, atol=1e-12)
        feet, slip = p[:n].reshape(-1, 3), u[:n].reshape(-1, 3)
        assert feet[:, 2].min() >= 0.0 and slip[:, 2].min() >= -1e-9 and np.abs(feet[:, 2] * slip[:, 2]).max() <= 1e-10
        # Inside the polygon, and there as much power is lost as any of its corners could lose (A(9), A(10)).
        edges = np.cos(angle + np.pi / facets), np.sin(angle + np.pi / facets)
        assert (feet[:, :2] @ np.array(edges) <= np.cos(np.pi / facets) * FRICTION * feet[:, 2:] + 1e-12).all()
        lost, best = -(feet[:, :2] * slip[:, :2]).sum(1), FRICTION * feet[:, 2] * (-slip[:, :2] @ D.T).max(1)
        np.testing.assert_allclose(lost, best, atol=1e-10)
        assert (np.abs(u[n:][np.abs(p[n:]) < SERVO_LIMIT * (1.0 - 1e-9)]) <= 1e-9).all()


def test_polyhedron_closes_in_on_the_cone_like_one_over_the_facets(problems):
    """Not like their square: a sliding foot is pushed along the nearest generator, up to pi / k off the slip."""
    facets = np.array([8, 16, 32])
    errors = []
    for problem in problems[:150]:
        exact = solve(problem)
        u = (problem.G @ exact + problem.g)[: 3 * FEET].reshape(-1, 3)
        if (np.hypot(u[:, 0], u[:, 1])[exact[2 : 3 * FEET : 3] > 0.0] > 1e-6).any():
            errors.append([distance(problem, polyhedron(problem, k)[0], exact) for k in facets])
    assert len(errors) >= 75
    slope = np.polyfit(np.log(facets), np.log(np.mean(errors, axis=0)), 1)[0]
    assert -1.5 < slope < -0.7


def test_polyhedron_takes_another_path_where_one_fails(problems):
    rescued = 0
    for problem in problems[:100]:
        _, _, _, needed = polyhedron(problem, 8)
        if needed > 1:
            _, _, error, used = polyhedron(problem, 8, max_pivots=needed - 1)
            assert needed - 1 < used <= 4 * (needed - 1)
            rescued += error <= 1e-10
    assert rescued >= 10


def test_polyhedron_without_enough_pivots_reports_what_is_left(problems):
    errors = [polyhedron(problem, 4, max_pivots=2)[2] for problem in problems[:20]]
    assert np.median(errors) > 1e-2


def test_polyhedron_never_takes_nan_for_a_solution(problems):
    problem = problems[0]
    for bad in (problem._replace(g=problem.g * np.nan), problem._replace(G=problem.G * np.nan)):
        assert polyhedron(bad, 4)[2] == np.inf
    if problem.low.size > 0:
        assert polyhedron(problem._replace(high=problem.high + np.inf), 4)[2] > 1e-3


@pytest.mark.parametrize("facets", [4, 8, 16])
def test_polyhedron_sticks_less_between_two_generators(facets):
    """A landing at 1 m/s stops a tangential speed of up to mu along a generator, of mu cos(pi / k) between two."""
    between = np.pi / facets
    for angle, bound in ((0.0, FRICTION), (between, FRICTION * np.cos(between)), (2 * between, FRICTION)):
        along = np.array([np.cos(angle), np.sin(angle)])
        for speed in (0.999 * bound, 1.001 * bound):
            _, u, _, _ = particle([*(speed * along), -1.0], facets=facets)
            np.testing.assert_allclose(u[:2], max(speed - bound, 0.0) * along, atol=1e-12)
    _, _, _, u = particle([*(0.999 * FRICTION * along), -1.0])
    np.testing.assert_allclose(u, 0.0, atol=1e-12)


def test_least_normal_impulse_carries_friction_at_an_open_contact():
    p, u, q, w = particle([0.3, 0.0, 0.5], p_min=1.0)
    np.testing.assert_allclose(p, [-0.3, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(u, [0.0, 0.0, 1.5], atol=1e-12)
    np.testing.assert_allclose([q, w], [p, u], atol=1e-12)
    p, u, q, w = particle([2.0, 0.0, -3.0], p_min=1.0)
    np.testing.assert_allclose(p, [-2.0, 0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose([q, w], [p, u], atol=1e-12)


def test_nearest_point_in_polygon_is_in_it_and_has_all_corners_behind(rng):
    for facets in (4, 6, 8, 16):
        angle = 2.0 * np.pi * np.arange(facets) / facets
        corners = 1.5 * np.column_stack([np.cos(angle), np.sin(angle)])
        normals = np.column_stack([np.cos(angle + np.pi / facets), np.sin(angle + np.pi / facets)])
        for point in rng.normal(0.0, 2.0, (200, 2)):
            nearest = np.array(nearest_in_polygon(*point, 1.5, facets))
            assert (normals @ nearest).max() <= 1.5 * np.cos(np.pi / facets) + 1e-12
            assert ((corners - nearest) @ (point - nearest)).max() <= 1e-12


# Lemke's method itself.


@pytest.mark.parametrize(
    ("A", "q", "z"),
    [
        # Murty, "Linear Complementarity, Linear and Nonlinear Programming" (1988); the last one cycles
        # without a rule for ties (Kostreva, "Cycling in linear complementarity problems", 1979).
        ([[1, 0, 0], [2, 1, 0], [2, 2, 1]], [-8, -12, -14], [8, 0, 0]),
        ([[1, -1, -1, -1], [-1, 1, -1, -1], [1, 1, 2, 0], [1, 1, 0, 2]], [3, 5, -9, -5], [2, 1, 3, 1]),
        ([[2, 1], [1, 2]], [-5, -6], [4 / 3, 7 / 3]),
        ([[2, 1], [1, 2]], [1, 2], [0, 0]),
        ([[1, 2, 0], [0, 1, 2], [2, 0, 1]], [-1, -1, -1], [1 / 3, 1 / 3, 1 / 3]),
    ],
)
def test_lemke_solves_textbook_examples(A, q, z):
    found, status, _ = lemke(np.array(A, dtype=float), np.array(q, dtype=float), 100)
    assert status == SOLVED
    np.testing.assert_allclose(found, z, atol=1e-12)


def by_enumeration(A, q):
    for held in product([False, True], repeat=q.size):
        held, z = np.array(held), np.zeros(q.size)
        z[held] = np.linalg.solve(A[np.ix_(held, held)], -q[held])
        if z.min() >= 0.0 and (A @ z + q).min() >= -1e-12:
            return z
    return None


def test_lemke_finds_the_one_solution_of_a_p_matrix(rng):
    for _ in range(50):
        B, skew = rng.normal(size=(6, 6)), rng.normal(size=(6, 6))
        A, q = B @ B.T + 0.1 * np.eye(6) + skew - skew.T, rng.normal(size=6)
        z, status, _ = lemke(A, q, 1000)
        assert status == SOLVED
        np.testing.assert_allclose(z, by_enumeration(A, q), atol=1e-9)


def test_lemke_solves_degenerate_problems_without_cycling(rng):
    """Small whole numbers tie in nearly every ratio test; q in A's range makes them solvable."""
    for _ in range(300):
        B = rng.integers(-1, 2, (12, 5)).astype(float)
        A = B @ B.T
        q = A @ rng.integers(-1, 2, 12) + rng.integers(0, 2, 12)
        z, status, pivots = lemke(A, q, 2000)
        w = A @ z + q
        assert status == SOLVED and pivots < 100
        assert z.min() >= 0.0 and w.min() >= -1e-9 and abs(z @ w) <= 1e-8


def test_lemke_ends_on_a_ray_where_there_is_no_solution(rng):
    assert lemke(np.array([[-1.0, 0.0, -3.0], [1.0, -2.0, -5.0], [-2.0, -1.0, -2.0]]), -np.ones(3), 100)[1] == RAY
    assert lemke(np.array([[1.0, -1.0, 3.0], [2.0, -1.0, 3.0], [-1.0, -2.0, 0.0]]), -np.ones(3), 100)[1] == RAY
    for _ in range(50):
        B, skew = rng.normal(size=(8, 4)), rng.normal(size=(8, 8))
        B[0], skew[0], skew[:, 0] = 0.0, -abs(skew[0]), abs(skew[0])
        A, q = B @ B.T + skew - skew.T, rng.normal(size=8)
        q[0] = -1.0  # row 0 of A is not positive, so that w_0 < 0 for every z >= 0
        assert lemke(A, q, 1000)[1] == RAY


def test_lemke_reports_neither_nan_nor_too_few_pivots_as_solved(rng):
    B, q = rng.normal(size=(6, 6)), -np.ones(6)
    assert lemke(B @ B.T, q, 1)[1] == TOO_LONG
    assert lemke(B @ B.T, q * np.nan, 100)[1] != SOLVED
    assert lemke(B * np.nan, q, 100)[1] != SOLVED
