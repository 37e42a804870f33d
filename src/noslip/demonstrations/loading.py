"""Recordings in files -> PoseTrajectory."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from noslip.errors import InputError, RecordingError
from noslip.recordings import bags, lerobot, robomimic, tables, tum
from noslip.trajectory import PoseTrajectory


class _Reader(NamedTuple):
    """How to read one format, and which of the options it takes."""

    read: Callable[..., list[PoseTrajectory]]
    options: tuple[str, ...] = ()


_BAG = _Reader(bags.read_bag, ("topic", "frame", "child_frame"))
_LEROBOT = _Reader(lerobot.read_lerobot, ("episode", "columns"))
_READERS = {
    ".csv": _Reader(lambda path, rate: [PoseTrajectory.from_csv(path, rate=rate)], ("rate",)),
    ".npz": _Reader(lambda path: [PoseTrajectory.from_npz(path)]),
    **dict.fromkeys(tum.SUFFIXES, _Reader(tum.read_tum)),
    **dict.fromkeys(tables.SUFFIXES, _Reader(tables.read_table, ("rate", "columns"))),
    **dict.fromkeys(
        robomimic.SUFFIXES, _Reader(robomimic.read_robomimic, ("rate", "episode", "columns"))
    ),
    **dict.fromkeys(bags.SUFFIXES, _BAG),
}
SUFFIXES = tuple(suffix for suffix in _READERS if suffix != ".txt")
"""Of recordings.  A text file may be one if it is named, but in a folder it mostly is none."""
_WHAT_TAKES = {
    "topic": "a ROS bag",
    "frame": "a ROS bag",
    "child_frame": "a ROS bag",
    "episode": "a LeRobot data set or an HDF5 file",
    "columns": "a LeRobot data set, an HDF5 file or a table",
}


def load_demonstrations(
    paths: str | Path | Iterable[str | Path],
    *,
    rate: float | None = None,
    topic: str | None = None,
    frame: str | None = None,
    child_frame: str | None = None,
    episode: int | Iterable[int] | None = None,
    columns: str | None = None,
) -> list[PoseTrajectory]:
    """Read recordings of a tool's motion, one trajectory a file, or one an episode.

    Parameters
    ----------
    paths : path, glob or iterable of them
        ``"runs/*.csv"``, say.  A glob gives its files sorted, ``**`` goes through folders, ``~``
        is the home folder.  A path that exists is taken as it is, even one that reads like a
        glob.  A file given twice is read once.
    rate : float, optional
        Samples per second of CSV files and tables that number their samples (column ``i``)
        instead of stamping them (sample ``i`` is then at ``i / rate`` seconds), and of robomimic
        files.  Files with stamps ignore it.
    topic, frame, child_frame : str, optional
        Of ROS bags: where the poses are, see :func:`noslip.recordings.bags.read_bag`.
    episode : int or iterable of int, optional
        Of LeRobot data sets and robomimic files; by default all.
    columns : str, optional
        Of data sets and tables: where the pose is, in the order x, y, z, qw, qx, qy, qz, such as
        ``"observation.state[0:3,6,3:6]"``; see :func:`noslip.recordings.columns.pose_columns`.

    Returns
    -------
    list of PoseTrajectory
        In the order given.  ``name`` is the file's path as given or found, followed by the
        episode where there are several.

    Raises
    ------
    MissingDependencyError
        If a format needs a package that is not installed; the message names the extra.
    InputError
        If nothing is found, a file cannot be read, or its content is not a recording: a missing
        or repeated column, a cell without a number, NaN or infinity, time that runs backwards,
        two poses at one time, a gap of more than 10 median periods, a quaternion more than 1e-3
        off unit norm, fewer than 8 samples.  The message names the file, the line (text, the
        header included) or the sample (from 0), and the column, array or topic.  Also if an
        option is given that none of the files takes.

    Notes
    -----
    **CSV**: UTF-8, one header, columns in any order found by name (in any case); cells are
    separated by ``,``, or by ``;`` or tab where the header is.  Other columns are ignored.

    ================== ==================================================================
    columns            meaning
    ================== ==================================================================
    ``t`` or ``time``  seconds, starting anywhere, at any rate
    ``i``              or the number of the sample, with ``rate``
    ``x,y,z``          position of the tool in the world frame, meters
    ``qw,qx,qy,qz``    unit quaternion, turns body-frame vectors into the world frame
    ``x,y,theta``      or a planar pose: ``z = 0``, turned by ``theta`` radians about world z;
                       in degrees as ``x,y,theta_deg``
    ================== ==================================================================

    **npz**: arrays ``times`` (N,), ``positions`` (N, 3) and ``quaternions`` (N, 4; scalar first),
    and if there ``linear_velocities`` and ``angular_velocities`` (N, 3; m/s, rad/s, world frame).

    ===================================== ===================================================
    other files                           what is read
    ===================================== ===================================================
    ``.bag``, ``.mcap``, a folder with    ROS bags: poses, transforms, odometry, paths, tf;
    ``metadata.yaml``                     :mod:`noslip.recordings.bags`
    a folder with ``meta/info.json``      LeRobot data set; :mod:`noslip.recordings.lerobot`
    ``.hdf5``, ``.h5``                    robomimic; :mod:`noslip.recordings.robomimic`
    ``.parquet``, ``.feather``            a CSV's columns; :mod:`noslip.recordings.tables`
    ``.tum``, ``.txt``                    ``t x y z qx qy qz qw``; :mod:`noslip.recordings.tum`
    ===================================== ===================================================

    A quaternion and its negative are the same rotation.  Quaternions are normalized.  A sample
    that repeats the time and the pose of the one before (to 1e-9) is dropped.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    files: dict[Path, Path] = {}
    for path in given:
        for file in expand(path):
            files.setdefault(file.resolve(), file)
    if not files:
        raise RecordingError("no demonstrations given; give at least one file, such as runs/*.csv")
    readers = {file: _reader(file) for file in files.values()}
    options = {
        "rate": rate,
        "topic": topic,
        "frame": frame,
        "child_frame": child_frame,
        "episode": list(episode) if isinstance(episode, Iterable) else episode,
        "columns": columns,
    }
    _check_options(options, readers)
    return [
        trajectory
        for file, reader in readers.items()
        for trajectory in reader.read(file, **{name: options[name] for name in reader.options})
    ]


