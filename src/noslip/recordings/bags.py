"""ROS bags: the poses of one topic, or of one frame in another through tf."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from noslip._extras import need
from noslip._pose_checks import Source, require_few
from noslip._samples import Samples
from noslip.errors import (
    InputError,
    NoslipError,
    RecordingError,
    RecordingWarning,
    did_you_mean,
    warn,
)
from noslip.named_columns import listed
from noslip.recordings._bag_files import METADATA, Channel, records, unfinished
from noslip.recordings._format import Format
from noslip.recordings._reading import reading
from noslip.recordings.bag_writing import write_bag
from noslip.recordings.transforms import (
    Key,
    Link,
    Published,
    Series,
    integrated,
    links_text,
    merged,
    resolve,
)
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

Integrate = Literal["body", "world"]
"""In which frame the velocities of a topic of twists are."""

PATH = "nav_msgs/msg/Path"
"""The type whose messages each hold a whole motion."""
POSE = "geometry_msgs/msg/Pose"
"""The type without a header: neither a stamp nor a frame."""
TWIST = "geometry_msgs/msg/TwistStamped"
"""The type that is read as a motion only if that is asked for."""
JOINTS = ("sensor_msgs/msg/JointState",)
"""The type that holds joints."""
TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""The types of links in a tree of frames, of ROS 2 and of ROS 1 before tf2."""
TYPES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseArray",
    POSE,
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
    PATH,
    *TF,
)
"""All that hold poses."""

