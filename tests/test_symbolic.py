"""What sympy derives equals the paper's equations, and the generated code equals what sympy derives."""

import ast

import numpy as np
import pytest
import sympy as sp

import hexakin as hk
from hexakin.exceptions import NoClosedFormError
from hexakin.installation import PACKAGE
from hexakin.kinematics import BRANCH_SIGNS
from hexakin.kinematics.leg_functions import leg_functions
from hexakin.robot.leg_table import DHRow, LegTable
from hexakin.symbolic.__main__ import generated_files


@pytest.fixture(scope="module")
def leg(athena):
    return hk.symbolic.derive(athena.table)


def names(leg):
    return {str(s): s for s in (*leg.joints, *leg.parameters)}


def test_forward_kinematics_is_a11_and_a12(leg):
    n = names(leg)
    t1, t2, t3, t4 = (n[f"theta_{i}"] for i in range(1, 5))
    l1, l2, l3, l4 = (n[f"l_{i}"] for i in range(1, 5))
    c, s = sp.cos, sp.sin
    radius = l4 * c(t3 + t4) + l3 * c(t3) + l2
    paper = sp.Matrix(
        [
            [c(t1 + t2) * c(t3 + t4), -c(t1 + t2) * s(t3 + t4), s(t1 + t2), c(t1 + t2) * radius + l1 * c(t1)],
            [s(t1 + t2) * c(t3 + t4), -s(t1 + t2) * s(t3 + t4), -c(t1 + t2), s(t1 + t2) * radius + l1 * s(t1)],
            [s(t3 + t4), c(t3 + t4), 0, l4 * s(t3 + t4) + l3 * s(t3)],
            [0, 0, 0, 1],
        ]
    )
    assert sp.expand(leg.forward - paper) == sp.zeros(4, 4)


def test_merging_parallel_axes_changes_nothing(leg):
    """The plain product of the rows' matrices gives the same pose."""
    plain = leg.transform(0, 1) * leg.transform(1, 2) * leg.transform(2, 3) * leg.transform(3, 4)
    values = {symbol: 0.3 + 0.1 * k for k, symbol in enumerate((*leg.joints, *leg.parameters))}
    difference = (plain - leg.forward).subs(values).evalf()
    assert max(abs(float(entry)) for entry in difference) < 1e-14


def test_generated_code_equals_sympys_evaluation_on_random_points(athena, leg, rng):
    """Forward, Jacobian and every inverse branch against evalf with 30 digits."""
    inverse = leg.inverse
    for _ in range(8):
        index = int(rng.integers(6))
        q = np.tile(rng.uniform(athena.q_min[0], athena.q_max[0]), (6, 1))
        values = dict(zip(leg.parameters, athena.parameters[index], strict=True))
        at = values | dict(zip(leg.joints, q[index], strict=True))
        foot = np.array(leg.foot.subs(at).evalf(30), dtype=float).ravel()
        assert hk.forward_kinematics(athena, q)[index] == pytest.approx(foot, abs=1e-15)
        exact = np.array(leg.jacobian.subs(at).evalf(30), dtype=float)
        assert hk.jacobian(athena, q)[index] == pytest.approx(exact, abs=1e-15)
        solution = hk.inverse_kinematics(athena, np.tile(foot, (6, 1)), branch="all")
        for branch, (side, knee) in enumerate(BRANCH_SIGNS.tolist()):
            at = values | dict(zip((inverse.x, inverse.y, inverse.z), foot, strict=True))
            at |= {inverse.side: side, inverse.knee: knee}
            reachable = float(inverse.outer.subs(at).evalf(30)) >= 0 and float(inverse.inner.subs(at).evalf(30)) >= 0
            assert solution.reachable[index, branch] == reachable
            if reachable:
                angles = np.array([float(angle.subs(at).evalf(30)) for angle in inverse.q])
                turn = np.exp(1j * (solution.q[index, branch] - angles))
                assert np.abs(turn - 1.0).max() < 1e-12


def test_the_inverse_solves_the_forward_equations_symbolically(leg):
    """Putting the closed form back into A(12) gives the foot, to 40 digits at a point away from special values."""
    inverse = leg.inverse
    values = {symbol: sp.Rational(30 + 7 * k, 100) for k, symbol in enumerate(leg.parameters)}
    target = {inverse.x: sp.Rational(7, 10), inverse.y: sp.Rational(3, 10), inverse.z: sp.Rational(-2, 10)}
    for side, knee in BRANCH_SIGNS.tolist():
        at = values | target | {inverse.side: side, inverse.knee: knee}
        if float(inverse.outer.subs(at)) < 0:
            continue
        angles = dict(zip(leg.joints, (angle.subs(at).evalf(60) for angle in inverse.q), strict=True))
        foot = leg.foot.subs(values).subs(angles).evalf(60)
        assert all(abs(a - b) < sp.Float("1e-40") for a, b in zip(foot, target.values(), strict=True))


