"""ROS bags: the poses of one topic, or of one frame in another through tf."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from noslip._extras import need
from noslip._pose_checks import require_few
from noslip._samples import Samples
from noslip.errors import InputError, RecordingError
from noslip.named_columns import listed
from noslip.recordings._format import Format
from noslip.recordings._reading import reading
from noslip.recordings.bag_writing import write_bag
from noslip.recordings.transforms import Key, Link, Series, links_text, resolve

METADATA = "metadata.yaml"
"""What the folder of every ROS 2 bag has, and is known by."""

PATH = "nav_msgs/msg/Path"
"""The type whose messages each hold a whole motion."""
TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""The types of links in a tree of frames, of ROS 2 and of ROS 1 before tf2."""
TYPES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
    PATH,
    *TF,
)
"""All that are read: the poses that ROS stamps."""

Stamped = tuple[Key, int, Any, Any]
"""Frames, stamp (ns), position and orientation as a message holds them."""


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag.

    Attributes
    ----------
    name : str
    type : str
        As ROS writes it, such as ``geometry_msgs/msg/PoseStamped``.
    messages : int
    frames : tuple of (str, str)
        Frame and child frame of the poses in it; the child frame is empty where messages do not
        name one.  None but of the types in ``TYPES``.
    """

    name: str
    type: str
    messages: int
    frames: tuple[Key, ...] = ()


def is_bag(folder: Path) -> bool:
    """Whether a folder is a ROS 2 bag."""
    return (folder / METADATA).is_file()


def bag_topics(path: str | Path) -> list[BagTopic]:
    """Return what is in a bag, by name of the topics.

    Parameters
    ----------
    path : path
        A ROS 1 bag (``.bag``), a ROS 2 bag (its folder) or an MCAP file.

    Raises
    ------
    MissingDependencyError
        Without rosbags (``noslip[bags]``).
    InputError
        If it cannot be read.
    """
    with _opened(Path(path)) as reader:
        return [
            BagTopic(
                name,
                ", ".join(sorted({c.msgtype for c in found.connections})),
                found.msgcount,
                tuple(_read(reader, name)) if _pose_type(reader, name) else (),
            )
            for name, found in sorted(reader.topics.items())
        ]


def read_bag(
    path: Path,
    *,
    topic: str | None = None,
    frame: str | None = None,
    child_frame: str | None = None,
) -> list[Samples]:
    """Read the poses of one topic of a bag.

    Parameters
    ----------
    path : Path
        A ROS 1 bag (``.bag``), a ROS 2 bag (its folder) or an MCAP file.
    topic : str, optional
        Needed where several hold poses.
    frame, child_frame : str, optional
        Of tf: the motion of ``child_frame`` in ``frame`` (by default the root of its tree), along
        the links between, see :func:`noslip.recordings.transforms.resolve`; a static topic
        (``/tf_static`` for ``/tf``) is read too.  Elsewhere only messages with these frames count.

    Raises
    ------
    MissingDependencyError
        Without rosbags (``noslip[bags]``).
    InputError
        If the topic or a frame is not there, or could be several (all are listed), or for what
        :func:`noslip.load_demonstrations` names.

    Notes
    -----
    Times are the headers' stamps; where all of a topic are zero, the times of the bag.  Of a
    topic of paths the last message counts: paths grow as they are published.
    """
    with _opened(path) as reader:
        name = _chosen_topic(path, reader, topic)
        where = f"{path}: {name}"
        series = _read(reader, name)
        if not series:
            raise RecordingError(f"{where}: no poses in it; record something first")
        if _pose_type(reader, name) in TF:
            static = f"{name}_static"
            links: dict[Key, Link] = {}
            if _pose_type(reader, static) in TF:
                fixed = _read(reader, static)
                links = {key: Link(f"{path}: {static}", one, True) for key, one in fixed.items()}
            links |= {key: Link(where, one, False) for key, one in series.items()}
            moved = resolve(str(path), where, links, frame, child_frame)
            return [moved]
        one = _one(where, series, frame, child_frame)
        if _pose_type(reader, name) == PATH and not any(one.stamps):
            raise RecordingError(f"{where}: the poses of the path carry no stamps, so no times")
        return [one.samples(str(path), where)]


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    if not path.exists():
        raise InputError(f"{path}: no such file; check the path")
    highlevel = need(path, "rosbags.highlevel", "bags")
    typesys = need(path, "rosbags.typesys", "bags")
    # Bags of ROS 2 before Iron do not carry the definitions of their messages.
    usual = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with (
        reading(path, "a ROS bag"),
        highlevel.AnyReader([path], default_typestore=usual) as reader,
    ):
        yield reader


def _chosen_topic(path: Path, reader: Any, topic: str | None) -> str:
    found: dict[str, str | None] = {name: _pose_type(reader, name) for name in reader.topics}
    holding = [
        name
        for name, kind in found.items()
        if kind and not (kind in TF and name.endswith("_static"))
    ]
    if topic is None and len(holding) == 1:
        return holding[0]
    choices = ", ".join(
        f"{name} ({_short(str(found[name]))}, {reader.topics[name].msgcount})"
        for name in sorted(holding)
    )
    if topic is None:
        if not holding:
            raise RecordingError(
                f"{path}: no topic of poses, found {listed(sorted(found))}; known are "
                f"{', '.join(map(_short, TYPES))}"
            )
        raise RecordingError(
            f'{path}: several topics hold poses; choose one with topic="..." (--topic): {choices}'
        )
    for name in (topic, f"/{topic}"):
        if found.get(name):
            return name
    problem = (
        f"no topic {topic}"
        if topic not in found
        else f"topic {topic} holds {_short(', '.join(_types(reader, topic)))}, no poses"
    )
    raise RecordingError(f"{path}: {problem}; those with poses are {choices or 'none'}")


def _types(reader: Any, topic: str) -> list[str]:
    return sorted({connection.msgtype for connection in reader.topics[topic].connections})


def _pose_type(reader: Any, topic: str) -> str | None:
    """Return the type of a topic that is there and holds poses."""
    if topic not in reader.topics:
        return None
    return next((kind for kind in _types(reader, topic) if kind in TYPES), None)


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _read(reader: Any, topic: str) -> dict[Key, Series]:
    """Return the poses of a topic, those between different frames apart."""
    kind = _pose_type(reader, topic)
    connections = [c for c in reader.topics[topic].connections if c.msgtype == kind]
    messages = reader.messages(connections)
    if kind == PATH:
        messages = deque(messages, maxlen=1)
    series: dict[Key, Series] = {}
    for _, received, raw in messages:
        for key, stamp, position, orientation in _poses(reader.deserialize(raw, kind), kind):
            one = series.setdefault(key, Series())
            require_few(topic, len(one.stamps) + 1)
            one.stamps.append(stamp)
            one.received.append(received)
            one.positions.append((position.x, position.y, position.z))
            one.quaternions.append((orientation.w, orientation.x, orientation.y, orientation.z))
    return series


def _poses(message: Any, kind: str | None) -> Iterator[Stamped]:
    match kind:
        case "geometry_msgs/msg/PoseStamped":
            yield _pose(message.header, "", message.pose)
        case "nav_msgs/msg/Odometry":
            yield _pose(message.header, message.child_frame_id, message.pose.pose)
        case "nav_msgs/msg/Path":
            for pose in message.poses:
                _, *of_pose = _pose(pose.header, "", pose.pose)
                yield (_frame(message.header.frame_id), ""), *of_pose
        case "geometry_msgs/msg/TransformStamped":
            yield _transform(message)
        case _:
            yield from map(_transform, message.transforms)


def _stamped(header: Any, child_frame: str, position: Any, orientation: Any) -> Stamped:
    stamp = int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
    return (_frame(header.frame_id), _frame(child_frame)), stamp, position, orientation


def _transform(message: Any) -> Stamped:
    moved = message.transform
    return _stamped(message.header, message.child_frame_id, moved.translation, moved.rotation)


def _pose(header: Any, child_frame: str, pose: Any) -> Stamped:
    return _stamped(header, child_frame, pose.position, pose.orientation)


def _frame(name: str) -> str:
    # ROS 1 let frames begin with a slash; tf2 drops it.
    return name.lstrip("/")


def _one(
    where: str, series: dict[Key, Series], frame: str | None, child_frame: str | None
) -> Series:
    """Return the poses between the frames asked for."""
    matching = [
        key
        for key in series
        if (frame is None or key[0] == _frame(frame))
        and (child_frame is None or key[1] == _frame(child_frame))
    ]
    if len(matching) == 1:
        return series[matching[0]]
    found = links_text(series)
    if not matching:
        asked = " in ".join(name for name in (child_frame, frame) if name is not None)
        raise RecordingError(f"{where}: no poses of frame {asked}; it holds {found}")
    raise RecordingError(
        f'{where}: poses between several frames; choose with frame="..." and child_frame="..." '
        f"(--frame, --child-frame): {found}"
    )


BAG = Format(
    name="a ROS bag",
    read=read_bag,
    options=("topic", "frame", "child_frame"),
    suffixes=(".bag", ".mcap", ".db3"),
    folders="ROS 2 bags",
    is_folder=is_bag,
    write=lambda trajectory, path, **named: write_bag(path, poses=trajectory, **named),
    write_options=("frame", "topic"),
    written=(".mcap", ""),
    extra="bags",
)
"""Of ROS 1 (``.bag``) or ROS 2: a folder, or one of its files."""
