"""Velocities and impulses of one time step in generalised coordinates, including servos with limited torque.

M v = r + J^T p + S^T s: mass matrix M, momentum r after all known forces, contact impulses p in cones and servo
impulses s in boxes. A servo holds its target velocity while its impulse is inside the box; otherwise its impulse is at
the limit. This is Coulomb friction relative to a moving target. Joints that hold are eliminated exactly, so that for a
standing robot only the body's six coordinates remain. An active-set iteration around the contact solver finds which
servos hold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.contact.cone import ConeMemory, ConeProblem, cone_memory, solve_cone
from hexakin.contact.last_resorts import soften, solve_hard_cone
from hexakin.contact.lcp import solve_polyhedron
from hexakin.contact.mass import (
    Factor,
    Mass,
    Rows,
    add_impulse,
    factor_memory,
    factorise,
    load,
    multiply,
    project,
    row_memory,
    row_speed,
    velocities,
)
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole, inlined, no_new_arrays, part

HOLDS, AT_LOW, AT_HIGH = 0, -1, 1
CALLS, STRICT, FAILED, CONTACTS, SERVOS = range(5)  # in Hints.state
ROUNDING = 1e-9  # relative residual that rounding errors may cause with redundant contacts
_TOGETHER = 8  # rounds in which all servos change their states that do not fit; this can repeat itself for ever ...
_ROUNDS = 60  # ... so that afterwards one servo changes in each round, up to this number of rounds
_HINTS = _ROUNDS + 3  # one for each problem of a step: the rounds, two phases of an impact, all together


class Servos(NamedTuple):
    """Servos on the joints ``joint`` (m,) of a ``Mass``, with their targets, limits, states and impulses.

    ``target`` (m,) [rad/s] are the velocities that they hold with impulses from ``low`` to ``high`` (m,) [N m s].
    ``state`` (m,) is HOLDS, AT_LOW or AT_HIGH; ``impulse`` (m,) [N m s] receives the impulses.
    """

    joint: Whole
    target: Array
    low: Array
    high: Array
    state: Whole
    impulse: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Accuracy(NamedTuple):
    """How exactly contact problems are solved.

    ``compliance``, as a fraction of the mean of G's diagonal, is added to this diagonal; of the many ways in which
    redundant contacts can share a load it selects the most even one. ``tolerance`` is the relative residual at which
    the contact solver stops, ``max_sweeps`` its largest number of sweeps or pivots.
    """

    compliance: float
    tolerance: float
    max_sweeps: int


class Hints(NamedTuple):
    """First guesses for contact problems that ``solve_cone`` does not solve without them.

    Parameters
    ----------
    p
        Impulses (k, rows).
    call
        Which contact problem of a step each guess is for, (k,): 1 for the first; 0 for none.
    state
        Integers (5,). CALLS: number of contact problems so far. STRICT: whether to stop at one that is not solved.
        FAILED: its number, 0 for none; CONTACTS and SERVOS: its size.
    """

    p: Array
    call: Whole
    state: Whole

    def __repr__(self) -> str:
        return short_repr(self)


class System(NamedTuple):
    """Bodies, the contacts that act on them, and the memory to solve for their impulses.

    ``rows`` are the rows of the Jacobian: three for each contact, along t1, t2 and n. ``bias`` (n,) [m/s] is added to
    the contacts' normal velocities. ``p`` (3 n + m,) [N s] are the impulses, at first a guess, and ``u`` (3 n + m,)
    [m/s] the velocities along the rows. ``cone.mu`` and ``cone.p_min`` belong to the problem, too. ``known`` and
    ``total`` (nv,) are memory for momenta.
    """

    mass: Mass
    factor: Factor
    rows: Rows
    cone: ConeProblem
    memory: ConeMemory
    hints: Hints
    bias: Array
    p: Array
    u: Array
    known: Array
    total: Array

    def __repr__(self) -> str:
        return short_repr(self)


def system_memory(mass: Mass, contacts: int, servos: int) -> System:
    """Return a System for up to a number of ``contacts`` and of ``servos``, filled with zeros."""
    size, nv = 3 * contacts + servos, 6 * len(mass.base_v) + len(mass.joint_v)
    cone = ConeProblem(
        np.zeros((size, size)), *(np.zeros(k) for k in (size, contacts, contacts, servos, servos))
    )  # fmt: skip
    hints = Hints(np.zeros((_HINTS, size)), np.zeros(_HINTS, dtype=np.int64), np.array([0, 1, 0, 0, 0]))
    vectors = (np.zeros(k) for k in (contacts, size, size, nv, nv))
    return System(mass, factor_memory(mass), row_memory(mass, size), cone, cone_memory(size), hints, *vectors)


@inlined
def _solve_contacts(
    cone: ConeProblem,
    memory: ConeMemory,
    hints: Hints,
    contacts: int,
    servos: int,
    p: Array,
    u: Array,
    accuracy: Accuracy,
    facets: int | None,
) -> tuple[float, int]:
    """Solve with the polyhedron of a number of ``facets``, or else with the exact cone, from a hint if there is one."""
    # With None as the type of facets, numba leaves the polyhedron's code out.
    if facets is not None:
        return solve_polyhedron(cone, contacts, servos, facets, p, u, accuracy.tolerance, accuracy.max_sweeps)
    hints.state[CALLS] += 1
    for k in range(hints.call.size):
        if hints.call[k] == hints.state[CALLS]:
            for i in range(3 * contacts + servos):
                p[i] = hints.p[k, i]
    residual, sweeps = solve_cone(cone, contacts, servos, p, u, accuracy.tolerance, accuracy.max_sweeps, memory)
    if hints.state[STRICT] and not residual <= max(accuracy.tolerance, ROUNDING):
        hints.state[FAILED], hints.state[CONTACTS], hints.state[SERVOS] = hints.state[CALLS], contacts, servos
    return residual, sweeps


@no_new_arrays
def solve_impulses(
    system: System,
    servos: Servos,
    contacts: int,
    r: Array,
    v: Array,
    accuracy: Accuracy,
    facets: int | None,
) -> tuple[float, int]:
    """Solve in place for the impulses ``system.p``, ``servos.impulse`` and the velocities ``system.u``, ``v`` (nv,).

    ``contacts`` is the number n of contacts and ``r`` (nv,) the momentum. ``servos.state`` is the first guess and
    receives the result. ``facets`` is the number of facets of the friction polyhedron, or None for the exact cone.
    Returns the residual and the number of sweeps (or pivots) of the contact solver.
    """
    mass, factor, rows, cone, size = system.mass, system.factor, system.rows, system.cone, 3 * contacts
    sweeps, none = 0, 0 * contacts  # with a literal 0, numba would compile the solver a second time
    for turn in range(_ROUNDS):
        _hold(system, servos, r, v)
        if not factorise(mass, factor):
            return np.inf, sweeps
        load(mass, system.known, factor)
        project(mass, factor, rows, size, cone.G, cone.g)
        soften(cone.G, size, accuracy.compliance)
        for i in range(size):
            cone.g[i] += row_speed(mass, rows, i, v)
        for c in range(contacts):
            cone.g[3 * c + 2] += system.bias[c]
        residual, used = _solve_contacts(
            cone, system.memory, system.hints, contacts, none, system.p, system.u, accuracy, facets
        )
        sweeps += used
        if system.hints.state[FAILED] > 0:
            return residual, sweeps
        velocities(mass, factor, rows, size, system.p, v)
        if servos.joint.size == 0 or not _switched(system, servos, size, r, v, turn >= _TOGETHER):
            return residual, sweeps
    residual, used = _solve_together(system, servos, contacts, r, v, accuracy, facets)
    return residual, sweeps + used


@inlined
def _hold(system: System, servos: Servos, r: Array, v: Array) -> None:
    """Write what is known under the servos' states to ``v`` (zero where unknown), ``factor.free`` and ``known``."""
    mass, free, known = system.mass, system.factor.free, system.known
    for i in range(v.size):
        v[i] = 0.0
    for j in range(free.size):
        free[j] = 1
    for k in range(servos.joint.size):
        if servos.state[k] == HOLDS:
            j = servos.joint[k]
            free[j], v[mass.joint_v[j]] = 0, servos.target[k]
    multiply(mass, v, known)
    for i in range(v.size):
        known[i] = r[i] - known[i]
    for k in range(servos.joint.size):
        if servos.state[k] != HOLDS:
            known[mass.joint_v[servos.joint[k]]] += servos.high[k] if servos.state[k] == AT_HIGH else servos.low[k]


