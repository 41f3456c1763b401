import numpy as np
import pytest
import yaml

import hexakin as hk
from hexakin.robot_file import DATA


@pytest.fixture(scope="session")
def athena():
    return hk.load_robot("athena")


@pytest.fixture
def edited(tmp_path):
    """Load a shipped robot after ``change`` has edited its file's tree in place."""

    def load(name, change):
        tree = yaml.safe_load((DATA / "robots" / f"{name}.yaml").read_text())
        change(tree)
        path = tmp_path / "edited.yaml"
        path.write_text(yaml.safe_dump(tree))
        return hk.load_robot(path)

    return load


@pytest.fixture
def rng():
    return np.random.default_rng(20240501)


@pytest.fixture(scope="session")
def short_walk(athena):
    """Three gait cycles up the ramp with A's chosen gains, at a coarse step to be quick."""
    return hk.simulate(athena, hk.terrain.Ramp(), hk.PostureController(athena), duration=6.0, time_step=0.005)
