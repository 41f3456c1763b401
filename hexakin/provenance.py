"""What made a result: the function, a digest of the code, package versions and the machine."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import platform
import subprocess
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from hexakin import __version__
from hexakin.robot_file import DATA
from hexakin.tables import Scalar

Trial = Callable[..., Mapping[str, Any]]

PACKAGES = ("numpy", "scipy", "pin", "coal", "numba", "pybullet")
"""Packages that a result may depend on; their versions are kept with it."""

# Rooms that only draw, judge or store: no run's result depends on them.
_BYSTANDERS = frozenset(
    ["__main__", "block_faces", "charts", "figure_style", "figures", "journal", "occlusion", "paper", "report"]
    + ["report_figures", "report_index", "report_page", "robot_page", "robot_summary"]
    + ["factorial", "sensitivity", "__init__", "provenance", "studies", "study", "tables", "verdicts"]
)


def provenance(trial: Trial) -> dict[str, Any]:
    """Say what a result depends on beside its arguments: function, code and package versions.

    ``code`` is a digest of the trial, of hexakin's robots and of its sources, but for those that draw, judge and store.
    Of a trial outside hexakin it is the function alone, without others that it calls.
    """
    package = Path(__file__).parent
    sources = [*sorted((DATA / "robots").glob("*.yaml")), *sorted(package.rglob("*.py"))]
    digest = hashlib.sha256()
    for source in sources:
        if source.stem not in _BYSTANDERS:
            digest.update(source.name.encode() + source.read_bytes().replace(b"\r\n", b"\n"))
    if not trial.__module__.startswith("hexakin."):
        try:
            digest.update(inspect.getsource(trial).encode())
        except (OSError, TypeError):  # typed into an interpreter
            code = trial.__code__
            constants = [value for value in code.co_consts if isinstance(value, Scalar)]
            digest.update(repr((code.co_code, code.co_names, constants)).encode())
    versions = {"python": platform.python_version(), "hexakin": __version__}
    for name in PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {
        "trial": f"{trial.__module__}:{trial.__qualname__}",
        "code": digest.hexdigest()[:12],
        "versions": versions,
    }


def machine() -> dict[str, Any]:
    """The machine, and the commit if hexakin is a checkout."""
    found = {"platform": f"{platform.system()} {platform.machine()}", "cores": os.cpu_count()}
    checkout = Path(__file__).parents[1]
    if (checkout / ".git").exists():
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            head = ["git", "rev-parse", "HEAD"]
            done = subprocess.run(head, cwd=checkout, capture_output=True, text=True, check=True, timeout=5)
            found["commit"] = done.stdout.strip()
    return found
