"""The origin of a result: the function, a digest of the code, package versions and the machine."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import platform
import subprocess
from collections.abc import Callable, Mapping
from typing import Any

from hexakin import installation
from hexakin.installation import DATA
from hexakin.study.tables import Scalar

Trial = Callable[..., Mapping[str, Any]]

PACKAGES = ("numpy", "scipy", "pin", "coal", "numba", "pybullet", "pybullet-arm64", "mujoco")
"""Packages that a result may depend on; the versions of those that are installed are stored with it."""

_RUNNER = __name__.rpartition(".")[0]
"""The package that calls a trial and stores its result; the result does not depend on it."""


def _code(module: str) -> str:
    """Return a digest of the code that a trial in ``module`` depends on: this module and all that it imports.

    A trial outside hexakin may call any public name of hexakin. Packages in which a module imports matplotlib only
    draw; they are left out.
    """
    if module in installation.modules():
        return installation.digest([module], without=[_RUNNER])
    drawing = {".".join(name.split(".")[:2]) for name in installation.modules() if _imports_matplotlib(name)}
    return installation.digest([installation.PACKAGE.name], without=[_RUNNER, *drawing])


def _imports_matplotlib(module: str) -> bool:
    return any(name.partition(".")[0] == "matplotlib" for name in installation.imports(module))


def provenance(trial: Trial) -> dict[str, Any]:
    """Return what a result of ``trial`` depends on, besides its arguments: function, code and package versions.

    ``code`` is a digest of hexakin's robot files and of the code, without comments, that the trial may depend on. For a
    trial in hexakin this is the code that it imports. For another trial it is all of hexakin except drawing code, and
    the code of the trial itself, but not of other functions that the trial calls.
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
    return {
        "trial": f"{trial.__module__}:{trial.__qualname__}",
        "code": digest.hexdigest()[:12],
        "versions": installation.versions(PACKAGES),
    }


def machine() -> dict[str, Any]:
    """Return platform and number of cores, and the git commit if hexakin runs from a checkout."""
    found = {"platform": f"{platform.system()} {platform.machine()}", "cores": os.cpu_count()}
    checkout = installation.PACKAGE.parent
    if (checkout / ".git").exists():
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            head = ["git", "rev-parse", "HEAD"]
            done = subprocess.run(head, cwd=checkout, capture_output=True, text=True, check=True, timeout=5)
            found["commit"] = done.stdout.strip()
    return found
