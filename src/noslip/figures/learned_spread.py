"""What several demonstrations said about one primitive: where they agree, and where they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from noslip._typing import Floats
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.motion import plot_path
from noslip.figures.quantities import (
    angle_unit,
    extent,
    index_of,
    length_unit,
    since_start,
    value_text,
    widest_plane,
)
from noslip.figures.spread import PROGRESS
from noslip.primitive import ConstrainedDMP
from noslip.spread import Spread
from noslip.trajectory import PoseTrajectory

ELLIPSES: Floats = np.linspace(0.0, 1.0, 11)
"""Fractions of the duration at which the path has an ellipse: every tenth."""
CIRCLE: Floats = np.column_stack(
    [function(np.linspace(0, 2 * np.pi, 73)) for function in (np.cos, np.sin)]
)
"""Points of a unit circle, one every 5 degrees, of which ellipses are made."""
SEEN = 0.05
"""Share of the path's extent below which the largest half axis is enlarged: smaller, it would be
hidden by the path's line."""
AGREED = 1e-9
"""Standard deviation (m or rad) that is rounding."""

QUANTITIES = ("x", "y", "z", "turned about x", "turned about y", "turned about z")
"""Of a primitive's motion, that have a spread."""
BANDS: dict[int, dict[str, Any]] = {
    2: {"alpha": 0.18, "linewidth": 0},
    1: {"alpha": 0.35, "linewidth": 0},
}
"""Style by number of standard deviations, the outer one first."""
MOTION: dict[str, Any] = {"linewidth": 1.2}
"""Of the motion itself."""
LEAST: dict[str, Any] = {
    "color": style.PALETTE["vermillion"],
    "linewidth": 1.0,
    "linestyle": (0, (3, 2)),
}
"""Of the instant at which the demonstrations agree least."""


def learned_spread(dmp: ConstrainedDMP, *, title: str | None = None) -> Figure:
    """Show a primitive's motion, and how far its demonstrations lie apart along it.

    Panels, over the share of the motion's time: x, y and z, and how far the tool has turned about
    each world axis (degrees, summed over the steps), each with bands of 1 and 2 standard
    deviations; the path in the world plane of its largest extent, with ellipses of 2 standard
    deviations at each tenth of the time, enlarged by a factor that its title tells where they
    would be too small.

    Parameters
    ----------
    dmp : ConstrainedDMP
        Learned from two demonstrations or more.
    title : str, optional
        By default the finding: along and about which axis they agree least, when, and by how much.

    Raises
    ------
    InputError
        If the primitive has no spread.
    """
    spread = _spread_of(dmp)
    motion = dmp.rollout()

    # A wide path lies below the panels, three in a row; a high one beside them, three in a column.
    reach = np.ptp(motion.positions, axis=0)[list(widest_plane([motion]))]
    wide = bool(reach[0] >= 1.8 * reach[1])
    figure = style.new_figure(style.TWO_COLUMNS, 4.8 if wide else 4.4)
    ratios = {"height_ratios" if wide else "width_ratios": (1, 1, 1.25)}
    grid = figure.add_gridspec(3, 3, **ratios)
    for kind, quantities in enumerate([QUANTITIES[:3], QUANTITIES[3:]]):
        panels = [figure.add_subplot(grid[(kind, i) if wide else (i, kind)]) for i in range(3)]
        for i, (ax, quantity) in enumerate(zip(panels, quantities, strict=True)):
            plot_learned_spread(ax, dmp, quantity)
            lowest = kind == 1 if wide else i == 2
            ax.tick_params(labelbottom=lowest)
            if not lowest:
                ax.set_xlabel("")
        if (worst := _worst(spread)[kind]) is not None:
            axis, at, _ = worst
            panels[axis].axvline(100 * at, **LEAST)
        figure.align_ylabels(panels)
    plot_ellipses(figure.add_subplot(grid[2, :] if wide else grid[:, 2]), dmp)

    handles: dict[str, Any] = {"primitive": MOTION | {"color": "black"}}
    for count, look in sorted(BANDS.items()):
        name = f"{count} standard deviation{'s' if count > 1 else ''}"
        handles[name] = Patch(facecolor="black", **look)
    if any(_worst(spread)):
        handles["agree least"] = LEAST
    style.put_legend(figure, handles)
    style.write_title(figure, title or _finding(spread))
    return figure


