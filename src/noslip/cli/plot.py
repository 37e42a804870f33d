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
from pathlib import Path
from typing import Annotated, cast

import typer
from matplotlib.figure import Figure

from noslip.cli import options
from noslip.errors import InputError
from noslip.figures import (
    compare_motions,
    constraint_history,
    learned_spread,
    plot_values,
    save_figure,
)
from noslip.primitive import ConstrainedDMP
from noslip.saving import load_primitive
from noslip.series import Series
from noslip.trajectory import PoseTrajectory

FORMATS = (".png", ".svg", ".pdf")
"""Of figures: to look at, to edit, and to print."""


class Show(enum.StrEnum):
    """Which figure to draw."""

    MOTION = "motion"
    CONSTRAINTS = "constraints"
    SPREAD = "spread"


@options.grouped
def run(
    motions: Annotated[
        list[str],
        typer.Argument(
            help="Recordings (of any format), and primitives (JSON), which are rolled out.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Figure to write: .png, .svg or .pdf.")
    ] = Path("noslip-plot.png"),
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    show: Annotated[
        Show | None,
        typer.Option(
            help="motion: poses, path and residuals, several motions together.  constraints: of "
            "one primitive, residual or margin, multiplier and force of each constraint.  spread: "
            "of one primitive, how far its demonstrations lie apart.  By default constraints for a "
            "primitive alone.",
            show_default=False,
        ),
    ] = None,
    title: Annotated[
        str | None, typer.Option(help="By default, what the data show.", show_default=False)
    ] = None,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Draw motions: position, orientation, path, and how well constraints hold over time.

    Of vectors and joints, alone, the values over time.

    Without --constraint the constraints of the primitives among the motions are shown.  A primitive
    alone is drawn as what each of its constraints and limits does.
    """
    options.output(out)
    if out.suffix not in FORMATS:
        raise InputError(f"--out: {out} must end in {', '.join(FORMATS)}")
    held = options.constraints(constraint)
    primitives = {name: load_primitive(name) for name in motions if name.endswith(".json")}
    recordings = [name for name in motions if name not in primitives]
    alone = len(primitives) == 1 and not recordings and not held
    if show in (Show.CONSTRAINTS, Show.SPREAD) and not alone:
        raise InputError(
            f"--show {show}: give one primitive (JSON) alone; it brings its own constraints"
        )
    if alone:
        (primitive,) = primitives.values()
        if not primitive.law.space.rotations:
            if show is not None and show is not Show.MOTION:
                raise InputError(f"--show {show}: is of poses; of vectors give --show motion")
            _write(_values(primitive.rollout(), title), out)
            return
        if show is Show.SPREAD:
            _write(learned_spread(primitive, title=title), out)
            return
        if show is Show.CONSTRAINTS or (show is None and primitive.constraints):
            _write(_history(primitive, title), out)
            return
    shown: dict[str, PoseTrajectory] = {}
    if recordings:
        for trajectory in given.load(recordings):
            shown[_label(trajectory.name, shown)] = trajectory
    for name, primitive in primitives.items():
        shown[_label(name, shown)] = primitive.rollout()
        if not constraint:
            held = [*held, *(c for c in primitive.constraints if c not in held)]
    vectors = [name for name, motion in shown.items() if not motion.space.rotations]
    if vectors:
        if len(shown) > 1 or constraint:
            raise InputError(
                f"{vectors[0]}: vectors and joints are drawn one motion at a time, without "
                "--constraint; noslip check measures what they keep"
            )
        _write(_values(shown[vectors[0]], title), out)
        return
    _write(compare_motions(shown, held, title=title), out)


def _values(motion: PoseTrajectory, title: str | None) -> Figure:
    return plot_values(cast("Series", motion), title=title)


def _history(primitive: ConstrainedDMP, title: str | None) -> Figure:
    return constraint_history(primitive.rollout(), primitive.system, title=title)


def _write(figure: Figure, out: Path) -> None:
    for path in save_figure(figure, out):
        typer.echo(f"wrote {path}")


def _label(name: str, taken: dict[str, PoseTrajectory]) -> str:
    """Short name of a file, longer where two would be the same."""
    short = Path(name).stem
    return short if short not in taken else name
