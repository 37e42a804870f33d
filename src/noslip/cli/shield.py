"""``noslip shield``: recordings and data sets that keep a constraint.

noslip shield run.csv --constraint blade --rate 120 --lowpass 4.8 --out kept.csv

noslip shield runs/*.csv --each --constraint blade --out kept/

noslip shield my_lerobot_set --each --constraint "blade(lateral='y')" --columns
"observation.state[0:6]" --rotation rotvec --out my_lerobot_set_kept

noslip shield can.hdf5 --each --constraint blade --out can_kept.hdf5
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from noslip.cli import options, output
from noslip.constraints.check import residual_text
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError, one_line
from noslip.recordings import write_recording
from noslip.shielding.datasets import ShieldedRecording, shield_each, shielded, told


@options.grouped
def run(
    recordings: options.Recordings,
    constraint: options.Constraints,
    out: Annotated[
        Path,
        options.out(
            "what is kept: a file; with --each a folder of files, or a copy of the data set"
        ),
    ],
    each: options.Each = False,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Write the motion nearest to each recording that keeps the constraints.

    It tells how far it moved each, and what that slips before and after.

    In the copy of a data set the poses alone are others, in the columns that they were read from,
    and what its meta says of these; gripper, images, actions and episodes stay.  Exits with 1 if
    in a recording the tool must hold, since no way near it keeps the constraints.
    """
    system = ConstraintSystem(options.constraints(constraint))
    if each:
        with output.progress("shielding", 1) as progress:
            rows = shield_each(
                recordings,
                system,
                out,
                preparation=given.preparation(),
                progress=progress,
                **given.loading(),
            )
    else:
        options.output(out)
        found = given.load(recordings)
        if len(found) > 1:
            raise InputError(
                f"{len(found)} recordings; add --each, and as --out a folder or, of a data set, "
                "the copy"
            )
        motion, held = shielded(found[0], system)
        write_recording(motion, out)
        rows = [told(found[0], motion, system, held)]
    if as_json:
        output.print_json({"out": str(out), "recordings": [row.to_dict() for row in rows]})
    else:
        for row in rows:
            typer.echo(one_line(_line(row)))
        typer.echo(f"wrote {out}")
    if any(row.held for row in rows):
        raise typer.Exit(1)


def _line(row: ShieldedRecording) -> str:
    """Say what became of one recording."""
    before, after = (
        residual_text(residual, "1") if slip is None else f"slips {residual_text(slip, 'm')}"
        for slip, residual in (
            (row.slip_before, row.residual_before),
            (row.slip_after, row.residual_after),
        )
    )
    held = "HELD " if row.held else ""
    return (
        f"{held}{row.name}: moved {1e3 * row.moved_mean:.3g} mm (at most "
        f"{1e3 * row.moved_max:.3g}), turned {np.degrees(row.turned_mean):.3g} degrees (at most "
        f"{np.degrees(row.turned_max):.3g}); {before} before, {after} after"
    )
