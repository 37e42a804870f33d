"""``noslip convert``: a recording in one format in, in another out.

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
from noslip.errors import InputError
from noslip.recordings import load_demonstrations, write_recording
from noslip.recordings.formats import WRITTEN, listed_suffixes


@options.grouped
def run(
    recording: Annotated[
        str, typer.Argument(help="A recording of any format.", show_default=False)
    ],
    out: Annotated[
        Path,
        options.optional("FILE", f"What to write: {listed_suffixes(WRITTEN)}."),
    ],
    given: options.Where = options.Where(),  # noqa: B008 - immutable
) -> None:
    """Read a recording of any format and write its poses in another, by suffix.

    Poses and times stay as recorded.  Of a data set choose one episode.
    """
    if out.suffix.lower() not in WRITTEN:
        raise InputError(f"--out: {out} must end in {listed_suffixes(WRITTEN)}")
    trajectories = load_demonstrations(recording, **given.loading())
    if len(trajectories) > 1:
        raise InputError(
            f"{recording}: {len(trajectories)} recordings for one file; choose one (--episode)"
        )
    (trajectory,) = trajectories
    named = {} if given.frame is None else {"frame": given.frame}
    written = write_recording(trajectory, out, **named)
    typer.echo(f"wrote {written}: {len(trajectory)} samples, {trajectory.duration:.4g} s")
