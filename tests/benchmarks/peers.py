"""Kinematics of ATHENA's legs by other libraries, each in its fastest documented way.

A ``Code`` maps an array (n, 6, 3) to another: angles [rad] to feet [m] or Jacobians (n, 6, 3, 3) [m/rad], or feet to
angles. A library without batches is called in a loop that fills an array. The loop is part of the measured time,
because users need it too. Pinocchio and CasADi have no inverse, and ikpy has no Jacobian.
"""

from __future__ import annotations

import functools
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from comparison import installed

from hexakin.robot.urdf import to_urdf

MANY = 1_000_000
"""Largest number of poses; all codes with batches are timed for it."""


@dataclass(frozen=True)
class Code:
    """One function of a library, timed for at most ``most`` poses; times for more poses are scaled.

    ``search`` is whether the function searches for angles, and may end away from the foot.
    """

    function: str
    name: str
    call: Callable[[np.ndarray], np.ndarray]
    most: int = MANY
    search: bool = False


def codes(robot) -> list[Code]:
    """Return the codes of all libraries that are installed."""
    found: list[Code] = []
    for packages, make in (
        (("roboticstoolbox",), toolbox),
        (("ikpy",), ikpy),
        (("pinocchio",), pinocchio),
        (("casadi",), casadi),
    ):
        if installed(*packages):
            found += make(robot)
    return found


def looped(one: Callable[[int, np.ndarray], object], shape: tuple[int, ...]) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that calls ``one(leg, values)`` for every leg of every pose."""

    def call(values: np.ndarray) -> np.ndarray:
        result = np.empty(values.shape[:2] + shape)
        for pose, every in enumerate(values):
            for leg, value in enumerate(every):
                result[pose, leg] = one(leg, value)
        return result

    return call


def toolbox(robot) -> Iterator[Code]:
    """Yield the functions of elementary transforms (ETS), which are compiled.

    ``fkine`` returns an SE3, ``eval`` matrices. ``ik_LM`` is the compiled Levenberg-Marquardt search. It starts from
    the standing pose and is used for positions only. Its tolerance is set for an error of a nanometre at the foot; with
    the default the error is a millimetre.
    """
    from roboticstoolbox import ET

    legs = [
        ET.Rz(t) * ET.tx(a) * ET.Rz() * ET.tx(b) * ET.Rx(np.pi / 2) * ET.Rz() * ET.tx(c) * ET.Rz() * ET.tx(d)
        for t, a, b, c, d in robot.parameters
    ]
    target, position = np.eye(4), np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    start = robot.standing_q.copy()  # the compiled code does not take read-only arrays

    def at_once(q):
        return np.stack([leg.eval(np.ascontiguousarray(q[:, k]))[..., :3, 3] for k, leg in enumerate(legs)], axis=1)

    def one_by_one(q):
        return looped(lambda leg, angles: legs[leg].eval(angles)[:3, 3], (3,))(q)

    def inverse(leg, foot):
        target[:3, 3] = foot
        return legs[leg].ik_LM(target, q0=start[leg], tol=1e-19, mask=position).q

    yield Code("forward", "Robotics Toolbox, fkine", looped(lambda leg, q: legs[leg].fkine(q).t, (3,)), 1000)
    yield Code("forward", "Robotics Toolbox, eval", lambda q: at_once(q) if len(q) > 1 else one_by_one(q), 100_000)
    yield Code("jacobian", "Robotics Toolbox, jacob0", looped(lambda leg, q: legs[leg].jacob0(q)[:3], (3, 3)), 1000)
    yield Code("inverse", "Robotics Toolbox, ik_LM", looped(inverse, (3,)), 100, search=True)


def ikpy(robot) -> Iterator[Code]:
    """Yield the functions of chains from the URDF; the inverse is scipy's least squares from the standing pose."""
    from ikpy.chain import Chain

    first, second, third = robot.table.joints
    moving = [False, True, True, True, False]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(to_urdf(robot), encoding="utf-8")
        legs = []
        for k in range(1, robot.num_legs + 1):
            path = [f"{first}_{k}", f"coxa_{k}", f"{second}_{k}", f"femur_{k}", f"{third}_{k}", f"tibia_{k}"]
            elements = ["torso", *path, f"ankle_{k}"]
            legs.append(Chain.from_urdf_file(str(file), base_elements=elements, active_links_mask=moving))

    def forward(leg, q):
        return legs[leg].forward_kinematics([0.0, *q, 0.0])[:3, 3]

    def inverse(leg, foot):
        return legs[leg].inverse_kinematics(foot, initial_position=[0.0, *robot.standing_q[leg], 0.0])[1:4]

    yield Code("forward", "ikpy", looped(forward, (3,)), 100)
    yield Code("inverse", "ikpy", looped(inverse, (3,)), 10, search=True)


