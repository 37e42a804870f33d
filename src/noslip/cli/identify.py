"""``noslip identify``: which constraint holds in recordings, and about which point of the tool.

noslip identify runs/*.csv --trim-speed 0.05 --rate 120 --lowpass 4.8 --figure why.png

noslip identify run.bag --topic /tf --child-frame knife --json

noslip identify runs/*.csv --constraint blade
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import cast

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.cli import options, output
from noslip.constraints.catalog import constraint_text
from noslip.constraints.declaration import Constraint
from noslip.constraints.fields import ORIGIN
from noslip.demonstrations.preparation import tool_frame_matrix
from noslip.errors import InputError
from noslip.figures import identified_constraint, save_figure
from noslip.identification import Identified, identify, tool_frame
from noslip.identification.calibration import Rule
from noslip.identification.identified import axis_text, measured

_OF_THE_TOOL = ("lateral", "edge", "axle", "shaft", "bevel")
"""Arguments that are the body axes of a tool: in its own frame they have their defaults."""
VAGUE = 10.0
"""Degrees of a standard error from which a frame's turn is hardly told: a blade turned by so much
slips by a sixth of its way."""


@options.grouped
def run(
    recordings: options.Recordings,
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    figure: options.Figure = None,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Find which constraint the tool of recordings keeps, and about which of its points.

    All recordings are of one tool with one sensor on it.  Says the axes and the point with their
    standard errors, what the motion does not tell, and how much the tool slips, before and after;
    and the options with which check and learn go on.  Exits with 1 if nothing holds.

    With --constraint blade, needle or wheel the tool is known to be that, and the sensor's place on
    it is found.
    """
    options.figure(figure)
    if constraint:
        _place_sensor(recordings, constraint, figure, as_json, given)
        return
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


def _place_sensor(
    recordings: list[str],
    constraint: list[str],
    figure: Path | None,
    as_json: bool,
    given: options.Loading,
) -> None:
    """Tell the frame of a tool of which it is known what it is."""
    if figure is not None:
        raise InputError("--figure: shows why a constraint was found; leave --constraint out")
    if len(constraint) > 1:
        raise InputError("--constraint: identify takes the one that the tool is known to keep")
    (rule,) = options.constraints(constraint)
    demonstrations = given.load(recordings)
    placed = tool_frame(demonstrations, cast("Rule", rule))
    if as_json:
        data = {f.name: np.asarray(getattr(placed, f.name)).tolist() for f in fields(placed)}
        output.print_json(data)
        return
    count = len(demonstrations)
    turned, moved = np.split(np.sqrt(np.maximum(np.diag(placed.covariance), 0.0)), 2)
    place = ", ".join(
        f"{axis} {measured(1e3 * value, 1e3 * error)}"
        for axis, value, error in zip("xyz", placed.matrix[:3, 3], moved, strict=True)
    )
    angle = Rotation.from_matrix(placed.matrix[:3, :3]).magnitude()
    typer.echo(f"{rule.name}, taken as known, in {count} recording{'s' if count > 1 else ''}")
    typer.echo(f"  its point is at {place} mm in the sensor's frame")
    for direction in placed.unknown:
        typer.echo(f"  along {axis_text(direction)} nothing tells where it is")
    turn = measured(np.degrees(angle), np.degrees(turned.max()))
    typer.echo(f"  its frame is turned by {turn} degrees")
    slip, holdout = 100 * placed.slip, 100 * placed.holdout
    typer.echo(f"  slips {slip:.2g} % of its speed; {holdout:.2g} % where it was not fitted")
    if np.degrees(turned.max()) > VAGUE:
        typer.echo(
            "  how it is turned is hardly told: record rolls and plunges too, or measure the frame"
        )
    typer.echo("go on with")
    typer.echo(f"{_frame_option(placed.matrix, given)} {_option(rule)}")


def _frame_option(frame: Floats, given: options.Loading) -> str:
    """``--tool-frame`` of a frame in that in which the recordings were read."""
    before = given.preparation()["tool_frame"]
    frame = frame if before is None else tool_frame_matrix(before) @ frame
    turn = Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True, canonical=True)
    numbers = ",".join(f"{value + 0.0:.9g}" for value in np.round([*frame[:3, 3], *turn], 9))
    return f"--tool-frame {numbers}"


def _to_paste(found: Identified, given: options.Loading) -> list[str]:
    """Options for check and learn: in the recording's frame, and in the tool's own."""
    if not found.constraints:
        return []
    lines = ["go on with", " ".join(map(_option, found.constraints))]
    if found.tool_frame is not None and len(found.constraints) == 1:
        lines += ["or, in the tool's own frame, with"]
        own = _option(_in_its_frame(found.constraints[0]))
        lines += [f"{_frame_option(found.tool_frame, given)} {own}"]
    return lines


def _option(constraint: Constraint) -> str:
    return f'--constraint "{constraint_text(constraint)}"'


def _in_its_frame(constraint: Constraint) -> Constraint:
    """A tool's constraint in the frame of its travel, its lateral axis and its point."""
    axes = {field.name: field.default for field in fields(constraint) if field.name in _OF_THE_TOOL}  # type: ignore[arg-type]
    return replace(constraint, **axes, reference_point=ORIGIN)  # type: ignore[type-var]
