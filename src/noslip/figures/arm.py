"""An arm's joints against their limits, and what of the tool's path it executes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noslip._typing import Floats
from noslip.constraints.check import ROUNDING, residual_text
from noslip.figures import style
from noslip.figures.motion import TIME
from noslip.figures.quantities import value_text
from noslip.robots.dynamics import Execution
from noslip.robots.executed import TrackedMotion

SO_FAR = "slipped so far (mm)"
"""Label of the way slipped."""
LIMIT: dict[str, Any] = {"color": style.PALETTE["gray"], "linestyle": "-", "linewidth": 1.0}
"""Of the line at a limit."""
LEAST_SLIP = 1e-9
"""Slip that a logarithmic axis shows at least (m/s): below, it is rounding."""


def joint_limits(tracked: TrackedMotion, *, title: str | None = None) -> Figure:
    """Show positions, velocities and accelerations of an arm's joints as shares of their limits.

    Parameters
    ----------
    tracked : TrackedMotion
    title : str, optional
        By default the smallest margin.
    """
    robot, times = tracked.robot, tracked.times
    changes = np.diff(tracked.joint_velocities, axis=0) / np.diff(times)[:, None]
    with np.errstate(invalid="ignore"):
        middle, half = (robot.upper + robot.lower) / 2, (robot.upper - robot.lower) / 2
        placed = (tracked.joint_positions - middle) / half
    shares = {
        "position in its range (share)": np.where(np.isfinite(half), placed, 0.0),
        "velocity over its limit (share)": tracked.joint_velocities / robot.velocity_limits,
        "acceleration over its limit (share)": np.pad(changes, ((0, 1), (0, 0)))
        / robot.acceleration_limits,
    }
    figure = style.new_figure(style.TWO_COLUMNS, 2.7)
    styles = style.joint_styles(robot.size)
    handles: dict[str, Any] = {}
    for ax, (label, values) in zip(figure.subplots(1, 3), shares.items(), strict=True):
        for joint, look in enumerate(styles):
            (line,) = ax.plot(times, values[:, joint], **look)
            handles[robot.joint_names[joint]] = line
        for limit in (-1, 1):
            ax.axhline(limit, **LIMIT, zorder=1)
        ax.set_ylim(-1.1, 1.1)
        style.dress(ax, TIME, label)
    style.put_legend(figure, handles | {"limits": LIMIT})
    least, whose = tracked.margins.smallest
    found = f"All limits are kept: the tightest, {whose}, has {least:.0%} left"
    if least < 0:
        found = f"The {whose} is beyond its limit, by {-least:.0%}"
    style.write_title(figure, title or found)
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
    """
    runs: dict[str, Any] = {"kinematic": tracked}
    if execution is not None:
        runs[f"dynamic, {execution.control} control"] = execution
    lines = style.line_styles(runs)
    figure = style.new_figure(style.TWO_COLUMNS, 4.2)
    panels: list[Axes] = list(figure.subplots(2, 3, sharex=True).flat)
    times = tracked.times - tracked.times[0]
    slips = {name: np.abs(run.slip).max(axis=1, initial=0.0) for name, run in runs.items()}
    unit = ", ".join(dict.fromkeys(tracked.system.equalities.row_units)) or "m/s"
    what = "slip" if unit == "m/s" else "residual"
    for name, run in runs.items():
        off, sizes = run.errors, np.abs(run.slip[:, tracked.system.equalities.row_is_velocity])
        curves: dict[str, Floats] = {
            f"{what} ({unit})": slips[name],
            "off along (mm)": 1e3 * off.along,
            "off sideways (mm)": 1e3 * off.lateral,
            "off in depth (mm)": 1e3 * off.depth,
            "off in angle (°)": np.degrees(off.rotation),
            SO_FAR: 1e3 * np.cumsum(sizes.max(axis=1, initial=0.0) * np.diff(times)),
        }
        for k, (ax, (label, curve)) in enumerate(zip(panels, curves.items(), strict=True)):
            # What is of a step lies at its end.
            ax.plot(times[-len(curve) :], curve, **lines[name])
            style.dress(ax, TIME if k > 2 else "", label)
    style.log_axis(panels[0], slips.values(), LEAST_SLIP)
    style.name_lines(figure, runs)
    name, run = list(runs.items())[-1]
    peak = float(slips[name].max())
    most = residual_text(peak, unit, order="at most")
    found = f"{what} {most}"
    if what == "slip":
        found = "does not slip"
        if peak >= ROUNDING:
            found = f"slips {value_text(float(curves[SO_FAR][-1]) / 1e3, 'm')} ({most})"
    away = value_text(float(run.errors.position.max()), "m")
    found = f"{name}: the tool {found}, at most {away} off its path"
    style.write_title(figure, title or found[:1].upper() + found[1:])
    return figure
