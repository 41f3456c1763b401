"""Moreau time stepping of rigid bodies with friction and impacts, on a Pinocchio model (A section 3.1).

A step of length h goes from velocity v to v' at the configuration half-way, q + h v / 2, where contacts are sought:

    M (v' - v) = -h (C + g) + S^T s + J^T p,

servo impulses s and contact impulses p found together (``hexakin.contact.impulses``). A contact that is closed
may not approach; one about to close may at most close its gap. Contacts that strike faster than a threshold bounce, by
Poisson's law (A(4)-(6)), whose expansion phase returns the share xi of each compression impulse, or by Newton's, which returns
the share xi of each approach velocity. Jean and Moreau, "Unilaterality and dry friction in the dynamics of rigid body
collections" (1992); Anitescu and Potra (1997); Glocker, "Set-Valued Force Laws" (2001).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexakin.compiled import compiled
from hexakin.contact.impulses import HOLDS, solve_impulses
from hexakin.dynamics import GRAVITY, coal, pin
from hexakin.engines.collision import (
    Contacts,
    Ground,
    compile_ground,
    empty_contacts,
    sphere_contacts,
    vertex_contacts,
)
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.terrain import Terrain
from hexakin.transforms import Array, check_number, check_whole

_CAPACITY = 64  # contacts at a time
_SLOP = 1e-3  # [m] penetration that is left alone
_PUSH_TIME = 0.05  # [s] in which deeper penetration is taken back ...
_PUSH_SPEED = 0.1  # ... [m/s] but not faster than this
_PATCH = 1e-5  # [m] how far from the deepest point two boxes count as touching
_HOPELESS = 1e-3  # relative residual at which a simulation stops


class Sphere(NamedTuple):
    """A sphere on a joint's body: ``center`` (3,) [m] in the joint's frame, ``radius`` [m], ``group`` it counts to."""

    joint: int
    center: Array
    radius: float
    group: int


class Cuboid(NamedTuple):
    """A box on a joint's body: ``placement`` (4, 4) of its centre in the joint's frame, full ``size`` (3,) [m]."""

    joint: int
    placement: Array
    size: Array
    group: int


class Servos(NamedTuple):
    """Velocity servos: model ``joints``, each driven at ``rate`` [1/s] times its error, up to ``max_torque`` [N m]."""

    joints: tuple[int, ...]
    rate: float
    max_torque: float


class StepSums(NamedTuple):
    """What a number of steps adds up to.

    ``normal_impulse`` (g,) [N s] by group, ``servo_work`` and ``contact_work`` [J] (the latter is minus what contacts
    dissipate), ``penetration`` [m] and ``residual``, the largest of any step.
    """

    normal_impulse: Array
    servo_work: float
    contact_work: float
    penetration: float
    residual: float


class _Bodies(NamedTuple):
    """Shapes on bodies and the tree that moves them, for the compiled step."""

    sphere_joint: NDArray[np.int64]
    sphere_group: NDArray[np.int64]
    sphere: Array  # (s, 4) centre and radius
    box_joint: NDArray[np.int64]
    box_group: NDArray[np.int64]
    box_rotation: Array  # (b, 3, 3)
    box: Array  # (b, 6) centre and half sizes
    moves: NDArray[np.bool_]  # (joint, coordinate): whether the coordinate moves the joint's body
    servo: NDArray[np.int64]
    servo_q: NDArray[np.int64]


class _Law(NamedTuple):
    """Constants of a run."""

    h: float
    friction: float
    restitution: float
    poisson: bool
    threshold: float
    servo_rate: float
    servo_torque: float
    compliance: float
    tolerance: float
    max_sweeps: int


class _State(NamedTuple):
    """What goes from step to step, and results, all changed in place."""

    v: Array
    s: Array
    hold: NDArray[np.int64]
    old_key: NDArray[np.int64]
    old_impulse: Array  # (c, 3) in the world
    old_count: NDArray[np.int64]  # (1,)
    impulse: Array  # (g,) normal impulse by group
    sums: Array  # servo work, contact work, penetration, residual


@compiled
def _point_jacobian(moves: Array, J: Array, body: int, x: Array, d: Array, sign: float, row: Array) -> None:
    """Add the derivative of a body point's velocity along d to a row; J (6, nv) is Pinocchio's, about the world's origin."""
    # d . (v + w x x) = d . v + (x x d) . w
    mx, my, mz = x[1] * d[2] - x[2] * d[1], x[2] * d[0] - x[0] * d[2], x[0] * d[1] - x[1] * d[0]
    for k in range(row.size):
        if moves[body, k]:
            row[k] += sign * (
                d[0] * J[0, k] + d[1] * J[1, k] + d[2] * J[2, k] + mx * J[3, k] + my * J[4, k] + mz * J[5, k]
            )


