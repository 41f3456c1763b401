"""Set-up: the messages of the Makefile, the pins, and what a wheel carries."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from hexakin import report
from hexakin.installation import __version__

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
    pins = re.findall(r"^([A-Za-z0-9_.-]+)==", (ROOT / "environment.txt").read_text(encoding="utf-8"), re.MULTILINE)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = project["dependencies"] + [name for extra in project["optional-dependencies"].values() for name in extra]
    assert {name.lower() for name in wanted} <= {pin.lower() for pin in pins}
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    assert all("==" in line for line in lines if line and not line.lstrip().startswith("#"))


def test_messages_name_packages_and_not_extras_of_a_hexakin_that_pypi_does_not_have():
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "hexakin").rglob("*.py"))
    assert "pip install " in code and "hexakin[" not in code


def test_the_reports_message_names_packages_of_the_notebooks():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {re.match(r"[\w-]+", wanted)[0] for wanted in project["optional-dependencies"]["notebooks"]}
    assert set(report.INSTALL.removeprefix("pip install ").split()) <= names


def built(kind, folder, root=ROOT):
    """The package of a kind, built into a folder."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)]
    subprocess.run(build, cwd=root, check=True, capture_output=True)
    (package,) = folder.iterdir()
    return package


def test_a_wheel_carries_the_robots_and_the_papers_values(tmp_path):
    wheel = built("wheel", tmp_path)
    names = zipfile.ZipFile(wheel).namelist()
    assert {"hexakin/data/robots/athena.yaml", "hexakin/data/paper/athena.csv", "hexakin/generated/athena.py"} <= set(
        names
    )
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "hexakin").rglob("*") if path.is_file()}
    assert {name for name in files if "__pycache__" not in name} <= set(names)
    script = f"import sys; sys.path.insert(0, {str(wheel)!r}); import hexakin; print(hexakin.__version__)"
    assert subprocess.run([sys.executable, "-I", "-c", script], check=True, capture_output=True).stdout


def test_a_wheel_says_its_version_and_that_it_has_types(tmp_path):
    archive = zipfile.ZipFile(built("wheel", tmp_path))
    (metadata,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
    lines = archive.read(metadata).decode().splitlines()
    assert f"Version: {__version__}" in lines and "Classifier: Typing :: Typed" in lines
    assert {"hexakin/py.typed", "hexakin/__init__.pyi"} <= set(archive.namelist())


def test_a_wheel_has_a_command_that_is_the_module(tmp_path):
    archive = zipfile.ZipFile(built("wheel", tmp_path))
    (entries,) = [name for name in archive.namelist() if name.endswith("entry_points.txt")]
    assert "hexakin = hexakin.__main__:main" in archive.read(entries).decode().splitlines()


def test_a_source_package_has_the_documents_and_makes_the_same_wheel(tmp_path):
    for folder in ("source", "wheel", "again"):
        (tmp_path / folder).mkdir()
    source = built("sdist", tmp_path / "source")
    with tarfile.open(source) as archive:
        names = archive.getnames()
        archive.extractall(tmp_path, filter="data")
    top = f"hexakin-{__version__}"
    for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/design.md", "LICENSE", "CITATION.cff"):
        assert f"{top}/{name}" in names
    wheel = built("wheel", tmp_path / "wheel")
    again = built("wheel", tmp_path / "again", root=tmp_path / top)
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())
