"""The package's structure: its layers, no circles, few entries, one table of public names."""

import ast
import importlib
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import public_stub
import pytest

import hexakin as hk
from hexakin import installation

ROOT = Path(__file__).resolve().parent.parent
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
PLANNED = {"learning", "py.typed"}
DRAWERS = {"utils", "util", "common", "helpers", "misc", "tools"}


def lint_imports(folder, *arguments):
    """Run the contracts of a folder's pyproject.toml on the package in it."""
    program = Path(sys.executable).with_name("lint-imports")
    command = [str(program), "--no-cache", *arguments]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, encoding="utf-8", env={"PATH": "", "PYTHONPATH": "."}
    )


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    root = tmp_path_factory.mktemp("architecture")
    shutil.copytree(installation.PACKAGE, root / "hexakin", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", root)
    return root


@pytest.mark.parametrize(
    "file, line, contract",
    [
        ("kinematics/inverse.py", "from hexakin.papers import gains", "A package knows only what lies below it"),
        ("kinematics/inverse.py", "def late():\n    import hexakin.papers.gains", "A package knows only"),
        ("simulation/closed_loop.py", "from hexakin.papers.gains import GAINS", "A package knows only"),
        ("study/runner.py", "from hexakin.robot.file import load_robot", "The study runner knows no robot"),
        ("kinematics/forward.py", "import sympy", "sympy derives"),
        ("stability/polygon.py", "def late():\n    import casadi", "casadi checks feasibility"),
        ("motion/measures.py", "from matplotlib import pyplot", "matplotlib draws"),
        ("robot/model.py", "from hexakin.robot.file import load_robot", "No circle inside a package"),
        ("study/runner.py", "from hexakin.transforms import pose", "The study runner knows no robot"),
    ],
)
def test_an_import_that_climbs_breaks_a_contract(copied, file, line, contract):
    path = copied / "hexakin" / file
    text = path.read_text(encoding="utf-8")
    path.write_text(f"{text}\n\n{line}\n", encoding="utf-8")
    try:
        done = lint_imports(copied)
    finally:
        path.write_text(text, encoding="utf-8")
    assert done.returncode == 1
    assert any(contract in row and "BROKEN" in row for row in done.stdout.splitlines()), done.stdout


def test_the_contracts_hold(copied):
    done = lint_imports(copied)
    assert done.returncode == 0, done.stdout
    assert f"{len(CONTRACTS)} kept, 0 broken" in done.stdout


def test_make_test_runs_the_contracts():
    assert (
        "lint-imports" in (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ntest:")[2].partition("\n\n")[0]
    )


def test_no_module_imports_itself_by_way_of_others():
    """By a walk over the syntax trees, imports inside functions included."""
    known = installation.modules()
    reached: dict[str, set[str]] = {}

    def visit(module, above):
        assert module not in above, f"a circle: {' -> '.join([*above[above.index(module) :], module])}"
        if module not in reached:
            below = [name for name in installation.imports(module) if name in known]
            reached[module] = set(below).union(*(visit(name, [*above, module]) for name in below))
        return reached[module]

    for module in known:
        if module != hk.__name__:  # it only maps names, which are strings
            visit(module, [])
    assert len(reached["hexakin.report.__main__"]) > 30


def test_no_module_imports_by_way_of_the_public_names():
    """``from hexakin import x`` may name a module directly below hexakin; the contracts do not see further."""
    below = {name.split(".")[1] for name in installation.modules() if name.count(".") == 1}
    for module, path in installation.modules().items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "hexakin":
                assert {alias.name for alias in node.names} <= below, module
            if isinstance(node, ast.Import):
                assert "hexakin" not in {alias.name for alias in node.names}, module


def test_importing_hexakin_runs_one_module_beside_the_table():
    code = "import sys, hexakin; print(sorted(name for name in sys.modules if name.startswith('hexakin')))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ast.literal_eval(run.stdout) == ["hexakin", "hexakin.installation"]


def test_every_name_in_notebooks_and_documents_exists():
    """Of the form hk.a.b or imported from hexakin."""
    texts = [path.read_text(encoding="utf-8") for path in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]]
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        texts += ["".join(cell["source"]) for cell in cells]
    named = set()
    for text in texts:
        named |= {tuple(name.split(".")) for name in re.findall(r"\bhk\.([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)?)", text)}
        for module, names in re.findall(r"^from (hexakin[\w.]*) import ([\w, ]+)$", text, re.MULTILINE):
            for name in names.split(","):
                found = importlib.import_module(module)
                name = name.split(" as ")[0].strip()
                assert hasattr(found, name) or f"{module}.{name}" in installation.modules(), f"{module}: {name}"
    for first, *rest in named:
        value = getattr(hk, first)
        for name in rest:
            assert hasattr(value, name), f"hk.{first}.{name}"


def test_only_the_report_and_the_command_line_import_the_papers():
    importers = {
        name
        for name in installation.modules()
        if any(of.startswith("hexakin.papers") for of in installation.imports(name))
        and not name.startswith("hexakin.papers")
        and name != hk.__name__  # it only maps names
    }
    assert {name.split(".")[1] for name in importers} <= {"report", "__main__"}


def test_the_package_has_few_entries_now_and_after_what_is_planned_and_no_drawer():
    entries = {path.name for path in installation.PACKAGE.iterdir() if path.name != "__pycache__"}
    assert len(entries | PLANNED) <= 30
    assert not {name.partition(".")[0] for name in entries} & DRAWERS


def test_every_package_is_in_one_layer():
    layers = [name.strip(" ()") for layer in CONTRACTS[0]["layers"] for name in layer.split("|")]
    there = {path.stem for path in installation.PACKAGE.iterdir() if path.suffix in ("", ".py")}
    there -= {"__init__", "__pycache__"}
    assert len(layers) == len(set(layers)) and set(layers) == there | {"learning"}


def test_editors_and_type_checkers_know_the_same_public_names():
    assert public_stub.STUB.read_text(encoding="utf-8") == public_stub.text(), "make generated"


def test_a_public_name_is_what_its_path_says():
    for name, place in hk.PUBLIC.items():
        module, _, attribute = place.partition(":")
        value = importlib.import_module(module)
        assert getattr(hk, name) is (getattr(value, attribute) if attribute else value)


def test_functions_take_at_most_twelve_positional_arguments():
    many = set()
    for module, path in installation.modules().items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and ".generated" not in module:
                names = [a.arg for a in node.args.posonlyargs + node.args.args]
                if len(names) - (names[:1] in (["self"], ["cls"])) > 12:
                    many.add(node.name)
    assert many == set()


def test_no_module_imports_a_private_name_of_another():
    for module, path in installation.modules().items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hexakin"):
                private = [
                    alias.name for alias in node.names if alias.name.startswith("_") and alias.name != "__version__"
                ]
                assert not private, f"{module}: {private} of {node.module}"
