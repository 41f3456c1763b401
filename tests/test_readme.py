"""The README's table, commands and example are true, and the notebooks are what they should be."""

import json
import re
from pathlib import Path

import pytest

from hexakin import studies
from hexakin.papers.results import load_results, statements_table
from hexakin.robot.file import robot_names

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
NOTEBOOKS = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in (ROOT / "notebooks").glob("*.ipynb")}
ROWS = re.findall(r"^\| ([AB] Fig\. [^|]+?) \| [^|]+ \|([^|]*)\| ([^|]+?) \|$", README, re.MULTILINE)
TABLE = [(figure, notebook.strip(" `"), status) for figure, notebook, status in ROWS]


def sources(notebook, kind=None):
    return "\n".join("".join(cell["source"]) for cell in notebook["cells"] if kind in (None, cell["cell_type"]))


def test_the_first_screen_says_what_this_is_cites_both_papers_and_gives_both_commands():
    screen = "\n".join(README.splitlines()[:25])
    for wanted in ("hexapod", "Coelho", "Aissaoui", "make reproduce", "make test"):
        assert wanted in screen


def test_the_table_lists_every_figure_of_both_papers_once():
    for paper, last in (("A", 19), ("B", 31)):
        numbers = [re.match(rf"{paper} Fig\. (\d+)", figure) for figure, _, _ in TABLE]
        assert sorted({int(match[1]) for match in numbers if match}) == list(range(1, last + 1))
    assert len(TABLE) == len(set(figure for figure, _, _ in TABLE))


@pytest.mark.parametrize("figure, notebook, status", TABLE)
def test_a_figure_is_where_the_table_says(figure, notebook, status):
    if status == "rebuilt":
        body = NOTEBOOKS[notebook]
        code = sources(body, "code")
        assert re.search(re.escape(figure) + r"(?!\d)", code)
        assert any(
            "image/png" in output.get("data", {}) for cell in body["cells"] for output in cell.get("outputs", [])
        )
    else:
        assert status in ("later", "left out") and not notebook
        drawn = [
            name for name, body in NOTEBOOKS.items() if re.search(re.escape(figure) + r"\b", sources(body, "code"))
        ]
        assert drawn == [], f"{figure} is drawn, but the table does not say so"


