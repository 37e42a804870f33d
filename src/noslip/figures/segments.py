"""A long recording and its pieces: where it was cut, by what, and what the pieces look like."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from noslip._typing import Floats
from noslip.demonstrations.preparation import _averaged_speeds
from noslip.demonstrations.segmentation import Interval, Segments
from noslip.figures import style
from noslip.figures.quantities import length_unit, scaled_unit, value_text
from noslip.trajectory import PoseTrajectory

COLORS = tuple(color for name, color in style.PALETTE.items() if name not in ("gray", "black"))
"""Of the pieces in turn; gray is what was cut out, and black looks gray as a shade."""
BETWEEN = ("rest", "no contact", "not asked for")
"""Reasons that the legend alone names: there are as many pauses as pieces."""
MOST_REASONS = 16
"""Dropped pieces whose reasons are written into the figure; more of them would hide it."""
FLOOR = 0.1
"""Share of the lower threshold at which a logarithmic axis of speed ends: below it is rest,
whatever the sensor's noise."""
ROOM = 0.16
"""Share of the axis above the signal, for a line of numbers."""

PAUSE: dict[str, Any] = {"facecolor": "0.94", "linewidth": 0}
"""Behind what is no piece: paler than any color."""
DROPPED: dict[str, Any] = PAUSE | {"facecolor": "0.85", "edgecolor": "0.65", "hatch": "////"}
"""Behind a piece that was dropped: hatched, so that it differs from a pause in print."""
PATH_OUT: dict[str, Any] = {"color": style.PALETTE["gray"], "linewidth": 0.6, "zorder": 1.5}
"""Of the path outside of pieces: thin, below theirs."""
_THRESHOLD: dict[str, Any] = {"color": style.PALETTE["black"], "linewidth": 0.9}
"""Black, and told apart by their dashes."""
UPPER, LOWER = _THRESHOLD | {"linestyle": (0, (5, 2))}, _THRESHOLD | {"linestyle": (0, (1, 1.8))}
"""Of the threshold at which a piece begins, and of that at which it ends."""


def recording_cuts(segments: Segments, *, title: str | None = None) -> Figure:
    """Show where a recording was cut, why, and the paths of its pieces from above.

    Left: the speed over time on a logarithmic axis, or the contact signal, with its thresholds.
    Pieces are colored and numbered; rests are light gray, and what was cut out beside them is
    hatched, with the reason.  Right: the paths in the world's xy plane in the same colors, all
    else thin and gray.

    Parameters
    ----------
    segments : Segments
        Of :func:`noslip.segment`.
    title : str, optional
        By default the finding: how many pieces, how long, and how many were dropped.
    """
    figure = style.new_figure(style.TWO_COLUMNS, 3.1)
    over_time, above = figure.subplots(1, 2, width_ratios=(2.1, 1))
    handles = _draw_cuts(over_time, segments) | _draw_paths(above, segments)
    if handles:
        style.put_legend(figure, handles)
    style.write_title(figure, title or _finding(segments))
    return figure


