"""Hands whose streams are shielded: recorded ones at a loop's rate, and made-up ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from scipy.spatial.transform import Rotation, Slerp

import noslip as ns
from motions import eased
from noslip._typing import Floats
from noslip.trajectory import continuous_quaternions

RATE = 1000
"""Hz of the loop."""
NOISE, TURN_NOISE = 0.5e-3, np.radians(0.3)
"""Standard deviations of each component, of commands and of what is measured."""
SEEN_EVERY = 10
"""Periods from one measurement to the next."""
TREMOR = 0.1
"""s of the Gaussian that takes its sensor's noise from a recorded hand, to know its own speed."""


def resampled(recording: ns.PoseTrajectory, seconds: float) -> ns.PoseTrajectory:
    """A recorded hand without its sensor's noise, at the loop's rate; it rests a second more."""
    times = recording.times - recording.times[0]
    at = np.arange(0, min(times[-1], seconds), 1 / RATE)
    paths = scipy.interpolate.interp1d(times, recording.positions, axis=0)(at)
    quaternions = continuous_quaternions(Slerp(times, recording.rotations)(at))
    smooth = [
        scipy.ndimage.gaussian_filter1d(each, TREMOR * RATE, axis=0, mode="nearest")
        for each in (paths, quaternions)
    ]
    rest = [np.concatenate([each, np.repeat(each[-1:], RATE, axis=0)]) for each in smooth]
    rotations = Rotation.from_quat(rest[1], scalar_first=True)
    return ns.PoseTrajectory(np.arange(len(rest[0])) / RATE, rest[0], rotations)


def made_up(path: Callable[[Floats], list[Floats]], seconds: float) -> ns.PoseTrajectory:
    """A hand by x, y (m) and yaw (rad) over the time (s), which are held for a second more."""
    times = np.arange(0, seconds + 1, 1 / RATE)
    x, y, yaw = (np.broadcast_to(part, times.shape) for part in path(np.fmin(times, seconds)))
    positions = np.column_stack([x, y, np.zeros_like(times)])
    return ns.PoseTrajectory(times, positions, Rotation.from_euler("z", yaw))


def risen(t: Floats, begin: float, duration: float) -> Floats:
    """From 0 to 1 within some seconds."""
    return eased(np.clip((t - begin) / duration, 0, 1))


HANDS: dict[str, Callable[[], ns.PoseTrajectory]] = {
    "pauses": lambda: made_up(
        lambda t: [0.1 * risen(t, 0, 1.5) + 0.1 * risen(t, 2.5, 1.5), 0 * t, 0 * t], 4
    ),
    "reversals": lambda: made_up(
        lambda t: [0.1 * np.sin(2 * t), 0.02 * risen(t, 0.5, 0.5), 0.3 * np.sin(t)], 2 * np.pi
    ),
    "a push aside": lambda: made_up(
        lambda t: [0.5 * risen(t, 0, 5), 0.03 * risen(t, 1.5, 0.5), 0.5 * risen(t, 0, 1)], 5
    ),
    "a turn in place": lambda: made_up(lambda t: [0 * t, 0 * t, risen(t, 0, 2)], 2),
    "a wave": lambda: made_up(
        lambda t: [0.05 * t, 0.03 * np.sin(1.2 * t), np.arctan(0.72 * np.cos(1.2 * t))], 6
    ),
}


@dataclass(frozen=True)
class Followed:
    """What a shield made of a hand.

    Attributes
    ----------
    hand, tool : PoseTrajectory
    linear, angular : array, shape (N, 3)
        Commanded velocities.
    distances, angles : array, shape (N,)
        As the shield told them.
    residuals : array, shape (N, m)
    """

    hand: ns.PoseTrajectory
    tool: ns.PoseTrajectory
    linear: Floats
    angular: Floats
    distances: Floats
    angles: Floats
    residuals: Floats

    @property
    def turned_faster(self) -> float:
        """Peak angular speed of the tool over the hand's."""
        hand = np.linalg.norm(self.hand.step_velocities()[1], axis=1).max()
        return float(np.linalg.norm(self.angular, axis=1).max() / hand)

    @property
    def lag(self) -> float:
        """Seconds after which the tool is nearest to where the hand was, on average."""
        shifts = range(0, RATE // 3, 5)
        return min(shifts, key=lambda k: float(self.off(k).mean())) / RATE

    def off(self, shift: int) -> Floats:
        """How far the tool is from where the hand was so many periods ago (m)."""
        return np.asarray(
            np.linalg.norm(
                self.tool.positions[shift:] - self.hand.positions[: len(self.hand) - shift], axis=1
            )
        )


def followed(
    shield: ns.Shield,
    hand: ns.PoseTrajectory,
    seed: int | None = 0,
    lag: int | None = None,
) -> Followed:
    """Follow a hand; with noise unless the seed is None, and seen so many periods late."""
    rng = np.random.default_rng(seed)
    noisy = seed is not None

    def seen(position: Floats, rotation: Rotation) -> tuple[Floats, Rotation]:
        if not noisy:
            return position, rotation
        turn = Rotation.from_rotvec(TURN_NOISE * rng.normal(size=3))
        return position + NOISE * rng.normal(size=3), turn * rotation

    shield.reset((hand.positions[0], hand.rotations[0]))
    states: list[ns.State] = []
    told = []
    for k, (position, rotation) in enumerate(zip(hand.positions, hand.rotations, strict=True)):
        measured = None
        if lag is not None and k > lag and k % SEEN_EVERY == 0:
            measured = seen(states[k - 1 - lag].position, states[k - 1 - lag].rotation)
        states.append(shield.step(seen(position, rotation), measured))
        told.append((shield.distance, shield.angle))
    vectors = np.array([state.vector() for state in states])
    tool = ns.PoseTrajectory(
        hand.times, vectors[:, :3], Rotation.from_quat(vectors[:, 3:7], scalar_first=True)
    )
    distances, angles = np.array(told).T
    residuals = np.array([state.constraint_residuals for state in states])
    return Followed(hand, tool, vectors[:, 7:10], vectors[:, 10:], distances, angles, residuals)


def recorded(folder: Path, file: str, seconds: float) -> ns.PoseTrajectory:
    """The first seconds of a recorded hand at the loop's rate."""
    rate = 14.5 if file.startswith("needle") else None
    (recording,) = ns.load_demonstrations(folder / file, rate=rate)
    return resampled(recording, seconds)
