"""Repeated demonstrations of one task: their spread, and how learning turned the tool."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from noslip.errors import InputError
from noslip.figures.motion import log_axis, span_at_least
from noslip.figures.quantities import (
    ANGLES,
    Constraints,
    ResidualRow,
    extent,
    length_unit,
    residual_rows,
    roll_pitch_yaw,
)
from noslip.figures.style import (
    PALETTE,
    SMALL_FONT_SIZE,
    TWO_COLUMNS,
    dress,
    new_figure,
    number,
    put_legend,
    short_name,
    trial_styles,
    write_title,
)
from noslip.primitives.pose import as_demonstrations
from noslip.trajectory import Floats, PoseTrajectory

PROGRESS = "share of the motion's time (%)"
GRID: Floats = np.linspace(0, 100, 201)
"""Where mean and standard deviation are taken (%)."""
POSITION, ORIENTATION, RESIDUAL = PALETTE["blue"], PALETTE["green"], PALETTE["vermillion"]


def demonstration_spread(
    trajectories: Sequence[PoseTrajectory], constraints: Constraints = (), *, title: str | None = None
) -> Figure:
    """Show several motions of one task over normalised time: each, their mean and their spread.

    The paper's figure A, given demonstrations, and B, given what was learned from them.  Panels:
    x, y and z; roll, pitch and yaw; the signed residual of each row of the constraints, and its
    size on a logarithmic axis where it is too small to be seen.

    Parameters
    ----------
    trajectories : sequence of PoseTrajectory
        Of any duration and rate.  Thin lines show their own samples, nothing is smoothed; the band
        is one standard deviation (of the sample, N - 1) to either side of the mean.
    constraints : Constraint or several
    title : str, optional
        By default the finding: how large the mean residual gets and when, and the largest of all.

    Raises
    ------
    InputError
        If there is no trajectory.
    """
    motions = _numbered(trajectories)
    rows = residual_rows(motions, constraints)
    figure = new_figure(TWO_COLUMNS, 3.2 + 1.5 * len(rows))
    grid = figure.add_gridspec(2 + len(rows), 1)

    progress = [_progress(motion) for motion in motions.values()]
    scale, unit = length_unit(motions.values())
    least = scale * 0.04 * max(map(extent, motions.values()))
    angles = _angles(list(motions.values()))
    for row, (names, unit, color, curves) in enumerate()
    return figure
