"""``noslip plot``: look at motions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from noslip.cli import options
from noslip.errors import InputError
from noslip.figures import compare_motions, save_figure
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory

NAME = "plot"
FORMATS = (".png", ".svg", ".pdf")
EXAMPLES = """
Examples:

  noslip plot recording.csv --constraint blade --out recording.png

  noslip plot demonstration.csv excision.json --constraint blade --out comparison.svg

  noslip plot runs/*.csv --constraint blade --rate 120 --lowpass 4.8 --out runs.pdf
"""


def run(
    motions: Annotated[
        list[str],
        typer.Argument(
            help="Recordings (CSV, npz), and primitives (JSON), which are rolled out.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Figure to write: .png, .svg or .pdf.")
    ] = Path("noslip-plot.png"),
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    title: Annotated[
        str | None, typer.Option(help="By default, what the data show.", show_default=False)
    ] = None,
    sample_rate: options.SampleRate = None,
    tool_frame: options.ToolFrame = None,
    trim_time: options.TrimTime = None,
    trim_speed: options.TrimSpeed = None,
    rate: options.Rate = None,
    lowpass: options.Lowpass = None,
    relative: options.Relative = False,
) -> None:
    """Draw motions: position, orientation, path, and how well constraints hold over time.

    Without --constraint the constraints of the primitives among the motions are shown.
    """
    options.output(out)
    if out.suffix not in FORMATS:
        raise InputError(f"--out: {out} must end in {', '.join(FORMATS)}")
    held = options.constraints(constraint)
    recordings = [name for name in motions if not name.endswith(".json")]
    shown: dict[str, PoseTrajectory] = {}
    if recordings:
        for trajectory in options.load(
            recordings,
            sample_rate=sample_rate,
            tool_frame=tool_frame,
            trim_time=trim_time,
            trim_speed=trim_speed,
            rate=rate,
            lowpass=lowpass,
            relative=relative,
        ):
            shown[_label(trajectory.name, shown)] = trajectory
    for name in motions:
        if name.endswith(".json"):
            primitive = load_primitive(name)
            shown[_label(name, shown)] = primitive.rollout()
            if not constraint:
                held = [*held, *(c for c in primitive.constraints if c not in held)]
    for path in save_figure(compare_motions(shown, held, title=title), out):
        typer.echo(f"wrote {path}")


def _label(name: str, taken: dict[str, PoseTrajectory]) -> str:
    """Short name of a file, longer where two would be the same."""
    short = Path(name).stem
    return short if short not in taken else name
