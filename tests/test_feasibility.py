"""Feasibility: leg functions, optimal contact forces with certificates, and the checks of a motion."""

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

import hexakin as hk
from hexakin import dynamics
from hexakin.exceptions import InvalidInputError, SolverError
from hexakin.feasibility import Motion, check, checks, commanded_walk, distribute, force_solver, forces, statics
from hexakin.feasibility.casadi_legs import leg_states

ROBOTS = ("athena", "athena_physical", "hwr")
FACETS = 16
MU = 0.9


@pytest.fixture(scope="module")
def athena():
    return hk.load_robot("athena")


def poses_on_slope(n, rng, steepest=0.0):
    """Body poses turned about random horizontal axes."""
    axis, angle = rng.normal(size=(n, 2)), steepest * rng.random(n)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    T = np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    T[:, :3, :3] = [hk.transforms.axis_rotation([*a, 0.0], b) for a, b in zip(axis, angle, strict=True)]
    return T


def wrenches(robot, T, q, normals):
    """By Pinocchio: gravity (6 + 3 L) and the contact points' Jacobians (L, 3, 6 + 3 L) in the world."""
    import pinocchio as pin

    configuration = dynamics.configuration(robot, T, q)
    model, gravity = dynamics.build_model(robot), dynamics.gravity(robot, configuration)
    data = model.createData()
    pin.computeJointJacobians(model, data, configuration)
    pin.updateFramePlacements(model, data)
    found = []
    for leg in range(robot.num_legs):
        frame = model.getFrameId(f"foot_{leg + 1}")
        J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        found.append(J[:3] - pin.skew(-robot.foot_radius * normals[leg]) @ J[3:])
    return gravity, np.array(found)


@pytest.mark.parametrize("name", ROBOTS)
def test_leg_functions_are_the_kinematics_and_pinocchios_gravity(name):
    robot, rng = hk.load_robot(name), np.random.default_rng(1)
    q = robot.standing_q + rng.uniform(-0.5, 0.5, (20, robot.num_legs, 3))
    states = leg_states(robot, q)
    np.testing.assert_allclose(states.foot, hk.forward_kinematics(robot, q), atol=1e-15)
    np.testing.assert_allclose(states.jacobian, hk.jacobian(robot, q), atol=1e-15)
    for k in range(len(q)):
        segments = hk.kinematics.segment_poses(robot, q[k])
        np.testing.assert_allclose(states.knee[k], segments[:, 2, :3, 3], atol=1e-15)
        configuration = dynamics.configuration(robot, np.eye(4), q[k])
        leg_gravity = dynamics.gravity(robot, configuration)[6:].reshape(-1, 3)
        np.testing.assert_allclose(dynamics.GRAVITY * states.moment_slope[k, :, 2], leg_gravity, atol=1e-14)


