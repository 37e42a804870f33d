"""A report of one primitive: what was learned from what, how it holds, how to make it again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from noslip.constraints.check import check
from noslip.errors import one_line
from noslip.figures.quantities import value_text
from noslip.figures.residuals import finding, residual_rows
from noslip.figures.style import number
from noslip.primitive import ConstrainedDMP
from noslip.reporting.commands import commands
from noslip.reporting.pictures import pictures
from noslip.reporting.tables import (
    constraints_tables,
    files_table,
    merits_table,
    recordings_tables,
    settings_table,
    short_names,
)
from noslip.reporting.values import Report
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory

APART = 0.01
"""Share of the path that a primitive may start or end from its recordings without a warning: beyond
what fitting leaves."""


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
        replace(d, name=name) for d, name in zip(demonstrations, short_names(sources), strict=True)
    ]
    motion, regular = dmp.rollout(), dmp.regular.rollout()
    motions: dict[str, PoseTrajectory] = {"regular": regular, "optimized": motion}
    if shown:
        motions = {"demonstration": _worst(shown, dmp), **motions}
    verdict = check(motion, dmp.constraints) if dmp.constraints else None

    files = [str(primitive), *(name for name in sources if Path(name).is_file())]
    names = [record.demonstration for record in dmp.record]
    # The first sentence, and what it goes on with.
    title, _, rest = _title(motions, dmp).partition(".  ")
    tables = [
        *constraints_tables(dmp, shown, regular, verdict),
        merits_table(dmp, motions),
        *recordings_tables(dmp, shown, motion),
    ]
    return Report(
        title=title,
        primitive=one_line(Path(primitive).name),
        lead=" ".join(filter(None, [f"{rest}." if rest else "", _lead(dmp, shown)])),
        verdict="" if verdict is None else verdict.verdict,
        holds=verdict is None or verdict.satisfied,
        warnings=tuple(_mismatches(dmp, shown)),
        tables=tuple(tables),
        provenance=(settings_table(dmp), files_table(files)),
        pictures=tuple(pictures(dmp, shown, motions, motion, progress)),
        commands=tuple(
            one_line(line) for line in commands(dmp, str(primitive), sources or names, preparation)
        ),
    )


def _title(motions: Mapping[str, PoseTrajectory], dmp: ConstrainedDMP) -> str:
    motion = motions["optimized"]
    if not dmp.constraints:
        path, duration = value_text(motion.path_length, "m"), number(motion.duration)
        return f"A path of {path} in {duration} s, learned without constraints"
    first = next(iter(motions))
    pair = {first: motions[first], "learned motion": motion}
    # Figures escape what their formulas begin with.
    return one_line(finding(residual_rows(pair, dmp.system), pair).replace(r"\$", "$"))


def _lead(dmp: ConstrainedDMP, demonstrations: Sequence[PoseTrajectory]) -> str:
    count = dmp.spread.demonstrations if dmp.spread else max(len(dmp.record), 1)
    under = ", ".join(one_line(name) for name in dmp.system.names) or "no constraint"
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
        learned = one_line(record.demonstration)
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
                f"the primitive {what} {value_text(off, 'm')} from where the recordings do; give "
                "the options with which they were prepared (or it was adapted since)"
            )


def _worst(demonstrations: Sequence[PoseTrajectory], dmp: ConstrainedDMP) -> PoseTrajectory:
    """Return the demonstration that violates the constraints most; the first, if none."""
    if not dmp.constraints:
        return demonstrations[0]
    return max(demonstrations, key=lambda d: check(d, dmp.constraints).peak)
