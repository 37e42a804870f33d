"""Everything that noslip raises on purpose derives from :class:`NoslipError`.

Each message is one line that names what was wrong, where, what was found and what to do.
"""


class NoslipError(Exception):
    """Base of every error that noslip raises on purpose."""


class InputError(NoslipError, ValueError):
    """A file, a recording or an argument is not what it must be."""


class ConstraintError(NoslipError, ValueError):
    """A constraint is declared wrongly or cannot be understood."""


class ConvergenceError(NoslipError, RuntimeError):
    """A projection did not converge; the message says what to change."""


class MissingDependencyError(NoslipError, ImportError):
    """An optional package is needed and not installed; the message says how to install it."""
