import base64
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import nbformat
import pytest

from hexakin.papers.results import statements_table
from hexakin.report.__main__ import main
from hexakin.report.figure_table import checks_passed, count_verdicts, figure_table, find_pictures, judged_statements
from hexakin.report.page import mathml

ROOT = Path(__file__).resolve().parent.parent
FIGURES = figure_table(ROOT / "README.md")
PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
DRAW = f"import base64\nfrom IPython.display import Image, display\ndisplay(Image(base64.b64decode('{PNG}')))  # "
TABLE = """
| figure | shows | notebook | status |
|---|---|---|---|
| A Fig. 9(a) | the ramp | `b_works` | rebuilt |
| A Fig. 16 | the ramp, again | `b_works` | rebuilt |
| A Fig. 17 | what is never drawn | `a_fails` | rebuilt |
| B Fig. 1 | a photograph | | left out |
| B Fig. 2 | what is drawn before | `a_fails` | rebuilt |
"""


def notebook_of(*cells):
    """A notebook; cells that begin with a heading are Markdown cells."""
    kinds = {True: nbformat.v4.new_markdown_cell, False: nbformat.v4.new_code_cell}
    return nbformat.v4.new_notebook(cells=[kinds[cell.startswith(("# ", "## "))](cell) for cell in cells])


def write(folder, name, *cells):
    nbformat.write(notebook_of(f"# Title of {name}", *cells), folder / f"{name}.ipynb")


def shown(*cells):
    """A notebook with the outputs of a run: code that contains the word DRAW has a picture."""
    notebook = notebook_of(*cells)
    for k, cell in enumerate(notebook.cells):
        if cell.cell_type == "code":
            cell.execution_count = k + 1
            if "DRAW" in cell.source:
                data = {"image/png": base64.b64encode(b"%d" % k).decode()}
                cell.outputs = [nbformat.v4.new_output("display_data", data)]
    return notebook


def test_the_report_has_a_page_for_every_notebook_and_an_index(tmp_path, capsys):
    write(tmp_path, "a_works", "print(6 * 7)")
    write(tmp_path, "b_works", "x = 1")
    assert main([str(tmp_path), str(tmp_path / "report")]) == 0
    assert "42" in (tmp_path / "report" / "a_works.html").read_text(encoding="utf-8")
    index = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert 'href="a_works.html"' in index and "Title of b_works" in index
    assert "2 of 2 notebooks ran to the end" in index and "Python 3." in index and "numpy" in index
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("[1/2] a_works ... ") and printed[1].startswith("[2/2] b_works ... ")


def test_a_failing_notebook_is_named_and_the_others_still_run(tmp_path, capsys):
    (tmp_path / "README.md").write_text(TABLE, encoding="utf-8")
    folder = tmp_path / "notebooks"
    folder.mkdir()
    write(folder, "a_fails", f"{DRAW}\n'B Fig. 2'", "raise ValueError('a reason')", "print('never')  # 'A Fig. 17'")
    write(folder, "b_works", f"print('after')\n{DRAW}\n'A Fig. 9(a)'; 'A Fig. 16(b)'", "assert 1 < 2")
    assert main([str(folder), str(tmp_path / "report")]) == 1
    printed = capsys.readouterr().out
    assert "FAILED: ValueError: a reason" in printed and "without a picture" not in printed
    assert "after" in (tmp_path / "report" / "b_works.html").read_text(encoding="utf-8")
    index = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert "1 of 2 notebooks ran to the end" in index and "1 failed" in index
    assert "3 of the papers&#39; 5 figures" in index
    assert '>a_fails</a>, <span class="bad">which failed: ValueError: a reason' in index
    assert "no picture; a_fails: ValueError: a reason" in index
    assert 'href="b_works.html#A-Fig-9-a"' in index and "1 check passed in its section" in index
    assert "B Fig. 1, a photograph (left out)" in index
    assert (tmp_path / "report" / "pictures" / "A-Fig-9-a.png").read_bytes() == base64.b64decode(PNG)


def test_a_figure_that_its_notebook_does_not_draw_is_named(tmp_path, capsys):
    (tmp_path / "README.md").write_text(TABLE.split("| B Fig. 2")[0].replace("a_fails", "b_works"), encoding="utf-8")
    (tmp_path / "notebooks").mkdir()
    write(tmp_path / "notebooks", "b_works", f"{DRAW}\n'A Fig. 9(a)'; 'A Fig. 16(b)'", "print('A Fig. 17')")
    assert main([str(tmp_path / "notebooks"), str(tmp_path / "report")]) == 1
    assert "without a picture: A Fig. 17" in capsys.readouterr().out