@compiled
def _tangent(n: Array, t: Array) -> None:
    """First tangent: the world's x axis laid into the tangent plane (or y, if the normal is along x)."""
    axis = 0 if abs(n[0]) < 0.9 else 1
    for a in range(3):
        t[a] = -n[axis] * n[a]
    t[axis] += 1.0
    norm = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for a in range(3):
        t[a] /= norm


@compiled
def find_contacts(poses: Array, bodies: _Bodies, ground: Ground, margin: float, contacts: Contacts) -> int:
    """Seek all contacts of spheres and boxes with the ground but those of box against box."""
    count, x = 0, np.empty(3)
    number = 0
    for k in range(bodies.sphere_joint.size):
        P, S = poses[bodies.sphere_joint[k]], bodies.sphere[k]
        for a in range(3):
            x[a] = P[a] * S[0] + P[3 + a] * S[1] + P[6 + a] * S[2] + P[9 + a]
        count = sphere_contacts(
            ground, bodies.sphere_joint[k], bodies.sphere_group[k], number, x[0], x[1], x[2], S[3], margin, contacts, count
        )
        number += 1
    R, center = np.empty((3, 3)), np.empty(3)
    simple = ground.planes.shape[0] + ground.triangles.shape[0] > 0
    for k in range(bodies.box_joint.size):
        P, B = poses[bodies.box_joint[k]], bodies.box[k]
        for a in range(3):
            center[a] = P[a] * B[0] + P[3 + a] * B[1] + P[6 + a] * B[2] + P[9 + a]
        if simple:
            for a in range(3):
                for b in range(3):
                    value = 0.0
                    for c in range(3):
                        value += P[3 * c + a] * bodies.box_rotation[k, c, b]
                    R[a, b] = value
            for corner in range(8):
                for a in range(3):
                    x[a] = center[a]
                    for b in range(3):
                        x[a] += R[a, b] * (B[3 + b] if corner & (1 << b) else -B[3 + b])
                count = sphere_contacts(
                    ground, bodies.box_joint[k], bodies.box_group[k], number + corner, x[0], x[1], x[2], 0.0,
                    margin, contacts, count,
                )  # fmt: skip
            if ground.vertices.shape[0] > 0:
                count = vertex_contacts(
                    ground, bodies.box_joint[k], bodies.box_group[k], number, R, center, B[3:], margin, contacts, count
                )
        number += 8
    return count


@compiled
def box_pairs(poses: Array, bodies: _Bodies, ground: Ground, margin: float, pairs: Array) -> int:
    """List which boxes of bodies may touch which boxes of the ground, by their bounding boxes."""
    count = 0
    for k in range(bodies.box_joint.size):
        P, B = poses[bodies.box_joint[k]], bodies.box[k]
        center, spread = np.empty(3), np.empty(3)
        for a in range(3):
            center[a] = P[a] * B[0] + P[3 + a] * B[1] + P[6 + a] * B[2] + P[9 + a]
            spread[a] = margin
            for b in range(3):
                value = 0.0
                for c in range(3):
                    value += P[3 * c + a] * bodies.box_rotation[k, c, b]
                spread[a] += abs(value) * B[3 + b]
        reach = max(spread[0], spread[1])
        i0 = max(int(np.floor((center[0] - reach - ground.corner[0]) / ground.cell)), 0)
        i1 = min(int(np.floor((center[0] + reach - ground.corner[0]) / ground.cell)), ground.shape[0] - 1)
        j0 = max(int(np.floor((center[1] - reach - ground.corner[1]) / ground.cell)), 0)
        j1 = min(int(np.floor((center[1] + reach - ground.corner[1]) / ground.cell)), ground.shape[1] - 1)
        first = count
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                cell = i * ground.shape[1] + j
                for index in range(ground.start[cell], ground.start[cell + 1]):
                    item = ground.items[index]
                    if item >= ground.boxes.shape[0] or count >= pairs.shape[0]:
                        continue
                    G = ground.boxes[item]
                    near = True
                    for a in range(3):
                        near = near and G[a] <= center[a] + spread[a] and center[a] - spread[a] <= G[3 + a]
                    for old in range(first, count):
                        near = near and pairs[old, 1] != item
                    if near:
                        pairs[count, 0], pairs[count, 1] = k, item
                        count += 1
    return count


