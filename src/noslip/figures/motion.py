"""One motion or several over time: position, orientation, path, constraint and its force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from noslip._typing import Floats
from noslip.constraints.check import ROUNDING, residual_text
from noslip.constraints.system import as_system
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.places import draw_places
from noslip.figures.quantities import (
    ANGLES,
    FORCE_UNITS,
    MARGIN_SHARE,
    PARTS,
    Constraints,
    Motions,
    Part,
    angle_unit,
    coupled,
    extent,
    force_parts,
    force_sizes,
    index_of,
    length_unit,
    named,
    near_angles,
    scaled_unit,
    since_start,
    widest_plane,
)
from noslip.figures.residuals import (
    ResidualRow,
    finding,
    least_margins,
    prominence,
    residual_rows,
)
from noslip.figures.snapshots import plot_tool_frame
from noslip.figures.style import short_name
from noslip.trajectory import PoseTrajectory

Plane = Literal["XY", "XZ", "YZ"]
"""In which a path is drawn."""
Scale = Literal["linear", "log"]
"""Of the axis of residuals."""

MOST_ABREAST = 3
"""Panels side by side: more are too narrow for their labels."""
STILL = 1e-6
"""Degrees by which an angle changes that stays as it is: rounding of rotations and their angles."""
TIME = "time since start (s)"
"""What every axis of time says."""


def compare_motions(
    motions: Motions,
    constraints: Constraints = (),
    *,
    tool: bool = False,
    title: str | None = None,
) -> Figure:
    """Show motions of one task together: where they go, how they turn, and how they slip.

    Panels: x, y and z; roll, pitch and yaw; the path seen along a coordinate axis, with what the
    limits of the position forbid; for each row of the constraints its residual, and once more on a
    logarithmic axis where a motion's is too small to be seen; for each limit the least margin of
    its rows, with the forbidden side shaded; the acceleration that the constraints added, where a
    rollout tells it.  What does not change has no panel: a line below names it.

    Parameters
    ----------
    motions : PoseTrajectory or mapping of them by name
        Their clocks need not agree: each is drawn over the time since its start.  The names
        "demonstration", "regular", "constrained" and "optimized" have the paper's line styles.
    constraints : Constraint or several
        None leaves their panels out.
    tool : bool
        Whether to draw the tool's frame at the left, as it starts in the first motion.
    title : str, optional
        By default the finding: what the first and the last motion slip, or the residual that is
        largest; how far from its goal a rollout ends; what is left of the tightest limit.

    Returns
    -------
    Figure
        Without a window; :func:`save_figure` writes it.

    Raises
    ------
    InputError
        If there is no motion, or one is no PoseTrajectory.
    """
    shown = named(motions)
    system = as_system(constraints)
    rows = least_margins(residual_rows(shown, system))
    forces = force_parts(m.constraint_forces for m in coupled(shown).values())
    styles = style.line_styles(shown, _told_apart(rows, shown))

    draws = _constraint_panels(shown, [row for row in rows if not row.is_zero], forces, styles)
    lower = -(-len(draws) // MOST_ABREAST)
    figure = style.new_figure(style.TWO_COLUMNS, 4.1 + 1.55 * lower)
    heights = [1.0] * 3 + [1.35] * lower
    grid = figure.add_gridspec(3 + lower, 1, height_ratios=heights)
    widths = [*([1.25] if tool else []), 1, 1, 1.25]
    upper = grid[:3].subgridspec(1, len(widths), width_ratios=widths)
    if tool:
        ax = figure.add_subplot(upper[0], projection="3d")
        plot_tool_frame(ax, next(iter(shown.values())).rotations[0])
        caption = "the tool's frame at the start\n(gray: the world's)"
        ax.set_title(caption, fontsize=style.SMALL_FONT_SIZE)

    still: list[str] = []
    poses: list[tuple[Callable[..., object], dict[str, str]]]
    poses = [(plot_positions, _resting_places(shown)), (plot_orientation, _resting_angles(shown))]
    for column, (plot, quantities) in enumerate(poses, start=-3):
        moving = [name for name, rest in quantities.items() if not rest] or list(quantities)
        still += [rest for name, rest in quantities.items() if name not in moving]
        parts = upper[len(widths) + column].subgridspec(len(moving), 1)
        stack = [figure.add_subplot(parts[row]) for row in range(len(moving))]
        for ax, quantity in zip(stack, moving, strict=True):
            plot(ax, shown, quantity, styles=styles)
            if ax is not stack[-1]:
                ax.sharex(stack[-1])
        style.stack(figure, stack)
    plot_path(figure.add_subplot(upper[-1]), shown, system, styles=styles)

    for index, part in enumerate(np.array_split(np.arange(len(draws)), lower) if lower else []):
        panels = grid[3 + index].subgridspec(1, len(part))
        for column, which in enumerate(part):
            draws[which](figure.add_subplot(panels[column]))

    zero = [row for row in rows if row.is_zero]
    still += [f"{short_name(row.name)} {residual_text(0.0, row.own_unit)}" for row in zero]
    if len(shown) > 1:
        style.name_lines(figure, shown, styles)
    if still:
        style.write_note(figure, f"Without a panel, as it does not change: {'; '.join(still)}")
    style.write_title(figure, title or (finding(rows, shown) if rows else _overview(shown)))
    return figure


def plot_positions(
    ax: Axes,
    motions: Motions,
    coordinate: str = "x",
    *,
    styles: style.Styles | None = None,
) -> list[Line2D]:
    """Draw one world coordinate, ``"x"``, ``"y"`` or ``"z"``, over time (s); m or mm."""
    shown = named(motions)
    index = index_of(coordinate, ("x", "y", "z"), "coordinate")
    scale, unit = length_unit(shown.values())
    curves = {name: (since_start(m), scale * m.positions[:, index]) for name, m in shown.items()}
    least = scale * style.LEAST_SHARE * max(map(extent, shown.values()))
    style.span_at_least(ax, [values for _, values in curves.values()], least)
    style.dress(ax, TIME, f"{coordinate} ({unit})")
    return style.draw_curves(ax, curves, styles)


def plot_orientation(
    ax: Axes,
    motions: Motions,
    angle: str = "yaw",
    *,
    degrees: bool = True,
    styles: style.Styles | None = None,
) -> list[Line2D]:
    """Draw ``"roll"``, ``"pitch"`` or ``"yaw"`` (extrinsic xyz) over time (s), degrees or radians.

    The angles do not jump; all motions begin as near as possible to the first one's.
    """
    shown = named(motions)
    index = index_of(angle, ANGLES, "angle")
    scale, unit = angle_unit(degrees)
    angles = near_angles(shown.values())
    curves = {name: scale * own[:, index] for name, own in zip(shown, angles, strict=True)}
    style.span_at_least(ax, curves.values(), scale * style.LEAST_TURN)
    style.dress(ax, TIME, f"{angle} ({unit})")
    return style.draw_curves(
        ax, {name: (since_start(shown[name]), curve) for name, curve in curves.items()}, styles
    )


def plot_speed(
    ax: Axes,
    motions: Motions,
    part: Part = "linear",
    *,
    degrees: bool = False,
    styles: style.Styles | None = None,
) -> list[Line2D]:
    """Draw how fast the tool moves or turns, over time (s), where each step ends.

    Parameters
    ----------
    ax : Axes
    motions : PoseTrajectory or mapping of them by name
    part : "linear" or "angular"
        m/s, or mm/s where all are slow; rad/s.
    degrees : bool
        Angular speed in degrees a second.
    styles : mapping of line properties by motion, optional
        As of :func:`noslip.figures.style.line_styles`, the default.
    """
    shown = named(motions)
    index = index_of(part, PARTS, "part")
    sizes = {
        name: np.linalg.norm(motion.step_velocities()[index], axis=1)
        for name, motion in shown.items()
    }
    scale, unit = scaled_unit(max(size.max() for size in sizes.values()), "m/s")
    if part == "angular":
        scale, unit = (np.degrees(1.0), "°/s") if degrees else (1.0, "rad/s")
    curves = {name: (since_start(shown[name])[1:], scale * size) for name, size in sizes.items()}
    lines = style.draw_curves(ax, curves, styles)
    ax.set_ylim(bottom=0)
    style.dress(ax, TIME, f"{'speed' if part == 'linear' else 'angular speed'} ({unit})")
    return lines


def plot_path(
    ax: Axes,
    motions: Motions,
    constraints: Constraints = (),
    *,
    plane: Plane | None = None,
    styles: style.Styles | None = None,
) -> list[Line2D]:
    """Draw the path in a world plane, to scale; a ring at each start, a square at each end.

    Parameters
    ----------
    ax : Axes
    motions : PoseTrajectory or mapping of them by name
    constraints : Constraint or several
        Where those of the position do not let the tool go is hatched: obstacles, what lies beyond
        limits; see :func:`noslip.figures.places.draw_places`.
    plane : "XY", "XZ" or "YZ"
        By default XY, seen from above, unless the motions reach further along z than along x or y;
        then the coordinate along which they reach least is left out.
    styles : mapping of line properties by motion, optional
        As of :func:`noslip.figures.style.line_styles`, the default.
    """
    shown = named(motions)
    chosen = plane or "".join("XYZ"[axis] for axis in widest_plane(shown.values()))
    axes = [index_of(letter, "XYZ", "plane") for letter in chosen]
    scale, unit = length_unit(shown.values())
    paths = {name: scale * motion.positions[:, axes].T for name, motion in shown.items()}
    lines = style.draw_curves(
        ax, {name: (across, up) for name, (across, up) in paths.items()}, styles
    )
    size = 5.0 if len(shown) <= style.MOST_NAMED else 2.5
    for line, path in zip(lines, paths.values(), strict=True):
        mark: Any = {"color": line.get_color(), "zorder": line.get_zorder() + 0.5}
        ax.plot(*path[:, :1], "o", mfc="white", ms=size, **mark)
        ax.plot(*path[:, -1:], "s", ms=0.7 * size, **mark)
    there = draw_places(ax, shown.values(), as_system(constraints), axes, scale)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    seen = "path from above" if chosen == "XY" else f"path in the {chosen} plane"
    labels = [f"{axis.lower()} ({unit})" for axis in chosen]
    style.dress(ax, *labels, title=style.with_places(f"{seen} (○ start, ■ end)", there))
    return lines


def plot_residuals(
    ax: Axes,
    motions: Motions,
    constraints: Constraints,
    *,
    row: int = 0,
    scale: Scale = "linear",
    styles: style.Styles | None = None,
) -> list[Line2D]:
    """Draw one row of the constraints' residuals over time (s), where each step ends.

    The linear axis spans at least a tenth of the top speed (of the path's extent, at position
    level) to either side: what looks like zero is small against the motion.  Of a limit it shows
    the margin, with the forbidden side shaded.  The logarithmic axis shows sizes of residuals, and
    by how much a limit is violated.
    """
    rows = residual_rows(named(motions), constraints)
    if not 0 <= row < len(rows):
        raise InputError(f"the constraints have {len(rows)} rows, counted from 0; got row {row}")
    return draw_residuals(ax, rows[row], scale, styles)


def draw_residuals(
    ax: Axes, residual: ResidualRow, scale: Scale, styles: style.Styles | None = None
) -> list[Line2D]:
    """Draw residuals already computed; see :func:`plot_residuals`."""
    sizes = {name: residual.sizes(name) for name in residual.values}
    shown = sizes if scale == "log" else residual.values
    curves = {name: (residual.times[name], shown[name]) for name in shown}
    lines = style.draw_curves(ax, curves, styles)
    if scale == "log":
        style.log_axis(ax, sizes.values(), residual.span)
        style.dress(ax, TIME, residual.size_label)
        return lines
    if residual.is_limit:
        style.shade_forbidden(ax, shown.values(), MARGIN_SHARE * residual.span)
    else:
        style.span_at_least(ax, shown.values(), 2 * residual.span)
    style.dress(ax, TIME, residual.label)
    return lines


def plot_forces(
    ax: Axes,
    motions: Motions,
    part: Part = "linear",
    *,
    styles: style.Styles | None = None,
) -> list[Line2D]:
    """Draw the size of the acceleration that the constraints added, over time (s).

    Of rollouts alone; other motions are left out.  Several motions share a logarithmic axis.

    Parameters
    ----------
    ax : Axes
    motions : PoseTrajectory or mapping of them by name
    part : "linear" or "angular"
        In m/s^2 or rad/s^2.
    styles : mapping of line properties by motion, optional
        As of :func:`noslip.figures.style.line_styles`, the default.
    """
    shown = named(motions)
    index_of(part, PARTS, "part")
    sizes = {
        name: force_sizes(motion.constraint_forces, part) for name, motion in coupled(shown).items()
    }
    lines = style.draw_curves(
        ax,
        {name: (since_start(shown[name]), sizes[name]) for name in sizes},
        styles or style.line_styles(shown),
    )
    if len(sizes) > 1:
        style.log_axis(ax, sizes.values(), 1.0)
    else:
        ax.set_ylim(bottom=0)
    style.dress(ax, TIME, f"constraint's {part} acceleration ({FORCE_UNITS[part]})")
    return lines


# ---------------------------------------------------------------- inside


def _constraint_panels(
    motions: Mapping[str, PoseTrajectory],
    rows: Sequence[ResidualRow],
    forces: Sequence[Part],
    styles: style.Styles,
) -> list[Callable[[Axes], object]]:
    """What draws the panels below a comparison's poses: equalities, limits, accelerations."""
    draws: list[Callable[[Axes], object]] = []
    for residual in sorted(rows, key=lambda row: row.is_limit):
        scales: list[Scale] = ["linear"]
        if residual.hidden:
            # Where nothing else is seen, a flat line says less than its size.
            unseen = all(map(residual.hides, residual.values))
            scales = ["log"] if unseen else ["linear", "log"]
        draws += [
            partial(draw_residuals, residual=residual, scale=scale, styles=styles)
            for scale in scales
        ]
    return draws + [
        partial(plot_forces, motions=motions, part=part, styles=styles) for part in forces
    ]


