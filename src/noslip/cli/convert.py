"""``noslip convert``: a recording in one format in, in another out.

noslip convert run.csv

noslip convert tracker.csv --lost drop --gaps interpolate --out run.csv

noslip convert run.bag --topic /tool_pose --out run.csv

noslip convert run.mcap --topic /tf --frame base --child-frame tool --out run.parquet

noslip convert can.hdf5 --episode 3 --out can_3.tum

noslip convert motion.csv --out motion_bag && ros2 bag play motion_bag
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from noslip.cli import options
from noslip.errors import InputError, one_line
from noslip.recordings import write_recording
from noslip.recordings.formats import WRITTEN, listed_suffixes, read_samples


@options.grouped
def run(
    recording: Annotated[
        str, typer.Argument(help="A recording of any format.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        options.optional(
            "FILE",
            f"What to write: {listed_suffixes(WRITTEN)}; several recordings are numbered.",
        ),
    ] = None,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Read a recording of any format and write its poses in another, by suffix.

    Without --out it tells what each column was taken for.  Poses and times stay as recorded,
    unless a step of preparation is asked for.
    """
    if out is None:
        _explain(recording, given)
        return
    if out.suffix.lower() not in WRITTEN:
        raise InputError(f"--out: {out} must end in {listed_suffixes(WRITTEN)}")
    trajectories = given.load([recording])
    named = {} if given.frame is None else {"frame": given.frame}
    for number, trajectory in enumerate(trajectories, start=1):
        several = len(trajectories) > 1
        file = out.with_name(f"{out.stem}_{number:02}{out.suffix}") if several else out
        written = write_recording(trajectory, file, **named)
        typer.echo(f"wrote {written}: {len(trajectory)} samples, {trajectory.duration:.4g} s")


def _explain(recording: str, given: options.Loading) -> None:
    """Tell what is in a recording, and how it was understood."""
    options_of_formats = {
        name: value for name, value in given.loading().items() if name not in options.MENDING
    }
    told = None
    for samples in read_samples(recording, options_of_formats):
        if samples.understood != told:
            for line in samples.understood:
                typer.echo(one_line(f"  {line}"))
            told = samples.understood
    for trajectory in given.load([recording]):
        step = 1e3 * trajectory.period
        typer.echo(
            one_line(
                f"{trajectory.name}: {len(trajectory)} samples, {trajectory.duration:.4g} s, one "
                f"every {step:.4g} ms, path {trajectory.path_length:.4g} m"
            )
        )
