"""The tables of a report: files, recordings, constraints, figures of merit, settings."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from noslip._version import __version__
from noslip.boundary import Boundary
from noslip.constraints.check import (
    SLIP_SHARE,
    TOLERANCE,
    CheckReport,
    ConstraintCheck,
    check,
    checked,
)
from noslip.errors import InputError, one_line
from noslip.figures.family import end_errors
from noslip.figures.quantities import value_text
from noslip.figures.style import number
from noslip.merit import figures_of_merit
from noslip.primitive import ConstrainedDMP
from noslip.reporting.commands import declaration
from noslip.reporting.values import Cell, Table, Value, cell, count, plain
from noslip.runtime.motion import Motion
from noslip.trajectory import PoseTrajectory


def files_table(files: Iterable[str]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for file in files:
        try:
            content = Path(file).read_bytes()
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror}") from error
        size = Value(len(content), f"{len(content):,}".replace(",", " "))
        rows.append((one_line(file), size, hashlib.sha256(content).hexdigest()))
    return Table("Files", ("file", "bytes", "SHA-256"), tuple(rows))


def recordings_tables(
    dmp: ConstrainedDMP, demonstrations: Sequence[PoseTrajectory], motion: Motion
) -> Iterable[Table]:
    given = [(d, figures_of_merit(motion, d, dmp.system)) for d in demonstrations]
    prepared = Table(
        "Recordings, as prepared",
        ("recording", "samples", "duration", "path", "motion off", "at its end", "turned"),
        tuple(
            (
                demonstration.name,
                count(len(demonstration)),
                cell(demonstration.duration, "s"),
                cell(demonstration.path_length, "m"),
                cell(merits.position_rms, "m"),
                cell(merits.end_error, "m"),
                cell(merits.rotation_rms, "rad"),
            )
            for demonstration, merits in given
        ),
        "Motion off: distance of the learned motion from the recording at the same share of their "
        "times, rms; turned: angle between the two, rms.",
    )
    names = short_names([record.demonstration for record in dmp.record])
    changed = Table(
        "What learning changed",
        ("recording", "samples", "iterations", "residual", "moved", "turned", "left out"),
        tuple(
            (
                name,
                count(record.samples),
                count(record.iterations),
                plain(record.residual),
                cell(record.position_change, "m"),
                cell(record.rotation_change, "rad"),
                one_line(", ".join(record.left_out)) or "nothing",
            )
            for name, record in zip(names, dmp.record, strict=True)
        ),
        "Each recording is projected onto the constraints before the primitive is fitted.  "
        "Residual: the largest afterwards, in the constraints' units (SI); moved and turned: by "
        "the projection, rms; left out: limits that hold at run time alone.",
    )
    return [table for table in (prepared, changed) if table.rows]


def constraints_tables(
    dmp: ConstrainedDMP,
    demonstrations: Sequence[PoseTrajectory],
    regular: PoseTrajectory,
    verdict: CheckReport | None,
) -> list[Table]:
    if verdict is None:
        return []
    before = [check(motion, dmp.constraints) for motion in demonstrations or [regular]]
    rows: list[tuple[Cell, ...]] = []
    found = [report.constraints for report in (verdict, *before)]
    for constraint, after, *others in zip(dmp.constraints, *found, strict=True):
        worst = max(others, key=lambda one: one.peak if one.margin is None else -one.margin)
        kind = f"{constraint.level} equality"
        if constraint.relation == "nonnegative":
            soft = f"soft limit, priority {constraint.priority}" if constraint.priority else "limit"
            kind = f"{constraint.level} {soft}"
        name = one_line(declaration(constraint))
        rows.append((name, kind, _extreme(worst), _extreme(after), after.verdict))
    who = "regular"
    if demonstrations:
        who = "as demonstrated" if len(demonstrations) == 1 else "worst recording"
    return [
        Table(
            "Constraints",
            ("declaration", "kind", who, "learned", "verdict"),
            tuple(rows),
            "Of an equality the largest residual of all steps, of a limit the least margin (below "
            f"zero: violated).  Holds: not violated by more than {TOLERANCE:g}, in SI units, and "
            f"slips at most {SLIP_SHARE:.0%} of its way.",
        )
    ]


def _extreme(result: ConstraintCheck) -> Value:
    if result.margin is None:
        return Value(result.peak, value_text(result.peak, result.unit))
    return Value(result.margin, f"margin {value_text(result.margin, result.unit)}")


def merits_table(dmp: ConstrainedDMP, motions: Mapping[str, PoseTrajectory]) -> Table:
    """Figures of merit, a row each, a column a motion."""
    (against, reference), *_ = motions.items()
    units = set(dmp.system.equalities.row_units)
    residual_unit = units.pop() if len(units) == 1 else "(SI)"
    goal = Boundary(1.0, dmp.goal_position, dmp.goal_rotation)
    slips: list[list[float]] = []
    for motion in motions.values() if dmp.system.size else ():
        found = checked(motion, dmp.system).constraints
        slips.append([one.slip_distance for one in found if one.slip_distance is not None])
    merits = [figures_of_merit(motion, reference, dmp.system) for motion in motions.values()]
    ends = [end_errors(motion, goal) for motion in motions.values()]
    shown: list[tuple[str, str, Sequence[float | None]]] = [
        (name, unit, [getattr(merit, figure) for merit in merits])
        for name, unit, figure in (
            ("residual, peak", residual_unit, "residual_peak"),
            ("residual, rms", residual_unit, "residual_rms"),
            (f"distance from {against}, rms", "m", "position_rms"),
            (f"angle to {against}, rms", "rad", "rotation_rms"),
            (f"angle to {against}, peak", "rad", "rotation_error"),
            ("peak speed", "m/s", "speed_peak"),
            ("peak angular speed", "rad/s", "angular_speed_peak"),
            ("peak angular acceleration", "rad/s²", "angular_acceleration_peak"),
            ("peak constraint acceleration, linear", "m/s²", "force_peak"),
            ("peak constraint acceleration, angular", "rad/s²", "torque_peak"),
        )
        if dmp.system.equalities.size or not name.startswith("residual")
    ]
    shown += [
        ("end: distance from the learned goal", "m", [off for off, _ in ends]),
        ("end: angle to the learned goal", "rad", [turned for _, turned in ends]),
    ]
    note = (
        "Regular: the ordinary primitive, fitted to the recordings without constraints.  "
        "Optimized: the primitive's own motion."
    )
    if "demonstration" in motions and len(dmp.record) > 1:
        note += f"  Demonstration: {reference.name}, of all the one that violates them most."
    if slips and all(slips):
        shown.insert(0, ("way slipped", "m", [max(each) for each in slips]))
    rows = tuple((name, *(cell(value, unit) for value in values)) for name, unit, values in shown)
    return Table("Figures of merit", ("", *motions), rows, note)


def settings_table(dmp: ConstrainedDMP) -> Table:
    step = dmp.duration / dmp.steps
    rows: list[tuple[Cell, ...]] = [
        ("duration τ", cell(dmp.duration, "s")),
        ("steps", count(dmp.steps)),
        ("time step", Value(step, f"{number(1e3 * step)} ms")),
        ("basis functions", count(dmp.law.basis.count)),
        ("attractor α, β", f"{dmp.law.attractor.alpha:g}, {dmp.law.attractor.beta:g}"),
        ("phase α_s", plain(dmp.law.clock.alpha_s)),
        ("inverse metric, diagonal of M⁻¹", ", ".join(map(number, dmp.rule.inverse_metric))),
        ("stabilization, per duration", plain(dmp.rule.stabilization)),
        ("barrier rate, per duration", plain(dmp.rule.barrier_rate)),
    ]
    smoothing = sorted({record.smoothing for record in dmp.record})
    if smoothing:
        rows.append(("rotation smoothing", ", ".join(map(number, smoothing))))
    rows += [("noslip", __version__), ("Python", platform.python_version())]
    rows += [(package, version(package)) for package in ("numpy", "scipy", "casadi")]
    return Table("Settings and versions", ("", ""), tuple(rows))


def short_names(paths: Sequence[str]) -> list[str]:
    """Names of files, without their folders if they differ without."""
    names = [Path(path).name or path for path in paths]
    return [one_line(name) for name in (names if len(set(names)) == len(names) else paths)]
