"""The files that paths, globs and folders stand for, and the primitive that each becomes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from noslip.errors import InputError, one_line
from noslip.recordings.formats import SUFFIXES, expand, folder_format

Recordings = str | Path | Iterable[str | Path]
"""What stands for files: a path, a glob, a folder, or several of them."""


def find_recordings(recordings: Recordings, *, leave_out: Iterable[Path] = ()) -> dict[str, Path]:
    """Return the files that paths, globs and folders stand for, by the name of their primitive.

    Hidden files and folders are passed over, and so is ``leave_out``.

    Raises
    ------
    InputError
        If a path is missing, a folder holds no recording, or two files have one name.
    """
    passed_over = {path.resolve() for path in leave_out}
    found: dict[Path, tuple[str, Path]] = {}
    for path in [recordings] if isinstance(recordings, (str, Path)) else recordings:
        folder = Path(os.path.expanduser(path))  # noqa: PTH111 - pathlib's raises without a home
        if folder.is_dir() and folder_format(folder) is None:
            inside = [
                (file.relative_to(folder), file)
                for file in sorted(folder.rglob("*"))
                if file.suffix.lower() in SUFFIXES and file.resolve() not in passed_over
            ]
            named = [
                (below.with_suffix("").as_posix(), file)
                for below, file in inside
                if not any(part.startswith(".") for part in below.parts) and file.is_file()
            ]
            if not named:
                raise InputError(
                    f"{path}: no recording in this folder; known are {', '.join(SUFFIXES)}"
                )
        else:
            named = [(file.stem, file) for file in expand(path)]
        for name, file in named:
            if file.resolve() not in passed_over:
                found.setdefault(file.resolve(), (name, file))
    if not found:
        raise InputError("no recordings given; give files, globs or folders")
    files: dict[str, Path] = {}
    taken: dict[str, Path] = {}
    for given, file in found.values():
        # The table is UTF-8, which a file's name need not be.
        name = one_line(given)
        # Some file systems take upper and lower case for the same.
        other = taken.setdefault(name.casefold(), file)
        if other is not file:
            raise InputError(
                f"{file}: its primitive would be {name}.json, as that of {other}; give the folder "
                "that holds both, or rename one"
            )
        files[name] = file
    return files


def content_hash(file: Path) -> str:
    try:
        with file.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError:
        return ""  # Reading it says what is wrong.