@compiled
def solve_step(
    M: Array,
    bias_force: Array,
    J_world: Array,
    q: Array,
    command: Array,
    bodies: _Bodies,
    contacts: Contacts,
    found: int,
    law: _Law,
    state: _State,
) -> None:
    """One step of the velocities, in place; configuration, mass matrix and contacts are those half-way."""
    nv, h, v = state.v.size, law.h, state.v
    m = bodies.servo.size
    # Which contacts take part.
    active, approach = np.empty(found, dtype=np.int64), np.empty(found)
    rows, frames = np.zeros((3 * found, nv)), np.empty((found, 3, 3))
    n = 0
    for c in range(found):
        frame = frames[n]
        normal, x = contacts.normal[c], contacts.point[c]
        _tangent(normal, frame[0])
        for a in range(3):
            frame[2, a] = normal[a]
        frame[1, 0] = normal[1] * frame[0, 2] - normal[2] * frame[0, 1]
        frame[1, 1] = normal[2] * frame[0, 0] - normal[0] * frame[0, 2]
        frame[1, 2] = normal[0] * frame[0, 1] - normal[1] * frame[0, 0]
        for a in range(3):
            row = rows[3 * n + a]
            row[:] = 0.0
            _point_jacobian(bodies.moves, J_world, contacts.bodies[c, 0], x, frame[a], 1.0, row)
            if contacts.bodies[c, 1] >= 0:
                _point_jacobian(bodies.moves, J_world, contacts.bodies[c, 1], x, frame[a], -1.0, row)
        speed = 0.0
        for k in range(nv):
            speed += rows[3 * n + 2, k] * v[k]
        # A fast body whose gap is still open flies on: it shall strike with its own speed.
        if contacts.gap[c] <= 0.0 or speed >= -law.threshold:
            active[n], approach[n] = c, speed
            n += 1
    J = rows[: 3 * n]
    mu, bias, p_min = np.full(n, law.friction), np.zeros(n), np.zeros(n)
    p, u, r, after = np.zeros(3 * n), np.zeros(3 * n), np.empty(nv), np.empty(nv)
    bounces = False
    for i in range(n):
        c = active[i]
        gap = contacts.gap[c]
        if gap > 0.0:
            bias[i] = gap / h
        elif gap < -_SLOP:
            bias[i] = -min((-gap - _SLOP) / _PUSH_TIME, _PUSH_SPEED)
        if gap <= 0.0 and approach[i] < -law.threshold and law.restitution > 0.0:
            bounces = True
            if not law.poisson:
                bias[i] = law.restitution * approach[i]
        for old in range(state.old_count[0]):
            if contacts.key[c] >= 0 and state.old_key[old] == contacts.key[c]:
                for a in range(3):
                    for k in range(3):
                        p[3 * i + a] += frames[i, a, k] * state.old_impulse[old, k]
    for i in range(nv):
        value = -h * bias_force[i]
        for k in range(nv):
            value += (M[i, k] if i <= k else M[k, i]) * v[k]
        r[i] = value
    target, limit = np.empty(m), np.full(m, h * law.servo_torque)
    for j in range(m):
        target[j] = law.servo_rate * (command[j] - q[bodies.servo_q[j]]) / (1.0 + 0.5 * h * law.servo_rate)
    residual, _ = solve_impulses(
        M, r, J, mu, bias, p_min, bodies.servo, target, -limit, limit, state.hold, p, state.s, u, after,
        law.compliance, law.tolerance, law.max_sweeps,
    )  # fmt: skip
    if bounces and law.poisson:
        # Expansion (A(6)): each striking contact gives back at least xi of its compression; servos keep to their limits in all.
        extra, more, hold = np.zeros(3 * n), np.zeros(m), state.hold.copy()
        for i in range(n):
            c = active[i]
            if contacts.gap[c] <= 0.0 and approach[i] < -law.threshold:
                p_min[i] = law.restitution * p[3 * i + 2]
        for i in range(nv):
            r[i] = 0.0
            for k in range(nv):
                r[i] += (M[i, k] if i <= k else M[k, i]) * after[k]
        second, _ = solve_impulses(
            M, r, J, mu, bias, p_min, bodies.servo, target, -limit - state.s, limit - state.s, hold, extra, more, u,
            after, law.compliance, law.tolerance, law.max_sweeps,
        )  # fmt: skip
        residual = max(residual, second)
        for i in range(3 * n):
            p[i] += extra[i]
        for j in range(m):
            state.s[j] += more[j]
    # Work by the trapezoidal rule: exact for a constant mass matrix.
    for j in range(m):
        i = bodies.servo[j]
        state.sums[0] += 0.5 * state.s[j] * (v[i] + after[i])
    work = 0.0
    for i in range(3 * n):
        if p[i] != 0.0:
            speed = 0.0
            for k in range(nv):
                speed += J[i, k] * (v[k] + after[k])
            work += 0.5 * p[i] * speed
    state.sums[1] += work
    state.sums[3] = max(state.sums[3], residual)
    state.old_count[0] = n
    for i in range(n):
        c = active[i]
        state.sums[2] = max(state.sums[2], -contacts.gap[c])
        state.impulse[contacts.group[c]] += p[3 * i + 2]
        state.old_key[i] = contacts.key[c]
        for k in range(3):
            state.old_impulse[i, k] = 0.0
            for a in range(3):
                state.old_impulse[i, k] += frames[i, a, k] * p[3 * i + a]
    for i in range(nv):
        v[i] = after[i]


