"""``noslip plot``: look at motions.

noslip plot recording.csv --constraint blade --out recording.png

noslip plot demonstration.csv excision.json --constraint blade --out comparison.svg

noslip plot runs/*.csv --constraint blade --rate 120 --lowpass 4.8 --out runs.pdf

noslip plot excision.json --out constraints.png

noslip plot excision.json --show motion --out motion.png

noslip plot excision.json --show spread --out spread.png
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, cast

import typer
from matplotlib.figure import Figure

from noslip.cli import options, output
from noslip.cli.found import Found, is_primitive
from noslip.constraints.declaration import Constraint
from noslip.errors import InputError
from noslip.figures import (
    compare_motions,
    constraint_history,
    learned_spread,
    plot_values,
    save_figure,
)
from noslip.figures.quantities import Constraints
from noslip.saving import load_primitive
from noslip.series import Series
from noslip.trajectory import PoseTrajectory


class Show(enum.StrEnum):
    """Which figure to draw."""

    MOTION = "motion"
    CONSTRAINTS = "constraints"
    SPREAD = "spread"


@options.grouped
def run(
    motions: options.Motions,
    out: Annotated[
        Path, options.out(f"the figure: {', '.join(options.FIGURES)}", default=True)
    ] = Path("noslip-plot.png"),
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    show: Annotated[
        Show | None,
        typer.Option(
            help="motion: poses, path and residuals, several motions together.  constraints: of "
            "one primitive, residual or margin, multiplier and added acceleration of each "
            "constraint.  spread: of one primitive, how far its demonstrations lie apart.  By "
            "default constraints for a primitive alone.",
            show_default=False,
        ),
    ] = None,
    title: Annotated[
        str | None, typer.Option(help="By default, what the data show.", show_default=False)
    ] = None,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Draw motions: position, orientation, path, and how well constraints hold over time.

    Of vectors and joints the values over time, and the limits that they come near.

    Without --constraint those of the primitives and simulated arms among the motions are shown.  A
    primitive alone is drawn as what each of its constraints and limits does.
    """
    options.figure(out, "--out")
    figure = _drawn(motions, options.constraints(constraint), show, title, given)
    written = [str(path) for path in save_figure(figure, out)]
    if as_json:
        output.print_json({"title": figure.get_suptitle(), "written": written})
        return
    for path in written:
        typer.echo(f"wrote {path}")


def _drawn(
    motions: list[str],
    held: list[Constraint],
    show: Show | None,
    title: str | None,
    given: options.Loading,
) -> Figure:
    """Draw what the motions and the options ask for."""
    alone = len(motions) == 1 and is_primitive(motions[0]) and not held
    if show in (Show.CONSTRAINTS, Show.SPREAD) and not alone:
        raise InputError(
            f"--show {show}: give one primitive (JSON) alone; it brings its own constraints"
        )
    if alone:
        primitive = load_primitive(motions[0])
        if not primitive.law.space.rotations:
            if show is not None and show is not Show.MOTION:
                raise InputError(f"--show {show}: is of poses; of vectors give --show motion")
            rolled = {motions[0]: primitive.rollout()}
            return _values(cast("dict[str, PoseTrajectory]", rolled), primitive.system, title)
        if show is Show.SPREAD:
            return learned_spread(primitive, title=title)
        if show is Show.CONSTRAINTS or (show is None and primitive.constraints):
            return constraint_history(primitive.rollout(), primitive.system, title=title)
    found = Found.of(motions, given)
    shown = found.motions
    vectors = [name for name, motion in shown.items() if not motion.space.rotations]
    if vectors:
        if len(vectors) < len(shown):
            others = [name for name in shown if name not in vectors]
            raise InputError(f"{vectors[0]} holds vectors, {others[0]} poses; draw them apart")
        return _values(shown, held or found.constraints, title)
    return compare_motions(shown, held or found.constraints, title=title)


def _values(
    motions: Mapping[str, PoseTrajectory], constraints: Constraints, title: str | None
) -> Figure:
    # One is drawn as it is called itself.
    shown = cast("dict[str, Series]", motions)
    alone = next(iter(shown.values())) if len(shown) == 1 else shown
    return plot_values(alone, constraints, title=title)
