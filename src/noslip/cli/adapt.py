"""``noslip adapt``: a primitive and new goals in, primitives that end there out."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from noslip import _arguments
from noslip._files import write_beside
from noslip._pose_checks import Source
from noslip._pose_csv import POSITION, QUATERNION
from noslip.adaptation import Via
from noslip.cli import options, output
from noslip.cli.plot import FORMATS
from noslip.comparison import compare
from noslip.constraints.check import amount, check
from noslip.errors import InputError, NoslipError
from noslip.figures import adapted_family, save_figure
from noslip.figures.family import Goal, end_errors
from noslip.learning import ConstrainedDMP
from noslip.named_columns import NamedColumns, records_text
from noslip.primitives.pose import Motion
from noslip.primitives.scaling import Scaling
from noslip.projection.trajectory import End
from noslip.saving import load_primitive

NAME = "adapt"
SUMMARY = "summary.csv"
EXAMPLES = """
Examples:

  noslip adapt excision.json --goal-position 0.05,0.01,0 --out longer.json

  noslip adapt excision.json --goal-position 0.05,0.01,0 --goal-rotation 1,0,0,0 --duration 6
  --via 0.5:0.02,0.02,0 --figure longer.png --out longer.json

  noslip adapt excision.json --goals goals.csv --figure family.png --out family/
"""
_FILE_NAME = re.compile(r"\w[\w .+-]{0,99}")
_COLUMNS = (POSITION, QUATERNION, ("duration",))
_KNOWN = "x,y,z (all or none), qw,qx,qy,qz (all or none), duration, name"

Point = Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Meters.", show_default=False)]
Turn = Annotated[str | None, typer.Option(metavar="QW,QX,QY,QZ", show_default=False)]


@dataclass(frozen=True)
class Outcome:
    """What became of one goal: a row of the summary.

    Attributes
    ----------
    name : str
    converged : bool
        Whether there is a primitive; if not, ``message`` says why and the rest is None.
    holds : bool or None
        Whether its motion keeps every constraint and hard limit.
    end_position_error_m, end_rotation_error_deg : float or None
        From the goal to the end of the motion; None of what is left free.
    residual_peak : float or None
        Of the equalities, in their units (SI).
    angular_speed_peak_rad_s, angular_speed_ratio : float or None
        The latter over that of the original primitive, None if that never turns.
    iterations : int or None
        Of the projection.
    duration_s : float or None
    message : str
        Why it failed, or what a person should know.
    """

    name: str
    converged: bool
    holds: bool | None = None
    end_position_error_m: float | None = None
    end_rotation_error_deg: float | None = None
    residual_peak: float | None = None
    angular_speed_peak_rad_s: float | None = None
    angular_speed_ratio: float | None = None
    iterations: int | None = None
    duration_s: float | None = None
    message: str = ""

    @property
    def failed(self) -> bool:
        """Whether there is no primitive, or one that breaks its constraints."""
        return not (self.converged and self.holds)


def run(
    primitive: Annotated[
        Path, typer.Argument(help="A primitive written by noslip learn.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="PATH", help="Primitive to write (JSON); with --goals, a folder."),
    ],
    goals: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=f"CSV with a goal a row, its columns any of {_KNOWN}.  The other options hold for "
            "all rows.",
            show_default=False,
        ),
    ] = None,
    goal_position: Point = None,
    goal_rotation: Turn = None,
    start_position: Point = None,
    start_rotation: Turn = None,
    start_velocity: Annotated[
        str | None,
        typer.Option(
            metavar="VX,VY,VZ[,WX,WY,WZ]",
            help="m/s and rad/s; by default whatever suits the motion.",
            show_default=False,
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Seconds.", show_default=False)
    ] = None,
    via: Annotated[
        list[str],
        typer.Option(
            metavar="AT:X,Y,Z[,QW,QX,QY,QZ]",
            help="To pass at a fraction of the duration, 0 < AT < 1; repeatable.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 - typer's way to say none
    scaling: Annotated[
        Scaling,
        typer.Option(
            help="How the path follows before it is projected: displaced, stretched axis by axis, "
            "or turned and stretched as a whole."
        ),
    ] = "none",
    end: Annotated[End, typer.Option(help="What of the goal is kept to.")] = "pose",
    figure: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Figure to write: .png, .svg or .pdf.", show_default=False
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Move a primitive to new goals, starts and via points; it still holds its constraints.

    The motion is moved to the new ends, projected onto the constraints with these fixed, and
    fitted again.  Of what is not named the primitive's own stays.

    With --goals each row becomes a primitive in the folder, and summary.csv tells of each how far
    from its goal its motion ends, its residual and its peak angular speed.  Rows that fail are
    listed, the others finished.  Exits with 1 if any failed, or violates a constraint.
    """
    if figure is not None and options.output(figure, "--figure") and figure.suffix not in FORMATS:
        raise InputError(f"--figure: {figure} must end in {', '.join(FORMATS)}")
    wanted: dict[str, Any] = {
        "goal_position": options.vector("--goal-position", goal_position),
        "goal_rotation": options.rotation("--goal-rotation", goal_rotation),
        "start_position": options.vector("--start-position", start_position),
        "start_rotation": options.rotation("--start-rotation", start_rotation),
        "start_velocity": _velocity(start_velocity),
        "duration": None
        if duration is None
        else _arguments.positive("--duration", duration, "seconds"),
        "via": [_via(text) for text in via],
        "scaling": scaling,
        "end": end,
    }
    dmp = load_primitive(primitive)
    family = _Family(dmp)
    if goals is None:
        options.output(out)
        family.add(out.stem, wanted, out)
        outcome = family.outcomes[0]
        result = {"primitive": str(out)} | asdict(outcome)
        told = [*_told(outcome), f"wrote {out}"]
    else:
        if out.exists() and not out.is_dir():
            raise InputError(f"--out: {out} is a file; with --goals give a folder")
        rows = {name: _merged(goals, wanted, row) for name, row in _read_goals(goals).items()}
        targets = {name: out / f"{name}.json" for name in rows}
        for name, target in targets.items():
            if target.resolve() == primitive.resolve():
                raise InputError(f"--out: goal {name!r} would replace {primitive}; rename either")
        with output.progress("adapting", len(rows)) as progress:
            for done, (name, row) in enumerate(rows.items(), start=1):
                family.try_to_add(name, row, targets[name])
                progress(done, len(rows))
        text = records_text([f.name for f in fields(Outcome)], map(asdict, family.outcomes))
        summary = write_beside(out / SUMMARY, text.encode())
        failed = sum(outcome.failed for outcome in family.outcomes)
        result = {
            "folder": str(out),
            "summary": str(summary),
            "failed": failed,
            "goals": [asdict(outcome) for outcome in family.outcomes],
        }
        told = _told_together(family.outcomes)
        told.append(f"wrote {out}: {len(family.motions)} primitive(s) and {SUMMARY}")
    if figure is not None and family.motions:
        save_figure(
            adapted_family(family.original, family.motions, family.goals, dmp.system), figure
        )
        result["figure"] = str(figure)
        told.append(f"wrote {figure}")
    elif figure is not None:
        told.append(f"no {figure}: there is no motion to draw")
    if as_json:
        output.print_json(result)
    else:
        for line in told:
            typer.echo(line)
    if any(outcome.failed for outcome in family.outcomes):
        raise typer.Exit(1)