@compiled
def moreau_step(
    M: Array,
    bias_force: Array,
    J_world: Array,
    poses: Array,
    q: Array,
    command: Array,
    bodies: _Bodies,
    ground: Ground,
    margin: float,
    contacts: Contacts,
    pairs: Array,
    law: _Law,
    state: _State,
) -> int:
    """Seek contacts and make the step; if boxes are near boxes, only return how many such ``pairs``, else -1."""
    if ground.boxes.shape[0] > 0 and bodies.box_joint.size > 0:
        near = box_pairs(poses, bodies, ground, margin, pairs)
        if near > 0:
            return near
    found = find_contacts(poses, bodies, ground, margin, contacts)
    solve_step(M, bias_force, J_world, q, command, bodies, contacts, found, law, state)
    return -1


class MoreauStepper:
    """Rigid bodies on a terrain: a Pinocchio model, shapes on its joints, and servos.

    ``time_step`` [s]; ``friction`` and ``restitution`` hold for every contact. ``restitution_law`` is ``"poisson"`` or
    ``"newton"``; only contacts faster than ``restitution_threshold`` [m/s] bounce, by default 5 g h, which slower
    ones would reach by falling for five steps. ``groups`` is the number of groups that forces are summed over.
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
        compliance: float = 1e-6,
        tolerance: float = 1e-8,
        max_sweeps: int = 2000,
    ):
        if restitution_law not in ("poisson", "newton"):
            raise UnknownNameError("restitution_law", restitution_law, ["newton", "poisson"])
        self.time_step = check_number("time_step", time_step, above=0.0, unit="s")
        threshold = 5.0 * GRAVITY * self.time_step if restitution_threshold is None else restitution_threshold
        self._model, self._data = model, model.createData()
        self._ground = compile_ground(terrain)
        self._law = _Law(
            h=self.time_step,
            friction=check_number("friction", friction, at_least=0.0),
            restitution=check_number("restitution", restitution, at_least=0.0, at_most=1.0),
            poisson=restitution_law == "poisson",
            threshold=check_number("restitution_threshold", threshold, at_least=0.0, unit="m/s"),
            servo_rate=servos.rate if servos else 0.0,
            servo_torque=servos.max_torque if servos else 0.0,
            compliance=check_number("compliance", compliance, at_least=0.0),
            tolerance=check_number("tolerance", tolerance, above=0.0),
            max_sweeps=check_whole("max_sweeps", max_sweeps, at_least=1),
        )
        self._bodies = _bodies(model, shapes, servos)
        self._groups = groups
        count = len(self._bodies.servo)
        self._contacts = empty_contacts(_CAPACITY)
        self._state = _State(
            v=np.zeros(model.nv),
            s=np.zeros(count),
            hold=np.zeros(count, dtype=np.int64),
            old_key=np.zeros(_CAPACITY, dtype=np.int64),
            old_impulse=np.zeros((_CAPACITY, 3)),
            old_count=np.zeros(1, dtype=np.int64),
            impulse=np.zeros(groups),
            sums=np.zeros(4),
        )
        self.q = pin.neutral(model)
        # Pinocchio's results keep their memory; these are views of it. A row of poses is a rotation, column by column, and
        # a translation.
        pin.crba(model, self._data, self.q, pin.Convention.WORLD)
        first = self._data.oMi[0].rotation
        stride = self._data.oMi[1].rotation.ctypes.data - first.ctypes.data
        self._poses = np.lib.stride_tricks.as_strided(first.T, (model.njoints, 12), (stride, 8))
        expected = [np.r_[T.rotation.T.ravel(), T.translation] for T in self._data.oMi]
        if not np.array_equal(self._poses, expected):
            raise SimulationError("pinocchio stores its placements in an order that engine 'rigid' does not know")
        self._M, self._J = self._data.M, self._data.J
        self._nle = self._data.nle
        self._touch = _BoxTouch(model, shapes, self._ground)
        self._pairs = np.zeros((_CAPACITY, 2), dtype=np.int64)
        self._margin = (threshold + 2.0 * GRAVITY * self.time_step) * self.time_step
        self.steps = 0

    @property
    def v(self) -> Array:
        """Velocity (nv,), Pinocchio's; write into it to set it."""
        return self._state.v

    @property
    def servo_torque(self) -> Array:
        """Torques (m,) [N m] of the servos in the last step."""
        return self._state.s / self.time_step

    def place(self, q: Array) -> None:
        """Put the bodies at rest into configuration q (nq,)."""
        self.q = np.array(q, dtype=float)
        state = self._state
        state.v[:] = 0.0
        state.s[:] = 0.0
        state.hold[:] = HOLDS
        state.old_count[0] = 0

    def energy(self) -> float:
        """Kinetic and potential energy [J]."""
        kinetic = pin.computeKineticEnergy(self._model, self._data, self.q, self._state.v)
        return float(kinetic + pin.computePotentialEnergy(self._model, self._data, self.q))

    def advance(self, num_steps: int, command: Array | None = None) -> StepSums:
        """Make time steps, the servos driven towards the angles ``command`` (m,) [rad].

        Raises SimulationError, with the step's number and residual, when contact forces cannot be found or the state is not
        finite.
        """
        model, data, state, h = self._model, self._data, self._state, self.time_step
        v, M, J, nle, poses = state.v, self._M, self._J, self._nle, self._poses
        bodies, ground, contacts, law = self._bodies, self._ground, self._contacts, self._law
        angles = np.zeros(0) if command is None else np.array(command, dtype=float).ravel()
        if angles.shape != bodies.servo.shape:
            raise InvalidInputError(f"command: expected {bodies.servo.size} angles, got {angles.size}")
        state.impulse[:] = 0.0
        state.sums[:] = 0.0
        q = pin.integrate(model, self.q, 0.5 * h * v)
        for step in range(num_steps):
            pin.crba(model, data, q, pin.Convention.WORLD)
            pin.nonLinearEffects(model, data, q, v)
            near = 0
            if not self._touch.body_pairs:
                near = moreau_step(
                    M, nle, J, poses, q, angles, bodies, ground, self._margin, contacts, self._pairs, law, state
                )
            if near >= 0:
                found = find_contacts(poses, bodies, ground, self._margin, contacts)
                found = self._touch.add(data, self._pairs[:near], self._margin, contacts, found)
                solve_step(M, nle, J, q, angles, bodies, contacts, found, law, state)
            if not state.sums[3] <= law.tolerance:
                self._check(step)
            q = pin.integrate(model, q, (h if step < num_steps - 1 else 0.5 * h) * v)
        self.q = q
        self.steps += num_steps
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            self._fail(num_steps)
        work = [float(value) for value in state.sums]
        return StepSums(state.impulse.copy(), work[0], work[1], work[2], work[3])

    def _check(self, step: int) -> None:
        if not self._state.sums[3] <= _HOPELESS:
            self._fail(step)

    def _fail(self, step: int) -> None:
        time = (self.steps + step) * self.time_step
        raise SimulationError(
            f"rigid: no contact forces found in step {self.steps + step + 1} (t = {time:g} s): relative residual "
            f"{self._state.sums[3]:.2g}, tolerance {self._law.tolerance:g}, time step {self.time_step:g} s"
        )


