"""Symbolic kinematics of a leg, derived by sympy from its Denavit-Hartenberg table.

``derive`` gives the expressions; ``hexakin.symbolic.generate`` turns them into numeric code. That of the shipped leg
types lies in ``hexakin.generated``, rewritten by ``python -m hexakin.symbolic``; a leg type that is not there is
derived when it is first used. Only the package ``hexakin.symbolic`` imports sympy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp
from sympy.core.function import Application
from sympy.printing.pycode import PythonCodePrinter

from hexakin.checks import check_number, check_whole, checked
from hexakin.exceptions import InvalidInputError, NoClosedFormError, UnknownNameError
from hexakin.numerics.display import short_repr
from hexakin.robot.leg_table import NUM_JOINTS, LegTable, pi_multiple


@checked
@dataclass(frozen=True)
class InverseExpressions:
    """The closed-form inverse of a leg, for a foot at (``x``, ``y``, ``z``) [m] in the body frame (A(14)-(18)).

    ``q`` are the three angles [rad] for the signs ``side`` (+1: the leg's plane faces the foot; -1: it is turned by
    half a turn) and ``knee``. A branch exists where ``clearance``, ``outer`` and ``inner`` [m^2] are not negative: the
    foot is far enough from the first axis for the leg's offset, not beyond the stretched leg, and not within the
    folded leg. ``distance`` [m] is from the second joint to the foot; ``reach`` (inner, outer) [m] are its bounds.
    """

    x: sp.Symbol
    y: sp.Symbol
    z: sp.Symbol
    side: sp.Symbol
    knee: sp.Symbol
    q: tuple[sp.Expr, sp.Expr, sp.Expr]
    clearance: sp.Expr
    outer: sp.Expr
    inner: sp.Expr
    distance: sp.Expr
    reach: tuple[sp.Expr, sp.Expr]

    __repr__ = short_repr


@checked
@dataclass(frozen=True)
class LegKinematics:
    """Symbolic kinematics of one leg type; every property is derived from ``table`` alone."""

    table: LegTable

    __repr__ = short_repr

    @checked
    def symbol(self, name: str) -> sp.Symbol:
        """Return the real symbol of the joint or parameter ``name`` of the table."""
        return sp.Symbol(name, real=True)

    @property
    def joints(self) -> tuple[sp.Symbol, ...]:
        """The three joint symbols."""
        return tuple(self.symbol(name) for name in self.table.joints)

    @property
    def parameters(self) -> tuple[sp.Symbol, ...]:
        """The symbols of the table's lengths and fixed angles."""
        return tuple(self.symbol(name) for name in self.table.parameters)

    def _value(self, entry: str | int) -> sp.Expr:
        exact = pi_multiple(entry)
        return self.symbol(str(entry)) if exact is None else sp.Rational(exact.numerator, exact.denominator) * sp.pi

    def _chain(self, motions: tuple[tuple[str, str | int], ...]) -> sp.Matrix:
        """Multiply elementary motions into a 4 x 4 matrix.

        Rotations about the same axis that follow each other are added before they are expanded, so
        that parallel joints give sums of angles at once and nothing needs to be simplified.
        """
        word: list[tuple[str, sp.Expr]] = []
        position = sp.zeros(3, 1)
        for motion, entry in motions:
            kind, axis, value = motion[0], motion[1], self._value(entry)
            if kind == "r" and word and word[-1][0] == axis:
                word[-1] = (axis, word[-1][1] + value)
            elif kind == "r":
                word.append((axis, value))
            else:
                position += _rotation(word)[:, "xyz".index(axis)] * value
        return sp.Matrix(sp.BlockMatrix([[_rotation(word), position], [sp.zeros(1, 3), sp.ones(1, 1)]]))

    @checked
    def transform(self, start: int, stop: int) -> sp.Matrix:
        """Transformation from frame ``start`` to frame ``stop`` of the table, such as T_01 for (0, 1).

        Raises InvalidInputError for a frame that the table does not have, and if ``stop`` is before ``start``.
        """
        check_whole("start", start, at_most=len(self.table.rows))
        check_whole("stop", stop, at_least=start, at_most=len(self.table.rows))
        rows = LegTable(self.table.convention, self.table.rows[start:stop], ())
        return self._chain(rows.motions)

    @cached_property
    def forward(self) -> sp.Matrix:
        """The foot's pose in the body frame, 4 x 4 (A(11))."""
        return self._chain(self.table.motions)

    @cached_property
    def foot(self) -> sp.Matrix:
        """The foot's position in the body frame, 3 x 1 (A(12))."""
        return self.forward[:3, 3]

    @cached_property
    def jacobian(self) -> sp.Matrix:
        """Derivative of the foot's position by the joint angles, 3 x 3."""
        return self.foot.jacobian(self.joints)

    @checked
    def carried(self, joint: int, point: Sequence[sp.Expr | float]) -> sp.Matrix:
        """Position (3 x 1) in the body frame of a point that turns with joint ``joint`` (0 to 2).

        ``point`` (3) is given in the joint's own frame, whose z is the joint's axis. Raises InvalidInputError for
        another joint or number of coordinates.
        """
        check_whole("joint", joint, at_most=len(self.table.joints) - 1)
        if len(point) != 3:
            raise InvalidInputError(f"point: expected 3 coordinates, got {len(point)}")
        for coordinate in point:
            if not isinstance(coordinate, sp.Expr):
                check_number("point", coordinate)
        return (self._chain(self._motions_to(joint + 1)) * sp.Matrix([*point, 1]))[:3, 0]

    @cached_property
    def joint_positions(self) -> tuple[sp.Matrix, ...]:
        """Position (3 x 1) of each joint in the body frame; the third is the knee."""
        return tuple(self.carried(joint, (0, 0, 0)) for joint in range(NUM_JOINTS))

    @cached_property
    def joint_axes(self) -> sp.Matrix:
        """Unit vectors along the joints' axes in the body frame, as columns, 3 x 3: the foot's angular Jacobian."""
        return sp.Matrix.hstack(*(self._chain(self._motions_to(k + 1))[:3, 2] for k in range(NUM_JOINTS)))

    def _motions_to(self, count: int) -> tuple[tuple[str, str | int], ...]:
        """The table's motions up to and with the joint of number ``count``."""
        last = [entry for _, entry in self.table.motions].index(self.table.joints[count - 1])
        return self.table.motions[: last + 1]

    @cached_property
    def inverse(self) -> InverseExpressions:
        """The closed-form inverse with its four branches (A(14)-(18), corrected).

        Paul's method: the foot is moved into the frame of the first joint and turned back by it. The
        component without the other angles gives the first angle; the two others are a planar
        two-link arm. Holds for legs whose second and third axes are parallel to each other and at a
        right angle to the first; raises NoClosedFormError for another table.
        """
        # A table may use these names for its own lengths.
        taken = {*self.table.joints, *self.table.parameters}
        x, y, z, side, knee = (
            (sp.Dummy if name in taken else sp.Symbol)(name, real=True) for name in ("x", "y", "z", "side", "knee")
        )
        _, q2, q3 = self.joints
        split = [entry for _, entry in self.table.motions].index(self.table.joints[0])
        base, rest = self._chain(self.table.motions[:split]), self._chain(self.table.motions[split + 1 :])[:3, 3]
        # A(15): the foot in frame Q, at the first joint.
        u, v, w = base[:3, :3].T * (sp.Matrix([x, y, z]) - base[:3, 3])

        offset, radial, height = rest[1], _planar_terms(rest[0], q2, q3), _planar_terms(rest[2], q2, q3)
        if offset.has(q2, q3) or radial is None or height is None:
            raise NoClosedFormError(f"no closed-form inverse is known for the leg table {self.table.rows}")
        upper, lower = radial.cosine
        mirror = sp.simplify(height.sine[0] / upper)
        planar = radial.sine == (0, 0) and height.cosine == (0, 0) and mirror in (1, -1)
        if not planar or sp.simplify(height.sine[1] - mirror * lower) != 0:
            raise NoClosedFormError(f"no closed-form inverse is known for the leg table {self.table.rows}")

        clearance = u**2 + v**2 - offset**2
        if offset == 0:
            angle_1 = sp.atan2(side * v, side * u)
            along = side * sp.sqrt(clearance) - radial.constant
        else:
            along = side * sp.sqrt(sp.Max(clearance, 0))
            angle_1 = sp.atan2(v, u) - sp.atan2(offset, along)
            along -= radial.constant
        up = mirror * (w - height.constant)
        square = (along**2 + up**2).subs(side**2, 1)
        # The half-angle form of the law of cosines keeps its accuracy for a stretched or folded leg.
        # Lengths of opposite sign swap its two bounds.
        turn = sp.sign(upper * lower)
        outer, inner = turn * ((upper + lower) ** 2 - square), turn * (square - (upper - lower) ** 2)
        angle_3 = 2 * knee * sp.atan2(sp.sqrt(sp.Max(outer, 0)), sp.sqrt(sp.Max(inner, 0)))
        angle_2 = sp.atan2(up, along) - sp.atan2(lower * sp.sin(angle_3), upper + lower * sp.cos(angle_3))
        reach = (sp.Abs(sp.Abs(upper) - sp.Abs(lower)), sp.Abs(upper) + sp.Abs(lower))
        return InverseExpressions(
            x, y, z, side, knee, (angle_1, angle_2, angle_3), clearance, outer, inner, sp.sqrt(square), reach
        )  # fmt: skip


