import csv
import importlib
import importlib.util
import io
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import warnings

import joblib
import numpy as np
import pandas as pd
import pytest

from hexakin.exceptions import ContactError, InvalidInputError, SimulationError, StudyError
from hexakin.papers.scenarios import walk
from hexakin.study import journal
from hexakin.study.provenance import provenance
from hexakin.study.runner import Study, grid, run
from hexakin.study.tables import NOT_COMPARED, read_table


def counted(folder):
    """A cheap trial that notes its calls in a file, to which processes may append at once."""

    def trial(seed):
        with open(folder / "calls.log", "a") as log:
            log.write(f"{seed}\n")
        return {"x": math.sin(seed), "pid": str(os.getpid())}

    return trial


def called(folder):
    """Seeds that ``counted`` was called with since this was last asked."""
    log = folder / "calls.log"
    seeds = [int(line) for line in log.read_text().split()] if log.exists() else []
    log.unlink(missing_ok=True)
    return sorted(seeds)


def compared(table):
    """The table as exact text, without what differs between equal runs."""
    return table.drop(columns=[*NOT_COMPARED, *({"pid"} & set(table))]).map(repr).to_csv()


@pytest.fixture
def seven(tmp_path):
    """A finished study of seven runs, its table and its folder."""
    study = Study("seven", counted(tmp_path), grid(seed=range(7)))
    table = run(study, tmp_path / "results", jobs=1, progress=False)
    assert called(tmp_path) == list(range(7))
    return study, table, tmp_path


# What a study is


def test_grid_is_every_combination_and_the_last_changes_fastest():
    assert grid(a=(1, 2), name="ab", b=range(2)) == [
        {"a": 1, "name": "ab", "b": 0},
        {"a": 1, "name": "ab", "b": 1},
        {"a": 2, "name": "ab", "b": 0},
        {"a": 2, "name": "ab", "b": 1},
    ]
    assert grid(a=np.array([0.5]), b=None) == [{"a": 0.5, "b": None}]
    assert grid(a=[], b=1) == []


def test_equal_runs_are_one_and_numpys_numbers_become_pythons():
    runs = [{"k": np.float64(1.0), "on": np.True_}, {"on": True, "k": 1}, {"k": 1, "on": False}, {"k": -0.0, "on": 0}]
    study = Study("a", lambda k, on: {}, [*runs, {"k": 0, "on": 0}])
    assert study.runs == ({"k": 1.0, "on": True}, {"k": 1, "on": False}, {"k": 0.0, "on": 0})
    assert [type(value) for value in study.runs[0].values()] == [float, bool] and len(study) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": ""}, r"name '', expected letters"),
        ({"name": "a/b"}, r"name 'a/b', expected letters"),
        ({"name": "a.b"}, r"name 'a.b', expected letters"),
        ({"name": 5}, "name: expected text, got 5"),
        ({"trial": None}, "trial: expected a function, got None"),
        ({"trial": print}, r"study a: trial <built-in function print> is not a function"),
        ({"runs": []}, r"study a: no runs"),
        ({"runs": {"seed": 1}}, "runs: expected a sequence, each a mapping"),
        ({"runs": [{"seed": 1}, {"seed": 1}, {"sede": 1}]}, r"study a: run 3 and the first differ in: sede, seed"),
        ({"runs": [{"seed": 1}, {"seed": math.nan}]}, r"study a: run 2: seed: nan is not finite"),
        ({"runs": [{"seed": -math.inf}]}, r"study a: run 1: seed: -inf is not finite"),
        ({"runs": [{"seed": [1]}]}, r"study a: run 1: seed: \[1\] is not a number, a string, a boolean or None"),
        ({"runs": [{"seed": np.zeros(1)}]}, r"study a: run 1: seed: array\(\[0.\]\) is not a number"),
        ({"runs": [{"seed": 1, "status": 2}]}, r"study a: argument status: the table has a column of that name"),
    ],
)
def test_a_study_that_cannot_be_run_is_refused_with_the_reason(change, message):
    with pytest.raises(InvalidInputError, match=message):
        Study(**{"name": "a", "trial": lambda seed: {}, "runs": grid(seed=range(3)), **change})