def test_the_shipped_code_is_what_the_generator_writes():
    folder = PACKAGE / "generated"
    written = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.py")}
    assert written == generated_files()


def test_no_generated_function_has_more_than_twelve_parameters():
    for path in (PACKAGE / "generated").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                assert len(node.args.args) <= 12, (path.name, node.name)


def table(convention, rows, joints=("a", "b", "c")):
    return LegTable(convention, tuple(DHRow(*row) for row in rows), joints)


def test_a_modified_table_gives_the_same_leg_as_the_classical_one(rng):
    """A's leg in Khalil's convention: the twist and the length belong to the joint that follows."""
    classical = table("classical", [("a", 0, "l2", "pi/2"), ("b", 0, "l3", 0), ("c", 0, "l4", 0)])
    modified = table("modified", [("a", 0, 0, 0), ("b", 0, "l2", "pi/2"), ("c", 0, "l3", 0), (0, 0, "l4", 0)])
    first, second = hk.symbolic.derive(classical), hk.symbolic.derive(modified)
    assert sp.expand(first.foot - second.foot) == sp.zeros(3, 1)
    assert [sp.simplify(a - b) for a, b in zip(first.inverse.q, second.inverse.q, strict=True)] == [0, 0, 0]


def test_a_leg_with_an_offset_along_its_first_plane_has_its_inverse_derived(rng, tmp_path, monkeypatch):
    """Joint b is displaced by d along its own axis, so that the foot's plane misses the first axis."""
    monkeypatch.setenv("HEXAKIN_CACHE", str(tmp_path))
    offset = table("classical", [("a", 0, "l2", "pi/2"), ("b", "d", "l3", 0), ("c", 0, "l4", 0)])
    functions = leg_functions(offset)
    p = np.array([{"l2": 0.05, "l3": 0.1, "l4": 0.12, "d": 0.02}[name] for name in offset.parameters])
    foot = functions.forward(p, rng.uniform(-1.4, 1.4, (1000, 3)))
    for side, knee in BRANCH_SIGNS.astype(float):
        constants = functions.numeric.inverse_constants(p, side, knee)
        work = np.empty((functions.numeric.INVERSE_ROWS, len(foot)))
        *angles, clearance, outer, inner, square = functions.numeric.inverse_arrays(constants, foot.T, work)
        exists = (clearance >= 0) & (outer >= 0) & (inner >= 0)
        assert exists.sum() > 50
        back = functions.forward(p, np.stack(angles, axis=-1))
        assert np.abs(back - foot)[exists].max() < 1e-14
        assert (np.sqrt(square[exists]) <= functions.numeric.reach(p)[1]).all()


def test_parallel_axes_at_fixed_angles_and_differences_of_joints_are_generated(rng):
    """The third joint turns against the second; a fixed angle stands between them."""
    odd = table("classical", [("a", 0, "l2", "pi/2"), ("b", 0, "l3", 0), ("pi/3", 0, "l5", "pi"), ("c", 0, "l4", 0)])
    functions, leg = leg_functions(odd), hk.symbolic.derive(odd)
    p, q = rng.uniform(0.05, 0.1, len(odd.parameters)), rng.uniform(-3.0, 3.0, (20, 3))
    for k in range(len(q)):
        values = dict(zip((*leg.parameters, *leg.joints), (*p, *q[k]), strict=True))
        exact = np.array(leg.foot.subs(values).evalf(30), dtype=float).ravel()
        assert functions.forward(p, q)[k] == pytest.approx(exact, abs=1e-15)
        exact = np.array(leg.jacobian.subs(values).evalf(30), dtype=float)
        assert functions.jacobian(p, q)[k] == pytest.approx(exact, abs=1e-15)


def test_a_leg_without_a_known_closed_form_is_refused_by_name():
    spatial = table("classical", [("a", 0, "l2", "pi/2"), ("b", 0, "l3", "pi/2"), ("c", 0, "l4", 0)])
    with pytest.raises(NoClosedFormError, match="no closed-form inverse"):
        _ = hk.symbolic.derive(spatial).inverse
