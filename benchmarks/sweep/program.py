"""The command line, run in this process as a shell would, and what it says."""

from __future__ import annotations

import contextlib
import io
import json
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from noslip.cli import main

LONGEST = 60
"""Seconds that a command may take: what a person waits for without looking at the clock, on a
machine at a tenth of its speed."""
_ERROR, _WARNING = "noslip: error: ", "noslip: warning: "


class TooLongError(Exception):
    """A command took longer than a person waits."""


@dataclass(frozen=True)
class Said:
    """What a command said.

    Attributes
    ----------
    command : str
    code : int
        Its exit code.
    result : dict
        What it printed as JSON; empty if it failed.
    warnings : tuple of str
    error : str
        Empty if there was none.
    other : str
        Anything else on standard error.
    seconds : float
    """

    command: str
    code: int
    result: dict[str, Any]
    warnings: tuple[str, ...]
    error: str
    other: str
    seconds: float

    @property
    def sentences(self) -> tuple[str, ...]:
        """All that it told a person."""
        return (*self.warnings, *([self.error] if self.error else []))


def noslip(*arguments: object, seconds: int = LONGEST) -> Said:
    """Run a command with ``--json``."""
    words = [*map(str, arguments), "--json"]
    out, err, code, begun = io.StringIO(), io.StringIO(), 0, time.process_time()
    argv, sys.argv = sys.argv, ["noslip", *words]
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            _within(seconds),
            warnings.catch_warnings(),
        ):
            main()
    except SystemExit as stop:
        code = int(stop.code or 0)
    except TooLongError:
        code = -1
        err.write(f"took more than {seconds} s")
    except Exception:
        code = -2
        err.write(traceback.format_exc())
    finally:
        sys.argv = argv
    told, error, other = [], "", []
    for line in err.getvalue().splitlines():
        if line.startswith(_WARNING):
            told.append(line.removeprefix(_WARNING))
        elif line.startswith(_ERROR):
            error = line.removeprefix(_ERROR)
        else:
            other.append(line)
    try:
        result = json.loads(out.getvalue())
    except ValueError:
        result = {}
    spent = time.process_time() - begun
    return Said(" ".join(words), code, result, tuple(told), error, "\n".join(other), spent)


@contextlib.contextmanager
def _within(seconds: int) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def files(folder: Path) -> set[str]:
    """What lies in a folder."""
    return {path.name for path in folder.iterdir()}
