"""A long recording and its pieces: where it was cut, by what, and what the pieces look like."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._instants import counts_from_afar
from noslip._typing import Floats
from noslip.demonstrations.preparation import _averaged_speeds
from noslip.demonstrations.segmentation import Interval, Segments
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.quantities import length_unit, scaled_unit, value_text
from noslip.trajectory import PoseTrajectory

COLORS = tuple(color for name, color in style.PALETTE.items() if name not in ("gray", "black"))
"""Of the pieces in turn; gray is what was cut out, and black looks gray as a shade."""
MANY_COLORS = style.PALETTE["blue"], style.PALETTE["sky"]
"""Of more pieces than can be told apart: neighbors differ."""
BETWEEN = ("rest", "no contact", "not asked for")
"""Reasons that the legend alone names: there are as many pauses as pieces."""
MOST_LABELS = {"time": 24, "path": 8}
"""Numbers that fit side by side over time, and among paths; of more pieces every second, third and
so on has one."""
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
TRUE: dict[str, Any] = {"color": style.PALETTE["black"], "linewidth": 2.5, "solid_capstyle": "butt"}
"""Of the true cuts: heavier than any threshold."""
TRUE_AT = 0.03
"""Share of the axis at which they are drawn."""
_THRESHOLD: dict[str, Any] = {"color": style.PALETTE["black"], "linewidth": 0.9}
"""Black, and told apart by their dashes."""
UPPER, LOWER = _THRESHOLD | {"linestyle": (0, (5, 2))}, _THRESHOLD | {"linestyle": (0, (1, 1.8))}
"""Of the threshold at which a piece begins, and of that at which it ends."""


def recording_cuts(
    segments: Segments, *, true: ArrayLike | None = None, title: str | None = None
) -> Figure:
    """Show where a recording was cut, why, and the paths of its pieces from above.

    Left: the speed over time on a logarithmic axis, or the contact signal, with its thresholds.
    Pieces are colored and numbered; rests are light gray, and what was cut out beside them is
    hatched, with a letter for the reason, which the legend tells.  Right: the paths in the world's
    xy plane in the same colors, all else thin and gray, as far as it lies in their view.

    Parameters
    ----------
    segments : Segments
        Of :func:`noslip.segment`.
    true : array, shape (n, 2), optional
        Start and end of each true cut (s, on the recording's clock), where they are known: drawn
        as bars below the signal.
    title : str, optional
        By default the finding: how many pieces, how long, and how many were dropped.

    Raises
    ------
    InputError
        If ``true`` holds no pairs of numbers.
    """
    if true is not None:
        true = _arguments.numbers("recording_cuts: true", true)
        if true.ndim != 2 or true.shape[1] != 2:
            raise InputError(
                f"recording_cuts: true has shape {true.shape}; give start and end of each, (n, 2)"
            )
    figure = style.new_figure(style.TWO_COLUMNS, 3.1)
    over_time, above = figure.subplots(1, 2, width_ratios=(2.1, 1))
    handles = _draw_cuts(over_time, segments, true) | _draw_paths(above, segments)
    if handles:
        style.put_legend(figure, handles)
    style.write_title(figure, title or _finding(segments))
    return figure


def _draw_cuts(
    ax: Axes, segments: Segments, true: Floats | None
) -> dict[str, Artist | dict[str, Any]]:
    times, values = segments.recording.times, segments.signal
    afar = counts_from_afar(times[0])
    began = times[0] if afar else 0.0
    times = times - began
    intervals = [replace(i, start=i.start - began, end=i.end - began) for i in segments.intervals]
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

    if true is not None:
        for start, end in true - began:
            ax.plot([start, end], [TRUE_AT] * 2, transform=ax.get_xaxis_transform(), **TRUE)
        handles["true cut"] = TRUE
    colors, kept = _colors(segments), 0
    for interval in intervals:
        extent = interval.start, interval.end
        if interval.reason is None:
            color = next(colors)
            kept += 1
            ax.axvspan(*extent, facecolor=color, alpha=0.3, linewidth=0, zorder=0.5)
            if _is_labeled(kept, segments, "time"):
                _write(ax, interval, str(kept), color=color)
        elif interval.reason in BETWEEN:
            ax.axvspan(*extent, **PAUSE, zorder=0.4)
            handles[interval.reason] = Patch(**PAUSE)
    reasons: dict[str, list[Interval]] = {}
    for interval in intervals:
        if interval.reason and interval.reason not in BETWEEN:
            reasons.setdefault(_kind(interval.reason), []).append(interval)
    for letter, (kind, dropped) in zip(cycle(ascii_lowercase), reasons.items()):
        for interval in dropped:
            ax.axvspan(interval.start, interval.end, **DROPPED, zorder=0.5)
            _write(ax, interval, letter, color="0.1")
        count = f" ({len(dropped)} times)" if len(dropped) > 1 else ""
        handles[f"{letter}: cut out, {kind}{count}"] = Patch(**DROPPED)
    style.dress(
        ax,
        "time since start (s)" if afar else "time (s)",
        "contact signal" if by_contact else f"speed ({unit})",
    )
    ax.grid(False)
    return handles


def _kind(reason: str) -> str:
    """Return what is common to reasons of one kind: those too short differ in their duration."""
    what = reason.partition(":")[0]
    return re.sub(r"^(?:lasts [^,]*, (?=less)|\d+ samples, (?=fewer))", "", what)


def _colors(segments: Segments) -> Iterator[str]:
    return cycle(COLORS if len(segments.pieces) <= style.MOST_NAMED else MANY_COLORS)


def _is_labeled(number: int, segments: Segments, where: str) -> bool:
    """Whether the piece of a number, from 1, has it written beside it."""
    return (number - 1) % -(-len(segments.pieces) // MOST_LABELS[where]) == 0


def _write(ax: Axes, interval: Interval, text: str, *, color: str) -> None:
    """Write at the top of an interval, above the signal."""
    ax.text(
        (interval.start + interval.end) / 2,
        0.97,
        text,
        transform=ax.get_xaxis_transform(),
        ha="center",
        va="top",
        fontsize=style.SMALL_FONT_SIZE,
        fontweight="bold",
        color=color,
        path_effects=[withStroke(linewidth=1.8, foreground="white")],
        in_layout=False,
    )


def _draw_paths(ax: Axes, segments: Segments) -> dict[str, dict[str, Any]]:
    recording, placed = segments.recording, segments.recording.unit == "m"
    shown = list(segments.pieces) or [recording]
    scale, unit = length_unit(shown) if placed else (1.0, recording.unit)
    seen = scale * _plane(recording)
    times = segments.recording.times
    for part in segments.intervals:
        if part.reason is not None:
            ax.plot(*seen[(times >= part.start) & (times <= part.end)].T, **PATH_OUT)
    for index, (piece, color) in enumerate(zip(segments.pieces, _colors(segments), strict=False)):
        path = scale * _plane(piece)
        ax.plot(*path.T, color=color, linewidth=1.1)
        if not _is_labeled(index + 1, segments, "path"):
            continue
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
    # What was cut out may lead far away: pieces fill the view.
    kept = np.concatenate([scale * _plane(piece) for piece in shown])
    ax.dataLim.set_points(np.array([kept.min(axis=0), kept.max(axis=0)]))
    ax.autoscale_view()
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
