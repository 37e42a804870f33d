"""Vectors and channels over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noslip._typing import Floats
from noslip.constraints.joints import JointLimits
from noslip.constraints.system import as_system
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.motion import TIME
from noslip.figures.quantities import Constraints
from noslip.runtime.motion import VectorMotion
from noslip.series import Series

MOST_LINES = 4
"""In a panel: more cross each other until none can be followed."""
PANEL_HEIGHT = 1.35
"""Inches."""
COLUMNS, THREE = 2, 3
"""Panels side by side where several motions have one for each value; three where that leaves no
hole."""
SEEN = 0.3
"""Share of a value's range within which a limit beyond it is drawn; a farther one would flatten
what moves."""
LIMIT: dict[str, Any] = {"color": style.PALETTE["gray"], "linewidth": 1.0, "zorder": 1}
"""Of a joint's limit."""


def plot_values(
    trajectory: Series | Mapping[str, Series],
    constraints: Constraints = (),
    *,
    title: str | None = None,
) -> Figure:
    """Show vectors, such as joints, or channels over time: of one motion, or of several.

    Of one motion, values of one unit share a panel, up to four in each, so that their sizes
    compare.  Of several each value has a panel, and each motion a line in it.

    Parameters
    ----------
    trajectory : Trajectory, channels of a motion, or mapping of them by name
        Several have the same values.
    constraints : Constraint or several, optional
        Limits of joints' positions among them are drawn, where the motion comes near them.
    title : str, optional
        By default the finding: what changes most, and by how much, in each unit; of several how
        far from its goal the last one ends, if it is a rollout.

    Returns
    -------
    Figure
        Without a window; :func:`save_figure` writes it.

    Raises
    ------
    InputError
        If it is none, or several differ in what their values are.
    """
    shown = dict(trajectory) if isinstance(trajectory, Mapping) else {"": trajectory}
    for one in shown.values():
        if not isinstance(one, Series):
            raise InputError(
                f"plot_values draws a Trajectory or channels, got {type(one).__name__}; "
                "compare_motions draws poses"
            )
    if not shown:
        raise InputError("a figure needs at least one motion")
    first = next(iter(shown.values()))
    for name, one in shown.items():
        if (one.names, one.units) != (first.names, first.units):
            raise InputError(
                f"{name!r} has the values {', '.join(one.names)}, the first one "
                f"{', '.join(first.names)}; draw motions of the same values together"
            )
    limits = _limits(constraints, first)
    figure = _compared(shown, limits) if len(shown) > 1 else _alone(first, limits)
    style.write_title(figure, title or _finding(shown))
    return figure


