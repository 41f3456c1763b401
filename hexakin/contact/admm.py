"""Coulomb's law with the exact cone, solved by Pinocchio's ADMM solver, as an independent check of our solvers.

ADMM is the alternating direction method of multipliers.

Carpentier, Le Lidec and Montaut, "From compliant to rigid contact simulation: a unified and efficient approach"
(2024). The method adds De Saxce's term mu |u_t| to the normal velocities and so solves Coulomb's law itself, not its
convex relaxation. Pinocchio's own report of success is not used, because it compares impulses and velocities with the
same absolute tolerance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_number, check_whole
from hexakin.contact.cone import ConeProblem, cone_memory, impulse_scales, natural_map
from hexakin.dynamics import pin
from hexakin.exceptions import InvalidInputError
from hexakin.numerics.display import short_repr

_MOST_ITERATIONS = 100_000  # Pinocchio's loop cannot be interrupted: a second or two for a robot's contacts


class AdmmSolution(NamedTuple):
    """Impulses ``p`` (3 n + m,) and velocities ``u`` (3 n + m,), u = G p + g, in the units of the problem.

    ``residual`` is the natural residual relative to the largest impulse, as in ``hexakin.contact.cone.solve_cone``; it
    shows whether they are a solution. ``iterations`` is the number of ADMM iterations.
    """

    p: Array
    u: Array
    residual: float
    iterations: int

    def __repr__(self) -> str:
        return short_repr(self)


def solve_admm(
    G: ArrayLike,
    g: ArrayLike,
    mu: ArrayLike,
    low: ArrayLike = (),
    high: ArrayLike = (),
    tolerance: float = 1e-11,
    max_iterations: int = 20_000,
) -> AdmmSolution:
    """Solve the problem of ``hexakin.contact.cone.solve_cone`` with p_min = 0.

    ``G`` (3 n + m, 3 n + m) [1/kg] and ``g`` (3 n + m,) [m/s] give the velocities u = G p + g: n contacts first, each
    in the order t1, t2, n, then m servos. ``mu`` (n,) are the friction coefficients, numbers without unit; ``low`` (m,)
    and ``high`` (m,) [N m s] the limits of the servos' impulses. ``tolerance`` is that of ADMM in a scale where the
    largest velocity is 1 and the diagonal of G is about 1; ``max_iterations``, at most 100,000, limits the ADMM
    iterations. Raises InvalidInputError for wrong shapes, friction below zero or ``low`` above ``high``.
    """
    n, m = np.size(mu), np.size(low)
    size = 3 * n + m
    G, g = _checked("G", G, size, size), _checked("g", g, size)
    mu, low, high = _checked("mu", mu, n), _checked("low", low, m), _checked("high", high, m)
    check_number("tolerance", tolerance, above=0.0)
    check_whole("max_iterations", max_iterations, at_least=1, at_most=_MOST_ITERATIONS)
    if (mu < 0.0).any():
        raise InvalidInputError(f"mu: {mu.min():g}, expected at least 0")
    if (low > high).any():
        j = int(np.argmax(low > high))
        raise InvalidInputError(f"low: {low[j]:g} of row {j + 1} is above high {high[j]:g}")
    # One scale for each contact and servo: cones stay cones, and with servos a twentieth of the iterations are enough.
    problem, memory = ConeProblem(G, g, mu, np.zeros(n), low, high), cone_memory(size)
    least = impulse_scales(problem, n, m, memory.step_length)
    d = np.sqrt(memory.step_length)
    unit = float(np.abs(d * g).max(initial=0.0))
    if unit == 0.0:
        return AdmmSolution(np.zeros(size), np.zeros(size), 0.0, 0)
    models, datas = _constraints(mu, low / (unit * d[3 * n :]), high / (unit * d[3 * n :]))
    settings = pin.ADMMSolverSettings()
    settings.solve_ncp = True  # Coulomb's law, not its relaxation
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
    settings.max_iterations = max_iterations
    settings.admm_update_rule = pin.ADMMUpdateRule.LINEAR  # the default rule fails on some redundant contacts
    result = pin.ADMMSolverResult()
    operator = pin.DelassusOperatorDense(d[:, None] * G * d)
    pin.ADMMConstraintSolver(size).solve(operator, d * g / unit, models, datas, settings, result)
    p = np.empty(size)
    result.retrievePrimalSolution(p)
    p *= unit * d
    u = G @ p + g
    residual, _ = natural_map(problem, n, m, p, u, memory)
    return AdmmSolution(p, u, residual / max(least, float(np.abs(p).max())), int(result.iterations))


def _checked(name: str, value: ArrayLike, *shape: int) -> Array:
    return np.array(check_array(name, value, shape), order="C")


def _constraints(mu: Array, low: Array, high: Array) -> tuple[pin.StdVec_ConstraintModel, pin.StdVec_ConstraintData]:
    """Return constraints that only define the allowed sets: cones about z for contacts, boxes for servos."""
    model = pin.Model()
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for friction in mu:
        contact = pin.PointContactConstraintModel(model, 0)
        contact.setFriction(friction)
        models.append(pin.ConstraintModel(contact))
    if low.size > 0:
        joints = [model.addJoint(j, pin.JointModelRZ(), pin.SE3.Identity(), f"servo_{j + 1}") for j in range(low.size)]
        servos = pin.JointFrictionConstraintModel(model, pin.StdVec_Index(joints), low, high)
        servos.setTimeStep(1.0)  # limits of forces are then limits of impulses
        models.append(pin.ConstraintModel(servos))
    for constraint in models:
        datas.append(constraint.createData())
    return models, datas
