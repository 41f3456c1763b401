"""Which picture of an executed notebook shows which figure of the papers, with the verdicts on the figure.

A picture shows the figures whose names, such as ``"A Fig. 10"``, are in strings of the code (a title, a label, an
argument) after the previous picture. If a figure is named again later, only its first picture counts.
"""

from __future__ import annotations

import ast
import base64
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from hexakin.papers import results
from hexakin.papers.statements import VERDICTS, finding


@dataclass(frozen=True)
class Figure:
    """A row of the README's table of figures: ``name``, such as ``"A Fig. 10"``, and the other columns."""

    name: str
    shows: str
    notebook: str
    status: str


@dataclass(frozen=True)
class Picture:
    """A picture of a notebook: names of its ``figures``, ``png`` file, number of ``checks`` passed in its section."""

    figures: tuple[str, ...]
    png: bytes
    checks: int

    @property
    def anchor(self) -> str:
        """The picture's anchor in the page of the notebook, and the stem of its file name."""
        return re.sub(r"\W+", "-", self.figures[0]).strip("-")


def figure_table(readme: Path) -> list[Figure]:
    """Return the rows of the table of figures in a README; an empty list if there is no such file or table."""
    if not readme.is_file():
        return []
    row = re.compile(r"^\| ([AB] Fig\. [^|]+?) \| ([^|]+?) \|([^|]*)\| ([^|]+?) \|$", re.MULTILINE)
    return [
        Figure(name, shows, notebook.strip(" `"), status)
        for name, shows, notebook, status in row.findall(readme.read_text(encoding="utf-8"))
    ]


def find_pictures(notebook: Any, names: Iterable[str]) -> list[Picture]:
    """Return the pictures of an executed notebook (an ``nbformat`` node) that show figures in ``names``, in order."""
    left, named, found = list(names), [], []
    for k, cell in enumerate(notebook.cells):
        if cell.cell_type != "code":
            continue
        text = _strings(cell.source)
        named += [name for name in left if name not in named and re.search(re.escape(name) + r"(?!\d)", text)]
        for output in cell.outputs:
            png = output.get("data", {}).get("image/png")
            if png and named:
                picture = Picture(tuple(named), base64.b64decode(png), checks_passed(_section(notebook.cells, k)))
                output.metadata["figure"] = {"anchor": picture.anchor, "names": ", ".join(named)}
                found.append(picture)
                left, named = [name for name in left if name not in named], []
    return found


def checks_passed(cells: Iterable[Any]) -> int:
    """Return the number of assert statements in code cells that ran to their end.

    An assert statement in a loop counts once. Those in functions and under conditions do not count, because they may
    not have been reached.
    """
    count = 0
    for cell in cells:
        failed = any(output.output_type == "error" for output in cell.get("outputs", []))
        if cell.cell_type == "code" and cell.execution_count is not None and not failed:
            count += _asserts(_tree(cell.source).body)
    return count


def _asserts(statements: list[ast.stmt]) -> int:
    inside = [s.body for s in statements if isinstance(s, ast.For | ast.With)]
    return sum(isinstance(s, ast.Assert) for s in statements) + sum(_asserts(body) for body in inside)


def _strings(source: str) -> str:
    """Return the strings in code, without comments, which also mention figures of other pictures."""
    constants = [node.value for node in ast.walk(_tree(source)) if isinstance(node, ast.Constant)]
    return "\n".join(value for value in constants if isinstance(value, str))


def _tree(source: str) -> ast.Module:
    try:
        return ast.parse(source)
    except SyntaxError:  # such a cell fails
        return ast.Module([], [])


def _section(cells: list[Any], k: int) -> list[Any]:
    """Return the cells from the heading above cell ``k`` to the next heading."""
    heads = [i for i, c in enumerate(cells) if c.cell_type == "markdown" and re.search(r"^#+ ", c.source, re.MULTILINE)]
    start = max((i for i in heads if i < k), default=0)
    return cells[start : min((i for i in heads if i > k), default=len(cells))]


@dataclass(frozen=True)
class Judged:
    """A statement of paper A: the ``claim``, and ``found`` by engine: the result and the verdict."""

    claim: str
    found: Mapping[str, tuple[str, str]]


def judged_statements() -> dict[str, list[Judged]]:
    """Return paper A's statements by figure, such as ``"A Fig. 10"``, with verdicts from the committed results."""
    table = results.statement_verdicts()
    statements: dict[str, list[Judged]] = {}
    for _, rows in table.groupby("id", sort=False):
        name = "A Fig. " + rows["figure"].iloc[0].split()[1].rstrip("abc")
        found = {row.engine: (finding(row), row.verdict) for row in rows.itertuples(index=False)}
        statements.setdefault(name, []).append(Judged(rows["claim"].iloc[0], found))
    return statements


def count_verdicts(statements: Iterable[Judged]) -> dict[str, dict[str, int]]:
    """Return by engine the number of statements with each verdict; verdicts without statements are left out."""
    pairs = [(engine, verdict) for s in statements for engine, (_, verdict) in s.found.items()]
    table = pd.DataFrame(pairs, columns=["engine", "verdict"])
    return {
        engine: {v: int((own["verdict"] == v).sum()) for v in VERDICTS if (own["verdict"] == v).any()}
        for engine, own in table.groupby("engine")
    }
