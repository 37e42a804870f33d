"""Trees of frames, as tf keeps them: one frame's motion in another."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from noslip._pose_checks import MINIMUM_SAMPLES, Source
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import listed

Key = tuple[str, str]
"""Frame and child frame; the latter is empty where a message names none."""


@dataclass
class Series:
    """Poses between two frames as messages brought them; times in nanoseconds."""

    stamps: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)
    positions: list[tuple[float, float, float]] = field(default_factory=list)
    quaternions: list[tuple[float, float, float, float]] = field(default_factory=list)

    def samples(self, name: str, where: str) -> Samples:
        """Return them as the samples of a recording, unchecked."""
        headers = any(self.stamps)
        source = Source(
            where, "stamp of the header" if headers else "time in the bag", "orientation"
        )
        # Division of whole numbers rounds once; seconds and nanoseconds apart would round twice.
        stamps = [stamp / 10**9 for stamp in (self.stamps if headers else self.received)]
        positions = np.array(self.positions, dtype=np.float64).reshape(-1, 3)
        quaternions = np.array(self.quaternions, dtype=np.float64).reshape(-1, 4)
        return Samples(
            name=name,
            source=source,
            times=np.array(stamps),
            positions=positions,
            quaternions=quaternions,
        )


@dataclass(frozen=True)
class Link:
    """A link between two frames; of a static one the last message counts."""

    where: str
    series: Series
    static: bool

    def poses(self, key: Key) -> tuple[Floats, Floats, Rotation]:
        """Return times, positions and rotations after the checks that recordings get."""
        where = f"{self.where}: {key[0]} -> {key[1]}"
        samples = self.series.samples(where, where)
        source, times, positions = samples.source, samples.times, samples.positions
        source.check_finite({"position": positions, "orientation": samples.quaternions})
        rotations = source.rotations(samples.quaternions)
        if self.static:
            return times[-1:], positions[-1:], rotations[-1:]
        kept = source.distinct(times, positions, rotations)
        source.check_gaps(times, kept)
        return times[kept], positions[kept], rotations[kept]


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
        If a frame is not there or needed, no links connect them, a frame has two parents, the
        links on the way share no time or do not move, or for what
        :func:`noslip.load_demonstrations` names.
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
            raise RecordingError(f"{where}: no frame {name}; it holds {found}")
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
