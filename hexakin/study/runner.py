"""Studies: many independent runs in parallel with one table of results; they can be interrupted and continued.

A study is a function and the arguments of its calls. ``run`` makes the calls on all processor cores, writes each result
to a journal as soon as it is finished, and returns one row per call. If it is killed, the next call continues.
"""

from __future__ import annotations

import contextlib
import inspect
import itertools
import json
import math
import multiprocessing.resource_tracker
import os
import signal
import threading
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hexakin.checks import check_path, checked
from hexakin.exceptions import HexakinError, InvalidInputError, MissingPackageError, SimulationError, StudyError, shown
from hexakin.numerics.messages import messages
from hexakin.study.journal import KEPT, Journal, alone, set_aside, write_whole
from hexakin.study.provenance import Trial, machine, provenance
from hexakin.study.tables import RESERVED, Scalar, read_table, table_text

try:
    import joblib
    import pandas as pd
    from joblib.externals import loky
    from tqdm import tqdm
except ImportError as error:
    raise MissingPackageError(str(error.name), "a study", f"pip install {error.name}") from error


@checked
@dataclass(frozen=True)
class Study:
    """A function and the arguments of its calls.

    Raises InvalidInputError if the name or the trial is not valid or if there is no run. Also raises InvalidInputError
    for a run that has other argument names than the first run, an argument with the name of one of the table's own
    columns, or a value that is not plain.

    Parameters
    ----------
    name
        The study's name; the result files have this name.
    trial
        Function that is called with each run's arguments as keywords. It returns measured values by name (numbers,
        strings, None), with the same names in every call. It must be importable or picklable, and depend only on its
        arguments. A SimulationError that it raises is a result: the row's ``status`` has the error, and the values are
        missing.
    runs
        Arguments of each call: mappings with the same names, of plain values (finite numbers, strings, booleans, None).
        Equal runs are made only once; 1 and 1.0 are equal.
    """

    name: str
    trial: Trial
    runs: tuple[Mapping[str, Any], ...]

    def __post_init__(self) -> None:
        if not self.name.replace("_", "").replace("-", "").isalnum():
            raise InvalidInputError(f"study: name {self.name!r}, expected letters, digits, '_' and '-'")
        here = f"study {self.name}"
        if not (inspect.isfunction(self.trial) or inspect.ismethod(self.trial)):
            raise InvalidInputError(
                f"{here}: trial {shown(self.trial)} is not a function; fixed arguments go into runs"
            )
        unique: dict[str, Mapping[str, Scalar]] = {}
        for number, arguments in enumerate(self.runs, start=1):
            plain = {name: _plain(f"{here}: run {number}: {name}", value) for name, value in arguments.items()}
            first = next(iter(unique.values()), plain)
            if odd := set(plain) ^ set(first):
                raise InvalidInputError(f"{here}: run {number} and the first differ in: {', '.join(sorted(odd))}")
            unique.setdefault(_key(plain), plain)
        if not unique:
            raise InvalidInputError(f"{here}: no runs")
        if taken := set(RESERVED) & set(first):
            raise InvalidInputError(f"{here}: argument {', '.join(sorted(taken))}: the table has a column of that name")
        object.__setattr__(self, "runs", tuple(unique.values()))

    def __len__(self) -> int:
        return len(self.runs)

    def __repr__(self) -> str:
        return f"Study({self.name!r}, {len(self)} runs of {self.trial.__module__}.{self.trial.__qualname__})"


@checked
def grid(**levels: Iterable[Scalar] | Scalar) -> list[dict[str, Scalar]]:
    """Return all combinations of the ``levels`` of the arguments; the last changes fastest, one value is one level."""
    lists = [[v] if isinstance(v, str) or not isinstance(v, Iterable) else list(v) for v in levels.values()]
    return [dict(zip(levels, values, strict=True)) for values in itertools.product(*lists)]