def _alone(trajectory: Series, limits: Floats) -> Figure:
    """Draw one motion: values of a unit together."""
    times = trajectory.times - trajectory.times[0]
    panels = _panels(trajectory)
    figure = style.new_figure(style.TWO_COLUMNS, 0.8 + PANEL_HEIGHT * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    limited = False
    for ax, (unit, columns) in zip(axes, panels, strict=True):
        curves = {trajectory.names[k]: trajectory.values[:, k] for k in columns}
        lines = style.draw_curves(ax, {name: (times, values) for name, values in curves.items()})
        _span(ax, list(curves.values()))
        for line, k in zip(lines, columns, strict=True):
            own = curves[trajectory.names[k]]
            limited |= _draw_limits(ax, own, limits[k], color=line.get_color())
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
    if limited:
        style.write_note(figure, "Sparse dots: limits, each in its value's color")
    return figure


def _compared(motions: Mapping[str, Series], limits: Floats) -> Figure:
    """Draw several motions: a panel a value."""
    first = next(iter(motions.values()))
    columns = THREE if len(first.names) % THREE == 0 else min(COLUMNS, len(first.names))
    rows = -(-len(first.names) // columns)
    styles = style.line_styles(
        motions, [name for name, one in motions.items() if isinstance(one, VectorMotion)]
    )
    figure = style.new_figure(style.TWO_COLUMNS, 1.0 + PANEL_HEIGHT * rows)
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    limited = False
    for k, ax in enumerate(panels):
        if k >= len(first.names):
            ax.remove()
            continue
        values = {name: one.values[:, k] for name, one in motions.items()}
        clocks = {name: one.times - one.times[0] for name, one in motions.items()}
        curves = {name: (clocks[name], values[name]) for name in motions}
        style.draw_curves(ax, curves, styles)
        _span(ax, list(values.values()))
        limited |= _draw_limits(ax, np.concatenate(list(values.values())), limits[k])
        below = k + columns >= len(first.names)
        style.dress(ax, TIME if below else "", f"{first.names[k]} ({first.units[k]})")
    style.name_lines(figure, motions, styles)
    if limited:
        style.write_note(figure, "Gray, across a panel: limits")
    return figure


def _span(ax: Axes, curves: Sequence[Floats]) -> None:
    largest = max(float(np.abs(values).max()) for values in curves)
    style.span_at_least(ax, curves, style.LEAST_SHARE * largest)


def _limits(constraints: Constraints, motion: Series) -> Floats:
    """Least and largest value of each coordinate that position limits allow, shape (n, 2)."""
    bounds = np.tile([-np.inf, np.inf], (len(motion.names), 1))
    for one in as_system(constraints, motion.space).constraints if constraints else ():
        if isinstance(one, JointLimits) and one.level == "position":
            bounds[:, 0] = np.maximum(bounds[:, 0], np.array(one.lower, dtype=np.float64))
            bounds[:, 1] = np.minimum(bounds[:, 1], np.array(one.upper, dtype=np.float64))
    return bounds


def _draw_limits(ax: Axes, values: Floats, bounds: Floats, color: object = None) -> bool:
    """Draw the limits that a value comes near to, in its own color if it has one; return if any."""
    room = SEEN * float(np.ptp(values)) or np.inf
    look: dict[str, Any] = dict(LIMIT)
    if color is not None:
        look.update(color=color, linestyle=(0, (1, 4)))
    near = [b for b in bounds[np.isfinite(bounds)] if np.min(np.abs(values - b)) <= room]
    for bound in near:
        ax.axhline(bound, **look)
        low, high = ax.get_ylim()
        margin = 0.05 * (high - low)
        ax.set_ylim(min(low, bound - margin), max(high, bound + margin))
    return bool(near)


def _panels(trajectory: Series) -> list[tuple[str, list[int]]]:
    """Unit and columns of each panel."""
    panels = []
    for unit in dict.fromkeys(trajectory.units):
        columns = [k for k, own in enumerate(trajectory.units) if own == unit]
        count = -(-len(columns) // MOST_LINES)
        panels += [(unit, part.tolist()) for part in np.array_split(columns, count)]
    return panels


def _finding(motions: Mapping[str, Series]) -> str:
    """What changes most of each unit; of several in the first one, and where the last one ends."""
    (name, first), *_ = motions.items()
    ranges: Floats = np.ptp(first.values, axis=0)
    told = []
    for unit in list(dict.fromkeys(first.units))[:3]:
        columns = [k for k, own in enumerate(first.units) if own == unit]
        most = max(columns, key=lambda k: ranges[k])
        size = style.number(float(ranges[most])) + ("" if unit == "1" else f" {unit}")
        told.append(f"{first.names[most]} spans {size}")
    who = style.capitalized(style.short_name(name or first.name))
    text = f"{who}: {'; '.join(told)} in {style.number(first.duration)} s"
    name, last = list(motions.items())[-1]
    if isinstance(last, VectorMotion) and len(motions) > 1:
        unit = "" if last.unit == "1" else f" {last.unit}"
        off = f"{style.number(last.end_error)}{unit}"
        text += f"; {style.short_name(name)} ends {off} from its goal"
    return text
