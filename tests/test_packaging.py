"""Set-up: the messages of the Makefile, the pins, what can be installed where, and what a wheel carries."""

import itertools
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from hexakin import report
from hexakin.installation import __version__

ROOT = Path(__file__).resolve().parent.parent


def make(tmp_path, *arguments, **variables):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    command = ["make", "-C", str(ROOT), "test", f"VENV={tmp_path / 'venv'}", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env={**os.environ, **variables})


def test_a_missing_python_gets_a_message(tmp_path):
    done = make(tmp_path, "PYTHON=")
    assert done.returncode != 0
    assert "hexakin needs Python 3.11, 3.12, 3.13 or 3.14, and none was found." in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_a_python_that_does_not_exist_gets_a_message(tmp_path):
    done = make(tmp_path, "PYTHON=/nowhere/python3.11")
    assert done.returncode != 0
    assert "PYTHON=/nowhere/python3.11: no such program." in done.stdout


def test_a_launcher_of_a_python_that_is_not_installed_gets_a_message(tmp_path):
    launcher = program(tmp_path / "python3.12", "echo python3.12: command not found >&2; exit 127")
    done = make(tmp_path, f"PYTHON={launcher}")
    assert done.returncode != 0
    assert f"PYTHON={launcher} does not run." in done.stdout


@pytest.mark.parametrize("version", ["(3, 10)", "(3, 15)"])
def test_another_python_gets_a_message(tmp_path, version):
    fake = program(
        tmp_path / "python", f'exec {sys.executable} "$1" "$(echo "$2" | sed "s/sys.version_info/{version}/")"'
    )
    done = make(tmp_path, f"PYTHON={fake}")
    assert done.returncode != 0
    assert "is not Python 3.11, 3.12, 3.13 or 3.14, which hexakin needs." in done.stdout


def test_the_first_python_that_runs_is_taken(tmp_path):
    folder = tmp_path / "bin"
    folder.mkdir()
    program(folder / "python3.11", "exit 127")
    program(folder / "python3.12", "exit 127")
    # It says that it runs, and stops the set-up at its second step.
    program(folder / "python3.13", 'case "$2" in *venv*) exit 1;; esac')
    done = make(tmp_path, PATH=f"{folder}{os.pathsep}{os.environ['PATH']}")
    assert done.returncode != 0
    assert "python3.13 cannot make virtual environments" in done.stdout


def program(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


# Requirements


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DEPENDENCIES, EXTRAS = PROJECT["dependencies"], PROJECT["optional-dependencies"]


def name_of(requirement):
    return re.match(r"[\w-]+", requirement)[0].lower()


def test_environment_txt_pins_the_library_and_the_extras_of_the_makefile():
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    pins = {name_of(line) for line in lines if line and not line.lstrip().startswith("#")}
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    extras = re.search(r"^EXTRAS := (.+)$", makefile, re.MULTILINE)[1].split()
    wanted = itertools.chain(DEPENDENCIES, *(EXTRAS[extra] for extra in extras))
    assert {name_of(each) for each in wanted} <= pins
    assert all("==" in line for line in lines if line and not line.lstrip().startswith("#"))


def test_every_requirement_has_a_lower_bound():
    for requirement in itertools.chain(DEPENDENCIES, *EXTRAS.values()):
        assert re.match(r"[\w-]+>=\d", requirement), requirement


MINORS = range(11, 15)
"""Python 3.11 to 3.14, the columns of the README's table."""
PLATFORMS = {
    "Linux, x86_64": ("x86_64-manylinux_2_28", ("linux", "Linux", "x86_64")),
    "Linux, aarch64": ("aarch64-manylinux_2_28", ("linux", "Linux", "aarch64")),
    "macOS, Apple processor": ("aarch64-apple-darwin", ("darwin", "Darwin", "arm64")),
    "macOS, Intel processor": ("x86_64-apple-darwin", ("darwin", "Darwin", "x86_64")),
    "Windows, x86_64": ("x86_64-pc-windows-msvc", ("win32", "Windows", "AMD64")),
}
"""Rows of the README's table: the platform as uv calls it, and sys.platform, platform.system() and .machine() there."""


@pytest.mark.parametrize("row", PLATFORMS)
def test_pip_finds_wheels_alone_and_the_engines_of_the_readme_on_every_python(row):
    platform, _ = PLATFORMS[row]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    cells = re.search(rf"^\| {row} \|(.+)\|$", readme, re.MULTILINE)[1].split("|")
    with ThreadPoolExecutor(4) as pool:
        newest, wheels = (
            list(pool.map(lambda minor, options=options: resolved(minor, platform, *options), MINORS))
            for options in ((), ("--only-binary", ":all:"))
        )
    assert newest == wheels, "pip would take a source package, because it is newer than the wheel"
    for minor, cell, pins in zip(MINORS, cells, newest, strict=True):
        names = {pin.partition("==")[0] for pin in pins}
        engines = {"pybullet": names & {"pybullet", "pybullet-arm64"}, "rigid": {"pin", "numba"} <= names}
        assert ("mujoco" in names) == ((row, minor) != ("macOS, Intel processor", 14)), (row, minor)
        assert set(re.findall(r"`(\w+)`", cell)) == {engine for engine, there in engines.items() if there}, (row, minor)


@pytest.mark.pybullet
def test_the_message_on_pybullet_names_the_package_that_pip_would_install():
    from hexakin.engines.pybullet_import import wheel

    pybullets = [each for each in map(Requirement, DEPENDENCIES) if each.name.startswith("pybullet")]
    for _, (sys_platform, system, machine) in PLATFORMS.values():
        for minor in MINORS:
            where = {"python_version": f"3.{minor}", "sys_platform": sys_platform, "platform_machine": machine}
            names = [each.name for each in pybullets if each.marker.evaluate(where)]
            assert names == [name for name in [wheel((3, minor), system, machine)] if name]


def resolved(minor, platform, *options):
    """What an installation with engine "mujoco" and Python 3.``minor`` gets, with versions; needs the package index."""
    call = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--no-header", "--no-annotate", *options]
    of = ["--python-version", f"3.{minor}", "--python-platform", platform, "--extra", "mujoco"]
    done = subprocess.run([*call, *of, str(ROOT / "pyproject.toml")], capture_output=True, text=True)
    if done.returncode != 0:
        asked = subprocess.run([*call, "--no-cache", "-"], input="tqdm", capture_output=True, text=True)
        if asked.returncode != 0:
            pytest.skip(f"the package index cannot be reached: {asked.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")


def test_messages_name_packages_and_not_extras_of_a_hexakin_that_pypi_does_not_have():
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "hexakin").rglob("*.py"))
    assert "pip install " in code and "hexakin[" not in code


def test_the_reports_message_names_packages_of_the_notebooks():
    names = {name_of(wanted) for wanted in EXTRAS["notebooks"]}
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