def test_forces_of_1000_stances_hold_the_robot_and_are_optimal(athena):
    """Tripods and six redundant feet, tilted, on uneven normals, with servos some of which are too weak."""
    robot, rng, n, limit = athena, np.random.default_rng(2), 1000, 0.65
    T, q = poses_on_slope(n, rng, 0.9), robot.standing_q + rng.uniform(-0.5, 0.5, (n, 6, 3))
    carrying = np.ones((n, 6), dtype=bool)
    carrying[::3, ::2] = False
    carrying[1::3, 1] = False
    normals = T[:, None, :3, 2] + 0.2 * rng.normal(size=(n, 6, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    found = distribute(robot, T, q, carrying, normals, friction=MU, facets=FACETS, max_torque=limit)
    counts = dict(zip(*np.unique(found.outcome, return_counts=True), strict=True))
    assert counts["balanced"] > 300 and counts["torque"] > 20 and counts["friction"] > 20, counts

    weight = robot.mass * dynamics.GRAVITY
    height = MU * np.cos(np.pi / FACETS)
    for k in range(n):
        gravity, contact = wrenches(robot, T[k], q[k], normals[k])
        frames = statics.contact_frames(normals[k])
        angle = (2.0 * np.arange(FACETS) + 1.0) * np.pi / FACETS
        facets = np.stack([np.cos(angle), np.sin(angle), np.full(FACETS, -height)], axis=-1)
        legs = np.flatnonzero(carrying[k])
        spans = np.concatenate([contact[leg].T @ frames[leg] for leg in legs], axis=1)  # generalised force per unit
        cone = np.kron(np.eye(len(legs)), facets)
        if found.outcome[k] == "balanced":
            local = np.concatenate([frames[leg].T @ found.force[k, leg] for leg in legs])
            assert not found.force[k, ~carrying[k]].any()
            residual = gravity - spans @ local
            assert np.abs(residual[:6]).max() < 1e-8  # [N], [N m]
            np.testing.assert_allclose(found.torque[k].ravel(), residual[6:], atol=1e-12)
            assert (cone @ local).max() < 1e-7 and np.abs(residual[6:]).max() < limit * (1 + 1e-7)
            # Karush-Kuhn-Tucker: minus the gradient is made of equilibrium rows and of active inequalities.
            slope = -spans[6:] / limit
            gradient = 2.0 * slope.T @ (residual[6:] / limit) + 2e-6 * local / weight**2
            active = [row / 1.0 for row, value in zip(cone, cone @ local, strict=True) if value > -1e-5 * weight]
            active += [slope[j] for j in range(18) if residual[6 + j] / limit > 1 - 1e-5]
            active += [-slope[j] for j in range(18) if residual[6 + j] / limit < -1 + 1e-5]
            columns = [*spans[:6], *-spans[:6], *active]
            off = nnls(np.array(columns).T, -gradient)[1]
            assert off < 1e-6 * max(np.linalg.norm(gradient), 1e-3), k
        else:
            # Independent certificate, with forces as sums of the pyramid's edges: slack is needed.
            edges = 2.0 * np.arange(FACETS) * np.pi / FACETS
            rays = np.stack([MU * np.cos(edges), MU * np.sin(edges), np.ones(FACETS)])
            reach = np.concatenate([spans[:, 3 * i : 3 * i + 3] @ rays for i in range(len(legs))], axis=1)
            size = reach.shape[1]
            slack = np.hstack([np.eye(6), -np.eye(6)])
            cost = np.r_[np.zeros(size), np.ones(12)]
            wall, bound = None, None
            if found.outcome[k] == "torque":
                wall = np.vstack([np.hstack([side * reach[6:], np.zeros((18, 12))]) for side in (1.0, -1.0)])
                bound = np.concatenate([limit + gravity[6:], limit - gravity[6:]])
            least = linprog(cost, wall, bound, np.hstack([reach[:6], slack]), gravity[:6], method="highs")
            assert (least.status == 0 and least.fun > 1e-6) or least.status == 2, (k, found.outcome[k])


def test_cost_is_that_of_another_solver_on_another_formulation(athena):
    import casadi as ca

    robot, rng = athena, np.random.default_rng(3)
    q = robot.standing_q + rng.uniform(-0.4, 0.4, (25, 6, 3))
    T, carrying = poses_on_slope(25, rng, 0.5), np.ones((25, 6), dtype=bool)
    found = distribute(robot, T, q, carrying, T[:, None, :3, 2], facets=8)
    limit, weight = robot.servo.max_torque, robot.mass * dynamics.GRAVITY
    angle = (2.0 * np.arange(8) + 1.0) * np.pi / 8
    facets = np.stack([np.cos(angle), np.sin(angle), np.full(8, -0.9 * np.cos(np.pi / 8))], axis=-1)
    for k in range(25):
        normals = np.broadcast_to(T[k, :3, 2], (6, 3))
        gravity, contact = wrenches(robot, T[k], q[k], normals)
        frames = statics.contact_frames(normals)
        spans = weight * np.concatenate([contact[leg].T @ frames[leg] for leg in range(6)], axis=1)
        slope, free = -spans[6:] / limit, gravity[6:] / limit
        rows = np.vstack([spans[:6], np.kron(np.eye(6), facets), slope])
        low = np.concatenate([gravity[:6], np.full(48, -np.inf), -1.0 - free])
        high = np.concatenate([gravity[:6], np.zeros(48), 1.0 - free])
        hessian = 2.0 * (slope.T @ slope + 1e-6 * np.eye(18))
        shapes = {"h": ca.DM(hessian).sparsity(), "a": ca.DM(rows).sparsity()}
        solver = ca.conic(
            "other",
            "osqp",
            shapes,
            {"osqp": {"verbose": False, "eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 200000}},
        )
        other = solver(h=hessian, g=2.0 * slope.T @ free, a=rows, lba=low, uba=high)
        assert found.cost[k] == pytest.approx(float(other["cost"]) + free @ free, rel=1e-6)


def standing(robot, T, n=1, feet=None):
    carrying = np.ones((n, robot.num_legs), dtype=bool)
    if feet is not None:
        carrying[:] = feet
    return np.broadcast_to(T, (n, 4, 4)), np.broadcast_to(robot.standing_q, (n, robot.num_legs, 3)), carrying


def test_why_there_are_no_forces_is_named(athena):
    tilted = hk.transforms.pose(hk.transforms.axis_rotation([1.0, 0.0, 0.0], np.radians(50.0)), np.zeros(3))
    found = distribute(athena, *standing(athena, tilted), tilted[:3, 2], friction=0.9)
    assert found.outcome[0] == "friction" and np.isnan(found.force).all()
    one_side = [True, True, False, False, False, True]  # the right legs: the centre of mass is outside
    assert distribute(athena, *standing(athena, np.eye(4), feet=one_side)).outcome[0] == "support"
    assert distribute(athena, *standing(athena, np.eye(4), feet=[False] * 6)).outcome[0] == "support"
    weak = distribute(athena, *standing(athena, np.eye(4)), max_torque=0.08)
    assert weak.outcome[0] == "torque"
    needed = float(weak.torque_needed[0])
    assert distribute(athena, *standing(athena, np.eye(4)), max_torque=needed * (1 + 1e-5)).feasible.all()
    assert distribute(athena, *standing(athena, np.eye(4)), max_torque=needed * (1 - 1e-5)).outcome[0] == "torque"


@pytest.mark.parametrize("slope", [20.0, 35.0])
def test_friction_needed_on_a_slope_is_its_tangent(athena, slope):
    tilted = hk.transforms.pose(hk.transforms.axis_rotation([1.0, 0.0, 0.0], np.radians(slope)), np.zeros(3))
    T, q, carrying = standing(athena, tilted)
    problem = statics.static_problem(
        athena, T, leg_states(athena, q), carrying, tilted[:3, 2], friction=0.1, facets=16, torque_unit=1.0
    )
    assert forces.friction_needed(problem)[0] == pytest.approx(np.tan(np.radians(slope)), abs=2e-3)


def test_a_failed_solver_is_not_taken_for_infeasible(athena, monkeypatch):
    optimum = force_solver.optimum

    def fails(which):
        def broken(programme, name):
            y, cost = optimum(programme, name)
            return (y + 1.0, cost) if name in which else (y, cost)

        return broken

    arguments = standing(athena, np.eye(4), n=3)
    right = distribute(athena, *arguments)
    monkeypatch.setattr(force_solver, "optimum", fails(["daqp"]))
    rescued = distribute(athena, *arguments)
    assert rescued.feasible.all()
    np.testing.assert_allclose(rescued.cost, right.cost, rtol=1e-7)
    monkeypatch.setattr(force_solver, "optimum", fails(["daqp", "piqp"]))
    with pytest.raises(SolverError, match="instant 0"):
        distribute(athena, *arguments)


def test_two_feet_hold_a_robot_only_in_line_with_its_centre_of_mass(athena):
    found = distribute(athena, *standing(athena, np.eye(4), feet=[True, False, False, True, False, False]))
    assert found.feasible[0], "two feet in line with the centre of mass: a knife's edge, but forces exist"
    np.testing.assert_allclose(found.force[0].sum(axis=0), [0.0, 0.0, athena.mass * dynamics.GRAVITY], atol=1e-8)
    assert distribute(athena, *standing(athena, np.eye(4), feet=[1, 1, 0, 0, 0, 0])).outcome[0] == "support"


def test_a_robot_that_tips_is_not_said_to_slide_because_its_feet_are_not_quite_in_a_plane(athena):
    """Three feet of one side, a hair's breadth out of line: without a bound on friction they could be wedged."""
    T, q, carrying = standing(athena, np.eye(4), feet=[True, True, False, False, False, True])
    q = q + 1e-3 * np.random.default_rng(5).normal(size=q.shape)
    problem = statics.static_problem(
        athena, T, leg_states(athena, q), carrying, [0.0, 0.0, 1.0], friction=0.9, facets=16, torque_unit=1.0
    )
    assert force_solver.smallest_torque(problem, 0, np.array([[0.0, 0.0, -1.0]])) is not None, "wedged"
    assert distribute(athena, T, q, carrying, max_torque=np.inf).outcome[0] == "support"


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"friction": -0.1}, "friction"),
        ({"facets": 2}, "facets"),
        ({"max_torque": 0.0}, "max_torque"),
        ({"normals": [0.0, 0.0, 2.0]}, "normals"),
    ],
)
def test_arguments_that_cannot_be_used_are_named(athena, change, error):
    with pytest.raises(InvalidInputError, match=error):
        distribute(athena, *standing(athena, np.eye(4)), **change)


