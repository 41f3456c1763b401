"""Studies: many independent runs, in parallel and resumable, in one tidy table.

A study is a function and the arguments it is to be called with. ``run`` calls it on every processor, keeps each result
in a journal as soon as it is there, and returns one row per call. Killed and started again, it goes on from there.
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
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hexakin.exceptions import HexakinError, InvalidInputError, MissingPackageError, SimulationError, StudyError
from hexakin.study.journal import KEPT, Journal, alone, set_aside, write_whole
from hexakin.study.provenance import Trial, machine, provenance
from hexakin.study.tables import RESERVED, Scalar, read_table, table_text

try:
    import joblib
    import pandas as pd
    from joblib.externals import loky
    from tqdm import tqdm
except ImportError as error:
    raise MissingPackageError(str(error.name), "a study", 'pip install "hexakin"') from error


@dataclass(frozen=True)
class Study:
    """A function and the arguments of its calls.

    Raises InvalidInputError for a run whose names differ from the first's or are the table's own, or whose values are
    not plain.

    Parameters
    ----------
    name
        Names the result files.
    trial
        Called with each run's arguments by keyword; returns the measured values by name (numbers, strings, None), the
        same names every time. It must be importable or picklable, and depend on nothing but its arguments.
        A SimulationError that it raises is a result: the row's ``status`` says it, its values are missing.
    runs
        Arguments of each call: mappings with the same names, of plain values (finite numbers, strings, booleans, None).
        Equal ones are called once; 1 and 1.0 are equal.
    """

    name: str
    trial: Trial
    runs: tuple[Mapping[str, Scalar], ...]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.replace("_", "").replace("-", "").isalnum():
            raise InvalidInputError(f"study: name {self.name!r}, expected letters, digits, '_' and '-'")
        here = f"study {self.name}"
        if not (inspect.isfunction(self.trial) or inspect.ismethod(self.trial)):
            raise InvalidInputError(f"{here}: trial {self.trial!r:.80} is not a function; fixed arguments go into runs")
        unique: dict[str, Mapping[str, Scalar]] = {}
        for number, arguments in enumerate(self.runs, start=1):
            if not isinstance(arguments, Mapping):
                raise InvalidInputError(f"{here}: run {number}: {arguments!r:.80} is not a mapping of names to values")
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


def grid(**levels: Iterable[Scalar] | Scalar) -> list[dict[str, Scalar]]:
    """Every combination of the levels of each argument, the last changing fastest; a single value is one level."""
    lists = [[v] if isinstance(v, str) or not isinstance(v, Iterable) else list(v) for v in levels.values()]
    return [dict(zip(levels, values, strict=True)) for values in itertools.product(*lists)]


def run(
    study: Study,
    folder: str | os.PathLike[str] = "results",
    *,
    jobs: int | None = None,
    progress: bool = True,
    restart: bool = False,
) -> pd.DataFrame:
    """Make the runs that are not in ``folder`` yet and return the table of all of them.

    The table has one row per run, in the order of ``study.runs``: its arguments, ``status`` ("ok" or the error's text),
    what the trial returned, and ``wall_time`` [s]. ``folder``, made if it is missing, gets ``<name>.journal``, one line
    for each finished run; and, when all are, ``<name>.csv``, the table, and ``<name>.json``, which says what made it:
    the call, versions, code and machines.

    ``jobs`` are processes, by default one for each core. Inside ``joblib.parallel_config``, say of "dask", the runs go
    where it says. ``progress`` shows how far it is, with the remaining time, on stderr. An interrupted study
    goes on when it is called again; nothing that was finished is lost or made again. Results of other code
    or package versions are not mixed: ``restart`` sets them aside and begins anew.

    Raises StudyError if the folder holds results of other code or another function, if another process is writing them,
    if the disk is full, if a worker dies, or if a run fails by anything but SimulationError; each names what is at
    fault.
    """
    if jobs == 0:
        raise InvalidInputError("jobs: 0, expected how many processes (or None: one for each core)")
    path = Path(folder) / study.name
    journal_path, csv_path, json_path = (path.with_suffix(suffix) for suffix in (".journal", ".csv", ".json"))
    made_by = provenance(study.trial)
    with alone(journal_path):
        if restart:
            set_aside([csv_path, json_path, journal_path])
        with Journal(journal_path) as journal:
            if journal.dropped and progress:
                print(f"{journal_path}: {journal.dropped} damaged or half-written line(s) dropped", file=sys.stderr)
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


def fault(error: BaseException) -> str:
    """An error's kind, its text and where it came from, if that is neither here nor in Python's import."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    here = last.filename == __file__ or last.filename.startswith("<frozen")
    where = "" if here else f" ({Path(last.filename).name}, line {last.lineno})"
    return f"{type(error).__name__}: {error}{where}"


def _make(
    study: Study,
    todo: Mapping[str, Mapping[str, Scalar]],
    done: dict[str, dict[str, Any]],
    journal: Journal,
    jobs: int | None,
    progress: bool,
) -> None:
    """Call the trial for what is to do; results go into the journal and into ``done`` as they come."""
    configured = joblib.parallel.get_active_backend()[1]
    n_jobs = jobs if jobs is not None else configured if configured is not None else -1
    names = next((set(result) for result in done.values() if result["status"] == "ok"), None)
    interval = 0.5 if sys.stderr.isatty() else 30.0
    bar = tqdm(
        desc=study.name, total=len(study), initial=len(study) - len(todo), unit="run", smoothing=0.02,
        mininterval=interval, maxinterval=interval, disable=not progress,
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
        # Runs are handed out in order: the workers had the first of those that are not done.
        had = [str(run) for key, run in todo.items() if key not in done][: joblib.effective_n_jobs(n_jobs)]
        said = f"study {study.name}: a worker process died, killed by the system (for want of memory?) or by a crash"
        raise StudyError(f"{said}; it was making one of: {'; '.join(had)}; {KEPT}") from error
    except HexakinError:
        raise
    except Exception as error:
        cause = str(error.__cause__ or "").strip('"\n ').splitlines()[-1:]
        raise StudyError(f"study {study.name}: the workers failed: {' '.join([fault(error), *cause])}") from error


@contextlib.contextmanager
def _results(trial: Trial, todo: Mapping[str, Mapping[str, Scalar]], n_jobs: int) -> Iterator[Iterator[Any]]:
    """What ``_attempt`` returns, in the order of completion; workers that are still busy at the end are stopped."""
    calls = (joblib.delayed(_attempt)(trial, key, arguments) for key, arguments in todo.items())
    results = None
    try:
        with contextlib.nullcontext() if n_jobs == 1 else _interrupted_later():
            results = joblib.Parallel(
                n_jobs,
                return_as="generator_unordered",
                batch_size=1,  # in a larger one results would wait for each other, and the study may be killed
                initializer=_end_with,
                initargs=(os.getpid(), provenance(trial)["code"]),
            )(calls)
        yield results
    finally:
        with warnings.catch_warnings():  # joblib's, of results that nobody waits for
            warnings.simplefilter("ignore")
            if results is not None:
                results.close()


@contextlib.contextmanager
def _interrupted_later() -> Iterator[None]:
    """Let Ctrl-C wait, and never reach the processes started meanwhile: it is for this one, which stops them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    for tracker in (multiprocessing.resource_tracker, loky.backend.resource_tracker):
        tracker.ensure_running()  # starting it later would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attempt(trial: Trial, key: str, arguments: Mapping[str, Scalar]) -> tuple[str, dict[str, Any] | None, str | None]:
    """One call, in a worker: the run's key, its result, and what is wrong with it if it cannot be one."""
    start = time.perf_counter()
    try:
        measured, status = _measured(trial(**arguments), arguments), "ok"
    except SimulationError as error:
        measured, status = {}, f"{type(error).__name__}: {error}"
    except (Exception, SystemExit) as error:
        return key, None, fault(error)
    return key, {"status": status, **measured, "wall_time": round(time.perf_counter() - start, 3)}, None


def _measured(returned: Any, arguments: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """What a trial returned, in plain values."""
    if not isinstance(returned, Mapping):
        raise InvalidInputError(f"the trial returned {returned!r:.80}, expected a mapping of names to values")
    if odd := [name for name in returned if not isinstance(name, str)]:
        raise InvalidInputError(f"the trial returned {odd[0]!r:.80} as a name, expected a string")
    if clash := sorted({*arguments, *RESERVED} & set(returned)):
        raise InvalidInputError(f"the trial returned {', '.join(clash)}, which the table has already")
    return {name: _plain(f"the trial returned {name}", value, finite=False) for name, value in returned.items()}


def _end_with(runner: int, code: str) -> None:
    """In a worker process: end when the one that started it is gone, which may be killed and then cannot stop it.

    joblib starts new workers when an argument differs from the last time: those that imported other code are not used.
    """

    def watch() -> None:
        while os.getppid() == runner:
            time.sleep(0.5)
        os._exit(1)

    if os.getpid() != runner:
        threading.Thread(target=watch, daemon=True).start()


def _finished(journal: Journal, made_by: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Results in a journal by their run's key; StudyError if they were made by something else."""
    advice = "name another folder, or set these aside with restart=True (--restart)"
    made = [record["made_by"] for record in journal.records if "made_by" in record]
    for then in made:
        for what in ("trial", "code", "versions"):
            if then[what] != made_by[what]:
                difference = _difference(then[what], made_by[what])
                raise StudyError(f"{journal.path}: made by {what} {difference}; results are not mixed: {advice}")
    results = {_key(record["run"]): record["result"] for record in journal.records if "run" in record}
    if results and not made:
        raise StudyError(f"{journal.path}: the line that says what made these results is damaged: {advice}")
    return results


def _difference(then: Any, now: Any) -> str:
    if isinstance(then, dict):
        names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
        return ", ".join(f"{name} {then.get(name)} (now {now.get(name)})" for name in names)
    return f"{then} (now {now})"


def _key(arguments: Mapping[str, Scalar]) -> str:
    """The same text for equal arguments, whatever their order."""
    whole = {name: int(v) if isinstance(v, float) and v.is_integer() else v for name, v in arguments.items()}
    return json.dumps(whole, sort_keys=True)


def _plain(what: str, value: Any, *, finite: bool = True) -> Scalar:
    """A plain value, NumPy's numbers turned into Python's."""
    if hasattr(value, "item") and getattr(value, "shape", None) == ():
        value = value.item()
    if not isinstance(value, (bool, int, float, str, type(None))):
        raise InvalidInputError(f"{what}: {value!r:.80} is not a number, a string, a boolean or None")
    if finite and isinstance(value, float) and not math.isfinite(value):
        raise InvalidInputError(f"{what}: {value} is not finite")
    return value


def _call(study: Study) -> str:
    """The study's calls, with the levels of every argument."""
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
