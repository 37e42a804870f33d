"""Why a constraint was found to hold: what slips, about which point, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from noslip._typing import Floats
from noslip.edge import AXES
from noslip.figures import style
from noslip.figures.learned_spread import CIRCLE
from noslip.identification.identified import Identified, Place, Row, axis_text, roughly
from noslip.identification.identify import HELD
from noslip.trajectory import PoseTrajectory

GIVEN, FOUND, FREE = (style.PALETTE[color] for color in ("gray", "blue", "vermillion"))
"""Colors of what the recording's own frame says, of what holds, and of what does not."""
REGION = 5.991
"""Of a point in a plane, 95 % lie within this squared number of standard errors (chi-square)."""
SEEN = 0.04
"""Share of the picture below which the region is enlarged: smaller, its point would hide it."""
LEAST_SHARE, LEAST_LENGTH = 1e-2, 1e-3
"""Percent of the speed, and millimeters: less is drawn as this, on logarithmic axes."""
MOST_DRAWN = 8
"""Recordings whose slip is drawn over time; more would be a smear."""


def identified_constraint(found: Identified, *, title: str | None = None) -> Figure:
    """Show why a constraint is believed to hold in recordings, or why none is.

    Panels: how much the body slips along each direction, about its own origin and about the point
    that was found, on what that was not fitted to, beside the share up to which a row is believed;
    where the point is in the body's frame, with its 95 % region; the way slipped over time, about
    the origin and about the point; and how far off each rule about places is.

    Parameters
    ----------
    found : Identified
    title : str, optional
        By default the finding.
    """
    timed = bool(found.recordings and found.candidates)
    figure = style.new_figure(style.TWO_COLUMNS, 4.9 if timed or found.surfaces else 2.7)
    below = [name for name, there in (("time", timed), ("places", found.surfaces)) if there]
    rows: Any = [["slip", "point"], *([[below[0], below[-1]]] if below else [])]
    panels = figure.subplot_mosaic(rows, width_ratios=(1.2, 1))
    handles = {"about the origin": _look(GIVEN, "o", "white")}
    if found.rows or any(place.holds for place in found.surfaces):
        handles["holds, where it was not fitted"] = _look(FOUND, "o")
    if len(found.candidates) > len(found.rows) or any(not p.holds for p in found.surfaces):
        handles["does not hold"] = _look(FREE, "o")
    _draw_slip(panels["slip"], found)
    handles |= _draw_point(panels["point"], found)
    if timed:
        _draw_time(panels["time"], found)
    if found.surfaces:
        _draw_places(panels["places"], found.surfaces)
    style.put_legend(figure, handles)
    style.write_title(figure, title or _finding(found))
    return figure


def _finding(found: Identified) -> str:
    first, *more = found.sentences[: 3 if found.rows else 2]
    text = f"{first}: {'; '.join(more)}" if more else first
    return text[:1].upper() + text[1:]


def _look(color: str, marker: str, inside: str | None = None) -> dict[str, Any]:
    return {"color": color, "marker": marker, "mfc": inside or color, "ms": 5, "linestyle": ""}


def _draw_slip(ax: Axes, found: Identified) -> None:
    """Draw the share of the speed that is slip along each direction, before and after."""
    names = []
    for place, row in enumerate(found.candidates):
        held = any(np.allclose(row.axis, each.axis) for each in found.rows)
        names.append(axis_text(row.axis))
        given, left = (max(100 * share, LEAST_SHARE) for share in (row.given, row.holdout))
        ax.plot([given, left], [place, place], color="0.8", linewidth=1, zorder=1)
        ax.plot(given, place, **_look(GIVEN, "o", "white"))
        ax.plot(left, place, **_look(FOUND if held else FREE, "o"))
    ax.axvline(100 * HELD, color="black", linewidth=0.9, linestyle=(0, (3, 2)))
    title = f"slip along each axis; held below {100 * HELD:.3g} %"
    _log_dots(ax, "slip (% of the speed)", title, names)


def _log_dots(ax: Axes, xlabel: str, title: str, names: Sequence[str]) -> None:
    """Dress axes of a dot or two for each name, over whole decades."""
    ax.set_xscale("log")
    low, high = np.log10(ax.dataLim.intervalx)
    ax.set_xlim(10 ** (np.floor(low) - 0.1), 10 ** (np.ceil(high) + 0.1))
    style.dress(ax, xlabel, "", title=title)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)


