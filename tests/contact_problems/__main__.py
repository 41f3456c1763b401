"""Solve random contact problems with the exact friction cone, and count how many are solved.

``python tests/contact_problems`` solves 1000 problems of each class, compliance, first guess and friction coefficient,
prints the counts and writes ``table.csv``; ``--count`` sets another number, and then no table is written. Solved means
that the residual, computed by code of its own, is at most 1e-8 of the largest impulse. ``without last resorts`` counts
the problems that ``solve_cone`` has solved alone. The exit code is 1 unless all are solved.
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
from random_problems import CLASSES, COMPLIANCES, FRICTION, STARTS, random_problem, residual

from hexakin.contact.cone import ConeProblem, cone_memory, solve_cone
from hexakin.contact.last_resorts import solve_hard_cone

HERE = Path(__file__).resolve().parent
COUNT = 1000
BAR = 1e-8  # relative residual of a solution
TOLERANCE, MAX_SWEEPS = 1e-9, 200  # the tolerance of hexakin.contact.solve
COLUMNS = ("class", "compliance", "start", "friction", "problems", "without last resorts", "solved", "worst residual")


def solved(problem, nearby, start):
    """Return the residual that is reached, and whether the last resorts were needed.

    A warm start is the solution of the problem ``nearby``, as in a walk, where it is that of the last time step.
    """
    n, m = problem.mu.size, problem.low.size
    size = 3 * n + m
    p, u, memory = np.zeros(size), np.zeros(size), cone_memory(size)
    if start == "warm":
        solve_cone(ConeProblem(*nearby), n, m, p, u, TOLERANCE, MAX_SWEEPS, memory)
    error, _ = solve_cone(ConeProblem(*problem), n, m, p, u, TOLERANCE, MAX_SWEEPS, memory)
    hard = not error <= TOLERANCE
    if hard:
        solve_hard_cone(ConeProblem(*problem), n, m, p, u, TOLERANCE, memory)
    return residual(problem, p), hard


def rows(count):
    """Yield a row of the table for each class, compliance, first guess and friction coefficient."""
    for k, kind in enumerate(CLASSES):
        for compliance in COMPLIANCES:
            for start in STARTS:
                for friction in FRICTION:
                    found = []
                    for number in range(count):
                        rng = np.random.default_rng([k, int(1e6 * compliance), int(10 * friction), number])
                        found.append(solved(*random_problem(rng, kind, friction, compliance), start))
                    errors, hard = np.array(found).T
                    alone, all_in_all = int((hard == 0.0).sum()), int((errors <= BAR).sum())
                    yield kind, compliance, start, friction, count, alone, all_in_all, f"{errors.max():.0e}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=COUNT, help="number of problems of each kind")
    options = parser.parse_args()
    table = []
    for row in rows(options.count):
        table.append(row)
        print(*row, sep=", ", flush=True)
    if options.count == COUNT:
        with open(HERE / "table.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows([COLUMNS, *table])
    total, good = sum(row[4] for row in table), sum(row[6] for row in table)
    print(f"{good} of {total} problems solved, {total - sum(row[5] for row in table)} by last resorts")
    return int(good < total)


if __name__ == "__main__":
    sys.exit(main())
