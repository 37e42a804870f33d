"""``noslip docs``: the pages of the documentation, as this installation has them.

noslip docs

noslip docs recordings

noslip docs constraints/blade | less
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markdown import Markdown

from noslip.cli import options, output
from noslip.errors import InputError, did_you_mean


def run(
    page: Annotated[
        str | None,
        typer.Argument(help="By its name, such as recordings; without, all.", show_default=False),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Read a page of the documentation; without a name, list them.

    Error messages name pages so.  On a terminal the page is laid out, in a pipe it is Markdown.
    """
    pages = _pages()
    if page is None:
        titles = {name: _title(path) for name, path in pages.items()}
        if as_json:
            output.print_json(titles)
            return
        width = max(map(len, titles))
        for name, title in titles.items():
            typer.echo(f"{name:<{width}}  {title}")
        return
    name = _found(page, pages)
    text = pages[name].read_text("utf-8")
    if as_json:
        output.print_json(
            {"page": name, "title": _title(pages[name]), "file": str(pages[name]), "text": text}
        )
        return
    screen = output.console()
    if screen.is_terminal:
        screen.print(Markdown(text))
    else:
        typer.echo(text, nl=False)


def _pages() -> dict[str, Path]:
    """Pages by name: in the package as installed, else beside its source."""
    package = Path(__file__).parents[1]
    for folder in (package / "pages", package.parents[1] / "docs"):
        files = sorted(folder.rglob("*.md"))
        if files:
            return {_name(file.relative_to(folder)): file for file in files}
    raise InputError("this installation has no pages; install noslip from a wheel")


def _name(path: Path) -> str:
    """``constraints/blade`` of constraints/blade.md, ``constraints`` of constraints/index.md."""
    bare = path.with_suffix("")
    return (bare.parent if bare.name == "index" and len(bare.parts) > 1 else bare).as_posix()


def _title(page: Path) -> str:
    lines = page.read_text("utf-8").splitlines()
    return next((line.lstrip("# ") for line in lines if line.startswith("# ")), page.stem)


def _found(asked: str, pages: dict[str, Path]) -> str:
    """The page of a name; its last part does where no other has it."""
    name = asked.removeprefix("docs/").removesuffix(".md").strip("/")
    if name in pages:
        return name
    ends = [page for page in pages if page.rpartition("/")[2] == name]
    if len(ends) == 1:
        return ends[0]
    short = {page.rpartition("/")[2]: page for page in pages}
    hint = did_you_mean(name, [*pages, *short])
    raise InputError(f"no page is called {asked!r}{hint}; noslip docs lists them")
