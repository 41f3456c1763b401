"""NumPy code in place: what it computes, and that rows are used again but never too early."""

import numpy as np
import pytest
import sympy as sp

from hexakin.numerics.trigonometry import angle as angle_of_arrays
from hexakin.symbolic.numpy_code import ANGLE_ROWS, array_code
from hexakin.symbolic.program import angle

a, b, c, s, t, u = sp.symbols("a b c s t u", real=True)
VALUES = {"a": 0.3, "b": -0.7, "c": 1.9, "s": 0.4, "k": 2.5}
FUNCTIONS = {name: getattr(np, name) for name in "absolute add copyto maximum multiply negative power subtract".split()}


def run(code, names, given=VALUES):
    """Execute the lines on rows of one number each; return the inputs and rows by name."""
    rows = {f"w{i}": np.full(1, np.nan) for i in range(code.rows)}
    inputs = {name: np.array([given[name]]) for name in names}
    exec("\n".join(code.lines), {**FUNCTIONS, "numpy": np, "angle": angle_of_arrays}, scope := {**inputs, **rows})
    return scope


def results(body, expressions, used_up=()):
    code = array_code(body, expressions, used_up)
    scope = run(code, "abcs")
    return [float(scope[name][0]) if name in scope else float(name) for name in code.values], code, scope


@pytest.mark.parametrize(
    "expression",
    [
        a + b + c,
        -a - b,
        a - b * c - 2 * s,
        -a * b,
        3 * a * b - 0.5,
        sp.sqrt(c) + a**2,
        a**3 / c,
        sp.Max(0, b) + sp.Max(a, b) + sp.Abs(b),
        angle(a, b, sp.sqrt(a**2 + b**2)) * c,
        sp.Mul(-1, sp.Add(a, b, evaluate=False), evaluate=False),
    ],
)
def test_the_calls_compute_the_expression(expression):
    (found,), _, scope = results([], [expression])
    functions = [{"angle": lambda y, x, length: np.arctan2(y, x)}, "numpy"]
    wanted = sp.lambdify([a, b, c, s], expression, functions)(*(VALUES[name] for name in "abcs"))
    assert found == pytest.approx(float(wanted), rel=1e-15)
    assert all(scope[name] == VALUES[name] for name in "abcs"), "inputs are left as they are"


def test_a_value_that_is_a_result_and_used_again_keeps_its_row():
    body = [(t, a * b), (u, t + c), (s, u * t)]
    values, code, _ = results(body, [t, s, u, sp.Integer(0), a])
    assert values == pytest.approx([-0.21, -0.3549, 1.69, 0.0, 0.3])
    assert code.rows == 3


def test_rows_are_used_again():
    chain = [(sp.Symbol(f"t{i + 1}", real=True), sp.Symbol(f"t{i}", real=True) * a + b) for i in range(20)]
    code = array_code([(sp.Symbol("t0", real=True), a * c), *chain], [chain[-1][0]])
    assert code.rows == 1
    # An input that is used up is worked on itself.
    assert array_code([(t, a * b)], [t], used_up=["a"]).values == ["a"]


def test_the_angle_of_a_vector_has_rows_of_its_own():
    code = array_code([], [angle(a, b, c)])
    (line,) = code.lines
    rows = line.removeprefix("angle(a, b, c, ").removesuffix(")").split(", ")
    assert len(set(rows)) == 1 + ANGLE_ROWS == code.rows


def test_results_go_into_places():
    code = array_code([(t, a * b)], [t, -t, t, sp.Integer(1)], into=[f"place[{i}]" for i in range(4)])
    place = np.zeros((4, 1))
    exec(
        "\n".join(code.lines),
        {**FUNCTIONS, "place": place, "a": np.array([0.3]), "b": np.array([-0.7])},
        {f"w{i}": np.empty(1) for i in range(code.rows)},
    )
    assert place.ravel() == pytest.approx([-0.21, 0.21, -0.21, 1.0])
