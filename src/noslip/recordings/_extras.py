"""Packages that only some formats need, and what they say about damaged files."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from noslip.errors import MissingDependencyError, NoslipError, RecordingError


def need(path: str | Path, module: str, extra: str) -> Any:
    """Return a module of an optional package, or say which extra brings it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingDependencyError(
            f"{path}: {module.partition('.')[0]} is needed for such files and cannot be imported; "
            f"pip install 'noslip[{extra}]'"
        ) from error


@contextmanager
def reading(path: str | Path, kind: str) -> Iterator[None]:
    """Turn whatever another package stumbles over in a file into one line.

    Damaged files surface as errors of SQLite, YAML, zstd, struct, Arrow and more, and as lack of
    memory where a length is damaged; no list of types would be complete.
    """
    try:
        yield
    except NoslipError:
        raise
    except Exception as error:
        what = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordingError(f"{path}: cannot be read as {kind} ({what})") from error
