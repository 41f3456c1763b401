"""Wrong arguments of public functions: an error of hexakin or a result, never a raw error, a wait or a dead process."""

import csv
import subprocess
import sys
from pathlib import Path

from public_objects import public_objects

FOLDER = Path(__file__).parent / "wrong_inputs"


def test_calls_with_a_wrong_argument_end_in_a_result_or_an_error():
    command = [sys.executable, str(FOLDER), "--share", "0.02", "--seed", "1", "--jobs", "1"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-4000:]
    number = int(run.stdout.rsplit("\n", 2)[-2].split()[0])
    assert number > 800


def test_the_table_of_the_calls_has_public_callables_only_and_no_failure():
    with open(FOLDER / "table.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert sum(int(row[outcome]) for row in rows for outcome in ("result", "error", "refused by Python")) > 5000
    assert all(row[outcome] == "0" for row in rows for outcome in ("raw error", "over 10 s", "process died"))
    known = public_objects()
    assert {row["callable"] for row in rows} <= set(known), "the table is older: run python tests/wrong_inputs"
