"""Studies: many independent runs, in parallel and resumable, in one tidy table.

A study is a function and the arguments it is to be called with. ``run`` calls it on every processor, keeps each result
in a journal as soon as it is there, and returns one row per call. Killed and started again, it goes on from there.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import itertools
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from hexakin import __version__
from hexakin.exceptions import HexakinError, InvalidInputError, MissingPackageError, SimulationError, StudyError
from hexakin.journal import Journal
from hexakin.robot_file import DATA

try:
    import joblib
    import pandas as pd
    from tqdm import tqdm
except ImportError as error:
    raise MissingPackageError(str(error.name), "a study", 'pip install "hexakin"') from error

Scalar = bool | int | float | str | None
Trial = Callable[..., Mapping[str, Any]]

PACKAGES = ("numpy", "scipy", "pin", "coal", "numba", "pybullet")
"""Packages that a result may depend on; their versions are kept with it."""

NOT_COMPARED = ("wall_time",)
"""Columns that differ between equal runs."""

# Rooms that only draw, judge or store: no run's result depends on them.
_BYSTANDERS = frozenset(
    ["__main__", "block_faces", "charts", "figure_style", "figures", "journal", "occlusion", "paper", "report"]
    + ["studies", "study", "verdicts", "verdict"]
)


@dataclass(frozen=True)
class Study:
    """A function and the arguments of its calls.

    Parameters
    ----------
    name:
        Names the result files.
    trial:
        Called with each run's arguments by keyword; returns the measured values by name (numbers, strings, None), the
        same names every time. It must be importable or picklable, and depend on nothing but its arguments.
        A SimulationError that it raises is a result: the row's ``status`` says it, its values are missing.
    runs:
        Arguments of each call: mappings with the same names, of plain values (numbers, strings, booleans, None). Equal
        ones are called once.

    Raises InvalidInputError for a run whose names differ from the first's or whose values are not plain.
    """

    name: str
    trial: Trial
    runs: tuple[Mapping[str, Scalar], ...]

    def __post_init__(self) -> None:
        if not self.name or not self.name.replace("_", "").replace("-", "").isalnum():
            raise InvalidInputError(f"study: name {self.name!r}, expected letters, digits, '_' and '-'")
        if not callable(self.trial):
            raise InvalidInputError(f"study {self.name}: trial {self.trial!r:.80} cannot be called")
        unique: dict[str, Mapping[str, Scalar]] = {}
        for number, arguments in enumerate(self.runs, start=1):
            plain = {name: _plain(f"study {self.name}: run {number}: {name}", v) for name, v in arguments.items()}
            unique.setdefault(_key(plain), plain)
        runs = tuple(unique.values())
        if not runs:
            raise InvalidInputError(f"study {self.name}: no runs")
        for number, arguments in enumerate(runs, start=1):
            if set(arguments) != set(runs[0]):
                odd = ", ".join(sorted(set(arguments) ^ set(runs[0])))
                raise InvalidInputError(f"study {self.name}: run {number} and the first differ in: {odd}")
        object.__setattr__(self, "runs", runs)

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
    what the trial returned, and ``wall_time`` [s]. ``folder`` gets ``<name>.journal``, one line for each
    finished run; and, when all are, ``<name>.csv``, the table, and ``<name>.json``, which says what made it: the call,
    versions, code and machine.

    ``jobs`` are processes, by default one for each core. Inside ``joblib.parallel_config("dask")``, or another backend,
    the runs go there. ``progress`` shows how far it is, with the remaining time, on stderr. An interrupted study
    goes on when it is called again; nothing that was finished is lost or made again. Results of other code
    or package versions are not mixed: ``restart`` sets them aside and begins anew.

    Raises StudyError if the folder holds results of other code or another function, if another process is writing them,
    if the disk is full, or if a run fails by anything but SimulationError; each names what is at fault.
    """
    path = Path(folder) / study.name
    if restart:
        _set_aside(path)
    made_by = provenance(study.trial)
    with Journal(path.with_suffix(".journal")) as journal:
        if journal.dropped and progress:
            print(f"{study.name}: {journal.dropped} half-written line dropped; its run is made again", file=sys.stderr)
        done = _finished(journal, made_by)
        wanted = {_key(arguments): arguments for arguments in study.runs}
        todo = {key: arguments for key, arguments in wanted.items() if key not in done}
        if todo:
            if not any("made_by" in record for record in journal.records):
                journal.append({"made_by": made_by})
            _make(study, todo, done, journal, jobs, progress)
        rows = [{**arguments, **done[key]} for key, arguments in wanted.items()]
        about = {"study": study.name, "runs": len(rows), "call": _call(study), **made_by, "machine": _machine()}
        write_whole(path.with_suffix(".csv"), pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"))
        write_whole(path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")
    return read_table(path.with_suffix(".csv"))


def read_table(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a table that ``run`` wrote. Raises StudyError if it is missing or not a study's table."""
    try:
        table = pd.read_csv(path, float_precision="round_trip", keep_default_na=False, na_values=[""])
    except FileNotFoundError as error:
        raise StudyError(f"{path}: no such file") from error
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: not readable as a study's table ({error})") from error
    if "status" not in table or "wall_time" not in table:
        raise StudyError(f"{path}: not a study's table: columns status and wall_time are missing")
    return table


def provenance(trial: Trial) -> dict[str, Any]:
    """Say what a result depends on beside its arguments: function, code and package versions.

    ``code`` is a digest of the trial, of hexakin's robots and of its sources, but for those that draw, judge and store.
    """
    package = Path(__file__).parent
    sources = sorted([*package.rglob("*.py"), *(DATA / "robots").glob("*.yaml")])
    sources = [source for source in sources if source.stem not in _BYSTANDERS]
    digest = hashlib.sha256()
    for source in sources:
        digest.update(source.name.encode() + source.read_bytes().replace(b"\r\n", b"\n"))
    with contextlib.suppress(OSError, TypeError):  # typed into an interpreter
        if not trial.__module__.startswith("hexakin."):
            digest.update(inspect.getsource(trial).encode())
    versions = {"python": platform.python_version(), "hexakin": __version__}
    for name in PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {
        "trial": f"{trial.__module__}:{trial.__qualname__}",
        "code": digest.hexdigest()[:12],
        "versions": versions,
    }


def write_whole(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with open(temporary, "w", encoding="utf-8", newline="") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise StudyError(f"{path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _make(
    study: Study,
    todo: Mapping[str, Mapping[str, Scalar]],
    done: dict[str, dict[str, Any]],
    journal: Journal,
    jobs: int | None,
    progress: bool,
) -> None:
    """Call the trial for what is to do; results go into the journal and into ``done`` as they come."""
    calls = (joblib.delayed(_attempt)(study.trial, key, arguments) for key, arguments in todo.items())
    # One result after another in whatever order: none waits in a batch for others while the study may be killed.
    with _processors(jobs) as options:
        results = joblib.Parallel(return_as="generator_unordered", batch_size=1, **options)(calls)
        bar = tqdm(
            results, study.name, total=len(study), initial=len(study) - len(todo), unit="run", smoothing=0.02,
            mininterval=0.5 if sys.stderr.isatty() else 30.0, disable=not progress,
        )  # fmt: skip
        with contextlib.closing(results), bar:
            for key, outcome, fault in bar:
                if fault is not None:
                    raise StudyError(f"study {study.name}: run {todo[key]}: {fault}")
                journal.append({"run": todo[key], "result": outcome})
                done[key] = outcome


@contextlib.contextmanager
def _processors(jobs: int | None) -> Iterator[dict[str, Any]]:
    """Options for joblib: what the caller configured, or all cores."""
    backend, configured = joblib.parallel.get_active_backend()
    elsewhere = type(backend).__name__ != "LokyBackend" or configured not in (None, 1)
    if jobs is not None:
        yield {"n_jobs": jobs}
    elif elsewhere:
        yield {}
    else:
        yield {"n_jobs": -1}


def _attempt(trial: Trial, key: str, arguments: Mapping[str, Scalar]) -> tuple[str, dict[str, Any] | None, str | None]:
    """One call, in a worker: the run's key, its result, and what is wrong with it if it cannot be one."""
    start = time.perf_counter()
    try:
        measured = dict(trial(**arguments))
        status = "ok"
        clash = sorted({*arguments, "status", "wall_time"} & set(measured))
        if clash:
            return key, None, f"the trial returned {', '.join(clash)}, which the table has already"
        measured = {name: _plain(name, value, finite=False) for name, value in measured.items()}
    except SimulationError as error:
        measured, status = {}, f"{type(error).__name__}: {error}"
    except HexakinError as error:
        return key, None, f"{type(error).__name__}: {error}"
    except Exception as error:
        frame = inspect.trace()[-1]
        return key, None, f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})"
    return key, {"status": status, **measured, "wall_time": round(time.perf_counter() - start, 3)}, None


def _finished(journal: Journal, made_by: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Results in a journal by their run's key; StudyError if they were made by something else."""
    for record in journal.records:
        then = record.get("made_by", made_by)
        for what in ("trial", "code", "versions"):
            if then[what] != made_by[what]:
                raise StudyError(
                    f"{journal.path}: made by {what} {_difference(then[what], made_by[what])}; results are not mixed: "
                    "name another folder, or set these aside with restart=True (--restart)"
                )
    return {_key(record["run"]): record["result"] for record in journal.records if "run" in record}


def _difference(then: Any, now: Any) -> str:
    if isinstance(then, dict):
        names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
        return ", ".join(f"{name} {then.get(name)} (now {now.get(name)})" for name in names)
    return f"{then} (now {now})"


def _set_aside(path: Path) -> None:
    """Rename a study's files, so that none is lost."""
    for suffix in (".journal", ".csv", ".json"):
        old = path.with_suffix(suffix)
        if old.exists():
            number = next(k for k in itertools.count(1) if not old.with_name(f"{old.name}.{k}.old").exists())
            os.replace(old, old.with_name(f"{old.name}.{number}.old"))


def _key(arguments: Mapping[str, Scalar]) -> str:
    return json.dumps(arguments, sort_keys=True)


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
    levels = {name: sorted({run[name] for run in study.runs}, key=repr) for name in study.runs[0]}
    shown = [f"{name}={values[0]!r}" for name, values in levels.items() if len(values) == 1]
    varied = [f"{name} ({len(values)} levels)" for name, values in levels.items() if len(values) > 1]
    return f"{study.trial.__qualname__}({', '.join(shown)}) over {', '.join(varied)}"


def _machine() -> dict[str, Any]:
    machine = {"platform": f"{platform.system()} {platform.machine()}", "cores": os.cpu_count()}
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        head, here = ["git", "rev-parse", "HEAD"], Path(__file__).parent
        done = subprocess.run(head, cwd=here, capture_output=True, text=True, check=True, timeout=5)
        machine["commit"] = done.stdout.strip()
    return machine
