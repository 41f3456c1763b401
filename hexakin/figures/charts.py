"""Charts on given axes: box plots, maps and bars of numbers that were computed elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_same_length, check_shape, checked
from hexakin.exceptions import InvalidInputError
from hexakin.figures.style import ENGINE_COLOURS, GREY, LEG_COLOURS, check_colours

_SUMMARY = ("minimum", "lower quartile", "median", "upper quartile", "maximum")
_MOST_PRINTED = 8  # columns or rows; numbers do not fit into more cells if the map is a third of a page wide


@checked
def box_groups(
    ax: Axes, groups: Sequence[Sequence[ArrayLike]], labels: Sequence[str], colours: Sequence[str], ylabel: str
) -> None:
    """Draw groups of box plots side by side.

    Parameters
    ----------
    ax
        Axes to draw on.
    groups
        For each group its samples, (n,) each, in the unit that ``ylabel`` names. Each sample gets one thin box.
    labels
        Names of the groups, written below them.
    colours
        Colours of the groups.
    ylabel
        Label of the vertical axis, with the unit.

    Raises
    ------
    InvalidInputError
        If there are not as many labels and colours as groups, a group has no sample, or a sample is no list of numbers.
    """
    check_same_length(groups=groups, labels=labels, colours=colours)
    check_colours("colours", colours)
    width, position, ticks = 0.7, 0.0, []
    for label, sample, colour in zip(labels, groups, colours, strict=True):
        values = [check_shape(f"groups: {label}", repeat, (None,)) for repeat in sample]
        if not values:
            raise InvalidInputError(f"groups: {label}: no sample")
        places = position + np.arange(len(values))
        ax.boxplot(
            values,
            positions=list(places),
            widths=width,
            patch_artist=True,
            manage_ticks=False,
            flierprops={"marker": ".", "markersize": 2, "markeredgecolor": colour},
            boxprops={"facecolor": colour, "alpha": 0.6, "linewidth": 0.6},
            medianprops={"color": "k", "linewidth": 1.2},
            whiskerprops={"linewidth": 0.6},
            capprops={"linewidth": 0.6},
        )
        ticks.append(float(places.mean()))
        position = places[-1] + 2.0
    ax.set_xticks(ticks, labels)
    ax.set_ylabel(ylabel)
    ax.grid(axis="x", visible=False)


@checked
def draw_boxes(
    ax: Axes,
    summaries: Mapping[str, ArrayLike],
    levels: Sequence[float] | Sequence[str],
    ylabel: str,
    *,
    xlabel: str = "",
    paper: Sequence[tuple[float | str, float]] = (),
    colours: Mapping[str, str] = ENGINE_COLOURS,
) -> None:
    """Draw box plots from five-number summaries: at each level one box for each engine, side by side.

    Each of the five numbers of a box is its median over the repeats. Whiskers go from minimum to maximum, and dots
    show the median of each repeat. Boxes, dots and marks have labels for a legend, which the caller places::

        draw_boxes(ax, {"pybullet": a, "rigid": b}, [0.0, 0.2, 0.4], "height [mm]", paper=[(0.4, 98.0)])
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=4)

    Parameters
    ----------
    ax
        Axes to draw on.
    summaries
        By engine: minimum, lower quartile, median, upper quartile and maximum, (levels, repeats, 5), in the unit that
        ``ylabel`` names.
    levels
        Numbers, which are placed to scale, or words, which are placed at equal distances.
    xlabel, ylabel
        Labels of the axes, with units.
    paper
        Values (level, y) that the paper reports; each is marked by a diamond.
    colours
        Colours by engine. Engines that are not in it take the colours of the legs in turn.

    Raises
    ------
    InvalidInputError
        If summaries have another shape or are not in ascending order, if a level occurs twice, or if a level of
        ``paper`` is not one of the words in ``levels``.
    """
    places = _places(levels)
    check_colours("colours", list(colours.values()))
    boxes = {name: _check_summary(name, summary, len(places)) for name, summary in summaries.items()}
    gap = float(np.diff(np.sort(places)).min()) if len(places) > 1 else 1.0
    slot = 0.8 * gap / max(len(boxes), 1)
    for k, (name, summary) in enumerate(boxes.items()):
        colour = colours.get(name, LEG_COLOURS[k % len(LEG_COLOURS)])
        centers = places + (k - (len(boxes) - 1) / 2.0) * slot
        middle = np.median(summary, axis=1)  # over repeats
        stats = [dict(zip(("whislo", "q1", "med", "q3", "whishi"), numbers, strict=True)) for numbers in middle]
        drawn = ax.bxp(
            stats,
            positions=centers.tolist(),
            widths=0.84 * slot,
            capwidths=0.4 * slot,
            patch_artist=True,
            showfliers=False,
            manage_ticks=False,
            boxprops={"facecolor": colour, "edgecolor": "k", "linewidth": 0.6},
            medianprops={"color": "k", "linewidth": 1.6},
            whiskerprops={"linewidth": 0.7},
            capprops={"linewidth": 0.7},
            zorder=2,
        )
        drawn["boxes"][0].set_label(name)
        # Fractional parts of multiples of the golden ratio: even for any number of dots, the same in every run.
        jitter = (np.arange(summary.shape[1]) * 0.618034) % 1.0 - 0.5
        x = centers[:, None] + 0.6 * slot * jitter
        label = "median of one repeat" if k == len(boxes) - 1 else None
        ax.plot(x.ravel(), summary[..., 2].ravel(), "o", ms=2.2, mfc="w", mec="k", mew=0.4, zorder=3, label=label)
    marks = [(_place(level, levels), check_number("paper: value", y)) for level, y in paper]
    if marks:
        ax.plot(*np.array(marks).T, "D", color="k", ms=4.5, mec="w", mew=0.6, zorder=4, label="paper")
    words = [level if isinstance(level, str) else f"{level:g}" for level in levels]
    ax.set_xticks(places, words)
    ax.set(xlabel=xlabel, ylabel=ylabel, xlim=(places.min() - 0.55 * gap, places.max() + 0.55 * gap))
    ax.grid(axis="x", visible=False)


@checked
def draw_sweep(
    axes: Sequence[Axes],
    summaries: Mapping[str, Mapping[str, ArrayLike]],
    levels: Sequence[float] | Sequence[str],
    xlabel: str,
    titles: Sequence[str],
    *,
    paper: Mapping[str, Sequence[tuple[float | str, float]]] | None = None,
    colours: Mapping[str, str] = ENGINE_COLOURS,
) -> None:
    """Draw paper A's three panels over a gain: torso height [mm], pitch rate and roll rate [rad/s] per gait cycle.

    One legend for all panels is put below the figure.

    Parameters
    ----------
    axes
        The three axes to draw on, for height, pitch rate and roll rate.
    summaries
        For each of ``"height"`` [m], ``"pitch_rate"`` and ``"roll_rate"`` [rad/s] the five-number summaries by engine,
        (levels, repeats, 5), as for ``draw_boxes``.
    levels
        Values of the gain, or words.
    xlabel
        Name of the gain, below each panel.
    titles
        Title of each panel.
    paper
        For each of the three measures the values (level, y) that the paper reports, in [m] and [rad/s].
    colours
        Colours by engine, as for ``draw_boxes``.

    Raises
    ------
    InvalidInputError
        Under the same conditions as ``draw_boxes``, and unless there are axes, a title and data for each panel.
    """
    reported = paper or {}
    panels = dict.fromkeys(_PANELS)
    check_same_length(axes=axes, titles=titles, panels=panels)
    if missing := [measure for measure in panels if measure not in summaries]:
        raise InvalidInputError(f"summaries: none of {', '.join(missing)}")
    for ax, (measure, (label, unit)), title in zip(axes, _PANELS.items(), titles, strict=True):
        boxes = {
            name: unit * _check_summary(f"{measure}: {name}", summary, len(levels))
            for name, summary in summaries[measure].items()
        }
        marks = [(level, unit * value) for level, value in reported.get(measure, ())]
        draw_boxes(ax, boxes, levels, label, xlabel=xlabel, paper=marks, colours=colours)
        ax.set_ylim(bottom=0.0)
        ax.set_title(title)
    entries = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    axes[0].figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=len(entries))


_PANELS = {
    "height": ("torso height [mm]", 1e3),
    "pitch_rate": ("pitch rate [rad/s]", 1.0),
    "roll_rate": ("roll rate [rad/s]", 1.0),
}


def _places(levels: Sequence[float] | Sequence[str]) -> Array:
    """Return the places (n,) of levels along an axis: numbers at their values, words at 0, 1, ..."""
    named = [isinstance(level, str) for level in levels]
    if not named:
        raise InvalidInputError("levels: expected at least one")
    places = np.arange(len(levels), dtype=float) if all(named) else check_shape("levels", levels, (None,))
    if len(set(levels)) < len(levels):
        raise InvalidInputError(f"levels: {list(levels)!r} contain a level twice")
    return places


def _place(level: float | str, levels: Sequence[float] | Sequence[str]) -> float:
    """Return the place along the axis of a level that is marked."""
    if all(isinstance(known, str) for known in levels):
        if level not in levels:
            raise InvalidInputError(f"paper: level {level!r} is not one of {list(levels)!r}")
        return float(list(levels).index(level))
    return check_number("paper: level", level)  # type: ignore[arg-type]


def _check_summary(name: str, summary: ArrayLike, count: int) -> Array:
    """Return a summary as an array (levels, repeats, 5) whose five numbers ascend, or raise InvalidInputError."""
    values = check_shape(f"summaries: {name}", summary, (count, None, 5), ("level", "repeat", "number"))
    if values.shape[1] == 0:
        raise InvalidInputError(f"summaries: {name}: no repeat")
    wrong = np.argwhere(np.diff(values, axis=-1) < 0.0)
    if len(wrong):
        level, repeat, k = wrong[0]
        below, above = values[level, repeat, k : k + 2]
        raise InvalidInputError(
            f"summaries: {name}: level {level + 1}, repeat {repeat + 1}: "
            f"{_SUMMARY[k]} {below:g} exceeds {_SUMMARY[k + 1]} {above:g}"
        )
    return values


@checked
def heat_map(
    ax: Axes,
    values: ArrayLike,
    x_levels: Sequence[float],
    y_levels: Sequence[float],
    label: str,
    *,
    xlabel: str = "",
    ylabel: str = "",
    mark: tuple[float, float] | None = None,
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw a map of equal cells with a colour bar; the values are printed in maps of up to 8 by 8 cells.

    Raises InvalidInputError if ``values`` have another shape, ``mark`` has a level that the map does not have, or the
    first of ``limits`` exceeds the second.

    Parameters
    ----------
    ax
        Axes to draw on.
    values
        Values of the cells, (y levels, x levels), in the unit that ``label`` names. The first row is at the bottom.
    x_levels, y_levels
        Levels of the columns and of the rows.
    label
        Label of the colour bar, with the unit of ``values``.
    xlabel, ylabel
        Labels of the axes, with units.
    mark
        Levels (x, y) of a cell that gets a frame and a star, labelled "paper" for a legend.
    limits
        Values at both ends of the colour bar, so that maps side by side can have the same colours. None takes the
        smallest and largest value of the map.
    """
    for name, levels in (("x_levels", x_levels), ("y_levels", y_levels)):
        if not check_shape(name, levels, (None,)).size:
            raise InvalidInputError(f"{name}: expected at least one level")
    shape = len(y_levels), len(x_levels)
    cells = check_shape("values", values, shape, ("y level", "x level"))
    low, high = (cells.min(), cells.max()) if limits is None else check_shape("limits", limits, (2,))
    if low > high:
        raise InvalidInputError(f"limits: {low:g} exceeds {high:g}")
    edges = [np.arange(count + 1) - 0.5 for count in shape]
    mesh = ax.pcolormesh(
        edges[1], edges[0], cells, cmap="viridis", vmin=low, vmax=high, edgecolors="w", linewidth=0.5, zorder=1
    )
    bar = ax.figure.colorbar(mesh, cax=ax.inset_axes((1.03, 0.0, 0.05, 1.0)), label=label)
    bar.outline.set_visible(False)
    bar.ax.grid(visible=False)
    if bar.solids is not None:
        bar.solids.set(rasterized=False, edgecolor="face")  # vectors, without seams
    if max(shape) <= _MOST_PRINTED:
        _print_cells(ax, mesh, cells)
    if mark is not None:
        column, row = (_cell(axis, level, of) for axis, level, of in zip("xy", mark, (x_levels, y_levels), strict=True))
        frame: dict[str, Any] = {"fill": False, "edgecolor": "k", "linewidth": 1.6, "zorder": 3}
        ax.add_patch(Rectangle((column - 0.5, row - 0.5), 1.0, 1.0, **frame))
        ax.plot(column + 0.3, row + 0.3, "*", color="w", mec="k", mew=0.6, ms=7, zorder=4, ls="none", label="paper")
    ax.set_xticks(range(shape[1]), [f"{level:g}" for level in x_levels])
    ax.set_yticks(range(shape[0]), [f"{level:g}" for level in y_levels])
    ax.set(xlabel=xlabel, ylabel=ylabel, aspect="equal")
    ax.tick_params(length=0)
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)