def _told_apart(rows: Sequence[ResidualRow], motions: Mapping[str, PoseTrajectory]) -> list[str]:
    """Which of many motions have a line of their own: what the title names, and rollouts."""
    if not rows:
        return list(coupled(motions))
    worst = max(rows, key=prominence)
    peak = max(worst.values, key=lambda name: (worst.peaks[name], -worst.margins[name]))
    return [peak, *coupled(motions)]


def _resting_places(motions: Mapping[str, PoseTrajectory]) -> dict[str, str]:
    """What coordinates rest at, in a few words; nothing of those that change."""
    scale, unit = length_unit(motions.values())
    places = scale * np.concatenate([motion.positions for motion in motions.values()])
    return {
        name: _resting(name, values, scale * ROUNDING, f" {unit}")
        for name, values in zip("xyz", places.T, strict=True)
    }


def _resting_angles(motions: Mapping[str, PoseTrajectory]) -> dict[str, str]:
    """The same of roll, pitch and yaw."""
    angles = np.concatenate(near_angles(motions.values()))
    return {
        name: _resting(name, values, STILL, "°")
        for name, values in zip(ANGLES, angles.T, strict=True)
    }


def _resting(name: str, values: Floats, least: float, unit: str) -> str:
    if np.ptp(values) > least:
        return ""
    value = float(np.mean(values))
    return f"{name} {style.number(value if abs(value) > least else 0.0)}{unit}"


def _overview(motions: Mapping[str, PoseTrajectory]) -> str:
    name, motion = next(iter(motions.items()))
    text = f"path of {style.number(motion.path_length)} m in {style.number(motion.duration)} s"
    others = f", and {len(motions) - 1} more" if len(motions) > 1 else ""
    return f"{style.capitalized(style.short_name(name))}: {text}{others}"
