"""The URDF agrees with the description in PyBullet and in Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

import hexakin as hk


@pytest.fixture(scope="module")
def urdf(athena):
    return hk.urdf.to_urdf(athena)


@pytest.mark.pybullet
def test_foot_positions_agree_between_generated_code_pinocchio_and_pybullet(athena, urdf, tmp_path, rng):
    import pybullet

    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    path = tmp_path / "athena.urdf"
    path.write_text(urdf)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        links = {
            pybullet.getJointInfo(body, i, client)[12].decode(): i for i in range(pybullet.getNumJoints(body, client))
        }
        joints = {
            pybullet.getJointInfo(body, i, client)[1].decode(): i for i in range(pybullet.getNumJoints(body, client))
        }
        for _ in range(20):
            q = rng.uniform(athena.q_min, athena.q_max, (6, 3))
            expected = hk.forward_kinematics(athena, q)
            configuration = pin.neutral(model)
            for leg in range(6):
                for k, name in enumerate(athena.table.joints):
                    configuration[model.joints[model.getJointId(f"{name}_{leg + 1}")].idx_q] = q[leg, k]
                    pybullet.resetJointState(body, joints[f"{name}_{leg + 1}"], q[leg, k], physicsClientId=client)
            pin.framesForwardKinematics(model, data, configuration)
            for leg in range(6):
                frame = data.oMf[model.getFrameId(f"foot_{leg + 1}")].translation
                assert frame == pytest.approx(expected[leg], abs=1e-12)
                # The centre of mass, which is the foot's centre, comes in double precision; the link frame does not.
                state = pybullet.getLinkState(body, links[f"foot_{leg + 1}"], 0, 1, physicsClientId=client)
                assert state[0] == pytest.approx(expected[leg], abs=1e-9)
    finally:
        pybullet.disconnect(client)


@pytest.mark.pybullet
def test_masses_and_inertias_arrive_in_both_engines(athena, urdf, tmp_path):
    import pybullet

    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(2.1334, abs=1e-12)
    assert model.nv == 24
    path = tmp_path / "athena.urdf"
    path.write_text(urdf)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        count = pybullet.getNumJoints(body, client)
        info = [pybullet.getDynamicsInfo(body, link, client) for link in range(-1, count)]
        assert sum(entry[0] for entry in info) == pytest.approx(2.1334, abs=1e-12)
        assert info[0][2] == pytest.approx(np.diag(athena.torso.inertia))
        assert info[2][2] == pytest.approx(np.diag(athena.segments["femur"].inertia))
        limits = pybullet.getJointInfo(body, 0, client)[8:11]
        assert limits == pytest.approx((-0.612, 0.612, 1.89))
    finally:
        pybullet.disconnect(client)


def test_composite_inertia_equals_the_descriptions_bodies(athena, urdf):
    """Mass, centre of mass and inertia of the whole robot, summed body by body without the URDF."""
    from hexakin.kinematics import segment_poses

    q = athena.standing_q
    bodies = [(athena.torso, np.eye(4))]
    for leg, poses in enumerate(segment_poses(athena, q)):
        bodies += [(athena.segments[name], poses[k]) for k, name in enumerate(("coxa", "femur", "tibia"))]
        foot = np.eye(4)
        foot[:3, 3] = hk.forward_kinematics(athena, q)[leg]
        bodies.append((athena.foot, foot))
    total = pin.Inertia.Zero()
    for body, T in bodies:
        total += pin.SE3(T[:3, :3], T[:3, 3]).act(pin.Inertia(body.mass, body.center_of_mass, body.inertia))
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    configuration = pin.neutral(model)
    for leg in range(6):
        for k, name in enumerate(athena.table.joints):
            configuration[model.joints[model.getJointId(f"{name}_{leg + 1}")].idx_q] = q[leg, k]
    data = model.createData()
    pin.ccrba(model, data, configuration, np.zeros(model.nv))
    assert data.Ig.mass == pytest.approx(total.mass)
    assert data.com[0] == pytest.approx(total.lever, abs=1e-12)
    assert data.Ig.inertia == pytest.approx(total.inertia, abs=1e-12)