Stamped = tuple[Key, int, tuple[float, ...]]
"""Frames, stamp (ns), position and quaternion (scalar first), or linear and angular velocity."""
Topics = dict[str, dict[Channel, int]]
"""The channels of each topic, and how many messages each has."""


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
    publishers : tuple of str
        Who published it: names of nodes (ROS 1), or the topic's channels, counted from 1.
    """

    name: str
    type: str
    messages: int
    frames: tuple[Key, ...] = ()
    publishers: tuple[str, ...] = ()


def is_bag(folder: Path) -> bool:
    """Whether a folder is a ROS 2 bag."""
    return (folder / METADATA).is_file() or bool(unfinished(folder))


def bag_topics(path: str | Path) -> list[BagTopic]:
    """Return what is in a bag, by name of the topics.

    Parameters
    ----------
    path : path
        As for :func:`read_bag`.

    Warns
    -----
    RecordingWarning
        Of topics that cannot be read, and of a bag that was not closed.

    Raises
    ------
    MissingDependencyError
        Without rosbags (``noslip[bags]``).
    InputError
        If it cannot be read.
    """
    bag = Path(path)
    with reading(bag, "a ROS bag"):
        topics = _topics(bag)
        readers, unread = _readers(bag, topics)
        if unread:
            warn(f"{bag}: {unread}", RecordingWarning)
        frames: dict[str, dict[Key, None]] = {name: {} for name in topics}
        for channel, _, raw in _messages(bag, dict(readers)):
            if channel in readers:
                try:
                    found = list(_stamped(readers[channel](raw), channel.type))
                except Exception as error:  # one bad topic does not cost the others
                    del readers[channel]
                    warn(f"{bag}: {channel.topic} cannot be read ({error})", RecordingWarning)
                    continue
                frames[channel.topic].update((key, None) for key, *_ in found)
    return [
        BagTopic(
            name,
            ", ".join(sorted({channel.type for channel in channels})),
            sum(channels.values()),
            tuple(frames[name]),
            tuple(sorted({channel.publisher for channel in channels})),
        )
        for name, channels in sorted(topics.items())
    ]


def read_bag(
    path: Path,
    *,
    topic: str | None = None,
    frame: str | None = None,
    child_frame: str | None = None,
    publisher: str | None = None,
    element: int | None = None,
    integrate: Integrate | None = None,
    values: bool | None = None,
    columns: str | None = None,
) -> list[Samples]:
    """Read the poses of one topic of a bag, or its joints.

    Parameters
    ----------
    path : Path
        A ROS 1 bag (``.bag``), the folder of a ROS 2 bag or a file of one (``.db3``, ``.mcap``, or
        these as ``.zstd``), or an MCAP file with messages of ROS 1 or 2.
    topic : str, optional
        Needed where several hold poses.
    frame, child_frame : str, optional
        Of tf: the motion of ``child_frame`` in ``frame`` (by default the root of its tree), along
        the links between, see :func:`noslip.recordings.transforms.resolve`; a static topic
        (``/tf_static`` for ``/tf``) is read too.  Elsewhere only messages with these frames count.
    publisher : str, optional
        Needed where the messages of several on one topic alternate: the name of the node (ROS 1),
        or the place of its channel among those of the topic, from 1.
    element : int, optional
        Which pose of a ``PoseArray``, from 0; needed where it holds several.
    integrate : "body" or "world", optional
        Read a topic of ``TwistStamped``: its velocities, in the frame of the body or of the world,
        integrated from the origin.  Each holds until the next message.
    values : bool, optional
        Read a topic of ``sensor_msgs/JointState``: the positions of joints (rad, or m of a sliding
        one).
    columns : str, optional
        Of these, names of the joints, separated by commas; by default those of the first message.
        Messages without them all, of another part of the robot, are passed over.

    Warns
    -----
    RecordingWarning
        Of a bag that was not closed, of topics that cannot be read (where none is named), of
        messages without stamps, and of transforms that tf2 would ignore.

    Raises
    ------
    MissingDependencyError
        Without rosbags (``noslip[bags]``).
    InputError
        If the topic, a frame, publisher or element is not there, or could be several (all are
        listed), or for what :func:`noslip.load_demonstrations` names.

    Notes
    -----
    Times are the headers' stamps; where all of a topic are zero, or there is none, the times of
    receipt.  Of a topic of paths the last message counts: paths grow as they are published.
    """
    if integrate is not None and integrate not in get_args(Integrate):
        raise InputError(f"integrate is one of {', '.join(get_args(Integrate))}; got {integrate!r}")
    with reading(path, "a ROS bag"):
        topics = _topics(path)
        if values or columns is not None:
            return [_joints(path, topics, topic, publisher, columns)]
        kinds = (TWIST,) if integrate else TYPES
        readers, unread = _readers(path, topics, kinds)
        name = _chosen(path, topics, readers, topic, unread)
        where = f"{path}: {name}"
        of_topic = [channel for channel in readers if channel.topic == name]
        kind = of_topic[0].type
        _require_publisher(where, topics[name], publisher)
        fixed = f"{name}_static"
        static = [c for c in readers if kind in TF and c.topic == fixed and c.type in TF]
        wanted = {channel: readers[channel] for channel in (*of_topic, *static)}
        found = _read(path, wanted, element)
        series = found.get(name, {})
        if not series:
            raise RecordingError(f"{where}: no poses in it; record something first")
        if kind in TF:
            links = {
                key: Link(f"{path}: {fixed}", one, True)
                for key, one in found.get(fixed, {}).items()
            }
            links |= {key: Link(where, one, False, publisher) for key, one in series.items()}
            moved = resolve(str(path), where, links, frame, child_frame)
            told = [
                f"{name} ({_short(kind)}), links {links_text(links)}: times the headers' stamps"
            ]
            return [replace(moved, understood=told)]
        one = merged(
            where, _one(where, series, frame, child_frame, publisher), publisher, kind == PATH
        )
        if not any(one.stamps):
            if kind == PATH:
                raise RecordingError(f"{where}: the poses of the path carry no stamps, so no times")
            what = "Pose has no stamp" if kind == POSE else "all stamps are zero"
            warn(f"{where}: {what}; times are those of receipt", RecordingWarning)
        frames = f" of frames {links_text(series)}" if any(map(any, series)) else ""
        clock = "the headers' stamps" if any(one.stamps) else "of receipt"
        told = [f"{name} ({_short(kind)}){frames}: times {clock}"]
        if integrate:
            return [replace(integrated(one, str(path), where, integrate), understood=told)]
        return [replace(one.samples(str(path), where), understood=told)]


def _joints(
    path: Path, topics: Topics, topic: str | None, publisher: str | None, columns: str | None
) -> Samples:
    """Read the positions of joints on one topic."""
    readers, unread = _readers(path, topics, JOINTS)
    name = _chosen(path, topics, readers, topic, unread, "joints")
    where = f"{path}: {name}"
    _require_publisher(where, topics[name], publisher)
    wanted = {
        channel: read
        for channel, read in readers.items()
        if channel.topic == name and publisher in (None, channel.publisher)
    }
    names = [] if columns is None else [one.strip() for one in columns.split(",")]
    seen: dict[str, None] = {}
    stamps, received, rows, own = [], [], [], dict[str, str]()
    for channel, at, raw in _messages(path, wanted):
        message = wanted[channel](raw)
        pairs = zip(map(_with_unit, message.name), message.position, strict=False)
        held, units = {}, {}
        for (each, unit), position in pairs:
            held[each], units[each] = position, unit
        seen |= dict.fromkeys(held)
        names = names or list(held)
        if held and set(names) <= set(held):
            stamp = message.header.stamp
            stamps.append(int(stamp.sec) * 10**9 + int(stamp.nanosec))
            received.append(at)
            rows.append([float(held[each]) for each in names])
            own = units
            require_few(where, len(rows))
    if not rows:
        asked = "positions of joints" if columns is None else f"joints {columns}"
        raise RecordingError(f"{where}: no message with {asked}; found {listed(seen, str)}")
    told = "the headers' stamps"
    if not any(stamps):
        warn(f"{where}: all stamps are zero; times are those of receipt", RecordingWarning)
        stamps, told = received, "of receipt"
    values = np.array(rows, dtype=np.float64)
    return Samples(
        name=str(path),
        source=Source(where, "stamp of the header", "positions of joints"),
        times=np.array(stamps) / 1e9,
        positions=values,
        quaternions=np.zeros((len(values), 0)),
        names=tuple(names),
        units=tuple(own[each] for each in names),
        understood=[f"{name} (sensor_msgs/JointState), {', '.join(names)}: times {told}"],
    )


def _with_unit(name: str) -> tuple[str, str]:
    """Return name and unit of a channel; a joint's message does not say whether it slides."""
    bare, bracket, unit = name.partition(" [")
    return (bare, unit[:-1]) if bracket and unit.endswith("]") else (name, "rad")