def pinocchio(robot) -> Iterator[Code]:
    """Yield the functions of one model from the URDF; each pose needs one call for all legs and one for each foot."""
    import pinocchio as pin

    model = pin.buildModelFromXML(to_urdf(robot))
    data = model.createData()
    feet = [model.getFrameId(f"foot_{leg + 1}") for leg in range(robot.num_legs)]
    names = [f"{joint}_{leg + 1}" for leg in range(robot.num_legs) for joint in robot.table.joints]
    assert list(model.names)[1:] == names, "Pinocchio has the joints in another order"

    def forward(q):
        result = np.empty(q.shape)
        for pose, angles in enumerate(q.reshape(len(q), -1)):
            pin.framesForwardKinematics(model, data, angles)
            for leg, foot in enumerate(feet):
                result[pose, leg] = data.oMf[foot].translation
        return result

    def jacobian(q):
        result = np.empty((*q.shape, 3))
        for pose, angles in enumerate(q.reshape(len(q), -1)):
            pin.computeJointJacobians(model, data, angles)
            pin.updateFramePlacements(model, data)
            for leg, foot in enumerate(feet):
                columns = slice(3 * leg, 3 * leg + 3)
                full = pin.getFrameJacobian(model, data, foot, pin.LOCAL_WORLD_ALIGNED)
                result[pose, leg] = full[:3, columns]
        return result

    yield Code("forward", "Pinocchio", forward, 10_000)
    yield Code("jacobian", "Pinocchio", jacobian, 10_000)


def casadi(robot) -> Iterator[Code]:
    """Yield A(12) and its derivative as CasADi functions of all legs, mapped over the poses, on NumPy's memory.

    Both run on CasADi's virtual machine, and as C code that CasADi writes and that is compiled for this machine.
    """
    import casadi as ca

    q = ca.SX.sym("q", 3, robot.num_legs)
    feet, jacobians = [], []
    for leg, (theta_1, l_1, l_2, l_3, l_4) in enumerate(robot.parameters.tolist()):
        angle, femur, tibia = theta_1 + q[0, leg], q[1, leg], q[1, leg] + q[2, leg]
        radius = l_2 + l_3 * ca.cos(femur) + l_4 * ca.cos(tibia)
        x, y = l_1 * np.cos(theta_1) + radius * ca.cos(angle), l_1 * np.sin(theta_1) + radius * ca.sin(angle)
        foot = ca.vertcat(x, y, l_3 * ca.sin(femur) + l_4 * ca.sin(tibia))
        feet.append(foot)
        # CasADi stores columns, NumPy rows.
        jacobians.append(ca.vec(ca.densify(ca.jacobian(foot, q[:, leg])).T))
    written = {
        "forward": ca.Function("forward", [ca.vec(q)], [ca.vertcat(*feet)]),
        "jacobian": ca.Function("jacobian", [ca.vec(q)], [ca.vertcat(*jacobians)]),
    }
    for name, shape in (("forward", (3,)), ("jacobian", (3, 3))):
        yield Code(name, "CasADi", mapped(written[name], shape))
        if shutil.which("cc"):
            yield Code(name, "CasADi, compiled C", mapped(compiled(written[name]), shape))


def mapped(function, shape: tuple[int, ...]) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that maps a CasADi function over all poses, without conversion to CasADi's matrices."""

    @functools.cache
    def prepared(count: int):
        every = function.map(count) if count > 1 else function
        return every, *every.buffer()

    def call(values: np.ndarray) -> np.ndarray:
        _, buffer, evaluate = prepared(len(values))
        result = np.empty(values.shape[:2] + shape)
        buffer.set_arg(0, memoryview(values))
        buffer.set_res(0, memoryview(result))
        evaluate()
        return result

    return call


def compiled(function):
    """Return the function as C code that CasADi writes, compiled with ``cc -O3 -march=native``."""
    import casadi as ca

    folder = Path(tempfile.mkdtemp(prefix="casadi_"))
    try:
        source = function.generate(f"{function.name()}.c", {"with_mem": False})
        shutil.move(source, folder)
        library = folder / f"{function.name()}.so"
        call = ["cc", "-O3", "-march=native", "-fPIC", "-shared", str(folder / source), "-o", str(library), "-lm"]
        subprocess.run(call, check=True)
        return ca.external(function.name(), str(library))
    finally:
        shutil.rmtree(folder)
