"""``noslip learn --each``: a primitive from each of many recordings, and one table of them all."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer

from noslip.cli import output
from noslip.constraints.check import residual_text
from noslip.constraints.declaration import Constraint
from noslip.errors import InputError, one_line
from noslip.many import LearnedEach, cluster, find_recordings, learn_each


def run(
    recordings: list[str],
    constraints: list[Constraint],
    *,
    out: Path,
    table: Path | None,
    jobs: int,
    address: str | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Learn, tell what failed, and exit with 1 if anything did."""
    if address is not None and jobs > 1:
        raise InputError("--jobs: processes of this machine; with --cluster leave it out")
    # Told before a cluster is waited for.
    total = len(find_recordings(recordings))
    with ExitStack() as stack:
        executor = None if address is None else stack.enter_context(cluster(address))
        learned = learn_each(
            recordings,
            constraints,
            out=out,
            table=table,
            jobs=jobs,
            executor=executor,
            progress=stack.enter_context(output.progress("learning", total)),
            **settings,
        )
    if as_json:
        output.print_json(
            {
                "folder": str(out),
                "table": str(learned.table),
                "kept": learned.kept,
                "failed": len(learned.failed),
                "recordings": [asdict(result) for result in learned.results],
            }
        )
    else:
        _print_summary(learned, out, constraints)
    if learned.failed:
        raise typer.Exit(1)


def _print_summary(learned: LearnedEach, out: Path, constraints: Sequence[Constraint]) -> None:
    failed, total = len(learned.failed), len(learned.results)
    kept = f", {learned.kept} of them before" if learned.kept else ""
    typer.echo(f"learned {total - failed} of {total} recordings{kept}")
    motions = [result for result in learned.results if result.residual_peak is not None]
    if motions and any(constraint.relation == "zero" for constraint in constraints):
        worst = max(motions, key=lambda result: result.residual_peak or 0.0)
        peak = residual_text(worst.residual_peak or 0.0, "1", order="at most")
        typer.echo(f"residual of their motions: {peak} ({one_line(worst.name)})")
    loose = [result.name for result in motions if not result.holds]
    if loose:
        some = one_line(", ".join(loose[:5]))
        typer.echo(f"{len(loose)} violate a constraint or limit: {some}")
    for result in learned.failed:
        # Most messages begin with the file.
        where = "" if result.message.startswith(result.recording) else f"{result.recording}: "
        typer.echo(one_line(f"FAILED {where}{result.message}"))
    typer.echo(f"wrote {out} and {learned.table}")
