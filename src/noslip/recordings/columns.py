"""One more column of a recording: a force, say."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from noslip._pose_columns import Asked
from noslip._pose_text import read_text_column
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.recordings.text import TEXT


def read_column(
    path: str | Path, column: str, *, rate: float | None = None, time: str | None = None
) -> tuple[Floats, Floats]:
    """Read one more column of a recording in text, a component of the wrench, say.

    Parameters
    ----------
    path : path
    column : str
        Its name in the header.
    rate : float, optional
        Samples per second of files that number their samples.
    time : str, optional
        Column of time, where its name does not tell.

    Returns
    -------
    times, values : array, shape (M,)
        Seconds, increasing, and the column in its own unit; a time given twice is taken once.

    Raises
    ------
    InputError
        If the file cannot be read, lacks the column or holds no number in it.
    """
    if Path(path).suffix.lower() not in (*TEXT.suffixes, *TEXT.named_only):
        raise RecordingError(f"{path}: column {column!r} can only be read from text; convert it")
    _, times, values = read_text_column(path, column, Asked(rate=rate, time=time))
    stamps, first = np.unique(times, return_index=True)
    return stamps, values[first]
