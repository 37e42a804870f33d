"""Everything that noslip raises on purpose derives from :class:`NoslipError`.

Each message is one line that names what was wrong, where, what was found and what to do.
"""

from typing import ClassVar


class NoslipError(Exception):
    """Base of every error that noslip raises on purpose.

    Attributes
    ----------
    page : str
        Of the documentation, that tells more; empty where the message tells all.
    """

    page: ClassVar[str] = ""


class InputError(NoslipError, ValueError):
    """A file, a recording or an argument is not what it must be."""


class RecordingError(InputError):
    """A file is not the recording that it must be."""

    page = "docs/recordings.md"


class ConstraintError(NoslipError, ValueError):
    """A constraint is declared wrongly or cannot be understood."""

    page = "docs/concepts/constraints.md"


class ConvergenceError(NoslipError, RuntimeError):
    """A projection did not converge; the message says what to change."""

    page = "docs/concepts/projections.md"


class MissingDependencyError(NoslipError, ImportError):
    """An optional package is needed and not installed; the message says how to install it."""
