"""Gait diagrams: which feet are on the ground when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from hexakin.figure_style import GREY
from hexakin.gait import Gait


def draw_gait(ax: Axes, gait: Gait, names: Sequence[str], cycles: float = 2.0) -> None:
    """Draw a gait's diagram: a bar for each leg while its foot is on the ground, over ``cycles`` of the gait.

    ``names`` are the legs', from top to bottom. The time axis counts cycles.
    """
    for leg, (offset, name) in enumerate(zip(gait.offsets, names, strict=True)):
        lands = offset + 1.0 - gait.duty_factor
        starts = np.arange(np.floor(-lands) - 1.0, cycles + 1.0) + lands
        left, right = np.clip(starts, 0.0, cycles), np.clip(starts + gait.duty_factor, 0.0, cycles)
        seen = right > left
        ax.barh(leg, (right - left)[seen], left=left[seen], height=0.62, color="0.25", label=name)
    ax.set_yticks(range(gait.num_legs), names)
    ax.invert_yaxis()
    ax.set(xlim=(0.0, cycles), xlabel="cycles", title=f"{gait.name}, duty factor {gait.duty_factor:.2g}")
    ax.set_facecolor("w")
    ax.grid(axis="x", color=GREY, alpha=0.4)
    ax.grid(axis="y", visible=False)
