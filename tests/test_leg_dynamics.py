"""The rigid engine's own dynamics and factors against Pinocchio and dense algebra."""

import numpy as np
import pinocchio as pin
import pytest

import hexakin as hk
from hexakin.contact.mass import Mass, factor_memory, factorise, load, multiply, project, row_memory, velocities
from hexakin.dynamics import build_model
from hexakin.engines.free_bodies import Ball, Block, free_bodies
from hexakin.engines.leg_dynamics import dynamics_memory, update
from hexakin.engines.model_bodies import bodies_of
from hexakin.exceptions import InvalidInputError

STATES = 10_000


def one_of_each():
    """Two free bodies between which legs of one, three and five joints are spread, with joints in any place."""
    rng, model = np.random.default_rng(7), pin.Model()
    model.gravity.linear = np.array([0.3, -0.2, -9.81])
    for legs in ((3, 1), (5,)):
        base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), f"body_{model.njoints}")
        model.appendBodyToJoint(base, pin.Inertia.Random(), pin.SE3.Random())
        for count in legs:
            parent = base
            for _ in range(count):
                parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Random(), f"joint_{model.njoints}")
                inertia = pin.Inertia.FromBox(rng.uniform(0.1, 1.0), *rng.uniform(0.05, 0.2, 3))
                model.appendBodyToJoint(parent, inertia, pin.SE3.Random())
    return model


@pytest.fixture(params=["athena", "hwr", "phantomx", "two free bodies", "one of each"])
def model(request):
    if request.param == "two free bodies":
        return free_bodies(Ball(1.0, 0.1), Block(2.0, (0.1, 0.2, 0.3)))[0]
    if request.param == "one of each":
        return one_of_each()
    return build_model(hk.load_robot(request.param))


def random_states(model, count, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        q = pin.neutral(model) + rng.normal(size=model.nq)
        for joint in model.joints[1:]:
            if joint.nq == 7:
                q[joint.idx_q + 3 : joint.idx_q + 7] /= np.linalg.norm(q[joint.idx_q + 3 : joint.idx_q + 7])
        yield q, 3.0 * rng.normal(size=model.nv)


def mass_of(bodies, dynamics):
    topology = (bodies.base_v, bodies.joint_v, bodies.leg_base, bodies.leg_start)
    return Mass(*topology, dynamics.composite, dynamics.coupling, dynamics.block)


def dense(mass, nv):
    M, column = np.zeros((nv, nv)), np.zeros(nv)
    for k, unit in enumerate(np.eye(nv)):
        multiply(mass, unit, column)
        M[:, k] = column
    return M


def test_mass_matrix_and_bias_are_pinocchios(model):
    bodies, data = bodies_of(model), model.createData()
    dynamics = dynamics_memory(bodies)
    mass, count = mass_of(bodies, dynamics), STATES if model.nv < 30 else 1000
    worst_M = worst_bias = 0.0
    for k, (q, v) in enumerate(random_states(model, count)):
        update(bodies, q, v, dynamics)
        bias = pin.nonLinearEffects(model, data, q, v)
        worst_bias = max(worst_bias, np.abs(dynamics.bias - bias).max() / np.abs(bias).max())
        if k % 20 == 0:
            M = pin.crba(model, data, q, pin.Convention.WORLD)
            M = np.triu(M) + np.triu(M, 1).T
            worst_M = max(worst_M, np.abs(dense(mass, model.nv) - M).max() / np.abs(M).max())
    assert worst_M < 1e-12
    assert worst_bias < 1e-12


@pytest.mark.parametrize("held", ["none", "some", "all"])
def test_factors_give_what_dense_algebra_gives(model, held):
    bodies, rng = bodies_of(model), np.random.default_rng(3)
    dynamics = dynamics_memory(bodies)
    mass = mass_of(bodies, dynamics)
    factor, rows = factor_memory(mass), row_memory(mass, 9)
    legs, bases, nv = len(bodies.leg_base), len(bodies.base_v), model.nv
    for q, v in random_states(model, 20, seed=1):
        update(bodies, q, v, dynamics)
        M = dense(mass, nv)
        factor.free[:] = {"none": 1, "some": rng.integers(0, 2, len(factor.free)), "all": 0}[held]
        J = random_rows(mass, rows, rng, legs, bases, nv)
        free = np.ones(nv, dtype=bool)
        free[bodies.joint_v] = factor.free == 1
        r, p = rng.normal(size=nv), rng.normal(size=9)
        assert factorise(mass, factor)
        load(mass, r, factor)
        G, g = np.zeros((9, 9)), np.zeros(9)
        project(mass, factor, rows, 9, G, g)
        inverse = np.linalg.inv(M[np.ix_(free, free)])
        assert pytest.approx(J[:, free] @ inverse @ J[:, free].T, rel=1e-9, abs=1e-9 * np.abs(G).max()) == G
        assert pytest.approx(J[:, free] @ inverse @ r[free], rel=1e-9, abs=1e-9 * np.abs(g).max()) == g
        after = np.full(nv, 7.0)
        velocities(mass, factor, rows, 9, p, after)
        wanted = inverse @ (r[free] + J[:, free].T @ p)
        assert after[free] == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())
        assert (after[~free] == 7.0).all()


def random_rows(mass, rows, rng, legs, bases, nv):
    """Fill the rows with one or two sides, and return them as a dense matrix."""
    J = np.zeros((9, nv))
    for i in range(9):
        rows.sides[i] = 1 if bases == 1 else rng.integers(1, 3)
        for side in range(rows.sides[i]):
            leg = int(rng.integers(-1, legs)) if side == 0 else -1
            base = int(mass.leg_base[leg]) if leg >= 0 else int(rng.integers(bases))
            if side == 1 and base == rows.base[i, 0]:
                base = (base + 1) % bases
            rows.leg[i, side], rows.base[i, side] = leg, base
            rows.on_base[i, side] = rng.normal(size=6)
            J[i, mass.base_v[base] : mass.base_v[base] + 6] += rows.on_base[i, side]
            if leg >= 0:
                joints = mass.joint_v[mass.leg_start[leg] : mass.leg_start[leg + 1]]
                rows.on_leg[i, side] = rng.normal(size=rows.on_leg.shape[2])
                J[i, joints] += rows.on_leg[i, side, : len(joints)]
    return J


def test_a_joint_of_another_kind_is_named():
    model = one_of_each()
    model.addJoint(1, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    with pytest.raises(InvalidInputError, match="slide"):
        bodies_of(model)
