"""Files of any content are read within limits or named; files are written whole."""

import io
import json
import os
import stat
import zipfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import hexakin as hk
from hexakin import animation, figures, study
from hexakin.checks import check_path
from hexakin.checks.files import DEEPEST, opened_arrays, parse_json, read_bytes, whole_file
from hexakin.exceptions import FileError, InvalidInputError, RecordingError, StudyError
from hexakin.papers.statements import statements
from hexakin.study.journal import Journal, read
from hexakin.study.tables import read_table
from hexakin.terrain import Plane

MB = 2**20


class BytesPath:
    def __fspath__(self):
        return b"walk.npz"


NO_PATHS = [1, 0, True, 1.5, None, b"walk.npz", BytesPath(), "", "a\0b", "\ud800", ["walk.npz"], Path, object()]


@pytest.mark.parametrize("value", NO_PATHS, ids=lambda value: type(value).__name__)
def test_what_is_no_path_is_named_wherever_a_path_is_received(short_walk, athena, value):
    def measure(seed):
        return {"seed": seed}

    calls = [
        lambda: hk.load_recording(value),
        lambda: hk.load_robot(value),
        lambda: short_walk.save(value),
        lambda: figures.save_pdf(plt.figure(), value),
        lambda: animation.animate(athena, short_walk, Plane()).save(value),
        lambda: study.run(study.Study("none", measure, [{"seed": 1}]), value),
        lambda: read_table(value),
    ]
    calls += [] if value is None else [lambda: statements(path=value)]
    for call in calls:
        with pytest.raises(InvalidInputError, match=r"(path|name|folder): expected (a path|text.* PathLike).*, got "):
            call()


def test_paths_may_be_text_or_path_objects(tmp_path):
    assert check_path("path", "a/b") == check_path("path", Path("a/b")) == Path("a/b")
    with os.scandir(tmp_path.parent) as entries:
        for entry in entries:
            assert check_path("path", entry) == Path(entry.path)


@pytest.mark.parametrize("folder", [".", "..", "/", "a/.."])
def test_a_folder_is_no_file_to_write(short_walk, folder):
    for write in (short_walk.save, lambda path: figures.save_pdf(plt.figure(), path)):
        with pytest.raises(InvalidInputError, match="path: expected the path of a file, got the folder"):
            write(folder)


def test_a_missing_ending_is_added():
    assert check_path("path", "a/b", ".npz") == Path("a/b.npz")
    assert check_path("path", "a/b.c", ".npz") == Path("a/b.c.npz")
    assert check_path("path", "a/b.NPZ", ".npz") == Path("a/b.NPZ")


def test_a_file_that_cannot_be_written_is_named_before_the_work_and_nothing_is_left(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_bytes(b"old")
    for path, message in [
        (tmp_path / "none" / "a", "none does not exist"),
        (tmp_path / "file" / "a", "file does not exist"),
        (tmp_path / "folder", "not a file"),
        (tmp_path / ("n" * 300), "too long"),
        (tmp_path / ("n" * 300) / "a", "too long"),
    ]:
        with pytest.raises(FileError, match=f"{path.name}: cannot be written .*{message}"), whole_file(path):
            pytest.fail("the block was entered")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"] and os.listdir(tmp_path / "folder") == []


@pytest.mark.parametrize("error, raised", [(OSError(28, "No space left"), FileError), (ZeroDivisionError(), None)])
def test_a_block_that_fails_leaves_the_file_before_as_it_was(tmp_path, error, raised):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(raised or type(error)) as caught, whole_file(path) as temporary:
        temporary.write_text("new")
        raise error
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]
    if raised:
        assert str(caught.value) == f"{path}: cannot be written (No space left)"


def test_a_file_has_the_rights_that_a_new_file_has(tmp_path):
    with whole_file(tmp_path / "a") as temporary:
        temporary.write_text("a")
    (tmp_path / "b").touch()
    rights = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in "ab"]
    assert rights[0] == rights[1]


