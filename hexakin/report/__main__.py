"""Run every notebook in a fresh kernel and write all of them as one HTML report.

``python -m hexakin.report NOTEBOOKS REPORT`` reads the folder NOTEBOOKS and writes the folder REPORT. Its index
shows the figures that the README beside NOTEBOOKS lists, if there is one.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from hexakin.checks.files import read_bytes
from hexakin.exceptions import FileError, InvalidInputError, MissingPackageError, exit_code
from hexakin.report import INSTALL
from hexakin.report.figure_table import Figure, checks_passed, figure_table, find_pictures, judged_statements
from hexakin.report.index import write_index
from hexakin.report.page import Page, title_of, write_page

try:
    import nbclient
    import nbformat
except ImportError as error:
    raise MissingPackageError(str(error.name), "the report", INSTALL) from error

_LARGEST = 2**26  # [bytes] a notebook with pictures has about a megabyte


def run(notebook: Any, folder: Path) -> tuple[float, str]:
    """Run a notebook (an ``nbformat`` node) in ``folder``; return its time [s] and its error, ``""`` without one."""
    client = nbclient.NotebookClient(
        notebook, timeout=None, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    start, failure = time.monotonic(), ""
    try:
        # This drops the kernel's own log only. Text that cells write to stderr is still an output of the cell.
        client.execute(stderr=subprocess.DEVNULL)
    except Exception as error:
        if hasattr(client, "_async_cleanup_kernel_future"):
            # nbclient handles SIGINT and SIGTERM: it ends the kernel and then raises one of several errors.
            raise KeyboardInterrupt from error
        if isinstance(error, nbclient.exceptions.CellExecutionError):
            failure = f"{error.ename}: {error.evalue}"
        elif isinstance(error, nbclient.exceptions.DeadKernelError):
            failure = f"DeadKernelError: {error}"
        else:
            raise
    return time.monotonic() - start, failure


def _notebook(path: Path) -> Any:
    """Return the notebook in a file."""
    text = read_bytes(path, _LARGEST)
    try:
        return nbformat.reads(text.decode(), as_version=4)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise FileError(f"{path}: not a notebook ({error})") from error


def make_page(path: Path, report: Path, names: list[str], stored: bool = False) -> Page:
    """Run the notebook at ``path`` and write its page into the folder ``report``, even if the notebook fails.

    ``names`` are the names of the figures to look for. With ``stored`` the notebook is not run, and the page shows its
    stored outputs.
    """
    notebook = _notebook(path)
    page = Page(path.stem, title_of(notebook, path.stem), written=True)
    if stored:
        errors = [o for cell in notebook.cells for o in cell.get("outputs", []) if o.output_type == "error"]
        page = replace(page, error=f"{errors[0].ename}: {errors[0].evalue}" if errors else "")
    else:
        for cell in notebook.cells:
            if cell.cell_type == "code":  # a cell that is not reached must not show old outputs
                cell.outputs, cell.execution_count = [], None
        seconds, failure = run(notebook, path.parent)
        page = replace(page, seconds=seconds, error=failure)
    page = replace(page, checks=checks_passed(notebook.cells), pictures=tuple(find_pictures(notebook, names)))
    write_page(notebook, page, report)
    return page


def missing_figures(figures: list[Figure], pages: list[Page]) -> list[str]:
    """Return the names of rebuilt figures that have no picture although their notebook did not fail."""
    drawn = {(page.stem, name) for page in pages for picture in page.pictures for name in picture.figures}
    failed = {page.stem for page in pages if page.error}
    wanted = [f for f in figures if f.status == "rebuilt" and f.notebook not in failed]
    return [f.name for f in wanted if (f.notebook, f.name) not in drawn]


def main(arguments: list[str] | None = None) -> int:
    """Run all notebooks of a folder and return the exit code.

    It is 1 after an error, if a notebook failed or if a figure has no picture, 130 after an interruption, otherwise 0.
    ``arguments`` are those of the command line, None for the program's own.
    """
    return exit_code(lambda: _run(arguments))


def _run(arguments: list[str] | None) -> int:
    parser = argparse.ArgumentParser(prog="python -m hexakin.report", description=__doc__)
    parser.add_argument("notebooks", type=Path)
    parser.add_argument("report", type=Path)
    parser.add_argument("--stored", action="store_true", help="show the outputs stored in the notebooks, without a run")
    options = parser.parse_args(arguments)
    paths = sorted(options.notebooks.glob("*.ipynb"))
    if not paths:
        raise InvalidInputError(f"{options.notebooks}: this folder has no notebooks")
    try:
        options.report.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{options.report}: this folder cannot be made ({error.strerror or error})") from error
    figures = figure_table(options.notebooks.resolve().parent / "README.md")
    statements = judged_statements() if figures else {}
    pages = [Page(path.stem, title_of(_notebook(path), path.stem)) for path in paths]
    try:
        for number, path in enumerate(paths, start=1):
            index = write_index(pages, figures, statements, options.report)
            print(f"[{number}/{len(paths)}] {path.stem} ...", end=" ", flush=True)
            names = [figure.name for figure in figures if figure.notebook == path.stem]
            page = pages[number - 1] = make_page(path, options.report, names, options.stored)
            took = "" if page.seconds is None else f"{page.seconds:.0f} s"
            said = f"FAILED: {page.error}" if page.error else "" if took else page.result
            print("  ".join(filter(None, (took, said))), flush=True)
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"the finished notebooks are in {options.report}/index.html") from error
    index = write_index(pages, figures, statements, options.report)
    failed = [page.stem for page in pages if page.error]
    missing = missing_figures(figures, pages)
    print(f"Report: {index}" + (f" (failed: {', '.join(failed)})" if failed else ""))
    if missing:
        print(f"Figures of the README's table without a picture: {', '.join(missing)}")
    return 1 if failed or missing else 0


if __name__ == "__main__":
    sys.exit(main())
