"""NumPy code of a program of assignments, one call for each operation, into rows of a workspace.

An array that is made for every intermediate value costs more than the arithmetic that fills it: the system is asked for
its pages, and the cache loses what it held. A row is used again as soon as its value is not needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import sympy as sp

from hexakin.numerics.display import short_repr
from hexakin.symbolic.program import Statement, angle

ANGLE_ROWS = 3
"""Rows that ``hexakin.numerics.trigonometry.angle`` works on, beside its result's."""

_FUNCTIONS = {"Max": "maximum", "Abs": "absolute"}


@dataclass(frozen=True)
class _Call:
    """``function`` of ``operands``, named ``target``."""

    target: str
    function: str
    operands: tuple[str, ...]


@dataclass
class _Flat:
    """Expressions taken apart into calls; ``names`` are those of the values of symbols."""

    calls: list[_Call] = field(default_factory=list)
    names: dict[str, str] = field(default_factory=dict)

    def call(self, function: str, *operands: str) -> str:
        name = f"value {len(self.calls)}"
        self.calls.append(_Call(name, function, operands))
        return name

    def value(self, expression: sp.Expr) -> str:
        """Take ``expression`` apart and return the name of its value."""
        if expression.is_Symbol:
            return self.names.get(expression.name, expression.name)
        if expression.is_Number:
            return repr(float(expression))
        if expression.is_Add:
            return self._sum(expression)
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            return self._power(expression)
        function = "angle" if isinstance(expression, angle) else _FUNCTIONS[expression.func.__name__]
        return self.call(function, *map(self.value, expression.args))

    def _sum(self, expression: sp.Expr) -> str:
        # What is taken off comes last: to negate an array costs as much as to add it.
        terms = sorted(expression.args, key=lambda term: (_is_minus(term), sp.default_sort_key(term)))
        first, *rest = terms
        total = self.value(first)
        for term in rest:
            minus = _is_minus(term)
            total = self.call("subtract" if minus else "add", total, self.value(-term if minus else term))
        return total

    def _product(self, expression: sp.Expr) -> str:
        factor, (first, *rest) = expression.as_coeff_mul()
        total = self.value(first)
        for part in rest:
            total = self.call("multiply", total, self.value(part))
        if factor == 1:
            return total
        return self.call("negative", total) if factor == -1 else self.call("multiply", total, repr(float(factor)))

    def _power(self, expression: sp.Expr) -> str:
        base = self.value(expression.base)
        if expression.exp == sp.Rational(1, 2):
            return self.call("numpy.sqrt", base)
        if expression.exp == 2:
            return self.call("multiply", base, base)
        return self.call("power", base, repr(float(expression.exp)))


def _is_minus(term: sp.Expr) -> bool:
    return term.as_coeff_mul()[0].is_negative


@dataclass
class _Rows:
    """Which row of the workspace holds which value."""

    free: list[str]
    used: int
    of: dict[str, str]

    def take(self) -> str:
        if not self.free:
            self.free.append(f"w{self.used}")
            self.used += 1
        return self.free.pop()

    def release(self, value: str) -> None:
        row = self.of.pop(value, None)
        if row is not None:
            self.free.append(row)


@dataclass(frozen=True)
class ArrayCode:
    """Lines of code that use ``rows`` rows w0, w1, ... of a workspace; ``values`` are where the results then are."""

    lines: list[str]
    rows: int
    values: list[str]

    __repr__ = short_repr


def array_code(
    body: Iterable[Statement],
    results: Sequence[sp.Expr],
    used_up: Sequence[str] = (),
    spare: int = 0,
    into: Sequence[str] = (),
) -> ArrayCode:
    """Write the calls for ``body`` and ``results``.

    The inputs ``used_up`` are rows too, free once they have been used for the last time; the first ``spare`` of the
    rows w0, w1, ... are there anyway. The results go ``into`` the arrays of these names, or else stay in the rows that
    ``values`` tells.
    """
    flat = _Flat()
    for name, expression in body:
        flat.names[name.name] = flat.value(expression)
    ends = [flat.value(expression) for expression in results]
    last_use = {operand: i for i, call in enumerate(flat.calls) for operand in call.operands}
    # A result that nothing else needs is written to its place at once.
    places = {
        end: place for end, place in zip(ends, into, strict=False) if end not in last_use and ends.count(end) == 1
    }
    rows = _Rows([f"w{i}" for i in reversed(range(spare))], spare, {name: name for name in used_up})
    lines = list[str]()
    for i, call in enumerate(flat.calls):
        operands = [rows.of.get(name, name) for name in call.operands]
        done = [name for name in dict.fromkeys(call.operands) if last_use[name] == i and name not in ends]
        scratch = []
        if call.function == "angle":  # it reads its operands to the last
            row, *scratch = [rows.take() for _ in range(1 + ANGLE_ROWS)]
            rows.free += scratch
        for name in done:
            rows.release(name)
        if call.function != "angle":
            row = places.get(call.target) or rows.take()
        out = f"out={row}" if call.function == "maximum" else row  # which takes it by name only
        lines.append(f"{call.function}({', '.join([*operands, out, *scratch])})")
        rows.of[call.target] = row
    values = [rows.of.get(name, name) for name in ends]
    lines += [f"copyto({place}, {value})" for place, value in zip(into, values, strict=False) if value != place]
    return ArrayCode(lines, rows.used, values)
