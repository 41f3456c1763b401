"""Fresh environments of other Pythons, and the wheel that is installed into them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
UV = [sys.executable, "-m", "uv"]


def interpreter(version: str) -> str:
    """Return a Python of this version that runs: from the PATH, as uv finds it, or from pyenv."""
    found = [shutil.which(f"python{version}"), output([*UV, "python", "find", "--no-python-downloads", version])]
    if pyenv := output(["pyenv", "root"]):
        found += sorted(map(str, Path(pyenv, "versions").glob(f"{version}.*/bin/python{version}")))
    for python in found:
        if python and output([python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]) == version:
            return python
    sys.exit(f"No Python {version} was found on the PATH, by uv or in pyenv; it is needed to test the wheel.")


def output(command: list[str]) -> str:
    """Return what a command prints; empty if it fails or does not exist."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def built_wheel(folder: Path) -> Path:
    """Build the wheel of this checkout into ``folder``, and return its file."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def new_environment(folder: Path, interpreter: str) -> Path:
    """Make an empty environment in ``folder``, and return its Python."""
    subprocess.run([*UV, "venv", "--quiet", "--python", interpreter, folder], check=True)
    return folder / ("Scripts" if os.name == "nt" else "bin") / "python"


def install(python: Path, *requirements: str | Path) -> None:
    """Install packages into the environment of ``python``; one that would have to be compiled is an error."""
    subprocess.run([*UV, "pip", "install", "--quiet", "--no-build", "--python", python, *requirements], check=True)


def installed(python: Path, name: str) -> bool:
    """Return whether the package ``name`` is in the environment of ``python``."""
    return output([*UV, "pip", "show", "--python", str(python), name]) != ""


def uninstall(python: Path, name: str) -> None:
    """Remove the package ``name`` from the environment of ``python``."""
    subprocess.run([*UV, "pip", "uninstall", "--quiet", "--python", python, name], check=True)