@checked
def run(
    study: Study,
    folder: str | os.PathLike[str] = "results",
    *,
    jobs: int | None = None,
    progress: bool = True,
    restart: bool = False,
) -> pd.DataFrame:
    """Make all runs of ``study`` that are missing in ``folder``, and return the table of all runs.

    The table has one row per run, in the order of ``study.runs``: its arguments, ``status`` ("ok" or the error's text),
    the values that the trial returned, and ``wall_time`` [s].

    An interrupted study continues when it is called again; finished runs are neither lost nor repeated. Results of
    different code or package versions are never mixed.

    Raises StudyError if the folder has results of other code or another function, if another process is writing them,
    if the disk is full, if a worker process dies, or if a run fails with another error than SimulationError; the
    message names the cause. Raises InvalidInputError for ``jobs`` = 0, or if ``folder`` is no path.

    Parameters
    ----------
    study
        The function and the arguments of its calls.
    folder
        Folder of the results; it is created if missing. Each finished run is a line of ``<name>.journal``. At the end
        the table is written to ``<name>.csv``, and its origin (call, versions, code and machines) to ``<name>.json``.
    jobs
        Number of processes; None is one per core. Inside ``joblib.parallel_config`` (for example with "dask") the runs
        are made by the backend configured there.
    progress
        Whether to show progress and remaining time on stderr.
    restart
        Whether to rename earlier results and start again.
    """
    if jobs == 0:
        raise InvalidInputError("jobs: 0, expected how many processes (or None: one for each core)")
    path = check_path("folder", folder) / study.name
    journal_path, csv_path, json_path = (path.with_suffix(suffix) for suffix in (".journal", ".csv", ".json"))
    made_by = provenance(study.trial)
    with alone(journal_path):
        if restart:
            set_aside([csv_path, json_path, journal_path])
        with Journal(journal_path) as journal:
            if journal.dropped and progress:
                print(f"{journal_path}: {journal.dropped} damaged or incomplete line(s) dropped", file=messages)
            done = _finished(journal, made_by)
            wanted = {_key(arguments): arguments for arguments in study.runs}
            todo = {key: arguments for key, arguments in wanted.items() if key not in done}
            if todo:
                here = {"made_by": {**made_by, "machine": machine()}}
                if here not in journal.records:
                    journal.append(here)
                _make(study, todo, done, journal, jobs, progress)
            made = [record["made_by"] for record in journal.records if "made_by" in record]
        rows = [{**arguments, **done[key]} for key, arguments in wanted.items()]
        about = {"study": study.name, "runs": len(rows), "call": _call(study), **made_by}
        about["machines"] = [one["machine"] for one in made if "machine" in one]
        write_whole(csv_path, table_text(rows).encode())
        write_whole(json_path, json.dumps(about, indent=1).encode() + b"\n")
    return read_table(csv_path)


@checked
def fault(error: BaseException) -> str:
    """Return the class, the text and the origin (file and line) of ``error`` in one line.

    The origin is left out if it is this module or Python's import system, or if the error was never raised.
    """
    last = (traceback.extract_tb(error.__traceback__) or [None])[-1]
    here = last is None or last.filename == __file__ or last.filename.startswith("<frozen")
    where = "" if last is None or here else f" ({Path(last.filename).name}, line {last.lineno})"
    return f"{type(error).__name__}: {error}{where}"


def _make(
    study: Study,
    todo: Mapping[str, Mapping[str, Scalar]],
    done: dict[str, dict[str, Any]],
    journal: Journal,
    jobs: int | None,
    progress: bool,
) -> None:
    """Call the trial for all runs in ``todo``; each result is written to the journal and to ``done`` at once."""
    configured = joblib.parallel.get_active_backend()[1]
    n_jobs = jobs if jobs is not None else configured if configured is not None else -1
    n_jobs = min(n_jobs, max(len(todo), 2))  # more processes than runs would start for nothing
    names = next((set(result) for result in done.values() if result["status"] == "ok"), None)
    interval = 0.5 if messages.isatty() else 30.0
    bar = tqdm(
        desc=study.name, total=len(study), initial=len(study) - len(todo), unit="run", smoothing=0.02,
        mininterval=interval, maxinterval=interval, file=messages, disable=not progress,
    )  # fmt: skip
    try:
        with bar, _results(study.trial, todo, n_jobs) as results:
            for key, outcome, wrong in results:
                if wrong is None and outcome["status"] == "ok":
                    names = names or set(outcome)
                    if odd := sorted(names ^ set(outcome)):
                        wrong = f"the trial returned other names than in an earlier run: {', '.join(odd)}"
                if wrong is not None:
                    raise StudyError(f"study {study.name}: run {todo[key]}: {wrong}")
                journal.append({"run": todo[key], "result": outcome})
                done[key] = outcome
                bar.update()
    except loky.process_executor.TerminatedWorkerError as error:
        # Runs are given to workers in order, so the workers had the first of the unfinished runs.
        had = [str(run) for key, run in todo.items() if key not in done][: joblib.effective_n_jobs(n_jobs)]
        message = f"study {study.name}: a worker process died: it crashed, or the system killed it (too little memory?)"
        raise StudyError(f"{message}; it had one of the runs: {'; '.join(had)}; {KEPT}") from error
    except HexakinError:
        raise
    except Exception as error:
        cause = str(error.__cause__ or "").strip('"\n ').splitlines()[-1:]
        raise StudyError(f"study {study.name}: the workers failed: {' '.join([fault(error), *cause])}") from error


@contextlib.contextmanager
def _results(trial: Trial, todo: Mapping[str, Mapping[str, Scalar]], n_jobs: int) -> Iterator[Iterator[Any]]:
    """Yield what ``_attempt`` returns, in the order of completion; stop workers that are still busy at the end."""
    calls = (joblib.delayed(_attempt)(trial, key, arguments) for key, arguments in todo.items())
    results = None
    try:
        with contextlib.nullcontext() if n_jobs == 1 else _interrupted_later():
            results = joblib.Parallel(
                n_jobs,
                return_as="generator_unordered",
                batch_size=1,  # in a larger batch, finished results would wait and could be lost
                initializer=_end_with,
                initargs=(os.getpid(), provenance(trial)["code"]),
            )(calls)
        yield results
    finally:
        with warnings.catch_warnings():  # joblib warns about results that are not used
            warnings.simplefilter("ignore")
            if results is not None:
                results.close()


