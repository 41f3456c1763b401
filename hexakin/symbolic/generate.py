"""Numeric code of a leg type, written from its symbolic kinematics in three forms.

One program of assignments (``hexakin.symbolic.program``) is printed three times:

- *scalar*: with Python's floats, leg by leg, for a few poses;
- *arrays*: with NumPy, for blocks that fit the cache;
- *loops*: compiled by numba, for large batches.

The functions of the code are described in ``generate``; ``hexakin.kinematics.evaluation`` calls them. ``python -m
hexakin.symbolic`` writes the code of the shipped leg types into ``hexakin.generated``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from hexakin.exceptions import NoClosedFormError
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import LegTable
from hexakin.symbolic.leg import LegKinematics, derive
from hexakin.symbolic.numpy_code import array_code
from hexakin.symbolic.program import Program, Statement, angle, program_of_angles, program_of_feet


class _Printer(PythonCodePrinter):
    """Python with the names that a target has for its functions."""

    def __init__(self, names: dict[str, str]):
        super().__init__({"fully_qualified_modules": False})
        self.names = names

    def _call(self, expression: sp.Expr) -> str:
        name = self.names[expression.func.__name__]
        return f"{name}({', '.join(self._print(argument) for argument in expression.args)})"

    _print_sin = _print_cos = _print_atan2 = _print_sign = _print_Abs = _print_Max = _call

    def _print_Add(self, expression: sp.Expr, **_: object) -> str:
        # What is taken off comes last: to negate an array costs as much as to add it.
        ordered = self._as_ordered_terms(expression)
        terms = [f"({self._print(term)})" if term.is_Add else self._print(term) for term in ordered]
        first, *rest = sorted(terms, key=lambda term: term.startswith("-"))
        return first + "".join(f" - {term[1:]}" if term.startswith("-") else f" + {term}" for term in rest)

    def _print_angle(self, expression: angle) -> str:
        y, x, length = map(self._print, expression.args)
        if self.names["angle"] == "angle":
            return f"angle({y}, {x}, {length})"
        # A zero is not to be negative: the angle of the zero vector is 0.
        return f"atan2({y} + 0.0, {x} + 0.0)"

    def _print_Pow(self, expression: sp.Pow, **_: object) -> str:
        base = self._print(expression.base)
        if expression.exp == sp.Rational(1, 2):
            return f"{self.names['sqrt']}({base})"
        if expression.exp == 2 and expression.base.is_Symbol:
            return f"({base}*{base})"
        return f"({base})**({self._print(expression.exp)})"


_SCALAR = _Printer({"sqrt": "sqrt", "angle": "atan2", "Max": "max", "Abs": "abs"})
_LOOPS = _Printer({"sqrt": "sqrt", "angle": "angle", "Max": "maximum", "Abs": "abs"})
_CONSTANTS = _Printer(
    {f: f"numpy.{f}" for f in ("sin", "cos", "sqrt", "sign")} | {"Max": "numpy.maximum", "Abs": "numpy.abs"}
)


def _assignments(statements: Iterable[Statement], printer: _Printer) -> list[str]:
    return [f"{name} = {printer.doprint(value)}" for name, value in statements]


def _tuple(names: Iterable[object]) -> str:
    return f"({''.join(f'{name}, ' for name in names)})"


def _unpacked(names: Iterable[object], source: str) -> str:
    return f"{_tuple(names)} = {source}"


def _function(head: str, summary: str, lines: Iterable[str], decorator: str = "") -> str:
    body = "\n".join("    " + line for line in lines)
    return f'{decorator}def {head}:\n    """{summary}"""\n{body}\n\n\n'


def _constants(program: Program, name: str, parameters: Sequence[sp.Symbol], extra: str = "") -> str:
    values = ", ".join(_CONSTANTS.doprint(value) for value in program.constants)
    lines = [_unpacked(parameters, "p"), f"return [{values}]"]
    return _function(f"{name}_constants(p{extra})", "Constants of legs with parameters ``p`` (n, ...).", lines)


def _leg_by_leg(numbers: str, head: str, body: Iterable[str]) -> list[str]:
    """Lines of a loop over poses around one over legs, which takes three of ``numbers`` for each leg.

    The inner loop ends with the constants, so that ``each`` goes on with the next pose.
    """
    poses = [f"each = iter({numbers})", f"for _ in range(len({numbers}) // (3 * len(constants))):"]
    return [*poses, "    " + head, *("        " + line for line in body)]


_PAIRS = ["s0", "s1", "s2", "k0", "k1", "k2"]
_SINCOS_ROWS = 2 * len(_PAIRS)  # of the workspace, half of which end with sines and cosines


def _names(letter: str, count: int) -> str:
    return "".join(f"{letter}{i}, " for i in range(count))


def _of_angles(name: str, program: Program, results: list[sp.Expr], parameters: Sequence[sp.Symbol]) -> str:
    """Scalar and array code of a function of the joint angles."""
    names = program.constants.values()
    inner = ["s0, k0, s1, k1, s2, k2 = sin(q0), cos(q0), sin(q1), cos(q1), sin(q2), cos(q2)"]
    inner += _assignments(program.body, _SCALAR)
    inner.append(f"result += ({', '.join(map(_SCALAR.doprint, results))})")
    head = f"for {_tuple(names)}, q0, q1, q2 in zip(constants, each, each, each):"
    scalar = ["result = []", *_leg_by_leg("angles", head, inner)]
    entries = [f"result[{i}]" for i in range(len(results))]
    code = array_code(program.body, results, used_up=_PAIRS, spare=_SINCOS_ROWS - len(_PAIRS), into=entries)
    rows = len(_PAIRS) + code.rows
    arrays = [
        _unpacked(names, "constants"),
        f"(s0, s1, s2), (k0, k1, k2), spare = sincos(angles, work[:{_SINCOS_ROWS}])",
        f"({_names('w', code.rows)}) = [*spare, *work[{_SINCOS_ROWS}:{rows}]]",
        *code.lines,
    ]
    return (
        _constants(program, name, parameters)
        + _function(
            f"{name}_scalar(constants, angles)",
            "Return all entries for ``angles`` (3 n,), pose by pose and leg by leg.",
            [*scalar, "return result"],
        )
        + _function(
            f"{name}_arrays(constants, angles, work, result)",
            f"Write each entry for angles (3, ...) to ``result`` ({len(results)}, ...); ``work`` has (rows, ...).",
            arrays,
        )
        + f"{name.upper()}_ROWS = {rows}\n\n\n"
    )


_WRAPPED = "q{0} + TURN * {round}((middle{0} - q{0}) * PER_TURN)"
_ANGLE_BOUNDS = ("middle", "low", "high")  # the fields of hexakin.kinematics.bounds.Bounds with a row for each angle
_BOUND_ROWS = {"tolerance": "bounds.tolerance"} | {
    f"{name}{k}": f"bounds.{name}[{k}]" for name in _ANGLE_BOUNDS for k in range(3)
}
_INVERSE_SCALAR = """\
if clearance >= -tolerance and outer >= -tolerance and inner >= -tolerance:
    {wrapped}
    angles += (q0, q1, q2)
    reachable.append(True)
    within.append(low0 <= q0 <= high0 and low1 <= q1 <= high1 and low2 <= q2 <= high2)
