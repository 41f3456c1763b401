"""Kinematics and statics of a leg as CasADi functions, made from the sympy expressions of its Denavit-Hartenberg table.

This package is the only one that imports casadi.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, read_only
from hexakin.exceptions import MissingPackageError
from hexakin.numerics.display import short_repr
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.robot.leg_table import NUM_JOINTS, LegTable
from hexakin.robot.model import SEGMENT_NAMES, Robot
from hexakin.symbolic.leg import derive, with_functions

try:
    import casadi as ca
except ImportError as error:
    raise MissingPackageError("casadi", "a feasibility check", "pip install casadi") from error

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sin": ca.sin,
    "cos": ca.cos,
    "sqrt": ca.sqrt,
    "Abs": ca.fabs,
    "sign": ca.sign,
    "atan2": ca.atan2,
    "Max": ca.fmax,
}
_CHUNK = 10_000  # leg poses of one call, which takes some hundredths of a second: Ctrl-C ends it only then
_SHAPES = {"foot": (3,), "jacobian": (3, 3), "axes": (3, 3), "knee": (3,), "moment": (3,), "moment_slope": (3, 3)}


class LegStates(NamedTuple):
    """Positions and derivatives of every leg in the body frame, for joint angles (..., L, 3).

    ``foot`` and ``knee`` (..., L, 3) [m] are positions, and ``jacobian`` (..., L, 3, 3) [m/rad] is that of the foot.
    ``axes`` (..., L, 3, 3) holds the unit vectors along the joint axes as columns. ``moment`` (..., L, 3) [kg m] is the
    mass of the leg times the position of its centre of mass, and ``moment_slope`` (..., L, 3, 3) [kg m/rad] its
    derivative with respect to the angles.
    """

    foot: Array
    jacobian: Array
    axes: Array
    knee: Array
    moment: Array
    moment_slope: Array

    def __repr__(self) -> str:
        return short_repr(self)


@lru_cache(maxsize=16)
@interrupts_kept()
def leg_function(table: LegTable) -> ca.Function:
    """CasADi function of a leg type: (q (3) [rad], constants) -> the fields of ``LegStates`` of one leg.

    Matrices are flattened column by column. ``constants`` is a row of ``leg_constants``.
    """
    leg = derive(table.canonical())
    joints, parameters = ca.SX.sym("q", NUM_JOINTS), ca.SX.sym("p", len(leg.parameters))
    mass, center = ca.SX.sym("m", NUM_JOINTS), ca.SX.sym("c", 3, NUM_JOINTS)
    points = [[leg.symbol(f"c_{k}_{axis}") for axis in "xyz"] for k in range(NUM_JOINTS)]
    carried = [leg.carried(k, points[k]) for k in range(NUM_JOINTS)]
    names = [*leg.joints, *leg.parameters, *(symbol for point in points for symbol in point)]
    vectors = [leg.foot, leg.jacobian, leg.joint_axes, leg.joint_positions[-1], *carried]
    found = with_functions(names, [entry for v in vectors for entry in v.T], _FUNCTIONS)(
        *ca.vertsplit(joints), *ca.vertsplit(parameters), *ca.vertsplit(ca.vec(center))
    )
    foot, jacobian, axes, knee, centers = (
        ca.vertcat(*found[a:b]) for a, b in ((0, 3), (3, 12), (12, 21), (21, 24), (24, None))
    )
    moment = ca.reshape(centers, 3, NUM_JOINTS) @ mass
    outputs = [foot, jacobian, axes, knee, moment, ca.vec(ca.jacobian(moment, joints))]
    constants = ca.vertcat(parameters, mass, ca.vec(center))
    return ca.Function("leg", [joints, constants], outputs, ["q", "constants"], list(_SHAPES))


@lru_cache(maxsize=16)
@interrupts_kept()
def reach_function(table: LegTable) -> ca.Function:
    """CasADi function of a leg type: (foot (3) [m], parameters, side) -> slack (2) to the outer and the inner reach.

    The slack is a difference of squared distances, divided by the square of the outer reach. It is negative where the
    foot is out of reach. ``side`` is the side of the inverse's branch. Raises NoClosedFormError for a leg without a
    closed-form inverse.
    """
    leg = derive(table.canonical())
    inverse = leg.inverse
    foot, parameters, side = ca.SX.sym("foot", 3), ca.SX.sym("p", len(leg.parameters)), ca.SX.sym("side")
    names = [inverse.x, inverse.y, inverse.z, *leg.parameters, inverse.side]
    slack = [bound / inverse.reach[1] ** 2 for bound in (inverse.outer, inverse.inner)]
    found = with_functions(names, slack, _FUNCTIONS)(*ca.vertsplit(foot), *ca.vertsplit(parameters), side)
    return ca.Function("reach", [foot, parameters, side], [ca.vertcat(*found)])


@lru_cache(maxsize=64)
def leg_constants(robot: Robot) -> Array:
    """Constants (L, n) of each leg: the parameters of its table, masses and centres of mass.

    A mass [kg] is that of all parts between a joint and the next one. Its centre of mass [m] is in the joint's frame.
    """
    masses = [robot.segments[name].mass for name in SEGMENT_NAMES]
    total = np.array([*masses[:-1], masses[-1] + robot.foot.mass])
    rows = []
    for leg in range(robot.num_legs):
        places = robot.segment_poses(leg)
        moments = [
            m * (T[:3, :3] @ robot.segments[name].center_of_mass)
            for m, T, name in zip(masses, places, SEGMENT_NAMES, strict=True)
        ]
        behind = robot.fixed_poses(leg)[-1]
        moments[-1] = moments[-1] + robot.foot.mass * (behind[:3, :3] @ robot.foot.center_of_mass + behind[:3, 3])
        centers = np.array(moments) / total[:, None]
        rows.append(np.concatenate([robot.parameters[leg], total, centers.ravel()]))
    return read_only(rows)


def leg_states(robot: Robot, q: NDArray[np.float64]) -> LegStates:
    """Evaluate ``leg_function`` for all legs at the joint angles ``q`` (..., L, 3) [rad]."""
    flat = q.reshape(-1, NUM_JOINTS)
    constants = leg_constants(robot)
    step = robot.num_legs * max(1, _CHUNK // robot.num_legs)
    tiled = np.tile(constants, (min(step, len(flat)) // robot.num_legs, 1))
    parts = [
        _evaluated(robot.table.canonical(), flat[start : start + step], tiled) for start in range(0, len(flat), step)
    ]
    fields = []
    for number, shape in enumerate(_SHAPES.values()):
        stacked = np.concatenate([part[number].T for part in parts]).reshape(*q.shape[:-1], *shape)
        fields.append(stacked.swapaxes(-1, -2) if len(shape) == 2 else stacked)  # CasADi stores matrices by columns
    return LegStates(*fields)


@interrupts_kept()
def _evaluated(table: LegTable, q: Array, constants: Array) -> list[Array]:
    """Outputs (rows, n) of ``leg_function`` for n angles (n, 3); ``constants`` has at least n rows."""
    function = leg_function(table).map(len(q))
    return [np.asarray(value) for value in function(q.T, constants[: len(q)].T)]
