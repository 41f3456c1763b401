import json
import os
import signal
import subprocess
import sys
import time

import pytest

from hexakin.__main__ import main
from hexakin.exceptions import StudyError
from hexakin.installation import DATA, __version__
from hexakin.papers.studies import STUDIES
from hexakin.study import journal
from hexakin.study.runner import run

MINE = """
import os, time
from hexakin.exceptions import SimulationError
from hexakin.study import Study, grid

def trial(seed):
    with open("calls.log", "a") as log:
        log.write(f"{seed}\\n")
    time.sleep(float(os.environ.get("NAP", "0")))
    if seed == 1:
        raise SimulationError("fell")
    return {"x": seed / 3}

def faulty(seed):
    return {"x": 1 / seed}

study = Study("mine", trial, grid(seed=range(30)))
other = Study("other", faulty, grid(seed=[1, 0, 2]))
number = 3

def made():
    return Study("made", trial, grid(seed=0))

def broken():
    return Study("made", trial, [])

def worse():
    return number.nothing
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a user's module in it, from which the command is called."""
    (tmp_path / "mine.py").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in ("mine", "late"):
        sys.modules.pop(name, None)


def called(folder):
    return sorted(int(line) for line in (folder / "calls.log").read_text().split())


def test_without_a_name_the_studies_are_listed(capsys):
    assert main(["study"]) == 0
    listed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert list(listed) == list(STUDIES)
    assert listed["ramp_sweeps"].strip() == f"{len(STUDIES['ramp_sweeps']())} runs"


def test_studies_are_listed_without_salib(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "SALib.sample", None)
    monkeypatch.delitem(sys.modules, "hexakin.papers.open_choices", raising=False)
    assert main(["study"]) == 0
    listed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert list(listed) == list(STUDIES)
    assert "install it with: pip install SALib" in listed["ramp_sensitivity"]


