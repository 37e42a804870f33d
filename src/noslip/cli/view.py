"""``noslip view``: a page in the browser on which motions are looked at, dragged and pushed.

noslip view excision.json

noslip view runs/*.csv --constraint blade --lowpass 4.8

noslip view demonstration.csv excision.json --out scene.html

noslip simulate excision.json --out arm/ && noslip view arm/ excision.json

ssh -L 8080:localhost:8080 robot noslip view excision.json --no-open
"""

from __future__ import annotations

import time
import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from noslip.cli import options, output
from noslip.cli.found import is_primitive, is_simulated
from noslip.errors import InputError
from noslip.saving import load_primitive


@options.grouped
def run(
    motions: options.Motions,
    constraint: options.Constraints = [],  # noqa: B006 - typer's way to say none
    tool_mesh: Annotated[
        Path | None,
        options.optional(
            "FILE", "The tool's mesh, in its own frame: .stl, .obj or .glb; by default a scalpel."
        ),
    ] = None,
    tool_scale: Annotated[
        float,
        typer.Option(metavar="M", help="Meters per unit of the mesh: 0.001 for millimeters."),
    ] = 1.0,
    out: Annotated[
        Path | None,
        options.out(
            "the scene as one HTML file that plays without Python; no page is served",
            also="--save",
        ),
    ] = None,
    host: Annotated[
        str,
        typer.Option(help="Address to serve on; 0.0.0.0 lets in who has the page's address."),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="If it is taken, the next free one.")
    ] = 8080,
    open_browser: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
    as_json: options.AsJson = False,
    given: options.Loading = options.Loading(),  # noqa: B008 - immutable
) -> None:
    """Look at motions in the browser: tool, path, slip, forces, surfaces and keep-out zones.

    A primitive's goal and start can be dragged; its adapted motion follows.  While it runs, the
    tool can be pushed, and comes back.  What holds in a recording is found and drawn, and a
    shielded tool follows a dragged command.  Files dropped onto the page are checked.  Simulated
    arms move along.

    Ends with Ctrl-C.
    """
    if out is not None and options.output(out) and out.suffix != ".html":
        raise InputError(f"--out: {out} must end in .html")
    held = options.constraints(constraint)
    simulated = [name for name in motions if is_simulated(name)]
    primitives = [name for name in motions if is_primitive(name)]
    recordings = [name for name in motions if name not in {*simulated, *primitives}]
    shown: dict[str, Any] = {}
    if recordings:
        for trajectory in given.load(recordings):
            shown[trajectory.name] = trajectory
    for name in primitives:
        shown[name] = load_primitive(name)

    # Only now: without a page to show, nobody needs viser.
    from noslip.viewer import Page, load_tool, read_simulation, save_page

    shown |= {str(Path(name)): read_simulation(name) for name in simulated}
    parts = None if tool_mesh is None else load_tool(tool_mesh, scale=tool_scale)
    if out is not None:
        path = save_page(out, shown, constraints=held, tool=parts)
        size = path.stat().st_size
        if as_json:
            output.print_json({"written": [str(path)], "bytes": size})
        else:
            typer.echo(f"wrote {path}: {size / 1e6:.1f} MB")
        return
    page = Page(shown, constraints=held, tool=parts, host=host, port=port)
    try:
        if as_json:
            output.print_json({"address": page.address})
        else:
            typer.echo(f"{page.address}  (Ctrl-C ends)")
        if open_browser:
            webbrowser.open(page.address)
        while True:
            time.sleep(3600)
    finally:
        page.stop()
