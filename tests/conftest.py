import numpy as np
import pytest

import hexakin as hk


@pytest.fixture(scope="session")
def athena():
    return hk.load_robot("athena")


@pytest.fixture
def rng():
    return np.random.default_rng(20240501)


@pytest.fixture(scope="session")
def short_walk(athena):
    """Three gait cycles up the ramp with A's chosen gains, at a coarse step to be quick."""
    return hk.simulate(athena, hk.terrain.Ramp(), hk.PostureController(athena), duration=6.0, time_step=0.005)
