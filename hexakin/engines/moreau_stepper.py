"""Simulation of rigid bodies on a terrain: a Pinocchio model, collision shapes, servos and Moreau time stepping.

The method is that of Jean and Moreau 1992, see ``hexakin.engines.moreau_step``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_number, check_whole
from hexakin.contact.impulses import HOLDS, Accuracy, begin, give_hint
from hexakin.contact.impulses import Servos as Driven
from hexakin.contact.problem import check_facets
from hexakin.dynamics import pin
from hexakin.engines.base import TorqueLaw
from hexakin.engines.contact_search import Shapes
from hexakin.engines.ground_grid import Ground, compile_ground
from hexakin.engines.leg_dynamics import Bodies
from hexakin.engines.model_bodies import bodies_of
from hexakin.engines.moreau_step import CROWDED, LOST, UNSOLVED, drift, run
from hexakin.engines.shapes import Cuboid, Sphere
from hexakin.engines.step_values import MOST_CONTACTS, Drive, Law, Places, Scene, Torques, state_memory, step_memory
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.numerics.display import short_repr
from hexakin.numerics.interrupts import interrupts_kept
from hexakin.numerics.numba_cache import Whole, announced, entry
from hexakin.robot.model import GRAVITY
from hexakin.terrain.base import Terrain

_FAST = 5.0  # [m/s] Bodies that are slower strike at the right step; faster ones may strike one step too late.
_CONTACTS = 12  # that memory is made for at first


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
    unsolved_steps
        Number of steps whose residual is above the tolerance.
    rate_moment
        Sum (3, 3) [rad^2/s^2] of w w^T, with w the angular velocity of the first free body in its own frame.
    """

    normal_impulse: Array
    last_normal_impulse: Array
    servo_work: float
    contact_work: float
    penetration: float
    residual: float
    unsolved_steps: int
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
        Collision shapes. They touch the ground and the shapes of other free bodies; those of one robot do not collide.
    terrain
        The ground.
    servos
        Servos on joints of the model, or None.
    groups
        Number of groups of shapes; normal impulses are summed over each group. Those between two free bodies count for
        the group of the later one.
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
            reach=(float(threshold) + 2.0 * GRAVITY * h) * h,
            search_distance=max(float(threshold) + 2.0 * GRAVITY * h, 0.5 * _FAST) * h,
            accuracy=Accuracy(
                compliance=check_number("compliance", compliance, at_least=0.0),
                tolerance=check_number("tolerance", tolerance, above=0.0),
                max_sweeps=check_whole("max_sweeps", max_sweeps, at_least=1),
            ),
        )
        self._model, self._data = model, model.createData()
        ground = compile_ground(terrain)
        bodies = bodies_of(model)
        self._scene = _scene(model, bodies, _shapes(shapes), ground, _meeting(model, shapes))
        order = self._scene.places.joint_of.tolist()
        driven = np.array([order.index(joint) for joint in servos.joints] if servos else [], dtype=np.int64)
        count = len(driven)
        self._drive = Drive(np.zeros(count), _driven(driven), _driven(driven[:0]), np.zeros(count, dtype=np.int64))
        self._torques = Torques(*(np.zeros(count) for _ in range(3)))
        self._state = state_memory(model.nq, model.nv, groups)
        self._state.q[:] = pin.neutral(model)
        self._facets = check_facets(facets)
        self._step = step_memory(bodies, self._scene.shapes, model.njoints, count, _CONTACTS)
        self.steps = 0
        self._runs: dict[bool, Callable[..., tuple[int, int]]] = {}
        self._go_on(by_torque=False, steps=0)
        self._drift = entry(drift, bodies, self._state.q, self._state.v, 0.0)

    @property
    def q(self) -> Array:
        """Configuration (nq,) at the end of the last step."""
        return self.state()[0]

    @property
    def v(self) -> Array:
        """Velocity (nv,) at the end of the last step; that of free bodies is in their own frames, as in Pinocchio."""
        return self.state()[1]

    def state(self) -> tuple[Array, Array]:
        """Return configuration ``q`` and velocity ``v`` at the end of the last step."""
        q, v = self._state.q.copy(), self._state.v.copy()
        self._drift(self._scene.bodies, q, v, -0.5 * self.time_step)
        return q, v

    @property
    def servo_torque(self) -> Array:
        """Torques (m,) [N m] of the servos in the last step."""
        return self._drive.servos.impulse / self.time_step

    @property
    def unsolved_steps(self) -> int:
        """Number of steps whose residual is above the tolerance."""
        return int(self._state.sums.unsolved[0])

    def place(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Set the configuration ``q`` (nq,) and the velocity ``v`` (nv,), which is zero if ``v`` is None.

        Raises InvalidInputError for a wrong shape or a value that is not finite.
        """
        state, model, servos = self._state, self._model, self._drive.servos
        state.q[:] = check_array("q", q, (model.nq,))
        state.v[:] = 0.0 if v is None else check_array("v", v, (model.nv,))
        self._drift(self._scene.bodies, state.q, state.v, 0.5 * self.time_step)
        servos.impulse[:] = 0.0
        servos.state[:] = HOLDS
        state.last.number[0] = 0

    def energy(self, state: tuple[Array, Array] | None = None) -> float:
        """Return the sum of kinetic and potential energy [J] of a ``state``; None means the present one."""
        q, v = self.state() if state is None else state
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
        drive, state = self._drive, self._state
        angles = np.zeros(0) if command is None else np.asarray(command, dtype=float).ravel()
        if angles.shape != drive.command.shape:
            raise InvalidInputError(f"command: expected {drive.command.size} angles, got {angles.size}")
        drive.command[:] = angles
        if torque_law is not None:
            for mine, given in zip(self._torques, torque_law, strict=True):
                mine[:] = np.ravel(given)
        sums, unsolved = state.sums, self.unsolved_steps
        for total in (sums.impulse, sums.totals, sums.rate_moment):
            total[...] = 0.0
        self._advance(num_steps, torque_law is not None)
        if not (np.isfinite(state.q).all() and np.isfinite(state.v).all()):
            self._fail(np.inf)
        work, lost, depth, worst = sums.totals.tolist()
        return StepSums(
            normal_impulse=sums.impulse.copy(),
            last_normal_impulse=sums.last_impulse.copy(),
            servo_work=work,
            contact_work=lost,
            penetration=depth,
            residual=worst,
            unsolved_steps=self.unsolved_steps - unsolved,
            rate_moment=sums.rate_moment.copy(),
        )

    def _go_on(self, by_torque: bool, steps: int) -> tuple[int, int]:
        """Call ``moreau_step.run``, compiled for these kinds of arguments when they first occur."""
        arguments = (
            self._scene, self._drive, self._torques if by_torque else None, self._law, self._facets, self._state,
            self._step,
        )  # fmt: skip
        if by_torque not in self._runs:
            with announced("the rigid engine"):
                self._runs[by_torque] = entry(run, *arguments, 0)
        return self._runs[by_torque](*arguments, steps)

    def _advance(self, num_steps: int, by_torque: bool) -> None:
        left, hard = num_steps, False
        while left > 0:
            made, why = self._go_on(by_torque, 1 if hard else left)
            self.steps += made
            left -= made
            step = self._step
            if why == UNSOLVED:
                hard = True
                give_hint(step.system, self._law.accuracy)
            elif hard:
                hard = False
                begin(step.system.hints)
            if why == LOST:
                self.steps += 1
                self._fail(float(self._state.sums.totals[3]))
            if step.found[0] >= MOST_CONTACTS:
                raise SimulationError(
                    f"rigid: more than {MOST_CONTACTS - 1} contacts at t = {self.steps * self.time_step:g} s"
                )
            if why == CROWDED:
                room = 2 * int(step.found[0])
                scene, servos = self._scene, len(self._drive.command)
                self._step = step_memory(scene.bodies, scene.shapes, self._model.njoints, servos, room)

    def _fail(self, residual: float) -> None:
        raise SimulationError(
            f"rigid: no contact forces found at t = {self.steps * self.time_step:g} s (step {self.steps} of "
            f"{self.time_step:g} s): relative residual {residual:.2g}, tolerance {self._law.accuracy.tolerance:g}"
        )


def _driven(joints: Whole) -> Driven:
    count = len(joints)
    targets, low, high, impulses = (np.zeros(count) for _ in range(4))
    return Driven(joints.copy(), targets, low, high, np.zeros(count, dtype=np.int64), impulses)


def _scene(model: pin.Model, bodies: Bodies, shapes: Shapes, ground: Ground, meeting: Whole | None) -> Scene:
    """Return the scene, with the places of the model's joints among the bodies and legs."""
    base, leg, depth = (np.full(model.njoints, -1, dtype=np.int64) for _ in range(3))
    order = {model.joints[joint].idx_q: joint for joint in range(1, model.njoints)}
    base_of = [order[q] for q in bodies.base_q.tolist()]
    joint_of = [order[q] for q in bodies.joint_q.tolist()]
    for number, joint in enumerate(base_of):
        base[joint], depth[joint] = number, 0
    for number, carrier in enumerate(bodies.leg_base.tolist()):
        chain = joint_of[bodies.leg_start[number] : bodies.leg_start[number + 1]]
        for place, joint in enumerate(chain):
            base[joint], leg[joint], depth[joint] = carrier, number, place + 1
    numbers = (np.array(numbers, dtype=np.int64) for numbers in (base_of, joint_of))
    return Scene(bodies, Places(base, leg, depth, *numbers), shapes, ground, meeting)


def _meeting(model: pin.Model, shapes: tuple[Sphere | Cuboid, ...]) -> Whole | None:
    """Return the pairs of shapes of different free bodies, that of the later body first, as in ``find_contacts``."""
    ordered = [shape.joint for kind in (Sphere, Cuboid) for shape in shapes if isinstance(shape, kind)]
    roots = [_root(model, joint) for joint in ordered]
    pairs = [(b, a) for b in range(len(roots)) for a in range(len(roots)) if roots[a] < roots[b]]
    return np.array(pairs, dtype=np.int64) if pairs else None


def _root(model: pin.Model, joint: int) -> int:
    while model.parents[joint] != 0:
        joint = model.parents[joint]
    return joint


def _shapes(shapes: tuple[Sphere | Cuboid, ...]) -> Shapes:
    spheres = [shape for shape in shapes if isinstance(shape, Sphere)]
    boxes = [shape for shape in shapes if isinstance(shape, Cuboid)]
    sizes = np.array([box.size for box in boxes], dtype=float).reshape(-1, 3)
    centers = np.array([box.placement[:3, 3] for box in boxes]).reshape(-1, 3)
    return Shapes(
        sphere_joint=np.array([s.joint for s in spheres], dtype=np.int64),
        sphere_group=np.array([s.group for s in spheres], dtype=np.int64),
        sphere=np.array([[*s.center, s.radius] for s in spheres]).reshape(-1, 4),
        box_joint=np.array([b.joint for b in boxes], dtype=np.int64),
        box_group=np.array([b.group for b in boxes], dtype=np.int64),
        box_rotation=np.ascontiguousarray(np.array([b.placement[:3, :3] for b in boxes]).reshape(-1, 3, 3)),
        box=np.concatenate([centers, 0.5 * sizes], axis=1),
    )
