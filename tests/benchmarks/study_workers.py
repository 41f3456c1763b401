"""Time a study with two processes and with one.

    python tests/benchmarks/study_workers.py [--quick]

The ratio is useful only on a machine with two idle cores. The runs are paper A's walks on the ramp with engine "rigid".
The time is that of the call of ``run`` in a fresh interpreter, after a small study has started the workers and each has
imported hexakin and loaded the compiled code. A second row includes the time of this start, whose share is smaller in a
longer study. The tables must be equal.
"""

import json
import subprocess
import sys
import tempfile

from comparison import alone, compared

CYCLES, RUNS = 12, 8
PROGRAM = """
import json, sys, time
from hexakin.papers.scenarios import walk
from hexakin.study import Study, grid, run

folder, jobs, cycles, runs = sys.argv[1], *map(int, sys.argv[2:])
fixed = {"scenario": "ramp", "engine": "rigid", "time_step": 0.002, "layout": 0, "k_z": 0.8, "k_alpha": 0.6}
first = Study("first", walk, grid(**fixed, k_beta=0.0, num_cycles=1, seed=range(2 * jobs)))
study = Study("walks", walk, grid(**fixed, k_beta=0.0, num_cycles=cycles, seed=range(runs)))
times = []
for one in (first, study, study):
    start = time.perf_counter()
    table = run(one, folder, jobs=jobs, progress=False)
    times.append(time.perf_counter() - start)
assert (table["status"] == "ok").all(), table["status"]
print(json.dumps([*times, table.drop(columns="wall_time").to_csv()]))
"""


def seconds(jobs, cycles, runs):
    """Return the times [s] of the start, a study and a second call of it, and its table, in a fresh interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "-c", PROGRAM, folder, *map(str, (jobs, cycles, runs))]
        return tuple(json.loads(subprocess.run(call, stdout=subprocess.PIPE, check=True).stdout))


def measure(quick=False):
    """Return two rows."""
    seconds(1, 1, 1)  # compiles, if there is no compiled code yet
    found = {jobs: [] for jobs in (1, 2)}
    for _ in range(2 if quick else 5):
        for jobs, made in found.items():
            made.append(seconds(jobs, CYCLES, RUNS))
    assert len({table for made in found.values() for *_, table in made}) == 1, "tables differ"
    names = {1: "one worker", 2: "two workers"}
    alone_, whole = ({names[jobs]: [sum(times[k] for k in part) for times in made] for jobs, made in found.items()}
                     for part in ((1,), (0, 1)))  # fmt: skip
    pair = (names[2], names[1])
    rows = compared("study", RUNS, "run", alone_, {pair: 0.6}, clock="wall")
    return rows + compared("study with start", RUNS, "run", whole, {pair: None}, clock="wall")


if __name__ == "__main__":
    alone(measure)
