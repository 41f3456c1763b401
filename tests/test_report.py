import nbformat
import pytest

from hexakin.exceptions import InvalidInputError
from hexakin.report import main


def write(folder, name, *cells):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(f"# Title of {name}")])
    notebook.cells += [nbformat.v4.new_code_cell(cell) for cell in cells]
    nbformat.write(notebook, folder / f"{name}.ipynb")


def test_the_report_has_a_page_for_every_notebook_and_an_index(tmp_path, capsys):
    write(tmp_path, "a_works", "print(6 * 7)")
    write(tmp_path, "b_works", "x = 1")
    assert main([str(tmp_path), str(tmp_path / "report")]) == 0
    assert "42" in (tmp_path / "report" / "a_works.html").read_text()
    index = (tmp_path / "report" / "index.html").read_text()
    assert 'href="a_works.html"' in index and "Title of b_works" in index
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("[1/2] a_works ... ") and printed[1].startswith("[2/2] b_works ... ")


def test_a_failing_notebook_is_named_and_the_others_still_run(tmp_path, capsys):
    write(tmp_path, "a_fails", "raise ValueError('a reason')", "print('never')")
    write(tmp_path, "b_works", "print('after')")
    assert main([str(tmp_path), str(tmp_path / "report")]) == 1
    assert "FAILED: ValueError: a reason" in capsys.readouterr().out
    assert "after" in (tmp_path / "report" / "b_works.html").read_text()
    assert "a reason" in (tmp_path / "report" / "index.html").read_text()


def test_a_folder_without_notebooks_is_named(tmp_path):
    with pytest.raises(InvalidInputError, match="no notebooks there"):
        main([str(tmp_path), str(tmp_path / "report")])


def test_sliders_are_a_picture_in_the_report(tmp_path):
    cell = "import hexakin as hk\nhk.sliders.body_pose(hk.load_robot('athena'))"
    write(tmp_path, "a_slides", cell)
    assert main([str(tmp_path), str(tmp_path / "report")]) == 0
    page = (tmp_path / "report" / "a_slides.html").read_text()
    assert 'src="data:image/png;base64,' in page and "widget-view" not in page