@inlined
def _switched(system: System, servos: Servos, size: int, r: Array, v: Array, one: bool) -> bool:
    """Compute the servos' impulses; change the states that do not fit them, and return whether there are any.

    If only ``one`` may change it is that with the least index; for linear problems this ends (K. G. Murty, "Note on a
    Bard-type scheme for solving the complementarity problem", 1974).
    """
    mass, total = system.mass, system.total
    multiply(mass, v, total)
    for i in range(v.size):
        total[i] -= r[i]
    for i in range(size):
        add_impulse(mass, system.rows, i, -system.p[i], total)
    changed = False
    for k in range(servos.joint.size):
        i, low, high = mass.joint_v[servos.joint[k]], servos.low[k], servos.high[k]
        if servos.state[k] == HOLDS:
            value = total[i]
            servos.impulse[k] = value
            slack = 1e-10 * (high - low)
            if (value > high + slack or value < low - slack) and not (one and changed):
                servos.state[k] = AT_HIGH if value > high else AT_LOW
                changed = True
        else:
            servos.impulse[k] = high if servos.state[k] == AT_HIGH else low
            misfit = (v[i] - servos.target[k]) * servos.state[k] > 1e-12 * (1.0 + abs(servos.target[k]))
            if misfit and not (one and changed):
                servos.state[k] = HOLDS
                changed = True
    return changed


