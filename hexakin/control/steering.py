"""Walking by velocity commands: forward, sideways and turning, with any gait.

The command may change during the walk. In the body frame, feet in stance move opposite to the commanded motion of the
body. Feet in swing land where the middle of their next stance is the standing foothold. A leg that stands on its
standing foothold while the command is zero does not swing, so that the robot stops on all feet. A robot that lies on
its torso stands up first. The method is hexakin's own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_array, check_function, check_number, check_shape, checked
from hexakin.control.interface import Command, Observation
from hexakin.control.standing_up import footholds_to_rise_on, lies
from hexakin.exceptions import InvalidInputError, shown
from hexakin.kinematics.forward import contact_jacobian, forward_kinematics, jacobian, joint_axes, standing_height
from hexakin.kinematics.inverse import inverse_kinematics, raise_if_impossible
from hexakin.numerics.display import short_repr
from hexakin.robot.model import Robot
from hexakin.transforms import axis_rotation, cross_matrix
from hexakin.walking.gait import LONGEST_PHASE, Gait, gait_of

_AT_HOME = 1e-4  # [m] A foot that is closer to its standing foothold need not swing.
_STILL = 1e-6  # [m/s] A foot whose commanded speed is lower need not swing.


class Twist(NamedTuple):
    """Velocity command of the body, in the body frame.

    ``forward`` and ``left`` are speeds [m/s] in these directions; ``turn`` is the turning rate [rad/s],
    counter-clockwise seen from above.
    """

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


STILL = Twist()


@checked
@dataclass(frozen=True)
class SteeringController:
    """A controller that follows velocity commands; for ``simulate`` and ``feasibility.commanded_walk``.

    Raises InvalidInputError for a number out of its range and for a gait that leaves too few legs on the ground, and
    UnknownNameError for an unknown gait. Raises UnreachableError or JointLimitError, which name the leg, if the legs
    cannot make the strokes of a constant command; ``start`` raises them if the feet of a lying robot cannot reach
    footholds on the ground.

    Parameters
    ----------
    robot
        The robot that walks.
    twist
        The velocity command, or a function that returns it at a time [s].
    gait
        A Gait, or the name of one (``hexakin.gait.GAITS``).
    cycle_duration
        Duration of a gait cycle [s].
    apex
        Height of a swing [m].
    body_height
        Height of the body's origin above the ground [m]; None means the standing height.
    response
        Limits how fast the controller follows a new command: a change as large as the largest command so far takes
        this number of cycles. At the start all feet are on their standing footholds; without this limit the last legs
        to swing would be in stance for a whole stroke from there.
    rise_duration
        Time [s] in which the feet move from where they are to the standing footholds, before the walk begins. If the
        robot lies, all feet move to the ground in the first half of this time, and lift the body in the second half.
    home
        Not an argument: the standing footholds (L, 3) [m] in the body frame, on level ground.
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

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "gait", gait_of(self.robot, self.gait))
        check_number("cycle_duration", self.cycle_duration, above=0.0, at_most=LONGEST_PHASE, unit="s")
        check_number("apex", self.apex, at_least=0.0, unit="m")
        check_number("rise_duration", self.rise_duration, at_least=0.0, at_most=LONGEST_PHASE, unit="s")
        check_number("response", self.response, above=0.0, unit="cycles")
        if self.body_height is not None:
            check_number("body_height", self.body_height, above=0.0, unit="m")
        home = forward_kinematics(self.robot, self.robot.standing_q)
        height = standing_height(self.robot) if self.body_height is None else self.body_height
        home[:, 2] = self.robot.foot_radius - height
        object.__setattr__(self, "home", home)
        if callable(self.twist):
            check_function("twist", self.twist, "time")
        else:
            object.__setattr__(self, "twist", _checked(self.twist))
            self._refuse(self.twist)

    @property
    def phases_per_cycle(self) -> int:
        """Number of gait phases in a cycle."""
        return self._gait.phases_per_cycle

    @property
    def _gait(self) -> Gait:
        assert isinstance(self.gait, Gait)
        return self.gait

    @checked
    def command_at(self, time: float) -> Twist:
        """Return the command at ``time`` [s].

        Raises InvalidInputError if the function of time returns anything but three finite numbers.
        """
        check_number("time", time, unit="s")
        return _checked(self.twist(time)) if callable(self.twist) else self.twist

    def parameters(self) -> dict[str, Any]:
        """Return all parameters except the robot, by name."""
        gait = self._gait
        twist = getattr(self.twist, "__qualname__", "a function") if callable(self.twist) else self.twist._asdict()
        named = {"gait": gait.name, "duty_factor": gait.duty_factor, "offsets": list(gait.offsets), "twist": twist}
        rest = ("cycle_duration", "apex", "body_height", "response", "rise_duration")
        return {**named, **{name: getattr(self, name) for name in rest}}

    @checked
    def start(self, observation: Observation, control_rate: float) -> SteeringRun:
        """Begin a run at ``observation``; its ``command`` is called ``control_rate`` [Hz] times per second."""
        return SteeringRun(self, observation, control_rate)

    @checked
    def velocity(self, twist: Twist, p_body_foot: Array) -> Array:
        """Velocity (L, 3) [m/s] of points of the ground relative to the body, in the body frame.

        The body moves with ``twist``; ``p_body_foot`` (L, 3) [m] are the points in the body frame.
        """
        robot, command = self.robot, _checked(twist)
        points = check_array("p_body_foot", p_body_foot, (3,))
        sideways = command.left * robot.right
        return -(command.forward * robot.forward - sideways + np.cross([0.0, 0.0, command.turn], points))

    @checked
    def landing(self, twist: Twist) -> Array:
        """Points (L, 3) [m] in the body frame at which swings end: half a stroke ahead of the standing footholds.

        A foot that stays on the ground there, while the body moves with ``twist``, is at its standing foothold in the
        middle of the stance.
        """
        return _moved(self, _checked(twist), self.home, -0.5 * self._gait.duty_factor * self.cycle_duration)

    def _refuse(self, twist: Twist) -> None:
        """Raise if the legs cannot reach the two ends of a stroke or the top of a swing.

        The times in the error message count from the middle of the stance.
        """
        half = 0.5 * self._gait.duty_factor * self.cycle_duration
        ends = np.array([*(_moved(self, twist, self.home, t) for t in (-half, half)), self.home + [0, 0, self.apex]])
        solution = inverse_kinematics(self.robot, ends)
        raise_if_impossible(self.robot, solution, np.array([-half, half, 0.0]))


