"""The formats of recordings, and reading and writing by what a path is."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from noslip._files import write_beside
from noslip._pose_columns import Kinematics
from noslip._pose_npz import read_npz
from noslip._samples import Duplicates, Gaps, Interval, Lost, Mending, Samples, Unsorted
from noslip._supplied import Supplied
from noslip.chain import Chain
from noslip.errors import InputError, RecordingError
from noslip.named_columns import listed, numbers_text
from noslip.recordings._format import VELOCITIES, Format
from noslip.recordings.bag_writing import write_bag
from noslip.recordings.bags import BAG, Integrate
from noslip.recordings.joints import checked_joints
from noslip.recordings.lerobot import LEROBOT
from noslip.recordings.robomimic import HDF5
from noslip.recordings.tables import TABLE
from noslip.recordings.text import TEXT
from noslip.recordings.twists import Twist
from noslip.scale import ask_after_units
from noslip.series import Series
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

NPZ = Format(
    name="an npz",
    read=lambda path, values=None: [read_npz(path, values=bool(values))],
    options=("values",),
    suffixes=(".npz",),
    write=lambda trajectory, path: trajectory.to_npz(path),
    written=(".npz",),
)
"""Of arrays."""
FORMATS = (TEXT, NPZ, LEROBOT, HDF5, TABLE, BAG)
"""All there are, in the order in which messages list them.  Adding one means adding it here."""

_BY_SUFFIX = {suffix: each for each in FORMATS for suffix in (*each.suffixes, *each.named_only)}
"""What a file that is named is read as."""
SUFFIXES = tuple(suffix for each in FORMATS for suffix in each.suffixes)
"""Of the recordings in a folder."""
WRITTEN = {suffix: each for each in FORMATS for suffix in each.written}
"""What is written by suffix."""


def listed_suffixes(suffixes: Iterable[str]) -> str:
    """Return suffixes that are written, for messages."""
    folder = "or no suffix for a ROS 2 bag (a folder)"
    return ", ".join(suffix or folder for suffix in suffixes)


class Reading(TypedDict, total=False):
    """Options of :func:`load_demonstrations`, of which other functions have some too."""

    rate: float | None
    topic: str | None
    frame: str | None
    child_frame: str | None
    publisher: str | None
    element: int | None
    integrate: Integrate | None
    episode: int | Iterable[int] | None
    channels: str | Iterable[str] | None
    time: str | None
    units: str | Iterable[str] | None
    rotation: str | None
    robot: Kinematics | None
    gaps: Gaps
    duplicates: Duplicates
    unsorted: Unsorted
    lost: Lost
    within: Interval | None


class ReadingColumns(Reading, total=False):
    """All of them."""

    columns: str | Iterable[str] | None
    values: bool


def load_demonstrations(
    paths: str | Path | Iterable[str | Path],
    *,
    rate: float | None = None,
    topic: str | None = None,
    frame: str | None = None,
    child_frame: str | None = None,
    publisher: str | None = None,
    element: int | None = None,
    integrate: Integrate | None = None,
    episode: int | Iterable[int] | None = None,
    columns: str | Iterable[str] | None = None,
    values: bool = False,
    channels: str | Iterable[str] | None = None,
    time: str | None = None,
    units: str | Iterable[str] | None = None,
    rotation: str | None = None,
    robot: Kinematics | None = None,
    gaps: Gaps = "refuse",
    duplicates: Duplicates = "refuse",
    unsorted: Unsorted = "refuse",
    lost: Lost = "refuse",
    within: Interval | None = None,
) -> list[Any]:
    """Read recordings of a motion, one trajectory a file, or one an episode.

    Poses become :class:`noslip.PoseTrajectory`; what is no pose becomes :class:`noslip.Trajectory`:
    columns that are named and are no pose, such as joints; a table of nothing but times and
    ``x,y,z``; what :meth:`noslip.Trajectory.to_npz` wrote.

    Parameters
    ----------
    paths : path, glob or iterable of them
        ``"runs/*.csv"``, say.  A glob gives its files sorted, ``**`` goes through folders, ``~``
        is the home folder.  A path that exists is taken as it is, even one that reads like a
        glob.  A file given twice is read once.
    rate : float, optional
        Samples per second of CSV files and tables that number their samples (column ``i``)
        instead of stamping them (sample ``i`` is then at ``i / rate`` seconds), of tables without
        times, and of robomimic files.  A table with stamps warns that it is not used; beside
        ``time`` it says that this column numbers the samples.
    topic, frame, child_frame, publisher, element, integrate : optional
        Of ROS bags: where the poses are, see :func:`noslip.recordings.bags.read_bag`.
    episode : int or iterable of int, optional
        Of LeRobot data sets and robomimic files; by default all.
    columns : str or iterable of str, optional
        Of data sets and tables: where the pose is, names separated by commas, position first, such
        as ``"px,py,pz,qw,qx,qy,qz"``.  Of a column that holds several numbers all of them, or those
        in brackets, by places from 0, slices or names: ``"observation.state[0:3,6,3:6]"``.  Of a
        table without a header, the numbers of its columns from 0.  Or what the names of one of
        several poses begin with: ``"left_arm"``.
        Numbers that are no pose (their names are those of joints, or their count is none of a
        pose and they hold no position with angles beside) are read as they are, in the units that
        their names state (``fx [N]``), degrees and millimeters as radians and meters.
    values : bool
        Read columns as they are, whatever they are; without ``columns`` LeRobot's
        ``observation.state``, or all columns of a table that hold numbers.  Of ROS bags: read a
        topic of ``sensor_msgs/JointState``, of which ``columns`` are joints.
    channels : str or iterable of str, optional
        Of tables and data sets: columns to read beside the pose, as they are: a gripper, a wrench,
        a stiffness.
    time : str, optional
        Of tables: the column of time, or two of seconds and nanoseconds, ``"sec,nanosec"``.
    units : str or iterable of str, optional
        Of tables and data sets: the unit of their times (``s``, ``ms``, ``us``, ``ns``) and that
        of their lengths (``m``, ``cm``, ``mm``, ``in``), if they do not state them: ``"ms,mm"``;
        ``deg`` or ``rad`` where ``rotation`` leaves it open.
    rotation : str, optional
        Of tables and data sets: how a rotation is written.  ``wxyz`` or ``xyzw`` (quaternions),
        ``rotvec``, ``rpy``, ``euler:ZYX`` (capitals: about the moving axes; small letters: about
        the fixed ones; any order), ``matrix:rows``, ``matrix:columns`` (of 3 x 3, or with the
        position 3 x 4 or 4 x 4), ``planar``; followed by ``:deg`` if angles are in degrees.
    robot : Robot or Chain, optional
        Of tables and data sets that hold joints: the pose is that of the tool of this robot (of
        :mod:`noslip.robots`).  Joints are found by its names, as ``q1``, ``q2``, ..., or as a
        column of as many numbers; ``columns`` lists them otherwise.  With ``values``, they are
        read as they are, and are known to carry its tool.
    gaps : "refuse", "split" or "interpolate"
        More than 10 median periods without a sample: make a recording of each piece, or fill it
        with samples at the median period, on the straight line and the shortest turn.
    duplicates : "refuse", "first" or "last"
        Which of two poses at one time to keep.
    unsorted : "refuse", "sort" or "split"
        Time that runs backwards: sort the samples, or make a recording of each piece.
    lost : "refuse" or "drop"
        Leave out samples without a pose: numbers that are not finite, quaternions that are zero,
        and poses that stand still for three samples or more and then jump, as trackers hold them
        that have lost the tool (these draw a warning where they are not left out).
    within : pair of float or None, optional
        Start and end (s, on the recording's clock; None leaves one open) of the time that must be
        whole: what lies outside is kept up to the first fault, for the filter of
        :func:`noslip.prepare`, whose ``trim_time`` cuts it off.

    Returns
    -------
    list of PoseTrajectory or Trajectory
        In the order given.  ``name`` is the file's path as given or found, followed by the
        episode, and the part, where there are several.

    Warns
    -----
    RecordingWarning
        If stamps, period, speed, turn rate or size are hardly those of a tool in seconds, meters
        and radians; of samples that were left out, sorted or filled in, and where to look first.

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

    A table of nothing but times and a quaternion is an orientation, which turns about the origin.

    **npz**: arrays ``times`` (N,), ``positions`` (N, 3) and ``quaternions`` (N, 4; scalar first),
    and if there ``linear_velocities`` and ``angular_velocities`` (N, 3; m/s, rad/s, world frame),
    ``channels`` (N, k), ``channel_names`` and ``channel_units`` (k texts).  Or, of vectors,
    ``times``, ``values`` (N, n), and if there ``velocities``, ``names`` and ``units``.

    ===================================== ===================================================
    other files                           what is read
    ===================================== ===================================================
    ``.bag``, ``.mcap``, ``.db3``, a      ROS bags: poses, transforms, odometry, paths, tf;
    folder with ``metadata.yaml``         :mod:`noslip.recordings.bags`
    a folder with ``meta/info.json``      LeRobot data set; :mod:`noslip.recordings.lerobot`
    ``.hdf5``, ``.h5``                    robomimic; :mod:`noslip.recordings.robomimic`
    ``.parquet``, ``.feather``            a CSV's columns; :mod:`noslip.recordings.tables`
    ``.tum``, ``.txt``                    ``t x y z qx qy qz qw``; :mod:`noslip.recordings.tum`
    ===================================== ===================================================

    A quaternion and its negative are the same rotation.  Quaternions are normalized.  A sample
    that repeats the time and the pose of the one before (to 1e-9) is dropped.
    """
    mending = Mending(gaps=gaps, duplicates=duplicates, unsorted=unsorted, lost=lost, within=within)
    options = {
        "rate": rate,
        "topic": topic,
        "frame": frame,
        "child_frame": child_frame,
        "publisher": publisher,
        "element": element,
        "integrate": integrate,
        "episode": list(episode) if isinstance(episode, Iterable) else episode,
        "columns": _joined(columns),
        "values": values or None,
        "channels": _joined(channels),
        "time": time,
        "units": units,
        "rotation": rotation,
        "robot": robot,
    }
    found = [trajectory for _, trajectory in loaded(paths, options, mending)]
    if robot is None or not values:
        return found
    chain = robot if isinstance(robot, Chain) else Supplied.functions["robots.chain"](robot)
    return [each.on(chain) for each in found]


def load_trajectory(
    path: str | Path, columns: str | Iterable[str] | None = None, **options: Unpack[Reading]
) -> Trajectory:
    """Read columns of one recording as they are: joints, a planar point, a gripper.

    Parameters
    ----------
    path : path
    columns : str or iterable of str, optional
        As for :func:`load_demonstrations` with ``values``.
    **options
        Of :func:`load_demonstrations`: ``rate``, ``time``, ``units``, ``topic``, ``episode``, ...

    Raises
    ------
    InputError
        If there are several, or for what :func:`load_demonstrations` refuses.
    """
    found = load_demonstrations(path, columns=columns, values=True, **options)
    if len(found) > 1:
        names = listed([each.name for each in found], str)
        raise RecordingError(
            f"{path}: {len(found)} recordings, {names}; choose one (episode=...), or read all with "
            "load_demonstrations(..., values=True)"
        )
    read: Trajectory = found[0]
    return read


def _joined(columns: str | Iterable[str] | None) -> str | None:
    return columns if columns is None or isinstance(columns, str) else ",".join(columns)


def loaded(
    paths: str | Path | Iterable[str | Path], options: dict[str, Any], mending: Mending
) -> Iterator[tuple[Samples, Any]]:
    """Yield what a file holds and the trajectory that comes of it, or of each of its pieces."""
    for samples in read_samples(paths, options):
        for piece in samples.mended(mending):
            kind = Trajectory if piece.names else PoseTrajectory
            trajectory = kind.of_samples(piece)
            ask_after_units(trajectory, clock_said=piece.clock_said)
            yield piece, trajectory


def read_samples(
    paths: str | Path | Iterable[str | Path], options: dict[str, Any]
) -> Iterator[Samples]:
    """Yield what is in recordings, unchecked; the options are those of their formats."""
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    files: dict[Path, Path] = {}
    for path in given:
        for file in expand(path):
            files.setdefault(file.resolve(), file)
    if not files:
        raise RecordingError("no demonstrations given; give at least one file, such as runs/*.csv")
    formats = {file: format_of(file) for file in files.values()}
    _refuse_ignored(options, formats)
    for file, each in formats.items():
        yield from each.read(file, **{name: options.get(name) for name in each.options})


def expand(path: str | Path) -> list[Path]:
    """Return the recordings that a path or glob stands for."""
    try:
        literal = Path(os.path.expanduser(path))  # noqa: PTH111 - pathlib's raises without a home
    except RuntimeError as error:
        raise RecordingError(f"{path}: the home folder is unknown; give the path itself") from error
    if literal.is_dir() and folder_format(literal) is None:
        raise InputError(f"{path}: a folder, not a file; give {Path(path) / '*.csv'}")
    if literal.exists():
        return [literal]
    if not glob.has_magic(str(literal)):
        raise InputError(f"{path}: no such file; check the path")
    # Path.glob takes no absolute pattern, and it matches hidden files.
    names = sorted(glob.glob(str(literal), recursive=True))  # noqa: PTH207
    matches = map(Path, names)
    files = [match for match in matches if not match.is_dir() or folder_format(match)]
    if not files:
        raise InputError(f"{path}: no file matches; check the folder and the pattern")
    return files


def folder_format(folder: Path) -> Format | None:
    """Return the format of the recording that a folder is, or None if it is none."""
    return next((each for each in FORMATS if each.is_folder(folder)), None)


def is_recording(path: Path) -> bool:
    """Whether a path is there and is what a recording is called, whatever may be in it."""
    if path.is_dir():
        return folder_format(path) is not None
    return path.exists() and path.suffix.lower() in _BY_SUFFIX


def format_of(file: Path) -> Format:
    """Return the format of a file or folder, or refuse it."""
    found = folder_format(file) if file.is_dir() else _BY_SUFFIX.get(file.suffix.lower())
    if found is None and file.suffix.lower() == ".json":
        raise RecordingError(
            f"{file}: JSON holds primitives, not recordings; noslip rollout {quote(str(file))} "
            "--out motion.csv writes a primitive's motion as one"
        )
    if found is None:
        folders = " and ".join(each.folders for each in reversed(FORMATS) if each.folders)
        raise RecordingError(
            f"{file}: {file.suffix or 'no suffix'} is not a known kind of recording; "
            f"known are {', '.join(_BY_SUFFIX)}, and the folders of {folders}"
        )
    return found


def _refuse_ignored(options: dict[str, Any], formats: dict[Path, Format]) -> None:
    """Refuse an option that none of the files takes; a rate may be given for files with stamps."""
    for name, value in options.items():
        taken = any(name in each.options for each in formats.values())
        if value is not None and name != "rate" and not taken:
            wanted = [each.name for each in FORMATS if name in each.options]
            *others, last = wanted
            listed = f"{', '.join(others)} or {last}" if others else last
            raise RecordingError(
                f"{next(iter(formats))}: {name}={value!r} is for {listed}; leave it out"
            )


def write_recording(
    trajectory: PoseTrajectory | Series,
    path: str | Path,
    *,
    frame: str = "world",
    topic: str = "/pose",
    twist: Twist | None = None,
    planar: bool = False,
    wheels: Mapping[str, float] | None = None,
) -> Path:
    """Write a trajectory in the format that the suffix names; return the path.

    Channels beside the poses are written where the format has a place for them: as columns, as
    arrays, as topics of a bag (see :func:`write_bag`).

    Parameters
    ----------
    trajectory : PoseTrajectory or Trajectory
        Vectors go into ``.csv``, ``.npz``, ``.parquet``, ``.feather`` and bags.
    path : path
        ``.csv``, ``.npz`` (with velocities), ``.tum``, ``.parquet``, ``.feather``, ``.mcap``, or
        without suffix for the folder of a ROS 2 bag (SQLite).
    frame, topic : str
        Of the ``geometry_msgs/PoseStamped`` messages in a bag or MCAP file.
    twist : "body" or "world", optional
        Of CSV and tables: add ``vx, vy, vz, wx, wy, wz``, the twist to command at each sample
        until the next, zero at the last; of planar motions ``v`` and ``omega``.  Of bags:
        ``geometry_msgs/TwistStamped`` on ``/twist``.
    planar : bool
        Of CSV and tables: ``x, y, theta`` instead of the pose.
    wheels : mapping, optional
        Of CSV and tables: ``track`` and ``radius`` of a differential drive (m); the motion is
        planar, and the wheels' speeds ``left`` and ``right`` (rad/s) are added.  See
        :func:`noslip.recordings.twists.motion_columns`.

    Raises
    ------
    MissingDependencyError
        Without the extra that the format needs.
    InputError
        If the suffix is another, it has no place for what is asked, the motion is not planar and
        should be, the file cannot be written, or :func:`write_bag` refuses.
    """
    target = Path(path)
    chosen = WRITTEN.get(target.suffix.lower())
    if chosen is None or chosen.write is None:
        raise InputError(
            f"{target}: cannot write {target.suffix}; known are {listed_suffixes(WRITTEN)}"
        )
    if isinstance(trajectory, Series) and target.suffix.lower() == ".tum":
        raise InputError(f"{target}: TUM's format holds poses alone; write a CSV")
    options = {
        "frame": frame,
        "topic": topic,
        "twist": twist,
        "planar": planar,
        "wheels": wheels,
    }
    for name in VELOCITIES:
        if options[name] and isinstance(trajectory, Series):
            raise InputError(f"{target}: {name} is of poses, and these are none; leave it out")
        if options[name] and name not in chosen.write_options:
            raise InputError(
                f"{target}: {chosen.name} has no place for {name}; leave it out, or write a CSV"
            )
    return chosen.write(
        trajectory, target, **{name: options[name] for name in chosen.write_options}
    )


def write_joints(
    times: ArrayLike,
    names: Sequence[str],
    positions: ArrayLike,
    velocities: ArrayLike | None,
    path: str | Path,
) -> Path:
    """Write the motion of joints as CSV, or as ``sensor_msgs/JointState`` in a ROS 2 bag.

    Parameters
    ----------
    times : array, shape (N,)
        Seconds, increasing.
    names : sequence of str, length J
        Of the joints.
    positions, velocities : array, shape (N, J)
        Radians (meters of a sliding joint), and per second; the latter None where unknown.
    path : path
        ``.csv``: columns ``t``, the names, and the names with ``_velocity``.  ``.mcap``, or
        without suffix for the folder of a ROS 2 bag: see :func:`write_bag`.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, times do not increase, or the suffix is another.
    """
    target = Path(path)
    if target.suffix.lower() in BAG.written:
        return write_bag(
            target,
            joint_names=names,
            joint_times=times,
            joint_positions=positions,
            joint_velocities=velocities,
        )
    if target.suffix.lower() != ".csv":
        raise InputError(
            f"{target}: cannot write joints as {target.suffix}; known are "
            f"{listed_suffixes(('.csv', *BAG.written))}"
        )
    stamps, angles, rates = checked_joints(target, names, times, positions, velocities)
    header = ["t", *names]
    table = [stamps[:, None], angles]
    if rates is not None:
        header += [f"{name}_velocity" for name in names]
        table.append(rates)
    return write_beside(target, numbers_text(header, np.column_stack(table)).encode())
