"""Which contacts act in a step, their axes and the rows of their Jacobian, compiled."""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.impulses import Impact
from hexakin.contact.mass import Mass, Rows, row_speed
from hexakin.engines.ground_contacts import Contacts
from hexakin.engines.leg_dynamics import Bodies, Dynamics
from hexakin.engines.step_values import Active, Last, Law, Places
from hexakin.numerics.numba_cache import Whole, inlined, part
from hexakin.numerics.vectors import (
    Vector,
    cross,
    dot,
    entries,
    matrix,
    minus,
    rotated_back,
    times,
    vector,
    write_vector,
)

_SLOP = 1e-3  # [m] penetration that is not corrected
_PUSH_TIME = 0.05  # [s] time constant with which deeper penetration is corrected ...
_PUSH_SPEED = 0.1  # [m/s] ... and the largest speed of this correction


@part
def choose(
    bodies: Bodies,
    places: Places,
    dynamics: Dynamics,
    mass: Mass,
    contacts: Contacts,
    found: int,
    law: Law,
    q: Array,
    v: Array,
    rows: Rows,
    active: Active,
    impact: Impact,
) -> tuple[int, int, bool]:
    """Write the rows of the contacts that act in a step; return how many, how many are closed, and whether one strikes.

    First come those that are closed or strike before the end of the step, then slow ones that may close in it. A fast
    body that strikes later is left in flight, so that it hits with its own speed.
    """
    count, closed, struck = 0 * found, 0, False
    for turn in range(2):
        for c in range(found):
            gap = contacts.gap[c]
            if turn == 1 and not 0.0 < gap <= law.reach:
                continue
            _write_frame(vector(contacts.normal, c, 0), active.frame, count)
            for side in range(2):
                joint = contacts.bodies[c, side]
                if joint >= 0:
                    _write_side(bodies, places, dynamics, q, joint, vector(contacts.point, c, 0), side, count,
                                active.frame, rows)  # fmt: skip
            for i in range(3 * count, 3 * count + 3):
                rows.sides[i] = 2 if contacts.bodies[c, 1] >= 0 else 1
            speed = row_speed(mass, rows, 3 * count + 2, v)
            fast = speed < -law.threshold
            if (gap <= 0.0 or (fast and gap + 0.5 * law.h * speed <= 0.0)) if turn == 0 else not fast:
                active.contact[count] = c
                impact.approach[count], impact.strikes[count] = speed, fast
                struck = struck or (turn == 0 and fast)
                count += 1
        if turn == 0:
            closed = count
    return count, closed, struck


@inlined
def _write_frame(n: Vector, frame: Array, place: int) -> None:
    """Write the axes (t1, t2, n), a right-handed frame; t1 is the world's x axis projected (y if n is near x)."""
    if abs(n[0]) < 0.9:
        t = (1.0 - n[0] * n[0], -n[0] * n[1], -n[0] * n[2])
    else:
        t = (-n[1] * n[0], 1.0 - n[1] * n[1], -n[1] * n[2])
    t = times(1.0 / np.sqrt(dot(t, t)), t)
    write_vector(t, frame, place, 0)
    write_vector(cross(n, t), frame, place, 3)
    write_vector(n, frame, place, 6)


@inlined
def _write_side(
    bodies: Bodies,
    places: Places,
    dynamics: Dynamics,
    q: Array,
    joint: int,
    point: Vector,
    side: int,
    place: int,
    frame: Array,
    rows: Rows,
) -> None:
    """Write the part of a contact's rows that one of its two bodies has, the body of a ``joint`` of the model.

    ``point`` [m] is the contact point in the world. All is expressed in the frame of the joint's free body.
    """
    base, leg, depth = places.base[joint], places.leg[joint], places.depth[joint]
    R = matrix(dynamics.base_rotation, base)
    x = rotated_back(R, minus(point, entries(q, bodies.base_q[base])))
    for axis in range(3):
        row = 3 * place + axis
        along = rotated_back(R, vector(frame, place, 3 * axis))
        if side == 1:
            along = times(-1.0, along)
        moment = cross(x, along)
        rows.base[row, side], rows.leg[row, side] = base, leg
        for a in range(3):
            rows.on_base[row, side, a], rows.on_base[row, side, 3 + a] = along[a], moment[a]
        if leg >= 0:
            start = bodies.leg_start[leg]
            for j in range(start, bodies.leg_start[leg + 1]):
                value = 0.0
                if j - start < depth:
                    value = dot(vector(dynamics.axis, j, 0), along) + dot(vector(dynamics.axis, j, 3), moment)
                rows.on_leg[row, side, j - start] = value


@part
def write_bias(gap: Array, active: Whole, count: int, h: float, bias: Array) -> None:
    """Write what is added to the contacts' normal velocities: open contacts may approach by their gap in a time ``h``.

    ``gap`` (found,) [m] are the gaps of all contacts found, ``active`` (count,) the indices of those that act.
    """
    for i in range(count):
        distance, added = gap[active[i]], 0.0
        if distance > 0.0:
            added = distance / h
        elif distance < -_SLOP:
            added = -min((-distance - _SLOP) / _PUSH_TIME, _PUSH_SPEED)
        bias[i] = added


@part
def guess(last: Last, key: Whole, active: Active, count: int, p: Array) -> None:
    """Write the impulses of the ``last`` step as a first guess to ``p`` (3 c,); zero for contacts that are new.

    ``key`` (found,) identifies the contacts found.
    """
    for i in range(count):
        for a in range(3 * i, 3 * i + 3):
            p[a] = 0.0
        mine = key[active.contact[i]]
        if mine < 0:
            continue
        for old in range(last.number[0]):
            if last.key[old] == mine:
                for a in range(3):
                    p[3 * i + a] += dot(vector(active.frame, i, 3 * a), vector(last.impulse, old, 0))


@part
def keep(last: Last, key: Whole, active: Active, count: int, p: Array) -> None:
    """Keep the impulses ``p`` (3 c,), for ``guess`` in the next step."""
    last.number[0] = count
    for i in range(count):
        last.key[i] = key[active.contact[i]]
        for k in range(3):
            last.impulse[i, k] = 0.0
            for a in range(3):
                last.impulse[i, k] += active.frame[i, 3 * a + k] * p[3 * i + a]
