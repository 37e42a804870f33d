"""TUM trajectory files: ``t x y z qx qy qz qw``, separated by blanks, ``#`` before comments."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from noslip._files import read_text, write_beside
from noslip._pose_checks import Source
from noslip._pose_csv import poses_of_columns
from noslip._samples import Samples
from noslip.errors import RecordingError
from noslip.named_columns import NamedColumns, numbers_text
from noslip.recordings._format import Format
from noslip.trajectory import PoseTrajectory

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""As the RGB-D benchmark of TU Munich orders them: the scalar of the quaternion last."""


def read_tum(path: Path) -> list[Samples]:
    """Read the one trajectory of a file in TUM's format.

    Raises
    ------
    InputError
        If a line does not hold eight numbers, or for what :func:`noslip.load_demonstrations` names.
    """
    stripped = (line.partition("#")[0].split() for line in read_text(path).splitlines())
    rows = ((number, cells) for number, cells in enumerate(stripped, start=1) if cells)
    lines, of, _ = NamedColumns(path, 0, COLUMNS, rows).read(COLUMNS)
    if not lines:
        raise RecordingError(f"{path}: the file holds no poses")
    source = Source(path, "column t", "columns qx, qy, qz, qw", lines)
    return [poses_of_columns(str(path), source, of, None)]


def write_tum(trajectory: PoseTrajectory, path: Path) -> Path:
    """Write a trajectory; a float read back is the float written."""
    scalar_last = np.roll(trajectory.quaternions, -1, axis=1)
    table = np.column_stack([trajectory.times, trajectory.positions, scalar_last])
    return write_beside(path, f"# {numbers_text(COLUMNS, table, ' ')}".encode())


TUM = Format(
    name="a TUM file",
    read=read_tum,
    suffixes=(".tum",),
    named_only=(".txt",),
    write=write_tum,
    written=(".tum",),
)
"""A text file may be one if it is named; in a folder it mostly is none."""
