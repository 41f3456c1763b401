"""hexakin without PyBullet and MuJoCo: which engine is used, what the errors say, and what still works."""

import json
import subprocess
import sys

import pytest
from PIL import Image

# An import of them then fails as if they were not installed.
WITHOUT = "import sys; sys.modules['pybullet'] = sys.modules['mujoco'] = None\n"


def program(text, folder):
    """Run a program in a process without the simulators and return the last line that it prints, read as JSON."""
    done = subprocess.run([sys.executable, "-c", WITHOUT + text], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_walk_is_simulated_on_rigid_and_says_why_and_its_gif_is_drawn(tmp_path):
    parameters = program(
        """
import json, hexakin as hk
robot, ramp = hk.load_robot("athena"), hk.terrain.Ramp()
walk = hk.simulate(robot, ramp, hk.PostureController(robot), duration=0.5, time_step=0.005)
hk.animation.animate(robot, walk, ramp).save("walk.gif", size=(160, 120))
print(json.dumps(walk.parameters))
""",
        tmp_path,
    )
    assert parameters["engine"] == "rigid"
    assert parameters["engine_choice"] == "default, because PyBullet is not installed"
    assert {"pin", "numba"} <= set(parameters["versions"])
    with Image.open(tmp_path / "walk.gif") as gif:
        assert gif.n_frames == 5 and len(gif.convert("RGB").getcolors(160 * 120)) > 50


def test_every_module_except_the_engines_can_be_imported(tmp_path):
    refused = program(
        """
import importlib, json
from hexakin import installation
refused = {}
for name in installation.modules():
    if not name.endswith("__main__"):
        try:
            importlib.import_module(name)
        except ImportError as error:
            refused[name] = type(error).__name__
print(json.dumps(refused))
""",
        tmp_path,
    )
    without = ("mujoco_engine", "mujoco_scene", "pybullet_engine", "pybullet_ground", "pybullet_import")
    assert refused == {f"hexakin.engines.{name}": "MissingPackageError" for name in without}


def test_a_request_for_mujoco_says_what_to_install_and_what_to_use_instead(tmp_path):
    answers = program(
        """
import json, platform, hexakin as hk
robot = hk.load_robot("athena")
answers = []
for python, system, machine in [
    ("3.11.7", "linux", "aarch64"),
    ("3.13.0", "darwin", "x86_64"),
    ("3.14.0", "darwin", "x86_64"),
]:
    sys.version_info, sys.platform = (*map(int, python.split(".")), "final", 0), system
    platform.python_version, platform.system, platform.machine = (lambda v=v: v for v in (python, system, machine))
    try:
        hk.simulate(robot, hk.terrain.Plane(), hk.PostureController(robot), engine="mujoco")
    except hk.exceptions.MissingPackageError as error:
        answers.append(str(error))
print(json.dumps(answers))
""",
        tmp_path,
    )
    assert answers == [
        f"""engine "mujoco" needs the package 'mujoco'; {how}; or use engine="rigid\""""
        for how in (
            "install it with: pip install mujoco",
            'install it with: pip install "mujoco<3.7"',
            "there is none for Python 3.14.0 on darwin x86_64",
        )
    ]


def test_a_robot_is_written_as_mjcf(tmp_path):
    code = "import json, hexakin as hk\nprint(json.dumps(hk.mjcf.to_mjcf(hk.load_robot('athena'))))"
    assert program(code, tmp_path).startswith('<mujoco model="')


def test_a_request_for_pybullet_says_what_to_install_and_what_to_use_instead(tmp_path):
    answers = program(
        """
import json, platform, hexakin as hk
robot = hk.load_robot("athena")
answers = []
for python, system, machine in [
    ("3.11.7", "Linux", "x86_64"),
    ("3.13.0", "Darwin", "arm64"),
    ("3.14.0", "Linux", "x86_64"),
    ("3.12.1", "Linux", "aarch64"),
]:
    sys.version_info = (*map(int, python.split(".")), "final", 0)
    platform.python_version, platform.system, platform.machine = (lambda v=v: v for v in (python, system, machine))
    try:
        hk.simulate(robot, hk.terrain.Plane(), hk.PostureController(robot), engine="pybullet")
    except hk.exceptions.MissingPackageError as error:
        answers.append(str(error))
print(json.dumps(answers))
""",
        tmp_path,
    )
    assert answers == [
        f"""engine "pybullet" needs the package 'pybullet'; {how}; or use engine="rigid\""""
        for how in (
            "install it with: pip install pybullet",
            "install it with: pip install pybullet-arm64",
            "there is none for Python 3.14.0 on Linux x86_64",
            "there is none for Python 3.12.1 on Linux aarch64",
        )
    ]


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("python", "system", "machine", "expected"),
    [
        ((3, 11), "Linux", "x86_64", "pybullet"),
        ((3, 11), "Darwin", "x86_64", "pybullet-arm64"),
        ((3, 11), "Windows", "AMD64", "pybullet-arm64"),
        ((3, 12), "Linux", "x86_64", "pybullet-arm64"),
        ((3, 13), "Linux", "x86_64", "pybullet-arm64"),
        ((3, 13), "Darwin", "arm64", "pybullet-arm64"),
        ((3, 13), "Darwin", "x86_64", ""),
        ((3, 11), "Linux", "aarch64", ""),
        ((3, 14), "Linux", "x86_64", ""),
        ((3, 14), "Darwin", "arm64", ""),
    ],
)
def test_the_wheel_of_each_platform_is_known(python, system, machine, expected):
    from hexakin.engines.pybullet_import import wheel

    assert wheel(python, system, machine) == expected
