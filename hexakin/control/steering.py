"""Walking by velocity commands: forward, sideways and turning, changed on the way, with any gait.

Feet in stance move against the body, turned about the vertical by the commanded rate; feet in swing are put where the
middle of their next stance will be the standing foothold. A leg whose foot stands at home and is not asked to move does
not swing, so that the robot stops on all feet. A robot that lies on its torso stands up first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_number
from hexakin.control.interface import Command, Observation
from hexakin.control.standing_up import footholds_to_rise_on, lies
from hexakin.exceptions import InvalidInputError
from hexakin.kinematics.forward import contact_jacobian, forward_kinematics, jacobian, joint_axes, standing_height
from hexakin.kinematics.inverse import inverse_kinematics, raise_if_impossible
from hexakin.robot.model import Robot, check_robot
from hexakin.transforms import axis_rotation, cross_matrix
from hexakin.walking.gait import Gait, gait_of

_AT_HOME = 1e-4  # [m]
_STILL = 1e-6  # [m/s], at a foot


class Twist(NamedTuple):
    """Velocity of the body: ``forward`` and ``left`` [m/s] along its own axes, ``turn`` [rad/s], counter-clockwise."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


STILL = Twist()


@dataclass(frozen=True)
class SteeringController:
    """A controller that follows velocity commands; for ``simulate`` and ``feasibility.commanded_walk``.

    Raises InvalidInputError or UnknownNameError for parameters out of range and for a gait that leaves too few legs on
    the ground; UnreachableError or JointLimitError, naming the leg, if a constant command's strokes cannot be made, or,
    when it begins, if the feet of a robot that lies cannot be put on the ground.

    Parameters
    ----------
    robot
        The robot to walk.
    twist
        The command, or a function of time [s] that returns it.
    gait
        By name (``hexakin.gait.GAITS``) or a Gait.
    cycle_duration
        Of the gait [s].
    apex
        Rise of a swing [m].
    body_height
        Of the body's origin over the ground [m]; None is the standing height.
    response
        Cycles in which the followed command changes by as much as the largest one so far: legs start from home,
        where the last to swing would otherwise be dragged through a whole stroke.
    rise_duration
        Time [s] in which the feet are brought from where they are to the standing footholds before walking begins. If
        the robot lies, they are put on the ground, all at once, in half of this time, and lift the body in the other.
    """

    robot: Robot
    twist: Twist | Callable[[float], Twist] = STILL
    gait: str | Gait = "tripod"
    cycle_duration: float = 2.0
    apex: float = 0.03
    body_height: float | None = None
    response: float = 1.5
    rise_duration: float = 1.0
    home: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_robot(self.robot)
        object.__setattr__(self, "gait", gait_of(self.robot, self.gait))
        check_number("cycle_duration", self.cycle_duration, above=0.0)
        check_number("apex", self.apex, at_least=0.0, unit="m")
        check_number("rise_duration", self.rise_duration, at_least=0.0)
        check_number("response", self.response, above=0.0, unit="cycles")
        if self.body_height is not None:
            check_number("body_height", self.body_height, above=0.0, unit="m")
        home = forward_kinematics(self.robot, self.robot.standing_q)
        height = standing_height(self.robot) if self.body_height is None else self.body_height
        home[:, 2] = self.robot.foot_radius - height
        object.__setattr__(self, "home", home)
        if not callable(self.twist):
            object.__setattr__(self, "twist", _checked(self.twist))
            self._refuse(self.twist)

    @property
    def phases_per_cycle(self) -> int:
        """Gait phases in a cycle."""
        return self._gait.phases_per_cycle

    @property
    def _gait(self) -> Gait:
        assert isinstance(self.gait, Gait)
        return self.gait

    def command_at(self, time: float) -> Twist:
        """Return the command at a time [s]."""
        return _checked(self.twist(time)) if callable(self.twist) else self.twist

    def parameters(self) -> dict[str, Any]:
        """Every parameter but the robot, by name."""
        gait = self._gait
        twist = getattr(self.twist, "__qualname__", "a function") if callable(self.twist) else self.twist._asdict()
        named = {"gait": gait.name, "duty_factor": gait.duty_factor, "offsets": list(gait.offsets), "twist": twist}
        rest = ("cycle_duration", "apex", "body_height", "response", "rise_duration")
        return {**named, **{name: getattr(self, name) for name in rest}}

    def start(self, observation: Observation, control_rate: float) -> SteeringRun:
        """Begin a run that is asked for a command ``control_rate`` [Hz] times a second."""
        return SteeringRun(self, observation, control_rate)

    def velocity(self, twist: Twist, p_body_foot: Array) -> Array:
        """Velocity (L, 3) [m/s] against the body of ground points (L, 3) [m] in the body frame."""
        robot = self.robot
        return -(
            twist.forward * robot.forward - twist.left * robot.right + np.cross([0.0, 0.0, twist.turn], p_body_foot)
        )

    def landing(self, twist: Twist) -> Array:
        """Where feet are put down (L, 3) [m]: half a stance ahead of home."""
        return _moved(self, twist, self.home, -0.5 * self._gait.duty_factor * self.cycle_duration)

    def _refuse(self, twist: Twist) -> None:
        """Raise if the two ends of a stroke or the top of a swing are impossible; time counts from mid-stance."""
        half = 0.5 * self._gait.duty_factor * self.cycle_duration
        ends = np.array([*(_moved(self, twist, self.home, t) for t in (-half, half)), self.home + [0, 0, self.apex]])
        solution = inverse_kinematics(self.robot, ends)
        raise_if_impossible(self.robot, solution, np.array([-half, half, 0.0]))


