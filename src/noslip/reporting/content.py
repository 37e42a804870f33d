"""What a report tells, as plain values: tables, pictures and commands."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from noslip._version import __version__
from noslip.boundary import Boundary
from noslip.comparison import compare
from noslip.constraints.blade import Blade
from noslip.constraints.check import TOLERANCE, CheckReport, ConstraintCheck, check
from noslip.errors import InputError
from noslip.figures import (
    blade_snapshots,
    column_figure,
    compare_motions,
    constraint_history,
    demonstration_spread,
    learned_spread,
    orientation_adjustments,
    plot_speed,
)
from noslip.figures.family import end_errors
from noslip.figures.quantities import amount, finding, length, residual_rows
from noslip.figures.style import name_lines, number, write_title
from noslip.primitive import ConstrainedDMP
from noslip.reporting.commands import commands, declaration
from noslip.runtime.motion import Motion
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory

PACKAGES = ("numpy", "scipy", "casadi")
LEARNED = "learned motion"
APART = 0.01
"""Share of the path that a primitive may start or end from its recordings without a warning."""


@dataclass(frozen=True)
class Value:
    """A number (SI units, radians) and how it is told."""

    number: float
    text: str


Cell = str | Value


@dataclass(frozen=True)
class Table:
    """Rows under headings, with a note below.

    Attributes
    ----------
    title : str
    columns : tuple of str
        The first one's cells head their rows.
    rows : tuple of tuple of str or Value
    note : str
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure and what it shows."""

    caption: str
    figure: Figure


@dataclass(frozen=True, eq=False)
class Report:
    """All that a report of a primitive says.

    Attributes
    ----------
    title : str
        The finding.
    primitive : str
        The primitive's file.
    lead : str
        What was learned from what, in a sentence or two.
    verdict : str
        What :func:`noslip.check` says of the motion; empty without constraints.
    holds : bool
    warnings : tuple of str
        Where recordings and primitive do not fit together.
    tables : tuple of Table
    pictures : tuple of Picture
    commands : tuple of str
        Shell commands that make it again.
    """

    title: str
    primitive: str
    lead: str
    verdict: str
    holds: bool
    warnings: tuple[str, ...]
    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...]
    commands: tuple[str, ...]


def report(
    primitive: str | Path,
    demonstrations: Sequence[PoseTrajectory] = (),
    *,
    preparation: Sequence[str] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Gather what there is to tell about a saved primitive.

    Parameters
    ----------
    primitive : path
        What :meth:`noslip.ConstrainedDMP.save` wrote.
    demonstrations : sequence of PoseTrajectory, optional
        What it was learned from, prepared as then.  Without them the ordinary primitive, fitted to
        them without constraints, stands in their place.
    preparation : sequence of str
        The options of ``noslip learn`` that prepare them, for the commands.
    progress : callable, optional
        Called with (figures done, figures in all).

    Raises
    ------
    InputError
        If the file is no primitive.
    """
    dmp = load_primitive(primitive)
    sources = [demonstration.name for demonstration in demonstrations]
    shown = [
        replace(d, name=name) for d, name in zip(demonstrations, _short_names(sources), strict=True)
    ]
    motion, regular = dmp.rollout(), dmp.regular.rollout()
    motions: dict[str, PoseTrajectory] = {"regular": regular, "optimized": motion}
    if shown:
        motions = {"demonstration": _worst(shown, dmp), **motions}
    verdict = check(motion, dmp.constraints) if dmp.constraints else None

    files = [str(primitive), *(name for name in sources if Path(name).is_file())]
    names = [record.demonstration for record in dmp.record]
    title, rest = _split(_title(motions, dmp))
    tables = [
        _files(files),
        *_recordings(dmp, shown, motion),
        *_constraints(dmp, shown, regular, verdict),
        _merits(dmp, motions),
        _settings(dmp),
    ]
    return Report(
        title=title,
        primitive=printable(Path(primitive).name),
        lead=" ".join(filter(None, [f"{rest}." if rest else "", _lead(dmp, shown)])),
        verdict="" if verdict is None else verdict.verdict,
        holds=verdict is None or verdict.satisfied,
        warnings=tuple(_mismatches(dmp, shown)),
        tables=tuple(tables),
        pictures=tuple(_pictures(dmp, shown, motions, motion, progress)),
        commands=tuple(
            printable(line) for line in commands(dmp, str(primitive), sources or names, preparation)
        ),
    )


