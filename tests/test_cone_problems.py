"""Random contact problems in classes, at friction coefficients from 0 to 50: all are solved."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from contact_problems.random_problems import random_problem

from hexakin import contact
from hexakin.contact.cone import ConeProblem, cone_memory, solve_cone
from hexakin.contact.last_resorts import solve_hard_cone

FOLDER = Path(__file__).parent / "contact_problems"
BAR = 1e-8


def test_the_first_tenth_of_the_random_problems_is_solved():
    run = subprocess.run([sys.executable, str(FOLDER), "--count", "100"], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout[-8000:] + run.stderr[-4000:]
    assert "11200 of 11200 problems solved" in run.stdout


def test_the_table_has_every_class_and_a_solution_of_every_problem():
    with open(FOLDER / "table.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len({(row["class"], row["compliance"], row["start"], row["friction"]) for row in rows}) == 4 * 2 * 2 * 7
    assert all(row["problems"] == row["solved"] == "1000" for row in rows)
    assert all(float(row["worst residual"]) <= BAR for row in rows)


def cone(G, g, mu, p_min=0.0, tolerance=1e-10, max_sweeps=200, capacity=0):
    """Impulses, velocities and residual of contacts without servos, from zero."""
    rows, none = len(g), np.empty(0)
    room = rows + capacity
    matrix, vector = np.full((room, room), np.nan), np.full(room, np.nan)
    matrix[:rows, :rows], vector[:rows] = G, g
    problem = ConeProblem(matrix, vector, np.full(room // 3, mu), np.full(room // 3, p_min), none, none)
    p, u = np.zeros(room), np.zeros(room)
    error, _ = solve_cone(problem, rows // 3, 0, p, u, tolerance, max_sweeps, cone_memory(room))
    assert (p[rows:] == 0.0).all() and (u[rows:] == 0.0).all()
    return p[:rows], u[:rows], error


def hard_problem():
    """A problem that sweeps and Newton's method do not solve, with a regular G."""
    return random_problem(np.random.default_rng([0, 0, 50, 46]), "many bodies", 5.0, 0.0)[0]


def test_rows_beyond_the_problem_are_not_used(rng):
    half = rng.normal(size=(6, 6))
    G, g = half @ half.T, rng.normal(size=6)
    exact, roomy = cone(G, g, 0.9), cone(G, g, 0.9, capacity=6)
    assert exact[2] <= 1e-10
    for value, other in zip(exact, roomy, strict=True):
        np.testing.assert_array_equal(value, other)


def test_a_contact_that_can_move_in_one_direction_only_is_solved():
    G = np.diag([0.0, 0.0, 2.0])
    p, u, error = cone(G, np.array([0.0, 0.0, -3.0]), 0.9)
    assert error <= 1e-10 and p[2] == pytest.approx(1.5) and u[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.9, 50.0])
def test_contacts_that_separate_carry_no_impulse(friction):
    p, u, error = cone(np.eye(6), np.array([1.0, 2.0, 0.5, -1.0, 0.0, 3.0]), friction)
    assert error == 0.0 and (p == 0.0).all() and u[2] == 0.5


def test_nan_is_never_a_solution():
    for G, g in ((np.eye(3) * np.nan, -np.ones(3)), (np.eye(3), np.full(3, np.nan)), (np.eye(3) * np.nan, np.zeros(3))):
        assert cone(G, g, 0.9, max_sweeps=20)[2] == np.inf


def test_polyhedra_solve_what_sweeps_and_newtons_method_do_not():
    problem = hard_problem()
    size = problem.g.size
    p, u, memory = np.zeros(size), np.zeros(size), cone_memory(size)
    arguments = ConeProblem(*problem), size // 3, 0, p, u, 1e-9
    assert solve_cone(*arguments, 200, memory)[0] > 1e-3
    assert solve_hard_cone(*arguments, memory)[0] <= 1e-9


def test_solve_takes_the_last_resorts():
    problem = hard_problem()
    half, n = np.linalg.cholesky(problem.G), problem.mu.size
    momentum = np.linalg.solve(half, problem.g)
    given = contact.ContactProblem(np.eye(3 * n), momentum, half.reshape(n, 3, 3 * n), friction=problem.mu)
    assert max(contact.solve(given).residuals) <= 1e-8
