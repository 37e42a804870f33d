"""``noslip adapt``: a primitive and new goals in, primitives that end there out.

noslip adapt excision.json --goal-position 0.05,0.01,0 --out longer.json

noslip adapt excision.json --goal-position 0.05,0.01,0 --goal-rotation 1,0,0,0 --duration 6
--via 0.5:0.02,0.02,0 --figure longer.png --out longer.json

noslip adapt reach.json --goal-values 0.1,0.2,0.3 --out reached.json

noslip adapt excision.json --goals goals.csv --figure family.png --out family/
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from noslip import _arguments
from noslip._files import renewing, write_beside
from noslip._pose_checks import Source
from noslip._pose_names import POSITION, QUATERNION
from noslip._typing import Floats
from noslip.adapting import Shape
from noslip.boundary import Boundary, twist
from noslip.cli import options, output
from noslip.cli.outcome import Outcome, csv_text, sentences, sentences_together
from noslip.constraints.check import checked
from noslip.errors import InputError, NoslipError, NoslipWarning, did_you_mean
from noslip.figures import adapted_family, save_figure
from noslip.figures.family import end_errors
from noslip.law.scaling import Scaling
from noslip.merit import figures_of_merit
from noslip.named_columns import NamedColumns
from noslip.primitive import ConstrainedDMP
from noslip.projection.request import ADAPTING
from noslip.runtime.motion import Motion
from noslip.saving import load_primitive
from noslip.space import Space

SUMMARY = "summary.csv"
"""In the folder, beside the primitives, none of which can have its name: they are JSON."""
_FILE_NAME = re.compile(r"\w[\w .+-]{0,99}")
"""What every file system takes for a name."""
_KNOWN = "x,y,z (all or none), qw,qx,qy,qz (all or none), duration, name"
"""Columns of a file of goals, of poses."""

Velocity = Annotated[
    str | None,
    options.optional(
        "VX,VY,VZ[,WX,WY,WZ]",
        "m/s and rad/s, 0 at rest, free for whatever suits; by default the primitive's own.",
    ),
]
"""An option that is a twist."""
Options = dict[str, Any]
"""Of :meth:`noslip.ConstrainedDMP.adapt`; what is None stays the primitive's own."""


def run(
    primitive: options.Primitive,
    out: Annotated[Path, options.out("the primitive: .json; with --goals, a folder of them")],
    goals: Annotated[
        Path | None,
        options.optional(
            "FILE",
            f"CSV with a goal a row, its columns any of {_KNOWN}; of vectors and joints "
            "their names in place of the pose.  The other options hold for all rows.",
        ),
    ] = None,
    goal_position: options.Point = None,
    goal_rotation: options.Turn = None,
    goal_values: options.PointValues = None,
    goal_velocity: Velocity = None,
    start_position: options.Point = None,
    start_rotation: options.Turn = None,
    start_values: options.PointValues = None,
    start_velocity: Velocity = None,
    duration: options.Duration = None,
    via: options.Vias = [],  # noqa: B006 - typer's way to say none
    scaling: Annotated[
        Scaling,
        typer.Option(
            help="How the path follows before it is projected: displaced, stretched axis by axis, "
            "or turned and stretched as a whole."
        ),
    ] = "none",
    shape: Annotated[
        Shape,
        typer.Option(
            help="Whether the demonstration's shape is kept as far as it leads to the goal, or the "
            "shortest maneuver is taken."
        ),
    ] = "demonstrated",
    reverse: Annotated[
        bool | None,
        typer.Option(
            "--reverse/--forward",
            help="Whether the tool may back up; by default where its turning radius lets it.",
            show_default=False,
        ),
    ] = None,
    start: options.Kept = "auto",
    end: options.Kept = "auto",
    samples: Annotated[
        int | None,
        options.optional("N", "Of the projection; by default one a step, up to 2001."),
    ] = None,
    position_weight: options.PositionWeight = ADAPTING.position,
    position_smoothing: options.PositionSmoothing = ADAPTING.position_smoothing,
    rotation_smoothing: options.RotationSmoothing = ADAPTING.rotation_smoothing,
    figure: options.Figure = None,
    as_json: options.AsJson = False,
) -> None:
    """Move a primitive to new goals, starts and via points; it still holds its constraints.

    The motion is moved to the new ends, projected onto the constraints with these fixed, and
    fitted again.  Of what is not named the primitive's own stays.

    With --goals each row becomes a primitive in the folder, and summary.csv tells of each how far
    from its goal its motion ends, its residual and its peak angular speed.  Rows that fail are
    listed, the others finished.  Exits with 1 if any failed, or violates a constraint.
    """
    options.figure(figure)
    if duration is not None:
        duration = _arguments.positive("--duration", duration, "seconds")
    dmp = load_primitive(primitive)
    space = dmp.law.space
    asked: Options = {
        "goal_position": options.place("goal", goal_position, goal_values, space),
        "goal_rotation": options.rotation("--goal-rotation", goal_rotation),
        "goal_velocity": _velocity("--goal-velocity", goal_velocity, space),
        "start_position": options.place("start", start_position, start_values, space),
        "start_rotation": options.rotation("--start-rotation", start_rotation),
        "start_velocity": _velocity("--start-velocity", start_velocity, space),
        "via": tuple(options.via(text, space) for text in via),
        "duration": duration,
        "scaling": scaling,
        "shape": shape,
        "reverse": reverse,
        **options.kept(start=start, end=end),
        "samples": samples,
        "position_weight": position_weight,
        "position_smoothing": position_smoothing,
        "rotation_smoothing": rotation_smoothing,
    }
    if figure is not None and not space.rotations:
        raise InputError("--figure: draws poses; of vectors and joints use noslip plot")
    family = _Family(dmp)
    if goals is None:
        options.output(out)
        family.add(out.stem, asked, out)
        outcome = family.outcomes[0]
        result = {"primitive": str(out)} | asdict(outcome)
        lines = [*sentences(outcome, family.original.unit), f"wrote {out}"]
    else:
        if out.exists() and not out.is_dir():
            raise InputError(f"--out: {out} is a file; with --goals give a folder")
        rows = _read_goals(goals, space)
        for name in next(iter(rows.values())):
            if asked[name] is not None:
                option = f"--{name.replace('_', '-')}"
                raise InputError(f"{option}: {goals} has columns for it too; leave one of them out")
        targets = {name: out / f"{name}.json" for name in rows}
        for name, target in targets.items():
            if target.resolve() == primitive.resolve():
                raise InputError(f"--out: goal {name!r} would replace {primitive}; rename either")
        with renewing(out / SUMMARY) as last, output.progress("adapting", len(rows)) as progress:
            for done, (name, row) in enumerate(rows.items(), start=1):
                family.try_to_add(name, asked | row, targets[name])
                progress(done, len(rows))
            summary = write_beside(last, csv_text(family.outcomes).encode())
        failed = sum(outcome.failed for outcome in family.outcomes)
        result = {
            "folder": str(out),
            "summary": str(summary),
            "failed": failed,
            "goals": [asdict(outcome) for outcome in family.outcomes],
        }
        lines = sentences_together(family.outcomes, family.original.unit)
        lines.append(f"wrote {out}: {len(family.motions)} primitive(s) and {SUMMARY}")
    if figure is not None and family.motions:
        drawn = adapted_family(family.original, family.motions, family.goals, dmp.system)
        save_figure(drawn, figure)
        result["figure"] = str(figure)
        lines.append(f"wrote {figure}")
    elif figure is not None:
        lines.append(f"no {figure}: there is no motion to draw")
    if as_json:
        output.print_json(result)
    else:
        for line in lines:
            typer.echo(line)
    if any(outcome.failed for outcome in family.outcomes):
        raise typer.Exit(1)