def printable(text: str) -> str:
    """Return text with what cannot be printed replaced; bytes of a file's name that are no text."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def _short_names(paths: Sequence[str]) -> list[str]:
    """Names of files, without their folders if they differ without."""
    names = [Path(path).name or path for path in paths]
    return [printable(name) for name in (names if len(set(names)) == len(names) else paths)]


# ---------------------------------------------------------------- in words


def _title(motions: Mapping[str, PoseTrajectory], dmp: ConstrainedDMP) -> str:
    motion = motions["optimized"]
    if not dmp.constraints:
        path, duration = length(motion.path_length), number(motion.duration)
        return f"A path of {path} in {duration} s, learned without constraints"
    first = next(iter(motions))
    rows = residual_rows({first: motions[first], LEARNED: motion}, dmp.system)
    # Figures escape what their formulas begin with.
    return printable(finding(rows).replace(r"\$", "$"))


def _split(title: str) -> tuple[str, str]:
    """Return the first sentence of a finding, and what it goes on with."""
    first, _, rest = title.partition(".  ")
    return first, rest


def _lead(dmp: ConstrainedDMP, demonstrations: Sequence[PoseTrajectory]) -> str:
    count = dmp.spread.demonstrations if dmp.spread else max(len(dmp.record), 1)
    under = ", ".join(printable(name) for name in dmp.system.names) or "no constraint"
    text = (
        f"A primitive of {number(dmp.duration)} s, learned from {count} recording"
        f"{'s' if count > 1 else ''} under: {under}."
    )
    if not demonstrations:
        text += "  The recordings were not at hand for this report."
    return text


def _mismatches(dmp: ConstrainedDMP, demonstrations: Sequence[PoseTrajectory]) -> Iterable[str]:
    """Say where what is given is not what the primitive was learned from."""
    if not demonstrations:
        return
    # Without constraints there is no record of a projection.
    if dmp.record and len(dmp.record) != len(demonstrations):
        yield (
            f"learned from {len(dmp.record)} recordings, given {len(demonstrations)}; the report "
            "compares with what is given"
        )
        return
    for record, given in zip(dmp.record, demonstrations, strict=False):
        learned = printable(record.demonstration)
        if Path(learned).name != Path(given.name).name:
            yield f"learned from {learned}, given {given.name}: another recording, or adapted since"
    for what, sample, own in (
        ("starts", 0, dmp.regular.start_position),
        ("ends", -1, dmp.regular.goal_position),
    ):
        theirs = np.mean([d.positions[sample] for d in demonstrations], axis=0)
        off = float(np.linalg.norm(own - theirs))
        if off > APART * dmp.regular.rollout().path_length:
            yield (
                f"the primitive {what} {length(off)} from where the recordings do; give the "
                "options with which they were prepared (or it was adapted since)"
            )


def _worst(demonstrations: Sequence[PoseTrajectory], dmp: ConstrainedDMP) -> PoseTrajectory:
    """Return the demonstration that violates the constraints most; the first, if none."""
    if not dmp.constraints:
        return demonstrations[0]
    return max(demonstrations, key=lambda d: check(d, dmp.constraints).peak)


# ---------------------------------------------------------------- tables


def _files(files: Iterable[str]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for file in files:
        try:
            content = Path(file).read_bytes()
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror}") from error
        size = Value(len(content), f"{len(content):,}".replace(",", " "))
        rows.append((printable(file), size, hashlib.sha256(content).hexdigest()))
    return Table("Files", ("file", "bytes", "SHA-256"), tuple(rows))


def _recordings(
    dmp: ConstrainedDMP, demonstrations: Sequence[PoseTrajectory], motion: Motion
) -> list[Table]:
    tables = []
    if demonstrations:
        rows: list[tuple[Cell, ...]] = []
        for given in demonstrations:
            merits = compare(motion, given, dmp.system)
            rows.append(
                (
                    given.name,
                    _count(len(given)),
                    _amount(given.duration, "s"),
                    _amount(given.path_length, "m"),
                    _amount(merits.position_rms, "m"),
                    _amount(merits.position_end, "m"),
                    _angle(merits.rotation_rms),
                )
            )
        tables.append(
            Table(
                "Recordings, as prepared",
                ("recording", "samples", "duration", "path", "motion off", "at its end", "turned"),
                tuple(rows),
                "Motion off: distance of the learned motion from the recording at the same share "
                "of their times, rms; turned: angle between the two, rms.",
            )
        )
    if dmp.record:
        tables.append(
            Table(
                "What learning changed",
                ("recording", "samples", "iterations", "residual", "moved", "turned", "left out"),
                tuple(
                    (
                        name,
                        _count(record.samples),
                        _count(record.iterations),
                        _plain(record.residual),
                        _amount(record.position_change, "m"),
                        _angle(record.rotation_change),
                        printable(", ".join(record.left_out)) or "nothing",
                    )
                    for name, record in zip(
                        _short_names([r.demonstration for r in dmp.record]), dmp.record, strict=True
                    )
                ),
                "Each recording is projected onto the constraints before the primitive is fitted.  "
                "Residual: the largest afterwards, in the constraints' units (SI); moved and "
                "turned: by the projection, rms; left out: limits that hold at run time alone.",
            )
        )
    return tables


def _constraints(
    dmp: ConstrainedDMP,
    demonstrations: Sequence[PoseTrajectory],
    regular: PoseTrajectory,
    verdict: CheckReport | None,
) -> list[Table]:
    if verdict is None:
        return []
    before = [check(motion, dmp.constraints) for motion in demonstrations or [regular]]
    rows: list[tuple[Cell, ...]] = []
    for index, (constraint, after) in enumerate(
        zip(dmp.constraints, verdict.constraints, strict=True)
    ):
        worst = max((report.constraints[index] for report in before), key=_violation)
        kind = f"{constraint.level} equality"
        if constraint.relation == "nonnegative":
            soft = f"soft limit, priority {constraint.priority}" if constraint.priority else "limit"
            kind = f"{constraint.level} {soft}"
        rows.append(
            (
                printable(declaration(constraint)),
                kind,
                _extreme(worst),
                _extreme(after),
                after.verdict,
            )
        )
    who = "as demonstrated" if demonstrations else "regular"
    return [
        Table(
            "Constraints",
            ("declaration", "kind", who, "learned", "verdict"),
            tuple(rows),
            "Of an equality the largest residual of all steps, of a limit the least margin (below "
            f"zero: violated).  Holds: not violated by more than {TOLERANCE:g}, in SI units.",
        )
    ]


def _violation(result: ConstraintCheck) -> float:
    return result.peak if result.margin is None else -result.margin


def _extreme(result: ConstraintCheck) -> Value:
    if result.margin is None:
        return _amount(result.peak, result.unit)
    return Value(result.margin, f"margin {amount(result.margin, result.unit)}")


def _merits(dmp: ConstrainedDMP, motions: Mapping[str, PoseTrajectory]) -> Table:
    """Figures of merit, a row each, a column a motion."""
    (against, reference), *_ = motions.items()
    units = set(dmp.system.equalities.row_units)
    unit = units.pop() if len(units) == 1 else "(SI)"
    goal = Boundary(1.0, dmp.goal_position, dmp.goal_rotation)
    columns: list[tuple[Cell, ...]] = []
    for motion in motions.values():
        merits = compare(motion, reference, dmp.system)
        off, turned = end_errors(motion, goal)
        assert off is not None and turned is not None
        speeds = np.linalg.norm(motion.step_velocities()[0], axis=1)
        forces: list[Cell] = ["–", "–"]
        if isinstance(motion, Motion) and dmp.constraints and motion.row_forces.size:
            sizes = np.split(motion.constraint_forces, 2, axis=1)
            peaks = [float(np.linalg.norm(size, axis=1).max()) for size in sizes]
            forces = [_amount(peaks[0], "m/s²"), _amount(peaks[1], "rad/s²")]
        residuals = [_amount(r, unit) for r in (merits.residual_peak, merits.residual_rms)]
        columns.append(
            (
                *(residuals if dmp.system.equalities.size else ()),
                _amount(merits.position_rms, "m"),
                _angle(merits.rotation_rms),
                _angle(merits.rotation_peak),
                _amount(off, "m"),
                _angle(turned),
                _amount(float(speeds.max()), "m/s"),
                _amount(merits.angular_speed_peak, "rad/s"),
                _amount(merits.angular_acceleration_peak, "rad/s²"),
                *forces,
            )
        )
    names = (
        *(("residual, peak", "residual, rms") if dmp.system.equalities.size else ()),
        f"distance from {against}, rms",
        f"angle to {against}, rms",
        f"angle to {against}, peak",
        "end: distance from the learned goal",
        "end: angle to the learned goal",
        "peak speed",
        "peak angular speed",
        "peak angular acceleration",
        "peak constraint acceleration, linear",
        "peak constraint acceleration, angular",
    )
    note = (
        "Regular: the ordinary primitive, fitted to the recordings without constraints.  "
        "Optimized: the primitive's own motion."
    )
    if "demonstration" in motions and len(dmp.record) > 1:
        note += f"  Demonstration: {reference.name}, of all the one that violates them most."
    rows = tuple(
        (name, *cells) for name, cells in zip(names, zip(*columns, strict=True), strict=True)
    )
    return Table("Figures of merit", ("", *motions), rows, note)


def _settings(dmp: ConstrainedDMP) -> Table:
    step = dmp.duration / dmp.steps
    rows: list[tuple[Cell, ...]] = [
        ("duration τ", _amount(dmp.duration, "s")),
        ("steps", _count(dmp.steps)),
        ("time step", Value(step, f"{number(1e3 * step)} ms")),
        ("basis functions", _count(dmp.law.basis.count)),
        ("attractor α, β", f"{dmp.law.attractor.alpha:g}, {dmp.law.attractor.beta:g}"),
        ("phase α_s", _plain(dmp.law.clock.alpha_s)),
        ("inverse metric, diagonal of M⁻¹", ", ".join(map(number, dmp.rule.inverse_metric))),
        ("stabilization, per duration", _plain(dmp.rule.stabilization)),
        ("barrier rate, per duration", _plain(dmp.rule.barrier_rate)),
    ]
    smoothing = sorted({record.smoothing for record in dmp.record})
    if smoothing:
        rows.append(("rotation smoothing", ", ".join(map(number, smoothing))))
    rows += [("noslip", __version__), ("Python", platform.python_version())]
    rows += [(package, version(package)) for package in PACKAGES]
    return Table("Settings and versions", ("", ""), tuple(rows))


def _plain(value: float) -> Value:
    return Value(value, number(value))


def _count(value: int) -> Value:
    return Value(value, str(value))


def _amount(value: float, unit: str) -> Value:
    return Value(value, amount(value, unit))


def _angle(radians: float) -> Value:
    return Value(radians, f"{number(float(np.degrees(radians)))}°")


# ---------------------------------------------------------------- pictures


def _pictures(
    dmp: ConstrainedDMP,
    demonstrations: Sequence[PoseTrajectory],
    motions: Mapping[str, PoseTrajectory],
    motion: Motion,
    progress: Callable[[int, int], None] | None,
) -> Iterable[Picture]:
    held = dmp.constraints
    first = next(iter(motions))
    pair = {first: motions[first], "optimized": motion}
    draws: list[tuple[str, Callable[[], Figure]]] = [
        (
            "Where the motions go, how they turn, and how well the constraints hold.",
            lambda: compare_motions(motions, held),
        ),
        ("How fast the tool moves and turns.", lambda: _speeds(motions)),
    ]
    if held:
        draws.append(
            (
                "Of each constraint: residual or margin, multiplier, and the acceleration it adds.",
                lambda: constraint_history(motion, held),
            )
        )
    # The snapshots' blade has its edge along x and its side along y.
    if Blade() in held:
        draws.append(
            (
                "The blade along the path, colored by the share of its speed that goes sideways.",
                lambda: blade_snapshots(pair),
            )
        )
    if len(demonstrations) > 1:
        draws.append(
            (
                "The recordings, their mean and one standard deviation.",
                lambda: demonstration_spread(demonstrations, held),
            )
        )
    if demonstrations:
        learned = [motion] * len(demonstrations)
        draws.append(
            (
                "How far the learned motion is turned from each recording.",
                lambda: orientation_adjustments(demonstrations, learned),
            )
        )
    if dmp.spread is not None:
        draws.append(
            (
                "How far the recordings lie apart along the motion, starts and goals aside.",
                lambda: learned_spread(dmp),
            )
        )
    for done, (caption, draw) in enumerate(draws, start=1):
        yield Picture(caption, draw())
        if progress is not None:
            progress(done, len(draws))


def _speeds(motions: Mapping[str, PoseTrajectory]) -> Figure:
    figure = column_figure(2)
    linear, angular = figure.subplots(1, 2)
    plot_speed(linear, motions)
    plot_speed(angular, motions, "angular")
    name_lines(figure, motions)
    moving, turning = (
        float(np.linalg.norm(velocities, axis=1).max())
        for velocities in motions["optimized"].step_velocities()
    )
    write_title(
        figure,
        f"Optimized moves at up to {amount(moving, 'm/s')} and turns at up to "
        f"{amount(turning, 'rad/s')}",
    )
    return figure
