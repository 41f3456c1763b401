"""The contact problem as a value: what solve promises, and what it refuses."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.contact import ContactProblem, solve
from hexakin.exceptions import ContactError, InvalidInputError, UnknownNameError


def falling_point(speed=(0.0, 0.0, -2.0), mass=3.0, **fields):
    """A point mass that meets the ground: rows t1, t2, n are x, y, z."""
    momentum = mass * np.array(speed)
    return ContactProblem(mass * np.eye(3), momentum, np.eye(3)[None], approach=speed[2], **fields)


@pytest.fixture
def standing(athena):
    """Six feet, gravity of one millisecond, no servos."""
    configuration = hk.dynamics.configuration(athena, np.eye(4), athena.standing_q)
    M = hk.dynamics.mass_matrix(athena, configuration)
    J = hk.dynamics.foot_jacobians(athena, configuration)
    return ContactProblem(
        M, -1e-3 * hk.dynamics.gravity(athena, configuration), J, servo=np.arange(6, 24), servo_limit=1.0
    )


@pytest.mark.parametrize("law", ["poisson", "newton"])
@pytest.mark.parametrize("xi", [0.0, 0.5, 1.0])
def test_a_point_leaves_at_its_restitution(law, xi):
    solution = solve(falling_point(), restitution=xi, law=law)
    assert solution.velocity == pytest.approx([0, 0, 2.0 * xi], abs=1e-12)
    assert solution.impulse[0, 2] == pytest.approx(3.0 * 2.0 * (1 + xi))


def test_a_compression_that_ends_exactly_at_rest_still_expands():
    """Then neither impulses nor velocities are left to tell the scale, only what is to be given back."""
    solution = solve(ContactProblem(np.eye(3), [0, 0, -1.0], np.eye(3)[None], approach=-1.0), restitution=0.5)
    assert solution.velocity == pytest.approx([0, 0, 0.5])


def test_the_paper_counts_the_compression_impulse_twice():
    """A-E6: with xi = 0.5 the printed A(5) lets a ball leave at 1.5 times its speed."""
    solution = solve(falling_point(), restitution=0.5)
    compression = solution.compression[0, 2]
    printed = (-2.0 * 3.0 + compression + compression + 0.5 * compression) / 3.0
    assert printed == pytest.approx(1.5 * 2.0)
    assert solution.velocity[2] == pytest.approx(0.5 * 2.0)


def test_friction_opposes_the_slip_within_its_cone():
    solution = solve(falling_point((1.0, 2.0, -0.5)), tolerance=1e-12)
    impulse = solution.impulse[0]
    assert np.hypot(*impulse[:2]) == pytest.approx(0.9 * impulse[2])
    assert impulse[:2] / np.hypot(*impulse[:2]) == pytest.approx(-solution.contact_velocity[0, :2] / np.hypot(
        *solution.contact_velocity[0, :2]))  # fmt: skip
    assert max(solution.residuals) < 1e-9


def test_a_facet_s_friction_lies_along_generators():
    solution = solve(falling_point((1.0, 0.2, -0.5)), facets=4)
    assert solution.impulse[0] == pytest.approx([-0.9 * 1.5, 0.0, 1.5])


@pytest.mark.parametrize("facets", [None, 4, 16])
def test_residuals_are_small_and_the_weight_is_carried(standing, athena, facets):
    solution = solve(standing, facets=facets)
    assert max(solution.residuals) < 1e-8
    weight = athena.mass * hk.dynamics.GRAVITY * 1e-3
    assert solution.impulse[:, 2].sum() == pytest.approx(weight, rel=1e-9)
    assert solution.velocity == pytest.approx(np.zeros(24), abs=1e-9)


def test_compliance_shares_evenly_and_changes_no_resultant(standing, athena):
    hard, soft = solve(standing), solve(standing, compliance=1e-6)
    assert soft.impulse[:, 2] == pytest.approx(np.full(6, soft.impulse[:, 2].mean()), rel=0.02)
    assert soft.impulse[:, 2].sum() == pytest.approx(hard.impulse[:, 2].sum(), rel=1e-5)


def test_servos_hold_or_give_their_limit(standing):
    weak = ContactProblem(standing.mass, standing.momentum, standing.jacobian, servo=standing.servo, servo_limit=1e-4)
    solution = solve(weak)
    at_limit = np.abs(solution.servo_impulse) > 1e-4 * (1 - 1e-9)
    assert at_limit.any()
    assert np.abs(solution.servo_impulse).max() <= 1e-4 * (1 + 1e-9)
    assert solution.velocity[6:][~at_limit] == pytest.approx(0.0, abs=1e-9)


def test_the_delassus_matrix_is_that_of_the_dynamics(standing, athena):
    configuration = hk.dynamics.configuration(athena, np.eye(4), athena.standing_q)
    assert standing.delassus == pytest.approx(hk.dynamics.delassus(athena, configuration), abs=1e-9)


def test_no_contacts_is_a_problem_too():
    solution = solve(ContactProblem(np.eye(2), [1.0, 2.0], np.zeros((0, 3, 2))))
    assert solution.velocity == pytest.approx([1.0, 2.0]) and solution.impulse.shape == (0, 3)


def test_what_is_not_solved_is_an_error_with_its_residual(standing):
    sliding = ContactProblem(standing.mass, standing.mass @ np.linspace(-1, 1, 24), standing.jacobian)
    with pytest.raises(ContactError, match="relative residual") as caught:
        solve(sliding, tolerance=1e-30, max_iterations=3)
    assert caught.value.residual > caught.value.tolerance == 1e-30


@pytest.mark.parametrize(
    "change, culprit",
    [
        ({"mass": -np.eye(3)}, "mass: not positive definite"),
        ({"mass": np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]])}, "mass: not symmetric"),
        ({"momentum": [np.nan, 0, 0]}, "momentum"),
        ({"jacobian": np.zeros((1, 2, 3))}, "jacobian"),
        ({"friction": -0.1}, "friction"),
        ({"friction": [0.1, 0.2]}, "friction"),
        ({"servo": [0, 0]}, "servo"),
        ({"servo": [7]}, "servo"),
        ({"servo": [0.5]}, "servo"),
        ({"servo": [0], "servo_limit": -1.0}, "servo_limit"),
    ],
)
def test_bad_problems_name_the_field(change, culprit):
    fields = {"mass": np.eye(3), "momentum": np.zeros(3), "jacobian": np.eye(3)[None]}
    with pytest.raises(InvalidInputError, match=culprit):
        ContactProblem(**{**fields, **change})


def test_bad_options_are_named():
    with pytest.raises(UnknownNameError, match="hertz"):
        solve(falling_point(), law="hertz")
    with pytest.raises(InvalidInputError, match="facets"):
        solve(falling_point(), facets=5)
    with pytest.raises(InvalidInputError, match="restitution"):
        solve(falling_point(), restitution=1.5)
