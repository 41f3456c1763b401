"""Moreau time stepping of rigid bodies with friction and impacts, compiled (A section 3.1).

A step of duration h changes the velocity from v to v'. The mass matrix, the forces and the contacts are those at the
configuration in the middle of the step, q + h v / 2:

    M (v' - v) = -h (C + g) + S^T s + J^T p.

The servo impulses s and the contact impulses p are computed together (``hexakin.contact.impulses``). Bodies at a closed
contact do not approach each other; at an open one they approach at most by the gap. If contacts close faster than a
threshold, an impact is computed first. With Poisson's law (A(4)-(6)), the expansion phase returns at least the share xi
of each compression impulse; with Newton's law, the impact returns the share xi of each approach velocity. M. Jean and
J. J. Moreau, "Unilaterality and dry friction in the dynamics of rigid body collections", 1992; M. Anitescu and F. A.
Potra, "Formulating dynamic multi-rigid-body contact problems with friction as solvable linear complementarity
problems", 1997; Ch. Glocker, "Set-Valued Force Laws", 2001.

``run`` makes steps. It is compiled once for each kind of arguments: with or without facets, and with or without
torques in place of servos, so that code that is not needed is not compiled.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.impulses import CALLS, FAILED, System, solve_impact, solve_impulses
from hexakin.contact.mass import Mass, Rows, factorise, load, multiply, row_speed, velocities
from hexakin.engines.acting_contacts import choose, guess, keep, write_bias
from hexakin.engines.contact_search import find_contacts
from hexakin.engines.leg_dynamics import Bodies, Dynamics, update
from hexakin.engines.step_values import Active, Drive, Law, Places, Scene, State, Step, Sums, Torques
from hexakin.engines.torque_step import solve_torques
from hexakin.numerics.numba_cache import Interrupted, Whole, inlined, no_new_arrays, part, signals_raise
from hexakin.numerics.vectors import (
    Matrix,
    Vector,
    entries,
    matrix,
    plus,
    product,
    rotated,
    rotated_back,
    rotation_of,
    vector,
)

DONE, CROWDED, UNSOLVED, LOST = range(4)
_HOPELESS = 1e-3  # relative residual above which a simulation stops


@no_new_arrays
def run(
    scene: Scene,
    drive: Drive,
    torques: Torques | None,
    law: Law,
    facets: int | None,
    state: State,
    step: Step,
    steps: int,
) -> tuple[int, int]:
    """Make up to ``steps`` time steps; return how many were made, and why no more.

    DONE: all were made. CROWDED: more contacts were found than ``step`` has memory for; the caller calls again with
    more. UNSOLVED: contact forces were not found to the tolerance; the caller gives a hint and repeats this one step.
    LOST: contact forces are not even nearly right.

    ``torques`` replace the servos if not None. ``facets`` is the number of facets of the friction polyhedron, or None
    for the exact cone.
    """
    bodies, dynamics, system, contacts, active = scene.bodies, step.dynamics, step.system, step.contacts, step.active
    hints = system.hints
    q, v, start, after, momentum, h = state.q, state.v, step.start, step.after, step.momentum, law.h
    for made in range(steps):
        if signals_raise() != 0:
            raise Interrupted
        update(bodies, q, v, dynamics)
        if drive.command.size == 0:
            _center_bias(bodies, system, dynamics, h, q, v, after, momentum)
        _write_poses(bodies, scene.places, q, dynamics, step.poses)
        step.found[0] = find_contacts(
            step.poses, scene.shapes, scene.ground, scene.meeting, law.search_distance, contacts, step.posed
        )
        found = step.found[0]
        if found > active.contact.size:
            return made, CROWDED
        count, closed, struck = choose(
            bodies, scene.places, dynamics, system.mass, contacts, found, law, q, v, system.rows, active, step.impact
        )
        for i in range(count):
            system.cone.mu[i] = law.friction
        for i in range(v.size):
            start[i] = v[i]
        for i in range(3 * count):
            active.blow[i] = 0.0
        for k in range(drive.before.size):
            drive.before[k] = drive.servos.state[k]
        hints.state[CALLS] = 0
        residual, rest = 0.0, h
        if struck:
            # An impact takes no time: servos have no effect on it. On average it occurs in the middle of the step.
            rest = 0.5 * h
            _write_momentum(bodies.base_v, system.mass, dynamics.bias, v, start, h - rest, after, momentum)
            for i in range(closed):
                system.bias[i] = 0.0
            for i in range(3 * closed):
                system.p[i] = 0.0
            residual, _ = solve_impact(
                system, drive.idle, closed, step.impact, law.restitution, law.poisson, momentum, start, law.accuracy,
                facets,
            )  # fmt: skip
            if hints.state[FAILED] > 0:  # the problem that failed is still in ``system``
                return made, UNSOLVED
            for i in range(3 * closed):
                active.blow[i] = system.p[i]
        _write_momentum(bodies.base_v, system.mass, dynamics.bias, v, start, rest, after, momentum)
        write_bias(contacts.gap, active.contact, count, h, system.bias)
        guess(state.last, contacts.key, active, count, system.p)
        if torques is None:
            _aim(drive, bodies.joint_q, q, law)
            last, _ = solve_impulses(system, drive.servos, count, momentum, after, law.accuracy, facets)
        else:
            last = solve_torques(
                bodies, scene.places, drive, torques, law, count, facets, q, system, momentum, after
            )  # fmt: skip
        residual = max(residual, last) if last == last else np.inf
        if hints.state[FAILED] > 0:
            for k in range(drive.before.size):
                drive.servos.state[k] = drive.before[k]
            return made, UNSOLVED
        _add_up(bodies, drive, system.mass, system.rows, active, count, system.p, v, start, after, state.sums)
        _add_impulses(contacts.gap, contacts.group, active, count, system.p, state.sums)
        state.sums.totals[3] = max(state.sums.totals[3], residual)
        if not residual <= law.accuracy.tolerance:
            state.sums.unsolved[0] += 1
        keep(state.last, contacts.key, active, count, system.p)
        for i in range(v.size):
            v[i] = after[i]
        if not residual <= _HOPELESS:
            return made, LOST
        _add_rate(bodies.base_v, v, state.sums.rate_moment)
        drift(bodies, q, v, h)
    return steps, DONE


@part
def _center_bias(
    bodies: Bodies, system: System, dynamics: Dynamics, h: float, q: Array, v: Array, half_way: Array, change: Array
) -> None:
    """Replace the velocity-dependent forces by those in the middle of the step.

    With these forces tumbling bodies keep their energy. A robot with servos rotates too slowly for this to matter, so
    that it is not computed for robots. ``half_way`` and ``change`` (nv,) are memory.
    """
    bias, factor, none = dynamics.bias, system.factor, 0 * v.size
    for j in range(factor.free.size):
        factor.free[j] = 1
    factorise(system.mass, factor)
    for i in range(v.size):
        half_way[i] = v[i]
    for _ in range(3):
        load(system.mass, bias, factor)
        velocities(system.mass, factor, system.rows, none, system.p, change)
        _add_turning(bodies.base_v, half_way, -1.0, change)
        for i in range(v.size):
            half_way[i] = v[i] - 0.5 * h * change[i]
        update(bodies, q, half_way, dynamics)
    # The momentum counts the turning of the frames at the velocity before the step.
    for i in range(v.size):
        change[i] = 0.0
    _add_turning(bodies.base_v, v, 1.0, change)
    _add_turning(bodies.base_v, half_way, -1.0, change)
    multiply(system.mass, change, half_way)
    for i in range(v.size):
        bias[i] += half_way[i]


@inlined
def _add_turning(base_v: Whole, v: Array, factor: float, out: Array) -> None:
    """Add ``factor`` times v x w of each free body to the linear part of ``out`` (nv,).

    It is the part of the linear accelerations that results from the rotation of the bodies' frames. Pinocchio's C
    contains it, but ``drift`` takes account of it already.
    """
    for b in range(base_v.size):
        j = base_v[b]
        out[j] += factor * (v[j + 4] * v[j + 2] - v[j + 5] * v[j + 1])
        out[j + 1] += factor * (v[j + 5] * v[j] - v[j + 3] * v[j + 2])
        out[j + 2] += factor * (v[j + 3] * v[j + 1] - v[j + 4] * v[j])


@part
def _write_poses(bodies: Bodies, places: Places, q: Array, dynamics: Dynamics, poses: Array) -> None:
    """Write the poses of all joints of the model in the world to ``poses`` (joints, 12)."""
    for b in range(bodies.base_q.size):
        _write_pose(matrix(dynamics.base_rotation, b), entries(q, bodies.base_q[b]), poses, places.base_of[b])
    for leg in range(bodies.leg_base.size):
        b = bodies.leg_base[leg]
        R, x = matrix(dynamics.base_rotation, b), entries(q, bodies.base_q[b])
        for j in range(bodies.leg_start[leg], bodies.leg_start[leg + 1]):
            place = plus(x, rotated(R, vector(dynamics.origin, j, 0)))
            _write_pose(product(R, matrix(dynamics.rotation, j)), place, poses, places.joint_of[j])


@inlined
def _write_pose(R: Matrix, x: Vector, poses: Array, joint: int) -> None:
    for a in range(3):
        for b in range(3):
            poses[joint, 3 * b + a] = R[3 * a + b]
        poses[joint, 9 + a] = x[a]


@part
def _write_momentum(
    base_v: Whole, mass: Mass, bias: Array, turning: Array, start: Array, time: float, moved: Array, out: Array
) -> None:
    """Write the momentum after a ``time`` [s] from the velocity ``start`` under the known forces to ``out`` (nv,).

    The frames turn with the velocity ``turning`` (nv,); ``moved`` (nv,) is memory.
    """
    for i in range(start.size):
        moved[i] = start[i]
    _add_turning(base_v, turning, time, moved)
    multiply(mass, moved, out)
    for i in range(start.size):
        out[i] -= time * bias[i]


@part
def _aim(drive: Drive, joint_q: Whole, q: Array, law: Law) -> None:
    """Write the servos' target velocities, from the angles at the end of the step, and their limits."""
    servos = drive.servos
    for k in range(servos.joint.size):
        lag = drive.command[k] - q[joint_q[servos.joint[k]]]
        servos.target[k] = law.servo_rate * lag / (1.0 + 0.5 * law.h * law.servo_rate)
        servos.low[k], servos.high[k] = -law.h * law.servo_torque, law.h * law.servo_torque


