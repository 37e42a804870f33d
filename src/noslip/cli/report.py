"""``noslip report``: all about one primitive in one file.

noslip report excision.json --out report.html

noslip report excision.json recordings/*.csv --out report.html --out report.pdf

noslip report cut.json sensor.csv --tool-frame 0.052,0,0.013 --trim-speed 0.005 --rate 120
--lowpass 4.8 --relative --out cut.pdf
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated

import typer

from noslip.cli import options, output
from noslip.cli.found import is_primitive
from noslip.errors import InputError
from noslip.reporting import report, write_report
from noslip.reporting.document import checked_path
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory


@options.grouped
def run(
    files: Annotated[
        list[str],
        typer.Argument(
            help="A primitive written by noslip learn, and the recordings that it was learned "
            "from, of any format; in any order.",
            show_default=False,
        ),
    ],
    out: Annotated[
        list[Path], options.out("the report: .html or .pdf; repeatable", default=True)
    ] = [Path("noslip-report.html")],  # noqa: B006 - typer's way to say a list's default
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Report what was learned, from what, and how well it holds: one HTML file, or PDF.

    The recordings are those that it was learned from, prepared with the options of noslip learn.
    It tells the files and their hashes, the constraints as they were declared, residuals before and
    after, figures of merit, settings and versions, shows the figures there are, and ends with the
    commands that make it again.  Nothing in it refers to anything outside.
    """
    for path in out:
        checked_path(options.output(path) or path)
    primitive = _one_primitive(files)
    recordings = [name for name in files if name != primitive]
    options.require_poses("report", primitive, load_primitive(primitive).law.space)
    demonstrations: list[PoseTrajectory] = []
    if recordings:
        demonstrations = given.load(recordings)
    # One word each: a value may begin with a minus.
    chosen = {o.name: v for o in fields(given) if (v := getattr(given, o.name)) != o.default}
    preparation = [
        f"--{name.replace('_', '-')}={str(value).removesuffix('.0')}"
        for name, value in chosen.items()
        if value is not None and name not in ("episode", "relative")
    ]
    preparation += [f"--episode={number}" for number in given.episode]
    preparation += ["--relative"] if given.relative else []
    with output.progress("drawing", 1) as progress:
        found = report(primitive, demonstrations, preparation=preparation, progress=progress)
        written = write_report(found, out)
    for warning in found.warnings:
        typer.echo(f"noslip: warning: {warning}", err=True)
    if as_json:
        output.print_json(
            {
                "title": found.title,
                "warnings": list(found.warnings),
                "written": [str(path) for path in written],
            }
        )
        return
    typer.echo(found.title)
    for path in written:
        typer.echo(f"wrote {path}")


def _one_primitive(files: list[str]) -> str:
    """Return the primitive among files; where none is called so, the first must be it."""
    primitives = [name for name in files if is_primitive(name)]
    if len(primitives) > 1:
        raise InputError(
            f"a report is about one primitive, got {', '.join(primitives)}; report each alone"
        )
    return (primitives or files)[0]
