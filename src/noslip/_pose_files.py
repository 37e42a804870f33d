"""Poses in CSV and npz files: read, checked, and explained when they are wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def read_csv(path: str | Path, *, rate: float | None = None) -> dict[str, Any]:
    """Return the fields of a PoseTrajectory read from a CSV."""
    raise NotImplementedError


def read_npz(path: str | Path) -> dict[str, Any]:
    """Return the fields of a PoseTrajectory read from an npz."""
    raise NotImplementedError