def _draw_cuts(ax: Axes, segments: Segments) -> dict[str, Artist | dict[str, Any]]:
    times, values = segments.recording.times, segments.signal
    by_contact = segments.quantity == "contact"
    if values is None:
        values = _averaged_speeds(segments.recording)
    of_speed = f"{segments.recording.unit}/s"
    scale, unit = (1.0, "") if by_contact else scaled_unit(float(values.max()), of_speed)
    values = scale * values
    ax.plot(times, values, color="0.25", linewidth=0.8)
    handles: dict[str, Artist | dict[str, Any]] = {}
    if segments.thresholds is not None:
        low, high = (scale * level for level in segments.thresholds)
        for level, what, look in ((high, "upper", UPPER), (low, "lower", LOWER)):
            ax.axhline(level, **look)
            shown = style.number(level) if by_contact else value_text(level / scale, of_speed)
            name = f"{what} threshold, {shown}"
            handles[name] = look
    if by_contact:
        low, high = float(values.min()), float(values.max())
        span = (high - low) or 1.0
        ax.set_ylim(low - 0.05 * span, high + (0.05 + ROOM) * span)
    else:
        # From below the noise at rest, with room for the numbers.
        top = float(values.max())
        bottom = FLOOR * low if segments.thresholds is not None and low else 1e-3 * top
        ax.set_yscale("log")
        ax.set_ylim(bottom, top * (top / bottom) ** ROOM)
    ax.set_xlim(times[0], times[-1])

    kept = 0
    dropped = [i for i in segments.intervals if i.reason and i.reason not in BETWEEN]
    for interval in segments.intervals:
        extent = interval.start, interval.end
        if interval.reason is None:
            color = COLORS[kept % len(COLORS)]
            kept += 1
            ax.axvspan(*extent, facecolor=color, alpha=0.3, linewidth=0, zorder=0.5)
            _write(ax, interval, str(kept), y=0.97, color=color, fontweight="bold")
        elif interval.reason in BETWEEN:
            ax.axvspan(*extent, **PAUSE, zorder=0.4)
            handles[interval.reason] = Patch(**PAUSE)
        else:
            ax.axvspan(*extent, **DROPPED, zorder=0.5)
            handles["cut out"] = Patch(**DROPPED)
            if len(dropped) <= MOST_REASONS:
                why, _, _ = interval.reason.partition(":")
                _write(ax, interval, why, y=0.05, color="0.1", rotation=90)
    style.dress(ax, "time (s)", "contact signal" if by_contact else f"speed ({unit})")
    ax.grid(False)
    return handles


def _write(ax: Axes, interval: Interval, text: str, *, y: float, **look: Any) -> None:
    """Write into the middle of an interval; heights are shares of the axis."""
    ax.text(
        (interval.start + interval.end) / 2,
        y,
        text,
        transform=ax.get_xaxis_transform(),
        ha="center",
        va="top" if y > 0.5 else "bottom",
        fontsize=style.SMALL_FONT_SIZE - (1.5 if "rotation" in look else 0),
        path_effects=[withStroke(linewidth=1.8, foreground="white")],
        in_layout=False,
        **look,
    )


def _draw_paths(ax: Axes, segments: Segments) -> dict[str, dict[str, Any]]:
    recording, placed = segments.recording, segments.recording.unit == "m"
    scale, unit = length_unit([recording]) if placed else (1.0, recording.unit)
    seen = scale * _plane(recording)
    times = segments.recording.times
    for part in segments.intervals:
        if part.reason is not None:
            ax.plot(*seen[(times >= part.start) & (times <= part.end)].T, **PATH_OUT)
    for index, piece in enumerate(segments.pieces):
        color = COLORS[index % len(COLORS)]
        path = scale * _plane(piece)
        ax.plot(*path.T, color=color, linewidth=1.1)
        # Numbers lie apart along the paths, which often lie on one another.
        traveled = np.cumsum(np.linalg.norm(np.diff(piece.positions, axis=0), axis=1))
        share = (index + 1) / (len(segments.pieces) + 1)
        ax.annotate(
            str(index + 1),
            path[np.searchsorted(traveled, share * traveled[-1])],
            color=color,
            fontsize=style.SMALL_FONT_SIZE,
            fontweight="bold",
            ha="center",
            va="center",
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )
    ax.set_aspect("equal", adjustable="datalim")
    x, y = (*recording.space.coordinates[:2], "")[:2]
    style.dress(ax, f"{x} ({unit})", y and f"{y} ({unit})", title="from above" if placed else "")
    return {"path cut out": PATH_OUT} if len(segments.intervals) > 1 else {}


def _plane(motion: PoseTrajectory) -> Floats:
    """Its first two coordinates, shape (N, 2); of one alone the second is 0."""
    return np.column_stack([motion.positions, np.zeros(len(motion))])[:, :2]


def _finding(segments: Segments) -> str:
    count = len(segments.pieces)
    name = style.short_name(segments.recording.name)
    if segments.quantity == "speed" and segments.thresholds is None:
        return f"{name}: no rest stands out, one piece"
    durations = [piece.duration for piece in segments.pieces]
    dropped = sum(i.reason not in (None, *BETWEEN) for i in segments.intervals)
    text = f"{name}: {count} piece{'s' if count != 1 else ''}"
    if durations:
        low, high = style.number(min(durations)), style.number(max(durations))
        text += f" of {low} s" if low == high else f" of {low} to {high} s"
    return text + (f", {dropped} more cut out" if dropped else "")