def test_studies_of_ones_own_are_run_and_failures_counted(here, capsys):
    assert main(["study", "mine:study", "mine:made", "--folder", "out", "--jobs", "1", "--quiet"]) == 0
    table, made = os.path.join("out", "mine.csv"), os.path.join("out", "made.csv")
    said = f"mine: 30 runs, 1 failed: {table}\nmade: 1 runs, 0 failed: {made}\n"
    assert capsys.readouterr() == (said.replace("\\", "/"), "")
    assert os.path.exists(table) and os.path.exists(made)
    assert main(["study", "mine:study", "--folder", "out", "--jobs", "1"]) == 0
    assert capsys.readouterr().err == "" and called(here) == sorted([*range(30), 0])
    assert main(["study", "mine:study", "--folder", "out", "--jobs", "1", "--restart", "--quiet"]) == 0
    assert called(here) == sorted([*range(30), *range(30), 0]) and os.path.exists(f"{table}.1.old")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ramp_sweep", "unknown study 'ramp_sweep'; known: ramp_sweeps, testbed_sweeps, "),
        ("nowhere:a", "study nowhere:a: importing nowhere failed: ModuleNotFoundError: No module named 'nowhere'"),
        ("late:a", "study late:a: importing late failed: ModuleNotFoundError: No module named 'no' (late.py, line 2)"),
        (":study", "study :study: importing  failed: ValueError: Empty module name"),
        ("mine:studie", "unknown study 'mine:studie'; known: mine:study, mine:other"),
        ("os:studie", "unknown study 'os:studie'; known: none in os"),
        ("mine:number", "study mine:number: expected a hexakin.study.Study or a function returning one, got 3"),
        ("mine:broken", "study made: no runs"),
        ("mine:worse", "study mine:worse: calling worse failed: AttributeError: 'int' object has no"),
        ("mine:other", "study other: run {'seed': 0}: ZeroDivisionError: division by zero (mine.py, line 15)"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_study_is_said_in_one_line(here, capsys, name, message):
    (here / "late.py").write_text("import json\nimport no\n")
    assert main(["study", name, "--jobs", "1", "--quiet"]) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.startswith(f"hexakin: {message}") and err.count("\n") == 1


def test_no_study_is_run_if_one_of_the_names_is_wrong(here, capsys):
    assert main(["study", "mine:study", "mine:studie", "--jobs", "1", "--quiet"]) == 1
    assert main(["study", "mine:study", "ramp_sweep", "--jobs", "1", "--quiet"]) == 1
    assert main(["study", "mine:study", "--jobs", "0", "--quiet"]) == 1
    assert "jobs: 0, expected" in capsys.readouterr().err
    assert not (here / "calls.log").exists() and not (here / "results").exists()


def test_a_robots_file_is_checked_and_summed_up(tmp_path, capsys):
    assert main(["robot"]) == 0
    names = capsys.readouterr().out.split()
    assert {"athena", "hwr", "phantomx"} <= set(names)
    for name in names:
        assert main(["robot", name]) == 0
        out, err = capsys.readouterr()
        assert out.startswith(f"{name}: 6 legs, ") and "inverse kinematics: in closed form" in out and err == ""
    path = tmp_path / "mine.yaml"
    path.write_text((DATA / "robots" / "phantomx.yaml").read_text().replace("mass: {value: 0.976", "mass: {value: 976"))
    assert main(["robot", str(path)]) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.startswith(f"hexakin: {path}: torso.mass: 976 kg in a box of 0.25 x 0.125 x 0.04 m")
    assert main(["robot", "phantom"]) == 1
    assert "unknown robot 'phantom'; known: athena, " in capsys.readouterr().err


def test_the_schema_that_is_printed_ends_in_a_file_that_loads(tmp_path, capsys):
    assert main(["robot", "--schema"]) == 0
    path = tmp_path / "mine.yaml"
    path.write_text(capsys.readouterr().out.split("An example, which loads as it is:\n")[1])
    assert main(["robot", str(path)]) == 0
    assert capsys.readouterr().out.startswith("mine: 6 legs, 2.134 kg\n")


@pytest.mark.parametrize("called, program", [("/usr/bin/hexakin", "hexakin"), ("x/__main__.py", "python -m hexakin")])
def test_the_version_and_the_name_of_the_command_are_printed(called, program, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [called, "--version"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 0 and capsys.readouterr().out == f"hexakin {__version__}\n"
    with pytest.raises(SystemExit):
        main(["--help"])
    assert capsys.readouterr().out.startswith(f"usage: {program} ")


def test_a_wrong_call_is_explained(capsys):
    for arguments in ([], ["study", "--jobs", "many"], ["sutdy"], ["robot", "athena", "hwr"]):
        with pytest.raises(SystemExit, match="2"):
            main(arguments)
        assert "usage: python -m hexakin" in capsys.readouterr().err


def living(group):
    """Processes of this group that run."""
    psutil = pytest.importorskip("psutil")
    found = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (OSError, psutil.Error):
            pass
    return found


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="no process groups")
def test_an_interrupted_study_says_so_leaves_no_worker_and_goes_on(here, monkeypatch):
    import mine

    call = [sys.executable, "-m", "hexakin", "study", "mine:study", "--jobs", "2"]
    path = here / "results" / "mine.journal"
    monkeypatch.setenv("NAP", "0.2")
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while process.poll() is None and len(journal.read(path)[0]) < 4:  # three runs and what made them
        time.sleep(0.01)
    for restart in (False, True):
        with pytest.raises(StudyError, match=r"mine.journal: another process is writing it"):
            run(mine.study, "results", progress=False, restart=restart)
    os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does, which reaches all of a terminal's processes
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130 and out == ""
    assert err.splitlines()[-1] == "hexakin: interrupted; finished runs are kept; repeat the same call to continue"
    assert "Traceback" not in err and "Warning" not in err
    deadline = time.monotonic() + 60.0
    while (left := living(process.pid)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left

    records, dropped = journal.read(path)
    finished = {record["run"]["seed"] for record in records if "run" in record}
    assert 3 <= len(finished) < 30 and dropped == 0
    (here / "calls.log").unlink()
    monkeypatch.setenv("NAP", "0")
    assert main(["study", "mine:study", "--jobs", "1", "--quiet"]) == 0
    assert called(here) == sorted(set(range(30)) - finished)


LIMITED = """
import resource, sys
from hexakin.__main__ import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
sys.exit(main(["study", "mine:study", "--jobs", "1", "--quiet"]))
"""


def test_a_full_disk_stops_a_study_which_goes_on_when_there_is_room(here):
    pytest.importorskip("resource")
    call = [sys.executable, "-B", "-c", LIMITED]
    path = here / "results" / "mine.journal"
    done = subprocess.run([*call, "2000"], capture_output=True, text=True)
    assert done.returncode == 1 and done.stdout == ""
    said = "File too large; finished runs are kept; repeat the same call to continue"
    assert done.stderr == f"hexakin: {os.path.join('results', 'mine.journal')}: {said}\n"
    records, dropped = journal.read(path)
    finished = {record["run"]["seed"] for record in records if "run" in record}
    assert 5 < len(finished) < 30 and dropped == 0
    (here / "calls.log").unlink()
    assert main(["study", "mine:study", "--jobs", "1", "--quiet"]) == 0
    assert called(here) == sorted(set(range(30)) - finished)
    assert json.loads((here / "results" / "mine.json").read_text())["runs"] == 30


PRINTING = {
    "version": ["-m", "hexakin", "--version"],
    "help": ["-m", "hexakin", "study", "--help"],
    "studies": ["-m", "hexakin", "study"],
    "study": ["-m", "hexakin", "study", "mine:study", "--jobs", "1", "--quiet"],
    "robots": ["-m", "hexakin", "robot"],
    "robot": ["-m", "hexakin", "robot", "athena"],
    "schema": ["-m", "hexakin", "robot", "--schema"],
    "statements": ["-m", "hexakin", "statements"],
    "report": ["-m", "hexakin.report", "notebooks", "report", "--stored"],
}
"""Commands that print, each with the words after the interpreter."""


@pytest.fixture
def printing(here):
    """A folder in which all of ``PRINTING`` can be called."""
    nbformat = pytest.importorskip("nbformat")
    (here / "notebooks").mkdir()
    cells = [nbformat.v4.new_markdown_cell("# Gains k_α"), nbformat.v4.new_code_cell("1")]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), here / "notebooks" / "α.ipynb")
    return here


def called_with(command, stdout=subprocess.PIPE, **environment):
    """Run one of ``PRINTING``; ``stdout`` is a file, or None for none at all. Returns the exit code, stdout, stderr."""
    call = [sys.executable, *PRINTING[command]]
    if stdout is None:
        call = ["sh", "-c", '"$@" >&-', "sh", *call]
    # Without a buffer, argparse itself writes the version, and ignores what goes wrong.
    environment = {**os.environ, "PYTHONUNBUFFERED": "", **environment}
    done = subprocess.run(call, stdout=stdout, stderr=subprocess.PIPE, env=environment)
    return done.returncode, done.stdout, done.stderr.decode()


@pytest.mark.parametrize("command", PRINTING)
def test_characters_that_a_stream_does_not_have_are_written_as_escapes(printing, command):
    encoding = "cp1252" if command == "statements" else "ascii"
    code, out, err = called_with(command, PYTHONIOENCODING=encoding)
    assert code == 0 and err == "" and out.decode(encoding)
    assert b"\\u03b1" in out or command not in ("statements", "report")


@pytest.mark.skipif(os.name != "posix", reason="closes a stream by a shell")
@pytest.mark.parametrize("command", ["version", "study", "statements", "report"])
def test_what_cannot_be_printed_is_said_in_one_line(printing, command):
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "wb") as pipe:
        said = called_with(command, pipe)
    assert said == (1, None, "hexakin: standard output: Broken pipe\n")
    if os.path.exists("/dev/full"):
        with open("/dev/full", "wb") as full:
            said = called_with(command, full)
        assert said == (1, None, "hexakin: standard output: No space left on device\n")
    assert called_with(command, None) == (1, None, "hexakin: standard output: Bad file descriptor\n")


@pytest.mark.skipif(os.name != "posix", reason="closes a stream by a shell")
def test_errors_end_a_command_without_a_stream_to_say_them(here):
    failing = [sys.executable, "-m", "hexakin", "robot", "nobody"]
    for redirected in ("2>&-", "2>/dev/full", ">&- 2>&-"):
        done = subprocess.run(["sh", "-c", f'"$@" {redirected}', "sh", *failing], capture_output=True)
        assert (done.returncode, done.stdout, done.stderr) == (1, b"", b""), redirected
