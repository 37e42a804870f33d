"""Object code of C texts, compiled once for all tests that compile the same."""

from __future__ import annotations

import hashlib
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path()
"""Where it is kept: all workers of a run share it (tests/conftest.py)."""


def objects(folder: Path, sources: Sequence[str], *command: str | None) -> list[Path]:
    """Compile each source without a word of the compiler's, or take what the same gave before.

    The same are command and source, and all headers of the folder.
    """
    headers = [
        part for file in sorted(folder.glob("*.h")) for part in (file.name, file.read_text())
    ]
    return [_object(folder, source, headers, [str(word) for word in command]) for source in sources]


def _object(folder: Path, source: str, headers: list[str], command: list[str]) -> Path:
    parts = [*command, source, (folder / source).read_text(), *headers]
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
