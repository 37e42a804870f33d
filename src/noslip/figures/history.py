"""What each constraint of a rollout did: residual or margin, multiplier and acceleration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from noslip._typing import Floats
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.motion import TIME
from noslip.figures.quantities import (
    FORCE_UNITS,
    MARGIN_SHARE,
    Constraints,
    Part,
    force_parts,
    force_sizes,
    index_of,
    since_start,
)
from noslip.figures.records import ConstraintRecord, constraint_records
from noslip.runtime.motion import HELD, Motion

LONGEST_TITLE = 24
"""Characters of a constraint's name that a panel's title shows: more run into the next panel's."""
PUSHING = 1e-6
"""Share of a limit's largest force above which it pushes: the barrier leaves a trace before and
after."""
MULTIPLIER_UNITS = {"m": "m/s²", "m/s": "m/s²", "m/s²": "m/s"}
"""By the unit of the residual, that of a position over the step; of others it depends on the metric
too."""
FORCE_NAMES: dict[Part, str] = {"linear": "acceleration", "angular": "angular acceleration"}
"""What the panels call what a constraint adds."""
MOST_ABREAST = 3
"""Panels of constraints that did nothing, side by side, where none acted."""


def constraint_history(
    motion: Motion, constraints: Constraints = (), *, title: str | None = None
) -> Figure:
    """Show what each constraint and limit of a rollout did over time.

    A row of panels for each that acted: the residual of its rows (on a logarithmic axis if it is
    too small to be seen) or their margins, with the forbidden side shaded; the multipliers; the
    size of the acceleration that it added, linear and angular, unless all of these are zero.  Of
    those that added none, residuals or margins alone.

    Parameters
    ----------
    motion : Motion
        What :meth:`noslip.ConstrainedDMP.rollout` returns.
    constraints : Constraint or several, optional
        Those of the primitive: they know the units of residuals and margins, which a motion does
        not.
    title : str, optional
        By default the finding: the largest residual; the least margin or what gave way; which limit
        pushed hardest, and when.

    Returns
    -------
    Figure
        Without a window; :func:`save_figure` writes it.

    Raises
    ------
    InputError
        If the motion is no rollout with constraints, or the constraints are not the motion's.
    """
    if not isinstance(motion, Motion):
        raise InputError(
            f"constraint_history takes the rollout of a primitive, got a {type(motion).__name__}"
        )
    held = constraint_records(motion, constraints)
    if not held:
        raise InputError(f"{motion.name}: no constraint took part in it")
    acting = [one for one in held if one.acts]
    idle = [one for one in held if not one.acts]
    plots = _plots(force_parts(one.forces for one in held))
    width = len(plots) if acting else min(MOST_ABREAST, len(idle))
    height = len(acting) - (-len(idle) // width)
    figure = style.new_figure(style.TWO_COLUMNS, 1.15 + 1.05 * height)
    panels = figure.subplots(height, width, sharex=True, squeeze=False)
    times = since_start(motion)
    for one, row in zip(acting, panels, strict=False):
        for ax, plot in zip(row, plots, strict=True):
            plot(ax, times, one)
    # Of what did nothing only the values are of interest: several share a row of panels.
    rest = list(panels[len(acting) :].flat)
    for one, ax in zip(idle, rest, strict=False):
        _plot_values(ax, times, one)
    for ax in rest[len(idle) :]:
        ax.remove()
    for column in panels.T:
        shown = [ax for ax in column if ax.figure is not None]
        for ax in shown:
            ax.set_xlabel(TIME if ax is shown[-1] else "", fontsize=style.SMALL_FONT_SIZE)
            ax.tick_params(labelbottom=ax is shown[-1])
        figure.align_ylabels(shown)

    most = max(held, key=lambda one: one.rows)
    if most.rows > 1:
        style.put_legend(figure, most.styles)
    if idle:
        names = ", ".join(style.short_name(one.name) for one in idle)
        style.write_note(figure, f"Added no acceleration: {names}")
    style.write_title(figure, title or _finding(since_start(motion), held))
    return figure


def plot_constraint(
    ax: Axes,
    motion: Motion,
    constraints: Constraints,
    name: str,
    show: str = "residual",
) -> list[Line2D]:
    """Draw what one constraint or limit of a rollout did over time (s): a panel of the history.

    Parameters
    ----------
    ax : Axes
    motion : Motion
    constraints : Constraint or several
        Those of the primitive.
    name : str
        Of the constraint, as in the motion's ``constraint_names`` and ``limit_names``.
    show : "residual", "multiplier", "acceleration" or "angular acceleration"
        Residuals, or of a limit its margins; multipliers; size of the linear (m/s^2) or angular
        (rad/s^2) acceleration that it added.

    Raises
    ------
    InputError
        If the motion has no such constraint, or the constraints are not the motion's.
    """
    held = constraint_records(motion, constraints)
    one = held[index_of(name, [one.name for one in held], "constraint")]
    index_of(show, list(PANELS), "show")
    return PANELS[show](ax, since_start(motion), one)


def _plot_values(ax: Axes, times: Floats, one: ConstraintRecord) -> list[Line2D]:
    """Residuals or margins, with the name and the extreme above."""
    scale, unit = one.axis
    quantity, shown = "margin" if one.is_limit else "residual", scale * one.values
    too_small = not one.is_limit and one.holds and one.peak > 0
    if too_small:
        quantity, shown = f"|{quantity}|", np.abs(shown)
    lines = _plot_rows(ax, times, shown, one)
    if too_small:
        style.log_axis(ax, shown.T, scale * one.span)
    elif one.is_limit:
        style.shade_forbidden(ax, shown.T, MARGIN_SHARE * scale * one.span)
    else:
        style.span_at_least(ax, shown.T, 2 * scale * one.span)
    _label(ax, quantity, unit if one.unit else "own unit")
    name = one.name if len(one.name) <= LONGEST_TITLE else f"{one.name[: LONGEST_TITLE - 1]}…"
    heading = f"{style.short_name(name)}:\n{one.extreme_text}"
    ax.set_title(heading, loc="left", fontsize=style.SMALL_FONT_SIZE, fontweight="bold")
    return lines


def _plot_multipliers(ax: Axes, times: Floats, one: ConstraintRecord) -> list[Line2D]:
    lines = _plot_rows(ax, times, one.multipliers, one)
    _span_something(ax, one.multipliers)
    _label(ax, "multiplier", MULTIPLIER_UNITS.get(one.unit or "", "SI"))
    return lines


def _plot_force(ax: Axes, times: Floats, one: ConstraintRecord, part: Part) -> list[Line2D]:
    """Size of the acceleration that all rows together added, with its peak above."""
    size = force_sizes(one.forces, part)
    look: dict[str, Any] = {"color": style.PALETTE["vermillion"], "linewidth": 1.1}
    lines = ax.plot(times, size, "-", label=style.short_name(one.name), **look)
    _span_something(ax, size)
    _label(ax, f"added {FORCE_NAMES[part]}", FORCE_UNITS[part])
    heading = "none added"
    if size.any():
        peak = f"{style.number(size.max())} {FORCE_UNITS[part]}"
        heading = f"≤ {peak}\nat {style.number(times[np.argmax(size)])} s"
    ax.set_title(heading, loc="left", fontsize=style.SMALL_FONT_SIZE)
    return lines


def _plot_rows(ax: Axes, times: Floats, columns: Floats, one: ConstraintRecord) -> list[Line2D]:
    lines: list[Line2D] = []
    for (label, look), column in zip(one.styles.items(), columns.T, strict=True):
        lines += ax.plot(times, column, label=style.short_name(label), **look)
    return lines


def _span_something(ax: Axes, values: Floats) -> None:
    """Show zero; an axis of nothing but zeros gets a range."""
    low, high = min(0.0, values.min()), max(0.0, values.max())
    room = 0.08 * (high - low) or 0.1
    ax.set_ylim(low - room, (high or 1.0) + room)


def _label(ax: Axes, quantity: str, unit: str) -> None:
    style.dress(ax, TIME, "")
    ax.set_ylabel(fill(f"{quantity} ({unit})", 13), fontsize=style.SMALL_FONT_SIZE)


PANELS: dict[str, Callable[[Axes, Floats, ConstraintRecord], list[Line2D]]] = {
    "residual": _plot_values,
    "multiplier": _plot_multipliers,
    **{name: partial(_plot_force, part=part) for part, name in FORCE_NAMES.items()},
}
"""A row of the figure, from left to right."""


def _plots(parts: Sequence[Part]) -> list[Callable[[Axes, Floats, ConstraintRecord], list[Line2D]]]:
    """What draws a row of panels, without accelerations that nothing added."""
    absent = [name for part, name in FORCE_NAMES.items() if part not in parts]
    return [plot for name, plot in PANELS.items() if name not in absent]


# ---------------------------------------------------------------- the finding


def _finding(times: Floats, held: Sequence[ConstraintRecord]) -> str:
    equalities = [one for one in held if not one.is_limit]
    limits = [one for one in held if one.is_limit]
    parts = [_about_equalities(equalities)] if equalities else []
    if limits:
        parts += [_about_margins(times, limits), _about_pushes(times, limits)]
    text = "; ".join(parts)
    return text[:1].upper() + text[1:]


def _about_equalities(equalities: Sequence[ConstraintRecord]) -> str:
    worst = max(equalities, key=lambda one: one.peak / one.span)
    name, peak = style.short_name(worst.name), worst.peak_text
    if not worst.holds:
        return f"{name} is violated by up to {peak}"
    if len(equalities) == 1:
        return f"{name} holds within {peak}"
    return f"{len(equalities)} constraints hold, the worst, {name}, within {peak}"


def _about_margins(times: Floats, limits: Sequence[ConstraintRecord]) -> str:
    """What gave way, or which limit left the least of its margin."""
    broken = sorted((one for one in limits if not one.holds), key=lambda one: -one.peak / one.span)
    if broken:
        parts = [
            f"{style.short_name(one.name)} gave way by up to {one.peak_text} at "
            f"{style.number(times[np.argmax(one.violation)])} s"
            for one in broken[:2]
        ]
        if len(broken) > len(parts):
            parts.append(f"{len(broken) - len(parts)} more")
        return " and ".join(parts)
    least = min(limits, key=lambda one: one.margin / one.span)
    left, name = least.values.min(axis=1), style.short_name(least.name)
    if least.margin <= HELD:
        return f"{name} is reached at {style.number(times[np.argmax(left <= HELD)])} s, and kept"
    return (
        f"least margin: {least.margin_text} from {name} at {style.number(times[np.argmin(left)])} s"
    )


def _about_pushes(times: Floats, limits: Sequence[ConstraintRecord]) -> str:
    """Which limit pushed hardest, when, and how hard."""
    pushing = {
        part: max(limits, key=lambda one: float(force_sizes(one.forces, part).max()))
        for part in FORCE_UNITS
    }
    part: Part = "linear" if force_sizes(pushing["linear"].forces, "linear").any() else "angular"
    size = force_sizes(pushing[part].forces, part)
    if not size.any():
        return "no limit pushes"
    first, last = times[size > PUSHING * size.max()][[0, -1]]
    verb = "pushes" if part == "linear" else "turns"
    others = sum(bool(one.forces.any()) for one in limits) > 1
    most, since, until = map(style.number, (size.max(), first, last))
    return (
        f"{style.short_name(pushing[part].name)} {verb}{' hardest' if others else ''}, up to "
        f"{most} {FORCE_UNITS[part]}, from {since} to {until} s"
    )
