"""Machine code is kept on disk, whatever happens to the disk."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

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
    path.write_text(SOURCE.format(package=Path(__file__).resolve().parent.parent.as_posix()))
    return path


def run(program, **environment):
    """Answer and number of functions loaded from disk, in a process of its own."""
    command = [sys.executable, "-c", "import adder; print(adder.answer, adder.hits)"]
    made = start(command, program, environment)
    out, _ = made.communicate(timeout=600)
    assert made.returncode == 0
    answer, hits = out.split()
    return float(answer), int(hits)


def start(command, program, environment):
    import os

    return subprocess.Popen(
        command, cwd=program.parent, env={**os.environ, **environment}, stdout=subprocess.PIPE, text=True
    )


def files(program, ending):
    return sorted((program.parent / "__pycache__").glob(f"adder.total*.{ending}"))


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
        "HOME": str(tmp_path / "cache"),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    for _ in range(2):
        assert run(program, **nowhere) == (10.0, 0)


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