def test_commanded_walk_on_a_plane_moves_the_body_by_a_stride_a_phase_over_fixed_feet(athena):
    for terrain in (hk.terrain.Plane(), hk.terrain.Ramp()):
        motion = commanded_walk(hk.PostureController(athena), terrain, num_cycles=2)
        assert len(motion.time) == 80
        world = hk.transforms.transform_points(motion.T_world_body, motion.p_body_foot)
        held = motion.carrying[1:] & motion.carrying[:-1]
        assert np.linalg.norm(np.diff(world, axis=0), axis=-1)[held].max() < 1e-12
        forward = terrain.normal(0.0, 0.0)
        body = motion.T_world_body[[19, 39, 59, 79], :3, 3]
        np.testing.assert_allclose(np.linalg.norm(np.diff(body, axis=0), axis=1), 0.05, atol=1e-4)
        np.testing.assert_allclose(np.diff(body, axis=0) @ forward, 0.0, atol=1e-4)


def test_walk_on_the_papers_ramp_is_feasible_and_names_what_ends_it_on_a_steep_one(athena):
    controller = hk.PostureController(athena)
    report = check(athena, commanded_walk(controller, hk.terrain.Ramp(), num_cycles=1), hk.terrain.Ramp())
    assert report.feasible and report.binding == ()
    assert set(report.constraints) >= {"reach", "joint limits", "joint speed", "torque", "friction", "balance"}
    steep = hk.terrain.Ramp(slope=np.radians(30.0))
    motion = commanded_walk(controller, steep, num_cycles=1)
    slippery = check(athena, motion, steep, friction=0.4)
    assert "friction" in slippery.binding and not slippery.feasible
    worst = slippery.constraints["friction"]
    needed = 0.4 - worst.worst
    assert f"{needed:.3g}"[:4] in worst.mend
    assert "friction" not in check(athena, motion, steep, friction=needed + 1e-3).binding
    assert "NO" in str(slippery)