def expand(path: str | Path) -> list[Path]:
    """Return the recordings that a path or glob stands for."""
    try:
        literal = Path(path).expanduser()
    except RuntimeError as error:
        raise RecordingError(f"{path}: the home folder is unknown; give the path itself") from error
    if literal.is_dir() and folder_reader(literal) is None:
        raise InputError(f"{path}: a folder, not a file; give {Path(path) / '*.csv'}")
    if literal.exists():
        return [literal]
    if not glob.has_magic(str(literal)):
        raise InputError(f"{path}: no such file; check the path")
    # Path.glob takes no absolute pattern, and it matches hidden files.
    names = sorted(glob.glob(str(literal), recursive=True))  # noqa: PTH207
    matches = map(Path, names)
    files = [match for match in matches if not match.is_dir() or folder_reader(match)]
    if not files:
        raise InputError(f"{path}: no file matches; check the folder and the pattern")
    return files


def folder_reader(folder: Path) -> _Reader | None:
    """Return how to read the recording that a folder is, or None if it is none."""
    if bags.is_bag(folder):
        return _BAG
    return _LEROBOT if lerobot.is_lerobot(folder) else None


def _reader(file: Path) -> _Reader:
    reader = folder_reader(file) if file.is_dir() else _READERS.get(file.suffix.lower())
    if reader is None:
        raise RecordingError(
            f"{file}: {file.suffix or 'no suffix'} is not a known kind of recording; "
            f"known are {', '.join(_READERS)}, and the folders of ROS 2 bags and LeRobot data sets"
        )
    return reader


def _check_options(options: dict[str, Any], readers: dict[Path, _Reader]) -> None:
    """Refuse an option that would be ignored."""
    for name, wanted in _WHAT_TAKES.items():
        taken = any(name in reader.options for reader in readers.values())
        if options[name] is not None and not taken:
            raise RecordingError(
                f"{next(iter(readers))}: {name}={options[name]!r} is for {wanted}; leave it out"
            )
