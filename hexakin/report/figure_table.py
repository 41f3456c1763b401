"""Which picture of an executed notebook shows which figure of the papers, and what is known of the figure.

A picture shows the figures that the code names, as ``"A Fig. 10"`` in a string (a title, a label, an argument), since
the picture before: what is written on it. A figure that is named again later stays with its first picture.
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
    """A row of the README's table of figures: ``name`` as ``"A Fig. 10"``, and what stands beside it there."""

    name: str
    shows: str
    notebook: str
    status: str


@dataclass(frozen=True)
class Picture:
    """A notebook's picture: the names of the figures on it, its PNG file, and the checks that passed in its section."""

    figures: tuple[str, ...]
    png: bytes
    checks: int

    @property
    def anchor(self) -> str:
        """Its place in the notebook's page, and the name of its file."""
        return re.sub(r"\W+", "-", self.figures[0]).strip("-")


def figure_table(readme: Path) -> list[Figure]:
    """Rows of the table of figures in a README; none without such a file or table."""
    if not readme.is_file():
        return []
    row = re.compile(r"^\| ([AB] Fig\. [^|]+?) \| ([^|]+?) \|([^|]*)\| ([^|]+?) \|$", re.MULTILINE)
    return [
        Figure(name, shows, notebook.strip(" `"), status)
        for name, shows, notebook, status in row.findall(readme.read_text(encoding="utf-8"))
    ]


def find_pictures(notebook: Any, names: Iterable[str]) -> list[Picture]:
    """Pictures of an executed notebook (an ``nbformat`` node) that show the figures named, in their order."""
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
    """Assert statements in those of the code cells that ran to their end.

    One in a loop counts once. Those in functions and under conditions are left out: they may not have been reached.
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
    """What the code has in strings, not in comments: these mention figures of other pictures too."""
    constants = [node.value for node in ast.walk(_tree(source)) if isinstance(node, ast.Constant)]
    return "\n".join(value for value in constants if isinstance(value, str))


def _tree(source: str) -> ast.Module:
    try:
        return ast.parse(source)
    except SyntaxError:  # such a cell has failed
        return ast.Module([], [])


def _section(cells: list[Any], k: int) -> list[Any]:
    """Cells from the heading above cell ``k`` to the next one."""
    heads = [i for i, c in enumerate(cells) if c.cell_type == "markdown" and re.search(r"^#+ ", c.source, re.MULTILINE)]
    start = max((i for i in heads if i < k), default=0)
    return cells[start : min((i for i in heads if i > k), default=len(cells))]


@dataclass(frozen=True)
class Judged:
    """A statement of paper A: its words and, by engine, what was found and the verdict."""

    claim: str
    found: Mapping[str, tuple[str, str]]


def judged_statements() -> dict[str, list[Judged]]:
    """Paper A's statements by the figure they are about, as ``"A Fig. 10"``, judged from the committed results."""
    table = results.statement_verdicts()
    statements: dict[str, list[Judged]] = {}
    for _, rows in table.groupby("id", sort=False):
        name = "A Fig. " + rows["figure"].iloc[0].split()[1].rstrip("abc")
        found = {row.engine: (finding(row), row.verdict) for row in rows.itertuples(index=False)}
        statements.setdefault(name, []).append(Judged(rows["claim"].iloc[0], found))
    return statements


def count_verdicts(statements: Iterable[Judged]) -> dict[str, dict[str, int]]:
    """How many of the statements have each verdict, by engine; verdicts that none has are left out."""
    pairs = [(engine, verdict) for s in statements for engine, (_, verdict) in s.found.items()]
    table = pd.DataFrame(pairs, columns=["engine", "verdict"])
    return {
        engine: {v: int((own["verdict"] == v).sum()) for v in VERDICTS if (own["verdict"] == v).any()}
        for engine, own in table.groupby("engine")
    }
