"""One walk on each build of PyBullet: the official wheel on Python 3.11, the fork on 3.11 and 3.13 (Linux, x86_64).

    python tests/wheel/pybullet_builds.py

All arrays of the three recordings must be equal to the last bit. ``make test-wheel`` calls this file.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np
from environments import built_wheel, install, installed, interpreter, new_environment, uninstall

BUILDS = (("3.11", "pybullet"), ("3.11", "pybullet-arm64"), ("3.13", "pybullet-arm64"))
# NumPy and SciPy are those of this Python, so that nothing but the build of PyBullet differs.
SAME = [f"{name}=={metadata.version(name)}" for name in ("numpy", "scipy")]
WALK = """
import hexakin as hk
robot = hk.load_robot("athena")
controller = hk.PostureController(robot, k_z=0.8, k_alpha=0.6)
hk.simulate(robot, hk.terrain.Ramp(), controller, engine="pybullet", duration=2.0, seed=0).save("walk.npz")
"""


def walk(folder: Path, wheel: Path, version: str, package: str) -> dict[str, np.ndarray]:
    """Simulate with a build of PyBullet in an environment of its own; return the arrays of the recording."""
    folder.mkdir()
    python = new_environment(folder / "venv", interpreter(version))
    install(python, wheel, *SAME)
    if not installed(python, package):  # the markers choose the official wheel on Python 3.11
        uninstall(python, "pybullet")
        install(python, package)
    subprocess.run([python, "-I", "-c", WALK], cwd=folder, check=True)
    with np.load(folder / "walk.npz") as stored:
        return {name: stored[name] for name in stored.files if stored[name].dtype.kind != "U"}  # "U": names, versions


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        wheel = built_wheel(Path(name))
        walks = [walk(Path(name, str(number)), wheel, *build) for number, build in enumerate(BUILDS)]
    first = walks[0]
    for build, other in zip(BUILDS[1:], walks[1:], strict=True):
        unequal = [name for name in first if first[name].tobytes() != other[name].tobytes()]
        if unequal or len(first) < 20:
            sys.exit(f"{build} and {BUILDS[0]} differ in {unequal}, of {len(first)} arrays")
    print(f"one walk on {len(BUILDS)} builds of PyBullet: {len(first)} arrays, equal to the last bit")


if __name__ == "__main__":
    main()
