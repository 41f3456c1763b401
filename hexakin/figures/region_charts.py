"""Charts for feasibility: contact forces, regions of the centre of mass, and samples around an optimum."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_flags, check_number, check_shape, checked
from hexakin.exceptions import InvalidInputError
from hexakin.figures.style import BLUE, GREEN, GREY, MM, ORANGE, PURPLE, RED, check_colours

_REGION_COLOURS = (BLUE, ORANGE, GREEN, PURPLE)


@checked
def draw_forces(ax: Axes, points: ArrayLike, forces: ArrayLike, *, scale: float, colour: str = RED) -> None:
    """Draw forces as arrows on ``ax``.

    ``forces`` (k, d) [N] begin at ``points`` (k, d) [m]; d is 3 on 3D axes, otherwise 2. An arrow is ``scale`` [m/N]
    times its force long and has the colour ``colour``. Forces of zero are not drawn. Raises InvalidInputError if the
    shapes are others.
    """
    dimensions = 3 if getattr(ax, "name", "") == "3d" else 2
    start = check_shape("points", points, (None, dimensions), ("point", "coordinate"))
    arrow = check_shape("forces", forces, start.shape, ("point", "coordinate"))
    check_number("scale", scale, above=0.0, unit="m/N")
    check_colours("colour", [colour])
    long = np.linalg.norm(arrow, axis=1) > 0.0
    begin, way = MM * start[long], MM * scale * arrow[long]
    if dimensions == 3:
        ax.quiver(*begin.T, *way.T, color=colour, lw=1.8, arrow_length_ratio=0.18, zorder=6)
    else:
        at: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
        ax.quiver(*begin.T, *way.T, color=colour, width=0.007, zorder=4, **at)


@checked
def draw_regions(
    ax: Axes,
    feet: ArrayLike,
    regions: Mapping[str, ArrayLike],
    center_of_mass: ArrayLike,
    polygon: ArrayLike | None = None,
) -> None:
    """Draw regions of the centre of mass and the feet, seen from above, with labels for a legend.

    Parameters
    ----------
    ax
        Axes to draw on.
    feet
        Places of the feet, (k, 2) or (k, 3) [m].
    regions
        By name the vertices of a region, (m, 2) [m], with m = 0 if it is empty. Later regions cover earlier ones.
    center_of_mass
        Place of the centre of mass, (2,) or (3,) [m].
    polygon
        Vertices of the support polygon, (m, 2) [m], drawn as a dashed line; None draws none.

    Raises
    ------
    InvalidInputError
        For other shapes, and for more regions than there are colours (4).
    """
    places, center = _seen_from_above("feet", feet, 2), _seen_from_above("center_of_mass", center_of_mass, 1)
    corners = {name: _vertices(f"regions: {name}", vertices) for name, vertices in regions.items()}
    if len(corners) > len(_REGION_COLOURS):
        raise InvalidInputError(f"regions: {len(corners)}, expected at most {len(_REGION_COLOURS)}")
    if polygon is not None:
        outline = MM * _vertices("polygon", polygon)
        ax.fill(*outline.T, fill=False, edgecolor="k", ls="--", lw=1.2, zorder=4, label="polygon")
    for colour, (name, vertices) in zip(_REGION_COLOURS, corners.items(), strict=False):
        light = 0.4 * np.array(to_rgb(colour)) + 0.6  # opaque, so that no other region shines through
        ax.fill(*(MM * vertices).T, facecolor=light, edgecolor=colour, lw=1.5, zorder=2, label=name)
    ax.plot(*(MM * places).T, "o", color=GREY, mec="k", ms=7, ls="none", zorder=5, label="feet")
    ax.plot(*(MM * center), "P", color="k", ms=7, ls="none", zorder=6, label="centre of mass")
    ax.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")


def _seen_from_above(name: str, value: ArrayLike, dimensions: int) -> Array:
    """Return x and y (..., 2) of places with two or three coordinates."""
    places = check_array(name, value, ())
    if places.ndim != dimensions or places.shape[-1] not in (2, 3):
        leading = "k, " if dimensions == 2 else ""
        raise InvalidInputError(f"{name}: expected shape ({leading}2) or ({leading}3), got {places.shape}")
    return places[..., :2]


def _vertices(name: str, value: ArrayLike) -> Array:
    """Return vertices (m, 2); an empty list has none."""
    return check_shape(name, value, (None, 2)) if np.size(check_array(name, value, ())) else np.zeros((0, 2))


@checked
def draw_samples(ax: Axes, x: ArrayLike, y: ArrayLike, feasible: ArrayLike) -> None:
    """Draw samples of two design parameters on ``ax``: dots where the motion is feasible, crosses where it is not.

    ``x`` (n,) and ``y`` (n,) are the parameters, in the units of the axes, which the caller labels; ``feasible`` (n,)
    bool. Raises InvalidInputError for other shapes.
    """
    across = check_shape("x", x, (None,))
    up, good = check_shape("y", y, across.shape), check_flags("feasible", feasible, across.shape)
    ax.plot(across[good], up[good], "o", color=GREEN, ms=4, ls="none", zorder=3, label="sample: possible")
    ax.plot(across[~good], up[~good], "x", color=RED, ms=4.5, mew=1.2, ls="none", zorder=3, label="sample: impossible")
