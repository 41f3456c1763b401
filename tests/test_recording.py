import dataclasses

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
    for field in dataclasses.fields(back):
        if field.name != "parameters":
            assert np.array_equal(getattr(back, field.name), getattr(short_walk, field.name), equal_nan=True)
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


def test_a_damaged_recording_is_a_named_error(saved):
    content = bytearray(saved.read_bytes())
    content[len(content) // 2] ^= 0xFF
    saved.write_bytes(bytes(content))
    with pytest.raises(RecordingError, match=r"walk\.npz"):
        hk.load_recording(saved)


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