def _topics(path: Path) -> Topics:
    """Return the channels of a bag's topics, and how many messages each has."""
    if not path.exists():
        raise InputError(f"{path}: no such file; check the path")
    need(path, "rosbags.typesys", "bags")
    topics: Topics = {}
    for channel, _, data in records(path, partial(warn, category=RecordingWarning)):
        counts = topics.setdefault(channel.topic, {})
        counts[channel] = counts.get(channel, 0) + (data is not None)
    return topics


def _messages(path: Path, wanted: Collection[Channel]) -> Iterator[tuple[Channel, int, bytes]]:
    """Yield some channels' messages; of paths the last of each."""
    last: dict[Channel, tuple[int, bytes]] = {}
    # What is to be said of the file was said as its topics were counted.
    for channel, received, data in records(path, lambda _: None):
        if data is None or channel not in wanted:
            continue
        if channel.type == PATH:
            if channel not in last or received >= last[channel][0]:
                last[channel] = received, data
        else:
            yield channel, received, data
    yield from ((channel, *message) for channel, message in last.items())


Reader = Callable[[bytes], Any]


def _readers(
    path: Path, topics: Topics, kinds: Collection[str] = TYPES
) -> tuple[dict[Channel, Reader], str]:
    """Return what reads the messages of each channel of some types, and what is not read."""
    readers, unread = {}, []
    for name, channels in sorted(topics.items()):
        for channel in channels:
            if channel.encoding not in ("cdr", "ros1"):
                unread.append(f"{name} ({channel.type or 'no type'} in {channel.encoding or '?'})")
            elif channel.type in kinds:
                try:
                    readers[channel] = _reader(path, channel)
                except NoslipError:
                    raise
                except Exception:  # as of damaged files, no list of types would be complete
                    unread.append(f"{name} ({_short(channel.type)}, whose definition is damaged)")
    told = f"not read: {listed(unread, str)}; messages are read that ROS 1 or 2 wrote"
    return readers, told if unread else ""