# Its table


def test_the_table_has_a_row_for_every_run_in_the_studys_order(tmp_path):
    study = Study("a", lambda a, b: {"y": a * b, "x": a - b}, grid(a=(3, 1, 2), b=(0.5, 0.25))[::-1])
    table = run(study, tmp_path, jobs=1, progress=False)
    assert list(table) == ["a", "b", "status", "y", "x", "wall_time"]
    assert table[["a", "b"]].to_dict("records") == list(study.runs)
    assert (table["y"] == table["a"] * table["b"]).all() and (table["wall_time"] >= 0).all()
    assert (table["status"] == "ok").all()


def nasty_values():
    rng = np.random.default_rng(20240501)
    numbers = [0.1, 1 / 3, 5e-324, 1.7976931348623157e308, -0.0, 1e16, 1e22, 123456789.12345679, math.inf, -math.inf]
    bits = rng.integers(0, 2**64, 200, dtype=np.uint64).view(np.float64)
    numbers += [float(value) for value in bits[np.isfinite(bits)]]
    letters = list("0123456789.+-e_, \t\n\r\"'\\;#Ténafilu\u2028\x00")
    texts = [
        "",
        " ",
        "7",
        "007",
        "1.0",
        "-0",
        "1e5",
        "1_000",
        "nan",
        "inf",
        "True",
        "None",
        "NA",
        '""',
        '"a',
        "a,b\nc\r\n",
    ]
    texts += ["".join(rng.choice(letters, rng.integers(1, 5))) for _ in range(len(numbers) - len(texts))]
    return numbers, texts


def test_a_table_read_back_has_the_trials_values_bit_for_bit_and_of_the_same_kind(tmp_path):
    numbers, texts = nasty_values()

    def trial(index):
        return {
            "number": numbers[index],
            "narrow": np.float32(index / 7),
            "text": texts[index],
            "whole": 2**62 + index,
            "flag": index % 3 == 0,
            "either": [None, True, "True", 1, 1.5, "1", ""][index % 7],
            "nothing": None,
        }

    table = run(Study("a", trial, grid(index=range(len(numbers)))), tmp_path, jobs=1, progress=False)
    pd.testing.assert_frame_equal(table, read_table(tmp_path / "a.csv"), check_exact=True)
    # From the journal, as when a study is resumed.
    pd.testing.assert_frame_equal(
        table, run(Study("a", trial, grid(index=range(len(numbers)))), tmp_path, progress=False), check_exact=True
    )
    assert [value.hex() for value in table["number"]] == [value.hex() for value in numbers]
    assert list(table["narrow"]) == [float(np.float32(k / 7)) for k in range(len(numbers))]
    assert list(table["text"]) == texts
    assert table["whole"].dtype == np.int64 and list(table["whole"]) == [2**62 + k for k in range(len(numbers))]
    assert table["flag"].dtype == bool
    assert [repr(value) for value in table["either"][:7]] == ["None", "True", "'True'", "1", "1.5", "'1'", "''"]
    assert table["nothing"].isna().all()
    lines = (tmp_path / "a.csv").read_bytes().count(b"\n")
    assert lines == 1 + len(numbers), "one line a run"


def test_a_simulation_error_is_a_row_with_its_text_and_no_values(tmp_path):
    text = 'left the scene, at t = 3 s:\r\n  "p" = [1, 2]\n'

    def trial(seed):
        if seed in (0, 2):
            raise SimulationError(text)
        return {"x": seed / 3, "kind": "a"}

    table = run(Study("a", trial, grid(seed=range(4))), tmp_path, jobs=1, progress=False)
    assert list(table) == ["seed", "status", "x", "kind", "wall_time"]
    assert list(table["status"]) == [f"SimulationError: {text}", "ok"] * 2
    assert list(table["x"].isna()) == list(table["kind"].isna()) == [True, False, True, False]
    assert table["x"].dtype == float and table["x"][3] == 1.0
    everything = run(Study("b", trial, grid(seed=[0, 2])), tmp_path, jobs=1, progress=False)
    assert list(everything) == ["seed", "status", "wall_time"]