@part
def _solve_together(
    system: System,
    servos: Servos,
    contacts: int,
    r: Array,
    v: Array,
    accuracy: Accuracy,
    facets: int | None,
) -> tuple[float, int]:
    """Solve for the impulses of contacts and servos together; the arguments are those of ``solve_impulses``."""
    mass, factor, rows, cone, size = system.mass, system.factor, system.rows, system.cone, 3 * contacts
    driven = servos.joint.size
    for j in range(factor.free.size):
        factor.free[j] = 1
    for k in range(servos.joint.size):
        _servo_row(mass, rows, size + k, servos.joint[k])
        cone.low[k], cone.high[k] = servos.low[k], servos.high[k]
        system.p[size + k] = 0.0
    if not factorise(mass, factor):
        return np.inf, 0
    load(mass, r, factor)
    project(mass, factor, rows, size + driven, cone.G, cone.g)
    soften(cone.G, size, accuracy.compliance)
    for c in range(contacts):
        cone.g[3 * c + 2] += system.bias[c]
    for k in range(servos.joint.size):
        cone.g[size + k] -= servos.target[k]
    residual, used = _solve_contacts(
        cone, system.memory, system.hints, contacts, driven, system.p, system.u, accuracy, facets
    )  # fmt: skip
    velocities(mass, factor, rows, size + driven, system.p, v)
    for k in range(servos.joint.size):
        impulse = system.p[size + k]
        servos.impulse[k] = impulse
        if impulse >= servos.high[k]:
            servos.state[k] = AT_HIGH
        else:
            servos.state[k] = AT_LOW if impulse <= servos.low[k] else HOLDS
    return residual, used


@inlined
def _servo_row(mass: Mass, rows: Rows, row: int, joint: int) -> None:
    """Write the row of the Jacobian that gives the velocity of a ``joint``."""
    for leg in range(mass.leg_base.size):
        start = mass.leg_start[leg]
        if start <= joint < mass.leg_start[leg + 1]:
            rows.sides[row], rows.leg[row, 0], rows.base[row, 0] = 1, leg, mass.leg_base[leg]
            for a in range(6):
                rows.on_base[row, 0, a] = 0.0
            for j in range(start, mass.leg_start[leg + 1]):
                rows.on_leg[row, 0, j - start] = 1.0 if j == joint else 0.0


