"""Paper A's walking controller: a tripod gait with control of height and posture (A section 4)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexakin.checks import Array, check_array, check_number, check_whole, checked
from hexakin.control.ground_plane import ground_plane, slope_angles, supporting_feet
from hexakin.control.interface import Command, Observation
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.kinematics.forward import forward_kinematics, standing_height
from hexakin.kinematics.inverse import inverse_kinematics
from hexakin.kinematics.leg_functions import reach
from hexakin.robot.model import Robot
from hexakin.transforms import axis_rotation
from hexakin.walking.gait import LONGEST_PHASE, Gait, tripod
from hexakin.walking.swing import bezier, stance_line, swing_control_points

READINGS = ("as_printed", "rotate_foothold")
STARTS = ("actual", "command")
FIRST_PHASES = ("full_stride", "half_stride")
_TICKS_AT_ONCE = 100  # whose foot targets are computed together


@checked
@dataclass(frozen=True)
class PostureController:
    """Tripod gait with paper A's control of height (k_z), pitch (k_alpha) and roll (k_beta) (A section 4).

    With all three gains zero it is the paper's "simple control". Raises InvalidInputError for a number out of its range
    or a robot without six legs, and UnknownNameError for an unknown option.

    Parameters
    ----------
    robot
        A robot with six legs.
    k_z, k_alpha, k_beta
        Gains in [0, 1] for height, pitch and roll (A(27), A(29)).
    stride, apex
        Length and height of a swing [m]. The values are assumed, because the paper does not give them.
    phase_duration
        Duration of one swing, t_g [s].
    reading
        How A(28)-(31) are read for a foot in stance. ``"as_printed"``: all feet move by the same rotated displacement.
        ``"rotate_foothold"``: the foothold is rotated too, so that the torso becomes parallel to the ground.
    start_from
        Where the feet are at the start of a phase: at the ``"actual"`` joint angles (A(12)) or at the last
        ``"command"``.
    reference_height
        Height [m] that the controller keeps; None means the standing height of the robot.
    first_phase
        ``"full_stride"``: the first phase has the full stride. ``"half_stride"``: it has half the stride, so that later
        strokes are centred on the standing footholds.
    estimate_every
        Number of phases between estimates of slope and height: 1, or 2 for once per gait cycle.
    extension_speed, max_extension
        Speed [m/s] and largest distance [m] at which feet without contact move down at a phase change (A Fig. 6).
    seed
        Seed of the random choice of three feet for the ground plane.
    gait
        Not an argument: the tripod gait of the robot.
    """

    robot: Robot
    k_z: float = 0.8
    k_alpha: float = 0.6
    k_beta: float = 0.0
    _: KW_ONLY
    stride: float = 0.05
    apex: float = 0.03
    phase_duration: float = 1.0
    reading: str = "as_printed"
    start_from: str = "actual"
    reference_height: float | None = None
    first_phase: str = "full_stride"
    estimate_every: int = 1
    extension_speed: float = 0.05
    max_extension: float = 0.03
    seed: int = 0
    gait: Gait = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("k_z", "k_alpha", "k_beta"):
            check_number(name, getattr(self, name), at_least=0.0, at_most=1.0)
        check_number("phase_duration", self.phase_duration, above=0.0, at_most=LONGEST_PHASE, unit="s")
        check_number("extension_speed", self.extension_speed, above=0.0, unit="m/s")
        # Lengths in millimetres would be far beyond it, and every foot would be out of reach without an error.
        farthest = 2.0 * float(reach(self.robot).max())
        for name in ("stride", "apex", "max_extension"):
            check_number(name, getattr(self, name), at_least=0.0, at_most=farthest, unit="m")
        check_whole("estimate_every", self.estimate_every, at_least=1)
        check_whole("seed", self.seed)
        options = {"reading": READINGS, "start_from": STARTS, "first_phase": FIRST_PHASES}
        for name, known in options.items():
            if getattr(self, name) not in known:
                raise UnknownNameError(name, getattr(self, name), list(known))
        if self.reference_height is not None:
            check_number("reference_height", self.reference_height, above=0.0, at_most=farthest, unit="m")
        object.__setattr__(self, "gait", tripod(self.robot))

    @property
    def phases_per_cycle(self) -> int:
        """Number of gait phases in a cycle."""
        return self.gait.phases_per_cycle

    @property
    def reference(self) -> float:
        """The height [m] that the controller keeps."""
        return standing_height(self.robot) if self.reference_height is None else self.reference_height

    def parameters(self) -> dict[str, Any]:
        """Return all parameters except the robot, by name."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__ if name not in ("robot", "gait")}

    @checked
    def check_control_rate(self, control_rate: float) -> None:
        """Raise InvalidInputError unless a phase is a whole number of ticks at ``control_rate`` [Hz]."""
        ticks = self.phase_duration * check_number("control_rate", control_rate, above=0.0, unit="Hz")
        if not np.isfinite(ticks) or abs(ticks - round(ticks)) > 1e-9 or round(ticks) < 1:
            raise InvalidInputError(
                f"phase_duration: {self.phase_duration:g} s is not a whole number of ticks at {control_rate:g} Hz"
            )

    @checked
    def start(self, observation: Observation, control_rate: float) -> PostureRun:
        """Begin a run at ``observation``; its ``command`` is called ``control_rate`` [Hz] times per second."""
        return PostureRun(self, observation, control_rate)

    @checked
    def swing_displacement(self, delta_z: float) -> Array:
        """Displacement (3,) [m] of a foot from the start to the end of a swing, A(27).

        ``delta_z`` [m] is the measured height minus the reference height.
        """
        return self.stride * self.robot.forward + [0.0, 0.0, self.k_z * check_number("delta_z", delta_z, unit="m")]

    @checked
    def stance_displacement(self, p_body_foot: Array, delta_z: float, delta_alpha: float, delta_beta: float) -> Array:
        """Displacement (L, 3) [m] of the feet from the start to the end of a stance phase, A(28)-(31).

        ``p_body_foot`` (L, 3) [m] are the feet at the start. ``delta_z`` [m] is the measured height minus the reference
        height; ``delta_alpha`` and ``delta_beta`` [rad] are the slope angles of the ground.
        """
        feet = check_array("p_body_foot", p_body_foot, (self.robot.num_legs, 3), ("leg", "coordinate"))
        for name, value in (("delta_z", delta_z), ("delta_alpha", delta_alpha), ("delta_beta", delta_beta)):
            check_number(name, value)
        pitch = axis_rotation(self.robot.right, self.k_alpha * delta_alpha)
        roll = axis_rotation(self.robot.forward, self.k_beta * delta_beta)
        rotation = pitch @ roll
        # A(30)
        t = -self.stride * self.robot.forward + [0.0, 0.0, self.k_z * delta_z]
        if self.reading == "as_printed":
            # A(29): the translation of the product of transforms is the rotated vector, the same for all feet.
            return np.broadcast_to(rotation @ t, feet.shape)
        return (feet + t) @ rotation - feet  # rows: R^T (p_0 + t) - p_0


