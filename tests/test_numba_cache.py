"""Machine code is kept on disk, whatever happens to the disk."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from hexakin.numerics.cache_folders import distrust, usable

numba = pytest.importorskip("numba")

ROOT = Path(__file__).resolve().parent.parent

SOURCE = """
import sys, numpy as np
sys.path.insert(0, "{package}")
from hexakin.numerics.numba_cache import compiled

@compiled
def total(values):
    result = 0.0
    for value in values:
        result += value
    return result

answer = total(np.arange(5.0))
hits = sum(total.stats.cache_hits.values())
"""


@pytest.fixture
def program(tmp_path):
    """A module with a compiled function, in a folder of its own."""
    path = tmp_path / "rooms" / "adder.py"
    path.parent.mkdir()
    path.write_text(SOURCE.format(package=ROOT.as_posix()))
    return path


def run(program, **environment):
    """Answer and number of functions loaded from disk, in a process of its own."""
    return run_and_read(program, **environment)[:2]


def run_and_read(program, **environment):
    """Answer, number of functions loaded from disk, and what is said on stderr."""
    command = [sys.executable, "-c", "import adder; print(adder.answer, adder.hits)"]
    made = start(command, program, environment)
    out, said = made.communicate(timeout=600)
    assert made.returncode == 0, said
    answer, hits = out.split()
    return float(answer), int(hits), said


def start(command, program, environment):
    return subprocess.Popen(
        command, cwd=program.parent, env={**os.environ, **environment}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def files(program, ending):
    return sorted((program.parent / "__pycache__" / "machine_code").glob(f"adder.total*.{ending}"))


def test_machine_code_is_kept_for_the_next_process(program):
    assert run(program) == (10.0, 0)
    assert run(program) == (10.0, 1)


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "garbage"])
def test_a_damaged_file_counts_as_missing_and_is_replaced(program, ending, damage):
    run(program)
    (path,) = files(program, ending)
    content = path.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :]
    path.write_bytes({"empty": b"", "cut": content[:middle], "flipped": flipped, "garbage": b"no code"}[damage])
    assert run(program)[0] == 10.0
    assert run(program) == (10.0, 1)


def test_two_processes_may_compile_at_once(program):
    command = [sys.executable, "-c", "import adder; print(adder.answer)"]
    made = [start(command, program, {}) for _ in range(3)]
    assert [process.communicate(timeout=600)[0].strip() for process in made] == ["10.0"] * 3
    assert run(program) == (10.0, 1)


def test_without_a_place_for_it_each_process_compiles(program, tmp_path):
    """A file where a folder should be can be written by nobody, not even by root."""
    (program.parent / "__pycache__").write_text("")
    (tmp_path / "cache").write_text("")
    nowhere = {
        "HEXAKIN_CACHE": str(tmp_path / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    for _ in range(2):
        assert run(program, **nowhere) == (10.0, 0)


posix = pytest.mark.skipif(os.name != "posix", reason="only POSIX systems tell who may write to a folder")


@posix
def test_machine_code_in_a_folder_that_others_may_write_to_is_not_run(program, tmp_path):
    assert run(program, NUMBA_CACHE_DIR=str(tmp_path / "cache")) == (10.0, 0)
    assert run(program, NUMBA_CACHE_DIR=str(tmp_path / "cache")) == (10.0, 1)
    (folder,) = (tmp_path / "cache").iterdir()
    folder.chmod(0o770)
    answer, hits, said = run_and_read(program, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert (answer, hits) == (10.0, 0)
    assert said.count("hexakin:") == 1 and f"other users may write to {folder} (chmod go-w forbids it)" in said
    assert files(program, "nbc"), "the next place is used"


@posix
def test_a_folder_of_code_belongs_to_its_user_and_cannot_be_replaced(tmp_path, monkeypatch):
    folder = tmp_path / "open" / "code"
    assert usable(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.parent.chmod(0o777)
    assert distrust(folder) == f"all users may write to {folder.parent}, and may replace what is in it"
    folder.parent.chmod(0o1777)
    assert distrust(folder) == ""
    os.symlink(folder, tmp_path / "link")
    folder.chmod(0o702)
    assert distrust(tmp_path / "link").startswith(f"other users may write to {folder}")
    folder.chmod(0o700)
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    assert distrust(folder) == ("" if folder.stat().st_uid == 0 else f"{folder} belongs to another user")


@posix
def test_a_file_that_others_may_write_to_is_not_trusted_unless_they_cannot_reach_it(tmp_path):
    folder, file = tmp_path / "code", tmp_path / "code" / "loops.py"
    folder.mkdir(mode=0o755)
    file.touch()
    file.chmod(0o666)
    assert distrust(folder) == f"other users may write to {file} (chmod go-w forbids it)"
    folder.chmod(0o700)
    assert distrust(folder) == ""


@posix
@pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only the administrator can give files away")
def test_a_file_that_another_user_left_in_a_folder_is_not_trusted(tmp_path):
    """It was written before the folder was closed to others."""
    (tmp_path / "loops.py").touch()
    assert distrust(tmp_path) == ""
    os.chown(tmp_path / "loops.py", 12345, 12345)
    assert distrust(tmp_path) == f"{tmp_path / 'loops.py'} belongs to another user"


@posix
@pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only the administrator can give folders away")
def test_a_folder_of_another_user_is_not_trusted_by_the_administrator_either(tmp_path):
    os.chown(tmp_path, 12345, 12345)
    assert distrust(tmp_path) == f"{tmp_path} belongs to another user"


EXAMPLE = """
from hexakin.numerics.numba_cache import compiled

@compiled
def twice(value):
    return value + value

