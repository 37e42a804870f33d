"""Vectors and channels over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from noslip._typing import Floats
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.motion import TIME
from noslip.series import Series

MOST_LINES = 4
"""In a panel: more cross each other until none can be followed."""
PANEL_HEIGHT = 1.35
"""Inches."""


def plot_values(trajectory: Series, *, title: str | None = None) -> Figure:
    """Show vectors, such as joints, or channels over time.

    Values of one unit share a panel, up to four in each, so that their sizes compare.

    Parameters
    ----------
    trajectory : Trajectory, or channels of a motion
    title : str, optional
        By default the finding: what changes most, and by how much, in each unit.

    Returns
    -------
    Figure
        Without a window; :func:`save_figure` writes it.

    Raises
    ------
    InputError
        If it is none.
    """
    if not isinstance(trajectory, Series):
        raise InputError(
            f"plot_values draws a Trajectory or channels, got {type(trajectory).__name__}; "
            "compare_motions draws poses"
        )
    times = trajectory.times - trajectory.times[0]
    panels = _panels(trajectory)
    figure = style.new_figure(style.TWO_COLUMNS, 0.8 + PANEL_HEIGHT * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (unit, columns) in zip(axes, panels, strict=True):
        curves = {trajectory.names[k]: trajectory.values[:, k] for k in columns}
        style.draw_curves(ax, {name: (times, values) for name, values in curves.items()})
        largest = max(float(np.abs(values).max()) for values in curves.values())
        style.span_at_least(ax, list(curves.values()), style.LEAST_SHARE * largest)
        label = ", ".join(curves) if len(curves) == 1 else ""
        style.dress(ax, TIME, f"{label or 'values'} ({unit})")
        ax.set_xlim(times[0], times[-1])
        if len(curves) > 1:
            # Beside the panel, where it hides no line.
            ax.legend(
                loc="upper left",
                bbox_to_anchor=(1.01, 1.0),
                fontsize=style.SMALL_FONT_SIZE,
                frameon=False,
                handlelength=3,
                borderaxespad=0,
            )
    style.stack(figure, list(axes))
    style.write_title(figure, title or _finding(trajectory))
    return figure


def _panels(trajectory: Series) -> list[tuple[str, list[int]]]:
    """Unit and columns of each panel."""
    panels = []
    for unit in dict.fromkeys(trajectory.units):
        columns = [k for k, own in enumerate(trajectory.units) if own == unit]
        count = -(-len(columns) // MOST_LINES)
        panels += [(unit, part.tolist()) for part in np.array_split(columns, count)]
    return panels


def _finding(trajectory: Series) -> str:
    """What changes most of each unit."""
    ranges: Floats = np.ptp(trajectory.values, axis=0)
    told = []
    for unit in list(dict.fromkeys(trajectory.units))[:3]:
        columns = [k for k, own in enumerate(trajectory.units) if own == unit]
        most = max(columns, key=lambda k: ranges[k])
        size = style.number(float(ranges[most])) + ("" if unit == "1" else f" {unit}")
        told.append(f"{trajectory.names[most]} spans {size}")
    name = style.capitalized(style.short_name(trajectory.name))
    return f"{name}: {'; '.join(told)} in {style.number(trajectory.duration)} s"
