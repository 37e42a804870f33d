"""Poses that a beveled needle surely reaches: ends of insertions with random smooth rolls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory
from noslip.maneuvers.maneuver import integrated

CURVATURES, LENGTHS = (2.0, 10.0), (0.1, 0.3)
"""1/m and m: from stiff to flexible needles, from shallow to deep targets."""
ROLLS = (0.03, 12.0)
"""Root mean square (rad over the whole way): from an arc to turns all the way."""
_STEPS, _WAVES, _DURATION = 600, 3, 12.0


@dataclass(frozen=True, eq=False)
class NeedleGoal:
    """An insertion; its end is a goal that is reached.

    Attributes
    ----------
    curvature : float
        Of the needle (1/m), about its z.
    length : float
        m.
    roll : float
        Root mean square (rad over the whole way).
    insertion : PoseTrajectory
        From the identity on, at constant speed.
    """

    curvature: float
    length: float
    roll: float
    insertion: PoseTrajectory


def needle_goals(count: int, *, curvature: float | None = None, seed: int = 0) -> list[NeedleGoal]:
    """Return so many goals.

    Parameters
    ----------
    count : int
    curvature : float, optional
        Of all of them (1/m); by default each has its own.  The way's bend stays that of each.
    seed : int
    """
    random = np.random.default_rng(seed)
    goals = []
    for _ in range(count):
        own, length = random.uniform(*CURVATURES), random.uniform(*LENGTHS)
        roll = float(np.exp(random.uniform(*np.log(ROLLS))))
        bend = own * length
        own = own if curvature is None else curvature
        goals.append(_inserted(own, bend / own, roll, random))
    return goals


def demonstrated(curvature: float, length: float = 0.15) -> PoseTrajectory:
    """An insertion that bends to one side, then, after half a turn of roll, to the other."""
    middles = (np.arange(_STEPS) + 0.5) / _STEPS
    # Half a turn within a fifth of the way.
    return _along(curvature, length, np.pi / 2 * 15 / np.cosh(15 * (middles - 0.5)) ** 2)


def _inserted(
    curvature: float, length: float, roll: float, random: np.random.Generator
) -> NeedleGoal:
    """Roll at a rate of a few random waves, the slower the larger."""
    middles = (np.arange(_STEPS) + 0.5) / _STEPS
    rate = np.full(_STEPS, random.normal())
    for half in range(1, 2 * _WAVES + 1):
        angle = np.pi * half * middles
        rate += (random.normal() * np.cos(angle) + random.normal() * np.sin(angle)) * 2 / half
    rate *= roll / np.sqrt(np.mean(rate**2))
    return NeedleGoal(curvature, length, roll, _along(curvature, length, rate))


def _along(curvature: float, length: float, rate: np.ndarray) -> PoseTrajectory:
    twists = np.zeros((_STEPS, 6))
    twists[:, 0], twists[:, 5] = length / _STEPS, curvature * length / _STEPS
    twists[:, 3] = rate / _STEPS
    positions, quaternions = integrated(twists)
    times = np.linspace(0.0, _DURATION, _STEPS + 1)
    rotations = Rotation.from_quat(quaternions, scalar_first=True)
    return PoseTrajectory(times, positions, rotations, name="insertion")
