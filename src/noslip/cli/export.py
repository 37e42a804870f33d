"""``noslip export``: a primitive in, or constraints; C99 for a robot out.

noslip export excision.json --out excision_c

cd excision_c && cc -std=c99 -O2 noslip.c excision.c example.c -lm -o example

cmake -S excision_c -B build && cmake --build build && ctest --test-dir build

noslip export --shield --constraint blade --loop-rate 1000 --out shield_c
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from noslip.cli import options, output
from noslip.errors import InputError
from noslip.exporting import Exported
from noslip.saving import load_primitive
from noslip.shielding import Shield

_SHIELD = "A shield for streams, of constraints alone"
"""Heading of these options in the help."""


def run(
    out: Annotated[Path, options.out("the C files: a folder, made if missing")],
    primitive: options.OptionalPrimitive = None,
    name: Annotated[
        str | None,
        options.optional("NAME", "Of the primitive in C; by default the file's."),
    ] = None,
    prefix: Annotated[
        str,
        typer.Option(metavar="NAME", help="Of all other names, so that two exports can be linked."),
    ] = "noslip",
    shield: Annotated[
        bool,
        typer.Option(
            "--shield",
            help="Instead of a primitive, what keeps a stream of commands within --constraint.",
            rich_help_panel=_SHIELD,
        ),
    ] = False,
    constraint: options.Constraints = [],  # noqa: B006 - read only
    loop_rate: Annotated[
        float | None, options.optional("HZ", "Of the robot's loop.", _SHIELD)
    ] = None,
    metric: options.WhoGivesWay = "auto",
    as_json: options.AsJson = False,
) -> None:
    """Write a primitive as C99: no heap, nothing but libm, one state struct, numbers as data.

    The constraints and limits are in the code (noslip.c), everything that was learned is data
    (NAME.c): another primitive under the same constraints needs another NAME.c only.  With a C
    compiler and valgrind at hand the most instructions of a step are counted and told in noslip.h.

    With --shield it takes no primitive, but --constraint and --loop-rate: shield.c follows a stream
    of commands and keeps the constraints.
    """
    exported = (
        _stream(primitive, name, constraint, loop_rate, metric).export_c(out, prefix=prefix)
        if shield
        else _primitive(primitive, name, prefix, out, bool(constraint) or loop_rate is not None)
    )
    if as_json:
        output.print_json(
            {
                "files": [str(file) for file in exported.files],
                "instructions": exported.instructions,
            }
        )
        return
    for file in exported.files:
        typer.echo(f"wrote {file}")
    if exported.instructions is None:
        typer.echo("instructions a step: not counted (that takes a C compiler and valgrind)")
    else:
        typer.echo(f"instructions a step: at most {exported.instructions}")


def _primitive(
    file: Path | None, name: str | None, prefix: str, out: Path, has_more: bool
) -> Exported:
    if file is None:
        raise InputError("give a primitive, or --shield with --constraint and --loop-rate")
    if has_more:
        raise InputError("--constraint and --loop-rate are for --shield; a primitive has its own")
    chosen = name if name is not None else re.sub(r"\W", "_", file.stem)
    return load_primitive(file).export_c(out, name=chosen, prefix=prefix)


def _stream(
    file: Path | None, name: str | None, constraint: list[str], rate: float | None, metric: str
) -> Shield:
    if file is not None or name is not None:
        raise InputError("--shield takes no primitive and no --name; give one or the other")
    if not constraint or rate is None:
        raise InputError("--shield takes what must hold (--constraint) and --loop-rate in Hz")
    return Shield(options.constraints(constraint), rate=rate, metric=options.metric(metric))