@checked
class PostureRun:
    """One run of a PostureController; it keeps the state from tick to tick (A section 4).

    ``controller`` is the PostureController, ``observation`` the first one, and ``control_rate`` [Hz] the number of
    commands per second. Raises InvalidInputError if the phase duration is not a whole number of control ticks.
    """

    def __init__(self, controller: PostureController, observation: Observation, control_rate: float):
        self._controller = controller
        controller.check_control_rate(control_rate)
        self._ticks_per_phase = round(controller.phase_duration * control_rate)
        self._extension_step = controller.extension_speed / control_rate
        self._rng = np.random.default_rng(controller.seed)
        self._q = np.array(observation.q)
        self._phase, self._tick, self._extended = 0, 0, 0.0
        self._delta_z = self._delta_alpha = self._delta_beta = 0.0
        self._misfit = float("nan")

    @checked
    def command(self, observation: Observation) -> Command:
        """Return the command of the tick that begins with ``observation``.

        At a phase change, slope and height of the ground are estimated first (A Fig. 6).
        """
        if self._tick == 0:
            support = supporting_feet(observation.foot_force)
            feet = forward_kinematics(self._controller.robot, observation.q)
            sensing = self._phase % self._controller.estimate_every == 0
            if sensing:
                plane = ground_plane(feet, support, self._rng)
                if plane is None and self._extended < self._controller.max_extension and not support.all():
                    return self._extend(support)
                if plane is not None:
                    self._delta_alpha, self._delta_beta = slope_angles(self._controller.robot, plane.normal)
                    self._misfit = plane.misfit
                self._delta_z = observation.height - self._controller.reference
            self._begin_phase(observation)
        self._tick += 1
        command = self._answer(self._target(), stance=~self._swinging, extending=False)
        if self._tick == self._ticks_per_phase:
            self._phase, self._tick, self._extended = self._phase + 1, 0, 0.0
        return command

    def _begin_phase(self, observation: Observation) -> None:
        c = self._controller
        q = observation.q if c.start_from == "actual" else self._q
        self._start = forward_kinematics(c.robot, q)
        part = 0.5 if c.first_phase == "half_stride" and self._phase == 0 else 1.0
        swing = part * c.swing_displacement(self._delta_z)
        self._stance = part * c.stance_displacement(self._start, self._delta_z, self._delta_alpha, self._delta_beta)
        self._swing = swing_control_points(self._start, swing, c.robot.forward, part * c.stride, c.apex)
        self._swinging = c.gait.swinging(self._phase)

    def _target(self) -> Array:
        """Return the foot targets (L, 3) [m] at the end of the present tick; those of many ticks are computed at once.

        For one tick, the calls of NumPy take ten times as long as the arithmetic.
        """
        place = (self._tick - 1) % _TICKS_AT_ONCE
        if place == 0:
            last = min(self._tick + _TICKS_AT_ONCE, self._ticks_per_phase + 1)
            phase = np.arange(self._tick, last)[:, None] / self._ticks_per_phase
            swing, stance = bezier(self._swing, phase), stance_line(self._start, self._stance, phase)
            self._targets = np.where(self._swinging[:, None], swing, stance)
        return self._targets[place]

    def _extend(self, support: NDArray[np.bool_]) -> Command:
        """Command if no triple of contacts is usable: feet without contact move down, the others stay."""
        self._extended += self._extension_step
        down = np.where(support[:, None], 0.0, [0.0, 0.0, -self._extension_step])
        target = forward_kinematics(self._controller.robot, self._q) + down
        return self._answer(target, stance=np.ones(len(support), dtype=bool), extending=True)

    def _answer(self, target: Array, *, stance: NDArray[np.bool_], extending: bool) -> Command:
        robot = self._controller.robot
        solution = inverse_kinematics(robot, target)
        # A leg with an unreachable foot keeps its last command. A joint stops at its limit. Both are reported.
        q = np.where(solution.reachable[:, None], solution.q, self._q)
        self._q = np.clip(q, robot.q_min, robot.q_max)
        diagnostics = {
            "delta_z": self._delta_z,
            "delta_alpha": self._delta_alpha,
            "delta_beta": self._delta_beta,
            "plane_misfit": self._misfit,
        }
        return Command(self._q, stance, self._phase, extending, ~solution.within_limits, diagnostics)