@checked
class SteeringRun:
    """One run of a SteeringController; it keeps the state from tick to tick.

    ``controller`` is the SteeringController, ``observation`` the first one, and ``control_rate`` [Hz] the number of
    commands per second. Raises UnreachableError or JointLimitError, which name the leg, if the feet of a lying robot
    cannot reach footholds on the ground.
    """

    def __init__(self, controller: SteeringController, observation: Observation, control_rate: float):
        self._controller, self._dt = controller, 1.0 / control_rate
        self._q = np.array(observation.q)
        self._feet = forward_kinematics(controller.robot, self._q)
        self._lifted = self._feet.copy()  # position of each foot at the start of its last swing
        self._swings = np.zeros(controller.robot.num_legs, dtype=bool)
        self._twist, self._largest = Twist(), np.zeros(3)
        self._time = -controller.rise_duration
        self._touchdown = None
        if controller.rise_duration > 0.0 and lies(controller.robot, observation.height):
            ground = controller.robot.foot_radius - observation.height
            self._touchdown = footholds_to_rise_on(controller.robot, controller.home, ground)

    @checked
    def command(self, observation: Observation) -> Command:
        """Return the command of the tick that begins with ``observation``."""
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
        # At the first tick only swings that have just begun count; a leg in the middle of one waits for its next swing.
        duration = (1.0 - c._gait.duty_factor) * c.cycle_duration
        begins |= (self._time <= self._dt + 1e-12) & (np.nan_to_num(share, nan=1.0) * duration <= self._dt + 1e-9)
        needed = np.linalg.norm(self._feet - c.home, axis=1) > _AT_HOME
        needed |= np.linalg.norm(c.velocity(self._twist, c.home), axis=1) > _STILL
        landed = self._swings & np.isnan(share)
        self._swings = np.where(begins, needed, self._swings & ~np.isnan(share))
        stance = forward_kinematics(c.robot, self._rolled())
        # Lift-off and landing take place between the last tick and this one; ``held`` is the share in stance before it.
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
        """Feet (L, 3) [m] at this tick, before the walk begins, on their way to the standing footholds."""
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
        """Change the followed command towards the given one, at the rate that ``response`` allows."""
        c = self._controller
        self._largest = np.maximum(self._largest, np.abs(wanted))
        step = self._largest * self._dt / (c.response * c.cycle_duration)
        self._twist = Twist(*(self._twist + np.clip(np.subtract(wanted, self._twist), -step, step)))

    def _rolled(self) -> Array:
        """Angles (L, 3) [rad] of legs in stance one tick later: spherical feet roll on the ground without slipping.

        The point of the foot that touches the ground is at rest, therefore the centre of the foot moves.
        """
        robot, up = self._controller.robot, np.array([0.0, 0.0, 1.0])
        q = self._q
        for part in (0.5, 1.0):  # the midpoint rule
            lever = -robot.foot_radius * up
            slide = contact_jacobian(jacobian(robot, q), joint_axes(robot, q), cross_matrix(lever))
            contact = forward_kinematics(robot, q) + lever
            # With the pseudo-inverse a stretched leg moves in the directions that it still can.
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
        return Twist(*check_shape("twist", twist, (3,)).tolist())
    except InvalidInputError as error:
        expected = "expected hexakin.steering.Twist(forward, left, turn), three finite numbers"
        raise InvalidInputError(f"twist: {expected}, got {shown(twist)}") from error


def _moved(controller: SteeringController, twist: Twist, feet: Array, duration: float) -> Array:
    """Points of the ground (L, 3) [m] in the body frame, after the body has moved with a twist for a duration [s]."""
    robot, angle = controller.robot, twist.turn * duration
    # The body's path is an arc. Its chord is turned by half the angle and is sinc(half the angle) times as long.
    chord = duration * np.sinc(angle / (2.0 * np.pi)) * (twist.forward * robot.forward - twist.left * robot.right)
    way = axis_rotation([0.0, 0.0, 1.0], 0.5 * angle) @ chord
    return (feet - way) @ axis_rotation([0.0, 0.0, 1.0], angle)


def _arc(start: Array, end: Array, start_slope: Array, end_slope: Array, share: Array, apex: float) -> Array:
    """Feet (L, 3) [m] when a ``share`` (L,) of the swing is completed.

    The path is a cubic with the given slopes [m] per swing at its ends, so that feet have no velocity relative to the
    ground when they leave and meet it, plus a bump of height ``apex`` [m].
    """
    s = share[:, None]
    u = 1.0 - s
    over = u**2 * ((1.0 + 2.0 * s) * start + s * start_slope) + s**2 * ((3.0 - 2.0 * s) * end - u * end_slope)
    return over + 64.0 * s**3 * u**3 * [0.0, 0.0, apex]
