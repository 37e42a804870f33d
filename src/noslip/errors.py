"""Everything that noslip raises on purpose derives from :class:`NoslipError`.

Each message is one line that names what was wrong, where, what was found and what to do.  What was
done, but not as asked, is a :class:`NoslipWarning`, in Python as on the command line.

Messages quote names and text of files that others wrote: here, where they leave, they are made such
that they cannot forge a line or steer a terminal.
"""

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from difflib import get_close_matches
from enum import StrEnum
from typing import Any, ClassVar

_muted: ContextVar[bool] = ContextVar("muted", default=False)


def one_line(text: object) -> str:
    """Return a text with all escaped that is no printable character: ends of lines, escapes, ..."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def did_you_mean(found: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean x?)"`` of the name nearest to one that is none, or nothing.

    Where names begin with what was given, they are meant: ``--goal-position`` and ``--goals`` by
    ``--goal``.
    """
    # Of names in any case and with any dashes: what differs there alone is surely meant.
    plain = {name.lower().replace("_", "-"): name for name in known}
    given = found.lower().replace("_", "-")
    begun = [name for name in plain if name.startswith(given)] if given.strip("-") else []
    # More than these are a list, not a hint.
    close = begun if 0 < len(begun) <= 6 else get_close_matches(given, plain, n=1)
    *others, last = [plain[name] for name in close] or [""]
    meant = f"{', '.join(others)} or {last}" if others else last
    return f" (did you mean {meant}?)" if meant else ""


class Refusal(StrEnum):
    """Why there is no motion as asked: the ``code`` of an error, and what helps.

    Only ``IMPOSSIBLE`` says that there is none; all others, that none was found.
    """

    TOO_FAST = "too-fast"
    """The path is fine, but a limit on speeds, rates or accelerations cannot be kept on it in the
    duration asked for: take the error's ``duration``, or loosen that limit."""
    NOT_CONVERGED = "not-converged"
    """There is a motion that keeps the constraints, but the iteration to the nearest did not end:
    look at the error's ``iterate``, and smooth what is projected."""
    NOT_FOUND = "not-found"
    """The search came to no motion that keeps the constraints: take other ends, loosen one of the
    constraints, or demonstrate the way."""
    IMPOSSIBLE = "impossible"
    """It is proven that no motion does, by the constraint that the message names: ask for something
    else, or leave that constraint out."""
    MISSED = "missed"
    """A motion was made, but carried out it misses its goal, a via point or a hard limit: the
    message says by how much, and what was tried."""


class NoslipError(Exception):
    """Base of every error that noslip raises on purpose.

    Attributes
    ----------
    page : str
        Of the documentation, that tells more: ``noslip docs PAGE`` shows it.  Empty where the
        message tells all.
    code : Refusal or None
        Why there is no motion as asked; None of what has no motion to do with.
    iterate : PoseTrajectory or None
        The best motion that was found.
    duration : float or None
        That suffices (s), where time is all that lacks.
    """

    page: ClassVar[str] = ""
    code: Refusal | None = None

    def __init__(
        self,
        *arguments: object,
        code: Refusal | None = None,
        iterate: Any = None,
        duration: float | None = None,
    ) -> None:
        super().__init__(*arguments)
        self.code = code or self.code
        self.iterate, self.duration = iterate, duration

    def __str__(self) -> str:
        return one_line(super().__str__())


class InputError(NoslipError, ValueError):
    """A file, a recording or an argument is not what it must be."""


class RecordingError(InputError):
    """A file is not the recording that it must be."""

    page = "recordings"


class ConstraintError(NoslipError, ValueError):
    """A constraint is declared wrongly or cannot be understood."""

    page = "concepts/constraints"


class ConvergenceError(NoslipError, RuntimeError):
    """A projection did not converge; the message says what to change."""

    page = "concepts/projections"
    code = Refusal.NOT_CONVERGED


class MissedError(NoslipError, RuntimeError):
    """A motion misses its goal, a via point or a hard limit; says by how much and what to do."""

    page = "refusals"
    code = Refusal.MISSED


class MissingDependencyError(NoslipError, ImportError):
    """An optional package is needed and not installed; the message says how to install it."""


class NoslipWarning(UserWarning):
    """Base of every warning; one line, like an error's."""


class RecordingWarning(NoslipWarning):
    """A recording is hardly what its file says: units, size, speed, placement."""


class CompromiseWarning(NoslipWarning):
    """Something was done, but not as asked: the message says by how much and what to do."""


def warn(message: str, category: type[NoslipWarning]) -> None:
    """Warn whoever called noslip: the line named is the first one outside of the package."""
    if _muted.get():
        return
    package, frame, level = __name__.partition(".")[0], sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        frame, level = frame.f_back, level + 1
    warnings.warn(one_line(message), category, stacklevel=level)


@contextmanager
def muted() -> Iterator[None]:
    """Leave out warnings of noslip in this thread: nobody reads them in a loop.

    Unlike those of :mod:`warnings`, this filter is no business of other threads.
    """
    token = _muted.set(True)
    try:
        yield
    finally:
        _muted.reset(token)
