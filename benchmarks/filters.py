"""``python -m benchmarks.filters``: what makes a policy's actions keep a constraint, side by side.

Chunks of actions are cut from recordings of a person's tool, a robot's needle and wheeled robots,
each with noise of its own, and every filter is given the same: none, LeRobot's bounds step,
inverse kinematics with an equality at each step (mink; pink where it is installed), and the shield.
The filters with weights have those that `--tune` found best for them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks import single_threaded
from benchmarks.side_by_side.kinematics import Follower, Pose, solver

RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data"
"""They lie beside the repository and are no part of it."""
RATE = 30.0
"""Of the actions (Hz)."""
NOISE, TURN_NOISE = 1e-3, np.radians(0.6)
"""Of each action, along and about each axis (m, rad)."""
LONGEST = 600
"""Samples of a recording: 20 s; robots drive for minutes."""


@dataclass(frozen=True)
class Family:
    """Recordings, and what holds in them: body and world axes along which nothing moves."""

    name: str
    files: str
    constraint: ns.Constraint
    forward: tuple[float, float, float]
    body: tuple[tuple[float, float, float], ...]
    world: tuple[tuple[float, float, float], ...] = ()
    rate: float | None = None
    trim_speed: float | None = None


X, Y, Z = np.eye(3).tolist()
FAMILIES = (
    Family("contour (blade)", "contour_following/*.csv", ns.Blade(), X, (Y,), trim_speed=0.05),
    Family(
        "needle", "needle_insertion/*.csv", ns.Needle(shaft="-x"), [-1, 0, 0], (Y, Z), rate=14.5
    ),
    Family("wheel", "wheeled_robots/diff_free*.csv", ns.Wheel(), X, (Y,), (Z,), trim_speed=0.02),
)


def episodes(family: Family, most: int) -> list[ns.PoseTrajectory]:
    """Recordings at the rate of actions, without their noise: what a policy would mean."""
    found = ns.load_demonstrations(RECORDINGS / family.files, rate=family.rate)[:most]
    steps: dict[str, Any] = {"rate": RATE, "lowpass": 4.8, "trim_speed": family.trim_speed}
    return [ns.prepare(one, **steps)[:LONGEST] for one in found]


def chunks(
    episode: ns.PoseTrajectory, length: int, executed: int, rng: np.random.Generator
) -> Iterator[ns.PoseTrajectory]:
    """What a policy gives: from where the last chunk was left, each with noise of its own."""
    for first in range(0, len(episode) - length + 1, executed):
        part = episode[first : first + length]
        noise = NOISE * rng.normal(size=(length, 3))
        turns = Rotation.from_rotvec(TURN_NOISE * rng.normal(size=(length, 3)))
        yield ns.PoseTrajectory(part.times, part.positions + noise, turns * part.rotations)


class Filter(Protocol):
    """Chunk after chunk in, the poses that are executed of each out."""

    name: str

    def reset(self, family: Family, episode: ns.PoseTrajectory) -> None: ...

    def chunk(self, poses: ns.PoseTrajectory, executed: int) -> ns.PoseTrajectory: ...


class Nothing:
    """What a robot does without a filter."""

    name = "none"

    def reset(self, family: Family, episode: ns.PoseTrajectory) -> None: ...

    def chunk(self, poses: ns.PoseTrajectory, executed: int) -> ns.PoseTrajectory:
        return poses[:executed]


class Bounds:
    """LeRobot's ``EEBoundsAndSafety``: positions are clipped to a box; a step too long ends it.

    As the documentation and source of version 0.4.4 say, with its default step at which it raises.
    """

    name = "bounds (LeRobot)"
    max_ee_step_m = 0.05

    def reset(self, family: Family, episode: ns.PoseTrajectory) -> None:
        self.low, self.high = episode.positions.min(axis=0), episode.positions.max(axis=0)
        self.last: np.ndarray | None = None

    def chunk(self, poses: ns.PoseTrajectory, executed: int) -> ns.PoseTrajectory:
        clipped = np.clip(poses.positions[:executed], self.low, self.high)
        for position in clipped:
            if self.last is not None and np.linalg.norm(position - self.last) > self.max_ee_step_m:
                raise ValueError("EE jump")
            self.last = position
        return ns.PoseTrajectory(poses.times[:executed], clipped, poses.rotations[:executed])


@dataclass
class Kinematics:
    """Inverse kinematics of a free body at each step: a frame task, and the constraint as equality.

    Parameters
    ----------
    ahead : float
        The frame that follows its command stands so far ahead of the tool (m): a tool that is
        beside its path then turns back to it.  With 0 it stays beside it.
    turning : float
        Cost of the orientation over that of the position (m / rad).
    gain : float
        Share of the error that a step makes good.
    substeps : int
        Solved and integrated in each period, for commands interpolated.
    """

    ahead: float = 0.0
    turning: float = 0.1
    gain: float = 1.0
    substeps: int = 1
    library: str = "mink"

    @property
    def name(self) -> str:
        ahead = f", {1e3 * self.ahead:.0f} mm ahead" if self.ahead else ""
        times = f", {self.substeps} times a period" if self.substeps > 1 else ""
        return f"{self.library}, equality{ahead}{times}"

    def reset(self, family: Family, episode: ns.PoseTrajectory) -> None:
        self.offset = self.ahead * np.array(family.forward)
        step = 1 / RATE / self.substeps
        follower = Follower(family.body, family.world, self.offset, self.turning, self.gain, step)
        self.solve = solver(self.library, follower)
        self.pose: Pose | None = None
        self.wanted: Pose | None = None

    def chunk(self, poses: ns.PoseTrajectory, executed: int) -> ns.PoseTrajectory:
        found = []
        for k in range(executed):
            wanted = poses.positions[k], poses.rotations[k]
            if self.pose is None or self.wanted is None:
                self.pose = self.wanted = wanted
            turn = (wanted[1] * self.wanted[1].inv()).as_rotvec()
            for share in np.arange(1, self.substeps + 1) / self.substeps:
                position = (1 - share) * self.wanted[0] + share * wanted[0]
                rotation = Rotation.from_rotvec(share * turn) * self.wanted[1]
                self.pose = self.solve(
                    self.pose, (position + rotation.apply(self.offset), rotation)
                )
            self.wanted = wanted
            found.append(self.pose)
        rotations = Rotation.concatenate([rotation for _, rotation in found])
        return ns.PoseTrajectory(poses.times[:executed], [p for p, _ in found], rotations)


class Shielded:
    """The shield of this library."""

    name = "**noslip**, shield"

    def reset(self, family: Family, episode: ns.PoseTrajectory) -> None:
        self.shield = ns.Shield([family.constraint], rate=RATE)
        self.executed: int | None = None

    def chunk(self, poses: ns.PoseTrajectory, executed: int) -> ns.PoseTrajectory:
        motion = self.shield.chunk(poses, self.executed)
        self.executed = executed
        return motion[:executed]


class Streamed(Shielded):
    """The shield, given one action after the other."""

    name = "**noslip**, shield, one by one"

    def chunk(self, poses: ns.PoseTrajectory, executed: int) -> ns.PoseTrajectory:
        """Return where each command leads."""
        found = [
            self.shield.step((poses.positions[k], poses.rotations[k])) for k in range(executed)
        ]
        rotations = Rotation.concatenate([state.rotation for state in found])
        return ns.PoseTrajectory(poses.times[:executed], [s.position for s in found], rotations)


@dataclass(frozen=True)
class Figures:
    """Of a filter over all recordings of a family.

    Attributes
    ----------
    slip, peak : float
        Share of the way slipped; largest speed sideways (m/s), in the middle of the steps.
    moved, turned : float
        Rms distance from the actions (m, rad), which are noisy.
    off, turned_off : float
        And from the recording without the noise.
    acceleration, angular_acceleration : float
        Rms of what is executed (m/s^2, rad/s^2).
    time : float
        Median share of a chunk's duration.
    rejected : float
        Share of the episodes that the filter ended.
    """

    slip: float
    peak: float
    moved: float
    turned: float
    off: float
    turned_off: float
    acceleration: float
    angular_acceleration: float
    time: float
    rejected: float


def measure(
    each: Filter, family: Family, given: list[ns.PoseTrajectory], length: int, executed: int
) -> Figures:
    """Run a filter over episodes and measure what would be executed."""
    rng = np.random.default_rng(0)
    rows: list[list[np.ndarray]] = []
    times, rejected = [], 0
    for episode in given:
        each.reset(family, episode)
        done: list[ns.PoseTrajectory] = []
        asked = list(chunks(episode, length, executed, rng))
        try:
            for chunk in asked:
                begun = perf_counter()
                done.append(each.chunk(chunk, executed))
                times.append((perf_counter() - begun) / (length / RATE))
        except ValueError:
            rejected += 1
            continue
        count = executed * len(done)
        motion = ns.PoseTrajectory(
            episode.times[:count],
            np.vstack([part.positions for part in done]),
            Rotation.concatenate([part.rotations for part in done]),
        )
        rows.append(list(_of(motion, asked, episode[:count], family, executed)))
    if not rows:
        return Figures(*[np.nan] * 8, float(np.median(times)), 1.0)
    slips, moved, turned, off, turned_off, linear, angular = (
        np.concatenate(parts) for parts in zip(*(row[:7] for row in rows), strict=True)
    )
    ways = np.concatenate([row[7] for row in rows])

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    return Figures(
        float(slips.sum() / ways.sum()), float(slips.max()), rms(moved), rms(turned), rms(off),
        rms(turned_off), rms(linear), rms(angular), float(np.median(times)), rejected / len(given),
    )  # fmt: skip


def _of(
    motion: ns.PoseTrajectory,
    asked: list[ns.PoseTrajectory],
    meant: ns.PoseTrajectory,
    family: Family,
    executed: int,
) -> Iterator[np.ndarray]:
    _, _, middle = motion.step_middles()
    linear, angular = motion.step_velocities()
    sideways = [middle.inv().apply(linear) @ np.array(axis) for axis in family.body]
    yield np.linalg.norm([*sideways, *(linear @ np.array(axis) for axis in family.world)], axis=0)
    positions = np.vstack([chunk.positions[:executed] for chunk in asked])
    rotations = Rotation.concatenate([chunk.rotations[:executed] for chunk in asked])
    yield np.linalg.norm(motion.positions - positions, axis=1)
    yield (motion.rotations * rotations.inv()).magnitude()
    yield np.linalg.norm(motion.positions - meant.positions, axis=1)
    yield (motion.rotations * meant.rotations.inv()).magnitude()
    yield RATE * np.linalg.norm(np.diff(linear, axis=0), axis=1)
    yield RATE * np.linalg.norm(np.diff(angular, axis=0), axis=1)
    yield np.linalg.norm(linear, axis=1)


TUNED = {
    "contour (blade)": Kinematics(ahead=0.02, turning=0.01),
    "needle": Kinematics(turning=0.1, gain=0.4),
    "wheel": Kinematics(ahead=0.1, turning=0.003),
}
"""Weights with which the inverse kinematics ends nearest to what was meant, of 100 tried each."""


def tune(family: Family, given: list[ns.PoseTrajectory], length: int, executed: int) -> Kinematics:
    """Return the weights with which the kinematics stays nearest to what was meant."""
    grid = product(
        (0.0, 0.01, 0.02, 0.05, 0.1), (0.0, 0.003, 0.01, 0.03, 0.1), (0.2, 0.4, 0.7, 1.0)
    )
    tried = []
    for weights in grid:
        each = Kinematics(*weights)
        try:
            found = measure(each, family, given, length, executed)
        except Exception:
            continue
        tried.append((found.off + 0.05 * found.turned_off, weights, found))
    _, weights, _ = min(tried, key=lambda each: each[0])
    return Kinematics(*weights)


def rows(family: Family) -> Iterator[Filter]:
    """What is compared; of the others those that are installed."""
    yield from (Nothing(), Bounds())
    best = TUNED[family.name]
    for each in (best, replace(best, substeps=10), replace(best, library="pink")):
        if find_spec(each.library) is None:
            print(f"({each.library} is not installed)", file=sys.stderr)
        else:
            yield each
    yield from (Streamed(), Shielded())


HEADER = (
    "| filter | slip | at most | moved | turned | off what was meant | acceleration, rms | time |\n"
    "|---|---|---|---|---|---|---|---|"
)


def line(each: Filter, of: Figures) -> str:
    """A row of the table; slip that is rounding is 0."""
    if np.isnan(of.slip):
        return f"| {each.name} | rejects {of.rejected:.0%} | | | | | | |"
    some = f", rejects {of.rejected:.0%}" if of.rejected else ""
    slip, peak = (f"{x:.2g}" if x > 1e-9 else "0" for x in (100 * of.slip, 1e3 * of.peak))
    return (
        f"| {each.name}{some} | {slip} % | {peak} mm/s | "
        f"{1e3 * of.moved:.2f} mm | {np.degrees(of.turned):.1f}° | {1e3 * of.off:.2f} mm, "
        f"{np.degrees(of.turned_off):.1f}° | {of.acceleration:.2g} m/s², "
        f"{of.angular_acceleration:.2g} rad/s² | {100 * of.time:.2g} % |"
    )


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--length", type=int, default=16, help="actions of a chunk")
    parser.add_argument("--executed", type=int, default=8, help="of these, carried out")
    parser.add_argument("--episodes", type=int, default=8, help="of each family, at most")
    parser.add_argument("--tune", action="store_true", help="find the weights of the kinematics")
    asked = parser.parse_args()
    if not RECORDINGS.is_dir():
        print(f"{RECORDINGS} is absent: no recordings to cut chunks from", file=sys.stderr)
        return 1
    for family in FAMILIES:
        given = episodes(family, asked.episodes)
        if asked.tune:
            print(family.name, tune(family, given, asked.length, asked.executed))
            continue
        print(f"\n{family.name}: {len(given)} recordings\n\n{HEADER}")
        for each in rows(family):
            print(
                line(each, measure(each, family, given, asked.length, asked.executed)), flush=True
            )
    return 0


if __name__ == "__main__":
    single_threaded()
    sys.exit(main())
