"""Simulate 100 walks of ATHENA at each high friction coefficient and on each ground, on engine ``rigid``.

``python tests/high_friction`` writes ``table.csv``, a row for each walk of 20 gait cycles, and prints how many stopped.
``--count`` sets another number of walks, and then no table is written. ``--jobs`` is the number of processes. The exit
code is 1 if a walk stopped.
"""

import argparse
import csv
import sys
from pathlib import Path

from joblib import Parallel, delayed
from walks import COLUMNS, FRICTION, GROUNDS, walk

COUNT = 100


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    cases = [(friction, ground, seed) for friction in FRICTION for ground in GROUNDS for seed in range(options.count)]
    rows = Parallel(options.jobs)(delayed(walk)(*case) for case in cases)
    if options.count == COUNT:
        with (Path(__file__).parent / "table.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows([COLUMNS, *((*row[:5], f"{row[5]:.1e}", row[6]) for row in rows)])
    stopped = [row for row in rows if row[6]]
    print(f"{len(rows)} walks, {len(stopped)} stopped, {sum(row[4] for row in rows)} steps missed the tolerance")
    return bool(stopped)


if __name__ == "__main__":
    sys.exit(main())