def _plane(found: Identified, row: Row) -> list[int]:
    """Two body axes: not the one along which least is told, of equals a shaft or lateral."""
    hidden = np.linalg.norm(row.unknown, axis=0) if len(row.unknown) else np.zeros(3)
    ahead = row.axis if found.travel is None or "needle" not in found.kinds else found.travel
    away = int(np.argmax(np.round(hidden, 3) + 1e-6 * np.abs(ahead)))
    return [k for k in range(3) if k != away]


def _draw_point(ax: Axes, found: Identified) -> dict[str, dict[str, Any]]:
    """Draw where the point is, seen along a body axis; return what to add to the legend."""
    handles: dict[str, dict[str, Any]] = {"origin": _look("black", "+")}
    rows = found.rows or found.candidates[:1]
    columns = _plane(found, rows[0]) if rows else [0, 1]
    ax.plot(0, 0, **_look("black", "+"))
    told = bool(rows) and len(rows[0].unknown) < 3
    if told:
        row, color = rows[0], FOUND if found.rows else FREE
        point = 1e3 * row.point[columns]
        spreads, axes = np.linalg.eigh(1e6 * row.point_covariance[np.ix_(columns, columns)])
        region = (np.sqrt(REGION * np.maximum(spreads, 0.0)) * CIRCLE) @ axes.T
        reach = max(float(np.abs(point).max()), float(np.abs(region).max()), 1.0)
        size = float(np.linalg.norm(region, axis=1).max())
        times = 1.0
        if 0 < size < SEEN * reach:
            times = 10 ** np.ceil(np.log10(SEEN * reach / size))
        ax.plot(*(point[:, None] + times * region.T), color=color, linewidth=1)
        ax.plot(*point, **_look(color, "."))
        more = "" if times == 1 else f", {times:g} times enlarged"
        handles[f"95 % region{more}"] = {"color": color, "linewidth": 1}
        for direction in row.unknown[:, columns]:
            if np.linalg.norm(direction) > 0.5:
                ax.axline(tuple(point), tuple(point + direction), color=color, linestyle=":", lw=1)
                handles["not told"] = {"color": color, "linestyle": ":", "linewidth": 1}
        if found.travel is not None and np.linalg.norm(found.travel[columns]) > 0.5:
            ahead = tuple(point + 0.35 * reach * found.travel[columns])
            ax.annotate("", ahead, tuple(point), arrowprops={"arrowstyle": "->", "lw": 0.9})
            ax.annotate("travel", ahead, fontsize=style.SMALL_FONT_SIZE)
        seen = np.array([np.zeros(2), point, *(point + times * region)])
        ax.update_datalim(
            np.array([seen.min(axis=0) - 0.4 * reach, seen.max(axis=0) + 0.4 * reach])
        )
    ax.margins(0)
    ax.set_aspect("equal", adjustable="datalim")
    x, y = (AXES[column] for column in columns)
    style.dress(
        ax,
        f"{x} of the body (mm)",
        f"{y} of the body (mm)",
        title=f"where the point is{'' if told else ': not told'}",
    )
    return handles


def _draw_time(ax: Axes, found: Identified) -> None:
    """Draw the way slipped, about the origin and about the point."""
    row = (found.rows or found.candidates)[0]
    color = FOUND if found.rows else FREE
    for recording in found.recordings[:MOST_DRAWN]:
        times = recording.clock
        for point, look in ((np.zeros(3), GIVEN), (row.point, color)):
            ax.plot(times, 1e3 * way_slipped(recording, row.axis, point), color=look, linewidth=0.9)
    style.dress(ax, "time (s)", "way slipped (mm)", title=f"way slipped along {roughly(row.axis)}")


def way_slipped(recording: PoseTrajectory, axis: Floats, point: Floats) -> Floats:
    """Way of a body's point along a body's axis (m), summed over the steps, shape (N,)."""
    linear, angular = recording.step_velocities()
    turns = recording.step_middles()[2]
    speeds = np.einsum(
        "ki,ki->k", turns.apply(axis), linear + np.cross(angular, turns.apply(point))
    )
    return np.concatenate([[0.0], np.cumsum(speeds * np.diff(recording.times))])


def _draw_places(ax: Axes, places: Sequence[Place]) -> None:
    """Draw how far off each rule about places is, where it was not fitted."""
    for k, place in enumerate(places):
        off = max(1e3 * place.holdout, LEAST_LENGTH)
        ax.plot(off, k, **_look(FOUND if place.holds else FREE, "o"))
    kinds = [place.kind for place in places]
    _log_dots(ax, "off where not fitted (mm, axes mrad)", "rules about places", kinds)
