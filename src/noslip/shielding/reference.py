"""What a chunk of actions means: smooth, and going on from what was executed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.quaternions import turned, turns_between, without_flips
from noslip.trajectory import PoseTrajectory

JOINED = 3
"""Executed poses that a chunk goes on from: they fix its pose, its twist and how that changes."""
LEVER = 0.05
"""Length (m) that weighs as much as a radian: 1 mm weighs as much as 1.1 degrees.  A blade that is
beside its path comes back to it within about this length.  With twice as much, recorded contours
are moved by 3 mm instead of 2; with less a tool turns more than its noise."""
SMOOTHED = 0.07
"""Seconds: what commands do in less than 2 pi of it, a third of a second, is mostly noise."""
SEEN = 0.5
"""Seconds of commands that are smoothed at once, and of motion that is looked ahead to, at least:
seven times :data:`SMOOTHED`; from less a tool's acceleration cannot be told."""
_SHARE, PACE = 0.4, 0.1
"""Speed of catching up over the chunk's own, and the least speed (m/s) that counts as its own; of
turning, over :data:`LEVER`.  A blade that steers aside so fast turns by a third of a radian."""
_LEAST = 0.15
"""Least time constant of catching up (s): a jump of the twist by noise is spread over as long."""
_LEASH, _LEASH_TURN = 0.05, 1.0
"""Meters and radians: farther from the tool, a reference waits for it.  A blade that makes up for
so much aside turns by half a radian."""


def joined(before: PoseTrajectory | None, past: Floats, chunk: PoseTrajectory) -> PoseTrajectory:
    """Return what was to be followed and then the chunk, smoothed and led over to from there.

    Positions and quaternions are smoothed by their third differences (minimum jerk), with commands
    that were carried out.  What the chunk is then off the reference before it decays, critically
    damped, at a moderate speed.  What lasts less than :data:`SEEN` is continued as it ends.

    Parameters
    ----------
    before : PoseTrajectory or None
        The reference's last poses, :data:`JOINED` of them.
    past : array, shape (M, 7)
        Commands before the chunk: positions and quaternions.
    chunk : PoseTrajectory
        Of the same period.
    """
    period, done = chunk.period, len(past)
    values = np.vstack([past, np.hstack([chunk.positions, chunk.quaternions])])
    values[:, 3:] = without_flips(values[:, 3:])
    # Rounded, as the periods of later times are, so that it is kept from chunk to chunk.
    values = _smoothing(len(values), round(SMOOTHED / period, 6)) @ values
    values[:, 3:] = _unit(values)
    if done < 2:
        values = np.vstack([_continued(values[::-1], 2)[::-1], values])
        done += 2
    values = np.vstack([values, _continued(values, round(SEEN / period) - len(chunk))])
    first, last = values[done - 2 : done], values[done:]
    if before is None:
        return poses_of(last, chunk.times[0], period)
    kept = np.hstack([before.positions, before.quaternions])
    for part, lever in ((slice(3), 1.0), (slice(3, 7), LEVER)):
        near, far = _apart(first[:, part], kept[-2:, part])
        speeds = np.linalg.norm(_apart(last[:-1, part], last[1:, part]), axis=1) / period
        pace = _SHARE * max(lever * float(speeds.max()), PACE)
        slow = max(_LEAST, lever * float(np.linalg.norm(far)) / (np.e * pace))
        fade, offsets = np.exp(-period / slow), [near, far]
        for _ in last:
            offsets.append(2 * fade * offsets[-1] - fade**2 * offsets[-2])
        last[:, part] = _moved(last[:, part], np.array(offsets[2:]))
    return poses_of(np.vstack([kept, last]), before.times[0], period)


def _apart(ones: Floats, others: Floats) -> Floats:
    """Displacements or, of quaternions, rotation vectors from ones to others, shape (N, 3)."""
    return others - ones if ones.shape[1] == 3 else turns_between(ones, others)


def _moved(ones: Floats, by: Floats) -> Floats:
    return ones + by if ones.shape[1] == 3 else turned(by, ones)


def _continued(values: Floats, count: int) -> Floats:
    """Poses that follow others, as fast as the last of them, shape (count, 7)."""
    k, parts = np.arange(1, count + 1)[:, None], []
    for part in (slice(3), slice(3, 7)):
        step = _apart(values[-2:-1, part], values[-1:, part])
        parts.append(_moved(np.repeat(values[-1:, part], len(k), axis=0), k * step))
    return np.hstack(parts)


def braked(
    motion: PoseTrajectory, count: int, within: int = 0, *, backwards: bool = False
) -> PoseTrajectory:
    """Return poses that follow a motion while its last twist fades, in the body's frame.

    So fades the velocity of each point of a body along its own axes: what does not slip goes on
    not to slip.

    Parameters
    ----------
    motion : PoseTrajectory
    count : int
        Of the poses.
    within : int
        Steps until it rests.
    backwards : bool
        Poses that led to the motion's first instead, had it always moved so.
    """
    period = motion.period
    way = -1.0 if backwards else 1.0
    k = 0 if backwards else len(motion) - 1
    turn, velocity = period * motion.body_velocities[min(k, len(motion) - 2)].reshape(2, 3)[::-1]
    share = np.minimum(np.arange(1, count + 1) / (within + 1), 1.0)
    fading = 1 - share**3 * (10 - 15 * share + 6 * share**2)
    if backwards:
        fading[:] = way
    position, rotation, found = motion.positions[k], motion.rotations[k], []
    for factor in fading:
        half = Rotation.from_rotvec(factor / 2 * turn)
        middle = rotation * half
        position, rotation = position + factor * middle.apply(velocity), middle * half
        found.append(np.hstack([position, rotation.as_quat(scalar_first=True)]))
    if backwards:
        return poses_of(np.array(found[::-1]), motion.times[0] - count * period, period)
    return poses_of(np.array(found), motion.times[-1] + period, period)


def poses_of(values: Floats, begin: float, period: float) -> PoseTrajectory:
    """Positions and quaternions, shape (N, 7), from a time on."""
    rotations = Rotation.from_quat(_unit(values), scalar_first=True)
    times: Floats = begin + period * np.arange(len(values), dtype=np.float64)
    return PoseTrajectory(times, values[:, :3], rotations, name="shielded")


def _unit(values: Floats) -> Floats:
    quaternions = values[:, -4:]
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))


@lru_cache(maxsize=8)
def _smoothing(count: int, strength: float) -> Floats:
    """Matrix that smooths so many samples: minimizes ``|x - c|^2 + |strength^3 x'''|^2``."""
    jerks = np.diff(np.eye(count), n=3, axis=0)
    inverse = np.linalg.inv(np.eye(count) + strength**6 * jerks.T @ jerks)
    return np.asarray(inverse, np.float64)


def drawn(reference: PoseTrajectory, tool: PoseTrajectory) -> PoseTrajectory:
    """Return a reference moved so far that its last pose is near the tool's."""
    away = reference.positions[-1] - tool.positions[-1]
    turn = turns_between(tool.quaternions[-1:], reference.quaternions[-1:])[0]
    back = [
        -max(0.0, 1 - most / max(float(np.linalg.norm(each)), most)) * each
        for each, most in ((away, _LEASH), (turn, _LEASH_TURN))
    ]
    if not any(each.any() for each in back):
        return reference
    quaternions = turned(np.tile(back[1], (len(reference), 1)), reference.quaternions)
    moved = np.hstack([reference.positions + back[0], quaternions])
    return poses_of(moved, reference.times[0], reference.period)
