"""Time a study with one process and with two, in turn, and the call that finds it finished: medians and the ratio.

Run with ``python tests/benchmarks/study_workers.py [repeats] [cycles] [runs]`` on a machine with two idle cores. The
runs are paper A's walks on the ramp, engine "rigid", of so many gait cycles. Each time is that of the call of ``run``
in a fresh interpreter whose workers are up: a small study before has started them, and each has imported hexakin and
loaded the compiled code. What that takes once, and the ratio with it, is shown too; it weighs less in a longer study.
"""

import json
import statistics
import subprocess
import sys
import tempfile

PROGRAM = """
import json, sys, time
from hexakin.experiments import walk
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


def seconds(jobs: int, cycles: int, runs: int) -> tuple[float, float, float, str]:
    """Times [s] of the start, of a study and of the same call once more, and its table, in a fresh interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "-c", PROGRAM, folder, *map(str, (jobs, cycles, runs))]
        return tuple(json.loads(subprocess.run(call, stdout=subprocess.PIPE, check=True).stdout))


def main() -> None:
    """Print the medians, the median of the paired ratios and their range."""
    given = [int(argument) for argument in sys.argv[1:]]
    repeats, cycles, runs = given + [5, 12, 8][len(given) :]
    seconds(1, 1, 1)  # compiles, if that was not done
    pairs = [(seconds(1, cycles, runs), seconds(2, cycles, runs)) for _ in range(repeats)]
    assert len({table for pair in pairs for *_, table in pair}) == 1, "tables differ"
    print(f"{runs} runs of {cycles} gait cycles, {repeats} pairs")
    for jobs, made in enumerate(zip(*pairs, strict=True), start=1):
        start, study, _ = (statistics.median(column) for column in list(zip(*made, strict=True))[:3])
        print(f"  {jobs} process(es): {study:.2f} s, after a start of {start:.2f} s")
    resumed = statistics.median(times[2] for pair in pairs for times in pair)
    ratios = sorted(two[1] / one[1] for one, two in pairs)
    whole = statistics.median((two[0] + two[1]) / (one[0] + one[1]) for one, two in pairs)
    print(f"  ratio {statistics.median(ratios):.3f} (pairs {ratios[0]:.3f} to {ratios[-1]:.3f}); bar: 0.6")
    print(f"  ratio with the start: {whole:.3f}")
    print(f"the same call, all runs finished: {resumed:.3f} s; bar: 1 s")


if __name__ == "__main__":
    main()
