"""Pythons of other versions, and the wheel, for fresh environments."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def interpreter(version: str) -> str:
    """Return a Python of this version that runs: from the PATH, as uv finds it, or from pyenv."""
    found = [shutil.which(f"python{version}"), output([sys.executable, "-m", "uv", "python", "find", version])]
    if pyenv := output(["pyenv", "root"]):
        found += sorted(map(str, Path(pyenv, "versions").glob(f"{version}.*/bin/python{version}")))
    for python in found:
        if python and output([python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]) == version:
            return python
    sys.exit(f"No Python {version} was found. Install it; it may be on the PATH or in pyenv, or be one that uv finds.")


def output(command: list[str]) -> str:
    """Return what a command prints; empty if it fails or does not exist."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def built(folder: Path) -> Path:
    """Build the wheel of this checkout into ``folder``, and return its file."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel
