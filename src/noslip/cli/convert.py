"""``noslip convert``: a recording in one format in, in another out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from noslip.cli import options
from noslip.demonstrations.loading import load_demonstrations
from noslip.errors import InputError
from noslip.recordings.writing import WRITABLE, WRITABLE_TOLD, write_recording

NAME = "convert"
EXAMPLES = """
Examples:

  noslip convert run.bag --topic /tool_pose --out run.csv

  noslip convert run.mcap --topic /tf --frame base --child-frame tool --out run.parquet

  noslip convert can.hdf5 --episode 3 --out can_3.tum

  noslip convert motion.csv --out motion_bag && ros2 bag play motion_bag
"""


def run(
    recording: Annotated[
        str, typer.Argument(help="A recording of any format.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            help=f"What to write: {WRITABLE_TOLD}.",
            show_default=False,
        ),
    ],
    sample_rate: options.SampleRate = None,
    topic: options.Topic = None,
    frame: options.Frame = None,
    child_frame: options.ChildFrame = None,
    episode: options.Episode = [],  # noqa: B006 - typer's way to say none
    columns: options.Columns = None,
) -> None:
    """Read a recording of any format and write its poses in another, by suffix.

    Poses and times stay as recorded.  Of a data set choose one episode.
    """
    if out.suffix.lower() not in WRITABLE:
        raise InputError(f"--out: {out} must end in {WRITABLE_TOLD}")
    trajectories = load_demonstrations(
        recording,
        rate=sample_rate,
        topic=topic,
        frame=frame,
        child_frame=child_frame,
        episode=episode or None,
        columns=columns,
    )
    if len(trajectories) > 1:
        raise InputError(
            f"{recording}: {len(trajectories)} recordings for one file; choose one (--episode)"
        )
    (trajectory,) = trajectories
    written = write_recording(trajectory, out, **({} if frame is None else {"frame": frame}))
    typer.echo(f"wrote {written}: {len(trajectory)} samples, {trajectory.duration:.4g} s")