class SteeringRun:
    """One run of a SteeringController; the state that it carries from tick to tick."""

    def __init__(self, controller: SteeringController, observation: Observation, control_rate: float):
        self._controller, self._dt = controller, 1.0 / control_rate
        self._q = np.array(observation.q)
        self._feet = forward_kinematics(controller.robot, self._q)
        self._lifted = self._feet.copy()  # where each swing began
        self._swings = np.zeros(controller.robot.num_legs, dtype=bool)
        self._twist, self._largest = Twist(), np.zeros(3)
        self._time = -controller.rise_duration
        self._touchdown = None
        if controller.rise_duration > 0.0 and lies(controller.robot, observation.height):
            ground = controller.robot.foot_radius - observation.height
            self._touchdown = footholds_to_rise_on(controller.robot, controller.home, ground)

    def command(self, observation: Observation) -> Command:
        """Return the command of this tick."""
        c = self._controller
        self._time += self._dt
        if self._time <= 0.0:
            self._feet = self._rising()
            return self._answer(np.zeros(c.robot.num_legs, dtype=bool), 0)
        self._follow(c.command_at(self._time))
        cycle = self._time / c.cycle_duration
        share = c._gait.swing_share(cycle)
        landing = c.landing(self._twist)
        begins = ~np.isnan(share) & np.isnan(c._gait.swing_share(cycle - self._dt / c.cycle_duration))
        # At the first tick, swings that begin now; a leg that would be in the middle of one waits for its next.
        duration = (1.0 - c._gait.duty_factor) * c.cycle_duration
        begins |= (self._time <= self._dt + 1e-12) & (np.nan_to_num(share, nan=1.0) * duration <= self._dt + 1e-9)
        needed = np.linalg.norm(self._feet - c.home, axis=1) > _AT_HOME
        needed |= np.linalg.norm(c.velocity(self._twist, c.home), axis=1) > _STILL
        landed = self._swings & np.isnan(share)
        self._swings = np.where(begins, needed, self._swings & ~np.isnan(share))
        stance = forward_kinematics(c.robot, self._rolled())
        # Feet lift off, and land, between this tick and the last one.
        held = np.clip(1.0 - np.nan_to_num(share) * duration / self._dt, 0.0, 1.0)[:, None]
        self._lifted = np.where(begins[:, None], self._feet + held * (stance - self._feet), self._lifted)
        for leg in np.flatnonzero(landed):
            since = np.mod(cycle - c._gait.offsets[leg] - (1.0 - c._gait.duty_factor) + 1e-9, 1.0) * c.cycle_duration
            stance[leg] = _moved(c, self._twist, landing, since)[leg]
        leaving, meeting = (duration * c.velocity(self._twist, feet) for feet in (self._lifted, landing))
        swing = _arc(self._lifted, landing, leaving, meeting, np.nan_to_num(share), c.apex)
        self._feet = np.where(self._swings[:, None], swing, stance)
        phase = int(np.floor(cycle * c.phases_per_cycle + 1e-9))
        return self._answer(self._swings, phase)

    def _rising(self) -> Array:
        """Feet (L, 3) on their way to the standing footholds."""
        c = self._controller
        if self._touchdown is None:
            left = max(-self._time, 0.0) / self._dt
            return self._feet + (c.home - self._feet) / (left + 1.0)
        share = 2.0 * (1.0 + self._time / c.rise_duration)
        if share < 1.0:
            still = np.zeros_like(self._lifted)
            return _arc(self._lifted, self._touchdown, still, still, np.full(c.robot.num_legs, share), c.apex)
        s = min(share - 1.0, 1.0)
        rise = (c.home - self._touchdown) * [0.0, 0.0, 1.0]
        return self._touchdown + s**2 * (3.0 - 2.0 * s) * rise

    def _follow(self, wanted: Twist) -> None:
        """Move the command that is followed towards the one that is given."""
        c = self._controller
        self._largest = np.maximum(self._largest, np.abs(wanted))
        step = self._largest * self._dt / (c.response * c.cycle_duration)
        self._twist = Twist(*(self._twist + np.clip(np.subtract(wanted, self._twist), -step, step)))

    def _rolled(self) -> Array:
        """Angles (L, 3) a tick later of legs in stance: their spherical feet roll on the ground without slipping.

        The point of the foot that touches the ground is at rest, and so its centre is not.
        """
        robot, up = self._controller.robot, np.array([0.0, 0.0, 1.0])
        q = self._q
        for part in (0.5, 1.0):  # the midpoint rule
            lever = -robot.foot_radius * up
            slide = contact_jacobian(jacobian(robot, q), joint_axes(robot, q), cross_matrix(lever))
            contact = forward_kinematics(robot, q) + lever
            # The pseudo-inverse: a leg that is stretched straight gives what it can.
            rate = (np.linalg.pinv(slide, rcond=1e-6) @ self._controller.velocity(self._twist, contact)[..., None])[
                ..., 0
            ]
            q = self._q + part * self._dt * rate
        return q

    def _answer(self, swinging: NDArray[np.bool_], phase: int) -> Command:
        robot = self._controller.robot
        solution = inverse_kinematics(robot, self._feet)
        q = np.where(solution.reachable[:, None], solution.q, self._q)
        self._q = np.clip(q, robot.q_min, robot.q_max)
        return Command(self._q, ~swinging, phase, limited=~solution.within_limits)


