"""One motion or several over time: position, orientation, path, constraint and its force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

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
from noslip.figures.residuals import ResidualRow, finding, least_margins, residual_rows
from noslip.trajectory import PoseTrajectory

Plane = Literal["XY", "XZ", "YZ"]
"""In which a path is drawn."""
Scale = Literal["linear", "log"]
"""Of the axis of residuals."""

TIME = "time since start (s)"
"""What every axis of time says."""


def compare_motions(
    motions: Motions, constraints: Constraints = (), *, title: str | None = None
) -> Figure:
    """Show motions of one task together: where they go, how they turn, and how they slip.

    Panels: x, y and z; roll, pitch and yaw; the path seen along a coordinate axis; for each row of
    the constraints its residual, and once more on a logarithmic axis where a motion's is too small
    to be seen; for each limit the least margin of its rows, with the forbidden side shaded; the
    acceleration that the constraints added, where a rollout tells it.

    Parameters
    ----------
    motions : PoseTrajectory or mapping of them by name
        Their clocks need not agree: each is drawn over the time since its start.  The names
        "demonstration", "regular", "constrained" and "optimized" have the paper's line styles.
    constraints : Constraint or several
        None leaves their panels out.
    title : str, optional
        By default the finding: the largest residual of the last motion, and of the first; what
        they leave of the tightest limit.

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
    rows = least_margins(residual_rows(shown, constraints))
    forces = force_parts(m.constraint_forces for m in coupled(shown).values()) if rows else []

    lines = _constraint_panels(shown, rows, forces)
    lower = len(lines)
    figure = style.new_figure(style.TWO_COLUMNS, 4.1 + 1.55 * lower)
    heights = [1.0] * 3 + [1.35] * lower
    grid = figure.add_gridspec(3 + lower, 1, height_ratios=heights)
    upper = grid[:3].subgridspec(3, 3, width_ratios=(1, 1, 1.25))

    poses: list[tuple[Callable[[Axes, Motions, str], object], Sequence[str]]]
    poses = [(plot_positions, ("x", "y", "z")), (plot_orientation, ANGLES)]
    for column, (plot, quantities) in enumerate(poses):
        stack = [figure.add_subplot(upper[row, column]) for row in range(3)]
        for ax, quantity in zip(stack, quantities, strict=True):
            plot(ax, shown, quantity)
            if ax is not stack[2]:
                ax.sharex(stack[2])
        style.stack(figure, stack)
    plot_path(figure.add_subplot(upper[:, 2]), shown)

    for index, draws in enumerate(lines, start=3):
        panels = grid[index].subgridspec(1, len(draws))
        for column, draw in enumerate(draws):
            draw(figure.add_subplot(panels[column]))

    if len(shown) > 1:
        style.name_lines(figure, shown)
    style.write_title(figure, title or (finding(rows) if rows else _overview(shown)))
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
    style.dress(ax, *labels, title="\n".join([f"{seen} (○ start, ■ end)", *there]))
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
    motions: Mapping[str, PoseTrajectory], rows: Sequence[ResidualRow], forces: Sequence[Part]
) -> list[list[Callable[[Axes], object]]]:
    """What draws the panels below a comparison's poses, line by line.

    An equality has a line of its own, limits and forces share theirs; a single constraint shares
    its line with its forces.
    """
    lines: list[list[Callable[[Axes], object]]] = []
    rest: list[Callable[[Axes], object]] = []
    for residual in rows:
        scales: list[Scale] = ["linear"]
        if residual.hidden:
            scales = ["linear", "log"] if len(motions) > 1 else ["log"]
        draws = [partial(draw_residuals, residual=residual, scale=scale) for scale in scales]
        if residual.is_limit:
            rest += draws
        else:
            lines.append([*draws])
    rest += [partial(plot_forces, motions=motions, part=part) for part in forces]
    if len(rows) == 1:
        return [[draw for line in [*lines, rest] for draw in line]]
    return lines + [rest[i : i + 2] for i in range(0, len(rest), 2)]


def _overview(motions: Mapping[str, PoseTrajectory]) -> str:
    name, motion = next(iter(motions.items()))
    text = f"path of {style.number(motion.path_length)} m in {style.number(motion.duration)} s"
    others = f", and {len(motions) - 1} more" if len(motions) > 1 else ""
    return f"{style.capitalized(style.short_name(name))}: {text}{others}"