def test_of_equally_bad_instants_the_first_is_named(athena):
    plane = hk.terrain.Plane()
    report = check(athena, commanded_walk(hk.PostureController(athena), plane, num_cycles=3), plane)
    for name in ("reach", "joint limits", "balance", "torque"):
        constraint = report.constraints[name]
        assert constraint.time <= 2.05, "cycles repeat; the first, and the instant that begins the next, take 2.05 s"
        assert constraint.worst == np.nanmin(constraint.slack)
    with pytest.warns(DeprecationWarning, match="now called slack"):
        assert constraint.margins is constraint.slack


def changed(motion, **fields):
    import dataclasses

    return dataclasses.replace(motion, **fields)


@pytest.fixture(scope="module")
def walk(athena):
    return commanded_walk(hk.PostureController(athena), hk.terrain.Plane(), num_cycles=1)


def test_each_violation_is_found_with_its_leg_and_time(athena, walk):
    plane = hk.terrain.Plane()
    at, leg = 30, 2
    target = np.array(walk.p_body_foot)
    target[at, leg] *= 2.0
    q = np.array(walk.q)
    q[at, leg] = np.nan
    far = check(athena, changed(walk, p_body_foot=target, q=q), plane)
    reach = far.constraints["reach"]
    assert far.binding == ("reach",) and (reach.leg, reach.time) == (leg + 1, walk.time[at])
    assert far.forces.outcome[at] == "" and (np.delete(far.forces.outcome, at) == "balanced").all()

    q = np.array(walk.q)
    q[at, leg, 0] = athena.q_max[leg, 0] + 0.1
    beyond = check(athena, changed(walk, q=q, p_body_foot=hk.forward_kinematics(athena, q)), plane).constraints[
        "joint limits"
    ]
    assert (beyond.leg, beyond.time) == (leg + 1, walk.time[at]) and beyond.worst == pytest.approx(-0.1)

    fast = check(athena, changed(walk, time=0.1 * walk.time), plane)
    assert fast.binding == ("joint speed",)
    slower = float(fast.constraints["joint speed"].mend.split()[1])
    assert check(athena, changed(walk, time=0.1 * slower * 1.01 * walk.time), plane).feasible

    T = np.array(walk.T_world_body)
    T[:, 2, 3] -= 0.078
    low = check(athena, changed(walk, T_world_body=T), plane)
    assert "torso clearance" in low.binding
    assert low.constraints["torso clearance"].worst == pytest.approx(-0.002, abs=1e-9)

    clipped = np.zeros_like(walk.clipped)
    clipped[at, leg] = True
    stopped = check(athena, changed(walk, clipped=clipped), plane).constraints["joint limits"]
    assert stopped.satisfied is False and (stopped.leg, stopped.time) == (leg + 1, walk.time[at])

    at = 19  # at the end of a phase all feet are on the ground
    carrying = np.array(walk.carrying)
    carrying[at] = [True, True, False, False, False, True]
    tips = check(athena, changed(walk, carrying=carrying), plane)
    assert "balance" in tips.binding and tips.constraints["balance"].time == walk.time[at]


