"""Design questions as small nonlinear programs: longest stride, highest step, steepest slope and best posture.

Each question covers a few instants of a walk on a plane that rises along the robot's forward axis. The tripod gait is
that of A section 4.1. At each instant the joint angles, the body pose and the contact forces are variables. The
constraints are the leg's kinematics, the joint limits, the equilibrium, the friction cones (as pyramids of 16 sides,
one edge of which points uphill) and the torque limit. IPOPT (Waechter and Biegler 2006) finds a local optimum. Wherever
it was compared with sampling (notebook ``c1_feasibility``), it was the global optimum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, checked
from hexakin.exceptions import SolverError, UnknownNameError
from hexakin.feasibility.casadi_legs import leg_constants, leg_function, reach_function
from hexakin.kinematics.branches import BRANCH_SIGNS, standing_branch
from hexakin.kinematics.forward import at_contact, forward_kinematics, standing_height
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.robot.model import GRAVITY, Robot
from hexakin.stability.friction_pyramid import pyramid_faces
from hexakin.walking.gait import tripod

STROKES = ("full_stride", "half_stride")
_SLACK = 1e-6  # a constraint with more slack than this is not active
_ACTIVE = 1e-3  # of the largest multiplier: constraints with a smaller multiplier are not named as active
_FACETS = 16
_UNLOADED = 1e-4  # of the weight: a foot with a smaller normal force carries no load
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a phase: the instants that are part of the problem


@checked
@dataclass(frozen=True)
class Design:
    """Result of a design question.

    Parameters
    ----------
    value
        The optimum, in the unit of the question; NaN if there is no feasible solution.
    active
        Names of the constraints that limit the optimum, such as ``"torque, leg 3"``; the strongest comes first.
    variables
        Values of the variables of the question at the optimum, by name, in SI units.
    feasible
        Whether a feasible solution was found. If it is False, the solver has shown only locally that there is none.
    """

    value: float
    active: tuple[str, ...]
    variables: Mapping[str, float]
    feasible: bool


@checked
@interrupts_kept()
def longest_stride(
    robot: Robot,
    body_height: float | None = None,
    slope: float = 0.0,
    *,
    apex: float = 0.03,
    friction: float = 0.9,
    first_phase: Literal["full_stride", "half_stride"] = "full_stride",
) -> Design:
    """Longest stride [m] of the tripod gait A(19)-(23) that reach, joint limits, friction and torque allow.

    Returns a ``Design`` with the stride [m] as its value. Raises InvalidInputError for a value out of its range,
    UnknownNameError for another ``first_phase``, NoClosedFormError for a leg without a closed-form inverse, and
    SolverError if IPOPT fails.

    Parameters
    ----------
    body_height
        Height [m] of the body's origin over the plane; None is that of the standing pose.
    slope
        Slope [rad] of the plane. The body is parallel to it.
    apex
        Height [m] of the swing.
    friction
        Coefficient of friction between feet and plane.
    first_phase
        As in ``PostureController``: the strokes start at the standing footholds (``"full_stride"``), or they are
        centred on them (``"half_stride"``).
    """
    question = _Question(robot, slope, friction, body_height)
    stride = question.free("stride", 0.02, 0.0, 1.0)
    question.walk(stride, apex, first_phase)
    return question.maximise(stride)


@checked
@interrupts_kept()
def highest_step(
    robot: Robot,
    body_height: float | None = None,
    slope: float = 0.0,
    *,
    stride: float = 0.05,
    friction: float = 0.9,
    first_phase: Literal["full_stride", "half_stride"] = "full_stride",
) -> Design:
    """Highest step [m] on which each leg, one at a time, can place its foot at the end of a swing.

    The feet of the other tripod stand on the plane below, and the body keeps its height. Only the foothold is checked,
    not a path to it. ``stride`` [m] is the length of a stroke; ``body_height`` [m], ``slope`` [rad], ``friction``,
    ``first_phase``, the result and the errors are those of ``longest_stride``.
    """
    question = _Question(robot, slope, friction, body_height)
    check_number("stride", stride, at_least=0.0, unit="m")
    height = question.free("height", 0.01, -0.5, 0.5)
    for swinging, start, end in _phases(robot, stride, first_phase):
        for leg in sorted(swinging):
            question.instant(end, set(start) - swinging, lift={leg: height})
    return question.maximise(height)


@checked
@interrupts_kept()
def best_posture(robot: Robot, slope: float = 0.0, *, friction: float = 0.9) -> Design:
    """Posture on a slope with the largest torque margin [N m], with all feet on their standing footholds.

    The torque margin is the torque limit minus the largest joint torque. The variables are the height of the body over
    the plane (``"height"`` [m]), its pitch relative to the plane (``"pitch"`` [rad], positive with the front up) and
    its displacement uphill (``"shift"`` [m]), within the joint limits and the clearance of the torso. ``slope`` [rad]
    is that of the plane, ``friction`` the coefficient of friction. Result and errors are those of ``longest_stride``.
    """
    question = _Question(robot, slope, friction, None)
    torque_margin = question.free("torque_margin", 0.0, -50.0, robot.servo.max_torque)
    # The origin may lie below the ground; the torso may not.
    lowest = min(0.0, -float(robot.torso_corners[:, 2].max()))
    question.height = question.free("height", question.height, lowest, 1.0)
    question.pitch = question.free("pitch", 0.0, -1.0, 1.0)
    question.shift = question.free("shift", 0.0, -0.2, 0.2)
    question.torque_margin = torque_margin
    question.instant(dict.fromkeys(range(robot.num_legs), 0.0), set(range(robot.num_legs)))
    return question.maximise(torque_margin)


@checked
@interrupts_kept()
def steepest_slope(
    robot: Robot,
    body_height: float | None = None,
    *,
    walking: bool = False,
    stride: float = 0.05,
    apex: float = 0.03,
    friction: float = 0.9,
    max_torque: float | None = None,
    first_phase: Literal["full_stride", "half_stride"] = "full_stride",
) -> Design:
    """Steepest slope [rad], up to 80 degrees, on which the robot can stand on all feet or walk up with the tripod gait.

    The body is parallel to the slope. ``walking`` selects walking instead of standing; only then ``stride`` [m],
    ``apex`` [m] and ``first_phase`` are used. ``max_torque`` [N m] replaces the torque limit of the servo.
    ``body_height`` [m], ``friction``, the result and the errors are those of ``longest_stride``.
    """
    question = _Question(robot, 0.0, friction, body_height, max_torque)
    question.slope = question.free("slope", 0.1, 0.0, np.radians(80.0))
    if walking:
        question.walk(stride, apex, first_phase)
    else:
        question.instant(dict.fromkeys(range(robot.num_legs), 0.0), set(range(robot.num_legs)))
    return question.maximise(question.slope)


def _phases(robot: Robot, stride: Any, first_phase: str) -> list[tuple[set[int], dict[int, Any], dict[int, Any]]]:
    """Phases of a cycle: the legs that swing, and the foot positions of all legs at the start and at the end.

    A position is the distance of the foot ahead of its standing foothold, relative to the body.
    """
    if first_phase not in STROKES:
        raise UnknownNameError("first_phase", first_phase, list(STROKES))
    first, second = (set(group) for group in tripod(robot).groups)
    full = first_phase == "full_stride"
    middle = {leg: (0.5 if leg in first else -0.5) if full else 0.0 for leg in first | second}
    front = {leg: (middle[leg] + 0.5) * stride for leg in middle}
    back = {leg: (middle[leg] - 0.5) * stride for leg in middle}
    phases = []
    for swinging in (first, second):
        start = {leg: back[leg] if leg in swinging else front[leg] for leg in middle}
        end = {leg: front[leg] if leg in swinging else back[leg] for leg in middle}
        phases.append((swinging, start, end))
    return phases


@dataclass
class _Question:
    """A nonlinear program that is assembled from instants of a motion.

    Poses are in the plane's frame: its z axis is the plane's normal, and the robot walks uphill. Forces are in units of
    m g.
    """

    robot: Robot
    slope: Any
    friction: float
    body_height: float | None
    max_torque: float | None = None

    def __post_init__(self) -> None:
        robot = self.robot
        check_number("friction", self.friction, at_least=0.0)
        check_number("slope", self.slope, at_least=-np.pi / 2, at_most=np.pi / 2, unit="rad")
        if self.body_height is not None:
            check_number("body_height", self.body_height, unit="m")
        self.height: Any = standing_height(robot) if self.body_height is None else self.body_height
        self.limit = robot.servo.max_torque if self.max_torque is None else self.max_torque
        check_number("max_torque", self.limit, above=0.0, unit="N m")
        self.pitch: Any = 0.0
        self.shift: Any = 0.0
        self.torque_margin: Any = 0.0
        self.footholds = forward_kinematics(robot, robot.standing_q)
        self.cone = pyramid_faces(np.array([self.friction]), _FACETS)[0]
        self.function = leg_function(robot.table.canonical())
        self.reach = reach_function(robot.table.canonical())
        self.named: dict[str, ca.MX] = {}
        self.variables: list[_Variable] = []
        self.rows: list[tuple[str, ca.MX, float, float]] = []
        self.impossible: dict[str, None] = {}  # names of the constraints that no values of the variables can satisfy
        self.loads: dict[int, ca.MX] = {}  # normal forces, by the number of the row that bounds them

    def free(self, name: str, guess: float, low: float, high: float) -> ca.MX:
        """Return a scalar variable that is part of the result."""
        self.named[name] = self._variable(f"range of {name}", [guess], [low], [high])
        return self.named[name]

    def _variable(self, name: str, guess: ArrayLike, low: ArrayLike, high: ArrayLike) -> ca.MX:
        bounds = (np.asarray(values, dtype=float) for values in (guess, low, high))
        variable = _Variable(name, *bounds)
        self.variables.append(variable)
        return variable.symbol

    def _require(self, name: str, expression: Any, low: float, high: float) -> None:
        """Bound an expression; an expression without variables is checked immediately."""
        for row in ca.vertsplit(ca.MX(expression)):
            if not row.is_constant():
                self.rows.append((name, row, low, high))
            elif not low <= float(ca.evalf(row)) <= high:
                self.impossible[name] = None

    def walk(self, stride: Any, apex: float, first_phase: str) -> None:
        """Add both phases of the tripod gait, at a few instants each."""
        check_number("apex", apex, at_least=0.0, unit="m")
        if not isinstance(stride, ca.MX):
            check_number("stride", stride, at_least=0.0, unit="m")
        for swinging, start, end in _phases(self.robot, stride, first_phase):
            for share in _SHARES:
                # A(19)-(21): the inner control points of a swing are a quarter and three quarters ahead.
                swung = 0.75 * share * (1 - share) ** 2 + 2.25 * share**2 * (1 - share) + share**3
                done = {leg: swung if leg in swinging else share for leg in start}
                place = {leg: start[leg] + done[leg] * (end[leg] - start[leg]) for leg in start}
                self.instant(place, set(start) - swinging, lift=dict.fromkeys(swinging, 4 * apex * share * (1 - share)))

    @interrupts_kept()
    def instant(self, place: Mapping[int, Any], carrying: set[int], lift: Mapping[int, Any] | None = None) -> None:
        """Add an instant: each foot's distance ahead of its standing foothold, its height, and the carrying feet."""
        robot, up = self.robot, ca.DM([0.0, 0.0, 1.0])
        forward, right = ca.DM(robot.forward), ca.DM(robot.right)
        c, s = ca.cos(self.pitch), ca.sin(self.pitch)
        R = c * ca.DM.eye(3) + s * ca.skew(right) + (1 - c) * (right @ right.T)
        body = self.shift * forward + self.height * up
        against_gravity = ca.sin(self.slope) * forward + ca.cos(self.slope) * up
        legs = {}
        for leg, ahead in place.items():
            q = self._variable(
                f"joint limits, leg {leg + 1}", robot.standing_q[leg], robot.q_min[leg], robot.q_max[leg]
            )
            state = dict(zip(self.function.name_out(), self.function(q, leg_constants(robot)[leg]), strict=True))
            ground = ca.DM([*self.footholds[leg, :2], 0.0]) + ahead * forward
            raised = (lift or {}).get(leg, 0.0)
            self._require("place", R @ state["foot"] + body - ground - (raised + robot.foot_radius) * up, 0.0, 0.0)
            side = float(BRANCH_SIGNS[standing_branch(robot)[leg], 0])
            stretched = self.reach(state["foot"], robot.parameters[leg], side)
            # Keep 1e-6 of the reach from the boundary: a fully stretched leg has no derivative along itself.
            self._require(f"reach, leg {leg + 1}", stretched, 2e-6, np.inf)
            legs[leg] = (state, ground)
        moments = [state["moment"] for state, _ in legs.values()]
        center = R @ ((robot.torso.mass * ca.DM(robot.torso.center_of_mass) + sum(moments)) / robot.mass) + body
        weight = robot.weight
        total, turning = ca.MX(-against_gravity), ca.MX.zeros(3)
        for leg, (state, ground) in legs.items():
            torque = GRAVITY * ca.reshape(state["moment_slope"], 3, 3).T @ (R.T @ against_gravity)
            if leg in carrying:
                force = self._variable("", [0.0, 0.0, 1.0 / len(carrying)], [-np.inf] * 3, [np.inf] * 3)
                total, turning = total + force, turning + ca.cross(ground - center, force)
                local = ca.vertcat(forward.T @ force, (-right).T @ force, force[2])
                for side in self.cone:
                    self._require(f"friction, leg {leg + 1}", -(ca.DM(side).T @ local), 0.0, np.inf)
                    self.loads[len(self.rows) - 1] = force[2]
                # The contact lies on the foot's sphere, a radius below its centre.
                lever = -robot.foot_radius * (R.T @ up)
                jacobian, axes = (ca.reshape(state[name], 3, 3) for name in ("jacobian", "axes"))
                torque -= weight * at_contact(jacobian, axes, ca.skew(lever)).T @ (R.T @ force)
            for sign in (1.0, -1.0):
                slack = 1.0 - (sign * torque + self.torque_margin) / self.limit
                self._require(f"torque, leg {leg + 1}", slack, 0.0, np.inf)
        self._require("equilibrium", ca.vertcat(total, 10.0 * turning), 0.0, 0.0)
        for corner in robot.torso_corners[::2]:
            point = R @ ca.DM(corner) + body
            self._require("torso clearance", point[2], 0.0, np.inf)

    def maximise(self, goal: ca.MX) -> Design:
        """Maximise ``goal`` under the constraints; raises SolverError if IPOPT fails."""
        nothing = dict.fromkeys(self.named, float("nan"))
        if self.impossible:
            return Design(float("nan"), tuple(self.impossible), nothing, feasible=False)
        symbols = ca.vertcat(*(variable.symbol for variable in self.variables))
        row_low, row_high = (np.array([row[k] for row in self.rows]) for k in (2, 3))
        problem: dict[str, Any] = {"x": symbols, "f": -goal, "g": ca.vertcat(*(row for _, row, _, _ in self.rows))}
        quiet = {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-9, "bound_relax_factor": 0.0}
        options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": quiet}
        guess, low, high = (np.concatenate([getattr(v, of) for v in self.variables]) for of in ("guess", "low", "high"))
        bounds = {"x0": guess, "lbx": low, "ubx": high, "lbg": row_low, "ubg": row_high}
        with interrupts_kept():
            solver = ca.nlpsol("design", "ipopt", problem, options)
            start = {name: ca.DM(values) for name, values in bounds.items()}
        with interrupts_kept():
            found = solver(**start)
        status = solver.stats()["return_status"]
        if status == "Infeasible_Problem_Detected":
            return Design(float("nan"), (), nothing, feasible=False)
        if status not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            raise SolverError(f"design question: IPOPT ended with {status}")
        wanted = ca.vertcat(goal, *self.named.values(), *self.loads.values())
        optimum, *values = np.asarray(ca.Function("values", [symbols], [wanted])(found["x"])).ravel()
        answer, loads = dict(zip(self.named, values, strict=False)), values[len(self.named) :]

        names = [name for name, *_ in self.rows] + [v.name for v in self.variables for _ in v.guess]
        for number, load in zip(self.loads, loads, strict=True):
            if load < _UNLOADED:
                names[number] = names[number].replace("friction", "unloading")
        multipliers = np.abs(np.concatenate([np.asarray(found[key]).ravel() for key in ("lam_g", "lam_x")]))
        at = np.concatenate([np.asarray(found[key]).ravel() for key in ("g", "x")])
        least, most = np.concatenate([row_low, low]), np.concatenate([row_high, high])
        slack = np.minimum(at - least, most - at)
        # Equations always hold, and a constraint with slack does not limit the optimum.
        multipliers[(slack > _SLACK) | (least == most)] = 0.0
        pressure: dict[str, float] = {}
        for name, multiplier in zip(names, multipliers, strict=True):
            pressure[name] = max(pressure.get(name, 0.0), float(multiplier))
        # Of constraints that press alike, to two digits, the first by name comes first, as on every machine.
        ranked = sorted(pressure, key=lambda name: (-float(f"{pressure[name]:.2g}"), name))
        active = tuple(name for name in ranked if pressure[name] > _ACTIVE * pressure[ranked[0]])
        return Design(float(optimum), active, {name: float(v) for name, v in answer.items()}, feasible=True)


class _Variable:
    """A vector of variables with its bounds and a name for them."""

    def __init__(self, name: str, guess: Array, low: Array, high: Array):
        self.name, self.guess, self.low, self.high = name, guess, low, high
        self.symbol = ca.MX.sym("x", len(guess))