def test_a_kernel_that_dies_is_an_error_like_others(tmp_path):
    write(tmp_path, "a_dies", "import os", "os._exit(3)")
    write(tmp_path, "b_works", "x = 1")
    assert main([str(tmp_path), str(tmp_path / "report")]) == 1
    assert "DeadKernelError: Kernel died" in (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert (tmp_path / "report" / "b_works.html").is_file()


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT as a terminal does, to all processes of a group")
def test_an_interrupted_report_keeps_what_is_done_and_says_what_is_not(tmp_path):
    write(tmp_path, "a_works", "print('done')")
    write(tmp_path, "b_sleeps", "open('reached', 'w').close()\nimport time\ntime.sleep(1000)")
    write(tmp_path, "c_works", "x = 1")
    report = tmp_path / "report"
    command = [sys.executable, "-m", "hexakin.report", str(tmp_path), str(report)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while process.poll() is None and not (tmp_path / "reached").exists():
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=300)
    assert process.returncode == 130 and "interrupted; the finished" in said and "Traceback" not in said
    assert sorted(path.name for path in report.iterdir()) == ["a_works.html", "index.html", "pictures"]
    index = (report / "index.html").read_text(encoding="utf-8")
    assert "1 of 3 notebooks ran to the end" in index and "; 2 not run." in index
    assert 'href="a_works.html"' in index and 'href="b_sleeps.html"' not in index


def test_stored_outputs_are_shown_without_a_run(tmp_path):
    notebook = notebook_of("# Stored", "open('reached', 'w').close()\nprint('now')")
    notebook.cells[1].outputs = [nbformat.v4.new_output("stream", text="then")]
    nbformat.write(notebook, tmp_path / "a_stored.ipynb")
    assert main([str(tmp_path), str(tmp_path / "report"), "--stored"]) == 0
    assert ">then" in (tmp_path / "report" / "a_stored.html").read_text(encoding="utf-8")
    assert "stored outputs, not run" in (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert not (tmp_path / "reached").exists()


def test_a_folder_without_notebooks_is_named(tmp_path, capsys):
    assert main([str(tmp_path), str(tmp_path / "report")]) == 1
    assert capsys.readouterr() == ("", f"hexakin: {tmp_path}: this folder has no notebooks\n")


def test_a_reference_beside_the_report_is_linked(tmp_path):
    write(tmp_path, "a_page", "1")
    arguments = [str(tmp_path), str(tmp_path / "report"), "--stored"]
    index = tmp_path / "report" / "index.html"
    main(arguments)
    assert "reference/index.html" not in index.read_text(encoding="utf-8")
    (tmp_path / "report" / "reference").mkdir()
    (tmp_path / "report" / "reference" / "index.html").write_text("", encoding="utf-8")
    main(arguments)
    assert 'href="reference/index.html"' in index.read_text(encoding="utf-8")


def test_sliders_are_a_picture_in_the_report(tmp_path):
    cell = "import hexakin as hk\nhk.sliders.body_pose(hk.load_robot('athena'))"
    write(tmp_path, "a_slides", cell)
    assert main([str(tmp_path), str(tmp_path / "report")]) == 0
    page = (tmp_path / "report" / "a_slides.html").read_text(encoding="utf-8")
    assert 'src="data:image/png;base64,' in page and "widget-view" not in page


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_every_rebuilt_figure_of_the_readme_has_a_picture(figure):
    if figure.status != "rebuilt":
        return
    notebook = nbformat.read(ROOT / "notebooks" / f"{figure.notebook}.ipynb", as_version=4)
    pictures = find_pictures(notebook, [f.name for f in FIGURES if f.notebook == figure.notebook])
    (own,) = [picture for picture in pictures if figure.name in picture.figures]
    assert own.png.startswith(b"\x89PNG")


def test_a_picture_shows_the_figures_that_the_code_since_the_picture_before_names():
    notebook = shown(
        "# Title, A Fig. 1",
        "x = 1  # A Fig. 4",
        "DRAW = 'A Fig. 1: one'",
        "titles = ['A Fig. 2', f'{x}: A Fig. 3(b)']",
        "DRAW = titles",
        "print('A Fig. 1')\nDRAW = 'A Fig. 12'",
        "DRAW = 0",
    )
    found = find_pictures(notebook, ["A Fig. 1", "A Fig. 2", "A Fig. 3", "A Fig. 4"])
    assert [(picture.figures, picture.png) for picture in found] == [
        (("A Fig. 1",), b"2"),
        (("A Fig. 2", "A Fig. 3"), b"4"),
    ]


def test_checks_are_those_that_certainly_passed_and_belong_to_the_pictures_section():
    notebook = shown(
        "## One",
        "assert 1\nfor k in range(3):\n    assert k < 3",
        "DRAW = 'A Fig. 1'",
        "def f():\n    assert False\nif False:\n    assert False",
        "assert False",
        "assert not reached",
        "## Two",
        "assert 2",
    )
    notebook.cells[4].outputs = [nbformat.v4.new_output("error", ename="AssertionError", evalue="", traceback=[])]
    notebook.cells[5].execution_count = None
    (picture,) = find_pictures(notebook, ["A Fig. 1"])
    assert picture.checks == 2 and checks_passed(notebook.cells) == 3


def test_verdicts_of_the_figures_are_those_of_the_readmes_table():
    statements = judged_statements()
    assert set(statements) <= {figure.name for figure in FIGURES}
    said = [line.split(" | ") for line in statements_table().splitlines()[2:]]
    of_figure_10 = [cells for cells in said if re.match(r"\| A 10[abc]?,", cells[0])]
    counted = count_verdicts(statements["A Fig. 10"])
    assert sum(counted["rigid"].values()) == len(of_figure_10) == len(statements["A Fig. 10"]) > 0
    for verdict, count in counted["pybullet"].items():
        assert count == sum(cells[2].endswith(f"] {verdict}") for cells in of_figure_10)
    assert sum(map(len, statements.values())) == len(said)


@pytest.mark.parametrize("latex", [r"$\displaystyle \left[\begin{matrix}0 & \tfrac{1}{2}\\a_1 & b\end{matrix}\right]$"])
def test_formulas_are_mathml(latex):
    made = mathml(latex, "block")
    assert made.startswith("<math") and 'display="block"' in made and "<mtable" in made and "\\" not in made


@pytest.mark.parametrize("latex", [r"\left( a < b", r"\notaword{a < b}"])
def test_a_formula_that_cannot_be_read_stays_readable(latex):
    assert mathml(latex) == f'<code class="latex">{latex.replace("<", "&lt;")}</code>'
