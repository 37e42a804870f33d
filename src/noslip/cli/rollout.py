"""``noslip rollout``: a primitive in, its motion out.

noslip rollout excision.json --out motion.csv

noslip rollout excision.json --duration 8 --time-step 0.001 --out slow.csv

noslip rollout excision.json --goal-position 0.05,0.01,0 --out elsewhere.csv

noslip rollout reach.json --goal-values 0.1,0.2,0.3 --out reached.csv

noslip rollout stirring.json --cycles 10 --out stirred.csv

noslip rollout excision.json | head
"""

from __future__ import annotations

import enum
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from noslip.cli import options, output
from noslip.constraints.check import CheckReport, checked, quantity_text, residual_text
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError
from noslip.law.entry import GoalForm
from noslip.recordings.formats import WRITTEN, listed_suffixes, write_recording
from noslip.recordings.twists import motion_text
from noslip.runtime.motion import Motion
from noslip.saving import load_primitive
from noslip.verification import misses_goal


class Variant(enum.StrEnum):
    """Which of the paper's three primitives to run."""

    OPTIMIZED = "optimized"
    CONSTRAINED = "constrained"
    REGULAR = "regular"


@options.grouped
def run(
    primitive: options.Primitive,
    out: Annotated[
        Path | None,
        options.out(
            f"the motion: {listed_suffixes(WRITTEN)}; by default as CSV to standard output"
        ),
    ] = None,
    goal_position: options.Point = None,
    goal_rotation: options.Turn = None,
    goal_values: options.PointValues = None,
    start_position: options.Point = None,
    start_rotation: options.Turn = None,
    start_values: options.PointValues = None,
    duration: options.Duration = None,
    cycles: Annotated[
        float, typer.Option(metavar="N", help="Of a rhythm: how many periods.")
    ] = 1.0,
    time_step: Annotated[
        float | None,
        options.optional("S", "Seconds; by default those of the plan."),
    ] = None,
    project_start: options.StartProjected = "velocity",
    pull_in: Annotated[
        float | None,
        options.optional(
            "1/S", "Rate at which what is off the constraints decays; by default the primitive's."
        ),
    ] = None,
    goal_form: Annotated[
        GoalForm,
        typer.Option(help="How a new goal enters: along minimum jerk, or at once as in the paper."),
    ] = "minimum-jerk",
    variant: Annotated[
        Variant,
        typer.Option(
            help="optimized: all of it; constrained: orientation as demonstrated; regular: no "
            "constraint (the paper's comparisons)."
        ),
    ] = Variant.OPTIMIZED,
    as_json: options.AsJson = False,
    given: options.Writing = options.Writing(),  # noqa: B008 - immutable
) -> None:
    """Roll a primitive out and write its motion (t,x,y,z,qw,qx,qy,qz, or its coordinates).

    Consecutive rows are the primitive's own steps.  Says which limits gave way.  Exits with 1 if
    the motion misses its goal, or violates a constraint or a hard limit that it should hold; soft
    ones (priority 1 and more) may give way.
    """
    options.output(out)
    if out is not None and out.suffix.lower() not in WRITTEN:
        raise InputError(f"--out: {out} must end in {listed_suffixes(WRITTEN)}")
    if as_json and out is None:
        raise InputError("--json needs --out: standard output cannot carry both")
    dmp = load_primitive(primitive)
    chosen = {
        Variant.OPTIMIZED: dmp,
        Variant.CONSTRAINED: dmp.constrained,
        Variant.REGULAR: dmp.regular,
    }[variant]
    motion = chosen.rollout(
        goal_position=options.place("goal", goal_position, goal_values, dmp.law.space),
        goal_rotation=options.rotation("--goal-rotation", goal_rotation),
        start_position=options.place("start", start_position, start_values, dmp.law.space),
        start_rotation=options.rotation("--start-rotation", start_rotation),
        duration=duration,
        cycles=cycles,
        time_step=time_step,
        project_start=project_start,
        pull_in=pull_in,
        goal_form=goal_form,
    )
    if out is None:
        sys.stdout.write(motion_text(motion, **given.writing()))
    else:
        write_recording(motion, out, **given.writing())
    report = checked(motion, dmp.system) if dmp.constraints else None
    gave_way = _gave_way(motion, dmp.system.limits)
    if as_json:
        result = {
            "motion": str(out),
            "samples": len(motion),
            "end_error": motion.end_error,
            "end_rotation_error": motion.end_rotation_error,
            "path_error": motion.path_error,
        }
        told = report.to_dict() if report else None
        output.print_json(result | {"check": told, "gave_way": gave_way})
    elif out is not None:
        typer.echo(
            f"wrote {out}: {len(motion)} samples, {motion.duration:.4g} s; ends "
            f"{residual_text(motion.end_error, motion.unit, below='less than')} from the goal"
        )
        if report:
            typer.echo(str(report))
    if not as_json:
        for limit in gave_way:
            # Standard output may be the motion itself.
            typer.echo(_violation_text(limit), err=out is None)
    promised = not report or _as_promised(report, dmp.system, gave_way)
    if variant is not Variant.REGULAR and (misses_goal(motion) or not promised):
        raise typer.Exit(1)


def _gave_way(motion: Motion, limits: ConstraintSystem) -> list[dict[str, Any]]:
    """What of the limits gave way, as plain data; ``priority`` 0 is hard."""
    priorities = limits.per_row(limit.priority for limit in limits.constraints)
    known = dict(zip(limits.row_names, zip(limits.row_units, priorities, strict=True), strict=True))
    return [
        asdict(limit) | {"unit": known[limit.name][0], "priority": known[limit.name][1]}
        for limit in motion.gave_way
    ]


def _violation_text(limit: dict[str, Any]) -> str:
    kind = f"soft, priority {limit['priority']}" if limit["priority"] else "hard"
    violation = quantity_text(limit["violation"], limit["unit"])
    return (
        f"{limit['name']} ({kind}) gave way by up to {violation}, at "
        f"{limit['time']:.3g} s; for {limit['share']:.1%} of the motion"
    )


def _as_promised(
    report: CheckReport, system: ConstraintSystem, gave_way: list[dict[str, Any]]
) -> bool:
    """Whether all holds but soft limits."""
    checks = zip(report.constraints, system.constraints, strict=True)
    held = all(check.satisfied or constraint.priority > 0 for check, constraint in checks)
    return held and all(limit["priority"] > 0 for limit in gave_way)