def _print_cells(ax: Axes, mesh: Any, cells: Array) -> None:
    """Print every value in its cell, with three digits of the largest value, in black on light and white on dark."""
    largest = float(np.abs(cells).max())
    decimals = int(np.clip(2 - np.floor(np.log10(largest)), 0, 5)) if largest > 0.0 else 0
    luminance = mesh.to_rgba(cells)[..., :3] @ [0.2126, 0.7152, 0.0722]
    for (row, column), value in np.ndenumerate(cells):
        colour = "k" if luminance[row, column] > 0.45 else "w"
        ax.text(column, row, f"{value:.{decimals}f}", ha="center", va="center", fontsize=7, color=colour, zorder=2)


def _cell(axis: str, level: float, levels: Sequence[float]) -> int:
    """Index of ``level`` among ``levels``."""
    found = np.flatnonzero(np.isclose(np.asarray(levels, dtype=float), level))
    if not len(found):
        known = [float(value) for value in levels]
        raise InvalidInputError(f"mark: {axis} = {level:g} is not one of the levels {known}")
    return int(found[0])


@checked
def bar_effects(
    ax: Axes,
    names: Sequence[str],
    values: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    xlabel: str,
    *,
    engines: Sequence[str] = (),
) -> None:
    """Draw horizontal bars with intervals, such as main effects or sensitivity indices, the first at the top.

    Raises InvalidInputError if shapes do not agree or the low end of an interval lies above its high end.

    Parameters
    ----------
    ax
        Axes to draw on.
    names
        Names of the n effects.
    values, low, high
        Lengths of the bars and ends of their intervals, in the unit that ``xlabel`` names: (n,), or (engines, n) for
        one bar per engine side by side, with a label for a legend.
    xlabel
        Label of the horizontal axis, with the unit.
    engines
        Names of the engines, which determine the colours. Empty if there is one bar per effect.
    """
    if not len(names):
        raise InvalidInputError("names: expected at least one effect")
    shape = (len(engines), len(names)) if len(engines) else (len(names),)
    given = [
        check_shape(name, v, shape, ("engine", "effect")[-len(shape) :])
        for name, v in (("values", values), ("low", low), ("high", high))
    ]
    length, begin, end = (array.reshape(-1, len(names)) for array in given)
    if (begin > end).any():
        row, effect = np.argwhere(begin > end)[0]
        ends = f"low {begin[row, effect]:g} exceeds high {end[row, effect]:g}"
        raise InvalidInputError(f"low, high: {names[effect]}: {ends}")
    rows, height = np.arange(len(names)), 0.75 / len(length)
    for k in range(len(length)):
        engine = engines[k] if len(engines) else None
        colour = GREY if engine is None else ENGINE_COLOURS.get(engine, LEG_COLOURS[k % len(LEG_COLOURS)])
        y = rows + (k - (len(length) - 1) / 2.0) * height
        ax.barh(y, length[k], 0.88 * height, color=colour, label=engine, zorder=2)
        ax.hlines(y, begin[k], end[k], color="k", linewidth=1.0, zorder=3)
        ax.plot([begin[k], end[k]], [y, y], "|", color="k", ms=4.0, mew=1.0, zorder=3)
    ax.axvline(0.0, color="k", linewidth=0.8, zorder=1)
    ax.set_yticks(rows, names)
    ax.set(xlabel=xlabel, ylim=(len(names) - 0.4, -0.6))
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)