def plot_learned_spread(
    ax: Axes, dmp: ConstrainedDMP, quantity: str = "x", *, degrees: bool = True
) -> list[Artist]:
    """Draw one quantity of a primitive's motion, with bands of its demonstrations' spread.

    Over the share of the motion's time; see :func:`learned_spread`.

    Parameters
    ----------
    ax : Axes
    dmp : ConstrainedDMP
        Learned from two demonstrations or more.
    quantity : str
        ``"x"``, ``"y"`` or ``"z"`` (m or mm), or ``"turned about x"`` and so on.
    degrees : bool
        Unit of what has turned; else radians.

    Returns
    -------
    list
        The bands of 2 and of 1 standard deviations, and the line.
    """
    spread = _spread_of(dmp)
    kind, axis = divmod(index_of(quantity, QUANTITIES, "quantity"), 3)
    motion = dmp.rollout()
    if kind == 0:
        scale, unit = length_unit([motion])
        values, deviations = motion.positions, spread.position_deviation
        least, color = scale * style.LEAST_SHARE * extent(motion), style.PALETTE["blue"]
    else:
        turn, unit = angle_unit(degrees)
        scale = turn * float(np.degrees(1.0))
        values, deviations = turns(motion), spread.rotation_deviation
        least, color = turn * style.LEAST_TURN, style.PALETTE["green"]

    share = since_start(motion) / motion.duration
    curve, deviation = scale * values[:, axis], scale * deviations[:, axis]
    middle = np.interp(spread.fractions, share, curve)
    artists: list[Artist] = []
    for count, look in BANDS.items():
        edges = middle - count * deviation, middle + count * deviation
        artists.append(ax.fill_between(100 * spread.fractions, *edges, color=color, **look))
    artists += ax.plot(100 * share, curve, color=color, **MOTION)
    ax.set_xlim(0, 100)
    style.span_at_least(ax, [curve, middle - 2 * deviation, middle + 2 * deviation], least)
    style.dress(ax, PROGRESS, f"{quantity} ({unit})")
    return artists


def plot_ellipses(ax: Axes, dmp: ConstrainedDMP) -> list[Artist]:
    """Draw a primitive's path in the world plane of its largest extent, to scale, with its spread.

    Ellipses of 2 standard deviations at each tenth of the time, enlarged by a factor that the title
    tells where they would be too small.

    Returns
    -------
    list
        The path's line, then the ellipses.
    """
    spread, motion = _spread_of(dmp), dmp.rollout()
    color, (a, b) = style.PALETTE["blue"], widest_plane([motion])
    artists: list[Artist] = [*plot_path(ax, motion)]
    for line in ax.lines:
        line.set_color(color)
    scale, _ = length_unit([motion])
    at = np.round(ELLIPSES * (len(spread.fractions) - 1)).astype(int)
    share = since_start(motion) / motion.duration
    path = scale * motion.positions[:, [a, b]]
    middles = [[np.interp(f, share, axis) for axis in path.T] for f in spread.fractions[at]]
    variances, directions = np.linalg.eigh(spread.positions[at][:, [[a], [b]], [a, b]])
    halves = 2 * scale * directions * np.sqrt(np.maximum(variances, 0.0))[:, None, :]
    largest = float(np.linalg.norm(halves, axis=1).max())
    factor = enlargement(largest, scale * extent(motion))
    for middle, half in zip(middles, halves, strict=True):
        outline = np.array(middle) + factor * CIRCLE @ half.T
        face = (color, BANDS[2]["alpha"])
        artists += ax.fill(*outline.T, facecolor=face, edgecolor=color, linewidth=0.5)
        ax.plot(*middle, ".", color=color, ms=3)
    enlarged = f" (× {factor:.0f})" if factor > 1 else ""
    caption = f"2 standard deviations{enlarged}, each 10 %"
    ax.set_title(f"{ax.get_title()}\n{caption}", fontsize=style.SMALL_FONT_SIZE)
    return artists


def turns(motion: PoseTrajectory) -> Floats:
    """How far a motion has turned about each world axis since its start, shape (N, 3), radians.

    The sum of the steps' rotation vectors; unlike angles it knows no limit and no jump.
    """
    steps = (motion.rotations[1:] * motion.rotations[:-1].inv()).as_rotvec()
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


# ---------------------------------------------------------------- inside


def _spread_of(dmp: ConstrainedDMP) -> Spread:
    if dmp.spread is None:
        raise InputError(
            "the primitive has no spread: it was learned from one demonstration, or saved before "
            "spreads were kept; learn it from several demonstrations"
        )
    return dmp.spread


def enlargement(largest: float, reach: float) -> float:
    """Return by how much, 1, 2, 5, 10 and so on, to enlarge a size until it is seen on a path."""
    if largest <= reach * AGREED or largest >= SEEN * reach:
        return 1.0
    wanted = SEEN * reach / largest
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(min(step * decade for step in (1, 2, 5, 10) if step * decade >= wanted))


def _worst(spread: Spread) -> list[tuple[int, float, float] | None]:
    """Axis, fraction and size of the largest deviation (m, rad); None of what is rounding."""
    found: list[tuple[int, float, float] | None] = []
    for deviation in (spread.position_deviation, spread.rotation_deviation):
        at, axis = np.unravel_index(np.argmax(deviation), deviation.shape)
        size = float(deviation[at, axis])
        found.append((int(axis), float(spread.fractions[at]), size) if size > AGREED else None)
    return found


def _finding(spread: Spread) -> str:
    """Say where the demonstrations agree least, and by how much."""
    parts = []
    for kind, worst in zip(("along", "about"), _worst(spread), strict=True):
        if worst is not None:
            axis, at, size = worst
            text = (
                value_text(size, "m") if kind == "along" else f"{style.number(np.degrees(size))}°"
            )
            parts.append((f"{kind} {'xyz'[axis]} at {100 * at:.0f} %", text))
    who = f"{spread.demonstrations} demonstrations"
    if not parts:
        return f"{who} agree, starts and goals aside"
    (where, size_text), *others = parts
    text = f"{who} agree least {where} of the time (standard deviation {size_text})"
    return text + "".join(f",\nand {where} ({size_text})" for where, size_text in others)