def test_plans_of_paper_b_are_checked_on_any_terrain_and_on_its_own_curves():
    robot = hk.load_robot("hwr")
    plan = hk.plan_walk(robot, hk.terrain.Plane(), num_steps=2)
    assert check(robot, plan, hk.terrain.Plane()).feasible
    curves = hk.terrain.LegCurves(reference_z=lambda s, y: 0.02 * np.sin(8.0 * s))
    report = check(robot, hk.plan_walk(robot, curves, num_steps=2), curves)
    assert report.constraints["knee clearance"].satisfied is None
    assert "not checked" in str(report) and report.constraints["torque"].satisfied
    long = hk.plan_walk(robot, hk.terrain.Plane(), num_steps=2, step_length=0.6, on_failure="mark")
    assert "reach" in check(robot, long, hk.terrain.Plane()).binding


def test_a_motion_that_is_nowhere_in_reach_is_reported_and_has_no_forces():
    robot = hk.load_robot("hwr")
    plan = hk.plan_walk(robot, hk.terrain.Plane(), num_steps=1, body_height=0.3, on_failure="mark")
    report = check(robot, plan, hk.terrain.Plane())
    assert report.binding == ("reach",) and (report.forces.outcome == "").all()
    assert np.isnan(report.forces.force).all() and report.constraints["torque"].satisfied is None


def test_a_robot_without_a_speed_limit_says_that_speed_was_not_checked(athena, walk):
    import dataclasses

    unknown = dataclasses.replace(athena, servo=dataclasses.replace(athena.servo, max_speed=None))
    speed = check(unknown, walk, hk.terrain.Plane()).constraints["joint speed"]
    assert speed.satisfied is None and "max_speed" in speed.mend


def test_what_cannot_be_checked_is_refused(athena, walk):
    with pytest.raises(InvalidInputError, match="motion"):
        check(athena, "walk", hk.terrain.Plane())
    with pytest.raises(InvalidInputError, match="terrain"):
        check(athena, walk, hk.terrain.Plane)
    with pytest.raises(InvalidInputError, match="clearance"):
        check(athena, walk, hk.terrain.Plane(), clearance=-1.0)
    with pytest.raises(InvalidInputError, match="heights"):
        check(athena, walk, hk.terrain.LegCurves())
    assert isinstance(checks.motion_of(athena, walk), Motion)
