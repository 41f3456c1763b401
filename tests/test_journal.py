import json
import os
import subprocess
import sys

import pytest

from hexakin.exceptions import StudyError
from hexakin.study.journal import Journal, alone, read, set_aside, write_whole

RECORDS = [{"run": {"seed": k}, "result": {"x": k / 7, "said": "a, b\nc"}} for k in range(3)]


@pytest.fixture
def path(tmp_path):
    """A journal of three records."""
    path = tmp_path / "a.journal"
    with Journal(path) as journal:
        for record in RECORDS:
            journal.append(record)
    return path


def run_python(program, *arguments):
    call = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(call, capture_output=True, text=True, check=True).stdout


def test_records_come_back_and_are_one_line_each(path):
    assert read(path) == (RECORDS, 0)
    assert path.read_bytes().count(b"\n") == 1 + len(RECORDS)
    with Journal(path) as journal:
        assert journal.records == RECORDS
        journal.append({"more": 1})
        assert journal.records == [*RECORDS, {"more": 1}]
    assert read(path) == ([*RECORDS, {"more": 1}], 0)


def test_a_file_cut_anywhere_keeps_the_lines_before_the_cut(path):
    whole = path.read_bytes()
    for length in range(len(whole) + 1):
        path.write_bytes(whole[:length])
        with Journal(path) as journal:
            complete = whole[:length].count(b"\n")
            assert journal.records == RECORDS[: max(complete - 1, 0)]
            assert journal.dropped == (not whole[:length].endswith(b"\n") and length > 0)
            journal.append({"more": 1})
        assert read(path) == ([*RECORDS[: max(complete - 1, 0)], {"more": 1}], 0)


