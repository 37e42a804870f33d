"""An arm's joints against their limits, and what of the tool's path it executes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noslip._typing import Floats
from noslip.figures.motion import TIME
from noslip.figures.style import (
    PALETTE,
    TWO_COLUMNS,
    dress,
    line_styles,
    log_axis,
    name_lines,
    new_figure,
    number,
    put_legend,
    trial_styles,
    write_title,
)
from noslip.robots.dynamics import Execution
from noslip.robots.executed import TrackedMotion

LEAST_SLIP = 1e-9
"""Slip that a logarithmic axis shows at least (m/s): below, it is rounding."""


def joint_limits(tracked: TrackedMotion, *, title: str | None = None) -> Figure:
    """Show positions, velocities and accelerations of an arm's joints as shares of their limits.

    Parameters
    ----------
    tracked : TrackedMotion
    title : str, optional
        By default the smallest margin.

    Returns
    -------
    Figure
    """
    robot, times = tracked.robot, tracked.times
    h = np.diff(times)[:, None]
    with np.errstate(invalid="ignore"):
        middle, half = (robot.upper + robot.lower) / 2, (robot.upper - robot.lower) / 2
        placed = (tracked.joint_positions - middle) / half
    shares = {
        "position in its range": np.where(np.isfinite(half), placed, 0.0),
        "velocity over its limit": tracked.joint_velocities / robot.velocity_limits,
        "acceleration over its limit": np.vstack(
            [np.diff(tracked.joint_velocities, axis=0) / h, np.zeros((1, robot.size))]
        )
        / robot.acceleration_limits,
    }
    figure = new_figure(TWO_COLUMNS, 2.7)
    styles = trial_styles(robot.size)
    handles: dict[str, Any] = {}
    for ax, (label, values) in zip(figure.subplots(1, 3), shares.items(), strict=True):
        for joint, style in enumerate(styles):
            (line,) = ax.plot(times, values[:, joint], **style)
            handles[robot.joint_names[joint]] = line
        for limit in (-1, 1):
            ax.axhline(limit, color=PALETTE["gray"], linewidth=1.0, zorder=1)
        ax.set_ylim(-1.1, 1.1)
        dress(ax, TIME, label)
    put_legend(figure, handles)
    least, whose = tracked.margins.smallest
    write_title(figure, title or f"All limits are kept: least is left of {whose}, {least:.0%}")
    return figure


def executed_slip(
    tracked: TrackedMotion, execution: Execution | None = None, *, title: str | None = None
) -> Figure:
    """Show the slip of the executed tool, and how far it is off the commanded path, over time.

    Parameters
    ----------
    tracked : TrackedMotion
        Kinematic.
    execution : Execution, optional
        By the arm's dynamics.
    title : str, optional
        By default the largest slip and error.

    Returns
    -------
    Figure
    """
    runs: dict[str, Any] = {"kinematic": tracked}
    if execution is not None:
        runs[f"dynamic, {execution.control} control"] = execution
    lines = line_styles(runs)
    figure = new_figure(TWO_COLUMNS, 4.2)
    panels: list[Axes] = list(figure.subplots(2, 3, sharex=True).flat)
    times = tracked.times - tracked.times[0]
    slips = {name: np.abs(run.slip).max(axis=1, initial=0.0) for name, run in runs.items()}
    for name, run in runs.items():
        off = run.errors
        curves: tuple[Floats, ...] = (1e3 * off.along, 1e3 * off.lateral, 1e3 * off.depth)
        panels[0].plot(times[1:], slips[name], **lines[name])
        for ax, curve in zip(panels[1:4], curves, strict=True):
            ax.plot(times, curve, **lines[name])
        panels[4].plot(times, np.degrees(off.rotation), **lines[name])
        sizes = np.abs(run.slip[:, tracked.system.equalities.row_is_velocity])
        slipped = np.cumsum(sizes.max(axis=1, initial=0.0) * np.diff(times))
        panels[5].plot(times[1:], 1e3 * slipped, **lines[name])
    log_axis(panels[0], slips.values(), LEAST_SLIP)
    unit = ", ".join(dict.fromkeys(tracked.system.equalities.row_units)) or "m/s"
    what = "slip" if unit == "m/s" else "residual"
    labels = (
        f"{what} ({unit})",
        "off along (mm)",
        "off sideways (mm)",
        "off in depth (mm)",
        "off in angle (°)",
        "slipped so far (mm)",
    )
    for k, (ax, label) in enumerate(zip(panels, labels, strict=True)):
        dress(ax, TIME if k > 2 else "", label)
    name_lines(figure, runs)
    name, run = list(runs.items())[-1]
    found = (
        f"{name}: {what} of the executed tool at most {number(float(slips[name].max()))} {unit}, "
        f"at most {number(1e3 * float(run.errors.position.max()))} mm off its path"
    )
    write_title(figure, title or found[:1].upper() + found[1:])
    return figure
