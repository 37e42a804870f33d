"""How motions are distributed: what one is like, and within what bounds others stay."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from noslip._typing import Floats
from noslip.constraints.check import residual_text
from noslip.distribution.distribution import MotionDistribution
from noslip.figures import style
from noslip.figures.places import draw_places
from noslip.figures.quantities import scaled_unit, value_text
from noslip.figures.spread import PROGRESS

SAMPLES = 30
"""Drawn by default: enough to see the spread, few enough to see each."""
LEVEL = 0.95
"""Share of motions that stay within the bands."""
SAMPLE: dict[str, Any] = {"color": style.PALETTE["sky"], "linewidth": 0.6}
"""Of one motion among many."""
MEAN: dict[str, Any] = {"color": style.PALETTE["blue"], "linewidth": 1.6}
"""Of the mean."""
BAND: dict[str, Any] = {"facecolor": style.PALETTE["sky"], "alpha": 0.3, "linewidth": 0}
"""Of what most motions stay within."""
KEPT: dict[str, Any] = {"color": style.PALETTE["black"], "marker": "s", "ms": 5, "mfc": "none"}
"""Of what all motions pass."""


def motion_distribution(
    distribution: MotionDistribution,
    *,
    count: int = SAMPLES,
    seed: int = 0,
    title: str | None = None,
) -> Figure:
    """Show what motions of a distribution are like: samples, their mean, and bounds of most.

    Panels: the path of samples and of the mean in the plane of their largest extent, with what the
    limits of the position forbid (of vectors the first two coordinates); each coordinate, and of
    poses how far the tool is turned from the mean about each world axis, with the band that 95 %
    of motions stay within.  What all motions pass is marked.

    Parameters
    ----------
    distribution : MotionDistribution
        Of ``noslip.learn(..., distribution=True)``, or conditioned since.
    count : int
        Samples to draw.
    seed : int
        Of the samples.
    title : str, optional
        By default the finding: how many motions, where they differ most, and the largest residual
        of all of them.
    """
    samples = distribution.sample(count, seed=seed)
    mean, space = distribution.motion, distribution.space
    points = np.asarray(samples.positions)
    spans = np.ptp(mean.positions, axis=0)
    a, b = sorted(np.argsort(-spans, kind="stable")[:2].tolist()) if len(spans) > 1 else (0, 0)
    half = distribution.interval(LEVEL)
    share = np.linspace(0, 1, len(half))
    along = (mean.times - mean.times[0]) / mean.duration

    names = [*space.coordinates, *(f"turned about {axis}" for axis in "xyz" if space.is_pose)]
    units = [*space.units, *("rad" for _ in names[space.linear :])]
    rows = -(-len(names) // 3)
    figure = style.new_figure(style.TWO_COLUMNS, 2.6 + 1.35 * rows)
    grid = figure.add_gridspec(1 + rows, 3, height_ratios=[1.9, *[1.0] * rows])
    size = float(np.ptp(points[:, :, [a, b]], axis=(0, 1)).max())
    scale, unit = scaled_unit(size, space.units[a])
    if len(spans) > 1:
        ax = figure.add_subplot(grid[0, :])
        _draw_paths(ax, distribution, points, (a, b), scale)
        style.dress(ax, f"{names[a]} ({unit})", f"{names[b]} ({unit})", title=ax.get_title())
    for k, (name, own) in enumerate(zip(names, units, strict=True)):
        ax = figure.add_subplot(grid[1 + k // 3, k % 3])
        factor, shown = (scale, unit) if own == space.units[a] else (1.0, own)
        if k < space.linear:
            middle: Floats = factor * np.interp(share, along, mean.positions[:, k])
        else:
            factor, shown, middle = float(np.degrees(1.0)), "°", np.zeros(len(share))
        width = factor * half[:, k]
        ax.fill_between(100 * share, middle - width, middle + width, **BAND)
        ax.plot(100 * share, middle, **MEAN)
        for boundary in distribution.kept if k < space.linear else ():
            if boundary.position is not None:
                ax.plot(100 * boundary.at, factor * boundary.position[k], linestyle="none", **KEPT)
        ax.set_xlim(0, 100)
        style.dress(ax, PROGRESS, f"{name} ({shown})")
    handles: dict[str, Any] = {"mean": MEAN, f"{count} samples": SAMPLE}
    handles[f"{100 * LEVEL:g} % of motions"] = Patch(**BAND)
    if any(boundary.position is not None for boundary in distribution.kept):
        handles["all pass"] = {"linestyle": "none"} | KEPT
    style.put_legend(figure, handles)
    residuals = np.abs(np.asarray(samples.constraint_residuals))
    style.write_title(figure, title or _finding(distribution, names, half, count, residuals))
    return figure


def _draw_paths(
    ax: Axes,
    distribution: MotionDistribution,
    points: Floats,
    columns: tuple[int, int],
    scale: float,
) -> None:
    """Draw samples and the mean in a plane, to scale, over what is forbidden."""
    for path in points:
        ax.plot(*(scale * path[:, list(columns)].T), **SAMPLE)
    mean = distribution.motion
    ax.plot(*(scale * mean.positions[:, list(columns)].T), **MEAN)
    for boundary in distribution.kept:
        if boundary.position is not None:
            place = scale * np.asarray(boundary.position)[list(columns)]
            ax.plot(*place, linestyle="none", zorder=4, **KEPT)
    ax.set_aspect("equal", adjustable="datalim")
    there = []
    if distribution.space.is_pose:
        there = draw_places(ax, [mean], distribution.system, columns, scale)
    ax.set_title("\n".join(["paths", *there]), fontsize=style.SMALL_FONT_SIZE)


def _finding(
    distribution: MotionDistribution, names: list[str], half: Floats, count: int, residuals: Floats
) -> str:
    linear = distribution.space.linear
    at, which = np.unravel_index(np.argmax(half[:, :linear]), half[:, :linear].shape)
    width = value_text(float(half[at, which]), distribution.space.units[int(which)])
    where = f"{names[int(which)]} at {100 * at / (len(half) - 1):.0f} % of the time"
    text = f"{100 * LEVEL:g} % of motions stay within {width} of the mean, widest in {where}"
    if residuals.size:
        unit = distribution.system.equalities.row_units[0]
        text += f"; {count} samples: residual {residual_text(float(residuals.max()), unit)}"
    return text
