"""The index of the report: all figures with pictures and verdicts, all notebooks, and the versions that made them."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from hexakin import installation
from hexakin.exceptions import MissingPackageError
from hexakin.report import INSTALL
from hexakin.report.figure_table import Figure, Judged, Picture, count_verdicts
from hexakin.report.page import Page, now, picture_file, write
from hexakin.study import provenance

try:
    import jinja2
except ImportError as error:
    raise MissingPackageError(str(error.name), "the report", INSTALL) from error

_TEMPLATE = Path(__file__).with_name("index.html")
PACKAGES = (*provenance.PACKAGES, "casadi", "sympy", "pandas", "matplotlib", "meshcat", "nbclient", "nbconvert")
"""Packages whose versions are listed in the index."""


@dataclass(frozen=True)
class Card:
    """A picture with the figures that it shows, or one figure without a picture.

    ``picture`` is None for a figure without one, and ``missing`` then gives the reason. ``error`` is the error of the
    notebook, or empty; ``statements`` are paper A's statements on the figures.
    """

    figures: tuple[Figure, ...]
    notebook: str
    picture: Picture | None
    missing: str
    error: str
    statements: tuple[Judged, ...]

    @property
    def image(self) -> str:
        """Path of the picture's file, empty without a picture."""
        return picture_file(self.picture) if self.picture else ""

    @property
    def link(self) -> str:
        """Link to the picture in the page of its notebook, empty without a picture."""
        return f"{self.notebook}.html#{self.picture.anchor}" if self.picture else ""

    @property
    def checks(self) -> str:
        """Text with the number of checks in the picture's section; empty if there are statements and no checks."""
        count = self.picture.checks if self.picture else 0
        if count == 0:
            return "" if self.statements else "no checks in its section of "
        return f"{count} check{'' if count == 1 else 's'} passed in its section of "

    @property
    def counts(self) -> dict[str, dict[str, int]]:
        """The statements' verdicts, by engine."""
        return count_verdicts(self.statements)


def cards(figures: Sequence[Figure], pages: Sequence[Page], statements: Mapping[str, Sequence[Judged]]) -> list[Card]:
    """Return a card for each picture of rebuilt figures and for each rebuilt figure without a picture.

    ``figures`` are the rows of the README's table, which give the order; ``statements`` are paper A's statements by
    figure.
    """
    made: list[Card] = []
    by_stem = {page.stem: page for page in pages}
    for figure in figures:
        if figure.status != "rebuilt" or any(figure in card.figures for card in made):
            continue
        page = by_stem.get(figure.notebook, Page(figure.notebook, figure.notebook))
        picture = next((p for p in page.pictures if figure.name in p.figures), None)
        shown = [f for f in figures if f.notebook == figure.notebook and picture and f.name in picture.figures]
        said = tuple(s for f in shown or [figure] for s in statements.get(f.name, ()))
        missing = "" if picture else f"no picture; {page.stem}: {page.result}"
        made.append(Card(tuple(shown or [figure]), page.stem, picture, missing, page.error, said))
    return made


def write_index(
    pages: Sequence[Page], figures: Sequence[Figure], statements: Mapping[str, Sequence[Judged]], report: Path
) -> Path:
    """Write ``index.html`` into the folder ``report`` and return its path.

    ``pages`` may contain notebooks that have not run. The index has a link to the library's reference if the folder
    ``report/reference`` exists.
    """
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    template = environment.from_string(_TEMPLATE.read_text(encoding="utf-8"))
    sections = []
    for paper in sorted({figure.name[0] for figure in figures}):
        own = [figure for figure in figures if figure.name.startswith(paper)]
        made = cards(own, pages, statements)
        said = [statement for card in made for statement in card.statements]
        left_out = [figure for figure in own if figure.status != "rebuilt"]
        sections.append(
            {"paper": paper, "cards": made, "number": len(said), "counts": count_verdicts(said), "left_out": left_out}
        )
    page = template.render(
        progress=_progress(pages), drawn=_drawn(figures, pages), made=made_by(), pages=pages, sections=sections,
        reference=(report / "reference" / "index.html").exists(),  # made by: make reference
    )  # fmt: skip
    write(report / "index.html", page)
    return report / "index.html"


def _progress(pages: Sequence[Page]) -> str:
    ran = [page for page in pages if page.seconds is not None]
    well = [page for page in ran if not page.error]
    seconds = sum(page.seconds or 0.0 for page in ran)
    took = f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.1f} min"
    said = [f"{len(well)} of {len(pages)} notebooks ran to the end, in {took}"] if ran else [f"{len(pages)} notebooks"]
    for count, what in (
        (len(ran) - len(well), "failed"),
        (sum(page.written and page.seconds is None for page in pages), "with stored outputs, not run"),
        (sum(not page.written for page in pages), "not run"),
    ):
        if count:
            said.append(f"{count} {what}")
    return "; ".join(said) + "."


def _drawn(figures: Sequence[Figure], pages: Sequence[Page]) -> str:
    if not figures:
        return ""
    names = {name for page in pages for picture in page.pictures for name in picture.figures}
    count = sum(figure.name in names for figure in figures)
    return f"{count} of the papers' {len(figures)} figures have a picture here."


def made_by() -> dict[str, str]:
    """Return date, commit, machine, system and versions of the packages with which the report was made."""
    machine = provenance.machine()
    versions = installation.versions(PACKAGES)
    versions = {"Python": versions.pop("python"), **versions}
    found = {"date": now()}
    if "commit" in machine:
        found["commit"] = machine["commit"]
    found["machine"] = f"{_processor()}, {os.cpu_count()} cores"
    found["system"] = _system()
    found["versions"] = ", ".join(f"{name} {version}" for name, version in versions.items())
    return found


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _system() -> str:
    with suppress(OSError):
        return f"{platform.freedesktop_os_release()['PRETTY_NAME']}, {platform.system()} {platform.release()}"
    return platform.platform()
