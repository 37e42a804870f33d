"""What a chunk of actions means: smooth, and going on from what was executed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.projection.blend import spread
from noslip.quaternions import turned, turns_between, without_flips
from noslip.trajectory import PoseTrajectory

JOINED = 3
"""Executed poses that a chunk goes on from: they fix its pose, its twist and how that changes."""
LEVER = 0.05
"""Length (m) that weighs as much as a radian: 1 mm weighs as much as 1.1 degrees.  A blade that is
beside its path comes back to it within about this length.  With twice as much, recorded contours
are moved by 3 mm instead of 2; with less a tool turns more than its noise."""
SMOOTHED = 0.06
"""Seconds: what commands do in less than 2 pi of it, a third of a second, is mostly noise."""
_SHARE, PACE = 0.4, 0.1
"""Speed of catching up over the chunk's own, and the least speed (m/s) that counts as its own; of
turning, over :data:`LEVER`.  A blade that steers aside so fast turns by a third of a radian."""
_LEASH, _LEASH_TURN = 0.05, 1.0
"""Meters and radians: farther from the tool, a reference waits for it.  A blade that makes up for
so much aside turns by half a radian."""
_LEAST = 8
"""Poses over which the least offset is spread."""
_PEAK = 1.875
"""Peak speed of a minimum jerk over its mean."""


def joined(before: PoseTrajectory | None, chunk: PoseTrajectory) -> PoseTrajectory:
    """Return what was executed and then the chunk, smoothed and led over to from there.

    Positions and quaternions are smoothed by their third differences (minimum jerk).  The offset
    between where the executed poses lead to and where the chunk begins decays at a moderate speed;
    what is left of it at the chunk's end is left to the next one.

    Parameters
    ----------
    before : PoseTrajectory or None
        The last executed poses, :data:`JOINED` of them, which stay as they are.
    chunk : PoseTrajectory
        Of the same period.
    """
    count, period = len(chunk), chunk.period
    strength = (SMOOTHED / period) ** (2 * JOINED)
    values = np.hstack([chunk.positions, chunk.quaternions])
    if before is None:
        return poses_of(_smoothing(count, 0, strength)[0] @ values, chunk.times[0], period)
    kept = np.hstack([before.positions, before.quaternions])
    alone = _smoothing(count, 0, strength)[0] @ values
    # Where the chunk would have been in the last two executed poses.
    led = np.array([[3, -2], [2, -1]]) @ alone[:2]
    offsets = np.hstack([kept[-2:, :3] - led[:, :3], turns_between(_unit(led), kept[-2:, 3:])])
    steps = np.diff(alone[:, :3], axis=0), turns_between(_unit(alone[:-1]), _unit(alone[1:]))
    parts = (slice(3), 1.0), (slice(3, 6), LEVER)
    long = []
    for step, (part, lever) in zip(steps, parts, strict=True):
        fastest = lever * float(np.linalg.norm(step, axis=1).max())
        far = _PEAK * lever * float(np.linalg.norm(offsets[1, part]))
        long.append(max(_LEAST, round(far / (_SHARE * max(fastest, PACE * period)))))
    decays = [
        spread(
            {0: offsets[1, part], end: np.zeros(3)},
            np.union1d(np.arange(count + 1), end),
            offsets[1, part] - offsets[0, part],
        )[1 : count + 1]
        for end, (part, _) in zip(long, parts, strict=True)
    ]
    values[:, :3] += decays[0]
    values[:, 3:] = turned(decays[1], values[:, 3:])
    values[:, 3:] = without_flips(np.vstack([kept[-1:, 3:], values[:, 3:]]))[1:]
    smoothed, led_on = _smoothing(count, JOINED, strength)
    values = np.vstack([kept, smoothed @ values + led_on @ kept])
    return poses_of(values, before.times[0], period)


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


@lru_cache(maxsize=32)
def _smoothing(count: int, kept: int, strength: float) -> tuple[Floats, Floats]:
    """Matrices of what smooths so many samples, and of what those kept before them add.

    They minimize ``|x - c|^2 + strength |x'''|^2`` with differences for derivatives.
    """
    jerks = np.diff(np.eye(kept + count), n=JOINED, axis=0)
    before, after = jerks[:, :kept], jerks[:, kept:]
    inverse: Floats = np.asarray(
        np.linalg.inv(np.eye(count) + strength * after.T @ after), np.float64
    )
    return inverse, -strength * inverse @ after.T @ before


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
