"""A notebook as an HTML page that opens without a network.

Formulas are MathML, which browsers draw themselves: nbconvert's own pages leave them to MathJax, from a server.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

from hexakin.exceptions import MissingPackageError
from hexakin.report.figure_table import Picture

try:
    import latex2mathml.converter
    import nbconvert
    import nbformat
    from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath
except ImportError as error:
    raise MissingPackageError(str(error.name), "the report", 'pip install "hexakin[notebooks]"') from error

_TEMPLATE = Path(__file__).with_name("page.html")


@dataclass(frozen=True)
class Page:
    """A notebook and what came of it.

    ``written`` says whether its page is there; ``seconds`` is None of a notebook that was not run, ``error`` empty of
    one that did not fail; ``checks`` counts those that passed, ``pictures`` are those of the papers' figures.
    """

    stem: str
    title: str
    written: bool = False
    seconds: float | None = None
    error: str = ""
    checks: int = 0
    pictures: tuple[Picture, ...] = ()

    @property
    def result(self) -> str:
        """What came of it, in a few words."""
        if self.error:
            return self.error
        if not self.written:
            return "not run"
        return "stored outputs, not run" if self.seconds is None else "ran to the end"


def title_of(notebook: Any, stem: str) -> str:
    """First heading of a notebook (an ``nbformat`` node), or its file's ``stem``."""
    lines = [line for cell in notebook.cells if cell.cell_type == "markdown" for line in cell.source.splitlines()]
    return next((line.removeprefix("# ") for line in lines if line.startswith("# ")), stem)


def write_page(notebook: Any, page: Page, report: Path) -> None:
    """Write a notebook's page, and the files of its pictures that the index shows."""
    exporter = nbconvert.HTMLExporter(
        raw_template=_TEMPLATE.read_text(encoding="utf-8"),
        filters={
            "markdown2html": lambda source: MarkdownWithMath(renderer=_Renderer(escape=False)).render(source),
            "mathml": lambda source: mathml(source, "block"),
        },
    )
    # Widgets in a page need a script from the net; without their state the page shows their pictures.
    kept = {name: value for name, value in notebook.metadata.items() if name != "widgets"}
    notebook = nbformat.from_dict({**notebook, "metadata": kept})
    took = "" if page.seconds is None else f", {page.seconds:.0f} s"
    resources = {"made": f"{page.result}{took}, {now()}", "metadata": {"name": page.title}}
    body, _ = exporter.from_notebook_node(notebook, resources)
    (report / "pictures").mkdir(exist_ok=True)
    for picture in page.pictures:
        write(report / picture_file(picture), picture.png)
    write(report / f"{page.stem}.html", body)


def picture_file(picture: Picture) -> str:
    """Path of a picture in the report's folder."""
    return f"pictures/{picture.anchor}.png"


def write(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    os.replace(temporary, path)


def now() -> str:
    """Date and time, such as ``"2026-01-31 12:00 UTC"``."""
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def mathml(latex: str, display: str = "inline") -> str:
    """LaTeX as MathML, or the LaTeX itself, marked as such, where it cannot be read."""
    source = latex.strip().strip("$")
    with suppress(Exception):  # latex2mathml's errors have no common base
        made = latex2mathml.converter.convert(source, display=display)
        if "\\" not in made:  # it leaves a command that it does not know as it stands
            return made
    return f'<code class="latex">{escape(source)}</code>'


class _Renderer(IPythonRenderer):
    """nbconvert's, with formulas as MathML."""

    def inline_math(self, body: str) -> str:
        return mathml(body)

    def block_math(self, body: str) -> str:
        return mathml(body, "block")

    def latex_environment(self, name: str, body: str) -> str:
        return mathml(f"\\begin{{{name}}}{body}\\end{{{name}}}", "block")
