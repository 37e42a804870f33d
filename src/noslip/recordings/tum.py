"""TUM trajectory files: ``t x y z qx qy qz qw``, separated by blanks, ``#`` before comments."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from noslip import _pose_files as files
from noslip.errors import RecordingError
from noslip.trajectory import PoseTrajectory

SUFFIXES = (".tum", ".txt")
COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""As the RGB-D benchmark of TU Munich orders them: the scalar of the quaternion last."""


def read_tum(path: Path) -> list[PoseTrajectory]:
    """Read the one trajectory of a file in TUM's format.

    Raises
    ------
    InputError
        If a line does not hold eight numbers, or for what :func:`noslip.load_demonstrations` names.
    """
    text = files._decode(path, files._read(path))
    stripped = (line.partition("#")[0].split() for line in text.splitlines())
    rows = [(number, cells) for number, cells in enumerate(stripped, start=1) if cells]
    if not rows:
        raise RecordingError(f"{path}: the file holds no poses")
    lines, table = files._numbers(path, rows, list(COLUMNS), COLUMNS)
    of = dict(zip(COLUMNS, table.T, strict=True))
    source = files._Source(path, "column t", "columns qx, qy, qz, qw", lines)
    return [PoseTrajectory(**files._of_columns(source, of, None), name=str(path))]


def tum_text(trajectory: PoseTrajectory) -> str:
    """Return a trajectory as text; a float read back is the float written."""
    scalar_last = np.roll(trajectory.quaternions, -1, axis=1)
    table = np.column_stack([trajectory.times, trajectory.positions, scalar_last])
    rows = (" ".join(map(repr, row)) for row in table.tolist())
    return "\n".join([f"# {' '.join(COLUMNS)}", *rows, ""])