else:
    angles += (nan, nan, nan)
    reachable.append(False)
    within.append(False)
distance.append(sqrt(square))"""
_INVERSE_RESULTS = "q0, q1, q2, clearance, outer, inner, square"


def _of_feet(program: Program, results: list[sp.Expr], leg: LegKinematics) -> str:
    """Scalar and array code of the inverse."""
    names = list(program.constants.values())
    solved = f"{_INVERSE_RESULTS} = " + ", ".join(map(_SCALAR.doprint, results))
    wrapped = "; ".join(f"q{k} = " + _WRAPPED.format(k, round="round") for k in range(3))
    inner = [*_assignments(program.body, _SCALAR), solved, *_INVERSE_SCALAR.format(wrapped=wrapped).split("\n")]
    limits = ", ".join(_tuple(f"{name}{k}" for k in range(3)) for name in _ANGLE_BOUNDS)
    fields = ", ".join(f"bounds.{name}" for name in ("tolerance", *_ANGLE_BOUNDS))
    head = f"for {_tuple(names)}, tolerance, {limits}, x, y, z in zip(constants, {fields}, each, each, each):"
    scalar = ["angles, reachable, within, distance = [], [], [], []", *_leg_by_leg("feet", head, inner)]
    code = array_code(program.body, results)
    arrays = [_unpacked(names, "constants"), "x, y, z = feet", f"({_names('w', code.rows)}) = work[:{code.rows}]"]
    arrays += [*code.lines, f"return {', '.join(code.values)}"]
    reach = [_unpacked(leg.parameters, "p"), f"return {', '.join(map(_CONSTANTS.doprint, leg.inverse.reach))}"]
    return (
        _constants(program, "inverse", leg.parameters, ", side, knee")
        + _function("reach(p)", "Inner and outer reach.", reach)
        + _function(
            "inverse_scalar(constants, bounds, feet)",
            "Return angles, whether reachable and within the limits, and distance for ``feet`` (3 n,).",
            [*scalar, "return angles, reachable, within, distance"],
        )
        + _function(
            "inverse_arrays(constants, feet, work)",
            f"{_INVERSE_RESULTS} for feet (3, ...), all of them rows of ``work`` (rows, ...).",
            arrays,
        )
        + f"INVERSE_ROWS = {code.rows}\n\n\n"
    )


def _angle_loops(name: str, program: Program, results: list[sp.Expr]) -> str:
    """Compiled loops of a function of the joint angles."""
    width = len(results)
    names = program.constants.values()
    lines = [f"{c} = constants[{i}, m]" for i, c in enumerate(names)]
    lines += [f"s{k}, k{k} = sines[3 * m + {k}], cosines[3 * m + {k}]" for k in range(3)]
    lines += _assignments(program.body, _LOOPS)
    lines += [f"result[{width} * m + {i}] = {_LOOPS.doprint(value)}" for i, value in enumerate(results)]
    block = ["for m in range(sines.shape[0] // 3):", *("    " + line for line in lines)]
    drive = f"""\
