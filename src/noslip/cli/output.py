"""How commands talk: results on standard output, progress on standard error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


def console() -> Console:
    """Return the console for results; plain text, and no wrapping, when piped."""
    shown = Console(highlight=False)
    return shown if shown.is_terminal else Console(highlight=False, width=200)


def print_json(data: Any) -> None:
    """Print data as JSON, and nothing else."""
    typer.echo(json.dumps(data, indent=2, allow_nan=False))


@contextmanager
def progress(description: str, total: int) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on standard error while work lasts; silent when that is no terminal.

    Yields
    ------
    callable
        To be called with (done, total).
    """
    error = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=error,
        transient=True,
        disable=not error.is_terminal,
    )
    with bar:
        task = bar.add_task(description, total=total)
        yield lambda done, total: bar.update(task, completed=done, total=total)