def _reader(path: Path, channel: Channel) -> Reader:
    typesys = need(path, "rosbags.typesys", "bags")
    # Bags of ROS 2 before Iron do not carry the definitions of their messages.
    usual = "ROS1_NOETIC" if channel.encoding == "ros1" else "ROS2_HUMBLE"
    store = typesys.get_typestore(typesys.Stores["EMPTY" if channel.definition else usual])
    if channel.idl:
        mark = "=" * 80 + "\n"
        for part in channel.definition.removeprefix(mark).split(mark):
            text = part.partition("\n")[2] if part.startswith("IDL: ") else part
            store.register(typesys.get_types_from_idl(text))
    elif channel.definition:
        store.register(typesys.get_types_from_msg(channel.definition, channel.type))
    read = store.deserialize_ros1 if channel.encoding == "ros1" else store.deserialize_cdr
    return partial(_deserialized, read, channel.type)


def _deserialized(read: Callable[[bytes, str], Any], kind: str, raw: bytes) -> Any:
    return read(raw, kind)


def _chosen(
    path: Path,
    topics: Topics,
    readers: Collection[Channel],
    topic: str | None,
    unread: str,
    what: str = "poses",
) -> str:
    """Return the topic to read."""
    holding = {
        channel.topic: channel.type
        for channel in readers
        if not (channel.type in TF and channel.topic.endswith("_static"))
    }
    if unread and holding and topic is None:
        warn(f"{path}: {unread}", RecordingWarning)
    if topic is None and len(holding) == 1:
        return next(iter(holding))
    choices = ", ".join(
        f"{name} ({_short(kind)}, {sum(topics[name].values())})"
        for name, kind in sorted(holding.items())
    )
    if topic is None:
        if not holding:
            found, types = sorted(topics), TYPES if what == "poses" else JOINTS
            twists = [n for n in found if any(c.type == TWIST for c in topics[n])]
            hints = [f"{listed(twists)}: {_TWISTS}"] if twists else []
            hints += [unread] if unread else []
            raise RecordingError(
                f"{path}: no topic of {what}, found {listed(found)}; known are "
                f"{'; '.join([', '.join(map(_short, types)), *hints])}"
            )
        raise RecordingError(
            f'{path}: several topics hold {what}; choose one with topic="..." (--topic): {choices}'
        )
    known = {channel.topic for channel in readers}
    for name in (topic, f"/{topic}"):
        if name in known:
            return name
    if topic not in topics:
        problem = f"no topic {topic}{did_you_mean(topic, topics)}"
    else:
        kinds = sorted({channel.type for channel in topics[topic]})
        if kinds == [TWIST]:
            raise RecordingError(f"{path}: topic {topic} holds {_short(TWIST)}: {_TWISTS}")
        problem = f"topic {topic} holds {_short(', '.join(kinds))}, no {what}"
    raise RecordingError(f"{path}: {problem}; those with {what} are {choices or 'none'}")


_TWISTS = 'velocities, of which integrate="body" or "world" (--integrate) makes a motion'


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _read(
    path: Path, readers: Mapping[Channel, Reader], element: int | None
) -> dict[str, dict[Key, Published]]:
    """Return the poses of topics, those between different frames and of each publisher apart."""
    found: dict[str, dict[Key, Published]] = {}
    count = 0
    for channel, received, raw in _messages(path, readers):
        where = f"{path}: {channel.topic}"
        poses = list(_stamped(readers[channel](raw), channel.type))
        if channel.type.endswith("/PoseArray"):
            poses = [_element(where, poses, element)]
        count += len(poses)
        require_few(where, count)
        for key, stamp, numbers in poses:
            published = found.setdefault(channel.topic, {}).setdefault(key, {})
            published.setdefault(channel.publisher, Series(len(numbers))).append(
                stamp, received, numbers
            )
    return found


