"""Checks whether a motion can be carried out: reach, limits, speed, clearance, balance, friction and torque.

Balance, friction and torque are those of a robot at rest (Bretl and Lall, "Testing static equilibrium for legged
robots", IEEE Trans. Robotics 24(4), 2008); the slack of the balance is A(33) of the centre of mass.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_number, checked
from hexakin.exceptions import InvalidInputError
from hexakin.feasibility.casadi_legs import leg_states
from hexakin.feasibility.forces import ForceDistribution, distribute, friction_needed
from hexakin.feasibility.statics import static_problem
from hexakin.kinematics.inverse import inverse_kinematics
from hexakin.motion.clearance import foot_gaps, torso_gaps
from hexakin.motion.motion import Motion, motion_of
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.numerics.display import html_table, short_repr
from hexakin.robot.model import Robot
from hexakin.stability.polygon import polygon_margins
from hexakin.terrain.base import Terrain, gaps
from hexakin.terrain.leg_curves import LegCurves
from hexakin.transforms import transform_points

_ROUNDING = 1e-9  # in the constraint's unit: a pose exactly at its limit satisfies it
_TIE = 1e-6  # in the constraint's unit: instants this close are equally bad; the first is named, on every machine


@checked
@dataclass(frozen=True, eq=False)
class Constraint:
    """One constraint over a motion, as ``check`` returns it.

    Parameters
    ----------
    name
        Name of the constraint, such as ``"joint limits"``.
    unit
        Unit of ``slack`` and ``worst``; empty for a coefficient of friction.
    slack
        Distances to the constraint's bound in [unit]: (n, L), or (n,) for a constraint of the whole robot. They are
        negative where the constraint is violated, and NaN where it does not apply.
    worst
        Smallest slack, in ``unit``.
    time, leg
        Time [s] and leg (1-based; None for the whole robot) of the smallest slack.
    satisfied
        Whether the constraint holds at every instant; None if it was not checked.
    mend
        A change that would satisfy a violated constraint, or the reason why it was not checked; else empty.
    """

    name: str
    unit: str
    slack: Array
    worst: float
    time: float
    leg: int | None
    satisfied: bool | None
    mend: str = ""

    __repr__ = short_repr

    @property
    def margins(self) -> Array:
        """Old name of ``slack``, with a DeprecationWarning."""
        warnings.warn("Constraint.margins is now called slack", DeprecationWarning, stacklevel=2)
        return self.slack


@checked
@dataclass(frozen=True, eq=False)
class FeasibilityReport:
    """Result of ``check``: the constraints and the forces that hold the robot during the motion.

    ``constraints`` maps names to constraints. ``forces`` is a ``ForceDistribution``; at instants at which a leg does
    not reach its target its values are NaN and its outcome is "". ``motion`` is the motion that was checked.
    """

    constraints: Mapping[str, Constraint]
    forces: ForceDistribution
    motion: Motion

    def __repr__(self) -> str:
        return f"FeasibilityReport({self._verdict()}; {len(self.motion.time)} instants)"

    def _repr_html_(self) -> str:
        """Return a table of the constraints, for a notebook."""
        said = {True: "yes", False: "NO", None: "not checked"}
        rows = [
            (
                c.name,
                said[c.satisfied],
                *(
                    ("",) * 4
                    if c.satisfied is None
                    else (f"{c.worst:+.4g}", c.unit, f"{c.time:.4g}", "all" if c.leg is None else str(c.leg))
                ),
                c.mend,
            )
            for c in self.constraints.values()
        ]
        return html_table(
            repr(self), ("constraint", "satisfied", "smallest slack", "unit", "time [s]", "leg", ""), rows
        )

    @property
    def feasible(self) -> bool:
        """Whether every constraint that was checked holds at every instant."""
        return all(constraint.satisfied is not False for constraint in self.constraints.values())

    @property
    def binding(self) -> tuple[str, ...]:
        """Names of the constraints that are violated."""
        return tuple(name for name, constraint in self.constraints.items() if constraint.satisfied is False)

    def _verdict(self) -> str:
        return "feasible" if self.feasible else f"not feasible: {', '.join(self.binding)}"

    def __str__(self) -> str:
        lines = [self._verdict()]
        for c in self.constraints.values():
            if c.satisfied is None:
                lines.append(f"  {c.name:16} not checked: {c.mend}")
                continue
            where = "" if c.leg is None else f", leg {c.leg}"
            mark = "ok " if c.satisfied else "NO "
            said = f"; {c.mend}" if c.mend else ""
            lines.append(f"  {c.name:16} {mark} smallest slack {c.worst:+.4g} {c.unit} at {c.time:.4g} s{where}{said}")
        return "\n".join(lines)


@checked
def check(
    robot: Robot,
    motion: Motion | WalkPlan | Recording,
    terrain: Terrain | LegCurves,
    *,
    friction: float = 0.9,
    facets: int = 16,
    clearance: float = 0.0,
    contact_tolerance: float = 1e-2,
) -> FeasibilityReport:
    """Check at every instant of a motion whether the legs can carry it out and the ground can hold the robot.

    The robot is treated as at rest at every instant: there are no inertia forces. The contact forces are those of the
    least joint torque (``distribute``).

    Returns a ``FeasibilityReport``. Raises InvalidInputError or UnknownNameError for an argument that cannot be used,
    and SolverError if a solver fails.

    Parameters
    ----------
    motion
        A plan (``plan_walk``), a controller's commands (``commanded_walk``), a recording or any ``Motion``.
    terrain
        The terrain of the motion. Paper B's curves give the height at the feet only, so that knees and torso are not
        checked on them.
    friction
        Coefficient of friction between feet and ground.
    facets
        Number of sides of the pyramids that replace the friction cones.
    clearance
        Smallest allowed distance [m] from the ground to the knees, to the torso and to the feet in the air.
    contact_tolerance
        Largest allowed distance [m] of a foot that carries load from the ground, above or below it. The default is
        above the largest distance in walks that are right: planned 1e-17 m, recorded with either engine 1.1 mm,
        commanded 1.7 mm (ATHENA, 20 Hz) and 7.7 mm (PhantomX, wave gait, 10 Hz).
    """
    check_number("clearance", clearance, at_least=0.0, unit="m")
    check_number("contact_tolerance", contact_tolerance, at_least=0.0, unit="m")
    given = motion_of(robot, motion)
    reached: NDArray[np.bool_] = np.asarray(np.isfinite(given.q).all(axis=-1))
    q = np.where(reached[..., None], given.q, robot.standing_q)
    states = leg_states(robot, q)
    found = [_reach(robot, given, reached), _limits(robot, given, reached), _speed(robot, given)]
    gap = _foot_gaps(robot, given, terrain)
    found += [_contact(given, gap, contact_tolerance), *_clearances(robot, given, terrain, gap, states.knee, clearance)]
    whole: NDArray[np.bool_] = np.asarray(reached.all(axis=1))
    forces = _forces(robot, given, q, whole, terrain, friction, facets)
    found += _statics(robot, given, forces, terrain, friction, facets)
    return FeasibilityReport({constraint.name: constraint for constraint in found}, forces, given)


def _constraint(
    name: str, unit: str, slack: Array, motion: Motion, mend: str, violated: NDArray[np.bool_] | None = None
) -> Constraint:
    """Find the smallest slack; ``mend`` is a text with {short}, the largest violation as a positive number."""
    if not np.isfinite(slack).any():
        return _unchecked(name, unit, "it applies at no instant", slack)
    bad = slack < -_ROUNDING if violated is None else violated
    ranked = np.where(bad, slack, np.inf) if bad.any() else slack
    least = float(np.nanmin(ranked))
    worst = least if abs(least) > _ROUNDING else 0.0
    place = np.unravel_index(int(np.argmax(ranked <= least + _TIE)), slack.shape)
    leg = int(place[1]) + 1 if slack.ndim == 2 else None
    said = mend.format(short=f"{max(-worst, 0.0):.3g}", leg=leg) if bad.any() else ""
    return Constraint(name, unit, slack, worst, float(motion.time[place[0]]), leg, not bad.any(), said)


def _unchecked(name: str, unit: str, reason: str, slack: Array) -> Constraint:
    """Return a constraint that was not checked, for ``reason``; ``slack`` is all NaN."""
    return Constraint(name, unit, slack, worst=float("nan"), time=float("nan"), leg=None, satisfied=None, mend=reason)


def _reach(robot: Robot, motion: Motion, reached: NDArray[np.bool_]) -> Constraint:
    solution = inverse_kinematics(robot, motion.p_body_foot)
    slack = np.minimum(solution.distance - solution.reach[..., 0], solution.reach[..., 1] - solution.distance)
    lost = ~solution.reachable | ~reached
    slack = np.where(lost, np.minimum(slack, 0.0), np.maximum(slack, 0.0))
    return _constraint("reach", "m", slack, motion, "bring the target of leg {leg} {short} m nearer", lost)


def _limits(robot: Robot, motion: Motion, reached: NDArray[np.bool_]) -> Constraint:
    with np.errstate(invalid="ignore"):
        slack = np.minimum(motion.q - robot.q_min, robot.q_max - motion.q).min(axis=-1)
    bad = (slack < -_ROUNDING) | (motion.clipped & reached)
    mend = "leg {leg} needs {short} rad more, a shorter stride or another height"
    if (motion.clipped & ~(slack < -_ROUNDING)).any():
        mend += " (targets were clipped to the limits)"
    return _constraint(
        "joint limits", "rad", np.where(motion.clipped, np.minimum(slack, 0.0), slack), motion, mend, bad
    )


def _speed(robot: Robot, motion: Motion) -> Constraint:
    limit, slack = robot.servo.max_speed, np.full(motion.q.shape[:2], np.nan)
    if limit is None:
        return _unchecked("joint speed", "rad/s", "the robot's file gives no servo.max_speed", slack)
    speed = np.abs(np.diff(motion.q, axis=0)).max(axis=-1) / np.diff(motion.time)[:, None]
    slack[1:] = limit - speed
    fastest = float(np.nanmax(speed)) if np.isfinite(speed).any() else limit
    return _constraint("joint speed", "rad/s", slack, motion, f"walk {fastest / limit:.2f} times slower")


def _foot_gaps(robot: Robot, motion: Motion, terrain: Terrain | LegCurves) -> Array:
    """Return the distance (n, L) [m] from each foot to the ground, negative if the foot is in the ground."""
    feet = transform_points(motion.T_world_body, motion.p_body_foot)
    if not isinstance(terrain, LegCurves):
        return foot_gaps(robot, terrain, feet)
    if motion.ground_height is None:
        raise InvalidInputError(
            "terrain: paper B's curves can be used with plans only; this motion has no heights of the ground"
        )
    return feet[..., 2] - motion.ground_height - robot.foot_radius


def _contact(motion: Motion, gap: Array, tolerance: float) -> Constraint:
    away = np.abs(gap)
    if motion.carrying_since:
        away[1:] = np.minimum(away[1:], away[:-1])
    held = motion.carrying & np.isfinite(motion.q).all(axis=-1)  # a foot out of reach violates the reach
    slack = np.where(held, tolerance - away, np.nan)
    farthest = np.max(away, where=held, initial=0.0)
    mend = f"leg {{leg}} carries load, but its foot is {farthest:.3g} m from the ground: is the terrain another one?"
    return _constraint("ground contact", "m", slack, motion, mend)


def _clearances(
    robot: Robot, motion: Motion, terrain: Terrain | LegCurves, gap: Array, knee: Array, clearance: float
) -> list[Constraint]:
    slack = np.where(motion.carrying, np.nan, gap - clearance)
    mend = "raise the swing of leg {leg} by {short} m"
    found = [_constraint("foot clearance", "m", slack, motion, mend, slack < -motion.touch)]
    if isinstance(terrain, LegCurves):
        said, none = "paper B's curves have no ground away from the feet", np.full(slack.shape, np.nan)
        return found + [_unchecked(name, "m", said, none) for name in ("knee clearance", "torso clearance")]
    thickness = 0.5 * float(max(robot.segments[name].size[1:].max() for name in ("femur", "tibia")))
    knees = gaps(terrain, transform_points(motion.T_world_body, knee)) - thickness - clearance
    knees = np.where(np.isfinite(motion.q).all(axis=-1), knees, np.nan)
    found.append(
        _constraint("knee clearance", "m", knees, motion, "raise the body or the knee of leg {leg} by {short} m")
    )
    torso = torso_gaps(robot, terrain, motion.T_world_body) - clearance
    found.append(_constraint("torso clearance", "m", torso, motion, "raise the body by {short} m"))
    return found


def _normals(motion: Motion, terrain: Terrain | LegCurves) -> Array:
    if isinstance(terrain, LegCurves):
        return np.broadcast_to([0.0, 0.0, 1.0], motion.p_body_foot.shape)
    feet = transform_points(motion.T_world_body, motion.p_body_foot)
    return terrain.normal(feet[..., 0], feet[..., 1])


def _forces(
    robot: Robot, motion: Motion, q: Array, whole: NDArray[np.bool_], terrain: Terrain | LegCurves,
    friction: float, facets: int,
) -> ForceDistribution:  # fmt: skip
    """Forces at the instants at which all legs reach their targets; elsewhere NaN, with the outcome ""."""
    part = distribute(
        robot, motion.T_world_body[whole], q[whole], motion.carrying[whole], _normals(motion, terrain)[whole],
        friction=friction, facets=facets,
    )  # fmt: skip

    def spread(values: Any, blank: float | str) -> Any:
        full = np.full((len(whole), *values.shape[1:]), blank, dtype=values.dtype)
        full[whole] = values
        return full

    nan = float("nan")
    return ForceDistribution(
        spread(part.outcome, ""), spread(part.force, nan), spread(part.torque, nan), spread(part.cost, nan),
        spread(part.torque_needed, nan), spread(part.center_of_mass, nan),
    )  # fmt: skip


def _statics(
    robot: Robot, motion: Motion, forces: ForceDistribution, terrain: Terrain | LegCurves, friction: float, facets: int
) -> list[Constraint]:
    normals = _normals(motion, terrain)
    contacts = transform_points(motion.T_world_body, motion.p_body_foot) - robot.foot_radius * normals
    above = polygon_margins(forces.center_of_mass[:, :2], contacts[..., :2], motion.carrying)
    tips = forces.outcome == "support"
    # Where the robot tips, the slack is at most zero, even if the support polygon contains the centre of mass.
    above = np.where(tips, np.minimum(np.nan_to_num(above, nan=-np.inf), 0.0), above)
    fewest = int(motion.carrying.sum(axis=1).min())
    mend = "move the body {short} m over its feet, or let more feet carry"
    if fewest < 3:
        mend = f"only {fewest} feet carry load at some instant: no static balance without three"
    balance = _constraint("balance", "m", np.where(np.isinf(above), -robot.foot_radius, above), motion, mend, tips)

    normal_force = np.einsum("nli,nli->nl", forces.force, normals)
    tangential = np.linalg.norm(forces.force - normal_force[..., None] * normals, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slack = np.where(normal_force > 1e-6 * robot.weight, friction - tangential / normal_force, np.nan)
    slides = forces.outcome == "friction"
    mend, legs = "", np.broadcast_to(slides[:, None], slack.shape)
    if slides.any():
        needed = np.full(len(slides), np.nan)
        states = leg_states(robot, np.nan_to_num(motion.q))
        problem = static_problem(
            robot, motion.T_world_body, states, motion.carrying, normals, friction=friction, facets=facets,
            torque_unit=robot.servo.max_torque,
        )  # fmt: skip
        needed[slides] = friction_needed(problem.at(np.flatnonzero(slides)))
        slack = np.where(legs, (friction - needed)[:, None], slack)
        mend = f"the ground needs a friction of {np.nanmax(needed):.3g}, or less slope under the feet"
    slip = _constraint("friction", "", slack, motion, mend, legs)

    weak = forces.outcome == "torque"
    torque = robot.servo.max_torque - np.abs(forces.torque).max(axis=-1)
    torque = np.where(weak[:, None], (robot.servo.max_torque - forces.torque_needed)[:, None], torque)
    needed_most = np.nanmax(forces.torque_needed) if weak.any() else 0.0
    lighter = robot.servo.max_torque / max(needed_most, 1e-9)
    said = f"servos of {needed_most:.3g} N m, {lighter:.2f} times the weight, or more feet on the ground"
    strength = _constraint("torque", "N m", torque, motion, said, np.broadcast_to(weak[:, None], torque.shape))
    return [balance, slip, strength]
