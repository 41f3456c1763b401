"""What a leg type's numeric code has to compute: programs of assignments, made of the symbolic kinematics.

In them every joint's sine and cosine are taken once, those of sums of angles follow by the addition theorems (which
also keeps large angles exact), what depends on the leg alone is a constant, and the inverse has no sine or cosine left.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import sympy as sp

from hexakin.numerics.display import short_repr
from hexakin.symbolic.leg import LegKinematics

Statement = tuple[sp.Symbol, sp.Expr]


@dataclass
class Program:
    """Assignments that lead from inputs to results: ``constants`` of the leg alone, and the ``body`` with them."""

    fixed: frozenset[sp.Symbol]
    prefix: str
    constants: dict[sp.Expr, sp.Symbol] = field(default_factory=dict)
    body: list[Statement] = field(default_factory=list)

    __repr__ = short_repr

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
        if expression.is_Mul:
            expression = _one_root(expression, self.fixed)
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

    def add(self, statements: Iterable[Statement], results: Sequence[sp.Expr]) -> list[sp.Expr]:
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


def _one_root(product: sp.Expr, fixed: frozenset[sp.Symbol]) -> sp.Expr:
    """Write the roots in a product as the root of a product."""
    roots = [factor for factor in product.args if factor.is_Pow and factor.exp == sp.Rational(1, 2)]
    roots = [root for root in roots if not root.free_symbols <= fixed]
    if len(roots) < 2:
        return product
    inside = sp.Mul(*(root.base for root in roots), evaluate=False)
    rest = [factor for factor in product.args if factor not in roots]
    return sp.Mul(*rest, sp.Pow(inside, sp.Rational(1, 2), evaluate=False), evaluate=False)


def program_of_angles(leg: LegKinematics, results: Sequence[sp.Expr]) -> tuple[Program, list[sp.Expr]]:
    """Program of expressions in sines and cosines of the joint angles, which it takes as s0, k0, s1 and so on."""
    pairs = {
        function(q): sp.Symbol(f"{letter}{i}", real=True)
        for i, q in enumerate(leg.joints)
        for function, letter in ((sp.sin, "s"), (sp.cos, "k"))
    }
    program = Program(frozenset(leg.parameters), "c")
    statements: list[Statement] = []
    named = dict(pairs)
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


class angle(sp.Function):
    """The angle of the vector (x, y) of known length: ``angle(y, x, length)``."""


def program_of_feet(leg: LegKinematics) -> tuple[Program, list[sp.Expr]]:
    """Program of the inverse: angles, clearance, outer, inner, square of the distance."""
    inverse = leg.inverse
    program = Program(frozenset({*leg.parameters, inverse.side, inverse.knee}), "c")
    place = (inverse.x, inverse.y, inverse.z)
    names = {symbol: sp.Symbol(name, real=True) for symbol, name in zip(place, "xyz", strict=True)}
    first, second, third = inverse.q
    scale = _exact_squares(inverse.outer + inverse.inner)
    results = [_one_angle(first, inverse.side), _one_angle(second, inverse.side)]
    # third = 2 knee atan2(y, x), as the angle of the vector's square: one root of a product instead of two.
    (half,) = third.atoms(sp.atan2)
    y, x = half.args
    results.append(third / (2 * half) * angle(2 * y * x, x**2 - y**2, scale))
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
