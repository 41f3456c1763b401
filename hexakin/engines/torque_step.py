"""A step in which the joints apply torques instead of following servos, compiled."""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.contact.impulses import AT_HIGH, AT_LOW, FAILED, HOLDS, System, solve_impulses
from hexakin.engines.leg_dynamics import Bodies
from hexakin.engines.step_values import Drive, Law, Places, Torques
from hexakin.numerics.numba_cache import Whole, inlined, part

_ROUNDS = 12


@part
def solve_torques(
    bodies: Bodies,
    places: Places,
    drive: Drive,
    torques: Torques,
    law: Law,
    contacts: int,
    facets: int | None,
    q: Array,
    system: System,
    r: Array,
    v: Array,
) -> float:
    """Compute the velocities ``v`` (nv,) and the contact impulses with a torque law; return the solver's residual.

    The torques are those at the angles and rates at the end of the step. They therefore add h (kd + h kp / 2) to the
    diagonal of the mass matrix (``q`` is the configuration in the middle of the step). Joints whose torque would exceed
    the limit apply the limit instead; which joints these are is found by iteration. ``r`` (nv,) is the momentum.
    """
    servos, limit = drive.servos, law.h * law.servo_torque
    for k in range(servos.joint.size):
        servos.state[k] = HOLDS
    residual = np.inf
    for _ in range(_ROUNDS):
        for k in range(servos.joint.size):
            _apply(bodies, places, drive, torques, law, q, k, 1.0, system.mass.block, r)
        residual, _ = solve_impulses(system, drive.idle, contacts, r, v, law.accuracy, facets)
        if system.hints.state[FAILED] > 0:
            return residual
        changed = False
        for k in range(servos.joint.size):
            _apply(bodies, places, drive, torques, law, q, k, -1.0, system.mass.block, r)
            constant, soft = _torque(bodies.joint_q, drive, torques, law.h, q, k)
            free = constant - soft * v[bodies.joint_v[servos.joint[k]]]
            if servos.state[k] == HOLDS:
                servos.impulse[k] = min(max(free, -limit), limit)
                if abs(free) > limit * (1.0 + 1e-10):
                    servos.state[k] = AT_HIGH if free > 0.0 else AT_LOW
                    changed = True
            else:
                servos.impulse[k] = limit * servos.state[k]
                if free * servos.state[k] < limit:
                    servos.state[k] = HOLDS
                    changed = True
        if not changed:
            break
    return residual


@inlined
def _torque(joint_q: Whole, drive: Drive, torques: Torques, h: float, q: Array, k: int) -> tuple[float, float]:
    """Return the impulse [N m s] of the torque law at rate zero, and its decrease [N m s^2] with the rate."""
    lag = drive.command[k] - q[joint_q[drive.servos.joint[k]]]
    return h * (torques.torque[k] + torques.kp[k] * lag), h * (torques.kd[k] + 0.5 * h * torques.kp[k])


@inlined
def _apply(
    bodies: Bodies,
    places: Places,
    drive: Drive,
    torques: Torques,
    law: Law,
    q: Array,
    k: int,
    sign: float,
    block: Array,
    r: Array,
) -> None:
    """Add the torque law of servo ``k`` to the momentum and the mass matrix, or take it away with the ``sign`` -1."""
    j = drive.servos.joint[k]
    if drive.servos.state[k] == HOLDS:
        constant, soft = _torque(bodies.joint_q, drive, torques, law.h, q, k)
        block[j, places.depth[places.joint_of[j]] - 1] += sign * soft
        r[bodies.joint_v[j]] += sign * constant
    else:
        r[bodies.joint_v[j]] += sign * law.h * law.servo_torque * drive.servos.state[k]
