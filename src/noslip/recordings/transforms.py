"""Trees of frames, as tf keeps them: one frame's motion in another."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from noslip._pose_checks import MAX_GAP, MAX_NORM_ERROR, MINIMUM_SAMPLES, SAME_POSE, Source
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError, RecordingWarning, did_you_mean, warn
from noslip.named_columns import listed

Key = tuple[str, str]
"""Frame and child frame; the latter is empty where a message names none."""


@dataclass
class Series:
    """What one publisher's messages hold between two frames; times in nanoseconds.

    Each takes ``width`` numbers: a position and a quaternion (7), or a twist (6).  Arrays hold
    them, since as Python's own objects a long recording would take ten times the memory.
    """

    width: int = 7
    stamps: array[int] = field(default_factory=lambda: array("q"))
    received: array[int] = field(default_factory=lambda: array("q"))
    numbers: array[float] = field(default_factory=lambda: array("d"))

    def append(self, stamp: int, received: int, numbers: tuple[float, ...]) -> None:
        """Add what a message holds."""
        self.stamps.append(stamp)
        self.received.append(received)
        self.numbers.extend(numbers)

    def times(self) -> Floats:
        """Return seconds: the headers' stamps, or where all are zero, when messages arrived."""
        # Division of whole numbers rounds once; seconds and nanoseconds apart would round twice.
        stamps = self.stamps if any(self.stamps) else self.received
        return np.array([stamp / 10**9 for stamp in stamps])

    def rows(self) -> Floats:
        """Return the numbers, one row a message."""
        return np.array(self.numbers).reshape(-1, self.width)

    def source(self, where: str) -> Source:
        """Return what they are called in messages."""
        stamps = "stamp of the header" if any(self.stamps) else "time in the bag"
        return Source(where, stamps, "orientation")

    def samples(self, name: str, where: str) -> Samples:
        """Return poses as the samples of a recording, unchecked."""
        rows = self.rows()
        return Samples(
            name=name,
            source=self.source(where),
            times=self.times(),
            positions=rows[:, :3],
            quaternions=rows[:, 3:],
        )


Published = dict[str, Series]
"""What each publisher sent."""


def merged(where: str, published: Published, publisher: str | None, whole: bool = False) -> Series:
    """Return the messages of one publisher, or of several that sent one after the other.

    Whole motions (paths) of several do not go on where another ends.

    Raises
    ------
    InputError
        If their messages alternate and none is chosen: all are listed.
    """
    if publisher in published:
        return _joined([published[publisher]])
    ordered = sorted(published.items(), key=lambda each: min(each[1].received))
    for (_, before), (_, after) in pairwise(ordered):
        if whole or min(after.received) <= max(before.received):
            raise RecordingError(
                f'{where}: several publish at once; choose one with publisher="..." '
                "(--publisher): "
                + ", ".join(f"{name} ({len(each.stamps)})" for name, each in sorted(ordered))
            )
    return _joined([one for _, one in ordered])


def _joined(parts: Sequence[Series]) -> Series:
    """Return messages in the order in which they came, which need not be that of the file."""
    received = np.concatenate([np.array(one.received) for one in parts])
    order = np.argsort(received, kind="stable")
    stamps = np.concatenate([np.array(one.stamps) for one in parts])[order]
    rows = np.concatenate([one.rows() for one in parts])[order]
    return Series(
        parts[0].width,
        array("q", stamps.tobytes()),
        array("q", received[order].tobytes()),
        array("d", rows.tobytes()),
    )


def integrated(series: Series, name: str, where: str, frame: str) -> Samples:
    """Return the motion from the origin whose twists messages hold, in the body's frame or the
    world's.

    Each twist holds until the next message, as :func:`noslip.recordings.twists.twists` writes them:
    of velocities that were measured, the motion is late by half a period.  Linear velocities of the
    body turn with it, and count as they are half way.
    """
    times, twists = series.times(), series.rows()
    steps = np.diff(times)[:, None] * twists[:-1]
    source = series.source(where)
    source.check_finite({"stamp": times, "twist": twists})
    rotation = Rotation.identity()
    rotations, moves = [rotation], np.zeros((len(times), 3))
    halves = Rotation.from_rotvec(steps[:, 3:] / 2)
    for k, half in enumerate(halves):
        if frame == "body":
            middle = rotation * half
            moves[k + 1] = middle.apply(steps[k, :3])
            rotation = middle * half
        else:
            moves[k + 1] = steps[k, :3]
            rotation = half * half * rotation
        rotations.append(rotation)
    return Samples(
        name=name,
        source=source,
        times=times,
        positions=np.cumsum(moves, axis=0),
        quaternions=Rotation.concatenate(rotations).as_quat(scalar_first=True),
        understood=(f"twists in the frame of the {frame}, integrated from the origin",),
    )