def test_a_file_is_read_up_to_a_limit_and_only_if_it_is_one(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(FileError, match="a: longer than 4 bytes"):
        read_bytes(path, 4)
    for other, message in [
        (tmp_path, "not a file"),
        (tmp_path / "b", "no such file"),
        (tmp_path / ("n" * 300), "long"),
    ]:
        with pytest.raises(FileError, match=message):
            read_bytes(other, 4)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_that_nobody_writes_to_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe.npz"
    os.mkfifo(pipe)
    with pytest.raises(FileError, match="not a file"):
        read_bytes(pipe, 4)
    with pytest.raises(RecordingError, match="not a file"):
        hk.load_recording(pipe)


@pytest.mark.parametrize("depth", [DEEPEST, 900, 100_000])
@pytest.mark.parametrize("kind", ["[]", '{"a":}'])
def test_json_of_too_many_levels_is_refused(kind, depth):
    opening, closing = kind[:-1], kind[-1]
    too_deep = opening * (depth + 1) + "1" + closing * (depth + 1)
    with pytest.raises(ValueError, match="nested too deeply"):
        parse_json(too_deep)
    allowed = opening * (DEEPEST - 1) + "1" + closing * (DEEPEST - 1)
    assert parse_json(allowed) == json.loads(allowed)


def member(array, shape=None, descr=None, version=b"\x01\x00"):
    """The bytes of an array's file, whose header may say another shape or type."""
    header = repr({"descr": descr or array.dtype.str, "fortran_order": False, "shape": shape or array.shape}).encode()
    return b"\x93NUMPY" + version + (len(header) + 1).to_bytes(2, "little") + header + b"\n" + array.tobytes()


def archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members:
            file.writestr(name, content)
    return path


ZEROS = np.zeros(10)


@pytest.mark.parametrize(
    "members, message",
    [
        ([("a.npy", member(ZEROS, shape=(10**12,)))], "impossible shape"),
        ([("a.npy", member(ZEROS, shape=(-10,)))], "impossible shape"),
        ([("a.npy", member(ZEROS, shape=(11,)))], r"shape \(11,\) of float64 contradicts its size"),
        ([("a.npy", member(ZEROS, shape=(10**5, 10**5, 10**5)))], "contradicts its size"),
        ([("a.npy", member(ZEROS, shape=(10**5,), descr="<U0"))], "contradicts its size"),
        ([("a.npy", member(ZEROS, descr="|O"))], "elements of object"),
        ([("a.npy", member(ZEROS, descr="<c16", shape=(5,)))], "elements of complex128"),
        ([("a.npy", member(ZEROS, descr=[("x", "<f8")]))], "elements of"),
        ([("a.npy", member(ZEROS, version=b"\x02\x00"))], r"format \(2, 0\)"),
        ([("a.npy", b"\x93NUMPY\x01\x00" + b"\xff\xff" + b"(" * 65535)], "truncated or damaged"),
        ([("a.npy", b"nothing")], "truncated or damaged"),
        ([("a.txt", b"text")], "'a.txt' is no array"),
        ([("a.npy", member(np.zeros(MB)))], "8388.*bytes when unpacked, expected at most 1048576"),
        ([(f"{k}.npy", member(ZEROS)) for k in range(1001)], "1001 arrays, expected at most 1000"),
    ],
)
def test_an_archive_is_refused_by_its_headers(tmp_path, members, message):
    with pytest.raises(FileError, match=message), opened_arrays(archive(tmp_path / "a.npz", members), MB):
        pytest.fail("the archive was opened")


def test_an_array_contained_twice_is_refused(tmp_path):
    with pytest.warns(UserWarning, match="Duplicate"):
        path = archive(tmp_path / "a.npz", [("a.npy", member(ZEROS)), ("a.npy", member(ZEROS))])
    with pytest.raises(FileError, match=r"'a\.npy' is no array, or is contained twice"), opened_arrays(path, MB):
        pass


def test_arrays_come_back_as_they_were_saved(tmp_path, rng):
    arrays = {
        "a": rng.random((3, 4)),
        "b": np.asfortranarray(rng.random((5, 2))),
        "c/d": np.array("text"),
        "e": ZEROS[:0],
    }
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    with opened_arrays(tmp_path / "a.npz", MB) as opened:
        assert opened.headers.keys() == arrays.keys()
        for name, array in arrays.items():
            np.testing.assert_array_equal(opened.read(name), array)
            assert opened.headers[name] == (array.shape, array.dtype)
        with pytest.raises(FileError, match="f is missing"):
            opened.read("f")


@pytest.fixture
def saved(short_walk, tmp_path):
    """The members of a recording's file, by name."""
    short_walk.save(tmp_path / "walk.npz")
    with zipfile.ZipFile(tmp_path / "walk.npz") as file:
        return {name: file.read(name) for name in file.namelist()}


def test_a_recording_that_would_unpack_to_gigabytes_is_refused_unread(saved, tmp_path, monkeypatch):
    """Of 50 million ticks of zeros: 400 MB in a file of 2 MB."""
    monkeypatch.setattr(np.lib.format, "read_array", lambda *a, **k: pytest.fail("an array was unpacked"))
    path, count = tmp_path / "large.npz", 50_000_000
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for name, content in saved.items():
            if name != "time.npy":
                file.writestr(name, content)
        with file.open("time.npy", "w") as stream:
            stream.write(member(np.zeros(0), shape=(count,)))
            zeros = bytes(8_000_000)
            for _ in range(count * 8 // len(zeros)):
                stream.write(zeros)
    with pytest.raises(RecordingError, match=r"large\.npz: 40.* bytes when unpacked, expected at most"):
        hk.load_recording(path)


def test_a_recording_of_contradictory_sizes_is_refused_before_its_arrays_are_unpacked(saved, tmp_path, monkeypatch):
    content = io.BytesIO()
    np.save(content, np.zeros(1_000_000))
    changed = {**saved, "height.npy": content.getvalue()}
    path = archive(tmp_path / "odd.npz", changed.items())
    read_array = np.lib.format.read_array
    sizes = []

    def reading(stream, **options):
        array = read_array(stream, **options)
        sizes.append(array.size)
        return array

    monkeypatch.setattr(np.lib.format, "read_array", reading)
    with pytest.raises(RecordingError, match=r"odd\.npz: height has shape \(1000000,\)"):
        hk.load_recording(path)
    assert sizes == [1]  # the format


@pytest.mark.parametrize(
    "parameters, message",
    [
        ("[" * 100_000 + "]" * 100_000, "nested too deeply"),
        (
            json.dumps({"robot": {}, "controller": {}, "control_rate": 20.0, "phases_per_cycle": 0}),
            "phases_per_cycle: 0",
        ),
        (json.dumps({"robot": {}, "controller": {}, "control_rate": "a", "phases_per_cycle": 2}), "control_rate: "),
        ("1" * 5000, "not valid JSON"),
        ("x" * (2 * MB), "expected a text"),
    ],
    ids=["deep", "phases", "rate", "digits", "long"],
)
def test_wrong_parameters_of_a_recording_are_named(saved, tmp_path, parameters, message):
    content = io.BytesIO()
    np.save(content, np.array(parameters))
    path = archive(tmp_path / "walk.npz", {**saved, "parameters.npy": content.getvalue()}.items())
    with pytest.raises(RecordingError, match=f"walk.npz: .*{message}"):
        hk.load_recording(path)


def test_parameters_that_json_cannot_store_are_named(short_walk, tmp_path):
    import dataclasses

    endless: list = []
    endless.append(endless)
    for value in (object(), endless):
        with pytest.raises(RecordingError, match="parameters: "):
            dataclasses.replace(short_walk, parameters={"note": value}).save(tmp_path / "walk.npz")
    assert os.listdir(tmp_path) == []


def test_a_journal_line_with_a_valid_checksum_and_other_contents_is_dropped(tmp_path):
    import zlib

    path = tmp_path / "a.journal"
    with Journal(path) as journal:
        journal.append({"run": {"seed": 1}})
    with open(path, "ab") as stream:
        for text in (b"[" * 100_000 + b"]" * 100_000, b"[1]", b"nothing"):
            stream.write(b"%08x %s\n" % (zlib.crc32(text), text))
    assert read(path) == ([{"run": {"seed": 1}}], 3)
    with pytest.raises(StudyError, match="not a file"):
        read(tmp_path)