class _Family:
    """The primitives adapted from one, their motions, and what became of each goal."""

    def __init__(self, dmp: ConstrainedDMP) -> None:
        self.dmp = dmp
        self.original = dmp.rollout()
        self.angular_speed_peak = compare(self.original, self.original, ()).angular_speed_peak
        self.motions: dict[str, Motion] = {}
        self.goals: dict[str, Goal] = {}
        self.outcomes: list[Outcome] = []

    def add(self, name: str, wanted: Mapping[str, Any], target: Path) -> None:
        """Adapt to one goal, write the primitive, and note what its motion achieves."""
        self.goals[name] = _goal(self.dmp, wanted)
        adapted = self.dmp.adapt(**wanted)
        motion = adapted.rollout()
        self.goals[name] = _goal(adapted, wanted)
        off, turned = end_errors(motion, self.goals[name])
        compared = compare(motion, self.original, self.dmp.system)
        hard = [c for c in self.dmp.constraints if c.priority == 0]
        report = check(motion, hard) if hard else None
        (record,) = adapted.record
        messages = [] if report is None or report.satisfied else [report.verdict]
        if record.left_out:
            messages.append(f"the projection cannot keep {', '.join(record.left_out)}")
        peak, before = compared.angular_speed_peak, self.angular_speed_peak
        adapted.save(target)
        self.motions[name] = motion
        self.outcomes.append(
            Outcome(
                name,
                converged=True,
                holds=report is None or report.satisfied,
                end_position_error_m=off,
                end_rotation_error_deg=None if turned is None else float(np.degrees(turned)),
                residual_peak=compared.residual_peak,
                angular_speed_peak_rad_s=peak,
                angular_speed_ratio=peak / before if before > 0 else None,
                iterations=record.iterations,
                duration_s=adapted.duration,
                message="; ".join(messages),
            )
        )

    def try_to_add(self, name: str, wanted: Mapping[str, Any], target: Path) -> None:
        """Do the same; note a failure, which must not stop the other goals."""
        try:
            self.add(name, wanted, target)
        except (NoslipError, ArithmeticError) as error:
            # What an earlier run wrote there is no primitive for this goal.
            target.unlink(missing_ok=True)
            self.outcomes.append(Outcome(name, converged=False, message=str(error)))


def _goal(primitive: ConstrainedDMP, wanted: Mapping[str, Any]) -> Goal:
    """Where a motion should end: what was asked for, else the primitive's own goal."""
    end, position, rotation = (wanted[key] for key in ("end", "goal_position", "goal_rotation"))
    own = primitive.position.goal, primitive.orientation.goal
    return (
        (own[0] if position is None else position) if end in ("position", "pose") else None,
        (own[1] if rotation is None else rotation) if end in ("rotation", "pose") else None,
    )