def test_a_file_that_is_no_table_is_named(tmp_path):
    for content, message in [
        (None, "no such file"),
        (b"", "not readable as a study's table"),
        (b"a,status,wall_time\n1,ok\n", "not readable as a study's table"),
        (b"\xff\xfe\x00", "not readable as a study's table"),
        (b"a,b\n1,2\n", "not a study's table .no column status, wall_time"),
    ]:
        if content is not None:
            (tmp_path / "a.csv").write_bytes(content)
        with pytest.raises(StudyError, match=f"a.csv: {message}"):
            read_table(tmp_path / "a.csv")


def test_the_file_beside_the_table_says_what_made_it(seven):
    study, _, folder = seven
    about = json.loads((folder / "results" / "seven.json").read_text())
    assert about["study"] == "seven" and about["runs"] == 7
    assert about["call"] == "counted.<locals>.trial() for all combinations of seed in 0..6"
    assert about["trial"] == "test_study:counted.<locals>.trial"
    assert about["versions"]["numpy"] == np.__version__
    assert {"python", "hexakin", "scipy", "pin", "numba"} <= set(about["versions"])
    assert len(about["code"]) == 12 and about["code"] == provenance(study.trial)["code"]
    (machine,) = about["machines"]
    assert machine["cores"] == os.cpu_count()
    if shutil.which("git") is not None:
        command = ["git", "rev-parse", "HEAD"]
        head = subprocess.run(command, capture_output=True, text=True, cwd=os.path.dirname(__file__))
        if head.returncode == 0:
            assert machine["commit"] == head.stdout.strip()


def test_the_machine_is_that_which_made_the_runs_not_that_which_read_them(seven, monkeypatch):
    study, _, folder = seven
    before = (folder / "results" / "seven.json").read_bytes()
    monkeypatch.setattr("os.cpu_count", lambda: 1000)
    run(study, folder / "results", progress=False)
    assert (folder / "results" / "seven.json").read_bytes() == before
    run(Study("seven", study.trial, grid(seed=range(8))), folder / "results", jobs=1, progress=False)
    machines = json.loads((folder / "results" / "seven.json").read_text())["machines"]
    assert [machine["cores"] for machine in machines][1:] == [1000]


@pytest.mark.parametrize(
    ("runs", "call"),
    [
        (grid(k=0.5, on=True, seed=range(10)), "t(k=0.5, on=True) for all combinations of seed in 0..9"),
        (grid(k=[0.4, 0.0, 0.2], seed=3), "t(seed=3) for all combinations of k in [0.0, 0.2, 0.4]"),
        (grid(k=[1, 2], e=["x", None]), "t() for all combinations of k in [1, 2], e in ['x', None]"),
        (grid(k=[1, 2], e=[1, 2])[:3], "t() for 3 combinations of k in [1, 2], e in [1, 2]"),
        (grid(k=[j / 64 for j in range(64)]), "t() for all combinations of k in 64 levels from 0.0 to 0.984375"),
        (grid(k=[f"{j}" for j in range(64)]), "t() for all combinations of k in 64 levels"),
        (grid(k=1), "t(k=1)"),
        ([{}], "t()"),
    ],
)
def test_the_call_lists_the_levels(tmp_path, runs, call):
    def t(**arguments):
        return {}

    run(Study("a", t, runs), tmp_path, jobs=1, progress=False)
    said = json.loads((tmp_path / "a.json").read_text())["call"]
    assert said.replace(t.__qualname__, "t") == call


# Going on


def test_what_is_finished_is_not_made_again(seven):
    study, table, folder = seven
    again = run(study, folder / "results", progress=False)
    assert called(folder) == []
    pd.testing.assert_frame_equal(again, table, check_exact=True)


