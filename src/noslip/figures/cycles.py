"""A rhythm, cycle upon cycle: how it goes round, and how well it comes back."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.check import ROUNDING
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.motion import STILL
from noslip.figures.quantities import ANGLES, Constraints, roll_pitch_yaw, scaled_unit, value_text
from noslip.figures.residuals import finding, least_margins, residual_rows
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

PHASE = "share of the period (%)"
"""What the axis of a cycle's time says."""
MOST_ABREAST = 3
"""Panels side by side."""
POINTS = 201
"""At which cycles are compared: every half percent of the period."""
EARLIER: dict[str, Any] = {"color": style.PALETTE["sky"], "linewidth": 0.7}
"""Of all cycles but the last."""
LAST: dict[str, Any] = {"color": style.PALETTE["blue"], "linewidth": 1.5}
"""Of the last one."""


def rhythm_cycles(
    motion: PoseTrajectory | Trajectory,
    period: float,
    constraints: Constraints = (),
    *,
    title: str | None = None,
) -> Figure:
    """Show the cycles of a rhythm on one another, over the share of the period.

    A panel for each coordinate and, of poses, for roll, pitch and yaw (extrinsic xyz); the last
    cycle is bold.

    Parameters
    ----------
    motion : PoseTrajectory or Trajectory
        Two cycles or more, as ``dmp.rollout(cycles=5)`` gives.
    period : float
        Seconds.
    constraints : Constraint or several, optional
        Of poses: what comes of them is in the title.
    title : str, optional
        By default the finding: how many cycles, and how far from each other the last two are.

    Raises
    ------
    InputError
        If the motion has no two cycles.
    """
    period = _arguments.positive("period", period, "seconds")
    # Rounding of the last sample's time takes no cycle away.
    count = int(motion.duration / period + 1e-6)
    if count < 2:
        raise InputError(
            f"{motion.name} lasts {motion.duration:.3g} s, which is less than two periods of "
            f"{period:.3g} s; roll out more cycles"
        )
    values, names, units = _values(motion)
    since, share = motion.times - motion.times[0], np.linspace(0.0, 1.0, POINTS)
    at = [(cycle + share) * period for cycle in range(count)]
    cycles: Floats = np.array([[np.interp(t, since, v) for v in values.T] for t in at])
    turning = np.array(units) == "°"
    # A tool that turns on and on comes back to the same rotation.
    gone = cycles[:, turning, :1] - cycles[-1:, turning, :1]
    cycles[:, turning] -= 360 * np.round(gone / 360)

    # Millimeters or degrees that are rounding are no change; a tool that rests has all its panels.
    still = np.ptp(cycles, axis=(0, 2)) <= np.where(turning, STILL, ROUNDING)
    moving = [k for k in range(len(names)) if not still[k]] or list(range(len(names)))
    rows = -(-len(moving) // MOST_ABREAST)
    width = -(-len(moving) // rows)
    figure = style.new_figure(style.TWO_COLUMNS, 0.9 + 1.4 * rows)
    panels = list(figure.subplots(rows, width, squeeze=False).flat)
    for ax in panels[len(moving) :]:
        ax.remove()
    for place, (ax, k) in enumerate(zip(panels, moving, strict=False)):
        own = [cycle[k] for cycle in cycles]
        scale, unit = scaled_unit(max(float(np.ptp(cycle)) for cycle in own), units[k])
        for cycle in own:
            ax.plot(100 * share, scale * cycle, **(LAST if cycle is own[-1] else EARLIER))
        least = style.LEAST_TURN
        if units[k] != "°":
            least = scale * style.LEAST_SHARE * float(np.ptp(cycles[:, ~turning], axis=2).max())
        style.span_at_least(ax, [scale * cycle for cycle in own], least)
        ax.set_xlim(0, 100)
        style.dress(ax, PHASE if place + width >= len(moving) else "", f"{names[k]} ({unit})")
    style.put_legend(figure, {"cycles before": EARLIER, "the last cycle": LAST})
    if rest := [name for k, name in enumerate(names) if k not in moving]:
        style.write_note(figure, f"Without a panel, as it does not change: {', '.join(rest)}")
    style.write_title(figure, title or _finding(motion, period, cycles, units, constraints))
    return figure


def _values(motion: PoseTrajectory | Trajectory) -> tuple[Floats, list[str], list[str]]:
    """Return what goes round, shape (N, n), its names and its units."""
    if isinstance(motion, Trajectory):
        return motion.values, list(motion.names), list(motion.units)
    angles = roll_pitch_yaw(motion.rotations)
    names, units = [*"xyz", *ANGLES], ["m"] * 3 + ["°"] * 3
    return np.column_stack([motion.positions, angles]), names, units


def _finding(
    motion: PoseTrajectory | Trajectory,
    period: float,
    cycles: Floats,
    units: list[str],
    constraints: Constraints,
) -> str:
    """Say how far the last two cycles are apart, and what comes of the constraints."""
    apart = np.abs(cycles[-1] - cycles[-2]).max(axis=1)
    owned = np.array(units)
    gaps = {unit: float(apart[owned == unit].max()) for unit in dict.fromkeys(units)}
    told = [
        value_text(gap, unit) if unit != "°" else f"{style.number(max(gap, STILL))}°"
        for unit, gap in gaps.items()
    ]
    text = f"{len(cycles)} cycles of {style.number(period)} s: the last two differ by at most "
    text += " and ".join(told)
    if constraints and isinstance(motion, PoseTrajectory):
        rows = least_margins(residual_rows({motion.name: motion}, constraints))
        text += f". {finding(rows, {})}"
    return text