# ---------------------------------------------------------------- what goes in


def _velocity(text: str | None) -> list[float] | None:
    if text is None:
        return None
    values = options.numbers("--start-velocity", text, (3, 6))
    if not np.isfinite(values).all():
        raise InputError(f"--start-velocity: expected finite numbers (m/s, rad/s), got {text!r}")
    return values


def _via(text: str) -> Via:
    at, colon, pose = text.partition(":")
    try:
        fraction = float(at if colon else "")
    except ValueError:
        raise InputError(
            f"--via: expected AT:X,Y,Z or AT:X,Y,Z,QW,QX,QY,QZ with 0 < AT < 1, got {text!r}"
        ) from None
    options.numbers("--via", pose, (3, 7))
    cells = pose.split(",")
    rotation = options.rotation("--via", ",".join(cells[3:])) if cells[3:] else None
    return Via(fraction, options.vector("--via", ",".join(cells[:3])), rotation)


def _merged(goals: Path, wanted: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the options want of every row with what a row wants."""
    for key in row:
        if wanted[key] is not None:
            option = f"--{key.replace('_', '-')}"
            raise InputError(f"{option}: {goals} has columns for it too; leave one of them out")
    return {**wanted, **row}


def _read_goals(path: Path) -> dict[str, dict[str, Any]]:
    """Read what each row of a CSV asks for, as arguments of ``adapt`` by name."""
    table = NamedColumns.open(path)
    columns = _goal_columns(table.where, table.names)
    labelled = ("name",) if "name" in table.names else ()
    lines, of, texts = table.read(columns, labelled)
    if not lines:
        raise InputError(f"{table.where}: a header and no goals; add a row for each")
    source = Source(path, "", f"columns {', '.join(QUATERNION)}", lines)
    source.check_finite({f"column {name}": values for name, values in of.items()})
    wanted: dict[str, Any] = {}
    if "x" in of:
        wanted["goal_position"] = np.column_stack([of[name] for name in POSITION])
    if "qw" in of:
        wanted["goal_rotation"] = source.rotations(np.column_stack([of[k] for k in QUATERNION]))
    if "duration" in of:
        wanted["duration"] = of["duration"]
        if (of["duration"] <= 0).any():
            index = int(np.argmax(of["duration"] <= 0))
            found = of["duration"][index]
            raise source.error(index, "column duration", f"found {found:g}; seconds above 0")
    labels = [f"goal_{index:03}" for index in range(1, len(lines) + 1)]
    if labelled:
        labels = _labels(path, dict(zip(lines, texts["name"], strict=True)))
    return {
        label: {key: values[index] for key, values in wanted.items()}
        for index, label in enumerate(labels)
    }


def _goal_columns(where: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of numbers; refuse what is unknown, twice there, or there by half."""
    known = [name for group in _COLUMNS for name in group]
    for name in filter(None, names):
        if name not in (*known, "name"):
            raise InputError(f"{where}: column {name!r} is not known; known are {_KNOWN}")
        if names.count(name) > 1:
            raise InputError(f"{where}: column {name} appears twice; keep one")
    for group in _COLUMNS:
        missing = [name for name in group if name not in names]
        if 0 < len(missing) < len(group):
            raise InputError(
                f"{where}: missing {', '.join(missing)}; give all of {','.join(group)} or none"
            )
    if not set(names) & set(known):
        raise InputError(f"{where}: no column of a goal; give any of {_KNOWN}")
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


# ---------------------------------------------------------------- what comes out


def _told(outcome: Outcome) -> list[str]:
    return _achieved([outcome]) + ([outcome.message] if outcome.message else [])


def _told_together(outcomes: list[Outcome]) -> list[str]:
    done = [outcome for outcome in outcomes if outcome.converged]
    lines = [f"adapted to {len(done)} of {len(outcomes)} goals"]
    lines += _achieved(done) if done else []
    return lines + [
        f"{outcome.name}: {'FAILED, ' if outcome.failed else ''}{outcome.message}"
        for outcome in outcomes
        if outcome.message
    ]


def _achieved(outcomes: list[Outcome]) -> list[str]:
    """Say the largest numbers of all outcomes that have them."""

    def most(name: str) -> float | None:
        found = [getattr(outcome, name) for outcome in outcomes]
        return max((value for value in found if value is not None), default=None)

    off, turned, residual, speed, ratio = (
        most(name)
        for name in (
            "end_position_error_m",
            "end_rotation_error_deg",
            "residual_peak",
            "angular_speed_peak_rad_s",
            "angular_speed_ratio",
        )
    )
    ends = [] if off is None else [amount(off, "m")]
    ends += [] if turned is None else [f"{turned:.3g} degrees"]
    lines = [f"ends within {' and '.join(ends)} of the goal"] if ends else []
    times = "" if ratio is None else f", {ratio:.3g} times that of the original"
    return [
        *lines,
        f"residual at most {residual:.2g}",
        f"angular speed at most {speed:.3g} rad/s{times}",
    ]
