"""Several bodies that move together: their ways in the world, and one's as another sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noslip._typing import Floats
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

LINE = 0.14
"""Inches of a constraint's name in the legend below its panel."""
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
    curves = _violations(report) if report else {}
    height = 2.9 + (LINE * len(curves) if len(curves) > 1 else 0)
    figure = style.new_figure(style.TWO_COLUMNS, height)
    world, frame, *others = figure.subplots(1, 3 if curves else 2)
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
        told = _told(report)
        if curves:
            _plot_violations(others[0], report, curves)
    style.name_lines(figure, names)
    kept = [each.name for each in report.constraints if each.name not in curves] if report else []
    if kept:
        style.write_note(figure, f"Without a line, as it is never violated: {', '.join(kept)}")
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


def _told(report: CheckReport) -> list[str]:
    """What comes of the constraints: of those that are violated, else of one, what was found."""
    bad = [each for each in report.constraints if not each.satisfied]
    shown = bad or list(report.constraints[:1])
    told = [
        f"{each.name} {'holds' if each.satisfied else 'is violated'}: {each.finding}"
        for each in shown
    ]
    if more := len(report.constraints) - len(shown):
        told.append("the other holds" if more == 1 else f"the other {more} hold")
        told[-1] += "" if bad else " too"
    return told


def _violations(report: CheckReport) -> dict[str, Floats]:
    """How much each constraint that is ever violated is, at each sample."""
    system = report.system
    residuals = sample_residuals(report.trajectory, system)
    parts = np.split(residuals, np.cumsum(system.rows)[:-1], axis=1)
    sizes = {
        each.name: np.maximum(-rows.min(axis=1), 0.0)
        if each.relation != "zero"
        else np.linalg.norm(rows, axis=1)
        for each, rows in zip(report.constraints, parts, strict=True)
    }
    return {name: size for name, size in sizes.items() if size.any()}


def _plot_violations(ax: Axes, report: CheckReport, curves: Mapping[str, Floats]) -> None:
    """Draw how much constraints are violated, over time, on a logarithmic axis."""
    units = {each.name: each.unit for each in report.constraints}
    looks = style.trial_styles(len(curves))
    for (name, sizes), look in zip(curves.items(), looks, strict=True):
        label = f"{name} ({units[name]})"
        ax.semilogy(since_start(report.trajectory), np.maximum(sizes, _LEAST), label=label, **look)
    ax.axhline(report.constraints[0].tolerance, color=style.PALETTE["gray"], linestyle=":")
    own = {units[name] for name in curves}
    unit = own.pop() if len(own) == 1 else "SI"
    what = next(iter(curves)) if len(curves) == 1 else "violation"
    style.dress(ax, TIME, f"{what} ({unit})", title="dotted: tolerance")
    if len(curves) > 1:
        # Below the panel, where it hides no line.
        place: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.24)}
        ax.legend(fontsize=style.SMALL_FONT_SIZE - 1, frameon=False, **place)
