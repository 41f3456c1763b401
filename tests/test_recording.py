from pathlib import Path

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import RecordingError


@pytest.fixture
def saved(short_walk, tmp_path):
    path = tmp_path / "walk.npz"
    short_walk.save(path)
    return path


def test_a_recording_comes_back_as_it_was_saved(short_walk, saved):
    back = hk.load_recording(saved)
    assert back.columns.keys() == short_walk.columns.keys() and "delta_z" in back.columns
    for name, values in back.columns.items():
        assert np.array_equal(values, short_walk.columns[name], equal_nan=True)
    assert back.parameters == short_walk.parameters


def test_numpy_reads_the_file_without_hexakin(saved):
    with np.load(saved) as archive:
        assert archive["height"].shape == (120,)


def test_the_suffix_is_added_and_nothing_else_is_left_behind(short_walk, tmp_path):
    short_walk.save(tmp_path / "walk")
    assert [path.name for path in tmp_path.iterdir()] == ["walk.npz"]


@pytest.mark.parametrize("kept", [0, 10, 1000, -100])
def test_a_truncated_recording_is_a_named_error(saved, kept):
    saved.write_bytes(saved.read_bytes()[:kept])
    with pytest.raises(RecordingError, match=r"walk\.npz: truncated or damaged"):
        hk.load_recording(saved)


def test_damage_anywhere_is_a_named_error_or_harmless(saved, rng):
    whole = saved.read_bytes()
    errors = 0
    for _ in range(300):
        content = bytearray(whole)
        for at in rng.integers(len(content), size=int(rng.integers(1, 4))):
            content[at] ^= int(rng.integers(1, 256))
        saved.write_bytes(bytes(content[: rng.integers(len(content) // 2, len(content) + 1)]))
        try:
            hk.load_recording(saved)
        except RecordingError as error:
            assert "walk.npz" in str(error)
            errors += 1
    assert errors > 250


@pytest.mark.parametrize(
    "change, message",
    [
        ({"q": np.zeros((20, 5))}, "not the shapes of a recording"),
        ({"height": np.array(["high"] * 120)}, "height has shape"),
        ({"foot_force": np.zeros((120, 4))}, r"foot_force has shape \(120, 4\)"),
        ({"time": np.zeros(0)}, "not the shapes of a recording"),
        ({"parameters": "[]"}, "its parameters must contain"),
        ({"parameters": "{}"}, "its parameters must contain"),
    ],
)
def test_a_recording_with_other_contents_is_a_named_error(saved, change, message):
    with np.load(saved) as archive:
        contents = dict(archive)
    np.savez(saved, **contents | change)
    with pytest.raises(RecordingError, match=message):
        hk.load_recording(saved)


def test_numpy_numbers_among_the_parameters_are_stored(athena, tmp_path):
    controller = hk.PostureController(athena, k_z=np.float32(0.5), seed=np.int64(2))
    recording = hk.simulate(athena, hk.terrain.Plane(), controller, duration=0.1, time_step=0.005, seed=np.int64(1))
    recording.save(tmp_path / "numpy.npz")
    assert hk.load_recording(tmp_path / "numpy.npz").parameters["controller"]["k_z"] == 0.5


def test_other_archives_and_missing_files_are_named_errors(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(RecordingError, match="not a hexakin recording"):
        hk.load_recording(tmp_path / "other.npz")
    with pytest.raises(RecordingError, match="no such file"):
        hk.load_recording(tmp_path / "absent.npz")


def test_an_interrupted_save_leaves_the_old_file_whole(short_walk, saved, monkeypatch):
    before = saved.read_bytes()

    def fail(*arguments, **keywords):
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="no space"):
        short_walk.save(saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == ["walk.npz"]


def test_a_recording_of_version_0_1_still_loads():
    walk = hk.load_recording(Path(__file__).parent / "data" / "recording_of_0_1.npz")
    assert walk.q.shape == (10, 6, 3) and walk.parameters["versions"]["hexakin"] == "0.1.0"
    assert np.isnan(walk.joint_velocity).all() and np.isnan(walk.unsolved_steps).all()
    assert set(walk.diagnostics) == {"delta_z", "delta_alpha", "delta_beta", "plane_misfit"}
    assert walk.delta_z is walk.diagnostics["delta_z"] and walk.delta_z.shape == (10,)
    assert (hk.stability.series(walk).margin > 0.0).all()


def test_a_recording_of_version_0_2_still_loads(short_walk, saved):
    with np.load(saved) as archive:
        contents = dict(archive)
    del contents["unsolved_steps"]
    np.savez(saved, **contents | {"format": "hexakin-recording-4"})
    walk = hk.load_recording(saved)
    assert walk.unsolved_steps.shape == walk.time.shape and np.isnan(walk.unsolved_steps).all()
    np.testing.assert_array_equal(walk.joint_velocity, short_walk.joint_velocity)
    assert walk.to_dataframe()["unsolved_steps"].isna().all()


def test_a_recording_of_this_version_must_have_all_columns(saved):
    with np.load(saved) as archive:
        contents = dict(archive)
    del contents["unsolved_steps"]
    np.savez(saved, **contents)
    with pytest.raises(RecordingError, match="unsolved_steps missing"):
        hk.load_recording(saved)


def test_columns_are_declared_once():
    """The docstring's table, the file and the checks follow from the fields."""
    for name in ("foot_force_last", "joint_velocity", "solver_residual"):
        assert f"``{name}``" in hk.Recording.__doc__
    with pytest.raises(AttributeError, match="a recording has no 'delta_y'; the controller's diagnostics are"):
        _ = hk.load_recording(Path(__file__).parent / "data" / "recording_of_0_1.npz").delta_y
