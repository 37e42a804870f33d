"""``noslip demo``: the paper's two experiments, from input to figures.

noslip demo

noslip demo --out results/ --json
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from noslip._files import renewing, write_beside
from noslip._version import __version__
from noslip.cli import options, output
from noslip.constraints.check import residual_text
from noslip.errors import InputError
from noslip.experiments.excision import CONSTRAINT as EXCISION_CONSTRAINT
from noslip.experiments.excision import Excision, Session
from noslip.experiments.numerical_example import CONSTRAINT, NumericalExample
from noslip.figures import (
    blade_snapshots,
    compare_motions,
    demonstration_spread,
    orientation_adjustments,
    recording_cuts,
    save_figure,
)
from noslip.figures.style import write_title
from noslip.merit import FiguresOfMerit
from noslip.trajectory import PoseTrajectory

STAGES = 8 + 1 + 6
"""Excisions, the numerical example and figures: steps of the progress bar."""


def run(
    out: Annotated[
        Path, options.out("the results: a folder, made if missing", default=True)
    ] = Path("noslip-demo"),
    seed: options.Seed = 7,
    as_json: options.AsJson = False,
) -> None:
    """Reproduce the paper's experiments: motions, primitives, figures and a summary.

    The numerical example compares the demonstration, a regular primitive, one constrained at run
    time only, and one with the orientation optimized as well.  The elliptical excision cuts one
    synthetic recording of eight excisions, compares the cuts with the true ones, and runs the
    whole preparation chain on each.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"--out: {out} is a file; give a folder")
    with output.progress("demo", STAGES) as progress:
        example = NumericalExample.run()
        progress(1, STAGES)
        session = Session.run(seed=seed, progress=lambda done, _: progress(1 + done, STAGES))
        summary = _summary(example, session, seed)
        with renewing(out / "summary.json") as last:
            _write_motions(out, example, session)
            figures = _write_figures(out, example, session, progress)
            write_beside(last, (json.dumps(summary, indent=2) + "\n").encode())
    if as_json:
        output.print_json(summary)
        return
    screen = output.console()
    screen.print(_example_table(example))
    screen.print(f"{_session_text(session)}\n", highlight=False)
    screen.print(_excision_table(session.excisions))
    for heading, path in zip(["Figures:", *[""] * len(figures)], figures, strict=False):
        screen.print(f"{heading:12} {path}, .svg")
    screen.print(f"Motions:     {out / 'numerical_example'}/*.csv, {out / 'excision'}/*.csv")
    screen.print(f"Primitives:  {out / 'numerical_example'}/*.json, {out / 'excision'}/*.json")
    screen.print(f"Numbers:     {out / 'summary.json'}")


def _write_motions(out: Path, example: NumericalExample, session: Session) -> None:
    folder = out / "numerical_example"
    for name, motion in example.motions.items():
        motion.to_csv(folder / f"{name}.csv")
    example.primitive.save(folder / "primitive.json")
    folder = out / "excision"
    session.recording.to_csv(folder / "session.csv")
    for number, excision in enumerate(session.excisions, start=1):
        excision.recording.to_csv(folder / f"recording_{number}.csv")
        excision.demonstration.to_csv(folder / f"demonstration_{number}.csv")
        excision.trained.to_csv(folder / f"trained_{number}.csv")
        excision.primitive.save(folder / f"primitive_{number}.json")


def _write_figures(
    out: Path,
    example: NumericalExample,
    session: Session,
    progress: Callable[[int, int], None],
) -> list[Path]:
    motions = example.motions
    demonstrations = [excision.demonstration for excision in session.excisions]
    trained = [excision.trained for excision in session.excisions]
    snapshots = {name: motions[name] for name in ("demonstration", "constrained", "optimized")}
    figures: dict[str, Callable[[], Figure]] = {
        "numerical_example/motions": lambda: compare_motions(motions, [CONSTRAINT], tool=True),
        "numerical_example/snapshots": lambda: blade_snapshots(
            snapshots, desired=example.demonstration
        ),
        "excision/cuts": lambda: recording_cuts(
            session.segments, true=session.cuts, title=_session_text(session)
        ),
        "excision/A_demonstrations": lambda: _synthetic_spread("demonstrated", demonstrations),
        "excision/B_trained": lambda: _synthetic_spread("trained", trained),
        "excision/C_adjustments": lambda: orientation_adjustments(demonstrations, trained),
    }
    written = []
    for done, (name, draw) in enumerate(figures.items(), start=STAGES - len(figures) + 1):
        written += [p for p in save_figure(draw(), out / name) if p.suffix == ".png"]
        progress(done, STAGES)
    return written


def _synthetic_spread(what: str, motions: list[PoseTrajectory]) -> Figure:
    """Spread of motions under a title that says that they are synthetic."""
    figure = demonstration_spread(motions, [EXCISION_CONSTRAINT])
    write_title(figure, f"Synthetic excisions, {what}. {figure.get_suptitle()}")
    return figure


def _session_text(session: Session) -> str:
    """How the recording was cut, beside how it truly should be."""
    pieces, true = len(session.segments.pieces), len(session.cuts)
    text = f"Synthetic session: {len(session.found)} of {true} cuts found"
    if pieces != len(session.found):
        text += f" among {pieces} pieces"
    if not session.found:
        return text
    late, missed = np.abs(session.late).max(), session.missed.max()
    return f"{text}, ends within {late:.2f} s and {missed * 1e3:.2g} mm of the true ones"


def _summary(example: NumericalExample, session: Session, seed: int) -> dict[str, Any]:
    return {
        "noslip": __version__,
        "units": "SI: m, s, rad; residuals in m/s",
        "numerical_example": {name: c.to_dict() for name, c in example.merits.items()},
        "excision": {
            "synthetic": True,
            "seed": seed,
            "session": {
                "cuts": session.cuts.tolist(),
                "intervals": [asdict(interval) for interval in session.segments.intervals],
                "found": [1 + number for number in session.found],
                "late": session.late.tolist(),
                "missed": session.missed.tolist(),
            },
            "trials": [
                {
                    "recording": excision.recording.name,
                    "samples": len(excision.trained),
                    "duration": excision.trained.duration,
                    **excision.merit.to_dict(),
                }
                for excision in session.excisions
            ],
        },
    }


_COLUMNS: list[tuple[str, Any]] = [
    ("slips at most (m/s)", lambda c: residual_text(c.residual_peak, "1", "<")),
    ("position rms (mm)", lambda c: f"{c.position_rms * 1e3:.3f}"),
    ("end (mm)", lambda c: f"{c.end_error * 1e3:.3f}"),
    ("rotation rms (deg)", lambda c: f"{np.degrees(c.rotation_rms):.1f}"),
    ("peak ang. speed (rad/s)", lambda c: f"{c.angular_speed_peak:.1f}"),
    ("peak ang. accel. (rad/s²)", lambda c: f"{c.angular_acceleration_peak:.0f}"),
]
"""Headings, and how the table shows a figure of merit."""


def _example_table(example: NumericalExample) -> Table:
    return _table("Numerical example (against the demonstration)", example.merits)


def _excision_table(excisions: list[Excision]) -> Table:
    rows = {str(number): e.merit for number, e in enumerate(excisions, start=1)}
    return _table("Elliptical excision, synthetic (trained against prepared)", rows)


def _table(title: str, rows: dict[str, FiguresOfMerit]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("")
    for heading, _ in _COLUMNS:
        table.add_column(heading, justify="right")
    for name, merit in rows.items():
        table.add_row(name, *(form(merit) for _, form in _COLUMNS))
    return table
