"""Where a tool may not go, in a view of its path: obstacles, and what lies beyond limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.shape import Mark
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError
from noslip.figures.style import PALETTE
from noslip.trajectory import PoseTrajectory

POINTS = 121
"""Of the grid along each side of the view: an edge is off by less than a hundredth of its cells,
between which it is interpolated; the time grows with the square."""
BEYOND = 1.0
"""How far beyond the paths the view may reach, as a share of their extent: axes of equal scales in
a wide or a high panel show about as much."""
FLAT = 1e-6
"""Share of the view's size below which a distance is none: of a contact in the view's own plane
only rounding would be drawn."""
DEPTHS = 17
"""Sections above and below, among which what the view's own does not meet is looked for."""
BESIDE = ("forbidden further off", "forbidden further off", "forbidden above or below")
"""What lies at another depth of the view, by the world axis that leads there."""

FORBIDDEN: dict[str, Any] = {"colors": ["0.93"], "hatches": ["////"], "zorder": 0.4}
"""As forbidden margins over time are."""
EDGE: dict[str, Any] = {"colors": ["0.55"], "linewidths": 0.8, "zorder": 0.6}
"""Of what is forbidden."""
CONTACT: dict[str, Any] = {"colors": [PALETTE["black"]], "linewidths": 0.8, "zorder": 0.6}
"""Of a surface on which the tool stays."""
POINT: dict[str, Any] = {"color": PALETTE["black"], "marker": "+", "ms": 7, "linestyle": "none"}
"""Of a point that stays, such as a port."""


def draw_places(
    ax: Axes,
    motions: Iterable[PoseTrajectory],
    system: ConstraintSystem,
    axes: Sequence[int],
    scale: float,
) -> list[str]:
    """Draw where the constraints of the position let the tool's origin go; return what is what.

    It is a section, at the depth, the rotation and the time at which the motions leave the least
    of a constraint, or are furthest off it.  What lies at other depths alone is outlined.  The view
    grows to hold what is forbidden, if that ends within the paths' extent.

    Parameters
    ----------
    ax : Axes
        With the paths drawn.
    motions : iterable of PoseTrajectory
    system : ConstraintSystem
    axes : 2 ints
        World axes of the view.
    scale : float
        Units of the axes a meter.
    """
    placed = [c for c in system.constraints if _has_place(c)]
    if not placed:
        return []
    motions, columns = list(motions), list(axes)
    poses = np.concatenate([motion.positions for motion in motions])
    low, high = poses[:, columns].min(axis=0), poses[:, columns].max(axis=0)
    size = float((high - low).max()) or 1.0
    across, up = (
        np.linspace(low[k] - BEYOND * size, high[k] + BEYOND * size, POINTS) for k in range(2)
    )
    grid = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
    times = np.concatenate([motion.clock for motion in motions])
    quaternions = np.concatenate([motion.quaternions for motion in motions])

    def values(
        own: ConstraintSystem, times: Floats, positions: Floats, quaternions: Floats
    ) -> Floats:
        still = np.zeros((len(times), 3))
        least: Floats = own.residuals(times, positions, quaternions, still, still).min(axis=1)
        return least

    found: dict[str, None] = {}
    seen = np.array(ax.dataLim.get_points())
    for constraint in placed:
        if isinstance(mark := constraint.shape(), Mark):
            ax.plot(*(scale * np.array(mark.point)[columns]), **POINT)
            seen = np.array(ax.dataLim.get_points())
            found["+ point that stays"] = None
            continue
        try:
            own = ConstraintSystem(constraint)
            along = values(own, times, poses, quaternions)
            at = np.argmin(along) if constraint.relation != "zero" else np.argmax(np.abs(along))
            instants = np.full(len(grid), at)
            positions = poses[instants]
            positions[:, columns] = grid
            given = times[instants], quaternions[instants]
            left = values(own, given[0], positions, given[1])
            beside = left.min() > 0
            if beside and constraint.relation != "zero":
                # What the section does not meet may lie above or below it.
                for depth in np.linspace(-BEYOND, BEYOND, DEPTHS) * size:
                    moved = positions.copy()
                    moved[:, 3 - sum(columns)] += depth
                    left = np.minimum(left, values(own, given[0], moved, given[1]))
        except ConstraintError:
            continue  # It is not defined off the path, and has no place to be drawn.
        left = left.reshape(POINTS, POINTS)
        if np.abs(left).max() < FLAT * size or not left.min() < 0 < left.max():
            continue
        places = scale * across, scale * up, left
        if constraint.relation == "zero":
            ax.contour(*places, levels=[0.0], **CONTACT)
            found["line: contact"] = None
            continue
        if beside:
            found[f"dashed: {BESIDE[3 - sum(columns)]}"] = None
        else:
            hatched = ax.contourf(*places, levels=[left.min() - size, 0.0], **FORBIDDEN)
            hatched.set(edgecolor="0.78", linewidth=0)
            found["hatched: forbidden"] = None
        ax.contour(*places, levels=[0.0], **EDGE, linestyles="dashed" if beside else "solid")
        forbidden = left < 0
        if not any(side.any() for side in (*forbidden[[0, -1]], *forbidden.T[[0, -1]])):
            whole = scale * grid[forbidden.ravel()]
            seen[0] = np.minimum(seen[0], whole.min(axis=0))
            seen[1] = np.maximum(seen[1], whole.max(axis=0))
    # The grid itself, which is larger than what is to be seen, does not count.
    ax.dataLim.set_points(seen)
    ax.autoscale_view()
    return list(found)


def _has_place(constraint: Constraint) -> bool:
    """Whether it is about where the tool's origin is: lengths, of one body's pose."""
    return (
        constraint.level == "position"
        and constraint.unit in (None, "m")
        and not constraint.coordinates
        and not constraint.body
        and (constraint.relation == "nonnegative" or _is_one(constraint))
    )


def _is_one(constraint: Constraint) -> bool:
    return isinstance(constraint.shape(), Mark) or not constraint.row_names
