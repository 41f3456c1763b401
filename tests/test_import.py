"""What importing hexakin costs."""

import pickle
import subprocess
import sys

import pytest

import hexakin as hk

HEAVY = ("sympy", "pinocchio", "casadi", "pybullet", "mujoco", "matplotlib", "numba")


def loaded_after(code):
    script = f"{code}\nimport sys\nprint(' '.join(m for m in {HEAVY!r} if m in sys.modules))"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()


def test_import_loads_no_heavy_package():
    assert loaded_after("import hexakin") == []


def test_kinematics_of_a_shipped_robot_load_no_heavy_package():
    code = (
        "import hexakin as hk, numpy as np\n"
        "robot = hk.load_robot('athena')\n"
        "hk.inverse_kinematics(robot, hk.forward_kinematics(robot, np.zeros((6, 3))))\n"
        "hk.jacobian(robot, np.zeros((6, 3)))"
    )
    assert loaded_after(code) == []


def test_a_simulation_loads_only_its_engine():
    assert loaded_after("from hexakin.simulation import simulate\nfrom hexakin import PostureController") == []
    assert loaded_after("import hexakin.engines.rigid_engine") == ["pinocchio", "numba"]


@pytest.mark.pybullet
def test_the_engine_pybullet_loads_only_its_package():
    assert loaded_after("import hexakin.engines.pybullet_engine") == ["pybullet"]


@pytest.mark.mujoco
def test_the_engine_mujoco_loads_only_its_package_and_prints_nothing():
    assert loaded_after("import hexakin.engines.mujoco_engine") == ["mujoco"]
    done = subprocess.run([sys.executable, "-c", "import hexakin.engines.mujoco_engine"], capture_output=True)
    assert done.returncode == 0 and done.stdout == done.stderr == b""


@pytest.mark.mujoco
def test_a_walk_on_mujoco_needs_no_other_engines_packages():
    code = (
        "import hexakin as hk\n"
        "robot = hk.load_robot('athena')\n"
        "controller = hk.PostureController(robot)\n"
        "hk.simulate(robot, hk.terrain.Plane(), controller, engine='mujoco', duration=0.1, settling_time=0.1)"
    )
    assert not {"pinocchio", "numba", "pybullet"} & set(loaded_after(code))


def test_drawing_loads_no_package_that_computes():
    for name in ("animation", "figures"):
        assert not {"casadi", "sympy", "pinocchio", "pybullet", "mujoco", "numba"} & set(
            loaded_after(f"import hexakin.{name}")
        )


@pytest.mark.pybullet
def test_importing_the_engine_prints_nothing():
    done = subprocess.run(
        [sys.executable, "-c", "import hexakin.engines.pybullet_engine"], capture_output=True, check=True
    )
    assert done.stdout == done.stderr == b""


def test_every_public_name_exists_and_others_are_attribute_errors():
    for name in hk.__all__:
        assert getattr(hk, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'walk'"):
        _ = hk.walk
    assert set(hk.__all__) <= set(dir(hk))


def test_errors_come_back_whole_from_a_worker_process():
    errors = [
        hk.exceptions.UnknownNameError("engine", "ode", ["pybullet"]),
        hk.exceptions.UnreachableError(2, 0.31, (0.004, 0.164), "3"),
        hk.exceptions.InvalidInputError("q: bad"),
        hk.exceptions.MissingPackageError("x", "y", "z"),
    ]
    for error in errors:
        copy = pickle.loads(pickle.dumps(error))
        assert type(copy) is type(error) and str(copy) == str(error) and copy.__dict__ == error.__dict__
