"""Comparison of two pieces of code: both run in turn, and each ratio is that of two times measured one after the other.

The speed of a machine changes with time and with other work. Both times of a pair change by the same factor, which
cancels in their ratio. A row contains the median and the range of these ratios, and the medians of the times.
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
"""Function that runs some code and returns the time it took [s]."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """The times of one code and of another code that does the same work.

    ``seconds`` and ``seconds_against`` are medians for the whole ``size``, ``per_unit`` and ``per_unit_against`` for
    one ``unit``, all [s]. A slow code is timed for the smaller size ``timed``, and its time is scaled to ``size``.
    ``ratio`` is the median of the ratios time of ``code`` / time of ``against`` in pairs of consecutive runs;
    ``ratio_low`` and ``ratio_high`` are the smallest and the largest ratio. ``bar`` is the largest acceptable ratio, if
    one was set before the measurement. ``clock`` is "thread" (processor time of the thread) or "wall". ``agreed`` is
    the share of results of ``against`` that agreed in the comparison before: 1, except for searches that may fail.
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
        """Return whether the bar is met; None without a bar."""
        return None if self.bar is None else self.ratio <= self.bar

    def __str__(self) -> str:
        bar = "" if self.bar is None else f", bar {self.bar:g}: {'met' if self.met() else 'not met'}"
        span = f"{self.ratio_low:.3g} to {self.ratio_high:.3g}"
        return (
            f"{self.benchmark} ({self.size}): {self.code} {_time(self.per_unit)}, {self.against}"
            f" {_time(self.per_unit_against)} per {self.unit}; ratio {self.ratio:.3g} ({span}){bar}"
        )


def timed(work: Callable[[], object], at_least: float = 0.0, clock: Callable[[], float] = time.thread_time) -> Timing:
    """Return a timing of a call: the mean over as many calls as take ``at_least`` [s], a number found at first use."""
    calls = 1

    def timing() -> float:
        nonlocal calls
        while True:
            start = clock()
            for _ in range(calls):
                work()
            taken = clock() - start
            if taken >= 0.5 * at_least:  # the number of calls is kept, unless a run is much too short
                return taken / calls
            calls = max(2 * calls, min(100 * calls, int(calls * at_least / max(taken, 1e-9))))

    return timing


def interleaved(timings: Mapping[str, Timing], repetitions: int) -> dict[str, list[float]]:
    """Run all timings in turn, ``repetitions`` times, after one round that does not count."""
    times: dict[str, list[float]] = {name: [] for name in timings}
    for repetition in range(repetitions + 1):
        for name, timing in timings.items():
            taken = timing()
            if repetition:
                times[name].append(taken)
    return times


def paired_ratio(times: Sequence[float], times_against: Sequence[float]) -> tuple[float, float, float]:
    """Return the median, smallest and largest ratio of times measured one after the other."""
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
    """Return one row for each of the ``pairs`` (code, against), whose values are the bars, from ``times`` [s] by code.

    ``units`` is the number of units in ``size``; None means ``size``. ``timed`` has the sizes of the codes that were
    timed for less than ``size``, ``agreed`` the shares of the codes whose results do not all agree.
    """
    units = size if units is None else units
    timed = {code: size for code in times} | dict(timed or {})
    whole = {code: [value * size / timed[code] for value in values] for code, values in times.items()}
    rows = []
    for (code, against), bar in pairs.items():
        middle = [statistics.median(whole[name]) for name in (code, against)]
        ratios = paired_ratio(whole[code], whole[against])
        rows.append(
            Row(
                benchmark=benchmark, size=size, code=code, against=against, unit=unit,
                seconds=middle[0], seconds_against=middle[1],
                per_unit=middle[0] / units, per_unit_against=middle[1] / units,
                ratio=ratios[0], ratio_low=ratios[1], ratio_high=ratios[2], bar=bar,
                repetitions=len(whole[code]), timed=timed[code], timed_against=timed[against], clock=clock,
                agreed=(agreed or {}).get(against, 1.0),
            )
        )  # fmt: skip
    return rows


def installed(*modules: str) -> bool:
    """Return whether all packages are installed, and print those that are not."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    for name in missing:
        print(f"left out: {name} is not installed", file=sys.stderr)
    return not missing


def table(rows: Sequence[Row]) -> str:
    """Return the rows as comma-separated text, with six digits, more than the accuracy of a time."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(field.name for field in dataclasses.fields(Row))
    for row in rows:
        values = dataclasses.astuple(row)
        writer.writerow(f"{value:.6g}" if isinstance(value, float) else value for value in values)
    return stream.getvalue()


def alone(measure: Callable[[bool], Sequence[Row]]) -> None:
    """Run one benchmark and print its rows; ``--quick`` makes few repetitions."""
    for row in measure("--quick" in sys.argv[1:]):
        print(row)


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"
