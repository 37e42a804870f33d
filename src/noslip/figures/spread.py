"""Repeated motions of one task: their spread, and how learning turned the tool."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from noslip._typing import Floats
from noslip.constraints.check import residual_text
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.motion import MOST_ABREAST
from noslip.figures.quantities import (
    ANGLES,
    MARGIN_SHARE,
    Constraints,
    extent,
    length_unit,
    near_angles,
    since_start,
    value_text,
)
from noslip.figures.residuals import ResidualRow, least_margins, prominence, residual_rows
from noslip.law.fitting import as_demonstrations
from noslip.trajectory import PoseTrajectory

PROGRESS = "share of the motion's time (%)"
"""What the axis of time says where durations differ."""
GRID: Floats = np.linspace(0, 100, 201)
"""Where mean and standard deviation are taken (%): every half percent."""
VISIBLE_TURN = 0.05
"""Degrees below which an adjustment is none: about a line's width."""
EACH: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.45}
"""Of one motion among many: thin and transparent."""
MEAN: dict[str, Any] = {"linewidth": 1.8}
"""Of their mean: wide."""
BAND: dict[str, Any] = {"alpha": 0.2}
"""Of one standard deviation about it."""
Curve = tuple[Floats, Floats]
"""Share of the motion's time (%) and value, at a motion's own samples."""


