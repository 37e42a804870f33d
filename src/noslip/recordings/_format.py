"""What there is to say about a kind of file that holds recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from noslip._samples import Samples

MAPPING = ("columns", "channels", "values", "time", "units", "rotation", "rate", "robot")
"""Options that say what the columns of a table are; see :class:`noslip._pose_columns.Asked`."""
VELOCITIES = ("twist", "planar", "wheels")
"""Options of what is written beside or instead of poses; see
:func:`noslip.recordings.twists.motion_columns`."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of file: what it is called, read and written by.

    Attributes
    ----------
    name, folders : str
        With its article, for messages; what recordings that are folders are called, if any.
    read, options : callable, tuple of str
        ``read(path, **options)`` returns the samples of each recording, unchecked; those options
        of :func:`noslip.load_demonstrations` that it takes.
    suffixes, named_only : tuple of str
        Of the files that are read, in lower case; those that are read of a file that is named, but
        not looked for in folders, where most files with them are something else.
    is_folder : callable
        Whether a folder is one.
    write, write_options : callable or None, tuple of str
        ``write(trajectory, path, **options)`` returns the path, None where it is only read; those
        options of :func:`noslip.recordings.write_recording` that it takes.
    written : tuple of str
        Suffixes that are written; an empty one is a folder.
    replace : callable or None
        ``replace(path, out, poses, **options)`` writes a copy of a data set in which trajectories,
        by their names, stand in the place of those that it holds; None where there is one
        recording a file.
    extra : str
        Of noslip, that brings the packages it needs; empty if it needs none.
    """

    name: str
    read: Callable[..., list[Samples]]
    options: tuple[str, ...] = ()
    suffixes: tuple[str, ...] = ()
    named_only: tuple[str, ...] = ()
    folders: str = ""
    is_folder: Callable[[Path], bool] = lambda _: False
    write: Callable[..., Path] | None = None
    write_options: tuple[str, ...] = ()
    written: tuple[str, ...] = ()
    replace: Callable[..., None] | None = None
    extra: str = ""