def begin(hints: Hints) -> None:
    """Forget the hints: the next problems are those of another step."""
    hints.call[:] = 0
    hints.state[:] = 0, 1, 0, 0, 0


def give_hint(system: System, accuracy: Accuracy) -> None:
    """Solve the contact problem at which a step has stopped by all means; its solution is a hint for the repeated step.

    If it is not solved, or is not even with its hint, the repeated step will not stop at such problems.
    """
    hints = system.hints
    number, contacts, servos = hints.state[[FAILED, CONTACTS, SERVOS]].tolist()
    place = int((hints.call > 0).sum())
    x, w = np.zeros(system.p.size), np.zeros(system.p.size)
    hints.state[[CALLS, FAILED]] = 0
    if number in hints.call or place == _HINTS:
        hints.state[STRICT] = 0
        return
    solve_hard_cone(
        system.cone, contacts, servos, x, w, max(accuracy.tolerance, ROUNDING), system.memory
    )  # fmt: skip
    hints.p[place], hints.call[place] = x, number


class Impact(NamedTuple):
    """Contacts that strike, and memory for the two phases of Poisson's law.

    ``strikes`` (n,) is 1 for contacts that bounce, ``approach`` (n,) [m/s] are the normal velocities before the impact.
    ``compression`` (3 n,) [N s] and ``servo`` (m,) [N m s] receive the impulses of the first phase.
    """

    strikes: Whole
    approach: Array
    compression: Array
    servo: Array

    def __repr__(self) -> str:
        return short_repr(self)


def impact_memory(contacts: int, servos: int) -> Impact:
    """Return an Impact for up to a number of ``contacts`` and of ``servos``, filled with zeros."""
    return Impact(np.zeros(contacts, dtype=np.int64), np.zeros(contacts), np.zeros(3 * contacts), np.zeros(servos))


@no_new_arrays
def solve_impact(
    system: System,
    servos: Servos,
    contacts: int,
    impact: Impact,
    restitution: float,
    poisson: bool,
    r: Array,
    v: Array,
    accuracy: Accuracy,
    facets: int | None,
) -> tuple[float, int]:
    """Solve as ``solve_impulses``, with ``restitution`` xi of the contacts that strike the ground.

    Newton's law (``poisson`` false) requires u_n >= -xi approach and is solved in one phase. Poisson's law has two:
    compression (A(4)), then expansion with additional normal impulses of at least xi times those of the compression
    (A(5)-(6), A-E6 corrected). ``system.p`` receives the sum of both phases, ``system.u`` the velocities after them;
    ``r`` (nv,) is overwritten.
    """
    bounces = False
    for c in range(contacts):
        system.cone.p_min[c] = 0.0
        if impact.strikes[c] and restitution > 0.0:
            bounces = True
            if not poisson:
                system.bias[c] = restitution * impact.approach[c]
    residual, sweeps = solve_impulses(system, servos, contacts, r, v, accuracy, facets)
    for i in range(3 * contacts):
        impact.compression[i] = system.p[i]
    if not (bounces and poisson) or system.hints.state[FAILED] > 0:
        return residual, sweeps
    multiply(system.mass, v, r)
    for i in range(3 * contacts):
        system.p[i] = 0.0
    for c in range(contacts):
        if impact.strikes[c]:
            system.cone.p_min[c] = restitution * impact.compression[3 * c + 2]
    for k in range(servos.joint.size):  # the sum of both phases stays within the limit
        impact.servo[k] = servos.impulse[k]
        servos.low[k] -= impact.servo[k]
        servos.high[k] -= impact.servo[k]
    second, used = solve_impulses(system, servos, contacts, r, v, accuracy, facets)
    for i in range(3 * contacts):
        system.p[i] += impact.compression[i]
    for c in range(contacts):
        system.cone.p_min[c] = 0.0
    for k in range(servos.joint.size):
        servos.impulse[k] += impact.servo[k]
        servos.low[k] += impact.servo[k]
        servos.high[k] += impact.servo[k]
    return max(residual, second), sweeps + used
