"""The values of the rigid engine's time step: what stays the same, what is commanded, the state, and memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.contact.impulses import Accuracy, Impact, Servos, System, impact_memory, system_memory
from hexakin.contact.mass import Mass
from hexakin.engines.contact_search import Posed, Shapes, posed_memory
from hexakin.engines.ground_contacts import Contacts, empty_contacts
from hexakin.engines.ground_grid import Ground
from hexakin.engines.leg_dynamics import Bodies, Dynamics, dynamics_memory
from hexakin.numerics.display import short_repr
from hexakin.numerics.numba_cache import Whole

MOST_CONTACTS = 256  # with time steps of 50 ms all corners of ATHENA's boxes are candidates


class Law(NamedTuple):
    """Constants of a run.

    Parameters
    ----------
    h
        Time step [s].
    friction, restitution
        Coefficients of all contacts.
    poisson
        Whether restitution follows Poisson's law; otherwise Newton's.
    threshold
        Speed [m/s] above which contacts bounce.
    servo_rate, servo_torque
        Rate [1/s] and torque limit [N m] of the servos.
    reach
        Gap [m] up to which slow contacts take part in a step.
    search_distance
        Gap [m] up to which contacts are searched.
    accuracy
        How exactly contact forces are computed.
    """

    h: float
    friction: float
    restitution: float
    poisson: bool
    threshold: float
    servo_rate: float
    servo_torque: float
    reach: float
    search_distance: float
    accuracy: Accuracy


class Places(NamedTuple):
    """Where each joint of the Pinocchio model is among free bodies and legs.

    ``base`` and ``leg`` (joints,) are its free body and its leg (-1 for none), ``depth`` (joints,) is the number of the
    leg's joints that move it. ``base_of`` (b,) and ``joint_of`` (j,) are the numbers in the model of each free body and
    of each joint of a leg.
    """

    base: Whole
    leg: Whole
    depth: Whole
    base_of: Whole
    joint_of: Whole

    def __repr__(self) -> str:
        return short_repr(self)


class Scene(NamedTuple):
    """What stays the same: bodies, their collision shapes and the ground.

    ``meeting`` (k, 2) are the pairs of shapes that can meet, as in ``find_contacts``; None if there are none.
    """

    bodies: Bodies
    places: Places
    shapes: Shapes
    ground: Ground
    meeting: Whole | None

    def __repr__(self) -> str:
        return short_repr(self)


class Drive(NamedTuple):
    """How m joints are driven; changed in place between two calls of ``MoreauStepper.advance``.

    ``command`` (m,) [rad] are the wanted angles. ``servos`` are the servos with their states, which stay from step to
    step; ``idle`` are no servos, for impacts and torques. ``before`` (m,) are the servos' states
    before the step.
    """

    command: Array
    servos: Servos
    idle: Servos
    before: Whole

    def __repr__(self) -> str:
        return short_repr(self)


class Torques(NamedTuple):
    """Torques torque + kp (command - angle) - kd rate in place of the servos, limited to the servos' torque.

    ``kp`` (m,) [N m/rad], ``kd`` (m,) [N m s/rad] and ``torque`` (m,) [N m] are changed in place.
    """

    kp: Array
    kd: Array
    torque: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Last(NamedTuple):
    """Keys ``key`` (c,) and impulses ``impulse`` (c, 3) [N s] in the world of the contacts in the last step.

    ``number`` (1,) is how many they are.
    """

    key: Whole
    impulse: Array
    number: Whole

    def __repr__(self) -> str:
        return short_repr(self)


class Sums(NamedTuple):
    """Sums over the steps of a call of ``MoreauStepper.advance``.

    Parameters
    ----------
    impulse, last_impulse
        Normal impulse (g,) [N s] of each group: the sum over the steps, and that of the last step.
    totals
        Work of the servos and of the contacts [J], largest penetration [m] and largest residual of the steps, (4,).
    unsolved
        Number (1,) of steps whose residual is above the tolerance.
    rate_moment
        Sum (3, 3) [rad^2/s^2] of w w^T over the steps, with w the angular velocity of the first free body in its frame.
    """

    impulse: Array
    last_impulse: Array
    totals: Array
    unsolved: Whole
    rate_moment: Array

    def __repr__(self) -> str:
        return short_repr(self)


class State(NamedTuple):
    """State that is kept from step to step, and results; all arrays are changed in place.

    ``q`` (nq,) [m, rad] is the configuration in the middle of the next step, ``v`` (nv,) [m/s, rad/s] the velocity.
    """

    q: Array
    v: Array
    last: Last
    sums: Sums

    def __repr__(self) -> str:
        return short_repr(self)


class Active(NamedTuple):
    """Contacts that act in a step.

    Parameters
    ----------
    contact
        Index (c,) of each among the contacts that were found.
    frame
        Axes (c, 9) t1, t2, n of each in the world.
    blow
        Impulses (3 c,) [N s] of the impact, along these axes.
    """

    contact: Whole
    frame: Array
    blow: Array

    def __repr__(self) -> str:
        return short_repr(self)


class Step(NamedTuple):
    """Memory of one step.

    Parameters
    ----------
    dynamics
        Mass matrix and forces in the middle of the step.
    system, impact
        The problem of the impulses, whose mass matrix is that of ``dynamics``, and contacts that strike.
    contacts, found
        Contacts that the search has found, and their number (1,).
    posed
        Memory of the search.
    active
        Contacts that act.
    start, after, momentum
        Velocity (nv,) after the impact and after the step, and the momentum (nv,).
    poses
        Pose (joints, 12) of each joint of the model in the world: rotation, column by column, and translation [m].
    """

    dynamics: Dynamics
    system: System
    impact: Impact
    contacts: Contacts
    found: Whole
    posed: Posed
    active: Active
    start: Array
    after: Array
    momentum: Array
    poses: Array

    def __repr__(self) -> str:
        return short_repr(self)


def step_memory(bodies: Bodies, shapes: Shapes, joints: int, servos: int, capacity: int) -> Step:
    """Return the memory for ``bodies`` and their ``shapes`` with ``servos`` and up to ``capacity`` contacts that act.

    ``servos`` is their number, and ``joints`` that of the joints of the Pinocchio model, its root included.
    """
    dynamics = dynamics_memory(bodies)
    mass = Mass(
        bodies.base_v, bodies.joint_v, bodies.leg_base, bodies.leg_start, dynamics.composite, dynamics.coupling,
        dynamics.block,
    )  # fmt: skip
    nv = len(dynamics.bias)
    return Step(
        dynamics=dynamics,
        system=system_memory(mass, capacity, servos),
        impact=impact_memory(capacity, 0),
        contacts=empty_contacts(MOST_CONTACTS),
        found=np.zeros(1, dtype=np.int64),
        posed=posed_memory(shapes),
        active=Active(np.zeros(capacity, dtype=np.int64), np.zeros((capacity, 9)), np.zeros(3 * capacity)),
        start=np.zeros(nv),
        after=np.zeros(nv),
        momentum=np.zeros(nv),
        poses=np.zeros((joints, 12)),
    )


def state_memory(nq: int, nv: int, groups: int) -> State:
    """Return the arrays of ``State``, filled with zeros."""
    last = Last(np.zeros(MOST_CONTACTS, dtype=np.int64), np.zeros((MOST_CONTACTS, 3)), np.zeros(1, dtype=np.int64))
    sums = Sums(np.zeros(groups), np.zeros(groups), np.zeros(4), np.zeros(1, dtype=np.int64), np.zeros((3, 3)))
    return State(np.zeros(nq), np.zeros(nv), last, sums)
