"""The pictures of a report, each with a caption."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from noslip import figures
from noslip.constraints.blade import Blade
from noslip.figures import style
from noslip.figures.motion import draw_residuals
from noslip.figures.quantities import value_text
from noslip.figures.residuals import finding, least_margins, prominence, residual_rows
from noslip.primitive import ConstrainedDMP
from noslip.reporting.values import Picture
from noslip.runtime.motion import Motion
from noslip.trajectory import PoseTrajectory


def pictures(
    dmp: ConstrainedDMP,
    demonstrations: Sequence[PoseTrajectory],
    motions: Mapping[str, PoseTrajectory],
    motion: Motion,
    progress: Callable[[int, int], None] | None,
) -> Iterable[Picture]:
    held, count = dmp.constraints, len(demonstrations)
    first = next(iter(motions))
    pair = {first: motions[first], "optimized": motion}
    draws: list[tuple[bool, str, Callable[[], Figure]]] = [
        (
            bool(held),
            "The path, with what is forbidden, and the constraint that is violated most.",
            lambda: _finding(dmp, motions),
        ),
        (
            # The snapshots' blade has its edge along x and its side along y.
            Blade() in held,
            "The blade along the path, colored by the share of its speed that goes sideways.",
            lambda: figures.blade_snapshots(pair),
        ),
        (
            True,
            "Where the motions go, how they turn, and how well the constraints hold.",
            lambda: figures.compare_motions(motions, held),
        ),
        (True, "How fast the tool moves and turns.", lambda: _speeds(motions)),
        (
            bool(held),
            "Of each constraint: residual or margin, multiplier, and the acceleration it adds.",
            lambda: figures.constraint_history(motion, held),
        ),
        (
            count > 1,
            "The recordings, their mean and one standard deviation.",
            lambda: figures.demonstration_spread(demonstrations, held),
        ),
        (
            count > 0,
            "How far the learned motion is turned from each recording.",
            lambda: figures.orientation_adjustments(demonstrations, [motion] * count),
        ),
        (
            dmp.spread is not None,
            "How far the recordings lie apart along the motion, starts and goals aside.",
            lambda: figures.learned_spread(dmp),
        ),
    ]
    wanted = [(caption, draw) for applies, caption, draw in draws if applies]
    for done, (caption, draw) in enumerate(wanted, start=1):
        yield Picture(caption, draw())
        if progress is not None:
            progress(done, len(wanted))


def _finding(dmp: ConstrainedDMP, motions: Mapping[str, PoseTrajectory]) -> Figure:
    """Path and worst residual beside each other: what the title says, to see."""
    rows = least_margins(residual_rows(motions, dmp.system))
    figure = figures.column_figure(2, 2.9)
    above, over_time = figure.subplots(1, 2)
    figures.plot_path(above, motions, dmp.system)
    draw_residuals(over_time, max(rows, key=prominence), "linear")
    style.name_lines(figure, motions)
    style.write_title(figure, finding(rows, motions))
    return figure


def _speeds(motions: Mapping[str, PoseTrajectory]) -> Figure:
    figure = figures.column_figure(2)
    linear, angular = figure.subplots(1, 2)
    figures.plot_speed(linear, motions)
    figures.plot_speed(angular, motions, "angular")
    style.name_lines(figure, motions)
    moving, turning = (
        float(np.linalg.norm(velocities, axis=1).max())
        for velocities in motions["optimized"].step_velocities()
    )
    style.write_title(
        figure,
        f"Optimized moves at up to {value_text(moving, 'm/s')} and turns at up to "
        f"{value_text(turning, 'rad/s')}",
    )
    return figure
