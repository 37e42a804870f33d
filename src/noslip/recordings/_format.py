"""What there is to say about a kind of file that holds recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from noslip.trajectory import PoseTrajectory


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of file: what it is called, read and written by.

    Attributes
    ----------
    name : str
        With its article, for messages.
    read : callable
        ``read(path, **options)`` returns a list of trajectories.
    options : tuple of str
        Of :func:`noslip.load_demonstrations`, those that ``read`` takes.
    suffixes : tuple of str
        Of the files that are read, in lower case.
    named_only : tuple of str
        Suffixes that are read of a file that is named, but not looked for in folders, where most
        files with them are something else.
    folders : str
        What recordings that are folders are called, if there are such.
    is_folder : callable
        Whether a folder is one.
    write : callable or None
        ``write(trajectory, path, **options)`` returns the path; None where it is only read.
    write_options : tuple of str
        Of :func:`noslip.recordings.write_recording`, those that ``write`` takes.
    written : tuple of str
        Suffixes that are written; an empty one is a folder.
    extra : str
        Of noslip, that brings the packages it needs; empty if it needs none.
    """

    name: str
    read: Callable[..., list[PoseTrajectory]]
    options: tuple[str, ...] = ()
    suffixes: tuple[str, ...] = ()
    named_only: tuple[str, ...] = ()
    folders: str = ""
    is_folder: Callable[[Path], bool] = lambda _: False
    write: Callable[..., Path] | None = None
    write_options: tuple[str, ...] = ()
    written: tuple[str, ...] = ()
    extra: str = ""
