"""Several bodies that move together: their ways in the world, and one's as another sees it."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noslip.bodies import Bodies
from noslip.constraints.check import CheckReport, check, sample_residuals
from noslip.constraints.of_body import OfBody
from noslip.constraints.system import as_system
from noslip.figures import style
from noslip.figures.motion import TIME, plot_path
from noslip.figures.places import draw_places
from noslip.figures.quantities import Constraints, length_unit, since_start, widest_plane
from noslip.space import IN
from noslip.trajectory import PoseTrajectory

_LEAST = 1e-16
"""Where a logarithmic axis ends: below lies rounding."""


def bodies_paths(
    bodies: Bodies, constraints: Constraints = (), *, title: str | None = None
) -> Figure:
    """Show where bodies go: in the world, and the first one as the second one sees it.

    What constraints of their positions forbid is hatched.

    Parameters
    ----------
    bodies : Bodies
    constraints : Constraint or several, optional
        How much each is violated is drawn over time, in its own unit.
    title : str, optional
        By default the finding: what comes of the constraints, else how far each body goes.

    Returns
    -------
    Figure
        Without a window; :func:`save_figure` writes it.
    """
    seen = IN.join(bodies.names[:2])
    motion: Any = bodies
    report = check(motion, constraints) if constraints else None
    figure = style.new_figure(style.TWO_COLUMNS, 2.9)
    world, frame, *others = figure.subplots(1, 3 if report else 2)
    plot_path(world, bodies.parts)
    names = [*bodies.names, seen]
    look = style.line_styles(names)[seen]
    for line in plot_path(frame, {seen: bodies.body(seen)}):
        line.set(**look)
    for mark in frame.lines:
        mark.set_color(look["color"])
    told = [f"{name} goes {p.path_length * 1e3:.3g} mm" for name, p in bodies.parts.items()]
    views = ((world, "in the world", bodies.parts), (frame, seen, {seen: bodies.body(seen)}))
    for ax, caption, shown in views:
        there = _draw_places(ax, shown, bodies, constraints)
        caption = style.with_places(f"{caption} (○ start, ■ end)", there)
        ax.set_title(caption, fontsize=style.SMALL_FONT_SIZE)
    if report:
        _plot_violations(others[0], report)
        told = [f"{each.name} {each.verdict}: {each.finding}" for each in report.constraints]
    style.name_lines(figure, names)
    said = "; ".join(told)
    style.write_title(figure, title or said[:1].upper() + said[1:])
    return figure


def _draw_places(
    ax: Axes, motions: Mapping[str, PoseTrajectory], bodies: Bodies, constraints: Constraints
) -> list[str]:
    """Draw where the constraints let each of some bodies go; return what is what."""
    if not constraints:
        return []
    scale, _ = length_unit(motions.values())
    found: dict[str, None] = {}
    for name, motion in motions.items():
        own = [
            one.inner if isinstance(one, OfBody) else one
            for one in as_system(constraints, bodies.space).constraints
            if (isinstance(one, OfBody) or not one.body) and (one.body or bodies.names[0]) == name
        ]
        axes = widest_plane(motions.values())
        found |= dict.fromkeys(draw_places(ax, [motion], as_system(own), axes, scale))
    return list(found)


def _plot_violations(ax: Axes, report: CheckReport) -> None:
    """Draw how much each constraint is violated, over time, on a logarithmic axis."""
    system = report.system
    residuals = sample_residuals(report.trajectory, system)
    parts = np.split(residuals, np.cumsum(system.rows)[:-1], axis=1)
    dashes = style.trial_styles(len(parts))
    for each, rows, look in zip(report.constraints, parts, dashes, strict=True):
        sizes = -rows.min(axis=1) if each.relation != "zero" else np.linalg.norm(rows, axis=1)
        label = f"{each.name} ({each.unit})"
        ax.semilogy(since_start(report.trajectory), np.maximum(sizes, _LEAST), label=label, **look)
    ax.axhline(report.constraints[0].tolerance, color=style.PALETTE["gray"], linestyle=":")
    units = {each.unit for each in report.constraints}
    unit = units.pop() if len(units) == 1 else "SI"
    style.dress(ax, TIME, f"violation ({unit})", title="dotted: tolerance")
    if len(parts) > 1:
        ax.legend(fontsize=style.SMALL_FONT_SIZE - 1, frameon=False)
    else:
        ax.set_ylabel(fill(f"{report.constraints[0].name} ({unit})", 30))