@part
def _add_up(
    bodies: Bodies,
    drive: Drive,
    mass: Mass,
    rows: Rows,
    active: Active,
    count: int,
    p: Array,
    v: Array,
    start: Array,
    after: Array,
    sums: Sums,
) -> None:
    """Add the works of servos and contacts, by the trapezoidal rule, which is exact for a constant mass matrix."""
    servos = drive.servos
    for k in range(servos.joint.size):
        i = bodies.joint_v[servos.joint[k]]
        sums.totals[0] += 0.5 * servos.impulse[k] * (start[i] + after[i])
    for i in range(3 * count):
        between = row_speed(mass, rows, i, start)
        work = p[i] * (between + row_speed(mass, rows, i, after))
        if active.blow[i] != 0.0:
            work += active.blow[i] * (row_speed(mass, rows, i, v) + between)
        sums.totals[1] += 0.5 * work


@part
def _add_impulses(gap: Array, group: Whole, active: Active, count: int, p: Array, sums: Sums) -> None:
    """Add the normal impulses to those of their groups; ``gap`` and ``group`` (found,) are those of all contacts."""
    for g in range(sums.last_impulse.size):
        sums.last_impulse[g] = 0.0
    for i in range(count):
        c, normal = active.contact[i], p[3 * i + 2] + active.blow[3 * i + 2]
        sums.totals[2] = max(sums.totals[2], -gap[c])
        sums.impulse[group[c]] += normal
        sums.last_impulse[group[c]] += normal