def test_a_study_that_grew_makes_the_new_runs_only(seven):
    study, table, folder = seven
    grown = run(Study("seven", study.trial, grid(seed=range(-2, 9))), folder / "results", jobs=1, progress=False)
    assert called(folder) == [-2, -1, 7, 8]
    assert list(grown["seed"]) == list(range(-2, 9))
    pd.testing.assert_frame_equal(grown[2:9].reset_index(drop=True), table, check_exact=True)


def test_a_study_that_shrank_returns_its_own_runs_only(seven):
    study, table, folder = seven
    small = run(Study("seven", study.trial, grid(seed=[5, 1])), folder / "results", progress=False)
    assert called(folder) == []
    pd.testing.assert_frame_equal(small, table.iloc[[5, 1]].reset_index(drop=True), check_exact=True)
    assert len(run(study, folder / "results", progress=False)) == 7
    assert called(folder) == []


def test_two_studies_in_one_folder_do_not_meet(seven):
    study, table, folder = seven
    run(Study("seven-2", lambda seed: {"y": "other"}, grid(seed=range(3))), folder / "results", jobs=1, progress=False)
    pd.testing.assert_frame_equal(run(study, folder / "results", progress=False), table, check_exact=True)
    assert called(folder) == []
    assert list(read_table(folder / "results" / "seven-2.csv")["y"]) == ["other"] * 3


def test_a_last_line_that_was_cut_costs_its_run_only(seven):
    study, table, folder = seven
    path = folder / "results" / "seven.journal"
    whole = path.read_bytes()
    for length in range(whole[:-1].rindex(b"\n") + 1, len(whole), 6):
        path.write_bytes(whole[:length])
        again = run(study, folder / "results", jobs=1, progress=False)
        assert called(folder) == [6]
        assert compared(again) == compared(table)


def test_a_changed_byte_costs_its_run_only(seven, capsys):
    study, table, folder = seven
    path = folder / "results" / "seven.journal"
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    start = sum(map(len, lines[:4]))  # of the third run's line
    for position in range(start, start + len(lines[4]) - 1, 9):
        damaged = bytearray(whole)
        damaged[position] ^= 0x10
        path.write_bytes(damaged)
        again = run(study, folder / "results", jobs=1)
        assert called(folder) == [2]
        assert compared(again) == compared(table)
        assert "seven.journal: 1 damaged or incomplete line(s) dropped" in capsys.readouterr().err


def test_results_whose_making_is_unknown_are_refused(seven):
    study, _, folder = seven
    path = folder / "results" / "seven.journal"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([lines[0], lines[1].replace(b"numpy", b"numpi"), *lines[2:]]))
    with pytest.raises(StudyError, match=r"seven.journal: the line with the origin of these results is damaged"):
        run(study, folder / "results", progress=False)
    assert called(folder) == []


def test_a_foreign_file_in_the_journals_place_is_refused_and_left(tmp_path):
    (tmp_path / "a.journal").write_text("my diary\n")
    study = Study("a", counted(tmp_path), grid(seed=range(3)))
    with pytest.raises(StudyError, match=r"a.journal: not a hexakin journal"):
        run(study, tmp_path, jobs=1, progress=False)
    assert (tmp_path / "a.journal").read_text() == "my diary\n" and called(tmp_path) == []
    run(study, tmp_path, jobs=1, progress=False, restart=True)
    assert (tmp_path / "a.journal.1.old").read_text() == "my diary\n"


# Results of something else


