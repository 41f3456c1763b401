"""Numeric code of a leg type, written from its symbolic kinematics for three machines.

One program of assignments is made of the sympy expressions, and printed three times:

- *scalar*: Python's floats, leg by leg, for one pose;
- *arrays*: NumPy, for blocks that fit the cache;
- *loops*: compiled by numba, for large batches.

In it every angle's sine and cosine are taken once, those of sums of angles follow by the addition theorems (which also
keeps large angles exact), what depends on the leg alone is taken out as a constant, and the inverse has no sine or cosine
left. ``python -m hexakin.symbolic`` writes the code of the shipped leg types into ``hexakin.generated``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from hexakin.exceptions import NoClosedFormError
from hexakin.robot import LegTable
from hexakin.robot_file import DATA, load_robot
from hexakin.symbolic import LegKinematics, derive

_Statement = tuple[sp.Symbol, sp.Expr]


@dataclass
class _Program:
    """Assignments that lead from inputs to results: ``constants`` of the leg alone, and the ``body`` with them."""

    fixed: frozenset[sp.Symbol]
    prefix: str
    constants: dict[sp.Expr, sp.Symbol] = field(default_factory=dict)
    body: list[_Statement] = field(default_factory=list)

    def constant(self, expression: sp.Expr) -> sp.Expr:
        """Return the symbol of an expression of the leg's own parameters."""
        if expression.is_Number:
            return expression
        name = sp.Symbol(f"{self.prefix}{len(self.constants)}", real=True)
        return self.constants.setdefault(expression, name)

    def lowered(self, expression: sp.Expr) -> sp.Expr:
        """Take constants out of an expression; squares become those of symbols, to be printed as products."""
        if expression.free_symbols <= self.fixed:
            return self.constant(expression)
        if expression.is_Atom:
            return expression
        if expression.is_Add or expression.is_Mul:
            own = [argument for argument in expression.args if argument.free_symbols <= self.fixed]
            rest = [self.lowered(argument) for argument in expression.args if argument not in own]
            if own:
                held = expression.func(*own)
                if held.could_extract_minus_sign() and not held.is_Number:
                    minus = [-1, self.constant(-held)]
                    rest[:0] = minus if expression.is_Mul else [sp.Mul(*minus, evaluate=False)]
                else:
                    rest.insert(0, self.constant(held))
            return expression.func(*rest, evaluate=False)
        if expression.is_Pow and expression.exp == 2 and not expression.base.is_Symbol:
            name = sp.Symbol(f"u{len(self.body)}", real=True)
            self.body.append((name, self.lowered(expression.base)))
            return name**2
        return expression.func(*(self.lowered(argument) for argument in expression.args), evaluate=False)

    def add(self, statements: Iterable[_Statement], results: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Append assignments and the common subexpressions of ``results``; return these in terms of them."""
        for name, value in statements:
            self.body.append((name, self.lowered(value)))
        shared, reduced = sp.cse(results, symbols=sp.numbered_symbols("t", real=True), order="canonical")
        known: dict[sp.Symbol, sp.Expr] = {}
        for name, value in shared:
            value = value.xreplace(known)
            if value.free_symbols <= self.fixed:
                known[name] = value
            else:
                self.body.append((name, self.lowered(value)))
        return [self.lowered(value.xreplace(known)) for value in reduced]


def _forward_program(leg: LegKinematics, results: Sequence[sp.Expr]) -> tuple[_Program, list[sp.Expr]]:
    """Program of expressions in sines and cosines of the joint angles, which it takes as s0, k0, s1 and so on."""
    pairs = {
        function(q): sp.Symbol(f"{letter}{i}", real=True)
        for i, q in enumerate(leg.joints)
        for function, letter in ((sp.sin, "s"), (sp.cos, "k"))
    }
    program = _Program(frozenset(leg.parameters), "c")
    statements, named = [], dict(pairs)
    found = set().union(*(result.atoms(sp.sin, sp.cos) for result in results))
    for call in sorted(found, key=lambda f: (len(f.args[0].args), sp.default_sort_key(f))):
        if call in pairs or not call.free_symbols & set(leg.joints):
            continue
        # Addition theorem.
        named[call] = sp.Symbol(f"{'s' if call.func == sp.sin else 'k'}_{len(statements)}", real=True)
        statements.append((named[call], sp.expand_trig(call).xreplace(pairs)))
    trigonometric = set(named.values())
    results = [_factored(sp.expand(result).xreplace(named), trigonometric) for result in results]
    return program, program.add(statements, results)


def _factored(expression: sp.Expr, symbols: set[sp.Symbol]) -> sp.Expr:
    """Take out of a sum, again and again, the symbol that the most of its terms have."""
    terms = sp.Add.make_args(expression)
    counts = {symbol: sum(term.has(symbol) for term in terms) for symbol in expression.free_symbols & symbols}
    best = max(counts, key=lambda symbol: (counts[symbol], str(symbol)), default=None)
    if best is None or counts[best] < 2:
        return expression
    inside = sp.Add(*(term / best for term in terms if term.has(best)))
    outside = sp.Add(*(term for term in terms if not term.has(best)))
    return best * _factored(inside, symbols) + _factored(outside, symbols)


class angle(sp.Function):  # noqa: N801
    """The angle of the vector (x, y) of known length: ``angle(y, x, length)``."""


def _inverse_program(leg: LegKinematics) -> tuple[_Program, list[sp.Expr]]:
    """Program of the inverse: angles, clearance, outer, inner, square of the distance."""
    inverse = leg.inverse
    program = _Program(frozenset({*leg.parameters, inverse.side, inverse.knee}), "c")
    place = (inverse.x, inverse.y, inverse.z)
    names = {symbol: sp.Symbol(name, real=True) for symbol, name in zip(place, "xyz", strict=True)}
    first, second, third = inverse.q
    scale = _exact_squares(inverse.outer + inverse.inner)
    results = [_one_angle(first, inverse.side), _one_angle(second, inverse.side)]
    # third = 2 knee atan2(...)
    (half,) = third.atoms(sp.atan2)
    results.append(third / half * angle(*half.args, sp.sqrt(scale)))
    results += [inverse.clearance, inverse.outer, inverse.inner, inverse.distance**2]
    return program, program.add([], [result.xreplace(names) for result in results])


def _one_angle(expression: sp.Expr, side: sp.Symbol) -> sp.Expr:
    """Write a difference of two vectors' angles as one angle, up to whole turns, without sine or cosine.

    For a foot within reach the two vectors are equally long: they are sides of a parallelogram's halves.
    """
    if not expression.is_Add:
        y, x = expression.args
        return angle(y, x, sp.sqrt((y**2 + x**2).subs(side**2, 1)))
    positive, negative = sorted(expression.args, key=lambda term: not isinstance(term, sp.atan2))
    y_1, x_1 = positive.args
    y_2, x_2, scale = _without_sines(*(-negative).args)
    length = scale * (y_1**2 + x_1**2).subs(side**2, 1)
    return angle(y_1 * x_2 - x_1 * y_2, x_1 * x_2 + y_1 * y_2, length)


def _without_sines(y: sp.Expr, x: sp.Expr) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """Return a vector whose sines and cosines are of twice an angle as a rational one, and by what it became longer."""
    calls = [call for call in (y + x).atoms(sp.sin, sp.cos) if call.has(sp.atan2)]
    if not calls:
        return y, x, sp.Integer(1)
    (half,) = calls[0].args[0].atoms(sp.atan2)
    knee = calls[0].args[0] / (2 * half)
    s, c, scale = sp.Dummy("s"), sp.Dummy("c"), sp.Dummy("scale")
    # knee^2 = 1. The vector is multiplied by the square of the half angle's length.
    double = {call: (2 * knee * s * c if call.func == sp.sin else c**2 - s**2) / scale for call in calls}
    squares = _exact_squares(half.args[0] ** 2 + half.args[1] ** 2)
    values = {scale: squares, s: half.args[0], c: half.args[1]}
    y, x = (sp.expand(part.xreplace(double) * scale, deep=False).xreplace(values) for part in (y, x))
    return y, x, squares


def _exact_squares(expression: sp.Expr) -> sp.Expr:
    """Sum of the room to both bounds of the reach, a constant of the leg: what one gains the other loses."""
    return sp.expand(expression.replace(sp.Max, lambda *args: next(argument for argument in args if argument != 0)))


# --- printing ----------------------------------------------------------------------------------------------


class _Printer(PythonCodePrinter):
    """Python with the names that a target has for its functions."""

    def __init__(self, names: dict[str, str]):
        super().__init__({"fully_qualified_modules": False})
        self.names = names

    def _call(self, expression: sp.Expr) -> str:
        name = self.names[expression.func.__name__]
        return f"{name}({', '.join(self._print(argument) for argument in expression.args)})"

    _print_sin = _print_cos = _print_atan2 = _print_sign = _print_Abs = _print_Max = _call

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
_ARRAYS = _Printer({"sqrt": "numpy.sqrt", "angle": "angle", "Max": "numpy.maximum", "Abs": "numpy.abs"})
_LOOPS = _Printer({"sqrt": "sqrt", "angle": "angle", "Max": "maximum", "Abs": "abs"})
_CONSTANTS = _Printer(
    {f: f"numpy.{f}" for f in ("sin", "cos", "sqrt", "sign")} | {"Max": "numpy.maximum", "Abs": "numpy.abs"}
)


def _assignments(statements: Iterable[_Statement], printer: _Printer) -> list[str]:
    return [f"{name} = {printer.doprint(value)}" for name, value in statements]


def _unpacked(names: Iterable[object], source: str) -> str:
    return f"({''.join(f'{name}, ' for name in names)}) = {source}"


def _function(head: str, summary: str, lines: Iterable[str], decorator: str = "") -> str:
    body = "\n".join("    " + line for line in lines)
    return f'{decorator}def {head}:\n    """{summary}"""\n{body}\n\n\n'


def _constants(program: _Program, name: str, parameters: Sequence[sp.Symbol], extra: str = "") -> str:
    values = ", ".join(_CONSTANTS.doprint(value) for value in program.constants)
    lines = [_unpacked(parameters, "p"), f"return [{values}]"]
    return _function(f"{name}_constants(p{extra})", "Constants of legs with parameters ``p`` (n, ...).", lines)


_PAIRS = "(s0, s1, s2), (k0, k1, k2)"


def _of_angles(name: str, program: _Program, results: list[sp.Expr], parameters: Sequence[sp.Symbol]) -> str:
    """Scalar and array code of a function of the joint angles."""
    names = program.constants.values()
    unpacked = ", ".join(f"{c}" for c in names) + ("," if len(program.constants) == 1 else "")
    inner = ["s0, k0, s1, k1, s2, k2 = sin(q0), cos(q0), sin(q1), cos(q1), sin(q2), cos(q2)"]
    inner += _assignments(program.body, _SCALAR)
    inner.append(f"result += ({', '.join(map(_SCALAR.doprint, results))})")
    scalar = ["result = []", f"for ({unpacked}), (q0, q1, q2) in zip(constants, angles):"]
    scalar += ["    " + line for line in inner]
    arrays = [_unpacked(names, "constants"), f"{_PAIRS} = sincos(angles)", *_assignments(program.body, _ARRAYS)]
    arrays.append(f"return {', '.join(map(_ARRAYS.doprint, results))}")
    return (
        _constants(program, name, parameters)
        + _function(f"{name}_scalar(constants, angles)", "All entries, leg by leg.", [*scalar, "return result"])
        + _function(f"{name}_arrays(constants, angles)", "Each entry for angles (3, ...).", arrays)
    )


_WRAPPED = "q{0} + TURN * {round}((middle{0} - q{0}) * PER_TURN)"
_BOUNDS = ["tolerance", *(f"{name}{k}" for name in ("middle", "low", "high") for k in range(3))]
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


def _of_feet(program: _Program, results: list[sp.Expr], leg: LegKinematics) -> str:
    """Scalar and array code of the inverse."""
    names = list(program.constants.values())
    solved = f"{_INVERSE_RESULTS} = " + ", ".join(map(_SCALAR.doprint, results))
    wrapped = "; ".join(f"q{k} = " + _WRAPPED.format(k, round="round") for k in range(3))
    inner = [*_assignments(program.body, _SCALAR), solved, *_INVERSE_SCALAR.format(wrapped=wrapped).split("\n")]
    scalar = ["angles, reachable, within, distance = [], [], [], []"]
    scalar.append(f"for ({', '.join(map(str, [*names, *_BOUNDS]))}), (x, y, z) in zip(constants, feet):")
    scalar += ["    " + line for line in inner]
    arrays = [_unpacked(names, "constants"), "x, y, z = feet", *_assignments(program.body, _ARRAYS)]
    arrays.append(f"return {', '.join(map(_ARRAYS.doprint, results))}")
    reach = [_unpacked(leg.parameters, "p"), f"return {', '.join(map(_CONSTANTS.doprint, leg.inverse.reach))}"]
    return (
        _constants(program, "inverse", leg.parameters, ", side, knee")
        + _function("reach(p)", "Inner and outer reach.", reach)
        + _function(
            "inverse_scalar(constants, feet)",
            "Angles, whether reachable and within the limits, and distance, leg by leg.",
            [*scalar, "return angles, reachable, within, distance"],
        )
        + _function("inverse_arrays(constants, feet)", f"{_INVERSE_RESULTS} for feet (3, ...).", arrays)
    )


def _angle_loops(name: str, program: _Program, results: list[sp.Expr]) -> str:
    width = len(results)
    names = program.constants.values()
    lines = [f"{c} = constants[{i}, m]" for i, c in enumerate(names)]
    lines += [f"s{k}, k{k} = sincos(angles[3 * m + {k}])" for k in range(3)] + _assignments(program.body, _LOOPS)
    lines += [f"result[{width} * m + {i}] = {_LOOPS.doprint(value)}" for i, value in enumerate(results)]
    block = ["for m in range(angles.shape[0] // 3):", *("    " + line for line in lines)]
    drive = f"""\
tile, worst = constants.shape[1], 0
scratch = numpy.empty(3 * tile)
for start in range(0, angles.shape[0] // 3, tile):
    part = angles[3 * start : 3 * (start + tile)]
    state = to_half_turn(part, scratch)
    worst = max(worst, state)
    _{name}(constants, part if state == 0 else scratch[: part.shape[0]], result[{width} * start : {width} * (start + tile)])
return worst"""
    return _function(f"_{name}(constants, angles, result)", "One block.", block, "@contracted\n") + _function(
        f"{name}(constants, angles, result)", "All blocks.", drive.split("\n"), '@kernel("2r", "1r", "1")\n'
    )


def _foot_loops(program: _Program, results: list[sp.Expr]) -> str:
    names = [*program.constants.values(), *_BOUNDS]
    lines = [f"{c} = constants[{i}, m]" for i, c in enumerate(names)]
    lines += [f"{axis} = feet[3 * m + {k}]" for k, axis in enumerate("xyz")] + _assignments(program.body, _LOOPS)
    lines += [f"{_INVERSE_RESULTS} = {', '.join(map(_LOOPS.doprint, results))}"]
    lines += [f"q{k} = " + _WRAPPED.format(k, round="rounded") for k in range(3)]
    lines += ["there = (clearance >= -tolerance) & (outer >= -tolerance) & (inner >= -tolerance)"]
    inside = " & ".join(f"(low{k} <= q{k}) & (q{k} <= high{k})" for k in range(3))
    lines += ["reachable[m] = there", f"within[m] = there & {inside}", "distance[m] = sqrt(square)"]
    lines += [f"angles[3 * m + {k}] = q{k} if there else nan" for k in range(3)]
    block = ["for m in range(feet.shape[0] // 3):", *("    " + line for line in lines)]
    drive = """\
tile = constants.shape[2]
for start in range(0, feet.shape[0] // 3, tile):
    stop = start + tile
    for b in range(constants.shape[0]):
        _inverse(constants[b], feet[3 * start : 3 * stop], angles[b, 3 * start : 3 * stop],
                 reachable[b, start:stop], within[b, start:stop], distance[b, start:stop])"""
    arguments = "(constants, feet, angles, reachable, within, distance)"
    return _function(f"_inverse{arguments}", "One block.", block, "@contracted\n") + _function(
        f"inverse{arguments}", "All blocks.", drive.split("\n"), '@kernel("3r", "1r", "2", "2b", "2b", "2")\n'
    )


_HEAD = '''"""{what} of the leg type {key!r}.

Generated by ``python -m hexakin.symbolic``; not to be edited.
"""
# ruff: noqa

from math import atan2, cos, nan, sin, sqrt

import numpy

'''


@dataclass(frozen=True)
class Sources:
    """Text of the two modules of a leg type: ``numeric`` needs NumPy alone, ``loops`` numba."""

    numeric: str
    loops: str


def generate(table: LegTable) -> Sources:
    """Write the numeric code of a leg type.

    ``numeric`` has ``CLOSED_FORM`` and, for each of forward, jacobian and (if there is a closed form) inverse, a function
    ``_constants``, ``_scalar`` and ``_arrays``; ``loops`` has a kernel for each.
    """
    leg = derive(table.canonical())
    forward, jacobian = ((p, [*r]) for p, r in (_forward_program(leg, m) for m in ([*leg.foot], [*leg.jacobian])))
    numeric = _of_angles("forward", *forward, leg.parameters) + _of_angles("jacobian", *jacobian, leg.parameters)
    loops = _angle_loops("forward", *forward) + _angle_loops("jacobian", *jacobian)
    try:
        inverse = _inverse_program(leg)
    except NoClosedFormError:
        closed = False
    else:
        closed = True
        numeric += _of_feet(*inverse, leg)
        loops += _foot_loops(*inverse)
    head = _HEAD.format(what="Kinematics", key=table.type_key)
    head += f"from hexakin.elementary import PER_TURN, TURN, angle, sincos\n\nCLOSED_FORM = {closed}\n\n\n"
    loops_head = _HEAD.format(what="Compiled loops", key=table.type_key)
    loops_head += (
        "from hexakin.compiled_elementary import angle, contracted, kernel, maximum, rounded, sincos, to_half_turn\n"
        "from hexakin.elementary import PER_TURN, TURN\n\n\n"
    )
    return Sources((head + numeric).rstrip() + "\n", (loops_head + loops).rstrip() + "\n")


def generated_files() -> dict[str, str]:
    """Return file name -> text of ``hexakin.generated`` for the leg types of all shipped robots."""
    files: dict[str, str] = {}
    modules: dict[str, str] = {}
    for path in sorted((DATA / "robots").glob("*.yaml")):
        table = load_robot(path).table
        if table.type_key not in modules:
            modules[table.type_key] = path.stem
            sources = generate(table)
            files[f"{path.stem}.py"], files[f"{path.stem}_loops.py"] = sources.numeric, sources.loops
    entries = "".join(f'    "{key}": "{module}",\n' for key, module in modules.items())
    files["__init__.py"] = (
        '"""Generated kinematics of the shipped leg types, each named after the first robot that has it."""\n\n'
        f"MODULES = {{\n{entries}}}\n"
    )
    return files


def write_generated_files() -> None:
    """Rewrite ``hexakin.generated``."""
    for name, text in generated_files().items():
        (Path(__file__).with_name("generated") / name).write_text(text, encoding="utf-8")
