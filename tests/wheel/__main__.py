"""Install the built wheel into a fresh environment, as a user does, and use it there from empty folders.

    python tests/wheel                 # with Python 3.13
    python tests/wheel /path/to/python

The wheel gets the versions of environment.txt and the extra ``animation``, nothing else of this project. The command
line, the script use.py and the examples of README.md are run; then PyBullet is removed, and all of it is run again.
``make test-wheel`` calls this file.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from environments import ROOT, built_wheel, install, installed, interpreter, new_environment, uninstall

README = (ROOT / "README.md").read_text(encoding="utf-8")
VERSION = "3.13"
PYBULLET = ("pybullet", "pybullet-arm64")  # distributions of the one module
LONGEST = 900  # [s]; only a command that hangs takes so long


def examples() -> Iterator[tuple[str, str]]:
    """Yield the headings and the code of the README's examples; those without hexakin need a cluster of machines."""
    for section in re.split(r"^## ", README, flags=re.MULTILINE):
        for code in re.findall(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL):
            if "import hexakin as hk" in code:
                yield section.partition("\n")[0], code


def run(name: str, command: list[str | Path], folder: Path, says: str = "") -> None:
    """Run a command in a new folder that has only the README's ``mine.yaml``; ``says`` must be in what it prints."""
    empty = folder / re.sub(r"\W+", "_", name)
    shutil.rmtree(empty, ignore_errors=True)
    empty.mkdir()
    (robot,) = re.findall(r"^```yaml\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    (empty / "mine.yaml").write_text(robot, encoding="utf-8")
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    start = time.perf_counter()
    done = subprocess.run(
        command, cwd=empty, env=clean, timeout=LONGEST, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    if done.returncode != 0 or says not in done.stdout:
        sys.exit(f"{name}: exit code {done.returncode}, expected 0 and {says!r} in its output:\n{done.stdout}")
    print(f"  {time.perf_counter() - start:5.1f} s  {name}", flush=True)


def use(python: Path, folder: Path, engine: str) -> int:
    """Run everything once, and return the number of commands. ``engine`` is the one that hk.simulate must choose."""
    hexakin = python.with_name("hexakin")
    version = re.search(r'__version__ = "(.+)"', (ROOT / "hexakin" / "installation.py").read_text(encoding="utf-8"))
    commands: list[tuple[str, list[str | Path], str]] = [
        ("hexakin --version", [hexakin, "--version"], f"hexakin {version[1] if version else ''}"),
        ("hexakin robot athena", [hexakin, "robot", "athena"], "standing"),
        ("hexakin robot mine.yaml", [hexakin, "robot", "mine.yaml"], "beetle"),
        ("hexakin study", [hexakin, "study"], "pip install SALib"),  # listed, though SALib is not installed
        ("hexakin statements", [python, "-m", "hexakin", "statements"], "| A 10"),
        ("use.py", [python, Path(__file__).with_name("use.py"), engine], f"{engine} is the default"),
    ]
    for number, (heading, code) in enumerate(examples(), start=1):
        file = folder / f"example_{number}.py"
        file.write_text(code, encoding="utf-8")
        commands.append((f"README: {heading}", [python, file], ""))
    for name, command, says in commands:
        run(name, command, folder, says)
    return len(commands)


def main() -> None:
    chosen = sys.argv[1] if len(sys.argv) > 1 else interpreter(VERSION)
    with tempfile.TemporaryDirectory() as name:
        folder, count = Path(name), 0
        print(f"Installing the wheel with {chosen}", flush=True)
        python = new_environment(folder / "venv", chosen)
        install(python, "--constraint", ROOT / "environment.txt", f"{built_wheel(folder)}[animation,mujoco]")
        for package in PYBULLET:
            if installed(python, package):
                print(f"With {package}:", flush=True)
                count += use(python, folder, "pybullet")
                uninstall(python, package)
        print("Without PyBullet:", flush=True)
        count += use(python, folder, "rigid")
    print(f"tests of the wheel: {count} passed, 0 failed")


if __name__ == "__main__":
    main()
