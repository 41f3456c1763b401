"""What is stale after a change is computed from the imports: results of studies, code of leg types, machine code."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hexakin import installation

PACKAGE = installation.PACKAGE
WALK = "from hexakin.papers.scenarios import walk"


def test_imports_in_functions_and_modules_named_by_strings_count():
    assert "hexakin.symbolic.generate" in installation.imports("hexakin.kinematics.code_cache")
    assert {"hexakin.engines.rigid_engine", "hexakin.engines.pybullet_engine"} <= installation.imports(
        "hexakin.engines"
    )
    assert "hexakin.generated.athena_loops" in installation.imports("hexakin.generated")
    assert "numba" in installation.imports("hexakin.numerics.numba_cache")


def test_every_import_names_a_module_that_exists():
    known = installation.modules()
    for module in known:
        text = known[module].read_text(encoding="utf-8")
        assert "from ." not in text, f"{module}: relative imports are not followed"
        for name in installation.imports(module):
            assert not name.startswith("hexakin.") or name in known


@pytest.mark.parametrize("engine", ["rigid", "pybullet"])
def test_no_file_that_a_walk_runs_is_forgotten(engine):
    """Every function of hexakin that runs during a trial is in a file on which the trial's results depend."""
    script = f"""
import cProfile, json, pstats
{WALK}
profile = cProfile.Profile()
profile.runcall(walk, "testbed", 0.6, 0.4, 0.4, {engine!r}, 0.005, 0, 0, num_cycles=1)
print(json.dumps(sorted({{file for file, _, function in pstats.Stats(profile).stats if function != "<module>"}})))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    ran = {Path(file) for file in json.loads(run.stdout.splitlines()[-1]) if file.startswith(str(PACKAGE))}
    engine_file = installation.modules()[f"hexakin.engines.{engine}_engine"]
    assert engine_file in ran and len(ran) > 15
    assert ran <= set(installation.sources(["hexakin.papers.scenarios"]).values())


STALE = f"""
import importlib, json
from hexakin.kinematics import code_cache
from hexakin.numerics import numba_cache
from hexakin.study.provenance import provenance
{WALK}
def own(): pass
print(json.dumps([provenance(walk)["code"], provenance(own)["code"], code_cache._generator()]))
"""


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the package that a test may change, with machine code in its caches."""
    root = tmp_path_factory.mktemp("copy")
    shutil.copytree(PACKAGE, root / "hexakin", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(installation.DATA / "robots", root / "data" / "robots")
    for module in MACHINE_CODE:
        machine_code(root, module).parent.mkdir(exist_ok=True)
    return root, *what_is_known(root, time.time() + 10.0)


MACHINE_CODE = ("contact.cone", "engines.moreau_step", "engines.box_contacts", "generated.athena_loops")


def machine_code(root, module):
    package, name = module.split(".")
    return root / "hexakin" / package / "__pycache__" / f"{name}.function-1.py311.nbi"


def what_is_known(root, made):
    """Digests of a walk, of a trial outside hexakin and of the generator; and what is kept of machine code."""
    for module in MACHINE_CODE:
        machine_code(root, module).write_bytes(b"")
        os.utime(machine_code(root, module), (made, made))
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", STALE]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=root)
    kept = {module for module in MACHINE_CODE if machine_code(root, module).exists()}
    return dict(zip(("walk", "own", "leg type"), json.loads(run.stdout), strict=True)), kept


def stale_after(copied, file, change):
    """Names of what a change of a file makes stale; the file is put back."""
    root, before, kept = copied
    assert kept == set(MACHINE_CODE)
    path, made = root / "hexakin" / file, time.time() + 10.0
    text = path.read_text(encoding="utf-8")
    path.write_text(change(text), encoding="utf-8")
    os.utime(path, (made + 10.0, made + 10.0))
    after, kept = what_is_known(root, made)
    path.write_text(text, encoding="utf-8")
    return {name for name in before if before[name] != after[name]} | (set(MACHINE_CODE) - kept)


def commented(text):
    return text + "\n# A comment.\n"


def changed(text):
    return text + "\n_ADDED = 1\n"


DRAWING = ("figures/robot_3d.py", "figures/sliders.py", "figures/solids_3d.py", "animation/scene.py", "report/page.py")


@pytest.mark.parametrize("file", DRAWING)
def test_a_comment_in_a_module_that_draws_makes_nothing_stale(copied, file):
    assert stale_after(copied, file, commented) == set()


@pytest.mark.parametrize("file", ["figures/robot_3d.py", "figures/charts.py", "study/runner.py"])
def test_a_change_in_a_module_that_draws_or_runs_studies_makes_nothing_stale(copied, file):
    assert stale_after(copied, file, changed) == set()


@pytest.mark.parametrize("file, knowing", [("model.py", set()), ("leg_table.py", {"leg type"})])
def test_a_change_of_the_robot_makes_stale_what_knows_it(copied, file, knowing):
    stale = stale_after(copied, f"robot/{file}", changed)
    assert stale == {"walk", "own", "engines.box_contacts"} | knowing


def test_a_change_of_an_engine_makes_walks_and_its_machine_code_stale(copied):
    assert stale_after(copied, "engines/moreau_stepper.py", changed) == {"walk", "own"}
    assert stale_after(copied, "engines/ground_contacts.py", changed) == {
        "walk",
        "own",
        "engines.moreau_step",
        "engines.box_contacts",
    }
    assert stale_after(copied, "contact/cone.py", changed) == {"walk", "own", "contact.cone", "engines.moreau_step"}


def test_a_comment_or_a_docstring_leaves_results_valid(copied):
    assert stale_after(copied, "control/posture.py", commented) == set()
    assert (
        stale_after(copied, "control/posture.py", lambda text: text.replace('"""', '"""In other words: ', 1)) == set()
    )
