"""Tables of text: CSV and its relatives, and TUM trajectory files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from noslip._files import write_beside
from noslip._pose_columns import Asked
from noslip._pose_names import clock_name
from noslip._pose_text import read_text_table
from noslip._samples import Samples
from noslip.errors import InputError
from noslip.named_columns import numbers_text
from noslip.recordings._format import MAPPING, VELOCITIES, Format
from noslip.recordings.twists import motion_text
from noslip.series import Series
from noslip.trajectory import PoseTrajectory

TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""As the RGB-D benchmark of TU Munich orders them: the scalar of the quaternion last."""


def read_text(path: Path, **asked: Any) -> list[Samples]:
    """Read the one recording of a table of text; see :mod:`noslip._pose_columns`."""
    return [read_text_table(path, Asked(**asked))]


def write_text(trajectory: PoseTrajectory | Series, path: Path, **asked: Any) -> Path:
    """Write a CSV, or TUM's format; a float read back is the float written."""
    if path.suffix.lower() == ".csv":
        return write_beside(path, motion_text(trajectory, **asked).encode())
    if isinstance(trajectory, Series) or trajectory.channels or any(asked.values()):
        raise InputError(f"{path}: TUM's format holds poses alone; write a CSV")
    scalar_last = np.roll(trajectory.quaternions, -1, axis=1)
    table = np.column_stack([trajectory.times, trajectory.positions, scalar_last])
    return write_beside(
        path, f"# {numbers_text((clock_name(trajectory.times), *TUM[1:]), table, ' ')}".encode()
    )


TEXT = Format(
    name="a table of text",
    read=read_text,
    options=MAPPING,
    suffixes=(".csv", ".tsv", ".tum"),
    named_only=(".txt", ".dat", ".log"),
    write=write_text,
    write_options=VELOCITIES,
    written=(".csv", ".tum"),
)
"""Some text may be one if it is named; in a folder it mostly is none."""
