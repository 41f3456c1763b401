"""Time per step of engine "rigid" as ratios to PyBullet and MuJoCo, in one interleaved run.

    pip install mujoco
    python tests/benchmarks/rigid_engine.py

All three replay the same joint commands of ATHENA's walk at steps of 1 ms, on the level and on blocks; MuJoCo has a
position servo with the same rate, torque limit and friction, from the same URDF. The closed loop is
``hexakin.simulate``, controller, sensors and recording included. Medians over repetitions; the machine's own speed
cancels in a ratio.
"""

import statistics
import sys
import time
import xml.etree.ElementTree as ET

import numpy as np

import hexakin as hk
from hexakin.engines import engine_class
from hexakin.simulation import starting_pose
from hexakin.urdf import to_urdf

REPETITIONS, SECONDS, STEPS_PER_TICK = 7, 4.0, 50

athena = hk.load_robot("athena")


class MuJoCo:
    """The URDF with a free base and position servos; blocks as boxes."""

    def __init__(self, robot, terrain):
        import mujoco

        self.mujoco = mujoco
        root = ET.fromstring(to_urdf(robot))
        # Keep the torso as a body of its own and give its mass and inertia as they are.
        extension = ET.SubElement(root, "mujoco")
        ET.SubElement(extension, "compiler", fusestatic="false", discardvisual="true", balanceinertia="true")
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        spec.option.timestep = 1e-3
        torso = spec.body("torso")
        torso.add_freejoint()
        for geom in spec.geoms:
            # Feet and limbs meet the ground, not each other.
            geom.friction[0], geom.contype, geom.conaffinity = 0.9, 1, 0
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
            # The armature that light links need here; stiffness and damping make a servo of the robot's rate.
            spec.joint(name).armature = 0.01
            servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
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


def replay(make, terrain, commands):
    """Time per step [s] of replaying ``commands`` after a settled start."""
    engine = make(athena, terrain)
    q = athena.standing_q
    engine.place(starting_pose(athena, terrain, q), q)
    engine.advance(q, 500)
    start = time.perf_counter()
    for command in commands:
        engine.advance(command, STEPS_PER_TICK)
    return (time.perf_counter() - start) / (len(commands) * STEPS_PER_TICK), engine


def closed_loop(name, terrain):
    start = time.perf_counter()
    hk.simulate(athena, terrain, hk.PostureController(athena), engine=name, duration=SECONDS, settling_time=0.05)
    return (time.perf_counter() - start) / ((SECONDS + 0.1) * 1e3)


def report(title, times, base):
    medians = {name: statistics.median(values) for name, values in times.items()}
    print(f"\n{title}")
    for name, values in times.items():
        ratios = sorted(a / b for a, b in zip(times["rigid"], values, strict=True))
        spread = f"rigid / {name} = {statistics.median(ratios):.3f} (pairs {ratios[0]:.3f} to {ratios[-1]:.3f})"
        print(f"  {name:9s} {1e6 * medians[name]:7.1f} us a step   {spread}")
    print(f"  bar: rigid <= {base[0]} x {base[1]}")


def start_up():
    """Seconds from a fresh interpreter's first engine to its first step, with the machine code cached."""
    import subprocess

    program = (
        "import time, numpy, hexakin as hk\nfrom hexakin.engines import engine_class\n"
        "r = hk.load_robot('athena'); t = time.perf_counter()\n"
        "e = engine_class('rigid')(r, hk.terrain.Plane()); e.place(numpy.eye(4), r.standing_q)\n"
        "e.advance(r.standing_q, 1); print(time.perf_counter() - t)\n"
    )
    run = [float(subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout)
           for _ in range(REPETITIONS)]  # fmt: skip
    print(f"\nstart-up, machine code cached: median {statistics.median(run):.2f} s, {min(run):.2f} to {max(run):.2f} s")


def main():
    engines = {"rigid": engine_class("rigid"), "pybullet": engine_class("pybullet")}
    try:
        import mujoco  # noqa: F401

        engines["mujoco"] = MuJoCo
    except ImportError:
        print("without MuJoCo: pip install mujoco")
    blocks = hk.terrain.Blocks()
    for title, terrain, share in (("level ground", hk.terrain.Plane(), 0.15), ("block testbed", blocks, 0.2)):
        walk = hk.simulate(athena, terrain, hk.PostureController(athena), engine="rigid", duration=SECONDS)
        times = {name: [] for name in engines}
        for repetition in range(REPETITIONS):
            for name, make in engines.items():
                seconds, engine = replay(make, terrain, walk.q_command)
                times[name].append(seconds)
                if repetition == 0 and name == "mujoco":
                    assert 0.05 < engine.data.qpos[2] < 0.4 and engine.data.ncon >= 3, "MuJoCo's robot does not stand"
                elif name != "mujoco":
                    engine.close()
        report(f"step, {title}", times, (share, "pybullet"))
        loops = {"rigid": [], "pybullet": []}
        for _ in range(REPETITIONS // 2 + 1):
            for name in loops:
                loops[name].append(closed_loop(name, terrain))
        report(f"closed loop, {title}", loops, (0.25, "pybullet"))
    start_up()


if __name__ == "__main__":
    main()
