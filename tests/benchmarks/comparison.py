"""How two pieces of code are compared: in turn, in one run, by the ratio of times that were taken side by side.

A machine's speed drifts, and other work slows it; both hit the two times of a pair alike and cancel in their ratio.
A row gives the median of the paired ratios with their range, and the medians of the times themselves.
"""

from __future__ import annotations

import csv
import dataclasses
import importlib.util
import io
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

Timing = Callable[[], float]
"""Runs something and returns the seconds that it took."""


@dataclass(frozen=True)
class Row:
    """One code beside another, doing the same work.

    ``seconds`` and ``seconds_against`` are medians for the whole ``size``, ``per_unit`` and ``per_unit_against`` those
    for one ``unit``, all [s]. A slow code is timed on less than ``size``, on ``timed``, and its time is scaled.
    ``ratio`` is the median of code over against in pairs of neighbouring runs, ``ratio_low`` and ``ratio_high`` the
    least and the largest. ``bar`` is what the ratio should not exceed, if that was said beforehand. ``clock`` is
    "thread", the processor's time of the thread, or "wall". ``agreed`` is the share of the other code's answers that
    were found to agree before they were timed: 1, but for searches that may fail.
    """

    benchmark: str
    size: int
    code: str
    against: str
    unit: str
    seconds: float
    seconds_against: float
    per_unit: float
    per_unit_against: float
    ratio: float
    ratio_low: float
    ratio_high: float
    bar: float | None
    repetitions: int
    timed: int
    timed_against: int
    clock: str
    agreed: float

    def met(self) -> bool | None:
        """Whether the bar is met; None without a bar."""
        return None if self.bar is None else self.ratio <= self.bar

    def __str__(self) -> str:
        bar = "" if self.bar is None else f", bar {self.bar:g}: {'met' if self.met() else 'not met'}"
        span = f"{self.ratio_low:.3g} to {self.ratio_high:.3g}"
        return (
            f"{self.benchmark} ({self.size}): {self.code} {_time(self.per_unit)}, {self.against}"
            f" {_time(self.per_unit_against)} per {self.unit}; ratio {self.ratio:.3g} ({span}){bar}"
        )


def timed(work: Callable[[], object], at_least: float = 0.0, clock: Callable[[], float] = time.thread_time) -> Timing:
    """Time a call: the mean of as many in a row as take ``at_least`` [s], the number found when it is first timed."""
    calls = 1

    def timing() -> float:
        nonlocal calls
        while True:
            start = clock()
            for _ in range(calls):
                work()
            taken = clock() - start
            if taken >= 0.5 * at_least:  # a number once found is kept, unless a run is far too short
                return taken / calls
            calls = max(2 * calls, min(100 * calls, int(calls * at_least / max(taken, 1e-9))))

    return timing


def interleaved(timings: Mapping[str, Timing], repetitions: int) -> dict[str, list[float]]:
    """Run the timings in turn, again and again; the first round only warms up."""
    times: dict[str, list[float]] = {name: [] for name in timings}
    for repetition in range(repetitions + 1):
        for name, timing in timings.items():
            taken = timing()
            if repetition:
                times[name].append(taken)
    return times


def paired_ratio(times: Sequence[float], times_against: Sequence[float]) -> tuple[float, float, float]:
    """Median, least and largest ratio of the times that were taken side by side."""
    ratios = [a / b for a, b in zip(times, times_against, strict=True)]
    return statistics.median(ratios), min(ratios), max(ratios)


def compared(
    benchmark: str,
    size: int,
    unit: str,
    times: Mapping[str, Sequence[float]],
    pairs: Mapping[tuple[str, str], float | None],
    *,
    units: int | None = None,
    timed: Mapping[str, int] | None = None,
    clock: str = "thread",
    agreed: Mapping[str, float] | None = None,
) -> list[Row]:
    """One row for each of the ``pairs`` (code, against), with its bar, from ``times`` [s] by code.

    ``units`` are in ``size`` (as many, unless said). ``timed`` gives the codes that were timed on less than ``size``,
    ``agreed`` those of whose answers not all agree.
    """
    units = size if units is None else units
    timed = {code: size for code in times} | dict(timed or {})
    whole = {code: [value * size / timed[code] for value in values] for code, values in times.items()}
    rows = []
    for (code, against), bar in pairs.items():
        middle = [statistics.median(whole[name]) for name in (code, against)]
        ratios = paired_ratio(whole[code], whole[against])
        rows.append(
            Row(benchmark, size, code, against, unit, *middle, *(value / units for value in middle), *ratios, bar,
                len(whole[code]), timed[code], timed[against], clock, (agreed or {}).get(against, 1.0))
        )  # fmt: skip
    return rows


def installed(*modules: str) -> bool:
    """Whether the packages are there; says which is not."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    for name in missing:
        print(f"left out: {name} is not installed", file=sys.stderr)
    return not missing


def table(rows: Sequence[Row]) -> str:
    """Rows as comma-separated text; six digits of a time are more than it has."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(field.name for field in dataclasses.fields(Row))
    for row in rows:
        values = dataclasses.astuple(row)
        writer.writerow(f"{value:.6g}" if isinstance(value, float) else value for value in values)
    return stream.getvalue()


def alone(measure: Callable[[bool], Sequence[Row]]) -> None:
    """Run one benchmark by itself and print its rows; with ``--quick`` with few repetitions."""
    for row in measure("--quick" in sys.argv[1:]):
        print(row)


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"
