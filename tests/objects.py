"""Object code of C texts, compiled once for all tests that compile the same."""

from __future__ import annotations

import hashlib
import re
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path()
"""Where it is kept: all workers of a run share it (tests/conftest.py)."""


def objects(folder: Path, sources: Sequence[str], *command: str | None) -> list[Path]:
    """Compile each source without a word of the compiler's, or take what the same gave before.

    The same are command and source, and all of the folder that it includes.
    """
    words = [str(word) for word in command]
    return [_object(folder, source, _texts(folder, source), words) for source in sources]


def _texts(folder: Path, source: str) -> list[str]:
    """Names and texts of a source and of what it includes, and of what that does."""
    found, wanted = {}, [source]
    while wanted:
        name = wanted.pop()
        if name not in found and (folder / name).exists():
            found[name] = (folder / name).read_text()
            wanted += re.findall(r'#include "(\S+)"', found[name])
    return [part for name in sorted(found) for part in (name, found[name])]


def _object(folder: Path, source: str, texts: list[str], command: list[str]) -> Path:
    parts = [*command, source, *texts]
    kept = FOLDER / f"{hashlib.sha256(chr(0).join(parts).encode()).hexdigest()}.o"
    if not kept.exists():
        FOLDER.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(dir=FOLDER) as scratch:
            made = Path(scratch) / "made.o"
            done = subprocess.run(
                [*command, "-c", source, "-o", str(made)],
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
            )
            assert (done.returncode, done.stderr) == (0, ""), done.stderr
            # Two workers at once make the same; it appears whole.
            made.replace(kept)
    return kept
