"""What people might ask: random recordings, rules, limits, options and goals."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.sweep import rules
from benchmarks.sweep.rules import Rule
from benchmarks.sweep.track import Floats, Track, quaternion, times

Vias = tuple[tuple[float, Floats], ...]
AXES_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Goal:
    """Where a primitive is asked to go instead.

    Attributes
    ----------
    shift : array, shape (3,)
        Of the goal, over the path's length.
    turn : array, shape (3,)
        Of the goal, a rotation vector in the world (rad).
    duration : float or None
        Over the primitive's own.
    vias : tuple of (fraction, shift over the path's length)
        Points to pass, beside the primitive's own path.
    seconds : float or None
        Its duration, as a remedy has it.
    """

    shift: Floats
    turn: Floats
    duration: float | None = None
    vias: Vias = ()
    seconds: float | None = None


@dataclass(frozen=True)
class Job:
    """One of them.

    Attributes
    ----------
    recordings : tuple of Track
    noise : float
        Standard deviation of the recorded positions (m).
    rules : tuple of Rule
    options : tuple of str
        Of ``noslip learn``.
    goal : Goal or None
        What the primitive is adapted to.
    """

    seed: int
    recordings: tuple[Track, ...]
    noise: float
    rules: tuple[Rule, ...]
    options: tuple[str, ...]
    goal: Goal | None = field(default=None)

    def without(self, *names: str) -> Job:
        """The same without the rules of these names."""
        return replace(self, rules=tuple(rule for rule in self.rules if rule.name not in names))

    def slower(self, factor: float) -> Job:
        """The same, recorded so much slower."""
        slower = tuple(replace(r, times=factor * r.times) for r in self.recordings)
        return replace(self, recordings=slower)


def job(seed: int) -> Job:
    """Return the job of a seed."""
    rng = np.random.default_rng(seed)
    planar = bool(rng.random() < 0.5)
    recording = _recording(rng, planar)
    several = int(rng.choice([1, 1, 1, 1, 1, 1, 1, 2, 3]))
    recordings = [recording]
    recordings += [_again(recording, rng, planar) for _ in range(several - 1)]
    held = _equalities(rng, recording, planar) + _limits(rng, recording)
    noise = float(rng.choice([0.0, 0.0, 1.0])) * 10 ** rng.uniform(-4.5, -3) * recording.length
    options: list[str] = []
    if noise:
        recordings = [_noisy(r, noise, rng) for r in recordings]
        rate = (len(recording.times) - 1) / recording.duration
        cutoff = float(rng.uniform(3, 8) / recording.duration * 4)
        if cutoff < rate / 3 and rng.random() < 0.8:
            options += ["--lowpass", f"{cutoff:.3g}"]
    if rng.random() < 0.15:
        options += ["--basis-functions", str(int(rng.integers(10, 150)))]
    if rng.random() < 0.2:
        options += ["--metric", str(rng.choice(["position", "shared"]))]
    if rng.random() < 0.05:
        options += ["--hold-position"]
    goal = _goal(rng, planar and any(r.name in ("wheel", "plane-contact") for r in held))
    wanted = goal if rng.random() < 0.65 else None
    return Job(seed, tuple(recordings), noise, tuple(held), tuple(options), wanted)


def _recording(rng: np.random.Generator, planar: bool) -> Track:
    """A smooth path, the tool along it or beside it, often from rest to rest."""
    count = int(rng.integers(60, 500))
    s = np.linspace(0, 1, count)
    if rng.random() < 0.6:
        s = s**3 * (10 - 15 * s + 6 * s**2)
    size = 10 ** rng.uniform(-1.7, 0.3)
    path = np.outer(s, [1.0, 0, 0])
    for k in range(1, int(rng.integers(1, 5))):
        bend = rng.normal(size=3) * [0.3, 1, 0 if planar else 1]
        path += np.outer(np.sin(np.pi * k * s + rng.uniform(0, 6)), bend) * rng.uniform(0, 0.2) / k
    path = size * (path - path[0]) + rng.uniform(-1, 1, 3)
    if rng.random() < 0.75:
        # Its chords lead: the first and last have no other neighbor.
        ways = np.gradient(path, np.linspace(0, 1, count), axis=0)
        moving = np.linalg.norm(ways, axis=1)
        ways = ways[np.maximum.accumulate(np.where(moving > 1e-3 * moving.max(), range(count), 0))]
        first = int(np.argmax(moving > 1e-3 * moving.max()))
        ways[:first] = ways[first]
        yaw = np.unwrap(np.arctan2(ways[:, 1], ways[:, 0]))
        pitch = -np.arctan2(ways[:, 2], np.hypot(ways[:, 0], ways[:, 1]))
        z, y = np.zeros((2, count, 3))
        z[:, 2], y[:, 1] = yaw, pitch
        turned = times(quaternion(z), quaternion(y))
    else:
        turned = np.tile([1.0, 0, 0, 0], (count, 1))
    askew = np.outer(np.sin(rng.uniform(0, 3) * s + rng.uniform(0, 6)), rng.normal(size=3))
    askew *= rng.choice([0.0, 0.1, 0.3]) * np.array([0 if planar else 1, 0 if planar else 1, 1])
    duration = 10 ** rng.uniform(-0.3, 1) * max(size, 0.1) ** 0.3
    return Track(np.linspace(0, duration, count), path, times(quaternion(askew), turned))


def _again(recording: Track, rng: np.random.Generator, planar: bool) -> Track:
    """Recorded once more: a little beside, or (seldom) elsewhere or out of step."""
    s = recording.times / recording.duration
    shift = recording.length * 0.02 * rng.normal(size=3) * [1, 1, 0 if planar else 1]
    if rng.random() < 0.15:
        shift *= 30
    stray = np.outer(np.sin(np.pi * s), recording.length * 0.02 * rng.normal(size=3))
    stray[:, 2] *= not planar
    warped = s + rng.choice([0.0, 0.0, 0.1]) * s * (1 - s)
    positions, quaternions = recording.at(warped)
    return Track(recording.times * rng.uniform(0.8, 1.25), positions + shift + stray, quaternions)


def _noisy(recording: Track, noise: float, rng: np.random.Generator) -> Track:
    turns = rng.normal(
        scale=min(noise / recording.length * 3, 0.01), size=(len(recording.times), 3)
    )
    return replace(
        recording,
        positions=recording.positions + rng.normal(scale=noise, size=recording.positions.shape),
        quaternions=times(quaternion(turns), recording.quaternions),
    )


def _equalities(rng: np.random.Generator, recording: Track, planar: bool) -> list[Rule]:
    offset = np.zeros(3)
    if rng.random() < 0.2:
        offset = recording.length * rng.uniform(-0.05, 0.05, 3) * [1, 1, 0 if planar else 1]
    plane = rules.plane_contact(recording.positions[0], AXES_Z)
    kinds = [[], [rules.blade(offset)], [rules.blade(np.zeros(3))], [rules.needle()]]
    if planar:
        kinds += [[rules.wheel()], [plane], [plane, rules.blade(np.zeros(3))]]
    return list(kinds[int(rng.integers(len(kinds)))])


def _limits(rng: np.random.Generator, recording: Track) -> list[Rule]:
    """None, one or two, of which some bind, some do not, and some are in the way."""
    made = []
    for _ in range(int(rng.choice([0, 0, 1, 1, 2]))):
        limit = _limit(rng, recording)
        made.append(limit.softened() if rng.random() < 0.2 else limit)
    return [rule for k, rule in enumerate(made) if rule.name not in [r.name for r in made[:k]]]


def _limit(rng: np.random.Generator, recording: Track) -> Rule:
    kind = str(
        rng.choice(
            ["speed", "rate", "acceleration", "half-space", "box", "sphere", "capsule", "forward"]
            + ["radius"]
        )
    )
    positions, length = recording.positions, recording.length
    share = float(10 ** rng.uniform(-0.8, 0.3))
    peak = np.linalg.norm(recording.steps.linear, axis=1).max()
    if kind == "speed":
        return rules.speed(float(share * peak))
    if kind == "rate":
        peak = max(np.linalg.norm(recording.steps.angular, axis=1).max(), 0.1)
        return rules.angular_rate(float(share * peak))
    if kind == "acceleration":
        peak = max(np.linalg.norm(recording.accelerations[0], axis=1).max(), 1e-3 * length)
        return rules.acceleration(float(share * peak))
    if kind == "half-space":
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        heights = positions @ normal
        # Within the path's heights it is in the way, but for the ends.
        lowest = min(heights[0], heights[-1], heights.min() + rng.uniform(0, 0.3) * np.ptp(heights))
        return rules.half_space((lowest - rng.uniform(0, 0.05) * length) * normal, normal)
    if kind == "box":
        margin = rng.uniform(-0.01, 0.1) * length
        lower, upper = positions.min(axis=0) - margin, positions.max(axis=0) + margin
        ends = positions[[0, -1]]
        near = 0.002 * length
        return rules.box(
            np.minimum(lower, ends.min(axis=0) - near), np.maximum(upper, ends.max(axis=0) + near)
        )
    if kind in ("sphere", "capsule"):
        radius = float(length * rng.uniform(0.01, 0.12))
        here = positions[int(rng.uniform(0.25, 0.75) * len(positions))]
        beside = rng.normal(size=3)
        center = here + beside / np.linalg.norm(beside) * radius * rng.uniform(0, 1.5)
        if kind == "sphere":
            return rules.sphere(center, radius)
        way = rng.normal(size=3)
        return rules.capsule(center - way * radius, center + way * radius, radius)
    if kind == "radius":
        return rules.turning_radius(float(length * rng.uniform(0.01, 0.2)))
    return rules.forward_only()


def _goal(rng: np.random.Generator, flat: bool) -> Goal:
    """Beside the primitive's own, or as far away as the path is long."""
    far = rng.random() < 0.35
    mask = np.array([1, 1, 0 if flat else 1])
    shift = rng.normal(size=3) * mask
    shift *= rng.uniform(0.01, 1.2 if far else 0.4) / np.linalg.norm(shift)
    turn = rng.normal(size=3) * (np.array([0, 0, 1]) if flat else 1)
    turn *= np.radians(rng.uniform(0, 170 if far else 45)) / np.linalg.norm(turn)
    duration = float(10 ** rng.uniform(-0.7, 0.7)) if rng.random() < 0.3 else None
    vias: list[tuple[float, Floats]] = []
    if rng.random() < 0.3:
        for at in sorted(rng.uniform(0.1, 0.9, int(rng.integers(1, 3))).round(3).tolist()):
            vias.append((at, rng.normal(size=3) * mask * 0.05))
    return Goal(shift, turn, duration, tuple(vias))
