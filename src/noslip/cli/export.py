"""``noslip export``: a primitive in, C99 for a robot out.

noslip export excision.json --out excision_c

cd excision_c && cc -std=c99 -O2 noslip.c excision.c example.c -lm -o example

cmake -S excision_c -B build && cmake --build build && ctest --test-dir build
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from noslip.cli import options, output
from noslip.saving import load_primitive


def run(
    primitive: Annotated[
        Path, typer.Argument(help="A primitive written by noslip learn.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write the C files.")],
    name: Annotated[
        str | None,
        options.optional("NAME", "Of the primitive in C; by default the file's."),
    ] = None,
    prefix: Annotated[
        str,
        typer.Option(metavar="NAME", help="Of all other names, so that two exports can be linked."),
    ] = "noslip",
    as_json: options.AsJson = False,
) -> None:
    """Write a primitive as C99: no heap, nothing but libm, one state struct, numbers as data.

    The constraints and limits are in the code (noslip.c), everything that was learned is data
    (NAME.c): another primitive under the same constraints needs another NAME.c only.  With a C
    compiler and valgrind at hand the most instructions of a step are counted and told in noslip.h.
    """
    dmp = load_primitive(primitive)
    chosen = name if name is not None else re.sub(r"\W", "_", primitive.stem)
    exported = dmp.export_c(out, name=chosen, prefix=prefix)
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