class _Family:
    """The primitives adapted from one, their motions, and what became of each goal."""

    def __init__(self, dmp: ConstrainedDMP) -> None:
        self.dmp = dmp
        self.original = dmp.rollout()
        self.angular_speed_peak = figures_of_merit(self.original, self.original).angular_speed_peak
        self.motions: dict[str, Motion] = {}
        self.goals: dict[str, Boundary] = {}
        self.outcomes: list[Outcome] = []

    def add(self, name: str, asked: Options, target: Path) -> None:
        """Adapt to one goal, write the primitive, and note what its motion achieves."""
        self.goals[name] = _goal(self.dmp, asked)
        adapted = self.dmp.adapt(**asked)
        motion = adapted.rollout()
        self.goals[name] = _goal(adapted, asked)
        off, turned = end_errors(motion, self.goals[name])
        turns = motion.space.rotations > 0
        turned = turned if turns else None
        merit = figures_of_merit(motion, self.original, self.dmp.system)
        hard = [c for c in self.dmp.constraints if c.priority == 0]
        report = checked(motion, hard) if hard else None
        (record,) = adapted.record
        messages = [] if report is None or report.satisfied else [report.verdict]
        if record.left_out:
            messages.append(f"the projection cannot keep {', '.join(record.left_out)}")
        peak, before = merit.angular_speed_peak, self.angular_speed_peak
        adapted.save(target)
        self.motions[name] = motion
        self.outcomes.append(
            Outcome(
                name,
                converged=True,
                holds=report is None or report.satisfied,
                end_position_error_m=off,
                end_rotation_error_deg=None if turned is None else float(np.degrees(turned)),
                path_error_m=record.path_error,
                residual_peak=merit.residual_peak,
                angular_speed_peak_rad_s=peak if turns else None,
                angular_speed_ratio=peak / before if before > 0 else None,
                iterations=record.iterations,
                duration_s=adapted.duration,
                maneuver=record.maneuver,
                message="; ".join(messages),
            )
        )

    def try_to_add(self, name: str, asked: Options, target: Path) -> None:
        """Do the same; note warnings, and a failure, which must not stop the other goals."""
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", NoslipWarning)
            try:
                self.add(name, asked, target)
            except (NoslipError, ArithmeticError) as error:
                # What an earlier run wrote there is no primitive for this goal.
                target.unlink(missing_ok=True)
                self.outcomes.append(_refused(name, error))
                return
        texts = [self.outcomes[-1].message, *(str(warning.message) for warning in told)]
        message = "; ".join(filter(None, texts))
        self.outcomes[-1] = replace(self.outcomes[-1], message=message)


