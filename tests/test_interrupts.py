"""Ctrl-C ends work of any kind with KeyboardInterrupt, also where the work is not done in Python.

python tests/test_interrupts.py    # prints how long each kind of work goes on after Ctrl-C
"""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from hexakin.numerics.interrupts import interrupts_kept, many_interrupts_kept
from hexakin.numerics.numba_cache import announced

# Each program prints a line, and then works for many minutes or for ever.
START = """
import numpy as np, hexakin as hk
from hexakin import contact, feasibility, symbolic
robot, plane = hk.load_robot("athena"), hk.terrain.Plane()
def begin(): print("begins", flush=True)
def walk(engine, duration):
    hk.simulate(robot, plane, hk.PostureController(robot), engine=engine, duration=duration, settling_time=0.05)
numbers = np.random.default_rng(1)
J = numbers.standard_normal((12, 3, 8))
contacts = contact.ContactProblem(np.eye(8), numbers.standard_normal(8), J, friction=3.0)
def solve(facets, tolerance, count):
    try:
        contact.solve(contacts, facets=facets, tolerance=tolerance, max_iterations=count)
    except hk.exceptions.ContactError:
        pass
"""
WORK = {
    "contact forces, cone": "solve(None, 1.0, 1)\nbegin()\nsolve(None, 1e-300, 10**9)",
    "contact forces, polyhedron": "solve(4, 1.0, 1)\nbegin()\nwhile True: solve(256, 1e-300, 10**9)",
    "walk, rigid": "walk('rigid', 0.05)\nbegin()\nwalk('rigid', 3600.0)",
    "walk, pybullet": "walk('pybullet', 0.05)\nbegin()\nwalk('pybullet', 3600.0)",
    "plan": "begin()\nwhile True: hk.plan_walk(robot, plane, num_steps=1000)",
    "IPOPT": "begin()\nwhile True: feasibility.best_posture(robot, slope=0.1)",
    "inverse kinematics": "feet = np.tile(hk.forward_kinematics(robot, robot.standing_q), (10**5, 1, 1))\nbegin()\n"
    "while True: hk.inverse_kinematics(robot, feet)",
    "derivation": "begin()\nwhile True: symbolic.derive(robot.table).inverse",
    "rays": "field = hk.terrain.HeightField(np.arange(200.0), np.arange(200.0), np.zeros((200, 200)))\nbegin()\n"
    "while True: field.distance_along(np.full((10**5, 3), 100.0), np.array([0.6, 0.0, -0.8]))",
}


def after_interrupt(work):
    """Send SIGINT half a second after ``work`` begins; return the time [s] to its end, the exit code and stderr."""
    process = subprocess.Popen(
        [sys.executable, "-c", START + work], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "begins\n", process.communicate(timeout=60)
        time.sleep(0.5)
        assert process.poll() is None, process.communicate()
        sent = time.monotonic()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    return time.monotonic() - sent, process.returncode, errors


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is a signal")
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.pybullet) if "pybullet" in kind else kind for kind in WORK]
)
def test_an_interrupt_ends_any_work(kind):
    _, code, errors = after_interrupt(WORK[kind])
    assert code == -signal.SIGINT
    assert errors.splitlines()[-1] == "KeyboardInterrupt"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_python_drops_ends_a_compilation():
    class Dropping:
        def __del__(self):
            signal.raise_signal(
                signal.SIGINT
            )  # numba's compiler has destructors, and callbacks, in which it can arrive

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), announced("a test"):
            Dropping()
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_blocks_inside_one_that_makes_them_cheap_keep_their_own_interrupts_only():
    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with many_interrupts_kept():
            inside = signal.getsignal(signal.SIGINT)
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)  # handled outside of the blocks
            with interrupts_kept() as raised:
                assert signal.getsignal(signal.SIGINT) is inside and raised == []
            with pytest.raises(KeyboardInterrupt), interrupts_kept() as outer:
                with pytest.raises(KeyboardInterrupt), interrupts_kept():
                    Dropping()
                assert len(outer) == 1
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        with many_interrupts_kept():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for name, program in WORK.items():
        seconds, code, _ = after_interrupt(program)
        print(f"{name}: {seconds:.2f} s, exit code {code}")
