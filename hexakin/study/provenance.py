"""What made a result: the function, a digest of the code, package versions and the machine."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import platform
import subprocess
from collections.abc import Callable, Iterable, Mapping
from importlib import metadata
from typing import Any

from hexakin import installation
from hexakin.installation import DATA, __version__
from hexakin.study.tables import Scalar

Trial = Callable[..., Mapping[str, Any]]

PACKAGES = ("numpy", "scipy", "pin", "coal", "numba", "pybullet")
"""Packages that a result may depend on; their versions are kept with it."""

_RUNNER = __name__.rpartition(".")[0]
"""The package of what calls a trial and keeps its result, on which the result does not depend."""


def _code(module: str) -> str:
    """Digest of what a trial in a module depends on: of that module's code and of all that it imports.

    A trial outside hexakin may call everything; what leads to matplotlib only draws, and is left out.
    """
    known = installation.modules()
    if module in known:
        return installation.digest([module], without=[_RUNNER])
    drawing = {"matplotlib"}
    while more := {m for m in known if m not in drawing and not drawing.isdisjoint(_tops(installation.imports(m)))}:
        drawing |= more
    return installation.digest(known.keys() - drawing, without=[_RUNNER])


def _tops(names: Iterable[str]) -> set[str]:
    """Names of modules of hexakin, and of whole packages for others."""
    return {name if name.startswith("hexakin.") else name.partition(".")[0] for name in names}


def provenance(trial: Trial) -> dict[str, Any]:
    """Say what a result depends on beside its arguments: function, code and package versions.

    ``code`` is a digest of hexakin's robots and of its code, without comments, as far as the trial may depend on it:
    what a trial in hexakin imports; for another trial, all but what draws, and the trial's own function, without others
    that it calls.
    """
    digest = hashlib.sha256(_code(trial.__module__).encode())
    for robot in sorted((DATA / "robots").glob("*.yaml")):
        digest.update(robot.name.encode() + robot.read_bytes().replace(b"\r\n", b"\n"))
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
    checkout = installation.PACKAGE.parent
    if (checkout / ".git").exists():
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            head = ["git", "rev-parse", "HEAD"]
            done = subprocess.run(head, cwd=checkout, capture_output=True, text=True, check=True, timeout=5)
            found["commit"] = done.stdout.strip()
    return found