def _refused(name: str, error: Exception) -> Outcome:
    """What became of a goal that is refused."""
    refused = Outcome(name, converged=False, message=str(error))
    if not isinstance(error, NoslipError):
        return refused
    return replace(refused, code=error.code or "", needed_duration_s=error.duration)


# ---------------------------------------------------------------- what goes in


def _goal(dmp: ConstrainedDMP, asked: Options) -> Boundary:
    """Where a motion should end: what was asked for, else the primitive's own goal."""
    given = Boundary(1.0, asked["goal_position"], asked["goal_rotation"])
    return Boundary(1.0, *given.pose_or(dmp.goal_position, dmp.goal_rotation)).part(
        asked.get("end", "pose")
    )


def _velocity(option: str, text: str | None, space: Space) -> Floats | str | None:
    if text in (None, "free"):
        return text
    counts = (1, 3, 6) if space.rotations else (1, space.linear)
    values = options.numbers(option, text, counts)
    if not np.isfinite(values).all():
        raise InputError(f"{option}: expected finite numbers (m/s, rad/s), got {text!r}")
    if not space.rotations:
        return np.array(values if len(values) == space.linear else values * space.linear)
    linear, angular = twist(option, values)
    return linear if angular is None else np.concatenate([linear, angular])


def _read_goals(path: Path, space: Space) -> dict[str, Options]:
    """Read the goal and the duration that each row of a CSV asks for, by its name."""
    table = NamedColumns.open(path, plain=True)
    place = POSITION if space.rotations else space.coordinates
    turn = QUATERNION if space.rotations else ()
    columns = _goal_columns(table.where, table.names, [place, turn, ("duration",)])
    labelled = ("name",) if "name" in table.names else ()
    lines, of, texts = table.read(columns, labelled)
    if not lines:
        raise InputError(f"{table.where}: a header and no goals; add a row for each")
    source = Source(path, "", f"columns {', '.join(QUATERNION)}", lines)
    source.check_finite({f"column {name}": values for name, values in of.items()})
    asked: Options = {}
    if place[0] in of:
        asked["goal_position"] = np.column_stack([of[name] for name in place])
    if "qw" in of:
        quaternions = np.column_stack([of[name] for name in QUATERNION])
        asked["goal_rotation"] = source.rotations(quaternions)
    if "duration" in of:
        asked["duration"] = of["duration"].tolist()
        for index, found in enumerate(asked["duration"]):
            if found <= 0:
                raise source.error(index, "column duration", f"found {found:g}; seconds above 0")
    labels = [f"goal_{index:03}" for index in range(1, len(lines) + 1)]
    if labelled:
        labels = _labels(path, dict(zip(lines, texts["name"], strict=True)))
    return {
        label: {name: values[index] for name, values in asked.items()}
        for index, label in enumerate(labels)
    }


def _goal_columns(
    where: str, names: Sequence[str], groups: Sequence[Sequence[str]]
) -> tuple[str, ...]:
    """Return the columns of numbers; refuse what is unknown, twice there, or there by half."""
    known = [name for group in groups for name in group]
    told = [f"{','.join(group)} (all or none)" for group in groups if len(group) > 1]
    listed = ", ".join([*told, *(name for group in groups if len(group) == 1 for name in group)])
    for name in filter(None, names):
        if name not in (*known, "name"):
            near = did_you_mean(name, (*known, "name"))
            raise InputError(
                f"{where}: column {name!r} is not known{near}; known are {listed}, name"
            )
        if names.count(name) > 1:
            raise InputError(f"{where}: column {name} appears twice; keep one")
    for group in groups:
        missing = [name for name in group if name not in names]
        if 0 < len(missing) < len(group):
            raise InputError(
                f"{where}: missing {', '.join(missing)}; give all of {','.join(group)} or none"
            )
    if not set(names) & set(known):
        raise InputError(f"{where}: no column of a goal; give any of {listed}, name")
    return tuple(name for name in known if name in names)


def _labels(path: Path, cells: Mapping[int, str]) -> list[str]:
    """Return the names that rows give, which must differ and do as names of files."""
    taken: dict[str, int] = {}
    for line, cell in cells.items():
        name = cell.strip()
        if not _FILE_NAME.fullmatch(name):
            raise InputError(
                f"{path}: line {line}, column name: {name[:80]!r} is no name of a file; use "
                "letters, digits and _ . + - (up to 100)"
            )
        # Some file systems take upper and lower case for the same.
        if name.casefold() in taken:
            raise InputError(
                f"{path}: line {line}, column name: {name!r} is also that of line "
                f"{taken[name.casefold()]}; rename one"
            )
        taken[name.casefold()] = line
    return [cell.strip() for cell in cells.values()]
