"""What other packages say about damaged files, in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from noslip.errors import NoslipError, RecordingError


@contextmanager
def reading(path: str | Path, kind: str) -> Iterator[None]:
    """Turn whatever another package stumbles over in a file into one line.

    Damaged files surface as errors of SQLite, YAML, zstd, struct, Arrow and more, and as lack of
    memory where a length is damaged; no list of types would be complete.
    """
    try:
        yield
    except (NoslipError, Warning):
        raise
    except Exception as error:
        what = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordingError(f"{path}: cannot be read as {kind} ({what})") from error
