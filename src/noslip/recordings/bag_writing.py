"""Poses, twists and joints -> ROS 2 bags."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from noslip._extras import need
from noslip._files import locked, scratch, write_beside
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.recordings._bag_files import METADATA
from noslip.recordings.joints import checked_joints
from noslip.recordings.twists import Twist, twists
from noslip.series import Series
from noslip.trajectory import PoseTrajectory

Storage = Literal["sqlite3", "mcap"]

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Channels that are a wrench: N and N m."""
WRENCH_TOPIC, CHANNELS_TOPIC = "/wrench", "/channels"
"""Where channels are written."""
_LAST_STAMP = 2**31
"""Seconds; ROS stores them as int32."""
_BAG_VERSION = 8
"""Of the metadata: it keeps profiles of service as text, which ROS 2 from Humble on understands."""


def write_bag(
    path: str | Path,
    *,
    poses: PoseTrajectory | None = None,
    joint_names: Sequence[str] = (),
    joint_times: ArrayLike | None = None,
    joint_positions: ArrayLike | None = None,
    joint_velocities: ArrayLike | None = None,
    frame: str = "world",
    topic: str = "/pose",
    joint_topic: str = "/joint_states",
    storage: Storage = "sqlite3",
    twist: Twist | None = None,
    twist_topic: str = "/twist",
    body_frame: str = "tool",
) -> Path:
    """Write poses, joints or both as a ROS 2 bag, which ``ros2 bag play`` replays.

    Parameters
    ----------
    path : path
        The bag's folder, which must not exist yet; or a file ``.mcap``, which is a bag by itself.
    poses : PoseTrajectory, optional
        Written to ``topic`` as ``geometry_msgs/PoseStamped`` in ``frame``.  Its channels
        ``fx, fy, fz, tx, ty, tz``, if all are there, are a ``geometry_msgs/WrenchStamped`` in
        ``body_frame`` on ``/wrench``; all others are the positions of a ``sensor_msgs/JointState``
        on ``/channels``, whose names hold their units: ``stiffness [N/m]``.
    joint_names : sequence of str, length J
    joint_times : array, shape (N,), optional
        Seconds, increasing, on the clock of ``poses``.
    joint_positions, joint_velocities : array, shape (N, J), optional
        Written to ``joint_topic`` as ``sensor_msgs/JointState``; radians (meters of a sliding
        joint), and per second.
    frame, topic, joint_topic : str
    storage : {"sqlite3", "mcap"}
        Of a folder.
    twist : "body" or "world", optional
        Write what to command at each sample until the next, see
        :func:`noslip.recordings.twists.twists`, to ``twist_topic`` as
        ``geometry_msgs/TwistStamped``: in ``body_frame``, which moves with the tool, or ``frame``.
    twist_topic, body_frame : str

    Raises
    ------
    MissingDependencyError
        Without rosbags (``noslip[bags]``).
    InputError
        If there is nothing to write or something at the path, times are not those of ROS (0 up to
        2^31 s, at least a nanosecond apart), or joints are as :func:`write_joints` refuses them.
    """
    target = Path(path)
    bare = target.suffix.lower() == ".mcap"
    if storage not in ("sqlite3", "mcap"):
        raise InputError(f"{target}: storage must be sqlite3 or mcap, got {storage!r}")
    if poses is None and joint_positions is None:
        raise InputError(f"{target}: nothing to write; give poses, joint_positions or both")
    if twist is not None and poses is None:
        raise InputError(f"{target}: twist={twist!r} is that of poses; give them or leave it out")
    taken = f"{target}: exists already; remove it or give another name"
    if target.exists() and (target.is_dir() or not bare):
        raise InputError(taken)
    rosbag2 = need(target, "rosbags.rosbag2", "bags")
    typesys = need(target, "rosbags.typesys", "bags")
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    messages: list[tuple[int, str, Any]] = []
    if poses is not None:
        stamps = _stamps(target, poses.times)
        messages += _pose_messages(types, poses, stamps, frame, topic)
        if poses.channels is not None:
            messages += _channel_messages(target, types, poses.channels, stamps, body_frame)
        if twist is not None:
            named = body_frame if twist == "body" else frame
            messages += _twist_messages(types, twists(poses, twist), stamps, named, twist_topic)
    if joint_positions is not None:
        joints = checked_joints(target, joint_names, joint_times, joint_positions, joint_velocities)
        messages += _joint_messages(target, types, joint_names, *joints, joint_topic)
    plugins = rosbag2.StoragePlugin
    plugin = plugins.MCAP if bare or storage == "mcap" else plugins.SQLITE3
    try:
        with scratch() as beside:
            # A bag names its files after its folder, so the folder has its final name already.
            folder = beside / (target.stem if bare else target.name)
            with rosbag2.Writer(folder, version=_BAG_VERSION, storage_plugin=plugin) as writer:
                connections: dict[str, Any] = {}
                for stamp, name, message in sorted(messages, key=lambda each: each[0]):
                    kind = message.__msgtype__
                    if name not in connections:
                        connections[name] = writer.add_connection(name, kind, typestore=types)
                    data = types.serialize_cdr(message, kind)
                    writer.write(connections[name], stamp, data)
            if bare:
                write_beside(target, (folder / f"{folder.name}.mcap").read_bytes())
            else:
                _put(folder, target, taken)
    except (OSError, rosbag2.WriterError) as error:
        raise InputError(f"{target}: cannot be written: {error}") from error
    return target