@dataclass(frozen=True)
class Link:
    """A link between two frames; of a static one the last message counts."""

    where: str
    published: Published
    static: bool
    publisher: str | None = None

    def poses(self, key: Key) -> tuple[Floats, Floats, Rotation]:
        """Return times, positions and rotations as tf2's buffer keeps them.

        That is by time, of two at one time the first (that of ROS 2 keeps both, and uses either),
        and without those that are not finite or whose quaternion is not of length 1.
        """
        where = f"{self.where}: {key[0]} -> {key[1]}"
        if self.static:
            series = _joined(list(self.published.values()))
        else:
            series = merged(where, self.published, self.publisher)
        source, times, rows = series.source(where), series.times(), series.rows()
        with np.errstate(over="ignore"):
            norms = np.linalg.norm(rows[:, 3:], axis=1)
        good = np.isfinite(rows).all(axis=1) & (np.abs(norms - 1) <= MAX_NORM_ERROR)
        if not good.any():
            source.check_finite({"position": rows[:, :3], "orientation": rows[:, 3:]})
            source.rotations(rows[:, 3:])
        _tell(where, ~good, "not finite, or with a quaternion that is not of length 1")
        times, rows = times[good], rows[good]
        if self.static:
            times, rows = times[-1:], rows[-1:]
        else:
            order = np.argsort(times, kind="stable")
            times, rows = times[order], rows[order]
            again = np.append(False, np.diff(times) == 0)
            moved = np.abs(np.diff(rows, axis=0, prepend=rows[:1])).max(axis=1) > SAME_POSE
            _tell(where, again & moved, "at the time of another, which came first")
            times, rows = times[~again], rows[~again]
            if len(times) < 2:
                raise RecordingError(f"{where}: one transform, so no motion; record more")
        return times, rows[:, :3], source.rotations(rows[:, 3:])


def _tell(where: str, ignored: NDArray[np.bool_], why: str) -> None:
    if count := int(np.sum(ignored)):
        warn(
            f"{where}: {count} of {len(ignored)} transforms ignored, as tf2 does: {why}",
            RecordingWarning,
        )


def resolve(
    name: str, where: str, links: Mapping[Key, Link], frame: str | None, child_frame: str | None
) -> Samples:
    """Return the motion of one frame in another.

    The links on the way are composed, inverted where they point the other way.  Samples lie at
    the stamps of the link that has most of them, in the time that all moving links cover; between
    its own stamps a link is interpolated as tf2 does it, positions linearly and rotations along
    the shortest turn at constant speed.

    Parameters
    ----------
    name, where : str
        Of the recording; file and topic, for messages.
    links : mapping
        By parent and child.
    frame : str or None
        None for the root of the tree of ``child_frame``.
    child_frame : str or None
        None if there is one link only.

    Raises
    ------
    InputError
        If a frame is not there or needed, no links connect them, a frame has two parents, several
        publish a link at once, or the links on the way share no time or do not move.
    """
    parents = _parents(where, links)
    root, tip = _ends(where, links, parents, frame, child_frame)
    way = _way(where, links, parents, root, tip)
    poses = {key: links[key].poses(key) for key, _ in way}
    moving = {key: poses[key][0] for key, _ in way if not links[key].static}
    if not moving:
        raise RecordingError(
            f"{where}: {tip} does not move in {root}: all links between are static"
        )
    start = max(times[0] for times in moving.values())
    end = min(times[-1] for times in moving.values())
    dense = max(moving.values(), key=lambda times: int(np.sum((times >= start) & (times <= end))))
    times = dense[(dense >= start) & (dense <= end)]
    for stamps in moving.values():
        times = _outside_gaps(times, stamps)
    if len(times) < MINIMUM_SAMPLES:
        raise RecordingError(
            f"{where}: the links from {root} to {tip} have {len(times)} samples in the time they "
            f"share, at least {MINIMUM_SAMPLES} are needed: "
            + ", ".join(f"{a} -> {b} {t[0]:.6f} to {t[-1]:.6f} s" for (a, b), t in moving.items())
        )
    positions = np.zeros((len(times), 3))
    rotations = Rotation.identity(len(times))
    for key, forwards in way:
        step, turn = _at(times, *poses[key])
        if not forwards:
            turn = turn.inv()
            step = -turn.apply(step)
        positions = positions + rotations.apply(step)
        rotations = rotations * turn
    return Samples(
        name=name,
        source=Source(where, "stamp of the header", "rotation"),
        times=times,
        positions=positions,
        quaternions=rotations.as_quat(scalar_first=True),
    )