def _bodies(model: pin.Model, shapes: tuple[Sphere | Cuboid, ...], servos: Servos | None) -> _Bodies:
    spheres = [shape for shape in shapes if isinstance(shape, Sphere)]
    boxes = [shape for shape in shapes if isinstance(shape, Cuboid)]
    moves = np.zeros((model.njoints, model.nv), dtype=np.bool_)
    for joint in range(1, model.njoints):
        moves[joint] = moves[model.parents[joint]]
        first = model.joints[joint].idx_v
        moves[joint, first : first + model.joints[joint].nv] = True
    driven = [model.joints[joint] for joint in servos.joints] if servos else []
    return _Bodies(
        sphere_joint=np.array([s.joint for s in spheres], dtype=np.int64),
        sphere_group=np.array([s.group for s in spheres], dtype=np.int64),
        sphere=np.array([[*s.center, s.radius] for s in spheres]).reshape(-1, 4),
        box_joint=np.array([b.joint for b in boxes], dtype=np.int64),
        box_group=np.array([b.group for b in boxes], dtype=np.int64),
        box_rotation=np.array([b.placement[:3, :3] for b in boxes]).reshape(-1, 3, 3),
        box=np.array([[*b.placement[:3, 3], *(0.5 * np.array(b.size))] for b in boxes]).reshape(-1, 6),
        moves=moves,
        servo=np.array([joint.idx_v for joint in driven], dtype=np.int64),
        servo_q=np.array([joint.idx_q for joint in driven], dtype=np.int64),
    )