@contextlib.contextmanager
def _interrupted_later() -> Iterator[None]:
    """Delay Ctrl-C, and block it in processes that are started meanwhile, because this process stops them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    for tracker in (multiprocessing.resource_tracker, loky.backend.resource_tracker):
        tracker.ensure_running()  # if it started later, it would enable Ctrl-C again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attempt(trial: Trial, key: str, arguments: Mapping[str, Scalar]) -> tuple[str, dict[str, Any] | None, str | None]:
    """Make one call, in a worker; return the run's key, its result, and the fault or None.

    With a fault there is no result.
    """
    start = time.perf_counter()
    try:
        measured, status = _measured(trial(**arguments), arguments), "ok"
    except SimulationError as error:
        measured, status = {}, f"{type(error).__name__}: {error}"
    except (Exception, SystemExit) as error:
        return key, None, fault(error)
    return key, {"status": status, **measured, "wall_time": round(time.perf_counter() - start, 3)}, None


def _measured(returned: Any, arguments: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Return the values that a trial returned, as plain values."""
    if not isinstance(returned, Mapping):
        raise InvalidInputError(f"the trial returned {shown(returned)}, expected a mapping of names to values")
    if odd := [name for name in returned if not isinstance(name, str)]:
        raise InvalidInputError(f"the trial returned {shown(odd[0])} as a name, expected a string")
    if clash := sorted({*arguments, *RESERVED} & set(returned)):
        raise InvalidInputError(f"the trial returned {', '.join(clash)}: the table already has such a column")
    return {name: _plain(f"the trial returned {name}", value, finite=False) for name, value in returned.items()}


def _end_with(runner: int, code: str) -> None:
    """In a worker process: end when the process ``runner`` has ended, because a killed runner cannot stop its workers.

    joblib starts new workers when an argument of this function changes. With ``code`` as an argument, workers that
    imported other code are therefore not used again.
    """

    def watch() -> None:
        while os.getppid() == runner:
            time.sleep(0.5)
        os._exit(1)

    if os.getpid() != runner:
        threading.Thread(target=watch, daemon=True).start()


def _finished(journal: Journal, made_by: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the results in a journal by their run's key; raise StudyError if other code made them."""
    advice = "use another folder, or rename these with restart=True (--restart)"
    made = [record["made_by"] for record in journal.records if "made_by" in record]
    for then in made:
        for what in ("trial", "code", "versions"):
            if then[what] != made_by[what]:
                difference = _difference(then[what], made_by[what])
                raise StudyError(f"{journal.path}: made by {what} {difference}; results are not mixed: {advice}")
    results = {_key(record["run"]): record["result"] for record in journal.records if "run" in record}
    if results and not made:
        raise StudyError(f"{journal.path}: the line with the origin of these results is damaged: {advice}")
    return results


def _difference(then: Any, now: Any) -> str:
    if isinstance(then, dict):
        names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
        return ", ".join(f"{name} {then.get(name)} (now {now.get(name)})" for name in names)
    return f"{then} (now {now})"


def _key(arguments: Mapping[str, Scalar]) -> str:
    """Return a text that is the same for equal arguments in any order."""
    whole = {name: int(v) if isinstance(v, float) and v.is_integer() else v for name, v in arguments.items()}
    return json.dumps(whole, sort_keys=True)


def _plain(what: str, value: Any, *, finite: bool = True) -> Scalar:
    """Return ``value`` as a plain Python value; raise InvalidInputError if this is not possible."""
    if hasattr(value, "item") and getattr(value, "shape", None) == ():
        value = value.item()
    if not isinstance(value, (bool, int, float, str, type(None))):
        raise InvalidInputError(f"{what}: {shown(value)} is not a number, a string, a boolean or None")
    if finite and isinstance(value, float) and not math.isfinite(value):
        raise InvalidInputError(f"{what}: {value} is not finite")
    return value


def _call(study: Study) -> str:
    """Return a text of the study's calls, with the levels of every argument."""
    levels = {name: list({repr(run[name]): run[name] for run in study.runs}.values()) for name in study.runs[0]}
    fixed = [f"{name}={values[0]!r}" for name, values in levels.items() if len(values) == 1]
    varied = [f"{name} in {_shown(values)}" for name, values in levels.items() if len(values) > 1]
    every = "all" if len(study) == math.prod(map(len, levels.values())) else f"{len(study)}"
    over = f" for {every} combinations of {', '.join(varied)}" if varied else ""
    return f"{study.trial.__qualname__}({', '.join(fixed)}){over}"


def _shown(levels: list[Scalar]) -> str:
    numbers = [value for value in levels if isinstance(value, (int, float)) and not isinstance(value, bool)]
    if len(numbers) < len(levels) or len(levels) <= 2:
        return f"{levels}" if len(levels) <= 12 else f"{len(levels)} levels"
    numbers.sort()
    low, high = numbers[0], numbers[-1]
    if numbers == list(range(int(low), int(low) + len(numbers))):
        return f"{low}..{high}"
    return f"{numbers}" if len(numbers) <= 12 else f"{len(numbers)} levels from {low} to {high}"
