"""Time a step of engine "rigid", PyBullet and MuJoCo, in turn in one run.

    python tests/benchmarks/rigid_engine.py [--quick]

All three run the same joint commands of ATHENA's walk at steps of 1 ms, on level ground and on blocks. MuJoCo has the
model of ``hk.mjcf.to_mjcf`` with its default contacts and solver, and position servos with the same rate, torque limit
and friction; engine "mujoco" has other servos and contacts, and sensors. The closed loop is ``hexakin.simulate``,
with controller, sensors and recording. Engine "pybullet" is hexakin's: it reads contacts and rates from PyBullet in
every step, because the sensors need their means. Engine "rigid" computes the same means. "pybullet, no sensors" and
MuJoCo only make steps. Engines with different contact laws do not walk equally far: it is checked first that the bodies
stay within a few centimetres of each other.
"""

import functools
import subprocess
import sys
import time
from types import SimpleNamespace

import height_fields
import numpy as np
from comparison import alone, compared, installed, interleaved, timed

import hexakin as hk
from hexakin.engines import engine_class
from hexakin.simulation.closed_loop import starting_pose

SECONDS, STEPS_PER_TICK = 4.0, 50
BARE = "pybullet, no sensors"
APART = 0.05  # [m], largest distance between the bodies of two engines

athena = hk.load_robot("athena")


class MuJoCo:
    """The robot's MJCF with position servos; blocks as boxes."""

    def __init__(self, robot, terrain):
        import mujoco

        self.mujoco = mujoco
        spec = mujoco.MjSpec.from_string(hk.mjcf.to_mjcf(robot))
        spec.option.timestep = 1e-3
        for geom in spec.geoms:
            geom.friction[0] = 0.9
        for shape in terrain.shapes():
            if isinstance(shape, hk.terrain.Box):
                low, high = np.array(shape.lower), np.array(shape.upper)
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX, size=(high - low) / 2, pos=(high + low) / 2,
                    friction=[0.9, 0, 0], contype=0, conaffinity=1,
                )  # fmt: skip
            else:
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1], pos=shape.point,
                    friction=[0.9, 0, 0], contype=0, conaffinity=1,
                )  # fmt: skip
        names = [f"{joint}_{leg + 1}" for leg in range(robot.num_legs) for joint in robot.table.joints]
        for name in names:
            # Light links need an armature here. Stiffness and damping give the servo the robot's rate.
            spec.joint(name).armature = 0.01
            servo = spec.actuator(name)
            servo.ctrllimited = False  # it is an angle, not the torque of a motor
            damping = 2.0
            servo.gainprm[0] = damping * robot.servo.rate
            servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            servo.biasprm[1], servo.biasprm[2] = -damping * robot.servo.rate, -damping
            servo.forcelimited, servo.forcerange = True, [-robot.servo.max_torque, robot.servo.max_torque]
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def place(self, T, q):
        from scipy.spatial.transform import Rotation

        quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()[[3, 0, 1, 2]]
        self.data.qpos[:] = np.r_[T[:3, 3], quaternion, np.ravel(q)]
        self.data.qvel[:] = 0.0

    def advance(self, q_command, num_steps):
        self.data.ctrl[:] = np.ravel(q_command)
        for _ in range(num_steps):
            self.mujoco.mj_step(self.model, self.data)
        T = np.eye(4)
        T[:3, 3] = self.data.qpos[:3]
        return SimpleNamespace(T_world_body=T)

    def close(self):
        """Nothing to close."""


class BarePyBullet:
    """hexakin's PyBullet engine without sensors: only commands, steps, and the pose after each tick."""

    def __init__(self, robot, terrain):
        self.engine = engine_class("pybullet")(robot, terrain)
        self.place = self.engine.place
        self.close = self.engine.close

    def advance(self, q_command, num_steps):
        import pybullet

        engine, servo = self.engine, athena.servo
        count = len(engine._joints)
        pybullet.setJointMotorControlArray(
            engine._body, engine._joints, pybullet.POSITION_CONTROL, targetPositions=np.ravel(q_command).tolist(),
            targetVelocities=[0.0] * count, forces=[servo.max_torque] * count,
            positionGains=[servo.rate * engine._time_step] * count, velocityGains=[1.0] * count,
            physicsClientId=engine._client,
        )  # fmt: skip
        for _ in range(num_steps):
            pybullet.stepSimulation(physicsClientId=engine._client)
        T = np.eye(4)
        T[:3, 3] = pybullet.getBasePositionAndOrientation(engine._body, physicsClientId=engine._client)[0]
        return SimpleNamespace(T_world_body=T)


