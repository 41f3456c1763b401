"""Walks at friction coefficients at which contact problems are hard; ``python tests/high_friction`` makes them all."""

import csv
from pathlib import Path

import pytest
from high_friction.walks import COLUMNS, CYCLES, FRICTION, GROUNDS, walk

TABLE = Path(__file__).parent / "high_friction" / "table.csv"
SEEDS = range(10)  # of 100


@pytest.mark.parametrize("ground", GROUNDS)
def test_walks_at_friction_3_do_not_stop(ground):
    for seed in SEEDS:
        row = walk(3.0, ground, seed)
        assert row[3] == CYCLES, row
        assert row[4] == 0 and row[5] <= 1e-8, row


def test_the_table_has_all_walks_and_their_steps_met_the_tolerance():
    """A walk either stops or is right: some stop at friction 3, and a third of them at friction 50."""
    with TABLE.open(encoding="utf-8") as file:
        columns, *rows = csv.reader(file)
    assert tuple(columns) == COLUMNS
    assert len(rows) == 100 * len(FRICTION) * len(GROUNDS)
    finished = [row for row in rows if not row[6]]
    assert all(int(row[3]) == CYCLES for row in finished)
    assert sum(int(row[4]) for row in finished) <= 1
