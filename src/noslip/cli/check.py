"""``noslip check``: whether a motion slips.

noslip check recording.csv --constraint blade

noslip check runs/*.csv --constraint blade --trim-speed 0.05 --rate 120 --lowpass 4.8

noslip check run.bag --topic /tf --child-frame knife --constraint blade

noslip check motion.csv --constraint blade --constraint "keep-out-sphere(center=(0.1,0,0),
radius=0.02)"

noslip check motion.csv --constraint my_rules.py:stay_flat --tolerance 1e-9 --json

noslip check excision.json

noslip check joints.csv --robot panda --values --constraint blade
"""

from __future__ import annotations

from typing import Annotated

import typer

from noslip.cli import options, output
from noslip.cli.found import Found
from noslip.constraints.check import SLIP_SHARE, TOLERANCE, check
from noslip.errors import InputError


@options.grouped
def run(
    motions: options.Motions,
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="X", help="Largest violation that holds, in each constraint's unit (SI)."
        ),
    ] = TOLERANCE,
    slip_share: Annotated[
        float,
        typer.Option(metavar="X", help="Largest share of its way that a tool may slip, 0 to 1."),
    ] = SLIP_SHARE,
    figure: options.Figure = None,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Check recorded, rolled-out or simulated motions against constraints.

    Without --constraint against those of the primitives and simulated arms among the motions.

    Reports, for each constraint, the peak and rms residual, the distance slipped and its share of
    the way, the worst moment, the share of the time above the tolerance, and the verdict; for each
    limit its least margin and when, or by how much it is violated.  Undecided is what moves slower
    than the tolerance.  Exits with 1 unless all hold.
    """
    options.figure(figure)
    found = Found.of(motions, given)
    held = options.constraints(constraint) or found.constraints
    if not held:
        raise InputError("check needs at least one --constraint")
    moved = found.motions.values()
    if figure is not None and not all(motion.space.rotations for motion in moved):
        raise InputError("--figure: draws poses; of vectors and joints use noslip plot")
    reports = [check(motion, held, tolerance=tolerance, slip_share=slip_share) for motion in moved]
    if figure is not None:
        from noslip.figures import compare_motions, save_figure

        save_figure(compare_motions(found.motions, held), figure)
    if as_json:
        output.print_json([report.to_dict() for report in reports])
    else:
        for report in reports:
            typer.echo(str(report))
        if figure is not None:
            typer.echo(f"wrote {figure}")
    if not all(report.satisfied for report in reports):
        raise typer.Exit(1)
