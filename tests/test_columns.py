"""Recordings, plans, motions and measures as pandas DataFrames."""

import dataclasses
import re

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import hexakin as hk
from hexakin.exceptions import InvalidInputError
from hexakin.motion.columns import columns_of
from hexakin.motion.motion import Motion, motion_of

SEGMENTS = ("coxa", "femur", "tibia")
LEGS = range(1, 7)


@pytest.fixture(scope="module")
def plan(athena):
    """A plan in which legs are out of reach."""
    return hk.plan_walk(
        athena, hk.terrain.Plane(), num_steps=2, step_length=0.25, samples_per_step=20, on_failure="mark"
    )


def gathered(frame, name, *labels):
    """The columns of a frame whose names are made of these labels, as an array."""
    names = [name]
    for axis in labels:
        names = [f"{start}_{label}" for start in names for label in axis]
    return frame[names].to_numpy().reshape(len(frame), *(len(axis) for axis in labels))


def test_a_recording_comes_back_from_its_frame(short_walk):
    frame, legs = short_walk.to_dataframe(), [f"leg{leg}" for leg in LEGS]
    assert isinstance(frame, pd.DataFrame) and frame.index.name == "time"
    assert np.array_equal(frame.index, short_walk.time)
    for name in ("q", "q_command", "joint_velocity", "joint_torque"):
        assert np.array_equal(gathered(frame, name, legs, SEGMENTS), getattr(short_walk, name))
    for name in ("foot_force", "stance", "limited"):
        values = gathered(frame, name, legs)
        assert np.array_equal(values, getattr(short_walk, name)) and values.dtype == getattr(short_walk, name).dtype
    assert np.array_equal(gathered(frame, "p_body_foot", legs, "xyz"), short_walk.p_body_foot)
    assert np.array_equal(gathered(frame, "body_velocity", "xyz"), short_walk.body_velocity)
    assert np.array_equal(gathered(frame, "body_rate_moment", "xyz", "xyz"), short_walk.body_rate_moment)
    assert np.array_equal(frame["phase"], short_walk.phase)
    assert np.array_equal(frame["energy"], short_walk.energy, equal_nan=True)  # PyBullet does not compute it
    for name, values in short_walk.diagnostics.items():
        assert np.array_equal(frame[name], values, equal_nan=True)
    assert np.array_equal(gathered(frame, "T_world_body", "xyz"), short_walk.T_world_body[:, :3, 3])
    quat_xyzw = gathered(frame, "T_world_body", ("qx", "qy", "qz", "qw"))
    assert (quat_xyzw[:, 3] >= 0.0).all()
    assert np.allclose(Rotation.from_quat(quat_xyzw).as_matrix(), short_walk.T_world_body[:, :3, :3], atol=1e-9)
    numbers = sum(values[0].size for values in short_walk.columns.values())
    assert frame.shape == (len(short_walk.time), numbers - 1 - 16 + 7)  # time is the index, a pose has seven numbers


def test_a_plan_and_a_motion_come_back_with_nan_where_feet_are_out_of_reach(athena, plan):
    legs = [f"leg{leg}" for leg in LEGS]
    assert not plan.reachable.all()
    frame = plan.to_dataframe()
    assert np.array_equal(gathered(frame, "q", legs, SEGMENTS), plan.q, equal_nan=True)
    assert np.array_equal(frame["q_leg2_femur"].isna(), ~plan.reachable[:, 1])
    assert np.array_equal(gathered(frame, "p_world_foot", legs, "xyz"), plan.p_world_foot)
    assert np.array_equal(gathered(frame, "ground_height", legs), plan.ground_height)
    motion = motion_of(athena, plan)
    frame = motion.to_dataframe()
    assert np.array_equal(gathered(frame, "p_body_foot", legs, "xyz"), motion.p_body_foot)
    assert np.array_equal(gathered(frame, "carrying", legs), motion.carrying)
    bare = dataclasses.replace(motion, ground_height=None).to_dataframe()
    assert set(frame) - set(bare) == {f"ground_height_{leg}" for leg in legs}


def test_measures_come_back_by_cycle(short_walk):
    measures = hk.measures.per_cycle(short_walk)
    frame = measures.to_dataframe()
    assert frame.index.name == "cycle" and list(frame.index) == list(range(len(measures.height)))
    assert list(frame) == [part.name for part in dataclasses.fields(measures)]
    assert all(np.array_equal(frame[name], getattr(measures, name)) for name in frame)


def test_arrays_that_do_not_go_together_are_named(athena, short_walk):
    motion = motion_of(athena, short_walk)
    with pytest.raises(InvalidInputError, match=r"q: shape \(3, 6, 3\), expected \(\d+, 6, 3\)"):
        dataclasses.replace(motion, q=motion.q[:3]).to_dataframe()
    with pytest.raises(InvalidInputError, match=r"carrying: shape \(\d+, 5\), expected \(\d+, 6\)"):
        dataclasses.replace(motion, carrying=motion.carrying[:, :5]).to_dataframe()
    twice = dataclasses.replace(short_walk, diagnostics={"q_leg1_coxa": short_walk.time})
    with pytest.raises(InvalidInputError, match="q_leg1_coxa: the name q_leg1_coxa occurs twice"):
        twice.to_dataframe()
    shear = dataclasses.replace(motion, T_world_body=motion.T_world_body + 1.0)
    with pytest.raises(InvalidInputError, match="T_world_body: expected poses"):
        shear.to_dataframe()


@pytest.mark.parametrize("kind", [hk.Recording, hk.WalkPlan, Motion, hk.measures.CycleMeasures])
def test_every_column_is_in_the_table_of_the_docstring(kind):
    rows = re.findall(r"(?m)^``(\w+)`` +\([nc],.*\)  ", kind.__doc__)
    assert rows == [part.name for part in columns_of(kind)]
    assert kind.__doc__.splitlines()[0].endswith(".") and not kind.__doc__.splitlines()[1]
