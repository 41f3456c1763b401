"""The files beside the library agree with each other: versions, changelog, paths in the documents, the CI workflow."""

import importlib
import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

import hexakin as hk
from hexakin import installation

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = ["CONTRIBUTING.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").glob("*.md"))]
MADE = {".venv", "report", "build", "dist"}
"""Folders that a fresh checkout does not have."""


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


def table_of(section, document):
    """Rows of the first table after a heading, without its head."""
    lines = document.split(section, 1)[1].splitlines()
    rows = [line.strip() for line in lines[: next(k for k, line in enumerate(lines) if line.startswith("## "))]]
    return [re.split(r"(?<!\\) *\| *", row.strip("| ")) for row in rows if row.startswith("|")][2:]


# Versions


def test_the_version_stands_in_one_place_of_the_package():
    project = tomllib.loads(text_of("pyproject.toml"))
    assert "version" not in project["project"] and project["project"]["dynamic"] == ["version"]
    assert project["tool"]["hatch"]["version"]["path"] == "hexakin/installation.py"
    assert hk.__version__ == installation.__version__
    written = [path for path in installation.modules().values() if "__version__ =" in path.read_text(encoding="utf-8")]
    assert written == [installation.PACKAGE / "installation.py"]


def test_the_citation_and_the_changelog_name_the_version():
    assert yaml.safe_load(text_of("CITATION.cff"))["version"] == hk.__version__
    assert versions_of_changelog()[0] == hk.__version__


def test_a_recording_names_the_version_that_made_it(short_walk):
    assert short_walk.parameters["versions"]["hexakin"] == hk.__version__


def test_a_study_names_the_version_that_made_it(tmp_path):
    hk.study.run(hk.study.Study("one", lambda seed: {"x": seed}, [{"seed": 0}]), tmp_path, jobs=1, progress=False)
    about = json.loads((tmp_path / "one.json").read_text(encoding="utf-8"))
    assert about["versions"]["hexakin"] == hk.__version__


# Changelog


def versions_of_changelog():
    """Versions of its entries, the newest first."""
    return re.findall(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d{2}-\d{2}$", text_of("CHANGELOG.md"), re.MULTILINE)


def test_the_changelog_has_the_form_of_keep_a_changelog():
    headings = re.findall(r"^##+ .*$", text_of("CHANGELOG.md"), re.MULTILINE)
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    for heading in headings:
        assert re.fullmatch(rf"## \[.+\]( - .+)?|### ({'|'.join(kinds)})", heading), heading
    versions = [tuple(map(int, version.split("."))) for version in versions_of_changelog()]
    assert versions == sorted(set(versions), reverse=True) and len(versions) >= 2


def moved_modules():
    """Old modules of the changelog's table, and the modules that replace them."""
    rows = table_of("### Removed", text_of("CHANGELOG.md"))
    return [(re.findall(r"hexakin[.\w]+", old), re.findall(r"hexakin[.\w]+", new)) for old, new in rows]


def test_the_new_paths_of_the_changelog_exist():
    rows = moved_modules()
    assert len(rows) > 30
    for _, new in rows:
        assert new and set(new) <= set(installation.modules())


@pytest.mark.pybullet  # the modules of both engines are imported
def test_names_of_the_changelogs_table_are_in_their_new_modules():
    for old, new in table_of("### Removed", text_of("CHANGELOG.md")):
        modules = [importlib.import_module(name) for name in re.findall(r"hexakin[.\w]+", new)]
        named = re.findall(r"`([A-Za-z_]+)`", new) or re.findall(r"`([A-Za-z_]+)`", old)
        for name in named:
            assert any(hasattr(module, name) for module in modules), f"{name} is not in {new}"


# Documents


def paths_in(document):
    """Paths of the project in the code of a document: words with a slash, and names of files at the top.

    Words in capitals stand for a name that the reader chooses.
    """
    spans = re.findall(r"^```.*?^```|`[^`\n]+`", document, re.MULTILINE | re.DOTALL)
    words = {word.strip("`,;:()'\"").rstrip("./") for span in spans for word in span.split()}
    paths = {word for word in words if "/" in word or re.fullmatch(r"Makefile|[\w-]+\.(md|toml|cff|txt)", word)}
    return {path for path in paths if path.split("/")[0] not in MADE and not re.search(r"NAME|\*|://|^/", path)}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_path_that_a_document_names_exists(name):
    missing = sorted(path for path in paths_in(text_of(name)) if not (ROOT / path).exists())
    assert missing == []


def test_the_search_for_paths_finds_those_that_do_not_exist():
    text = "`hexakin/none.py`, `NONE.md`.\n```\nmake test; python tests/none.py -k a\n```\n`data/robots/NAME.yaml`, a/b"
    assert paths_in(text) == {"hexakin/none.py", "NONE.md", "tests/none.py"}


def test_the_questions_are_answered_by_files():
    rows = table_of("## Where do I ...", text_of("CONTRIBUTING.md") + "\n## ")
    assert len(rows) >= 10
    for question, answer in rows:
        assert question.endswith("?") and paths_in(answer), question


def test_packages_in_the_design_notes_are_those_of_the_library():
    rows = table_of("## Packages", text_of("docs/design.md"))
    named = {name for cell, _ in rows for name in re.findall(r"`(\w+)`", cell)}
    there = {
        path.stem for path in installation.PACKAGE.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert named == there - {"__init__"}


def test_lines_of_the_documents_are_not_longer_than_code():
    for name in ("CHANGELOG.md", *DOCUMENTS):
        assert [line for line in text_of(name).splitlines() if len(line) > 120] == [], name


# Continuous integration


def test_the_workflow_runs_the_projects_own_commands_on_pushes_and_pull_requests():
    workflow = yaml.safe_load(text_of(".github/workflows/ci.yml"))
    # YAML 1.1 reads the key "on" as true.
    assert set(workflow[True]) == {"push", "pull_request"}
    tests, wheel = workflow["jobs"]["tests"], workflow["jobs"]["wheel"]
    assert tests["runs-on"].startswith("ubuntu")
    assert [step["run"] for step in tests["steps"] if "run" in step] == [".ci/run"]
    assert wheel["strategy"]["matrix"]["python-version"] == ["3.11", "3.12", "3.13", "3.14"]
    assert {name.partition("-")[0] for name in wheel["strategy"]["matrix"]["os"]} == {"ubuntu", "macos"}
    assert wheel["steps"][-1]["run"].startswith("python tests/wheel ")
    for job in (tests, wheel):
        (python,) = [step["with"] for step in job["steps"] if "setup-python" in step.get("uses", "")]
        assert python["cache"] == "pip" and (ROOT / python["cache-dependency-path"]).is_file()


def test_continuous_integration_runs_the_tests_and_then_the_wheel():
    commands = [line for line in text_of(".ci/run").splitlines() if line.startswith("make ")]
    assert commands == ["make test", "make test-wheel"]
