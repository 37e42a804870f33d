"""``noslip learn``: recordings and constraints in, a primitive out.

noslip learn recordings/*.csv --constraint blade --out excision.json

noslip learn cut.csv --constraint "blade(lateral='z')" --constraint my_rules.py:stay_flat
--out cut.json

noslip learn sensor.csv --tool-frame 0.052,0,0.013 --trim-speed 0.005 --rate 120 --lowpass 4.8
--relative --constraint blade --out cut.json

noslip learn joints.csv --robot panda --values --constraint blade --out arm.json

noslip learn stirring.csv --columns x,y --rhythmic --out stirring.json

noslip learn --each recordings/ --constraint blade --jobs 8 --table results.parquet
--out primitives/
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from noslip._values import with_unit
from noslip.cli import each as one_each
from noslip.cli import options, output
from noslip.constraints.check import (
    checked,
    margin_text,
    quantity_text,
    residual_text,
)
from noslip.demonstrations.alignment import align as bring_into_step
from noslip.demonstrations.cycles import periods
from noslip.distribution import MotionDistribution
from noslip.errors import InputError, muted, one_line
from noslip.learning import learn
from noslip.merit import figures_of_merit
from noslip.primitive import ConstrainedDMP
from noslip.projection.request import LEARNING
from noslip.rule import BARRIER_RATE, STABILIZATION
from noslip.runtime.motion import Motion

_MANY = options.MANY
"""Heading of these options in the help."""
_CONSTANTS = "Constants of the law"
"""Heading of these options in the help."""


@dataclass(frozen=True)
class Learning:
    """Options of :func:`noslip.learn`, one each, by the same names."""

    basis_functions: Annotated[
        str,
        typer.Option(metavar="N", help="auto: 100, and more where the path needs them."),
    ] = "auto"
    alpha: Annotated[
        float, typer.Option(metavar="X", help="Of the attractor.", rich_help_panel=_CONSTANTS)
    ] = 25.0
    beta: Annotated[
        float, typer.Option(metavar="X", help="Of the attractor.", rich_help_panel=_CONSTANTS)
    ] = 6.25
    alpha_s: Annotated[
        float, typer.Option(metavar="X", help="Of the phase.", rich_help_panel=_CONSTANTS)
    ] = 1.0
    ridge: Annotated[
        float,
        typer.Option(
            metavar="X",
            help="Regularization of the fit, over the basis functions' mean square.",
            rich_help_panel=_CONSTANTS,
        ),
    ] = 1e-6
    hold_position: Annotated[
        bool,
        typer.Option(
            "--hold-position",
            help="Let the orientation alone give way, as in the paper; by default the position "
            "gives way a little too, which spares the tool sharp turns.",
        ),
    ] = False
    start: options.Kept = "auto"
    end: options.Kept = "auto"
    position_weight: options.PositionWeight = LEARNING.position
    position_smoothing: options.PositionSmoothing = LEARNING.position_smoothing
    rotation_smoothing: options.RotationSmoothing = LEARNING.rotation_smoothing
    metric: options.WhoGivesWay = "auto"
    metric_length: Annotated[
        float | None,
        options.optional("M", "Meters that weigh as much as a radian; by default a mean step."),
    ] = None
    stabilization: Annotated[
        float,
        typer.Option(
            metavar="X", help="Rate at which a violation at the start decays, per duration."
        ),
    ] = STABILIZATION
    barrier_rate: Annotated[
        float,
        typer.Option(
            metavar="X", help="Rate at which the margins of limits may shrink, per duration."
        ),
    ] = BARRIER_RATE
    align: Annotated[
        bool,
        typer.Option(
            "--align",
            help="Bring several recordings into step first, by dynamic time warping (needs "
            "noslip\\[align]).",
        ),
    ] = False
    rhythmic: Annotated[
        bool,
        typer.Option(
            "--rhythmic",
            help="Each recording is one period, whose last sample is the first again, or holds "
            "several: the primitive goes round for ever.",
        ),
    ] = False
    period: Annotated[
        float | None,
        options.optional("S", "Of a rhythm: seconds of a period, about; by default it is found."),
    ] = None
    project_start: options.StartProjected = "nothing"

    def keywords(self) -> dict[str, Any]:
        """Return what they are for :func:`noslip.learn`."""
        count: int | str = self.basis_functions
        if count != "auto":
            if not self.basis_functions.lstrip("+-").isdecimal():
                raise InputError(
                    f"--basis-functions: give auto or a whole number, got {self.basis_functions!r}"
                )
            count = int(self.basis_functions)
        given = {name: value for name, value in vars(self).items() if name not in ("start", "end")}
        given |= options.kept(start=self.start, end=self.end)
        return given | {"metric": options.metric(self.metric), "basis_functions": count}


@options.grouped
def run(
    recordings: options.Recordings,
    out: Annotated[Path, options.out("the primitive: .json; with --each, a folder of them")],
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    learning: Learning = Learning(),
    distribution: Annotated[
        bool,
        typer.Option(
            "--distribution",
            help="Learn how the motions are distributed too, of three recordings or more; noslip "
            "sample draws from the file.",
        ),
    ] = False,
    each: options.Each = False,
    table: Annotated[
        Path | None,
        options.optional(
            "FILE",
            "Figures of merit, a row a recording: .csv or .parquet; by default results.csv "
            "in the folder.",
            _MANY,
        ),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(metavar="N", min=1, help="Processes.", rich_help_panel=_MANY),
    ] = 1,
    cluster: Annotated[
        str | None,
        options.optional(
            "ADDRESS",
            "Scheduler of a Dask cluster, such as tcp://10.0.0.5:8786, to work on instead.",
            _MANY,
        ),
    ] = None,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Learn one primitive from one recording or several; it holds the constraints exactly.

    Each recording is projected onto the constraints (the nearest motion that satisfies them), one
    primitive is fitted to all of them, and the coupling term of the Udwadia-Kalaba method holds the
    constraints at every step of its motion.  Exits with 1 if a projection does not converge, or
    if the motion misses its goal or breaks a hard limit.

    With --each every recording becomes a primitive of its own; folders are searched, and what an
    earlier run has learned the same way is kept.  Recordings that fail are listed, the others
    finished, and the exit code is 1.
    """
    held = options.constraints(constraint)
    if each:
        if distribution:
            raise InputError("--distribution: is of several together; leave out --each")
        if learning.align:
            raise InputError(
                "--align: brings several into step; with --each there is one at a time"
            )
        one_each.run(
            recordings,
            held,
            out=out,
            table=table,
            jobs=jobs,
            address=cluster,
            as_json=as_json,
            loading=given.loading(),
            preparation=given.preparation(),
            **learning.keywords(),
        )
        return
    for option, is_given in (("--table", table), ("--jobs", jobs > 1), ("--cluster", cluster)):
        if is_given:
            raise InputError(f"{option}: goes with --each, for a primitive from each recording")
    options.output(out)
    demonstrations = given.load(recordings)
    with output.progress("learning", len(demonstrations)) as progress:
        how = learning.keywords() | {"progress": progress}
        learned: ConstrainedDMP | MotionDistribution
        if distribution:
            learned = learn(demonstrations, held, distribution=True, **how)
            primitive = learned.primitive
        else:
            learned = primitive = learn(demonstrations, held, **how)
    if learning.align:
        # What it was learned from is what it is compared with.
        demonstrations = bring_into_step(demonstrations)
    if learning.rhythmic:
        with muted():
            demonstrations = [p for d in demonstrations for p in periods(d, learning.period)]
    motion = primitive.rollout()
    system = primitive.system
    merits = [figures_of_merit(motion, d, system).to_dict() for d in demonstrations]
    result: dict[str, Any] = {
        "primitive": str(out),
        "constraints": list(system.names),
        "duration": primitive.duration,
        "end_error": motion.end_error,
        "end_rotation_error": motion.end_rotation_error,
        "path_error": motion.path_error,
        "residual_peak": merits[0]["residual_peak"],
        "least_margins": merits[0]["least_margins"],
        "demonstrations": [
            {"name": d.name, "duration": d.duration, **c}
            for d, c in zip(demonstrations, merits, strict=True)
        ],
        "projection": [vars(record) for record in primitive.record],
    }
    # Only what moves is written: what was there before may still be of use.
    learned.save(out)
    if as_json:
        output.print_json(result)
        return
    for demonstration, figures in zip(demonstrations, result["demonstrations"], strict=True):
        typer.echo(
            f"{one_line(demonstration.name)}: {len(demonstration)} samples, "
            f"{demonstration.duration:.3g} s; the primitive stays within "
            f"{_apart(figures, motion)} of it (rms)"
        )
    for record in primitive.record:
        if record.backing:
            typer.echo(
                f"{one_line(record.demonstration)}: moves backwards in {record.backing} "
                "stretch(es); there the edge trails, as recorded"
            )
    if system.equalities.size:
        typer.echo(f"residual of its motion: {residual_text(result['residual_peak'], '1')} (peak)")
    if system.limits.size:
        for limit in checked(motion, system.limits).constraints:
            typer.echo(f"{limit.name} of its motion: {margin_text(limit)}")
    here, there = (" ".join(f"{x:.6g}" for x in motion.positions[k]) for k in (0, -1))
    typer.echo(
        f"from {here} to {with_unit(there, motion.unit)} in {motion.duration:.4g} s; ends "
        f"{quantity_text(motion.end_error, motion.unit)} from its goal"
    )
    typer.echo(f"wrote {out}")


def _apart(figures: dict[str, Any], motion: Motion) -> str:
    """How far from a demonstration its motion stays."""
    off = figures["position_rms"]
    text = f"{off * 1e3:.3g} mm" if motion.unit == "m" else quantity_text(off, motion.unit)
    if not motion.space.rotations:
        return text
    return f"{text} and {np.degrees(figures['rotation_rms']):.3g} degrees"