tile, lost = constants.shape[1], 0
sines, cosines = numpy.empty(3 * tile), numpy.empty(3 * tile)
for start in range(0, angles.shape[0] // 3, tile):
    part = angles[3 * start : 3 * (start + tile)]
    s, k = sines[: part.shape[0]], cosines[: part.shape[0]]
    lost = max(lost, sincos(part, s, k))
    _{name}(constants, s, k, result[{width} * start : {width} * (start + tile)])
return lost"""
    return _function(
        f"_{name}(constants, sines, cosines, result)", "Evaluate one tile.", block, "@contracted\n"
    ) + _function(
        f"{name}(constants, angles, result)",
        "Evaluate all leg poses; return 1 if an angle is too large or not finite, else 0.",
        drive.split("\n"),
        '@kernel("2r", "1r", "1")\n',
    )


def _foot_loops(program: Program, results: list[sp.Expr]) -> str:
    """Compiled loops of the inverse."""
    # One table of constants and bounds, read from the first row to the last. In which order numbers are loaded decides
    # which products and sums LLVM fuses, and so the last bits of the results.
    lines = [f"{name} = rows[{i}, m]" for i, name in enumerate([*program.constants.values(), *_BOUND_ROWS])]
    lines += [f"{axis} = feet[3 * m + {k}]" for k, axis in enumerate("xyz")] + _assignments(program.body, _LOOPS)
    lines += [f"{_INVERSE_RESULTS} = {', '.join(map(_LOOPS.doprint, results))}"]
    lines += [f"q{k} = " + _WRAPPED.format(k, round="rounded") for k in range(3)]
    lines += ["there = (clearance >= -tolerance) & (outer >= -tolerance) & (inner >= -tolerance)"]
    inside = " & ".join(f"(low{k} <= q{k}) & (q{k} <= high{k})" for k in range(3))
    lines += ["reachable[m] = there", f"within[m] = there & {inside}", "distance[m] = sqrt(square)"]
    lines += [f"angles[3 * m + {k}] = q{k} if there else nan" for k in range(3)]
    # In this loop, because a loop of its own would wait for the memory: a tenth of the time of a large batch.
    lines += ["lost += not ((abs(x) < inf) & (abs(y) < inf) & (abs(z) < inf))"]
    block = ["lost = 0", "for m in range(feet.shape[0] // 3):", *("    " + line for line in lines), "return lost"]
    drive = """\
tile, lost = rows.shape[2], 0
for start in range(0, feet.shape[0] // 3, tile):
    stop = start + tile
    for b in range(rows.shape[0]):
        lost += _inverse(rows[b], feet[3 * start : 3 * stop], angles[b, 3 * start : 3 * stop],
                         reachable[b, start:stop], within[b, start:stop], distance[b, start:stop])
return lost"""
    arguments = "(rows, feet, angles, reachable, within, distance)"
    return (
        _function(
            "inverse_rows(constants, bounds)",
            "Return the rows (..., L) of one branch that ``inverse`` reads.",
            [f"return numpy.array([*constants, {', '.join(_BOUND_ROWS.values())}])"],
        )
        + _function(
            f"_inverse{arguments}", "Solve one tile; return how many feet are not finite.", block, "@contracted\n"
        )
        + _function(
            f"inverse{arguments}",
            "Solve for all leg poses; return 0 if all feet are finite.",
            drive.split("\n"),
            '@kernel("3r", "1r", "2", "2b", "2b", "2")\n',
        )
    )


_HEAD = '''"""{what} of the leg type {key!r}.

Generated by ``python -m hexakin.symbolic``; not to be edited.
"""
# ruff: noqa

from math import atan2, cos, inf, nan, sin, sqrt
'''


@dataclass(frozen=True)
class Sources:
    """Text of the two modules of a leg type: ``numeric`` needs NumPy, ``loops`` needs numba too."""

    numeric: str
    loops: str

    __repr__ = short_repr


def generate(table: LegTable) -> Sources:
    """Write the numeric code of the leg type of ``table``.

    Parameters, constants and results are in metres and radians. L is the number of legs, n a number of leg poses; the
    legs of a pose follow each other. ``numeric`` has the flag ``CLOSED_FORM`` and these functions, where ``forward``
    stands for ``jacobian`` too, with nine entries instead of three:

    - ``forward_constants(p)``: list of constants of legs with parameters ``p`` (number of parameters, ...);
    - ``forward_scalar(constants, angles)``: list (3 n,) of foot coordinates for ``angles`` (3 n,), a list of finite
      floats; ``constants`` is a list of L rows;
    - ``forward_arrays(constants, angles, work, result)``: writes ``result`` (3, n) for ``angles`` (3, n), with
      ``constants`` (number of constants, n) and ``work`` (``FORWARD_ROWS``, n). Raises ValueError as
      ``hexakin.numerics.trigonometry.sincos`` does.

    With a closed form there are also:

    - ``reach(p)``: inner and outer reach;
    - ``inverse_constants(p, side, knee)``: as above, for the branch with these signs;
    - ``inverse_scalar(constants, bounds, feet)``: lists of angles (3 n,), two flags and distance (n,) for ``feet``
      (3 n,); ``constants`` and the fields of ``bounds`` (``hexakin.kinematics.bounds.Bounds``) are lists of L rows;
    - ``inverse_arrays(constants, feet, work)``: rows of ``work`` (``INVERSE_ROWS``, n) with angles, clearance, outer,
      inner and square (``hexakin.symbolic.leg.InverseExpressions``) for ``feet`` (3, n). No bound is used.

    ``loops`` has a kernel for each. Legs are repeated to tiles of m leg poses there. All numbers of a leg pose follow
    each other in flat arrays, and what is returned is not 0 if an argument was out of range:

    - ``forward(constants, angles, result)``, with ``constants`` (number of constants, m);
    - ``inverse_rows(constants, bounds)``: rows (..., L) of one branch, of ``constants`` (number of constants, L) and
      bounds whose fields are arrays;
    - ``inverse(rows, feet, angles, reachable, within, distance)``, with ``rows`` (b, ..., m) and results (b, ...) of b
      branches.
    """
    leg = derive(table.canonical())
    forward, jacobian = ((p, [*r]) for p, r in (program_of_angles(leg, m) for m in ([*leg.foot], [*leg.jacobian])))
    numeric = _of_angles("forward", *forward, leg.parameters) + _of_angles("jacobian", *jacobian, leg.parameters)
    loops = _angle_loops("forward", *forward) + _angle_loops("jacobian", *jacobian)
    try:
        inverse = program_of_feet(leg)
    except NoClosedFormError:
        closed = False
    else:
        closed = True
        numeric += _of_feet(*inverse, leg)
        loops += _foot_loops(*inverse)
    head = _HEAD.format(what="Kinematics", key=table.type_key)
    head += (
        "\nimport numpy\nfrom numpy import absolute, add, copyto, maximum, multiply, negative, power, subtract\n"
        f"\nfrom hexakin.numerics.trigonometry import PER_TURN, TURN, angle, sincos\n\nCLOSED_FORM = {closed}\n\n\n"
    )
    loops_head = _HEAD.format(what="Compiled loops", key=table.type_key)
    loops_head += (
        "\nimport numpy\n\n"
        "from hexakin.numerics.trigonometry_loops import angle, contracted, kernel, maximum, rounded, sincos\n"
        "from hexakin.numerics.trigonometry import PER_TURN, TURN\n\n\n"
    )
    return Sources((head + numeric).rstrip() + "\n", (loops_head + loops).rstrip() + "\n")
