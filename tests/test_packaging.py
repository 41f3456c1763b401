"""Set-up: the messages of the Makefile, the pins, and what a wheel carries."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def make(tmp_path, *arguments):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    command = ["make", "-C", str(ROOT), "test", f"VENV={tmp_path / 'venv'}", *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def test_a_missing_python_gets_a_message(tmp_path):
    done = make(tmp_path, "PYTHON=")
    assert done.returncode != 0
    assert "hexakin needs Python 3.11, and none was found." in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_a_python_that_does_not_exist_gets_a_message(tmp_path):
    done = make(tmp_path, "PYTHON=/nowhere/python3.11")
    assert done.returncode != 0
    assert "PYTHON=/nowhere/python3.11: no such program." in done.stdout


@pytest.mark.parametrize(
    "version, message", [("(3, 10)", "is older than Python 3.11"), ("(3, 13)", "is newer than 3.11")]
)
def test_another_python_gets_a_message(tmp_path, version, message):
    fake = tmp_path / "python"
    # A Python that claims another version and cannot make virtual environments.
    fake.write_text(
        "#!/bin/sh\n"
        'case "$2" in *venv*) exit 1;; esac\n'
        f'exec {sys.executable} "$1" "$(echo "$2" | sed "s/sys.version_info/{version}/")"\n'
    )
    fake.chmod(0o755)
    done = make(tmp_path, f"PYTHON={fake}")
    assert done.returncode != 0
    assert message in done.stdout


def test_every_requirement_is_pinned():
    pins = re.findall(r"^([A-Za-z0-9_.-]+)==", (ROOT / "environment.txt").read_text(), re.MULTILINE)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"] + [name for extra in project["optional-dependencies"].values() for name in extra]
    assert {name.lower() for name in wanted} <= {pin.lower() for pin in pins}
    lines = (ROOT / "environment.txt").read_text().splitlines()
    assert all("==" in line for line in lines if line and not line.lstrip().startswith("#"))


def test_a_wheel_carries_the_robots_and_the_papers_values(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {"hexakin/data/robots/athena.yaml", "hexakin/data/paper/athena.csv", "hexakin/generated/athena.py"} <= set(
        names
    )
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "hexakin").rglob("*") if path.is_file()}
    assert {name for name in files if "__pycache__" not in name} <= set(names)
    script = f"import sys; sys.path.insert(0, {str(wheel)!r}); import hexakin; print(hexakin.__version__)"
    assert subprocess.run([sys.executable, "-I", "-c", script], check=True, capture_output=True).stdout