def load(path, source):
    """A module written anew, as after an edit."""
    path.write_text(source)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_results_of_another_trial_are_refused_until_they_are_set_aside(tmp_path):
    first = load(tmp_path / "mine.py", "def trial(seed):\n    return {'x': seed}\n")
    table = run(Study("a", first.trial, grid(seed=range(3))), tmp_path / "r", jobs=1, progress=False)
    kept = {path.name: path.read_bytes() for path in (tmp_path / "r").iterdir() if path.suffix != ".lock"}
    second = load(tmp_path / "mine.py", "def trial(seed):\n    return {'x': seed + 0.5}\n")
    code, now = (provenance(function)["code"] for function in (first.trial, second.trial))
    study = Study("a", second.trial, grid(seed=range(3)))
    if code == now:  # both read from the file as it is now
        code = json.loads(kept["a.json"])["code"]
    with pytest.raises(StudyError, match=rf"a.journal: made by code {code} \(now {now}\); results are not mixed"):
        run(study, tmp_path / "r", progress=False)
    assert {path.name: path.read_bytes() for path in (tmp_path / "r").iterdir() if path.suffix != ".lock"} == kept
    assert list(run(study, tmp_path / "r", jobs=1, progress=False, restart=True)["x"]) == [0.5, 1.5, 2.5]
    for name, content in kept.items():
        assert (tmp_path / "r" / f"{name}.1.old").read_bytes() == content
    run(study, tmp_path / "r", jobs=1, progress=False, restart=True)
    assert (tmp_path / "r" / "a.csv.2.old").exists()
    assert list(table["x"]) == [0, 1, 2]


def test_results_of_other_versions_or_another_function_are_refused_by_name(seven, monkeypatch):
    study, _, folder = seven
    with pytest.raises(StudyError, match=r"made by trial test_study:counted.<locals>.trial \(now test_study:.*lambda"):
        run(Study("seven", lambda seed: {}, study.runs), folder / "results", progress=False)
    monkeypatch.setattr("importlib.metadata.version", lambda name: "0.0" if name == "scipy" else study.name)
    monkeypatch.setattr("hexakin.study.provenance.PACKAGES", ("scipy",))
    with pytest.raises(StudyError, match=r"made by versions .*scipy \d.* \(now 0.0\)"):
        run(study, folder / "results", progress=False)
    assert called(folder) == []


