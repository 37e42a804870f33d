"""The ``noslip`` command: recordings in, constrained primitives and their motion out."""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from textwrap import indent
from threading import current_thread, main_thread
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from noslip._version import __version__
from noslip.errors import (
    ConvergenceError,
    InputError,
    MissedError,
    NoslipError,
    NoslipWarning,
    did_you_mean,
    one_line,
)

EXIT_VIOLATED, EXIT_USAGE = 1, 2
"""What a script tells apart: a job that was not done, and a call that is wrong."""

PANELS = {
    "Start here": ("demo", "docs", "doctor"),
    "Recordings": ("topics", "convert", "segment", "check", "identify", "shield"),
    "Primitives": ("learn", "rollout", "adapt", "sample"),
    "Look at them": ("plot", "view", "report"),
    "To the robot": ("simulate", "export"),
}
"""The commands by what a person does with them, in the order in which that is done."""
_LOOK: dict[str, Any] = {
    "add_completion": False,
    "rich_markup_mode": "rich",
    "pretty_exceptions_enable": False,
}


class _Commands(Mapping[str, Any]):
    """The commands by their names; each is imported when it is asked for."""

    def __init__(self) -> None:
        self._panels = {name: panel for panel, names in PANELS.items() for name in names}

    def __getitem__(self, name: str) -> Any:
        return _command(name, self._panels[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._panels)

    def __len__(self) -> int:
        return len(self._panels)


@cache
def _command(name: str, panel: str) -> Any:
    """Return one command; its module has its name, and examples below the first line it says."""
    command = import_module(f"{__name__}.{name}")
    _, _, examples = (command.__doc__ or "").partition("\n\n")
    alone = typer.Typer(**_LOOK)
    alone.command(
        name=name,
        cls=_Command,
        epilog=f"\nExamples:\n\n{indent(examples, '  ')}",
        rich_help_panel=panel,
    )(command.run)
    return typer.main.get_command(alone)


_OTHER_WORDS = {"--rate": "--time-step", "--frequency": "--time-step", "--dt": "--time-step"}
"""What a motion's own time step is called elsewhere; spelling does not lead there."""

# Typer brings a Click of its own, or takes the one that is installed.
_USAGE: Any = typer.BadParameter.__base__


@contextmanager
def _usage_as_line(context: Any) -> Iterator[None]:
    """Tell a call that is wrong as one line, like any other error."""
    try:
        yield
    except _USAGE as error:
        told: Any = error
        what = " ".join(told.format_message().replace("Value error, ", "").split()).rstrip(".")
        if hasattr(told, "possibilities"):
            known = [name for each in context.command.params for name in each.opts]
            ours = _OTHER_WORDS.get(told.option_name, "")
            near = did_you_mean(ours if ours in known else told.option_name, known)
            what = f"no such option {told.option_name}{near}"
        raise InputError(f"{what}; see {context.command_path} --help") from None


class _Command(TyperCommand):
    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        with _usage_as_line(ctx):
            return super().parse_args(ctx, args)


class _Group(TyperGroup):
    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes | {"commands": _Commands()})

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args:
            return super().parse_args(ctx, args)
        with _usage_as_line(ctx):
            return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and not args[0].startswith("-") and args[0] not in self.commands:
            near = did_you_mean(args[0], self.commands)
            raise InputError(f"no command {args[0]!r}{near}; noslip --help lists them")
        return super().resolve_command(ctx, args)


app = typer.Typer(
    name="noslip",
    cls=_Group,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    **_LOOK,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"noslip {__version__}")
        raise typer.Exit


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """Tell each warning of ours as one line, like an error; those of libraries stay as they are."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", NoslipWarning)
        show = warnings.showwarning

        def as_line(message: Warning | str, category: type[Warning], *where: Any) -> None:
            if issubclass(category, NoslipWarning):
                typer.echo(f"noslip: warning: {message}", err=True)
            else:
                show(message, category, *where)

        warnings.showwarning = as_line  # type: ignore[assignment]
        yield


@app.callback()
def _noslip(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Movement primitives for tools that must not slip sideways.

    Learn a primitive from recordings, hold a constraint exactly while it
    runs, check and draw the motion.  Start with [bold]noslip demo[/bold]; then, with a
    recording of your own:

      noslip check cut.csv --constraint blade               does the hand slip?

      noslip identify cut.csv                               what holds instead?

      noslip learn cut.csv --constraint blade --out cut.json

      noslip view cut.csv cut.json                          drag its goal, push it

      noslip simulate cut.json --out arm/                   on an arm

    A recording is t,x,y,z,qw,qx,qy,qz (s, m, the tool in the world), a ROS
    bag or a data set.

    Exit codes: 0 fine, 1 a constraint is violated, a goal missed or a projection
    did not converge, 2 bad usage or input.
    """
    context.with_resource(_warnings_as_lines())


def _interrupt(_: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt outside of CasADi, which clears what is raised in its midst."""
    caller = frame
    while caller is not None and caller.f_globals.get("__name__", "").startswith("casadi"):
        caller = caller.f_back
    if caller is frame or caller is None:
        raise KeyboardInterrupt

    def stop(*_: Any) -> None:
        sys.settrace(None)
        raise KeyboardInterrupt

    caller.f_trace = stop
    sys.settrace(lambda *_: None)


@contextmanager
def _interruptible() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler and current_thread() is main_thread()
    if ours:
        signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)


def main() -> None:
    """Run the command line; errors become one line and an exit code."""
    try:
        with _interruptible():
            app()
    except NoslipError as error:
        more = f" (see noslip docs {error.page})" if error.page else ""
        print(f"noslip: error: {error}{more}", file=sys.stderr)
        undone = isinstance(error, (ConvergenceError, MissedError))
        sys.exit(EXIT_VIOLATED if undone else EXIT_USAGE)
    except (MemoryError, OverflowError, RecursionError, ArithmeticError) as error:
        what = one_line(error) or "too large to compute"
        print(f"noslip: error: {type(error).__name__}: {what}; check the numbers", file=sys.stderr)
        sys.exit(EXIT_USAGE)
    except BrokenPipeError:
        # The reader of a pipe has gone: that is its right, and no error of ours.
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        where = one_line(error.filename or "output")
        print(f"noslip: error: {where}: {error.strerror}", file=sys.stderr)
        sys.exit(EXIT_USAGE)
    except KeyboardInterrupt:
        print("noslip: interrupted", file=sys.stderr)
        sys.exit(130)