def replay(make, terrain, commands):
    """Run ``commands`` after settling; return the thread's time per step [s] and the path of the body (n, 3) [m]."""
    engine = make(athena, terrain)
    q = athena.standing_q
    engine.place(starting_pose(athena, terrain, q), q)
    engine.advance(q, 500)
    path, start = [], time.thread_time()
    for command in commands:
        path.append(engine.advance(command, STEPS_PER_TICK).T_world_body[:3, 3])
    taken = time.thread_time() - start
    engine.close()
    return taken / (len(commands) * STEPS_PER_TICK), np.array(path)


def walk(name, terrain):
    """Simulate with the controller."""
    return hk.simulate(athena, terrain, hk.PostureController(athena), engine=name, duration=SECONDS, settling_time=0.05)


def start_up():
    """Return timings of the first engine and first step in a fresh interpreter, with cached machine code."""
    program = (
        "import time, numpy, hexakin as hk\nfrom hexakin.engines import engine_class\n"
        "r = hk.load_robot('athena'); t = time.perf_counter()\n"
        "e = engine_class('{}')(r, hk.terrain.Plane()); e.place(numpy.eye(4), r.standing_q)\n"
        "e.advance(r.standing_q, 1); print(time.perf_counter() - t)\n"
    )

    def of(name):
        done = subprocess.run([sys.executable, "-c", program.format(name)], capture_output=True, check=True)
        return float(done.stdout)

    return {name: functools.partial(of, name) for name in ("rigid", "pybullet")}


def check(paths):
    """Check that all robots walked nearly the same path; contact laws differ, so that the paths do too."""
    reference = paths["rigid"]
    for name, path in paths.items():
        apart = np.abs(path - reference).max(axis=0)
        print(
            f"  {name}: at most {1e3 * apart[:2].max():.1f} mm beside rigid's path, {1e3 * apart[2]:.1f} mm in height"
        )
        assert apart.max() < APART, f"{name}: {apart} m from the path of rigid"


def measure(quick=False):
    """Return the rows of a step and of the closed loop on both terrains, of the start, and of height fields."""
    repetitions = 2 if quick else 7
    engines = {"rigid": engine_class("rigid"), "pybullet": engine_class("pybullet"), BARE: BarePyBullet}
    if installed("mujoco"):
        engines["mujoco"] = MuJoCo
    rows = []
    for title, terrain, share in (("level", hk.terrain.Plane(), 0.15), ("blocks", hk.terrain.Blocks(), 0.2)):
        print(title)
        rows += on_ground(title, terrain, share, engines, repetitions)
    starts = interleaved(start_up(), repetitions)
    rows += compared("engine start", 1, "start", starts, {("rigid", "pybullet"): None}, clock="wall")
    return rows + height_fields.measure(quick)


def on_ground(title, terrain, share, engines, repetitions):
    """Return the rows of one terrain; ``share`` is the bar for the ratio of a step to PyBullet's."""
    commands = walk("rigid", terrain).q_command
    steps = len(commands) * STEPS_PER_TICK
    check({name: replay(make, terrain, commands)[1] for name, make in engines.items()})
    timings = {name: lambda make=make: steps * replay(make, terrain, commands)[0] for name, make in engines.items()}
    pairs = {("rigid", name): share if name == "pybullet" else None for name in engines if name != "rigid"}
    rows = compared(f"step, {title}", steps, "step", interleaved(timings, repetitions), pairs)
    loops = {name: timed(lambda name=name: walk(name, terrain)) for name in ("rigid", "pybullet")}
    simulated = round((SECONDS + 0.1) * 1e3)  # with settling
    times = interleaved(loops, repetitions // 2 + 1)
    return rows + compared(f"closed loop, {title}", simulated, "step", times, {("rigid", "pybullet"): 0.25})


if __name__ == "__main__":
    alone(measure)