@checked
def derive(table: LegTable) -> LegKinematics:
    """Return the symbolic kinematics of the leg ``table``, with the table's own names as symbols."""
    return LegKinematics(table)


@checked
def with_functions(
    arguments: Sequence[sp.Symbol], expressions: Sequence[sp.Expr], functions: Mapping[str, Callable[..., Any]]
) -> Callable[..., list[Any]]:
    """Return a function of ``arguments`` that computes ``expressions`` with the functions of another package.

    ``functions`` maps the names of sympy's functions, such as ``"sin"``, to those of the package. With CasADi's, for
    example, the result takes and returns CasADi's symbols. Common subexpressions are computed once. Raises
    UnknownNameError for a function in ``expressions`` that ``functions`` lacks.
    """
    for called in sorted({str(call.func) for expression in expressions for call in expression.atoms(Application)}):
        if called not in functions:
            raise UnknownNameError("function", called, sorted(functions))
    return sp.lambdify(
        arguments,
        list(expressions),
        modules=[dict(functions)],
        printer=_CallPrinter({"fully_qualified_modules": False}),
        cse=True,
    )


class _CallPrinter(PythonCodePrinter):
    """Every function as a call by its own name; sympy spells some of them out, with comparisons."""

    def _call(self, expression: sp.Expr) -> str:
        return f"{expression.func.__name__}({', '.join(self._print(argument) for argument in expression.args)})"

    _print_sin = _print_cos = _print_atan2 = _print_sign = _print_Abs = _print_Max = _call