def _checked(twist: Any) -> Twist:
    try:
        values = [float(value) for value in twist]
    except (TypeError, ValueError) as error:
        raise InvalidInputError(
            f"twist: expected hexakin.steering.Twist(forward, left, turn), got {twist!r:.80}"
        ) from error
    if len(values) != 3 or not np.isfinite(values).all():
        raise InvalidInputError(f"twist: expected three finite numbers (forward, left, turn), got {twist!r:.80}")
    return Twist(*values)


def _moved(controller: SteeringController, twist: Twist, feet: Array, duration: float) -> Array:
    """Ground points (L, 3) after the body has moved with a constant twist for a duration [s], in the body frame."""
    robot, angle = controller.robot, twist.turn * duration
    # The body's path is an arc: its mean direction is turned by half the angle, its chord sinc times its length.
    chord = duration * np.sinc(angle / (2.0 * np.pi)) * (twist.forward * robot.forward - twist.left * robot.right)
    way = axis_rotation([0.0, 0.0, 1.0], 0.5 * angle) @ chord
    return (feet - way) @ axis_rotation([0.0, 0.0, 1.0], angle)


def _arc(start: Array, end: Array, start_slope: Array, end_slope: Array, share: Array, apex: float) -> Array:
    """Swing (L, 3) at a share of it: a cubic between these slopes, so that feet leave and meet the ground at rest."""
    s = share[:, None]
    u = 1.0 - s
    over = u**2 * ((1.0 + 2.0 * s) * start + s * start_slope) + s**2 * ((3.0 - 2.0 * s) * end - u * end_slope)
    return over + 64.0 * s**3 * u**3 * [0.0, 0.0, apex]
