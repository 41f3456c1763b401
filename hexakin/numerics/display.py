"""How values with long arrays are shown: in one line in a terminal, as a table in a notebook."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from hexakin.exceptions import shown

_FEW = 4  # an array of up to this many numbers is printed itself, a longer one by its shape
_LONGEST = 100  # characters of one value, and of one cell
_CAPTION = 300  # characters of a caption
_LARGEST = 8000  # characters of the rows of a table in a notebook; rows beyond are counted


def short_repr(value: Any) -> str:
    """Return the fields of a dataclass or a NamedTuple in one line, with the shapes of arrays and the names of entries.

    It serves as the ``__repr__`` of classes with long arrays: ``Motion(time (200,), q (200, 6, 3), touch 1e-06)``.
    """
    names = [part.name for part in fields(value) if part.repr] if is_dataclass(value) else value._fields
    parts = [f"{name} {_short(getattr(value, name))}" for name in names]
    return f"{type(value).__name__}({', '.join(parts)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        if value.ndim > 1 or value.size > _FEW:
            return str(value.shape)
        text = np.array2string(value, precision=4, separator=", ")
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(map(str, value)) + "}"
    elif isinstance(value, (tuple, list)) and len(value) > _FEW:
        return f"{len(value)} values"
    else:
        return shown(value)
    return _cut(text)


def _cut(text: str, longest: int = _LONGEST) -> str:
    """Return ``text`` in one line and without its end, if it is long."""
    line = " ".join(text.split())
    return line if len(line) <= longest else f"{line[: longest - 3]}..."


def spread(values: np.ndarray) -> str:
    """Return the range of an array's finite numbers, or the share of its flags that are true, as a text."""
    if not values.size:
        return "empty"
    if values.dtype.kind == "b":
        return f"{100.0 * values.mean():.3g} % true"
    if values.dtype.kind not in "iuf":
        return ""
    known = values[np.isfinite(values)]
    if not known.size:
        return "not finite"
    least, most = known.min(), known.max()
    text = f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
    return text if known.size == values.size else f"{text}, {1.0 - known.size / values.size:.3%} not finite"


def html_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as HTML for a notebook, of at most about 10 kB and without scripts.

    ``caption`` stands above the table, ``head`` are the titles of its columns, and ``rows`` their texts. All texts are
    escaped, and cut if they are long. Rows that would make the table too large are only counted.
    """
    lines: list[str] = []
    left, size = 0, 0
    for row in rows:
        line = _row("td", row)
        size += len(line)
        if left or size > _LARGEST:
            left += 1
        else:
            lines.append(line)
    if left:
        lines.append(_row("td", [f"... and {left} more"]))
    return "\n".join(
        [
            "<table>",
            f'<caption style="text-align: left">{html.escape(_cut(caption, _CAPTION))}</caption>',
            f"<thead>{_row('th', head)}</thead>",
            "<tbody>",
            *lines,
            "</tbody>",
            "</table>",
        ]
    )


def _row(cell: str, texts: Sequence[str]) -> str:
    cells = "".join(f'<{cell} style="text-align: left">{html.escape(_cut(text))}</{cell}>' for text in texts)
    return f"<tr>{cells}</tr>"
