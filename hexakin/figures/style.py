"""The style of all figures, and how a figure is written to a file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.colors import is_color_like
from matplotlib.figure import Figure

from hexakin.checks import check_path, checked
from hexakin.checks.files import whole_file
from hexakin.exceptions import InvalidInputError, shown

# The colours of Okabe and Ito, which colour-blind readers can tell apart.
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#7f7f7f"
LEG_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, "#56B4E9", "#999933", "#332288")
SIMPLE, CONTROLLED = GREY, BLUE
ENGINE_COLOURS = {"pybullet": ORANGE, "rigid": BLUE, "mujoco": GREEN}
MM = 1e3

STYLE: dict[str, Any] = {
    "figure.dpi": 100,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "axes.prop_cycle": plt.cycler(color=LEG_COLOURS),
}


def use_style() -> None:
    """Set the style of all figures that are made after this call."""
    plt.rcParams.update(STYLE)  # type: ignore[arg-type]


def check_colours(name: str, colours: Iterable[object]) -> None:
    """Raise InvalidInputError if matplotlib does not know one of ``colours``; ``name`` is the argument's name."""
    for colour in colours:
        if not is_color_like(colour):
            raise InvalidInputError(f"{name}: {shown(colour)} is no colour of matplotlib")


@checked
def save_pdf(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write ``figure`` as a PDF file of vector graphics, and return its path.

    The page has the size of the figure, so that figures of the same width also have it on paper. Fonts are embedded as
    TrueType, and equal figures give equal files. ``.pdf`` is added to ``path`` if it is missing. If writing fails, a
    file that was there before stays as it was. Raises InvalidInputError if ``path`` is no path, and FileError if the
    file cannot be written.
    """
    target = check_path("path", path, ".pdf")
    with whole_file(target) as temporary, plt.rc_context({"pdf.fonttype": 42, "savefig.bbox": None}):
        figure.savefig(temporary, format="pdf", metadata={"CreationDate": None})
    return target