def _rotation(word: list[tuple[str, sp.Expr]]) -> sp.Matrix:
    rotation = sp.eye(3)
    for axis, angle in word:
        c, s = sp.cos(angle), sp.sin(angle)
        turn = [[1, 0, 0], [0, c, -s], [0, s, c]] if axis == "x" else [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        rotation = rotation * sp.Matrix(turn)
    return rotation


@dataclass(frozen=True)
class _PlanarTerms:
    constant: sp.Expr
    cosine: tuple[sp.Expr, sp.Expr]
    sine: tuple[sp.Expr, sp.Expr]


def _planar_terms(expression: sp.Expr, q2: sp.Symbol, q3: sp.Symbol) -> _PlanarTerms | None:
    """Coefficients of 1, cos and sin of q2 and of q2 + q3, or None if the expression has anything else."""
    expression = sp.expand(expression)
    bases = [sp.cos(q2), sp.cos(q2 + q3), sp.sin(q2), sp.sin(q2 + q3)]
    c2, c23, s2, s23 = (expression.coeff(base) for base in bases)
    constant = sp.expand(expression - sum(k * base for k, base in zip((c2, c23, s2, s23), bases, strict=True)))
    if any(term.has(q2, q3) for term in (c2, c23, s2, s23, constant)):
        return None
    return _PlanarTerms(constant, (c2, c23), (s2, s23))