twice(1.0)
"""


@pytest.fixture
def announcing(tmp_path):
    """A program that compiles a function of a module of hexakin, and says so: what it says, run by run."""
    path = tmp_path / "example.py"
    path.write_text(EXAMPLE)
    script = f"""
import sys
from pathlib import Path
sys.path.insert(0, {str(ROOT)!r})
from hexakin.kinematics.code_cache import executed
from hexakin.numerics.numba_cache import announced
with announced("an example"):
    executed(Path({str(path)!r}).read_text(), {str(path)!r}, "example")
"""

    def said(**environment):
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, env={**os.environ, **environment}
        )
        assert done.returncode == 0, done.stderr
        return done.stderr

    return said


def test_compiling_is_said_only_when_numba_compiles_and_where_the_code_is_kept(announcing, tmp_path):
    folder = tmp_path / "__pycache__" / "machine_code"
    assert announcing() == f"hexakin: compiling an example (up to two minutes), once; it is kept in {folder}\n"
    assert announcing() == ""


def test_compiling_is_said_in_each_process_where_no_code_can_be_kept(announcing, tmp_path):
    (tmp_path / "__pycache__").write_text("")
    (tmp_path / "cache").write_text("")
    for _ in range(2):
        assert announcing(HEXAKIN_CACHE=str(tmp_path / "cache")) == (
            "hexakin: compiling an example (up to two minutes), in each process, since no folder for it can be used\n"
        )


def test_code_that_cannot_be_stored_in_the_end_is_said_too(announcing, tmp_path):
    folder = tmp_path / "__pycache__" / "machine_code"
    folder.mkdir(parents=True, mode=0o700)
    (folder / f"example.twice-4.py{sys.version_info[0]}{sys.version_info[1]}.nbi").mkdir()  # no file can be put there
    assert f"hexakin: the machine code cannot be kept in {folder}: Is a directory\n" in announcing()


def test_a_kernel_takes_only_what_it_was_made_for():
    from hexakin.numerics.numba_cache import kernel

    def doubled(values, result):
        for k in range(values.shape[0]):
            result[k] = 2.0 * values[k]

    made = kernel("1r", "1")(doubled)
    result = np.empty(3)
    made(np.arange(3.0), result)
    np.testing.assert_array_equal(result, [0.0, 2.0, 4.0])
    with pytest.raises(TypeError):
        made(np.arange(3), result)


def test_a_function_that_makes_no_arrays_may_take_parts_of_them_and_make_none():
    from hexakin.numerics.numba_cache import no_new_arrays

    @no_new_arrays
    def sums(values):
        total = 0.0
        for k in range(values.shape[0]):
            row = values[k]
            total += row[0] + row[1]
        return total

    @no_new_arrays
    def makes(count):
        return np.zeros(count).sum()

    values = np.ones((3, 2))
    before = sys.getrefcount(values)
    assert [sums(values) for _ in range(10)] == [6.0] * 10
    assert sys.getrefcount(values) == before
    with pytest.raises(numba.core.errors.TypingError, match="zeros"):
        makes(3)


def test_the_loops_run_in_python_where_numba_is_told_to_compile_nothing():
    """As by ``NUMBA_DISABLE_JIT=1``, for a debugger."""
    code = """
import numpy as np
import hexakin as hk
robot = hk.load_robot("athena")
hk.kinematics.prepare(robot)
print(np.ptp(hk.forward_kinematics(robot, robot.standing_q)[:, 2]))
options = {"duration": 0.1, "time_step": 0.01, "settling_time": 0.1}
print(len(hk.simulate(robot, hk.terrain.Ramp(), hk.PostureController(robot), engine="rigid", **options).time))
"""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    made = subprocess.run([sys.executable, "-c", code], env=environment, cwd=ROOT, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert made.stderr == "" and made.stdout.split() == ["0.0", "2"]


# What is used of numba -----------------------------------------------------------------------------------------


def test_numba_is_bounded_by_the_minor_version_whose_cache_is_known():
    """``hexakin.numerics.numba_cache`` uses classes that numba may change in any minor version.

    To raise the bound: pin the new version in environment.txt, run this file, and change the bound in pyproject.toml.
    """
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    bounds = [re.search(r"<0\.(\d+)", line) for line in dependencies if re.match(r"numba\b", line)]
    pins = re.findall(r"^numba==0\.(\d+)", (ROOT / "environment.txt").read_text(encoding="utf-8"), re.MULTILINE)
    assert max(int(bound[1]) for bound in bounds) == max(map(int, pins)) + 1


def test_numbas_cache_has_the_parts_that_hexakin_replaces():
    from numba.core import caching

    from hexakin.numerics.numba_cache import compiled

    changed = f"numba {numba.__version__} has changed its cache; hexakin.numerics.numba_cache must follow"
    assert caching.FunctionCache._impl_class is caching.CompileResultCacheImpl, changed
    assert isinstance(caching.CacheImpl._locator_classes, list), changed
    for owner, names in {
        caching.CompileResultCacheImpl: ("reduce", "rebuild", "locator", "filename_base"),
        caching.FunctionCache: ("load_overload", "save_overload", "flush", "cache_path"),
        caching._CacheLocator: ("from_function", "ensure_cache_path", "get_cache_path", "get_source_stamp"),
    }.items():
        assert all(hasattr(owner, name) for name in names), changed
    assert isinstance(numba.njit(lambda value: value)._cache, caching.NullCache), changed

    @compiled
    def same(value):
        return value

    impl = same._cache._impl
    assert type(impl).__module__ == "hexakin.numerics.numba_cache", changed
    assert type(impl.locator).__module__ == "hexakin.numerics.numba_cache", changed