def _put(folder: Path, target: Path, taken: str) -> None:
    """Copy a bag to its place; what makes a folder a bag comes last."""
    with locked(target, wait=False):
        if any(target.iterdir()):  # another process was faster
            raise InputError(taken)
        try:
            for file in sorted(folder.iterdir(), key=lambda each: each.name == METADATA):
                write_beside(target / file.name, file.read_bytes())
        except BaseException:
            shutil.rmtree(target, ignore_errors=True)
            raise


def _pose_messages(
    types: Any, poses: PoseTrajectory, stamps: list[int], frame: str, topic: str
) -> list[tuple[int, str, Any]]:
    pose, point, quaternion, stamped = (
        types.types[f"geometry_msgs/msg/{name}"]
        for name in ("Pose", "Point", "Quaternion", "PoseStamped")
    )
    scalar_last = np.roll(poses.quaternions, -1, axis=1).tolist()
    rows = zip(stamps, poses.positions.tolist(), scalar_last, strict=True)
    return [
        (
            stamp,
            topic,
            stamped(_header(types, stamp, frame), pose(point(*place), quaternion(*turn))),
        )
        for stamp, place, turn in rows
    ]


def _twist_messages(
    types: Any, rows: Floats, stamps: list[int], frame: str, topic: str
) -> list[tuple[int, str, Any]]:
    both, vector, stamped = (
        types.types[f"geometry_msgs/msg/{name}"] for name in ("Twist", "Vector3", "TwistStamped")
    )
    return [
        (
            stamp,
            topic,
            stamped(_header(types, stamp, frame), both(vector(*row[:3]), vector(*row[3:]))),
        )
        for stamp, row in zip(stamps, rows.tolist(), strict=True)
    ]


def _channel_messages(
    target: Path, types: Any, channels: Series, stamps: list[int], frame: str
) -> list[tuple[int, str, Any]]:
    """Return a wrench, and what else there is as named numbers."""
    both, vector, stamped = (
        types.types[f"geometry_msgs/msg/{name}"] for name in ("Wrench", "Vector3", "WrenchStamped")
    )
    messages: list[tuple[int, str, Any]] = []
    rest = [k for k, name in enumerate(channels.names) if name not in WRENCH]
    if set(WRENCH) <= set(channels.names):
        rows = np.column_stack([channels.column(name) for name in WRENCH]).tolist()
        messages = [
            (
                stamp,
                WRENCH_TOPIC,
                stamped(_header(types, stamp, frame), both(vector(*row[:3]), vector(*row[3:]))),
            )
            for stamp, row in zip(stamps, rows, strict=True)
        ]
    else:
        rest = list(range(len(channels.names)))
    if rest:
        names = [f"{channels.names[k]} [{channels.units[k]}]" for k in rest]
        values = np.ascontiguousarray(channels.values[:, rest])
        messages += _joint_messages(
            target, types, names, channels.times, values, None, CHANNELS_TOPIC
        )
    return messages


def _joint_messages(
    target: Path,
    types: Any,
    names: Sequence[str],
    times: Floats,
    positions: Floats,
    velocities: Floats | None,
    topic: str,
) -> list[tuple[int, str, Any]]:
    state = types.types["sensor_msgs/msg/JointState"]
    unknown = np.empty(0)
    rates = [unknown] * len(times) if velocities is None else list(velocities)
    return [
        (stamp, topic, state(_header(types, stamp, ""), list(names), angles, rate, unknown))
        for stamp, angles, rate in zip(_stamps(target, times), positions, rates, strict=True)
    ]


def _header(types: Any, stamp: int, frame: str) -> Any:
    time = types.types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    return types.types["std_msgs/msg/Header"](time, frame)


def _stamps(target: Path, times: Floats) -> list[int]:
    """Return times in nanoseconds."""
    if times[0] < 0 or times[-1] >= _LAST_STAMP:
        raise InputError(
            f"{target}: times from {times[0]:g} to {times[-1]:g} s; stamps of ROS go from 0 to "
            f"{_LAST_STAMP} s, shift the times"
        )
    # The product of the whole time would round by some 100 ns in stamps since 1970.
    stamps = [int(time) * 10**9 + round(time % 1 * 10**9) for time in times.tolist()]
    if any(after <= before for before, after in pairwise(stamps)):
        raise InputError(f"{target}: samples less than a nanosecond apart; resample first")
    return stamps