def test_functions_typed_into_an_interpreter_run_in_workers_and_are_told_apart(tmp_path):
    program = """
from hexakin.study import Study, StudyError, grid, run
scale = 2.0
def trial(seed):
    return {"x": scale * seed}
print(list(run(Study("a", trial, grid(seed=range(4))), "r", jobs=2, progress=False)["x"]))
def trial(seed):
    return {"x": 3.0 * seed}
try:
    run(Study("a", trial, grid(seed=range(4))), "r", jobs=2, progress=False)
except StudyError as error:
    print(error)
"""
    call = [sys.executable, "-W", "error", "-"]
    done = subprocess.run(call, input=program, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0 and done.stderr == ""
    values, error = done.stdout.splitlines()
    assert values == "[0.0, 2.0, 4.0, 6.0]"
    assert error.startswith(os.path.join("r", "a.journal") + ": made by code ")


# Runs that go wrong


def boom(seed):
    if seed == 3:
        raise ZeroDivisionError("by nothing")
    return {"x": seed}


def unsolved(seed):
    if seed == 3:
        raise ContactError(0.5, 1e-8, 100)
    return {"x": seed}


def leaving(seed):
    if seed == 3:
        sys.exit("enough")
    return {"x": seed}


@pytest.mark.parametrize(
    ("trial", "message"),
    [
        (boom, r"ZeroDivisionError: by nothing \(test_study.py, line \d+\)"),
        (unsolved, r"ContactError: contact problem not solved: relative residual 0.5 .*"),
        (leaving, r"SystemExit: enough \(test_study.py, line \d+\)"),
        (
            lambda seed: {"x": 1 if seed < 3 else [1]},
            r"InvalidInputError: the trial returned x: \[1\] is not a number.*",
        ),
        (
            lambda seed: {"x": 1} if seed < 3 else None,
            r"InvalidInputError: the trial returned None, expected a mapping.*",
        ),
        (
            lambda seed: {"x": 1} if seed < 3 else {"seed": 1},
            r"InvalidInputError: .* returned seed: the table already has.*",
        ),
        (
            lambda seed: {"x": 1} if seed < 3 else {"status": 1},
            r".* returned status: the table already has such a column",
        ),
        (lambda seed: {"x": 1} if seed < 3 else {1: 1}, r"InvalidInputError: the trial returned 1 as a name, .*"),
        (lambda seed: {"x": 1} if seed < 3 else {"y": 1}, r"the trial returned other names than .* earlier run: x, y"),
        (lambda seed, *, more: {}, r"TypeError: .*missing 1 required keyword-only argument: 'more'"),
    ],
)
def test_a_faulty_run_stops_the_study_by_name_and_finished_ones_are_kept(tmp_path, trial, message):
    with pytest.raises(StudyError, match=rf"^study a: run {{'seed': [03]}}: {message}$"):
        run(Study("a", trial, grid(seed=range(6))), tmp_path, jobs=1, progress=False)
    records, dropped = journal.read(tmp_path / "a.journal")
    kept = [record["run"]["seed"] for record in records if "run" in record]
    assert kept == ([] if "more" in message else [0, 1, 2]) and dropped == 0
    assert not (tmp_path / "a.csv").exists()


def test_a_faulty_run_in_a_worker_stops_the_study_quietly(tmp_path, capfd):
    (tmp_path / "faulty").touch()

    def trial(seed):
        if seed == 5 and (tmp_path / "faulty").exists():
            raise ValueError("not this one")
        return {"x": seed}

    study = Study("a", trial, grid(seed=range(40)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(StudyError, match=r"^study a: run {'seed': 5}: ValueError: not this one \(test_study.py"):
            run(study, tmp_path, jobs=2, progress=False)
        (tmp_path / "faulty").unlink()
        assert list(run(study, tmp_path, jobs=1, progress=False)["x"]) == list(range(40))
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system kills in another way")
def test_a_worker_that_the_system_kills_is_an_error_that_names_the_runs_it_may_have_been(tmp_path):
    (tmp_path / "faulty").touch()
    log = counted(tmp_path)

    def trial(seed):
        if seed == 5 and (tmp_path / "faulty").exists():
            while sum(1 for _ in open(tmp_path / "a.journal")) < 7:  # the runs before it are finished
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGKILL)
        if seed > 5 and (tmp_path / "faulty").exists():
            time.sleep(600.0)  # until it is stopped
        return log(seed)

    study = Study("a", trial, grid(seed=range(12)))
    with pytest.raises(
        StudyError, match=r"^study a: a worker process died.*one of the runs: .*{'seed': 5}.*finished runs are kept"
    ):
        run(study, tmp_path, jobs=2, progress=False)
    assert called(tmp_path) == [0, 1, 2, 3, 4]
    (tmp_path / "faulty").unlink()
    run(study, tmp_path, jobs=1, progress=False)
    assert called(tmp_path) == [5, 6, 7, 8, 9, 10, 11]


def test_a_trial_that_cannot_be_sent_to_workers_is_an_error(tmp_path):
    lock = threading.Lock()

    def trial(seed):
        with lock:
            return {"x": seed}

    study = Study("a", trial, grid(seed=range(3)))
    with pytest.raises(StudyError, match=r"study a: the workers failed: PicklingError.*cannot pickle '_thread.lock'"):
        run(study, tmp_path, jobs=2, progress=False)
    assert len(run(study, tmp_path, jobs=1, progress=False)) == 3


# Where the runs are made


class Taken(Exception):
    pass


@pytest.mark.parametrize(
    ("configured", "jobs", "expected"),
    [
        ({}, None, -1),
        ({}, 3, 3),
        ({"n_jobs": 1}, None, 1),
        ({"n_jobs": 1}, 2, 2),
        ({"backend": "loky"}, None, -1),
        ({"backend": "loky", "n_jobs": 2}, None, 2),
        ({"backend": "threading", "n_jobs": 2}, None, 2),
        ({"backend": "threading"}, None, -1),
    ],
)
def test_jobs_are_what_the_caller_says_or_configured_or_all_cores(tmp_path, monkeypatch, configured, jobs, expected):
    def parallel(n_jobs, **options):
        raise Taken(n_jobs)

    monkeypatch.setattr("joblib.Parallel", parallel)
    with joblib.parallel_config(**configured), pytest.raises(StudyError, match=rf"Taken: {expected} "):
        run(Study("a", lambda seed: {}, grid(seed=range(3))), tmp_path, jobs=jobs, progress=False)


def test_no_jobs_is_an_error(tmp_path):
    with pytest.raises(InvalidInputError, match=r"jobs: 0, expected how many processes"):
        run(Study("a", lambda seed: {}, grid(seed=range(3))), tmp_path / "r", jobs=0)
    assert not (tmp_path / "r").exists()


def test_processes_threads_and_this_process_give_equal_tables(tmp_path):
    study = Study("a", counted(tmp_path), grid(seed=range(12)))
    tables = {jobs: run(study, tmp_path / f"{jobs}", jobs=jobs, progress=False) for jobs in (1, 2)}
    with joblib.parallel_config("threading", n_jobs=2):
        tables["threads"] = run(study, tmp_path / "threads", progress=False)
    with joblib.parallel_config(n_jobs=1):
        tables["one"] = run(study, tmp_path / "one", progress=False)
    for where, table in tables.items():
        assert compared(table) == compared(tables[1])
        assert (str(os.getpid()) in set(table["pid"])) == (where != 2)


def test_workers_import_a_trial_again_when_it_was_edited(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for scale in (0.5, 0.25):
        (tmp_path / "edited.py").write_text(f"def trial(seed):\n    return {{'x': seed * {scale}}}\n")
        sys.modules.pop("edited", None)
        importlib.invalidate_caches()
        study = Study("a", importlib.import_module("edited").trial, grid(seed=range(4)))
        table = run(study, tmp_path, jobs=2, progress=False, restart=True)
        assert list(table["x"]) == [seed * scale for seed in range(4)]
    sys.modules.pop("edited")


def test_a_dask_cluster_gives_the_same_table_quietly(tmp_path, capfd):
    distributed = pytest.importorskip("distributed")
    study = Study("a", counted(tmp_path), grid(seed=range(12)))
    expected = run(study, tmp_path / "here", jobs=1, progress=False)
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
    with cluster, distributed.Client(cluster), joblib.parallel_config("dask"), warnings.catch_warnings():
        warnings.simplefilter("error")
        table = run(study, tmp_path / "there", progress=False)
        with pytest.raises(StudyError, match=r"study b: run {'seed': 3}: ZeroDivisionError: by nothing"):
            run(Study("b", boom, grid(seed=range(6))), tmp_path / "there", progress=False)
    assert compared(table) == compared(expected)
    assert str(os.getpid()) not in set(table["pid"])
    out, err = capfd.readouterr()
    assert out == "" and "Warning:" not in err and "Traceback" not in err


def test_a_walk_is_the_same_in_a_worker_as_in_a_plain_call(tmp_path):
    arguments = {"scenario": "ramp", "k_z": 0.8, "k_alpha": 0.6, "k_beta": 0.0, "engine": "rigid", "time_step": 0.005}
    arguments |= {"seed": 3, "layout": 0, "num_cycles": 1}
    table = run(Study("a", walk, [arguments]), tmp_path, jobs=2, progress=False)
    for name, value in walk(**arguments).items():
        assert table[name][0].hex() == value.hex() if isinstance(value, float) else table[name][0] == value


# How far it is


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_on_a_terminal_shows_the_remaining_time(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    study = Study("slow-one", lambda seed: time.sleep(0.3) or {}, grid(seed=range(6)))
    run(study, tmp_path, jobs=1)
    shown = sys.stderr.getvalue()
    assert "slow-one: 100%" in shown and "6/6" in shown
    assert any(re.search(r"<\d\d:\d\d", line) and "100%" not in line for line in shown.split("\r"))


def test_progress_in_a_file_is_a_few_lines_and_none_when_it_is_off(tmp_path, monkeypatch):
    trial = counted(tmp_path)
    monkeypatch.setattr("sys.stderr", io.StringIO())
    run(Study("a", trial, grid(seed=range(300))), tmp_path, jobs=1, progress=False)
    assert sys.stderr.getvalue() == ""
    run(Study("a", trial, grid(seed=range(600))), tmp_path, jobs=1)
    shown = sys.stderr.getvalue()
    assert "300/600" in shown and "600/600" in shown
    assert shown.count("\r") + shown.count("\n") < 10
    monkeypatch.setattr("sys.stderr", io.StringIO())
    run(Study("a", trial, grid(seed=range(600))), tmp_path, jobs=1)
    assert sys.stderr.getvalue() == ""


# Killed

RUNNER = """
import math, os, sys, time
from hexakin.exceptions import SimulationError
from hexakin.study import Study, grid, run

def trial(a, seed):
    session = os.environ["SESSION"]
    with open("calls.log", "a+") as log:
        log.write(f"{session} {a} {seed}\\n")
        log.seek(0)
        calls = sum(line.startswith(f"{session} ") for line in log)
    time.sleep(0.02 if calls <= int(os.environ["MOST"]) else 600.0)
    if seed == 7:
        raise SimulationError(f"fell, at\\n{a}")
    return {"x": math.exp(a * seed), "y": None if seed % 2 else a / 3, "said": f"{seed}"}

study = Study("killed", trial, grid(a=[0.1, 0.2, 0.7], seed=range(20)))
if __name__ == "__main__":
    run(study, "results", jobs=int(sys.argv[1]), progress=False)
"""


def living(groups):
    """Processes of these groups that run."""
    psutil = pytest.importorskip("psutil")
    found = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) in groups and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (OSError, psutil.Error):
            pass
    return found


def journalled(path):
    return {(r["run"]["a"], r["run"]["seed"]) for r in journal.read(path)[0] if "run" in r}


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="no process groups")
def test_a_study_killed_ten_times_ends_as_one_that_was_not(tmp_path, monkeypatch):
    runner, path = tmp_path / "runner.py", tmp_path / "results" / "killed.journal"
    study = load(runner, RUNNER).study
    rng = np.random.default_rng(20240501)
    finished, groups = {}, set()
    for session in range(11):
        finished[session] = journalled(path)
        size = path.stat().st_size if path.exists() else 0
        monkeypatch.setenv("SESSION", str(session))
        # However slow this process is, a session that is to be killed waits for it after a few calls.
        monkeypatch.setenv("MOST", "5" if session < 10 else "1000")
        jobs = 2 if session in (0, 3) else 1
        process = subprocess.Popen([sys.executable, runner, str(jobs)], cwd=tmp_path, start_new_session=True)
        groups.add(process.pid)
        if session < 10:
            grown, pause = rng.integers(1, 300), rng.uniform(0.0, 0.05)
            while process.poll() is None and (not path.exists() or path.stat().st_size < size + grown):
                time.sleep(0.002)
            time.sleep(pause)
            (os.killpg if session % 2 else os.kill)(process.pid, signal.SIGKILL)
        assert process.wait(timeout=600) == (-signal.SIGKILL if session < 10 else 0)

    calls = [line.split() for line in (tmp_path / "calls.log").read_text().splitlines()]
    for session, before in finished.items():
        made = {(float(a), int(seed)) for number, a, seed in calls if int(number) == session}
        assert not made & before, "a finished run was made again"
    assert len(study) <= len(calls) <= len(study) + 6 * 10

    monkeypatch.chdir(tmp_path)
    run(study, "whole", jobs=1, progress=False)
    tables = []
    for folder in ("results", "whole"):
        with open(tmp_path / folder / "killed.csv", newline="") as stream:
            tables.append([[cell for k, cell in enumerate(row) if k != 6] for row in csv.reader(stream)])
    assert tables[0][0] == ["a", "seed", "status", "x", "y", "said"] and len(tables[0]) == 61
    assert tables[0] == tables[1]

    deadline = time.monotonic() + 300.0
    while (left := living(groups)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left, "the workers of a killed runner end by themselves"
