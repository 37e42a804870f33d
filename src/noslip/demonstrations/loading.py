"""Recordings in files -> PoseTrajectory."""

from __future__ import annotations

import glob
from collections.abc import Iterable
from pathlib import Path

from noslip.errors import InputError
from noslip.trajectory import PoseTrajectory

SUFFIXES = (".csv", ".npz")


def load_demonstrations(
    paths: str | Path | Iterable[str | Path], *, rate: float | None = None
) -> list[PoseTrajectory]:
    """Read recordings of a tool's motion, one trajectory a file.

    Parameters
    ----------
    paths : path, glob or iterable of them
        ``"runs/*.csv"``, say.  A glob gives its files sorted, ``**`` goes through folders, ``~``
        is the home folder.  A path that exists is taken as it is, even one that reads like a
        glob.  A file given twice is read once.
    rate : float, optional
        Samples per second of CSV files that number their samples (column ``i``) instead of
        stamping them; sample ``i`` is then at ``i / rate`` seconds.  Files with stamps ignore it.

    Returns
    -------
    list of PoseTrajectory
        In the order given.  ``name`` is the file's path as given or found.

    Raises
    ------
    InputError
        If nothing is found, a file cannot be read, or its content is not a recording: a missing
        or repeated column, a cell without a number, NaN or infinity, time that runs backwards,
        two poses at one time, a gap of more than 10 median periods, a quaternion more than 1e-3
        off unit norm, fewer than 8 samples.  The message names the file, the line (CSV, the
        header included) or the sample (npz, from 0), and the column or array.

    Notes
    -----
    **CSV**: UTF-8, one header, columns in any order found by name (in any case); cells are
    separated by ``,``, or by ``;`` or tab where the header is.  Other columns are ignored.

    ================== ==================================================================
    columns            meaning
    ================== ==================================================================
    ``t`` or ``time``  seconds, starting anywhere, at any rate
    ``i``              or the number of the sample, with ``rate``
    ``x,y,z``          position of the tool in the world frame, metres
    ``qw,qx,qy,qz``    unit quaternion, turns body-frame vectors into the world frame
    ``x,y,theta``      or a planar pose: ``z = 0``, turned by ``theta`` radians about world z
    ================== ==================================================================

    **npz**: arrays ``times`` (N,), ``positions`` (N, 3) and ``quaternions`` (N, 4; scalar first),
    and if there ``linear_velocities`` and ``angular_velocities`` (N, 3; m/s, rad/s, world frame).

    A quaternion and its negative are the same rotation.  Quaternions are normalised.  A sample
    that repeats the time and the pose of the one before (to 1e-9) is dropped.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    files: dict[Path, Path] = {}
    for path in given:
        for file in _expand(path):
            files.setdefault(file.resolve(), file)
    if not files:
        raise InputError("no demonstrations given; give at least one file, such as runs/*.csv")
    return [_load(file, rate) for file in files.values()]


def _expand(path: str | Path) -> list[Path]:
    """Return the files that a path or glob stands for."""
    try:
        literal = Path(path).expanduser()
    except RuntimeError as error:
        raise InputError(f"{path}: the home folder is unknown; give the path itself") from error
    if literal.is_dir():
        raise InputError(f"{path}: a folder, not a file; give {Path(path) / '*.csv'}")
    if literal.exists():
        return [literal]
    if not glob.has_magic(str(literal)):
        raise InputError(f"{path}: no such file; check the path")
    # Path.glob takes no absolute pattern, and it matches hidden files.
    names = sorted(glob.glob(str(literal), recursive=True))  # noqa: PTH207
    matches = map(Path, names)
    files = [match for match in matches if not match.is_dir()]
    if not files:
        raise InputError(f"{path}: no file matches; check the folder and the pattern")
    return files


def _load(file: Path, rate: float | None) -> PoseTrajectory:
    match file.suffix.lower():
        case ".csv":
            return PoseTrajectory.from_csv(file, rate=rate)
        case ".npz":
            return PoseTrajectory.from_npz(file)
    raise InputError(
        f"{file}: {file.suffix or 'no suffix'} is not a known kind of recording; "
        f"known are {' and '.join(SUFFIXES)}"
    )