def _parents(where: str, links: Mapping[Key, Link]) -> dict[str, str]:
    parents: dict[str, str] = {}
    for parent, child in links:
        if parents.setdefault(child, parent) != parent:
            raise RecordingError(
                f"{where}: frame {child} has two parents, {parents[child]} and {parent}; record "
                "it under one, or split the recording"
            )
    return parents


def _ends(
    where: str,
    links: Mapping[Key, Link],
    parents: Mapping[str, str],
    frame: str | None,
    child_frame: str | None,
) -> Key:
    """Return the names of the frames asked for."""
    found = links_text(links)
    if child_frame is None:
        if len(links) > 1:
            raise RecordingError(
                f'{where}: whose motion? choose with child_frame="..." and frame="..." '
                f"(--child-frame, --frame): {found}"
            )
        child_frame = next(iter(links))[1]
    tip = child_frame.lstrip("/")
    root = _lineage(tip, parents)[-1] if frame is None else frame.lstrip("/")
    known = {name for link in links for name in link}
    for name in (tip, root):
        if name not in known:
            near = did_you_mean(name, known)
            raise RecordingError(f"{where}: no frame {name}{near}; it holds {found}")
    if tip == root:
        raise RecordingError(
            f"{where}: {tip} does not move in itself; give two different frames: {found}"
        )
    return root, tip


def _lineage(frame: str, parents: Mapping[str, str]) -> list[str]:
    """Return a frame, its parent and so on; a loop ends where it closes."""
    line = [frame]
    while line[-1] in parents and parents[line[-1]] not in line:
        line.append(parents[line[-1]])
    return line


def _way(
    where: str, links: Collection[Key], parents: Mapping[str, str], root: str, tip: str
) -> list[tuple[Key, bool]]:
    """Return the links from one frame to another, and whether each is passed from its parent."""
    up, down = _lineage(root, parents), _lineage(tip, parents)
    common = next((name for name in down if name in up), None)
    if common is None:
        raise RecordingError(
            f"{where}: no links connect {root} and {tip}; it holds {links_text(links)}; perhaps a "
            "static transform was not recorded"
        )
    way = [((parents[name], name), False) for name in up[: up.index(common)]]
    return way + [((parents[name], name), True) for name in down[: down.index(common)][::-1]]


def _outside_gaps(times: Floats, stamps: Floats) -> Floats:
    """Leave out times within a hole of a link, so that the motion has the hole as well."""
    periods = np.diff(stamps)
    holes = np.flatnonzero(periods > MAX_GAP * float(np.median(periods)) * (1 + 1e-9))
    kept = np.ones(len(times), dtype=bool)
    for before in holes:
        kept &= (times <= stamps[before]) | (times >= stamps[before + 1])
    return times[kept]


def _at(
    times: Floats, stamps: Floats, positions: Floats, rotations: Rotation
) -> tuple[Floats, Rotation]:
    """Return a link's poses at other times, by linear interpolation."""
    if len(stamps) == 1:
        return np.repeat(positions, len(times), axis=0), rotations[np.zeros(len(times), dtype=int)]
    path = np.column_stack([np.interp(times, stamps, axis) for axis in positions.T])
    return path, Slerp(stamps, rotations)(times)


def links_text(keys: Collection[Key]) -> str:
    """Return pairs of frames as text, but not all of hundreds."""
    shown = [" -> ".join(name or "''" for name in (key if key[1] else key[:1])) for key in keys]
    return listed(sorted(shown), str)
