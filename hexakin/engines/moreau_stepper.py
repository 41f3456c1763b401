"""Simulation of rigid bodies on a terrain: a Pinocchio model, collision shapes, servos and Moreau time stepping.

The method is that of Jean and Moreau 1992, see ``hexakin.engines.moreau_step``.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_number, check_whole
from hexakin.contact.impulses import HOLDS
from hexakin.contact.problem import check_facets
from hexakin.dynamics import pin
from hexakin.engines.base import TorqueLaw
from hexakin.engines.box_contacts import BoxTouch
from hexakin.engines.ground_contacts import Bodies, empty_contacts
from hexakin.engines.ground_grid import compile_ground
from hexakin.engines.moreau_step import CAPACITY, Drive, Law, State, drift, march
from hexakin.engines.shapes import Cuboid, Sphere
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.numerics.display import short_repr
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.numerics.numba_cache import announced
from hexakin.robot.model import GRAVITY
from hexakin.terrain.base import Terrain

_FAST = 5.0  # [m/s] Bodies that are slower strike at the right step; faster ones may strike one step too late.
_HOPELESS = 1e-3  # relative residual above which a simulation stops


class Servos(NamedTuple):
    """Velocity servos on the ``joints`` (m,) of a model, given as indices.

    Each joint is driven at ``rate`` [1/s] times its error of angle, with at most ``max_torque`` [N m].
    """

    joints: tuple[int, ...]
    rate: float
    max_torque: float


class StepSums(NamedTuple):
    """Sums over a number of steps, as ``MoreauStepper.advance`` returns them.

    Parameters
    ----------
    normal_impulse, last_normal_impulse
        Normal impulse (g,) [N s] of each group: over all steps, and in the last step.
    servo_work, contact_work
        Work [J] of the servos and of the contacts; the latter is minus the energy that contacts dissipate.
    penetration
        Largest penetration [m] in any step.
    residual
        Largest relative residual of the contact solver in any step.
    rate_moment
        Sum (3, 3) [rad^2/s^2] of w w^T, with w the angular velocity of the first free body in its own frame.
    """

    normal_impulse: Array
    last_normal_impulse: Array
    servo_work: float
    contact_work: float
    penetration: float
    residual: float
    rate_moment: Array

    def __repr__(self) -> str:
        return short_repr(self)


class MoreauStepper:
    """Simulator of rigid bodies under gravity, servo torques and contact with a terrain (A section 3.1).

    ``steps`` counts the time steps, ``unsolved_steps`` those whose residual is above ``tolerance``. Raises
    InvalidInputError for a number out of its range and for a joint that is neither free nor of one coordinate, and
    UnknownNameError for an unknown ``restitution_law``.

    Parameters
    ----------
    model
        Pinocchio model of the bodies.
    shapes
        Collision shapes.
    terrain
        The ground.
    servos
        Servos on joints of the model, or None.
    groups
        Number of groups of shapes; normal impulses are summed over each group.
    time_step
        Time step h [s].
    friction, restitution
        Coefficients of friction and of restitution of all contacts.
    restitution_law
        ``"poisson"`` or ``"newton"``.
    restitution_threshold
        Only contacts faster than this [m/s] bounce. None means 5 g h, a speed that bodies at rest cannot reach.
    facets
        Number of facets of the friction polyhedron of A section 3.1; None means the exact cone.
    compliance
        Compliance of the contacts, relative to the mean of the diagonal of the Delassus matrix. It distributes loads
        evenly over redundant contacts; a loaded contact yields at about compliance * g * h [m/s].
    tolerance
        Relative residual at which the contact solver stops. A residual above 1e-3 raises SimulationError.
    max_sweeps
        Largest number of sweeps of the contact solver.
    """

    def __init__(
        self,
        model: pin.Model,
        shapes: tuple[Sphere | Cuboid, ...],
        terrain: Terrain,
        *,
        servos: Servos | None = None,
        groups: int = 1,
        time_step: float = 0.001,
        friction: float = 0.9,
        restitution: float = 0.5,
        restitution_law: Literal["poisson", "newton"] = "poisson",
        restitution_threshold: float | None = None,
        facets: int | None = None,
        compliance: float = 1e-6,
        tolerance: float = 1e-8,
        max_sweeps: int = 2000,
    ):
        if restitution_law not in ("poisson", "newton"):
            raise UnknownNameError("restitution_law", restitution_law, ["newton", "poisson"])
        self.time_step = h = check_number("time_step", time_step, above=0.0, unit="s")
        threshold = 5.0 * GRAVITY * h if restitution_threshold is None else restitution_threshold
        self._law = Law(
            h=h,
            friction=check_number("friction", friction, at_least=0.0),
            restitution=check_number("restitution", restitution, at_least=0.0, at_most=1.0),
            poisson=restitution_law == "poisson",
            threshold=check_number("restitution_threshold", threshold, at_least=0.0, unit="m/s"),
            servo_rate=servos.rate if servos else 0.0,
            servo_torque=servos.max_torque if servos else 0.0,
            compliance=check_number("compliance", compliance, at_least=0.0),
            tolerance=check_number("tolerance", tolerance, above=0.0),
            max_sweeps=check_whole("max_sweeps", max_sweeps, at_least=1),
            reach=(float(threshold) + 2.0 * GRAVITY * h) * h,
            search_distance=max(float(threshold) + 2.0 * GRAVITY * h, 0.5 * _FAST) * h,
        )
        self._model, self._data = model, model.createData()
        ground = compile_ground(terrain)
        self._touch = BoxTouch(model, shapes, ground)
        self._bodies = _bodies(model, shapes, servos, bool(self._touch.body_pairs))
        count = len(self._bodies.servo)
        self._state = State(
            v=np.zeros(model.nv),
            s=np.zeros(count),
            hold=np.zeros(count, dtype=np.int64),
            old_key=np.zeros(CAPACITY, dtype=np.int64),
            old_impulse=np.zeros((CAPACITY, 3)),
            old_count=np.zeros(1, dtype=np.int64),
            found=np.zeros(1, dtype=np.int64),
            impulse=np.zeros(groups),
            last_impulse=np.zeros(groups),
            sums=np.zeros(4),
            rate_moment=np.zeros((3, 3)),
        )
        self._q_half = pin.neutral(model)
        self._drive = Drive(np.zeros(count), np.zeros(1, dtype=np.bool_), *(np.zeros(count) for _ in range(3)))
        self._contacts = empty_contacts(CAPACITY)
        self._pairs = np.zeros((CAPACITY, 2), dtype=np.int64)
        self.steps = self.unsolved_steps = 0
        data = self._data
        with announced("the rigid engine"):
            self._march = march(
                data.M, data.nle, data.J, _pose_view(model, data), self._q_half, self._drive, self._bodies, ground,
                self._contacts, self._pairs, self._law, check_facets(facets), self._state,
            )  # fmt: skip

    @property
    def q(self) -> Array:
        """Configuration (nq,) at the end of the last step."""
        return self._now()[0]

    @property
    def v(self) -> Array:
        """Velocity (nv,) at the end of the last step; that of free bodies is in their own frames, as in Pinocchio."""
        return self._now()[1]

    def _now(self) -> tuple[Array, Array]:
        q, v = self._q_half.copy(), self._state.v.copy()
        drift(q, v, self._bodies, -0.5 * self.time_step)
        return q, v

    @property
    def servo_torque(self) -> Array:
        """Torques (m,) [N m] of the servos in the last step."""
        return self._state.s / self.time_step

    def place(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Set the configuration ``q`` (nq,) and the velocity ``v`` (nv,), which is zero if ``v`` is None.

        Raises InvalidInputError for a wrong shape or a value that is not finite.
        """
        state, model = self._state, self._model
        self._q_half[:] = check_array("q", q, (model.nq,))
        state.v[:] = 0.0 if v is None else check_array("v", v, (model.nv,))
        drift(self._q_half, state.v, self._bodies, 0.5 * self.time_step)
        state.s[:] = 0.0
        state.hold[:] = HOLDS
        state.old_count[0] = 0

    def energy(self) -> float:
        """Return the sum of kinetic and potential energy [J]."""
        q, v = self._now()
        kinetic = pin.computeKineticEnergy(self._model, self._data, q, v)
        return float(kinetic + pin.computePotentialEnergy(self._model, self._data, q))

    @interrupts_kept()
    def advance(
        self, num_steps: int, command: ArrayLike | None = None, torque_law: TorqueLaw | None = None
    ) -> StepSums:
        """Make ``num_steps`` time steps, in which the servos drive their joints towards ``command`` (m,) [rad].

        If ``torque_law`` is not None, the m joints apply its torques instead. Raises InvalidInputError for a wrong
        number of angles. Raises SimulationError, with the number of the step and the residual, if contact forces cannot
        be found or the state is no longer finite; also if there are too many contacts.
        """
        model, data, q, v = self._model, self._data, self._q_half, self._state.v
        state, loop, world = self._state, self._march, pin.Convention.WORLD
        angles = np.zeros(0) if command is None else np.asarray(command, dtype=float).ravel()
        drive = self._drive
        if angles.shape != drive.command.shape:
            raise InvalidInputError(f"command: expected {drive.command.size} angles, got {angles.size}")
        drive.command[:] = angles
        drive.by_torque[0] = torque_law is not None
        if torque_law is not None:
            for mine, given in zip((drive.kp, drive.kd, drive.torque), torque_law, strict=True):
                mine[:] = np.ravel(given)
        state.impulse[:] = 0.0
        state.sums[:] = 0.0
        state.rate_moment[:] = 0.0
        worst, driven = 0.0, drive.command.size > 0
        turning = np.ones(model.nv, dtype=bool)
        for j in self._bodies.floating[:, 1]:
            turning[j : j + 3] = False
        for _ in range(num_steps):
            pin.crba(model, data, q, world)
            pin.nonLinearEffects(model, data, q, v)
            if not driven and v[turning].any():
                self._center_bias(q, v)
            near = next(loop)
            if near >= 0:
                found = int(state.found[0])
                state.found[0] = self._touch.add(data, self._pairs[:near], self._law.reach, self._contacts, found)
                next(loop)
            self.steps += 1
            if state.found[0] >= CAPACITY:
                raise SimulationError(
                    f"rigid: more than {CAPACITY - 1} contacts at t = {self.steps * self.time_step:g} s"
                )
            residual = float(state.sums[3])
            if not residual <= self._law.tolerance:
                self._unsolved(residual)
            worst = max(worst, residual)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            self._unsolved(np.inf)
        work, lost, depth = (float(total) for total in state.sums[:3])
        return StepSums(
            state.impulse.copy(), state.last_impulse.copy(), work, lost, depth, worst, state.rate_moment.copy()
        )

    def _center_bias(self, q: Array, v: Array) -> None:
        """Replace the velocity-dependent forces by those in the middle of the step.

        With these forces tumbling bodies keep their energy. A robot with servos rotates too slowly for this to matter,
        so that it is not computed for robots.
        """
        data, floating = self._data, self._bodies.floating[:, 1]
        M = np.triu(data.M) + np.triu(data.M, 1).T

        def turning(v: Array) -> Array:
            rate = np.zeros_like(v)
            for j in floating:
                rate[j : j + 3] = np.cross(v[j + 3 : j + 6], v[j : j + 3])
            return rate

        half_way = v
        for _ in range(3):
            half_way = v - 0.5 * self.time_step * (np.linalg.solve(M, data.nle) - turning(half_way))
            pin.nonLinearEffects(self._model, data, q, half_way)
        data.nle[:] += M @ (turning(v) - turning(half_way))

    def _unsolved(self, residual: float) -> None:
        self.unsolved_steps += 1
        self._state.sums[3] = 0.0
        if not residual <= _HOPELESS:
            raise SimulationError(
                f"rigid: no contact forces found at t = {self.steps * self.time_step:g} s (step {self.steps} of "
                f"{self.time_step:g} s): relative residual {residual:.2g}, tolerance {self._law.tolerance:g}"
            )


