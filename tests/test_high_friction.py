"""Walks at friction coefficients at which contact problems are hard; ``python tests/high_friction`` makes them all."""

import csv
from pathlib import Path

import pytest
from high_friction.walks import COLUMNS, CYCLES, FRICTION, GROUNDS, walk

TABLE = Path(__file__).parent / "high_friction" / "table.csv"
SEEDS = range(10)  # of 100


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("friction", FRICTION)
def test_no_walk_stops_at_high_friction(friction, ground):
    for seed in SEEDS:
        row = walk(friction, ground, seed)
        assert row[3] == CYCLES, row
        assert row[4] == 0 and row[5] <= 1e-8, row


def test_the_table_of_all_walks_has_none_that_stopped():
    with TABLE.open(encoding="utf-8") as file:
        columns, *rows = csv.reader(file)
    assert tuple(columns) == COLUMNS
    assert len(rows) == 100 * len(FRICTION) * len(GROUNDS)
    assert all(int(row[3]) == CYCLES and not row[6] for row in rows)
