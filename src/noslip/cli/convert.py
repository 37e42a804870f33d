"""``noslip convert``: a recording in one format in, in another out.

noslip convert run.csv

noslip convert tracker.csv --lost drop --gaps interpolate --out run.csv

noslip convert run.bag --topic /tool_pose --out run.csv

noslip convert run.mcap --topic /tf --frame base --child-frame tool --out run.parquet

noslip convert can.hdf5 --episode 3 --out can_3.tum

noslip convert motion.csv --out motion_bag && ros2 bag play motion_bag
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from noslip._samples import Mending
from noslip.cli import options, output
from noslip.demonstrations.preparation import prepare
from noslip.errors import InputError, one_line
from noslip.recordings import write_recording
from noslip.recordings.formats import WRITTEN, listed_suffixes, loaded

_PLANAR = (".csv", ".parquet", ".feather")
"""Formats that have columns."""


@options.grouped
def run(
    recording: options.Recording,
    out: Annotated[
        Path | None,
        options.out(f"the poses: {listed_suffixes(WRITTEN)}; several recordings are numbered"),
    ] = None,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
    written: options.Writing = options.Writing(),  # noqa: B008 - immutable
) -> None:
    """Read a recording of any format and write its poses in another, by suffix.

    Without --out it tells what each column was taken for.  Poses and times stay as recorded,
    unless a step of preparation is asked for; what was planar is written as t,x,y,theta where the
    format has columns.
    """
    if out is not None and out.suffix.lower() not in WRITTEN:
        raise InputError(f"--out: {out} must end in {listed_suffixes(WRITTEN)}")
    asked = given.loading()
    mending = Mending(**{name: asked.pop(name) for name in options.MENDING})
    found = list(loaded(recording, asked, mending))
    told: Sequence[str] = ()
    results: list[dict[str, Any]] = []
    for number, (samples, read) in enumerate(found, start=1):
        if out is None and not as_json and samples.understood != told:
            for line in samples.understood:
                typer.echo(one_line(f"  {line}"))
            told = samples.understood
        trajectory = prepare(read, **given.preparation())
        size = f"{len(trajectory)} samples, {trajectory.duration:.4g} s"
        results.append(
            {
                "recording": trajectory.name,
                "samples": len(trajectory),
                "duration": trajectory.duration,
                "period": trajectory.period,
                "path_length": trajectory.path_length,
                "understood": list(samples.understood),
                "written": None,
            }
        )
        if out is None and as_json:
            continue
        if out is None:
            step = f"one every {1e3 * trajectory.period:.4g} ms"
            path = f"path {trajectory.path_length:.4g} m"
            typer.echo(one_line(f"{trajectory.name}: {size}, {step}, {path}"))
            continue
        what = written.writing()
        if out.suffix.lower() in _PLANAR and samples.planar:
            what["planar"] = True
        if given.frame is not None:
            what["frame"] = given.frame
        several = len(found) > 1
        file = out.with_name(f"{out.stem}_{number:02}{out.suffix}") if several else out
        results[-1]["written"] = str(write_recording(trajectory, file, **what))
        if not as_json:
            typer.echo(f"wrote {results[-1]['written']}: {size}")
    if as_json:
        output.print_json(results)
