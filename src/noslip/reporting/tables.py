"""The tables of a report: files, recordings, constraints, figures of merit, settings."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from noslip._version import __version__
from noslip.comparison import compare
from noslip.constraints.check import TOLERANCE, CheckReport, ConstraintCheck, check
from noslip.errors import InputError
from noslip.figures.family import end_errors
from noslip.figures.quantities import amount
from noslip.figures.style import number
from noslip.learning import ConstrainedDMP
from noslip.primitives.pose import Motion
from noslip.reporting.commands import declaration
from noslip.reporting.values import Cell, Table, Value, angle, count, plain, printable, quantity
from noslip.trajectory import PoseTrajectory

PACKAGES = ("numpy", "scipy", "casadi")


def files_table(files: Iterable[str]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for file in files:
        try:
            content = Path(file).read_bytes()
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror}") from error
        size = Value(len(content), f"{len(content):,}".replace(",", " "))
        rows.append((printable(file), size, hashlib.sha256(content).hexdigest()))
    return Table("Files", ("file", "bytes", "SHA-256"), tuple(rows))


def recordings_tables(
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
                    count(len(given)),
                    quantity(given.duration, "s"),
                    quantity(given.path_length, "m"),
                    quantity(merits.position_rms, "m"),
                    quantity(merits.position_end, "m"),
                    angle(merits.rotation_rms),
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
                        count(record.samples),
                        count(record.iterations),
                        plain(record.residual),
                        quantity(record.position_change, "m"),
                        angle(record.rotation_change),
                        printable(", ".join(record.left_out)) or "nothing",
                    )
                    for name, record in zip(
                        short_names([r.demonstration for r in dmp.record]), dmp.record, strict=True
                    )
                ),
                "Each recording is projected onto the constraints before the primitive is fitted.  "
                "Residual: the largest afterwards, in the constraints' units (SI); moved and "
                "turned: by the projection, rms; left out: limits that hold at run time alone.",
            )
        )
    return tables


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
        return quantity(result.peak, result.unit)
    return Value(result.margin, f"margin {amount(result.margin, result.unit)}")


def merits_table(dmp: ConstrainedDMP, motions: Mapping[str, PoseTrajectory]) -> Table:
    """Figures of merit, a row each, a column a motion."""
    (against, reference), *_ = motions.items()
    units = set(dmp.system.equalities.row_units)
    unit = units.pop() if len(units) == 1 else "(SI)"
    goal = (dmp.position.goal, dmp.orientation.goal)
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
            forces = [quantity(peaks[0], "m/s²"), quantity(peaks[1], "rad/s²")]
        residuals = [quantity(r, unit) for r in (merits.residual_peak, merits.residual_rms)]
        columns.append(
            (
                *(residuals if dmp.system.equalities.size else ()),
                quantity(merits.position_rms, "m"),
                angle(merits.rotation_rms),
                angle(merits.rotation_peak),
                quantity(off, "m"),
                angle(turned),
                quantity(float(speeds.max()), "m/s"),
                quantity(merits.angular_speed_peak, "rad/s"),
                quantity(merits.angular_acceleration_peak, "rad/s²"),
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


def settings_table(dmp: ConstrainedDMP) -> Table:
    step = dmp.duration / dmp.steps
    rows: list[tuple[Cell, ...]] = [
        ("duration τ", quantity(dmp.duration, "s")),
        ("steps", count(dmp.steps)),
        ("time step", Value(step, f"{number(1e3 * step)} ms")),
        ("basis functions", count(dmp.position.forcing.basis.count)),
        ("attractor α, β", f"{dmp.position.attractor.alpha:g}, {dmp.position.attractor.beta:g}"),
        ("phase α_s", plain(dmp.phase.alpha_s)),
        ("inverse metric, diagonal of M⁻¹", ", ".join(map(number, dmp.inverse_metric))),
        ("stabilization, per duration", plain(dmp.stabilization)),
        ("barrier rate, per duration", plain(dmp.barrier_rate)),
    ]
    smoothing = sorted({record.smoothing for record in dmp.record})
    if smoothing:
        rows.append(("rotation smoothing", ", ".join(map(number, smoothing))))
    rows += [("noslip", __version__), ("Python", platform.python_version())]
    rows += [(package, version(package)) for package in PACKAGES]
    return Table("Settings and versions", ("", ""), tuple(rows))


def short_names(paths: Sequence[str]) -> list[str]:
    """Names of files, without their folders if they differ without."""
    names = [Path(path).name or path for path in paths]
    return [printable(name) for name in (names if len(set(names)) == len(names) else paths)]
