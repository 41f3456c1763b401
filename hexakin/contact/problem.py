"""The contact problem of one time step or impact: its data, its solution and the residuals (A section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexakin.checks import Array, check_array, check_number, check_shape, check_whole, checked, read_only
from hexakin.contact.impulses import (
    FAILED,
    HOLDS,
    Accuracy,
    Impact,
    Servos,
    System,
    give_hint,
    impact_memory,
    solve_impact,
    system_memory,
)
from hexakin.contact.mass import Mass
from hexakin.exceptions import ContactError, InvalidInputError, shown
from hexakin.numerics.display import short_repr
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.numerics.numba_cache import announced

_MOST_FACETS = 256  # the cone then differs by 1e-4; more take long, and the exact cone is solved faster


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """Find v, p and s in M v = r + J^T p + S^T s (A(4), with A-E5 and A-E7 corrected).

    v is the generalised velocity after the step, p are the contact impulses and s the servo impulses. A single number
    may be given instead of an array for all contacts or for all servos. Raises InvalidInputError, which names the
    field, for wrong shapes and values.

    Parameters
    ----------
    mass
        Mass matrix M (nv, nv) [kg, kg m, kg m^2], symmetric and positive definite.
    momentum
        Momentum r (nv,) [N s, N m s] after all known forces f in the time step h: M v_before + h f.
    jacobian
        Jacobian J (n, 3, nv) [1, m]: for each of n contacts the rows of two tangents and the normal.
    friction
        Friction coefficients (n,), numbers without unit.
    gap_rate
        Velocities (n,) [m/s] that are added to the normal velocities; with gap / h a contact can close its gap within
        the time step h.
    approach
        Normal velocities (n,) [m/s] before the step, for restitution; contacts that separate (>= 0) do not bounce.
    servo
        Indices (m,) of the coordinates that have a servo.
    servo_velocity
        Velocities (m,) [rad/s] that the servos try to reach.
    servo_limit
        Largest impulses (m,) [N m s] of the servos.
    """

    mass: Array
    momentum: Array
    jacobian: Array
    friction: ArrayLike = 0.9
    gap_rate: ArrayLike = 0.0
    approach: ArrayLike = 0.0
    servo: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    servo_velocity: ArrayLike = 0.0
    servo_limit: ArrayLike = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        momentum = check_shape("momentum", self.momentum, (None,))
        nv = len(momentum)
        mass = check_shape("mass", self.mass, (nv, nv))
        jacobian = check_shape("jacobian", self.jacobian, (None, 3, nv))
        if np.abs(mass - mass.T).max(initial=0.0) > 1e-9 * np.abs(mass).max(initial=1e-300):
            raise InvalidInputError("mass: not symmetric")
        try:
            np.linalg.cholesky(mass)
        except np.linalg.LinAlgError as error:
            raise InvalidInputError("mass: not positive definite") from error
        check_shape("servo", self.servo, (None,))
        servo = np.asarray(self.servo)
        if len(servo) and not np.issubdtype(servo.dtype, np.integer):
            raise InvalidInputError(f"servo: expected coordinate numbers (m,), got {shown(self.servo)}")
        if len(servo) and (servo.min() < 0 or servo.max() >= nv or len(set(servo.tolist())) < len(servo)):
            raise InvalidInputError(f"servo: expected different coordinates from 0 to {nv - 1}, got {servo.tolist()}")
        values = {"mass": mass, "momentum": momentum, "jacobian": jacobian}
        for name, count in (("friction", len(jacobian)), ("gap_rate", len(jacobian)), ("approach", len(jacobian)),
                            ("servo_velocity", len(servo)), ("servo_limit", len(servo))):  # fmt: skip
            value = check_array(name, getattr(self, name), ())
            if value.shape not in ((), (count,)):
                raise InvalidInputError(f"{name}: expected a number or shape ({count},), got {value.shape}")
            values[name] = np.broadcast_to(value, (count,))
            if name in ("friction", "servo_limit") and (values[name] < 0.0).any():
                raise InvalidInputError(f"{name}: {values[name].min():g}, expected at least 0")
        for name, value in values.items():
            object.__setattr__(self, name, read_only(value))
        object.__setattr__(self, "servo", servo.astype(np.int64))

    @property
    def delassus(self) -> Array:
        """Delassus matrix J M^-1 J^T (3 n, 3 n) [1/kg] of the contacts."""
        J = self.jacobian.reshape(-1, len(self.momentum))
        return J @ np.linalg.solve(self.mass, J.T)


class Residuals(NamedTuple):
    """Errors of a solution of Coulomb's law, relative to the largest impulse and the fastest free contact velocity.

    ``gap``: normal velocity into the ground. ``complementarity``: normal impulse times separating velocity. ``cone``:
    friction beyond its bound. ``dissipation``: difference from the largest power that friction can dissipate.
    ``solver``: the natural residual, which bounds all others and decides whether the problem is solved; for an impact
    with two phases it is the larger of both residuals.
    """

    gap: float
    complementarity: float
    cone: float
    dissipation: float
    solver: float


class ContactSolution(NamedTuple):
    """Impulses and velocities after the step.

    ``impulse`` (n, 3) [N s] is along the two tangents and the normal; ``compression`` (n, 3) [N s] is its part before
    Poisson's expansion (the whole impulse if there is no expansion). ``servo_impulse`` (m,) [N m s] are the servos'
    impulses, ``velocity`` (nv,) [m/s, rad/s] the generalised velocity, ``contact_velocity`` (n, 3) [m/s] the velocities
    of the contacts. ``residuals`` are the errors, ``iterations`` the number of sweeps or pivots.
    """

    impulse: Array
    compression: Array
    servo_impulse: Array
    velocity: Array
    contact_velocity: Array
    residuals: Residuals
    iterations: int

    def __repr__(self) -> str:
        return short_repr(self)


def check_facets(facets: int | None) -> int | None:
    """Return ``facets`` if it is None (the exact cone) or even and from 4 to 256; otherwise raise InvalidInputError."""
    if facets is None:
        return None
    if check_whole("facets", facets, at_least=4, at_most=_MOST_FACETS) % 2:
        raise InvalidInputError(f"facets: {facets}, expected an even number, so that every direction has its opposite")
    return int(facets)


@checked
@interrupts_kept()
def solve(
    problem: ContactProblem,
    *,
    facets: int | None = None,
    restitution: float = 0.0,
    law: Literal["poisson", "newton"] = "poisson",
    compliance: float = 0.0,
    tolerance: float = 1e-9,
    max_iterations: int = 5000,
) -> ContactSolution:
    """Solve ``problem`` with the exact friction cone, or with paper A's polyhedron of ``facets`` (A(7)-(10)).

    The polyhedron is inscribed in the cone; its first generator lies along each contact's first tangent.
    ``restitution`` is the coefficient for contacts with ``approach`` < 0, by Poisson's or Newton's ``law`` ("poisson"
    or "newton"). With ``compliance`` > 0, a number without unit, redundant contacts share loads evenly, but the
    residual is then of the order of ``compliance``. The solver stops at the relative residual ``tolerance``, or after
    ``max_iterations`` sweeps or pivots.

    Raises ContactError if the natural residual stays above ``tolerance``, UnknownNameError for an unknown ``law``, and
    InvalidInputError for a number outside its range.
    """
    sides = check_facets(facets)
    check_number("restitution", restitution, at_least=0.0, at_most=1.0)
    check_number("compliance", compliance, at_least=0.0)
    check_number("tolerance", tolerance, above=0.0)
    check_whole("max_iterations", max_iterations, at_least=1)
    accuracy = Accuracy(float(compliance), float(tolerance), max_iterations)
    options = (float(restitution), law == "poisson")
    with announced("the contact solvers"):
        system, servos, impact, v, residual, iterations = _solved(problem, options, accuracy, sides)
    if not residual <= tolerance:
        raise ContactError(residual, tolerance, iterations)
    n, nv = len(problem.jacobian), len(problem.momentum)
    p, u, compression = (a[: 3 * n].reshape(n, 3) for a in (system.p, system.u, impact.compression))
    friction, struck, J = np.array(problem.friction), impact.strikes == 1, problem.jacobian.reshape(3 * n, nv)
    expanded = law == "poisson" and restitution > 0.0
    least = restitution * compression[:, 2] * struck if expanded else np.zeros(n)
    last = p - compression if expanded and struck.any() else p
    free = J @ np.linalg.solve(problem.mass, problem.momentum)
    residuals = _residuals(last, u, friction, least, free, sides, residual)
    return ContactSolution(p, compression, servos.impulse, v, (J @ v).reshape(n, 3), residuals, iterations)


def _solved(
    problem: ContactProblem,
    restitution: tuple[float, bool],
    accuracy: Accuracy,
    facets: int | None,
) -> tuple[System, Servos, Impact, Array, float, int]:
    """Return what ``solve_impact`` has worked on, the velocity (nv,), the residual and the number of iterations.

    ``restitution`` is the coefficient, and whether it follows Poisson's law.
    """
    n, m, nv = len(problem.jacobian), len(problem.servo), len(problem.momentum)
    nobody = np.zeros(0, dtype=np.int64)
    # All coordinates are one leg without a body.
    mass = Mass(
        nobody, np.arange(nv), np.array([-1]), np.array([0, nv]), np.zeros((0, 10)),
        np.zeros((nv, 6)), problem.mass.copy(),
    )  # fmt: skip
    system, impact = system_memory(mass, n, m), impact_memory(n, m)
    system.rows.sides[:] = 1
    system.rows.leg[: 3 * n, 0] = 0
    system.rows.on_leg[: 3 * n, 0] = problem.jacobian.reshape(3 * n, nv)
    system.cone.mu[:] = problem.friction
    impact.approach[:] = problem.approach
    impact.strikes[:] = impact.approach < 0.0
    limit = np.array(problem.servo_limit)
    state = np.zeros(m, dtype=np.int64)
    servos = Servos(problem.servo.copy(), np.array(problem.servo_velocity), -limit, limit, state, np.zeros(m))
    v, iterations = np.zeros(nv), 0
    while True:
        system.bias[:], servos.state[:], system.p[:] = problem.gap_rate, HOLDS, 0.0
        residual, used = solve_impact(
            system, servos, n, impact, *restitution, problem.momentum.copy(), v, accuracy, facets
        )  # fmt: skip
        iterations += used
        if not system.hints.state[FAILED]:
            return system, servos, impact, v, residual, iterations
        give_hint(system, accuracy)


def _residuals(
    p: Array, u: Array, mu: Array, least: Array, free: Array, facets: int | None, solver: float
) -> Residuals:
    impulse, speed = np.abs(p).max(initial=1e-300), max(np.abs(free).max(initial=0.0), 1e-300)
    if facets:
        angles = 2.0 * np.pi * np.arange(facets) / facets
        normals = np.stack([np.cos(angles + np.pi / facets), np.sin(angles + np.pi / facets)])
        generators = np.stack([np.cos(angles), np.sin(angles)])
        beyond = (p[:, :2] @ normals).max(axis=1) - np.cos(np.pi / facets) * mu * p[:, 2]
        slip = (-u[:, :2] @ generators).max(axis=1)
    else:
        beyond = np.linalg.norm(p[:, :2], axis=1) - mu * p[:, 2]
        slip = np.linalg.norm(u[:, :2], axis=1)
    missing = (mu * p[:, 2] * slip + (p[:, :2] * u[:, :2]).sum(axis=1)) / impulse / speed
    return Residuals(
        gap=float(max(0.0, (-u[:, 2]).max(initial=0.0)) / speed),
        complementarity=float(np.abs((p[:, 2] - least) / impulse * u[:, 2] / speed).max(initial=0.0)),
        cone=float(max(0.0, beyond.max(initial=0.0)) / impulse),
        dissipation=float(np.abs(missing).max(initial=0.0)),
        solver=float(solver),
    )
