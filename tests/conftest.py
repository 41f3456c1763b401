import importlib.util
import os
import signal
import sys

import numpy as np
import pytest
import yaml

import hexakin as hk
from hexakin.installation import DATA

# Tests look for machine code beside its source, or in a folder that they name themselves.
os.environ.pop("NUMBA_CACHE_DIR", None)

if sys.__stdin__ is None:  # it is closed, and IPython asks for its encoding
    sys.__stdin__ = open(os.devnull, encoding="utf-8")


def pytest_collection_modifyitems(items):
    """Without a simulator, skip the tests that are marked with its name, or that have its name as a parameter."""
    for simulator in ("pybullet", "mujoco"):
        if importlib.util.find_spec(simulator) is not None:
            continue
        skipped = pytest.mark.skip(reason=f"{simulator} is not installed")
        for item in items:
            values = item.callspec.params.values() if hasattr(item, "callspec") else ()
            if item.get_closest_marker(simulator) or any(isinstance(v, str) and v == simulator for v in values):
                item.add_marker(skipped)


@pytest.fixture(scope="session", autouse=True)
def children_may_be_interrupted():
    """Processes that tests start end on SIGINT, even where the tests themselves run with SIGINT ignored.

    A shell starts its background jobs that way, and children inherit an ignored signal. They do not inherit a handler.
    """
    ignored = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    if ignored:
        signal.signal(signal.SIGINT, lambda number, frame: None)
    yield
    if ignored:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def cache_of_its_own(tmp_path_factory):
    """Code of leg types that are not shipped is derived anew and leaves nothing in the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEXAKIN_CACHE", str(tmp_path_factory.mktemp("leg_types")))
        yield


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