def demonstration_spread(
    trajectories: PoseTrajectory | Iterable[PoseTrajectory],
    constraints: Constraints = (),
    *,
    title: str | None = None,
) -> Figure:
    """Show several motions of one task over normalized time: each, their mean and their spread.

    The paper's figure A, given demonstrations, and B, given what was learned from them.  Panels:
    x, y and z; roll, pitch and yaw (extrinsic xyz); for each row of the constraints its signed
    residual, or its size on a logarithmic axis where it is too small to be seen; for each limit
    the least margin of its rows, with the forbidden side shaded.  What all keep but for rounding
    has no panel.

    Parameters
    ----------
    trajectories : PoseTrajectory or several
        Of any duration and rate.
    constraints : Constraint or several
        None leaves their panels out.
    title : str, optional
        By default the finding: how large the mean residual gets and when, and the largest of all;
        or how many of the motions violate a limit.

    Raises
    ------
    InputError
        If there is no trajectory.
    """
    motions = {str(i): motion for i, motion in enumerate(as_demonstrations(trajectories))}
    rows = least_margins(residual_rows(motions, constraints))
    drawn = sorted((row for row in rows if not row.is_zero), key=lambda row: row.is_limit)
    below = -(-len(drawn) // MOST_ABREAST)
    figure = style.new_figure(style.TWO_COLUMNS, 3.3 + 1.7 * below)
    grid = figure.add_gridspec(2 + below, 1)

    scale, unit = length_unit(motions.values())
    least = scale * style.LEAST_SHARE * max(map(extent, motions.values()))
    positions = [scale * motion.positions for motion in motions.values()]
    angles = near_angles(motions.values())
    progress = [_percent(motion) for motion in motions.values()]
    for row, (values, names, axis_unit, span, color) in enumerate(
        [
            (positions, "xyz", unit, least, style.PALETTE["blue"]),
            (angles, ANGLES, "°", style.LEAST_TURN, style.PALETTE["green"]),
        ]
    ):
        panels = grid[row].subgridspec(1, 3)
        for column, name in enumerate(names):
            ax = figure.add_subplot(panels[column])
            curves = [(p, v[:, column]) for p, v in zip(progress, values, strict=True)]
            plot_spread(ax, curves, color=color, least=span)
            style.dress(ax, PROGRESS, f"{name} ({axis_unit})")

    for index, part in enumerate(np.array_split(np.arange(len(drawn)), below) if below else []):
        panels = grid[2 + index].subgridspec(1, len(part))
        for column, which in enumerate(part):
            residual = drawn[which]
            ax = figure.add_subplot(panels[column])
            curves = _residual_curves(residual, motions)
            if all(map(residual.hides, motions)):
                _plot_sizes(ax, residual, curves)
                continue
            least = (MARGIN_SHARE if residual.is_limit else 2) * residual.span
            plot_spread(ax, curves, color=style.PALETTE["vermillion"], least=least)
            if residual.is_limit:
                style.shade_forbidden(ax, [np.array(ax.get_ylim())], 0.0)
            style.dress(ax, PROGRESS, residual.label)

    handles: dict[str, Any] = {"each motion": EACH | {"color": "black"}}
    if len(motions) > 1:
        handles["mean"] = MEAN | {"color": "black"}
        handles["± 1 standard deviation"] = Patch(facecolor="black", edgecolor="none", **BAND)
    style.put_legend(figure, handles)
    if zero := [row for row in rows if row.is_zero]:
        told = [f"{style.short_name(row.name)} {residual_text(0.0, row.own_unit)}" for row in zero]
        style.write_note(figure, f"Without a panel, as all motions keep it: {'; '.join(told)}")
    style.write_title(figure, title or _spread_finding(rows, motions))
    return figure


def plot_spread(
    ax: Axes, curves: Sequence[Curve], *, color: str, least: float = 0.0
) -> list[Artist]:
    """Draw curves, and of two or more their mean and a band of one standard deviation.

    Parameters
    ----------
    ax : Axes
    curves : sequence of pairs of arrays, shape (N,)
        Share of the motion's time (%), and values.  Thin lines show them as they are; only the
        mean and the standard deviation (of the sample, N - 1) interpolate between samples.
    color : str
    least : float
        What the axis spans at least.

    Returns
    -------
    list
        The thin lines; then the mean's line and the band, if there are any.
    """
    artists: list[Artist] = []
    shown = [values for _, values in curves]
    for progress, values in curves:
        artists += ax.plot(progress, values, color=color, **EACH)
    if len(curves) > 1:
        sampled = _sampled(curves)
        mean, deviation = sampled.mean(axis=0), sampled.std(axis=0, ddof=1)
        low, high = mean - deviation, mean + deviation
        artists += ax.plot(GRID, mean, color=color, **MEAN)
        artists.append(ax.fill_between(GRID, low, high, color=color, linewidth=0, **BAND))
        shown += [low, high]
    ax.set_xlim(0, 100)
    style.span_at_least(ax, shown, least)
    return artists


def orientation_adjustments(
    demonstrations: PoseTrajectory | Iterable[PoseTrajectory],
    trained: PoseTrajectory | Iterable[PoseTrajectory],
    *,
    title: str | None = None,
) -> Figure:
    """Show by how much learning changed roll, pitch and yaw of each demonstration.

    The paper's figure C, over normalized time; one color a trial, the largest change of each
    angle named.

    Parameters
    ----------
    demonstrations : PoseTrajectory or several
    trained : PoseTrajectory or several
        The motion learned from each, in the same order; durations and rates may differ.
    title : str, optional
        By default the finding: which angle changed most, and by how much.

    Raises
    ------
    InputError
        If there is none, or not one trained motion for each demonstration.
    """
    before, after = as_demonstrations(demonstrations), as_demonstrations(trained)
    if len(before) != len(after):
        raise InputError(
            f"orientation_adjustments needs one trained motion for each demonstration, got "
            f"{len(after)} for {len(before)}"
        )
    names = _trial_names(before)
    changes = [adjustment(*pair) for pair in zip(before, after, strict=True)]
    progress = list(map(_percent, after))
    peaks = np.array([np.abs(change).max(axis=0) for change in changes])

    figure = style.new_figure(style.TWO_COLUMNS, 2.9)
    panels = figure.subplots(1, 3, sharey=True)
    styles = style.trial_styles(len(names))
    for column, (ax, angle) in enumerate(zip(panels, ANGLES, strict=True)):
        curves = [change[:, column] for change in changes]
        for share, curve, look in zip(progress, curves, styles, strict=True):
            ax.plot(share, curve, **look)
        ax.axhline(0, color=style.PALETTE["gray"], linewidth=0.6, zorder=1)
        ax.set_xlim(0, 100)
        style.dress(ax, PROGRESS, f"adjustment of {angle} (°)")
        largest = int(np.argmax(peaks[:, column]))
        if peaks[largest, column] >= VISIBLE_TURN:
            _point_out(ax, progress[largest], curves[largest], names[largest])
    low, high = min(c.min() for c in changes), max(c.max() for c in changes)
    room = max(0.25 * (high - low), style.LEAST_TURN / 2)
    panels[0].set_ylim(low - room, high + room)

    if len(names) > 1:
        style.put_legend(figure, dict(zip(names, styles, strict=True)))
    style.write_title(figure, title or _adjustment_finding(peaks, names))
    return figure


def adjustment(demonstration: PoseTrajectory, trained: PoseTrajectory) -> Floats:
    """Change of roll, pitch and yaw at the trained motion's samples, shape (N, 3), degrees.

    Both are compared at the same share of their durations.
    """
    before, after = near_angles([demonstration, trained])
    own, at = _percent(demonstration), _percent(trained)
    return np.asarray(after - np.column_stack([np.interp(at, own, angle) for angle in before.T]))


# ---------------------------------------------------------------- inside


def _percent(motion: PoseTrajectory) -> Floats:
    return np.asarray(100 * since_start(motion) / motion.duration)


def _sampled(curves: Sequence[Curve]) -> Floats:
    return np.array([np.interp(GRID, progress, values) for progress, values in curves])


def _residual_curves(residual: ResidualRow, motions: Mapping[str, PoseTrajectory]) -> list[Curve]:
    return [
        (100 * residual.times[name] / motion.duration, residual.values[name])
        for name, motion in motions.items()
    ]


def _plot_sizes(ax: Axes, residual: ResidualRow, curves: Sequence[Curve]) -> None:
    """Draw residuals that look like zero on a logarithmic axis, and say how large they get."""
    sizes = [np.abs(values) for _, values in curves]
    for (progress, _), size in zip(curves, sizes, strict=True):
        ax.plot(progress, size, color=style.PALETTE["vermillion"], **EACH)
    style.log_axis(ax, sizes, residual.span)
    ax.set_xlim(0, 100)
    peak = max(residual.peaks.values()) / residual.scale
    text = f"largest of all: {value_text(peak, residual.own_unit)}"
    middle: Any = {"ha": "center", "va": "top", "transform": ax.transAxes}
    ax.text(0.5, 0.9, text, fontsize=style.SMALL_FONT_SIZE, **middle)
    style.dress(ax, PROGRESS, residual.size_label)


def _spread_finding(rows: Sequence[ResidualRow], motions: Mapping[str, PoseTrajectory]) -> str:
    count = f"{len(motions)} motion{'s' if len(motions) > 1 else ''}"
    if not rows:
        paths = [motion.path_length for motion in motions.values()]
        return f"{count}: paths of {value_text(min(paths), 'm')} to {value_text(max(paths), 'm')}"
    worst = max(rows, key=prominence)
    who = f"{style.capitalized(worst.name)} of {count}"
    if worst.is_limit:
        broken = sum(not worst.keeps(name) for name in worst.values)
        least = min(worst.margins.values()) / worst.scale
        if not broken:
            return f"{who}: kept by all, least margin {value_text(max(least, 0.0), worst.own_unit)}"
        return f"{who}: violated by {broken}, by up to {value_text(-least, worst.own_unit)}"
    largest = max(worst.peaks.values())
    peak = f"{style.number(largest)} {worst.unit}"
    if all(map(worst.hides, motions)):
        return f"{who}: {residual_text(largest / worst.scale, worst.own_unit, order='at most')}"
    mean = _sampled(_residual_curves(worst, motions)).mean(axis=0)
    at = int(np.argmax(np.abs(mean)))
    signed = f"{'+' if mean[at] > 0 else '−'}{style.number(abs(mean[at]))} {worst.unit}"
    return f"{who}: mean up to {signed} (at {GRID[at]:.0f} % of the time), largest {peak}"


def _adjustment_finding(peaks: Floats, names: Sequence[str]) -> str:
    typical = np.median(peaks, axis=0)
    most = int(np.argmax(typical))
    trial = int(np.argmax(peaks[:, most]))
    if peaks.max() < VISIBLE_TURN:
        return f"No angle is adjusted by more than {style.number(peaks.max())}°"
    text = f"{ANGLES[most].capitalize()} is adjusted most: "
    if len(names) > 1:
        text += f"typically by {style.number(typical[most])}°, "
    return (
        text + f"at most by {style.number(peaks[trial, most])}° ({style.short_name(names[trial])})"
    )


def _trial_names(trials: Sequence[PoseTrajectory]) -> list[str]:
    """Names of the trials, numbered where two are the same."""
    names = [trial.name for trial in trials]
    if len(set(names)) == len(names):
        return names
    return [f"{name} ({i})" for i, name in enumerate(names, start=1)]


def _point_out(ax: Axes, progress: Floats, curve: Floats, name: str) -> None:
    """Name a curve where it is largest, on the outer side, which no curve reaches."""
    at = int(np.argmax(np.abs(curve)))
    above = curve[at] >= 0
    ax.annotate(
        f"{style.short_name(name)}: {curve[at]:+.1f}°".replace("-", "−"),
        (progress[at], curve[at]),
        xytext=(0.5, 0.97 if above else 0.03),
        textcoords="axes fraction",
        ha="center",
        va="top" if above else "bottom",
        fontsize=style.SMALL_FONT_SIZE,
        arrowprops={"arrowstyle": "-", "linewidth": 0.6, "color": "0.3"},
    )
