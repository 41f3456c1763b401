"""How times are compared, the one command, and the committed results of its run."""

import hashlib
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "tests" / "benchmarks"
sys.path.insert(0, str(FOLDER))
try:
    comparison, summary = importlib.import_module("comparison"), importlib.import_module("summary")
finally:
    sys.path.remove(str(FOLDER))

COMMITTED, ABOUT = summary.results()
NUMBERS = ("seconds", "seconds_against", "per_unit", "per_unit_against", "ratio", "ratio_low", "ratio_high", "agreed")


def rows_of(times, pairs, **options):
    return comparison.compared("work", 10, "piece", times, pairs, **options)


def test_a_ratio_is_the_median_of_pairs_not_the_ratio_of_medians():
    ours, theirs = [1.0, 2.0, 9.0], [2.0, 8.0, 3.0]
    assert comparison.paired_ratio(ours, theirs) == (0.5, 0.25, 3.0)
    (row,) = rows_of({"a": ours, "b": theirs}, {("a", "b"): 0.5})
    assert (row.seconds, row.seconds_against, row.ratio) == (2.0, 3.0, 0.5)
    assert (row.per_unit, row.repetitions, row.met()) == (0.2, 3, True)


def test_drift_of_the_machine_cancels():
    drift = [1.0, 3.0, 2.0, 10.0]
    (row,) = rows_of({"a": [0.1 * d for d in drift], "b": drift}, {("a", "b"): None})
    assert row.ratio_low == pytest.approx(0.1) and row.ratio_high == pytest.approx(0.1) and row.met() is None


def test_a_code_that_is_timed_on_less_is_scaled():
    (row,) = rows_of({"a": [1.0], "b": [1.0]}, {("a", "b"): 0.1}, timed={"b": 2}, units=60)
    assert (row.seconds_against, row.per_unit_against, row.timed, row.timed_against) == (5.0, 5.0 / 60, 10, 2)
    assert row.ratio == 0.2 and row.met() is False and "not met" in str(row)


def test_timings_are_taken_in_turn_and_the_first_round_is_left_out():
    calls = []

    def taken(name):
        calls.append(name)
        return float(len(calls))

    times = comparison.interleaved({name: lambda name=name: taken(name) for name in "ab"}, 2)
    assert calls == list("ababab") and times == {"a": [3.0, 5.0], "b": [4.0, 6.0]}


def test_a_short_call_is_repeated_until_the_clock_can_tell():
    now = [0.0]

    def work():
        now[0] += 1e-3

    timing = comparison.timed(work, at_least=0.1, clock=lambda: now[0])
    assert timing() == pytest.approx(1e-3) and now[0] > 0.1
    before = now[0]
    assert timing() == pytest.approx(1e-3)
    assert 0.05 <= now[0] - before < 0.3, "the number of calls that was found is kept"


def test_a_table_reads_back_as_it_was(tmp_path):
    rows = rows_of({"a, b": [1 / 3], "c": [2.0]}, {("a, b", "c"): None})
    (tmp_path / "speed.csv").write_text(comparison.table(rows), encoding="utf-8")
    (tmp_path / "speed.json").write_text("{}", encoding="utf-8")
    ((read,), _) = summary.results(tmp_path)
    assert (read["code"], read["seconds"], read["bar"], read["size"]) == ("a, b", "0.333333", "", "10")


def test_the_command_runs_from_end_to_end_and_says_that_it_was_quick(tmp_path):
    call = [sys.executable, str(FOLDER), "--quick", "--only", "plan_walk", "--folder", str(tmp_path)]
    utf8 = {**os.environ, "PYTHONIOENCODING": "utf-8"}  # the table has a µ
    done = subprocess.run(call, capture_output=True, text=True, encoding="utf-8", check=True, env=utf8)
    rows, about = summary.results(tmp_path)
    assert [row["benchmark"] for row in rows] == ["walk plan"] and "written" in done.stdout
    assert about["quick"] is True and about["benchmarks"] == ["plan_walk"] and about["versions"]["numpy"]
    check_whole(tmp_path, rows, about)
    check_row(rows[0])


def test_an_unknown_benchmark_is_named_and_nothing_is_written(tmp_path):
    call = [sys.executable, str(FOLDER), "--only", "warp", "--folder", str(tmp_path)]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 2 and "'warp'" in done.stderr and not list(tmp_path.iterdir())


def check_whole(folder, rows, about):
    assert hashlib.sha256((folder / "speed.csv").read_bytes()).hexdigest() == about["sha256"]
    assert about["rows"] == len(rows)


def check_row(row):
    """What holds of every row, whatever was measured."""
    numbers = {name: float(row[name]) for name in NUMBERS}
    assert all(value > 0.0 for value in numbers.values()) and numbers["agreed"] <= 1.0
    # If every pair's ratio lies in a range, so does that of the medians.
    low, high = numbers["ratio_low"] * (1 - 1e-5), numbers["ratio_high"] * (1 + 1e-5)
    assert low <= numbers["ratio"] <= high
    assert low <= numbers["seconds"] / numbers["seconds_against"] <= high
    assert row["bar"] == "" or float(row["bar"]) > 0.0
    assert int(row["repetitions"]) >= 1 and row["clock"] in ("thread", "wall")
    assert all(1 <= int(row[name]) <= int(row["size"]) for name in ("timed", "timed_against"))
    units = [numbers["seconds"] / numbers["per_unit"], numbers["seconds_against"] / numbers["per_unit_against"]]
    assert units[0] == pytest.approx(units[1], rel=1e-4)
    assert units[0] == pytest.approx(int(row["size"]) * (6 if row["unit"] == "leg pose" else 1), rel=1e-4)


@pytest.mark.parametrize("row", COMMITTED, ids=lambda row: "-".join((row["benchmark"], row["size"], row["against"])))
def test_every_committed_row_is_well_formed(row):
    check_row(row)


def test_the_committed_results_are_of_one_run_of_everything():
    check_whole(ROOT / "data" / "results", COMMITTED, ABOUT)
    names = ("benchmark", "size", "code", "against")
    assert len({tuple(row[name] for name in names) for row in COMMITTED}) == len(COMMITTED)
    scripts = {path.stem for path in FOLDER.glob("*.py") if "alone(measure)" in path.read_text(encoding="utf-8")}
    assert set(ABOUT["benchmarks"]) == scripts and ABOUT["left_out"] == []
    assert ABOUT["machine"]["cpu"] and len(ABOUT["load_average"]) == 3
    pinned = dict(line.split("==") for line in (FOLDER / "peers.txt").read_text().splitlines() if "==" in line)
    for peer in ("roboticstoolbox-python", "ikpy", "mujoco"):
        assert ABOUT["versions"][peer] == pinned[peer]


def test_the_readmes_table_of_ratios_is_that_of_the_results():
    """Mend it with: python tests/benchmarks/summary.py."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    _, rest = readme.split("<!-- speed: python tests/benchmarks/summary.py -->\n")
    assert rest.split("<!-- end of speed -->")[0] == summary.text(COMMITTED, ABOUT)


def test_a_missed_bar_and_a_busy_machine_are_said():
    rows = [dict(row) for row in COMMITTED]
    met = summary.text(rows, ABOUT | {"quick": False, "loaded": False})
    assert "preliminary" not in met and "few repetitions" in summary.caution({"quick": True, "loaded": False})
    for row in rows:
        row["ratio"] = "7.5"
    said = summary.text(rows, ABOUT | {"loaded": True})
    assert "a busy machine" in said and "missed" in said and " met |" not in said and " 0 are met" in said
