"""All benchmarks in one run, and their results as files.

    python tests/benchmarks [--quick] [--only NAME ...] [--folder FOLDER]

``make benchmarks`` installs the libraries that hexakin is compared with (``peers.txt``) and runs all benchmarks.
Results are compared first, then times are measured in turn. The files ``speed.csv`` (the rows of ``comparison.Row``)
and ``speed.json`` (date, machine and versions) are written into ``data/results`` at the end. Libraries that are not
installed are listed, and their rows are missing. With ``--quick`` there are few repetitions, which is noted in
``speed.json``. With ``--only``, files are written only if a ``--folder`` is given.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import hashlib
import importlib
import json
import os
import platform
import shutil
import subprocess
import sys
import warnings
from importlib import metadata
from pathlib import Path

from comparison import Row, table

from hexakin.installation import __version__
from hexakin.study.journal import write_whole
from hexakin.study.provenance import machine

BENCHMARKS = (
    "kinematics", "derivation", "rigid_engine", "import_time", "plan_walk", "feasibility_check", "study_workers",
)  # fmt: skip
PEERS = ("roboticstoolbox-python", "ikpy", "pin", "casadi", "pybullet", "mujoco")
PACKAGES = ("numpy", "scipy", "sympy", "numba", "llvmlite", "joblib", "pandas", "coal", "spatialmath-python")
ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Run the chosen benchmarks, print their rows and write the files."""
    options = argparse.ArgumentParser(prog="python tests/benchmarks", description=__doc__.split("\n")[0])
    options.add_argument("--only", nargs="+", choices=BENCHMARKS, metavar="NAME", help=", ".join(BENCHMARKS))
    options.add_argument("--quick", action="store_true", help="few repetitions")
    options.add_argument("--folder", type=Path, help="where speed.csv and speed.json go (default: data/results)")
    given = options.parse_args()
    chosen = [name for name in BENCHMARKS if name in (given.only or BENCHMARKS)]
    folder = given.folder or (None if given.only else ROOT / "data" / "results")
    about = conditions(chosen, given.quick)
    for name in about["left_out"]:
        print(f"left out: {name} is not installed")
    # Warnings of other libraries are hidden; hexakin's own warnings are errors in its tests.
    warnings.simplefilter("ignore")
    rows: list[Row] = []
    for name in chosen:
        print(f"-- {name}", flush=True)
        found = importlib.import_module(name).measure(given.quick)
        print(*found, sep="\n", flush=True)
        rows += found
    bars = [row.met() for row in rows if row.bar is not None]
    print(f"{len(rows)} rows; {sum(bars)} of {len(bars)} bars are met")
    if folder is not None:
        written(folder, rows, about)


def conditions(chosen: list[str], quick: bool) -> dict:
    """Return date, machine, load before the first benchmark, versions, and libraries that are not installed."""
    versions = {"python": platform.python_version(), "hexakin": __version__}
    missing = []
    for name in (*PACKAGES, *PEERS):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            if name in PEERS:
                missing.append(name)
    compiler = None
    if shutil.which("cc"):
        compiler = subprocess.run(["cc", "--version"], capture_output=True, text=True).stdout.split("\n")[0]
    else:
        missing.append("cc (CasADi's compiled C)")
    load = [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else None
    return {
        "made_by": "python tests/benchmarks" + (" --quick" if quick else ""),
        "benchmarks": chosen,
        "quick": quick,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": machine() | {"cpu": processor(), "compiler": compiler},
        "load_average": load,
        # The benchmarks have not started yet, so that an idle machine has a load near 0.
        "loaded": None if load is None else load[0] > 0.2 * (os.cpu_count() or 1),
        "versions": versions,
        "left_out": missing,
    }


def processor() -> str:
    """Return the name of the processor, if the system gives it."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    if sys.platform == "darwin":
        call = ["sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(call, capture_output=True, text=True).stdout.strip()
    return platform.processor()


def written(folder: Path, rows: list[Row], about: dict) -> None:
    """Write both files. The second contains the digest of the first, so that files of two runs cannot be mixed."""
    folder.mkdir(parents=True, exist_ok=True)
    text = table(rows).encode()
    about = about | {"rows": len(rows), "sha256": hashlib.sha256(text).hexdigest()}
    write_whole(folder / "speed.csv", text)
    write_whole(folder / "speed.json", (json.dumps(about, indent=1) + "\n").encode())
    print(f"written: {folder / 'speed.csv'}, speed.json")


if __name__ == "__main__":
    main()
