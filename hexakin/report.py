"""Run every notebook in a fresh kernel and write them as one browsable HTML report.

``python -m hexakin.report NOTEBOOKS REPORT`` reads the folder NOTEBOOKS and writes the folder REPORT.
"""

from __future__ import annotations

import argparse
import html
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from hexakin.exceptions import InvalidInputError, MissingPackageError

try:
    import nbclient
    import nbconvert
    import nbformat
except ImportError as error:
    raise MissingPackageError(str(error.name), "the report", 'pip install "hexakin[notebooks]"') from error


@dataclass(frozen=True)
class Page:
    """One executed notebook: its title, the seconds it took, and its error if it failed."""

    path: Path
    title: str
    seconds: float
    error: str


def run_notebook(path: Path, report: Path) -> Page:
    """Execute a notebook from top to bottom and write it as HTML, whether or not it fails on the way."""
    notebook = nbformat.read(path, as_version=4)
    title = next(
        (line.lstrip("# ") for cell in notebook.cells for line in cell.source.splitlines() if line.startswith("# ")),
        path.stem,
    )
    client = nbclient.NotebookClient(
        notebook, timeout=None, kernel_name="python3", resources={"metadata": {"path": str(path.parent)}},
        # Widgets in a page need a script from the net; without their state the page shows their pictures.
        store_widget_state=False,
    )  # fmt: skip
    start, failure = time.monotonic(), ""
    try:
        # The kernel's own log goes nowhere; what cells write to stderr comes as output all the same.
        client.execute(stderr=subprocess.DEVNULL)
    except nbclient.exceptions.CellExecutionError as error:
        failure = f"{error.ename}: {error.evalue}"
    seconds = time.monotonic() - start
    body, _ = nbconvert.HTMLExporter().from_notebook_node(notebook)
    _write(report / f"{path.stem}.html", body)
    return Page(path, title, seconds, failure)


def write_index(pages: list[Page], report: Path) -> Path:
    """Write ``index.html``, a table of the pages with their run times."""
    rows = "\n".join(
        f'<tr><td><a href="{page.path.stem}.html">{html.escape(page.path.stem)}</a></td>'
        f"<td>{html.escape(page.title)}</td><td>{page.seconds:.0f} s</td>"
        f"<td>{html.escape(page.error) or 'ran to the end'}</td></tr>"
        for page in pages
    )
    _write(
        report / "index.html",
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>hexakin: report</title>\n'
        "<style>body{font-family:sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
        "table{border-collapse:collapse}td,th{border-bottom:1px solid #ccc;padding:.4em .8em;text-align:left}</style>"
        "</head><body>\n<h1>hexakin: report</h1>\n"
        "<p>Every notebook, run from top to bottom in a fresh kernel.</p>\n"
        f"<table><tr><th>Notebook</th><th>Title</th><th>Run time</th><th>Result</th></tr>\n{rows}\n</table>\n"
        "</body></html>\n",
    )
    return report / "index.html"


def _write(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def main(arguments: list[str] | None = None) -> int:
    """Run all notebooks of a folder; the exit code is 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m hexakin.report", description=__doc__)
    parser.add_argument("notebooks", type=Path)
    parser.add_argument("report", type=Path)
    options = parser.parse_args(arguments)
    paths = sorted(options.notebooks.glob("*.ipynb"))
    if not paths:
        raise InvalidInputError(f"{options.notebooks}: no notebooks there")
    options.report.mkdir(parents=True, exist_ok=True)
    pages = []
    for number, path in enumerate(paths, start=1):
        print(f"[{number}/{len(paths)}] {path.stem} ...", end=" ", flush=True)
        pages.append(run_notebook(path, options.report))
        print(f"{pages[-1].seconds:.0f} s" + (f"  FAILED: {pages[-1].error}" if pages[-1].error else ""), flush=True)
    index = write_index(pages, options.report)
    failed = [page.path.stem for page in pages if page.error]
    print(f"Report: {index}" + (f" (failed: {', '.join(failed)})" if failed else ""))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