@pytest.mark.parametrize("flip", [0x01, 0x07, 0x80])  # 0x07 makes a line break of a carriage return, and the reverse
def test_a_byte_that_changed_costs_its_own_line_and_at_most_the_next(path, flip):
    whole = path.read_bytes()
    ends = [k for k, byte in enumerate(whole) if byte == 0x0A]
    for position in range(len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= flip
        path.write_bytes(damaged)
        records, dropped = read(path)
        line = whole[:position].count(b"\n")  # 0 is the format's
        lost = {line - 1, line} if position in ends else {line - 1}  # without its end, a line runs into the next
        assert records == [record for k, record in enumerate(RECORDS) if k not in lost]
        assert dropped >= 1


@pytest.mark.parametrize(
    "foreign",
    [b"seed,x\n1,2\n", b"\x89PNG\r\n\x1a\n", b"\n", b'12345678 {"format":"hexakin-journal-1"}\n', b"no line's end"],
)
def test_a_file_of_another_kind_is_refused_and_left_as_it_is(tmp_path, foreign):
    path = tmp_path / "a.journal"
    path.write_bytes(foreign)
    with pytest.raises(StudyError, match=r"a.journal: not a hexakin journal"):
        Journal(path)
    assert path.read_bytes() == foreign
    assert os.listdir(tmp_path) == ["a.journal"]


def test_a_journal_of_another_format_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.journal"
    monkeypatch.setattr("hexakin.study.journal._FORMAT", "hexakin-journal-2")
    with Journal(path) as journal:
        journal.append({"run": 1})
    monkeypatch.undo()
    with pytest.raises(StudyError, match=r"not a hexakin journal .expected format hexakin-journal-1"):
        Journal(path)


def test_an_empty_file_is_an_empty_journal(tmp_path):
    path = tmp_path / "a.journal"
    path.touch()
    with Journal(path) as journal:
        assert (journal.records, journal.dropped) == ([], 0)
        journal.append(RECORDS[0])
    assert read(path) == (RECORDS[:1], 0)


def test_a_missing_folder_is_made(tmp_path):
    path = tmp_path / "a" / "b" / "c.journal"
    with alone(path), Journal(path) as journal:
        journal.append(RECORDS[0])
    assert read(path) == (RECORDS[:1], 0)


def test_a_folder_that_is_a_file_is_named(tmp_path):
    (tmp_path / "results").write_text("mine")
    for path in (tmp_path / "results" / "a.journal", tmp_path / "results" / "deep" / "a.journal"):
        with (
            pytest.raises(StudyError, match=r"a.journal: cannot be written .*results(/deep)? is not a folder"),
            alone(path),
        ):
            pass
    assert (tmp_path / "results").read_text() == "mine"


def test_a_journal_that_is_a_folder_is_named(tmp_path):
    (tmp_path / "a.journal").mkdir()
    with pytest.raises(StudyError, match=r"a.journal: cannot be read"):
        Journal(tmp_path / "a.journal")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_the_right_to_write_is_named(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(StudyError, match=r"a.journal: cannot be written .Permission denied"):
            with alone(tmp_path / "a.journal"):
                pass
    finally:
        tmp_path.chmod(0o700)


def test_files_that_may_not_be_opened_are_named(path, monkeypatch):
    def refused(file, mode="r", *arguments, **options):
        if mode[0] in "awx":
            raise PermissionError(13, "Permission denied")
        return unchanged(file, mode, *arguments, **options)

    unchanged = open
    monkeypatch.setattr("builtins.open", refused)
    with pytest.raises(StudyError, match=r"a.journal: cannot be written .Permission denied"):
        Journal(path)
    with pytest.raises(StudyError, match=r"a.csv: cannot be written .Permission denied"):
        write_whole(path.with_suffix(".csv"), b"")


HOLD = """
import sys, time
from pathlib import Path
from hexakin.study.journal import alone
with alone(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_one_process_at_a_time_and_a_killed_one_gives_way(path):
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(StudyError, match=r"a.journal: another process is writing it"), alone(path):
            pass
    finally:
        holder.kill()
        holder.communicate()
    with alone(path):
        with pytest.raises(StudyError, match=r"another process is writing it"), alone(path):
            pass


def test_a_file_is_written_whole(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"old")
    write_whole(tmp_path / "a.csv", b"new")
    assert (tmp_path / "a.csv").read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a.csv"]


FULL = """
import json, resource, sys
from pathlib import Path
from hexakin.exceptions import StudyError
from hexakin.study.journal import Journal, read, write_whole

path = Path(sys.argv[1])
free = resource.getrlimit(resource.RLIMIT_FSIZE)
errors = []
with Journal(path) as journal:
    before, size = list(journal.records), path.stat().st_size
    for room in range(40):  # of the next line, which is longer
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + room, free[1]))
        for write in (lambda: journal.append({"said": 60 * "x"}), lambda: write_whole(path, 10000 * b"x")):
            try:
                write()
            except StudyError as error:
                errors.append(str(error))
        assert path.stat().st_size == size and journal.records == before and read(path) == (before, 0)
    resource.setrlimit(resource.RLIMIT_FSIZE, free)
    journal.append({"said": 60 * "x"})
assert read(path) == ([*before, {"said": 60 * "x"}], 0)
assert [other.name for other in path.parent.iterdir()] == [path.name]
print(json.dumps(errors))
"""


def test_on_a_full_disk_nothing_of_a_line_is_written_and_the_error_says_why(path):
    pytest.importorskip("resource")
    errors = json.loads(run_python(FULL, path))
    assert len(errors) == 80
    assert set(errors) == {
        f"{path}: File too large; finished runs are kept; repeat the same call to continue",
        f"{path}: cannot be written (File too large)",
    }


def test_files_set_aside_together_have_one_number_and_none_is_overwritten(tmp_path):
    paths = [tmp_path / "a.csv", tmp_path / "a.journal"]
    paths[1].write_text("first")
    set_aside(paths)
    for path in paths:
        path.write_text("second")
    set_aside(paths)
    set_aside(paths)  # nothing there
    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == {"a.journal.1.old": "first", "a.journal.2.old": "second", "a.csv.2.old": "second"}