def _root(model: pin.Model, joint: int) -> int:
    while model.parents[joint] != 0:
        joint = model.parents[joint]
    return joint


class _BoxTouch:
    """Contacts of box against box, edges and corners included, by coal (of the Pinocchio project)."""

    def __init__(self, model: pin.Model, shapes: tuple[Sphere | Cuboid, ...], ground: Ground):
        self._cuboids = [shape for shape in shapes if isinstance(shape, Cuboid)]
        self._boxes = [coal.Box(*(float(size) for size in cuboid.size)) for cuboid in self._cuboids]
        self._placements = [pin.SE3(np.array(cuboid.placement)) for cuboid in self._cuboids]
        self._ground = [coal.Box(*(B[3:] - B[:3])) for B in ground.boxes]
        self._ground_poses = [coal.Transform3s(np.eye(3), 0.5 * (B[3:] + B[:3])) for B in ground.boxes]
        joints = [cuboid.joint for cuboid in self._cuboids]
        # Boxes of bodies that float on their own may touch each other; those of one robot may not.
        roots = [_root(model, joint) for joint in joints]
        count = len(joints)
        self.body_pairs = [(b, a) for a in range(count) for b in range(a + 1, count) if roots[a] != roots[b]]
        self._joints = joints
        self._request, self._result = coal.CollisionRequest(), coal.CollisionResult()
        patches = coal.ContactPatchRequest()
        patches.setPatchTolerance(_PATCH)
        self._patch_request, self._patches = patches, coal.ContactPatchResult(patches)

    def add(
        self, data: pin.Data, near: NDArray[np.int64], margin: float, contacts: Contacts, count: int
    ) -> int:
        """Append the contacts of these pairs (body's box, ground's box) and of all pairs of bodies."""
        self._request.security_margin = margin
        poses: dict[int, coal.Transform3s] = {}

        def pose_of(k: int) -> coal.Transform3s:
            if k not in poses:
                T = data.oMi[self._joints[k]] * self._placements[k]
                poses[k] = coal.Transform3s(T.rotation, T.translation)
            return poses[k]

        for k, item in near.tolist():
            count = self._pair(k, -1, self._boxes[k], pose_of(k), self._ground[item], self._ground_poses[item], contacts, count)
        for a, b in self.body_pairs:
            count = self._pair(a, b, self._boxes[a], pose_of(a), self._boxes[b], pose_of(b), contacts, count)
        return count

    def _pair(self, a, b, box_a, pose_a, box_b, pose_b, contacts: Contacts, count: int) -> int:
        result, patches = self._result, self._patches
        result.clear()
        if not coal.collide(box_a, pose_a, box_b, pose_b, self._request, result):
            return count
        patches.clear()
        coal.computeContactPatch(box_a, pose_a, box_b, pose_b, result, self._patch_request, patches)
        for index in range(patches.numContactPatches()):
            patch = patches.getContactPatch(index)
            for corner in range(patch.size()):
                if count == _CAPACITY:
                    return count
                contacts.bodies[count] = self._joints[a], self._joints[b] if b >= 0 else -1
                contacts.point[count] = patch.getPoint(corner)
                contacts.normal[count] = -patch.getNormal()
                contacts.gap[count] = patch.penetration_depth
                contacts.group[count] = self._cuboids[a].group
                contacts.key[count] = -1
                count += 1
        return count
