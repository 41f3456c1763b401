"""What is stale after a change is computed from the imports: results of studies, code of leg types, machine code."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hexakin import installation

PACKAGE = installation.PACKAGE
WALK = "from hexakin.papers.scenarios import walk"


def test_imports_in_functions_and_modules_named_by_strings_count():
    assert "hexakin.symbolic.generate" in installation.imports("hexakin.kinematics.code_cache")
    assert {
        "hexakin.engines.rigid_engine",
        "hexakin.engines.pybullet_engine",
        "hexakin.engines.mujoco_engine",
    } <= installation.imports("hexakin.engines")
    assert "hexakin.generated.athena_loops" in installation.imports("hexakin.generated")
    assert "numba" in installation.imports("hexakin.numerics.numba_cache")


def test_every_import_names_a_module_that_exists():
    known = installation.modules()
    for module in known:
        text = known[module].read_text(encoding="utf-8")
        assert "from ." not in text, f"{module}: relative imports are not followed"
        for name in installation.imports(module):
            assert not name.startswith("hexakin.") or name in known


TRIALS = {
    "papers.scenarios": 'walk("testbed", 0.6, 0.4, 0.4, "rigid", 0.005, 0, 0, num_cycles=1)',
    "papers.scenarios ": 'walk("ramp", 0.6, 0.4, 0.4, "pybullet", 0.005, 0, 0, num_cycles=1)',
    "papers.near_limits": 'near_limit(0.17, 0.9, 1.89, 0.05, 0, "rigid", num_cycles=1)',
    "papers.steering_trials": 'steered("athena", "tripod", "0 deg", 5)',
}


@pytest.mark.parametrize(
    "module",
    [pytest.param(name, marks=[pytest.mark.pybullet] if '"pybullet"' in TRIALS[name] else []) for name in TRIALS],
)
def test_no_file_that_a_trial_runs_is_forgotten(module):
    """Every Python function of hexakin that runs during a trial is in a file on which the trial's results depend."""
    name, call = f"hexakin.{module.strip()}", TRIALS[module]
    script = f"""
import cProfile, json, pstats
from {name} import {call.partition("(")[0]}
profile = cProfile.Profile()
profile.runcall(lambda: {call})
print(json.dumps(sorted({{file for file, _, function in pstats.Stats(profile).stats if function != "<module>"}})))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    ran = {Path(file) for file in json.loads(run.stdout.splitlines()[-1]) if file.startswith(str(PACKAGE))}
    assert len(ran) > 15
    # hexakin/__init__.py only maps names.
    assert ran - {PACKAGE / "__init__.py"} <= set(installation.sources([name]).values())


MACHINE_CODE = (
    "contact.cone",
    "contact.lemke",
    "engines.moreau_step",
    "engines.contact_search",
    "generated.athena_loops",
)
WHAT = f"""
import json
from hexakin.kinematics import code_cache
from hexakin.numerics.numba_cache import source_stamp
from hexakin.study.provenance import provenance
{WALK}
def own(): pass
stamps = {{name: source_stamp("hexakin." + name) for name in {MACHINE_CODE!r}}}
other = {{"walk": provenance(walk)["code"], "own": provenance(own)["code"], "leg type": code_cache._generator()}}
print(json.dumps(stamps | other))
"""


def what_is_known(root):
    """Digests of a walk, of a trial outside hexakin, of the generator of leg code, and stamps of machine code."""
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", WHAT]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=root)
    return json.loads(run.stdout)


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the package that a test may change, and what is known of it."""
    root = tmp_path_factory.mktemp("copy")
    shutil.copytree(PACKAGE, root / "hexakin", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(installation.DATA / "robots", root / "data" / "robots")
    return root, what_is_known(root)


def stale_after(copied, *changes):
    """Names of what is stale after changes of files, each a file and a function of its text; they are undone."""
    root, before = copied
    texts = {root / "hexakin" / file: (root / "hexakin" / file).read_text(encoding="utf-8") for file, _ in changes}
    try:
        for path, (_, change) in zip(texts, changes, strict=True):
            path.write_text(change(texts[path]), encoding="utf-8")
        after = what_is_known(root)
    finally:
        for path, text in texts.items():
            path.write_text(text, encoding="utf-8")
    return {name for name in before if before[name] != after[name]}


def commented(text):
    return text + "\n# A comment.\n"


def changed(text):
    return text + "\n_ADDED = 1\n"


DRAWING = ("figures/robot_3d.py", "figures/sliders.py", "figures/occlusion.py", "animation/scene.py", "report/page.py")


def test_a_comment_in_modules_that_draw_makes_nothing_stale(copied):
    assert stale_after(copied, *((file, commented) for file in DRAWING)) == set()


def test_a_change_in_modules_that_draw_or_run_studies_makes_nothing_stale(copied):
    assert stale_after(copied, *((file, changed) for file in (*DRAWING, "study/runner.py"))) == set()


@pytest.mark.parametrize("file, knowing", [("model.py", set()), ("leg_table.py", {"leg type"})])
def test_a_change_of_the_robot_makes_stale_what_knows_it(copied, file, knowing):
    stale = stale_after(copied, (f"robot/{file}", changed))
    assert stale == {"walk", "own"} | knowing


@pytest.mark.parametrize(
    "file, machine_code",
    [
        ("engines/moreau_stepper.py", set()),
        ("engines/ground_contacts.py", {"engines.moreau_step", "engines.contact_search"}),
        ("contact/cone.py", {"contact.cone", "contact.lemke", "engines.moreau_step"}),
    ],
)
def test_a_change_of_an_engine_makes_walks_and_its_machine_code_stale(copied, file, machine_code):
    assert stale_after(copied, (file, changed)) == {"walk", "own"} | machine_code


def test_comments_and_docstrings_leave_results_valid(copied):
    def reworded(text):
        return text.replace('"""', '"""In other words: ', 1)

    assert stale_after(copied, ("control/posture.py", commented), ("control/interface.py", reworded)) == set()


def test_another_place_of_a_public_name_makes_trials_outside_hexakin_stale(copied):
    def redirected(text):
        return text.replace(
            "hexakin.simulation.closed_loop:simulate", "hexakin.simulation.commanded_walk:commanded_walk"
        )

    assert stale_after(copied, ("__init__.py", redirected)) == {"own"}


def test_machine_code_of_other_sources_is_not_used(tmp_path):
    """Wherever it is kept: a changed module that a compiled function imports gives it another stamp."""
    root = tmp_path / "copy"
    shutil.copytree(PACKAGE, root / "hexakin", ignore=shutil.ignore_patterns("__pycache__"))
    script = """
import numpy as np
from hexakin.contact import cone
def used():
    cone.eliminate(3, np.eye(3), np.zeros(3))
    return sum(cone.eliminate.stats.cache_hits.values())
print(used())
"""
    environment = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def hits():
        command = [sys.executable, "-c", script]
        run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=root)
        return int(run.stdout)

    assert (hits(), hits()) == (0, 1)
    checks = root / "hexakin" / "checks" / "values.py"  # which contact.cone imports
    checks.write_text(changed(checks.read_text(encoding="utf-8")), encoding="utf-8")
    assert (hits(), hits()) == (0, 1)