@inlined
def _add_rate(base_v: Whole, v: Array, rate_moment: Array) -> None:
    """Add the products of the first free body's rates to ``rate_moment`` (3, 3)."""
    if base_v.size > 0:
        first = base_v[0] + 3
        for i in range(3):
            for k in range(3):
                rate_moment[i, k] += v[first + i] * v[first + k]


@no_new_arrays
def drift(bodies: Bodies, q: Array, v: Array, h: float) -> None:
    """Change the configuration ``q`` (nq,) in place by the motion with constant velocity in a time ``h`` [s].

    A free body moves along a straight line in the world and rotates at its angular velocity. Its linear velocity is
    expressed in its own frame, so that this part of ``v`` (nv,) is rotated in place too.
    """
    for j in range(bodies.joint_q.size):
        q[bodies.joint_q[j]] += h * v[bodies.joint_v[j]]
    for b in range(bodies.base_q.size):
        i, j = bodies.base_q[b], bodies.base_v[b]
        x, y, z, w = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        linear = rotated(rotation_of(x, y, z, w), (v[j], v[j + 1], v[j + 2]))
        wx, wy, wz = h * v[j + 3], h * v[j + 4], h * v[j + 5]
        angle = np.sqrt(wx * wx + wy * wy + wz * wz)
        sine = np.sin(0.5 * angle) / angle if angle > 1e-6 else 0.5 - angle * angle / 48.0
        cosine = np.cos(0.5 * angle)
        sx, sy, sz = sine * wx, sine * wy, sine * wz
        nx = w * sx + x * cosine + y * sz - z * sy
        ny = w * sy - x * sz + y * cosine + z * sx
        nz = w * sz + x * sy - y * sx + z * cosine
        nw = w * cosine - x * sx - y * sy - z * sz
        norm = np.sqrt(nx * nx + ny * ny + nz * nz + nw * nw)
        nx, ny, nz, nw = nx / norm, ny / norm, nz / norm, nw / norm
        q[i + 3], q[i + 4], q[i + 5], q[i + 6] = nx, ny, nz, nw
        back = rotated_back(rotation_of(nx, ny, nz, nw), linear)
        for a in range(3):
            q[i + a] += h * linear[a]
            v[j + a] = back[a]
