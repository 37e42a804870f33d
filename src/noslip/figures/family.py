"""A primitive adapted to other goals: where the family goes, how near it ends, what it slips."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.edge import Axis, Edge, unit_axis
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.places import draw_places
from noslip.figures.quantities import Constraints, Motions, named, scaled_unit, value_text
from noslip.figures.residuals import residual_rows, violations
from noslip.figures.snapshots import equally_far_apart
from noslip.figures.style import MANY, MOST_NAMED
from noslip.trajectory import PoseTrajectory

SIDE_VIEW = 0.15
"""Share of the family's reach from which its least axis gets a view of its own: flatter paths are
seen from above."""
TICK = 0.035
"""Half the length of a tick across the tool, as a share of the family's reach: its direction is
seen, and neighbors do not touch."""
MOST_TICKS, FEWEST_TICKS = 9, 4
"""Ticks along a motion that has a color of its own, when it is alone and when there are many: the
figure has as much ink."""
SEEN = 0.5
"""Share of its length that an axis of the tool must show in a view to be drawn there: a
foreshortened one misleads."""
VISIBLE_SHARE, VISIBLE_TURN = 1e-3, 0.1
"""Displacement of a goal (of the path's length) and its turn (degrees) that are worth telling."""

ORIGINAL: dict[str, Any] = {"color": style.PALETTE["gray"], "linewidth": 3.2, "zorder": 1.5}
"""Gray, wide and below the others, which go the same way at first."""
ON_TOP: dict[str, Any] = {"color": style.PALETTE["black"], "linewidth": 1.5, "zorder": 2.8}
"""The original among so many others that would hide it."""
WANTED: dict[str, Any] = {"color": style.PALETTE["black"], "mfc": "none", "mew": 0.7, "marker": "s"}
"""A goal: an open mark, through which the end of a motion is seen."""
FAILED: dict[str, Any] = {"color": style.PALETTE["vermillion"], "marker": "x", "mew": 1.3, "ms": 5}
"""A goal that no motion was found for."""
NOTHING: dict[str, Any] = {"color": style.PALETTE["black"], "marker": "v", "mfc": "white", "ms": 4}
"""A size of zero, which a logarithmic axis cannot show."""
HATS = {"x": "x̂", "y": "ŷ", "z": "ẑ"}
"""What axes of the tool are called."""
ENDS = "ends off by"
"""Heading of the panels of ends."""
FOOT = 0.05
"""Height of the marks of what a logarithmic axis cannot show, as a share of the axis: on its
foot."""


def adapted_family(
    original: PoseTrajectory,
    adapted: Motions,
    goals: Mapping[str, Boundary],
    constraints: Constraints = (),
    *,
    title: str | None = None,
) -> Figure:
    """Show the motions of a primitive adapted to other goals, and how well they get there.

    Panels: the paths in the plane in which they reach furthest, and from the side if they leave it,
    with the tool's lateral axis across them here and there, and what the constraints of the
    position forbid; for each goal how far from it the motion ends, in position and in rotation;
    and the largest residual of the constraints.  Up to 8 motions have a color each.

    Parameters
    ----------
    original : PoseTrajectory
        Of the primitive as it was learned.
    adapted : PoseTrajectory or mapping of them by name
    goals : mapping of Boundary by name
        Where each should end.  A goal without a motion is drawn as failed.
    constraints : Constraint or several
        None leaves their panel out.
    title : str, optional
        By default the finding: how far away the goals are, and the largest errors.

    Raises
    ------
    InputError
        If there is no motion, or one without a goal.
    """
    motions = named(adapted)
    if strangers := [name for name in motions if name not in goals]:
        raise InputError(f"goals lack {strangers[0]!r}, which adapted holds; name a goal for each")
    named({"original": original})
    numbers = {name: index for index, name in enumerate(goals, start=1)}
    styles = dict.fromkeys(motions, MANY)
    if len(motions) <= MOST_NAMED:
        # By number: some names, such as "regular", have styles of their own.
        colors = style.line_styles(str(index) for index in range(len(motions)))
        styles = dict(zip(motions, colors.values(), strict=True))
    system = as_system(constraints)
    panels = _measured(motions, goals, system)

    wanted = [goal.position[None] for goal in goals.values() if goal.position is not None]
    views = _views([original, *motions.values()], wanted)
    figure = style.new_figure(
        style.TWO_COLUMNS, max(2.9, 0.7 + 1.25 * len(panels)) + 0.7 * (len(views) - 1)
    )
    grid = figure.add_gridspec(1, 2, width_ratios=(1.35, 1))
    paths = grid[0].subgridspec(len(views), 1, height_ratios=(2, 1)[: len(views)])
    ticks = []
    for row, view in enumerate(views):
        ax = figure.add_subplot(paths[row])
        tick, there = _draw_paths(ax, view, original, motions, goals, styles, system)
        ticks.append(tick)
        caption = style.with_places("" if row else "paths (○ start, ■ end)", there)
        ax.set_title(caption, fontsize=style.SMALL_FONT_SIZE)
    stack = grid[1].subgridspec(max(1, len(panels)), 1)
    axes = [figure.add_subplot(stack[row]) for row in range(len(panels))]
    for ax, panel in zip(axes, panels, strict=True):
        _draw_sizes(ax, panel, numbers, styles)
    style.stack(figure, axes)

    nothing = any(0 in panel.values.values() for panel in panels)
    failed = any(name not in motions for name in goals)
    style.put_legend(figure, _handles(styles, ticks, failed=failed, nothing=nothing))
    style.write_title(figure, title or _finding(original, motions, goals, panels))
    return figure


def end_errors(motion: PoseTrajectory, goal: Boundary) -> tuple[float | None, float | None]:
    """Return how far from its goal a motion ends: meters and radians, None of what is left free."""
    off = turned = None
    if goal.position is not None:
        off = float(np.linalg.norm(motion.positions[-1] - goal.position))
    if goal.rotation is not None:
        turned = float((motion.rotations[-1].inv() * goal.rotation).magnitude())
    return off, turned


# ---------------------------------------------------------------- what is measured


@dataclass(frozen=True)
class _Sizes:
    """One number a motion, of those that have it, in SI units or degrees."""

    name: str
    unit: str
    values: dict[str, float]

    @property
    def text(self) -> str:
        """The largest of all with its unit."""
        if self.unit == "°":
            return f"{style.number(self.most)}°"
        return value_text(self.most, self.unit).replace(" SI", " in SI units")

    @property
    def most(self) -> float:
        return max(self.values.values())


def _measured(
    motions: Mapping[str, PoseTrajectory], goals: Mapping[str, Boundary], system: ConstraintSystem
) -> list[_Sizes]:
    """What the panels beside the paths show; nothing that is not there."""
    errors = {name: end_errors(motion, goals[name]) for name, motion in motions.items()}
    off = {name: found for name, (found, _) in errors.items() if found is not None}
    turned = {name: np.degrees(found) for name, (_, found) in errors.items() if found is not None}
    rows = residual_rows(motions, system) if system.size else []
    peaks = {
        name: max(
            float(violations(row.values[name], row.is_limit).max()) / row.scale for row in rows
        )
        for name in (motions if rows else ())
    }
    units = {row.own_unit for row in rows}
    sizes = [
        _Sizes(ENDS, "m", off),
        _Sizes(ENDS, "°", turned),
        _Sizes(
            "violation" if any(row.is_limit for row in rows) else "residual",
            units.pop() if len(units) == 1 else "SI",
            peaks,
        ),
    ]
    return [size for size in sizes if size.values]


def _finding(
    original: PoseTrajectory,
    motions: Mapping[str, PoseTrajectory],
    goals: Mapping[str, Boundary],
    panels: Sequence[_Sizes],
) -> str:
    """Say how far away the goals are, and how well all of them are reached."""
    away = [end_errors(original, goals[name]) for name in motions]
    share = max(off or 0.0 for off, _ in away) / (original.path_length or 1.0)
    turn = np.degrees(max(turned or 0.0 for _, turned in away))
    count = f"{len(motions)} of {len(goals)}" if len(motions) < len(goals) else f"{len(goals)}"
    text = "One goal" if len(goals) == 1 else f"{count} goals"
    up_to = " up to" if len(goals) > 1 else ""
    where = []
    if share >= VISIBLE_SHARE:
        where.append(f"{style.number(100 * share)} % of the path away")
    if turn >= VISIBLE_TURN:
        where.append(f"turned by {style.number(turn)}°")
    if where:
        text += f"{up_to} {' and '.join(where)}"
    ends = [panel.text for panel in panels if panel.name == ENDS]
    results = [f"ends within {' and '.join(ends).replace('< ', '')}"] if ends else []
    results += [f"{panel.name} {panel.text}" for panel in panels if panel.name != ENDS]
    return f"{text}: {', '.join(results)}" if results else text


# ---------------------------------------------------------------- what is drawn


def _views(family: Sequence[PoseTrajectory], goals: Iterable[Floats]) -> list[tuple[int, int]]:
    """World axes of each view of the paths: that of the furthest reach, and one from the side."""
    reach = np.ptp(np.concatenate([*(motion.positions for motion in family), *goals]), axis=0)
    a, b = sorted(np.argsort(-reach, kind="stable")[:2].tolist())
    least = 3 - a - b
    return [(a, b), (a, least)] if reach[least] > SIDE_VIEW * reach.max() else [(a, b)]


def _draw_paths(
    ax: Axes,
    view: tuple[int, int],
    original: PoseTrajectory,
    motions: Mapping[str, PoseTrajectory],
    goals: Mapping[str, Boundary],
    styles: Mapping[str, dict[str, Any]],
    system: ConstraintSystem,
) -> tuple[str, list[str]]:
    """Draw all paths in a plane, to scale; return what the ticks across them, and places, are."""
    family = [original, *motions.values()]
    reach = float(np.ptp(np.concatenate([m.positions for m in family]), axis=0).max()) or 1.0
    scale, unit = scaled_unit(reach)
    columns = list(view)
    few = len(motions) <= MOST_NAMED
    before = ORIGINAL if few else ON_TOP
    count = max(FEWEST_TICKS, MOST_TICKS + 1 - len(motions)) if few else 1
    axis, tick = _tool_axis(system, family, columns)

    looks = [before, *styles.values()]
    paths = [scale * motion.positions[:, columns] for motion in family]
    for name, path, look in zip(["", *motions], paths, looks, strict=True):
        ax.plot(*path.T, **look, label=style.short_name(name))
    size = 4.5 if few else 1.9
    for motion, path, look in zip(family, paths, looks, strict=True):
        color = look["color"]
        if motion is not original:
            # Fewer of a motion that rests; the last one lies at its end.
            where = equally_far_apart(motion, count + 1)[1:]
            along = TICK * reach * motion.rotations[where].apply(unit_axis(axis))
            middle = motion.positions[where]
            ticks = scale * np.stack([middle - along, middle + along], axis=1)[:, :, columns]
            ax.add_collection(LineCollection(list(ticks), colors=color, linewidths=0.8))
        ax.plot(*path[-1], "s", color=color, ms=0.75 * size, zorder=3)
        ax.plot(*path[0], "o", color=color, mfc="white", ms=size, zorder=3.2)
    for name, goal in goals.items():
        if goal.position is None:
            continue
        place = scale * goal.position[columns]
        if name in motions:
            ax.plot(*place, **WANTED, ms=1.6 * size, zorder=3.5)
        else:
            ax.plot(*place, **FAILED, zorder=4)
    there = draw_places(ax, family, system, columns, scale)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    style.dress(ax, *(f"{'xyz'[column]} ({unit})" for column in columns))
    return tick, there


def _tool_axis(
    system: ConstraintSystem, family: Sequence[PoseTrajectory], columns: Sequence[int]
) -> tuple[Axis, str]:
    """Body axis that ticks show, and what it is: the lateral one, unless it points at the eye."""
    tool = system.edged.edge if system.edged and system.edged.edge else Edge()
    lateral, edge = tool.lateral or "y", tool.travel
    across = np.concatenate([motion.rotations.apply(unit_axis(lateral)) for motion in family])
    seen = np.median(np.linalg.norm(across[:, columns], axis=1)) >= SEEN
    axis, role = (lateral, "lateral axis") if seen else (edge, "edge")
    hat = f"{HATS[axis.removeprefix('-')]}, " if isinstance(axis, str) else ""
    return axis, f"{hat}the tool's {role}"


def _draw_sizes(
    ax: Axes,
    panel: _Sizes,
    numbers: Mapping[str, int],
    styles: Mapping[str, dict[str, Any]],
) -> None:
    """Draw one value a goal on a logarithmic axis; what is zero, and failed, at its foot."""
    scale, unit = scaled_unit(panel.most, panel.unit)
    positive = [scale * value for value in panel.values.values() if value > 0]
    if positive:
        ax.set_yscale("log")
        # Whole decades, so that two of them have a number.
        ends = np.log10([min(positive) / 2, 1.2 * max(positive)])
        ax.set_ylim(10 ** np.floor(ends[0]), 10 ** np.ceil(ends[1]))
        ax.yaxis.set_minor_formatter(NullFormatter())
    else:
        ax.set_ylim(-FOOT, 1 - FOOT)
        ax.set_yticks([0])
    size = 4.5 if len(styles) <= MOST_NAMED else 2.5
    foot = ax.get_xaxis_transform()
    for name, place in numbers.items():
        if name not in styles:
            ax.plot(place, FOOT, linestyle="none", transform=foot, **FAILED)
        elif panel.values.get(name) == 0:
            ax.plot(place, FOOT, linestyle="none", transform=foot, **NOTHING)
        elif name in panel.values:
            color = styles[name]["color"] if styles[name] is not MANY else style.PALETTE["blue"]
            ax.plot(place, scale * panel.values[name], "o", color=color, ms=size, mew=0)
    room = max(0.5, 0.02 * len(numbers))
    ax.set_xlim(1 - room, len(numbers) + room)
    ax.xaxis.set_major_locator(MaxNLocator(8, integer=True, min_n_ticks=1))
    style.dress(ax, "goal (number)", f"{panel.name} ({unit})")


def _handles(
    styles: Mapping[str, dict[str, Any]], ticks: Sequence[str], *, failed: bool, nothing: bool
) -> dict[str, dict[str, Any]]:
    many, mark = len(styles) > MOST_NAMED, {"linestyle": "none"}
    handles = {"original primitive": ON_TOP if many else ORIGINAL}
    handles |= {f"adapted ({len(styles)})": MANY} if many else styles
    handles["wanted goal"] = mark | {"ms": 7} | WANTED
    handles |= dict.fromkeys(ticks, mark | {"color": "black", "marker": "|", "ms": 7})
    if failed:
        handles["failed"] = mark | FAILED
    if nothing:
        handles["exactly 0"] = mark | NOTHING
    return handles
