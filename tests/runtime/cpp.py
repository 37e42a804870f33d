"""What tests of C++ share."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

CC, CXX = shutil.which("gcc"), shutil.which("g++")
needs_cpp = pytest.mark.skipif(
    CC is None or CXX is None, reason="gcc or g++ is missing (Debian: g++)"
)
SOURCES = ("noslip.c", "plan.c", "replan.c", "controller.c", "primitive.c")
OBJECTS = [source.replace(".c", ".o") for source in SOURCES]


def ran(*command: object, folder: Path) -> str:
    """What a command that must succeed prints."""
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