def _pose_view(model: pin.Model, data: pin.Data) -> Array:
    """Return a view (joints, 12) of data.oMi; each row is a rotation, column by column, and a translation."""
    # Pinocchio keeps its results in the same memory, but the Python binding gives access to single arrays only.
    pin.crba(model, data, pin.neutral(model), pin.Convention.WORLD)
    first = data.oMi[0].rotation.T
    stride = data.oMi[1].rotation.ctypes.data - first.ctypes.data
    poses = np.lib.stride_tricks.as_strided(first, (model.njoints, 12), (stride, first.itemsize))
    if not np.array_equal(poses, [np.r_[T.rotation.T.ravel(), T.translation] for T in data.oMi]):
        raise SimulationError(
            "engine 'rigid' does not support this version of pinocchio, which stores placements in another order"
        )
    return poses


def _bodies(model: pin.Model, shapes: tuple[Sphere | Cuboid, ...], servos: Servos | None, meeting: bool) -> Bodies:
    spheres = [shape for shape in shapes if isinstance(shape, Sphere)]
    boxes = [shape for shape in shapes if isinstance(shape, Cuboid)]
    moves = np.zeros((model.njoints, model.nv), dtype=np.bool_)
    floating: list[list[int]] = []
    hinges: list[list[int]] = []
    for joint in range(1, model.njoints):
        kind = model.joints[joint]
        moves[joint] = moves[model.parents[joint]]
        moves[joint, kind.idx_v : kind.idx_v + kind.nv] = True
        (floating if kind.nq == 7 else hinges).append([kind.idx_q, kind.idx_v])
        if (kind.nq, kind.nv) not in ((7, 6), (1, 1)):
            raise InvalidInputError(f"model: joint {model.names[joint]!r} is neither free nor of one coordinate")
    driven = [model.joints[joint] for joint in servos.joints] if servos else []
    sizes = np.array([box.size for box in boxes], dtype=float).reshape(-1, 3)
    centers = np.array([box.placement[:3, 3] for box in boxes]).reshape(-1, 3)
    return Bodies(
        sphere_joint=np.array([s.joint for s in spheres], dtype=np.int64),
        sphere_group=np.array([s.group for s in spheres], dtype=np.int64),
        sphere=np.array([[*s.center, s.radius] for s in spheres]).reshape(-1, 4),
        box_joint=np.array([b.joint for b in boxes], dtype=np.int64),
        box_group=np.array([b.group for b in boxes], dtype=np.int64),
        box_rotation=np.ascontiguousarray(np.array([b.placement[:3, :3] for b in boxes]).reshape(-1, 3, 3)),
        box=np.concatenate([centers, 0.5 * sizes], axis=1),
        moves=moves,
        floating=np.array(floating, dtype=np.int64).reshape(-1, 2),
        hinges=np.array(hinges, dtype=np.int64).reshape(-1, 2),
        servo=np.array([joint.idx_v for joint in driven], dtype=np.int64),
        servo_q=np.array([joint.idx_q for joint in driven], dtype=np.int64),
        meeting=meeting,
    )
