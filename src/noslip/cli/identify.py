"""``noslip identify``: which constraint holds in recordings, and about which point of the tool.

noslip identify runs/*.csv --trim-speed 0.05 --rate 120 --lowpass 4.8 --figure why.png

noslip identify run.bag --topic /tf --child-frame knife --json
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from noslip.cli import options, output
from noslip.constraints.catalog import constraint_text
from noslip.constraints.declaration import Constraint
from noslip.constraints.fields import ORIGIN
from noslip.demonstrations.preparation import tool_frame_matrix
from noslip.figures import identified_constraint, save_figure
from noslip.identification import Identified, identify

_OF_THE_TOOL = ("lateral", "edge", "axle", "shaft", "bevel")
"""Arguments that are the body axes of a tool: in its own frame they have their defaults."""


@options.grouped
def run(
    recordings: options.Recordings,
    figure: options.Figure = None,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Find which constraint the tool of recordings keeps, and about which of its points.

    All recordings are of one tool with one sensor on it.  Says the axes and the point with their
    standard errors, what the motion does not tell, and how much the tool slips, before and after;
    and the options with which check and learn go on.  Exits with 1 if nothing holds.
    """
    options.figure(figure)
    found = identify(given.load(recordings))
    if figure is not None:
        save_figure(identified_constraint(found), figure)
    if as_json:
        output.print_json(found.to_dict())
    else:
        typer.echo(str(found))
        for line in _to_paste(found, given):
            typer.echo(line)
    if not found.constraints:
        raise typer.Exit(1)


def _to_paste(found: Identified, given: options.Loading) -> list[str]:
    """Options for check and learn: in the recording's frame, and in the tool's own."""
    if not found.constraints:
        return []
    lines = ["go on with", " ".join(map(_option, found.constraints))]
    if found.tool_frame is not None and len(found.constraints) == 1:
        before = given.preparation()["tool_frame"]
        frame = found.tool_frame if before is None else tool_frame_matrix(before) @ found.tool_frame
        turn = Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True, canonical=True)
        numbers = ",".join(f"{value + 0.0:.9g}" for value in np.round([*frame[:3, 3], *turn], 9))
        lines += ["or, in the tool's own frame, with"]
        lines += [f"--tool-frame {numbers} {_option(_in_its_frame(found.constraints[0]))}"]
    return lines


def _option(constraint: Constraint) -> str:
    return f'--constraint "{constraint_text(constraint)}"'


def _in_its_frame(constraint: Constraint) -> Constraint:
    """A tool's constraint in the frame of its travel, its lateral axis and its point."""
    axes = {field.name: field.default for field in fields(constraint) if field.name in _OF_THE_TOOL}  # type: ignore[arg-type]
    return replace(constraint, **axes, reference_point=ORIGIN)  # type: ignore[type-var]
