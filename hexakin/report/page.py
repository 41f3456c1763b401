"""A notebook as an HTML page that opens without a network.

Formulas are MathML, which browsers can draw. The pages of nbconvert would load MathJax from a server for them.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

from hexakin.checks.files import whole_file
from hexakin.exceptions import MissingPackageError
from hexakin.report import INSTALL
from hexakin.report.figure_table import Picture

try:
    import latex2mathml.converter
    import nbconvert
    import nbformat
    from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath
except ImportError as error:
    raise MissingPackageError(str(error.name), "the report", INSTALL) from error

_TEMPLATE = Path(__file__).with_name("page.html")


@dataclass(frozen=True)
class Page:
    """A notebook and the result of its run.

    ``written`` is whether its page exists; ``seconds`` [s] is None if the notebook was not run; ``error`` is empty if
    it did not fail; ``checks`` is the number of checks that passed; ``pictures`` show figures of the papers.
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
        """The result in a few words."""
        if self.error:
            return self.error
        if not self.written:
            return "not run"
        return "stored outputs, not run" if self.seconds is None else "ran to the end"


def title_of(notebook: Any, stem: str) -> str:
    """Return the first heading of a notebook (an ``nbformat`` node), or the ``stem`` of its file if there is none."""
    lines = [line for cell in notebook.cells if cell.cell_type == "markdown" for line in cell.source.splitlines()]
    return next((line.removeprefix("# ") for line in lines if line.startswith("# ")), stem)


def write_page(notebook: Any, page: Page, report: Path) -> None:
    """Write the page of a notebook and the picture files for the index into the folder ``report``."""
    exporter = nbconvert.HTMLExporter(
        raw_template=_TEMPLATE.read_text(encoding="utf-8"),
        filters={
            "markdown2html": lambda source: MarkdownWithMath(renderer=_Renderer(escape=False)).render(source),
            "mathml": lambda source: mathml(source, "block"),
        },
    )
    # Widgets in a page need a script from a server. Without the state of the widgets, the page shows their pictures.
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
    """Return the path of a picture's file, relative to the folder of the report."""
    return f"pictures/{picture.anchor}.png"


def write(path: Path, content: str | bytes) -> None:
    """Write a file, completely or not at all; raises FileError if it cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def now() -> str:
    """Return date and time, such as ``"2026-01-31 12:00 UTC"``."""
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def mathml(latex: str, display: str = "inline") -> str:
    """Return a LaTeX formula as MathML, or as marked LaTeX code if it cannot be converted.

    ``display`` is "inline" or "block".
    """
    source = latex.strip().strip("$")
    with suppress(Exception):  # latex2mathml's errors have no common base
        made = latex2mathml.converter.convert(source, display=display)
        if "\\" not in made:  # the converter leaves unknown commands unchanged
            return made
    return f'<code class="latex">{escape(source)}</code>'


class _Renderer(IPythonRenderer):
    """The renderer of nbconvert, with formulas as MathML."""

    def inline_math(self, body: str) -> str:
        return mathml(body)

    def block_math(self, body: str) -> str:
        return mathml(body, "block")

    def latex_environment(self, name: str, body: str) -> str:
        return mathml(f"\\begin{{{name}}}{body}\\end{{{name}}}", "block")