@pytest.mark.parametrize("name", sorted(NOTEBOOKS))
def test_a_notebook_is_stored_executed_in_order_and_without_errors(name):
    cells = [cell for cell in NOTEBOOKS[name]["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert all(output["output_type"] != "error" and output.get("name") != "stderr" for output in outputs)
    assert NOTEBOOKS[name]["metadata"]["kernelspec"]["name"] == "python3"
    assert "assert " in sources(NOTEBOOKS[name], "code")


def test_the_commands_without_make_are_the_makefiles():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = makefile.split("test: $(VENV)/installed\n")[1].split("\n\n")[0]
    commands = [
        line.strip().replace("$(RUN)", ".venv/bin/python -m").replace("$(VENV)", ".venv")
        for line in recipe.splitlines()
    ]
    block = README.split("## Without make")[1].split("```")[1]
    plain = [re.sub(r"\s+#.*", "", line).strip() for line in block.splitlines() if line.strip()]
    assert commands == plain[-len(commands) :]
    assert len(commands) == 6


def test_the_readmes_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example = README.split("```python\n")[1].split("```")[0]
    assert len(example.strip().splitlines()) <= 20
    exec(compile(example, "README.md", "exec"), {})
    assert (tmp_path / "walk.npz").is_file()
    heights, margin, shapes = capsys.readouterr().out.strip().split("\n")
    assert heights.startswith("[0.10") and float(margin) > 0.0
    assert shapes == "(701, 6, 3) (701, 6, 3)"


def test_the_example_of_an_animation_leaves_its_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = README.split("## Animations")[1].split("```python\n")[1].split("```")[0]
    exec(compile(example.replace("duration=5.0", "duration=0.5"), "README.md", "exec"), {})
    assert (tmp_path / "walk.html").stat().st_size > 5e5 and (tmp_path / "walk.gif").stat().st_size > 1e4


def test_the_example_of_a_check_prints_what_it_says(capsys):
    example = README.split("## Feasibility checks")[1].split("```python\n")[1].split("```")[0]
    exec(compile(example, "README.md", "exec"), {})
    said = capsys.readouterr().out
    assert "not feasible: friction" in said and "a friction of 0.684" in said and "unloading" in said
    energy, region = (float(line) for line in said.splitlines()[-2:])
    assert 0.0 < energy < region


def test_the_example_of_an_own_robot_walks_as_commanded_from_an_empty_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    section = README.split("## Your own robot")[1].split("\n## ")[0]
    (tmp_path / "mine.yaml").write_text(section.split("```yaml\n")[1].split("```")[0], encoding="utf-8")
    example = section.split("```python\n")[1].split("```")[0]
    assert len(example.strip().splitlines()) <= 20
    namespace = {}
    exec(compile(example, "README.md", "exec"), namespace)
    assert namespace["robot"].name not in robot_names()
    said = capsys.readouterr().out
    assert said.startswith("feasible") and "NO" not in said
    margin, commanded, walked = (float(number) for number in re.findall(r"(-?\d\.\d{3}) m (?:within|forwards)", said))
    assert margin > 0.0
    # 4 cycles of 3 s at 0.03 m/s, less half of the 1.5 cycles in which the robot gets up to speed.
    assert commanded == pytest.approx(0.03 * 3.0 * (4 - 0.5 * 1.5), rel=0.1)
    assert walked == pytest.approx(commanded, rel=0.1)
    assert (tmp_path / "walk.html").stat().st_size > 5e5


def test_the_table_of_statements_is_computed_from_the_committed_results():
    """Mend it with: python -m hexakin statements."""
    _, rest = README.split("<!-- statements: python -m hexakin statements -->\n")
    assert rest.split("<!-- end of statements -->")[0] == statements_table()


def test_the_readmes_study_runs_and_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example = README.split("## Studies")[1].split("```python\n")[1].split("```")[0]
    namespace = {"__name__": "example"}
    exec(compile(example, "README.md", "exec"), namespace)
    assert list(namespace["table"].groupby("k_z").size()) == [2, 2, 2]
    assert {path.suffix for path in (tmp_path / "results").iterdir()} >= {".csv", ".json", ".journal"}
    assert capsys.readouterr().out.startswith("k_z")


def test_the_studies_that_the_readme_names_exist():
    names = re.findall(r"^python -m hexakin study (\w+)", README, re.MULTILINE)
    assert names and set(names) <= {*studies.STUDIES, "all"}


def test_what_the_readme_says_of_the_grid_and_of_foresight_is_in_the_results():
    from hexakin.papers import near_limits
    from hexakin.study.factorial import cells, variance_shares

    said = " ".join(README.split())
    grid = load_results("ramp_grid")[0]
    names = ["k_z", "k_alpha", "k_beta"]
    shares = {
        measure: variance_shares(cells(grid, measure, names), names)
        for measure in ("height_median", "pitch_rate_median", "roll_rate_median")
    }
    height = 100 * shares["height_median"]["k_z"]
    start = 100 * min(shares[rate]["repeats"] for rate in ("pitch_rate_median", "roll_rate_median"))
    assert f"$k_z$ explains {height:.1f} % of the height's variance, and the start {start:.0f} % of the rates'" in said
    walks = load_results("ramp_limits")[0]
    walks = walks[walks.engine == "rigid"]
    skill = near_limits.foresight(walks, near_limits.failures(walks))
    assert f"Of {len(walks)} walks" in said and f"predicted {100 * skill.right['feasible']:.0f} % correctly" in said
    assert f"missed {100 * skill.missed['margin_polygon']:.0f} % of the failures" in said


def test_what_the_readme_says_of_walks_by_velocity_commands_is_in_the_results():
    table, _ = load_results("manoeuvres")
    assert (table.status == "ok").all() and (table.torso_contact == 0.0).all() and (table.num_cycles == 20).all()
    said = " ".join(README.split())
    assert f"In {len(table)} walks of 20 cycles" in said
    assert f"within {100 * table.error.max():.1f} % of the command" in said
    assert f"moved by more than {1e3 * table.slip_most.max():.1f} mm" in said