def _element(where: str, poses: list[Stamped], element: int | None) -> Stamped:
    if element is None and len(poses) == 1:
        return poses[0]
    if element is None or not 0 <= element < len(poses):
        raise RecordingError(
            f"{where}: arrays of {len(poses)} poses; choose one with element=K (--element), from 0"
        )
    return poses[element]


def _stamped(message: Any, kind: str) -> Iterator[Stamped]:
    """Yield the poses, or the twist, of a message."""
    match kind.rpartition("/")[2]:
        case "Pose":
            yield ("", ""), 0, _numbers(message.position, message.orientation)
        case "PoseStamped":
            yield _of(message.header, "", _pose(message.pose))
        case "PoseWithCovarianceStamped":
            yield _of(message.header, "", _pose(message.pose.pose))
        case "PoseArray":
            for pose in message.poses:
                yield _of(message.header, "", _pose(pose))
        case "Odometry":
            yield _of(message.header, message.child_frame_id, _pose(message.pose.pose))
        case "Path":
            for each in message.poses:
                _, stamp, numbers = _of(each.header, "", _pose(each.pose))
                yield (_frame(message.header.frame_id), ""), stamp, numbers
        case "TwistStamped":
            v, w = message.twist.linear, message.twist.angular
            yield _of(message.header, "", (v.x, v.y, v.z, w.x, w.y, w.z))
        case "TransformStamped":
            yield _transform(message)
        case _:
            yield from map(_transform, message.transforms)


def _of(header: Any, child_frame: str, numbers: tuple[float, ...]) -> Stamped:
    stamp = int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
    return (_frame(header.frame_id), _frame(child_frame)), stamp, numbers


def _transform(message: Any) -> Stamped:
    moved = message.transform
    numbers = _numbers(moved.translation, moved.rotation)
    return _of(message.header, message.child_frame_id, numbers)


def _pose(pose: Any) -> tuple[float, ...]:
    return _numbers(pose.position, pose.orientation)


def _numbers(p: Any, q: Any) -> tuple[float, ...]:
    return p.x, p.y, p.z, q.w, q.x, q.y, q.z


def _frame(name: str) -> str:
    # ROS 1 let frames begin with a slash; tf2 drops it.
    return name.lstrip("/")


def _require_publisher(where: str, channels: Collection[Channel], publisher: str | None) -> None:
    known = sorted({channel.publisher for channel in channels})
    if publisher is not None and publisher not in known:
        raise RecordingError(f"{where}: no publisher {publisher}; there are {', '.join(known)}")


def _one(
    where: str,
    series: dict[Key, Published],
    frame: str | None,
    child_frame: str | None,
    publisher: str | None,
) -> Published:
    """Return the poses between the frames asked for."""
    matching = [
        key
        for key in series
        if (frame is None or key[0] == _frame(frame))
        and (child_frame is None or key[1] == _frame(child_frame))
        and (publisher is None or publisher in series[key])
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


def _written(trajectory: PoseTrajectory | Trajectory) -> dict[str, Any]:
    """Return a trajectory as arguments of :func:`write_bag`: vectors are joints."""
    if isinstance(trajectory, PoseTrajectory):
        return {"poses": trajectory}
    return {
        "joint_names": trajectory.names,
        "joint_times": trajectory.times,
        "joint_positions": trajectory.values,
        "joint_velocities": trajectory.velocities,
    }


BAG = Format(
    name="a ROS bag",
    read=read_bag,
    options=(
        "topic",
        "frame",
        "child_frame",
        "publisher",
        "element",
        "integrate",
        "values",
        "columns",
    ),
    suffixes=(".bag", ".mcap", ".db3"),
    named_only=(".active", ".zstd"),
    folders="ROS 2 bags",
    is_folder=is_bag,
    write=lambda trajectory, path, **named: write_bag(path, **_written(trajectory), **named),
    write_options=("frame", "topic", "twist"),
    written=(".mcap", ""),
    extra="bags",
)
"""Of ROS 1 (``.bag``) or ROS 2: a folder, or one of its files."""
