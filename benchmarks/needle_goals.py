"""Poses that a beveled needle surely reaches, and which it is led to.

``python -m benchmarks.needle_goals``: each is the end of an insertion with a random roll, so none
may be refused.  The ways to them are found, then a primitive is adapted to them.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import NoslipError, NoslipWarning
from noslip.maneuvers.beveled import beveled
from noslip.maneuvers.maneuver import integrated

Floats = NDArray[np.float64]

CURVATURES, LENGTHS = (2.0, 10.0), (0.1, 0.3)
"""1/m and m: from stiff to flexible needles, from shallow to deep targets."""
ROLLS = (0.03, 12.0)
"""Root mean square (rad over the whole way): from an arc to turns all the way."""
TURNS_OVER = 4
"""One goal in so many is that of a needle that turns over quickly once or a few times, the usual
way of steering; others roll all the way."""
STEPS = (None, 1e-3, 7e-3)
"""Of rollouts (s): by default, of a control loop, and one that divides nothing."""
NEAR, REACHED = 1e-3, 0.9
"""Share of the way within which a goal is reached, and share of goals that must be."""
_PIECES, _DURATION, _HALF_WAVES = 600, 12.0, 6


@dataclass(frozen=True, eq=False)
class NeedleGoal:
    """An insertion whose end is a goal.

    Attributes
    ----------
    curvature : float
        Of the needle (1/m), about its z.
    length : float
        m.
    insertion : PoseTrajectory
        From the identity on, at constant speed.
    """

    curvature: float
    length: float
    insertion: ns.PoseTrajectory

    @property
    def position(self) -> Floats:
        """Of the goal (m)."""
        return np.asarray(self.insertion.positions[-1])

    @property
    def rotation(self) -> Rotation:
        """Of the goal."""
        return self.insertion.rotations[-1]


def needle_goals(count: int, *, curvature: float | None = None, seed: int = 0) -> list[NeedleGoal]:
    """Return so many goals.

    Parameters
    ----------
    count : int
    curvature : float, optional
        Of all of them (1/m), each way being as long as its bend takes; by default each has its own.
    seed : int
    """
    random = np.random.default_rng(seed)
    goals = []
    for k in range(count):
        own, length = random.uniform(*CURVATURES), random.uniform(*LENGTHS)
        bend, own = own * length, curvature or own
        rate = _turning_over(random) if k % TURNS_OVER == 0 else _waves(random)
        goals.append(NeedleGoal(own, bend / own, _inserted(own, bend / own, rate)))
    return goals


def demonstrated(curvature: float, length: float = 0.15) -> ns.PoseTrajectory:
    """An insertion that bends to one side, then, after half a turn of roll, to the other."""
    return _inserted(curvature, length, _half_turn(0.5, 10.0))


def _middles() -> Floats:
    return (np.arange(_PIECES) + 0.5) / _PIECES


def _half_turn(at: float, quickness: float) -> Floats:
    return np.asarray(np.pi / 2 * quickness / np.cosh(quickness * (_middles() - at)) ** 2)


def _turning_over(random: np.random.Generator) -> Floats:
    """Roll one way or the other, by half a turn or less, up to three times."""
    return np.sum(
        [
            random.uniform(-1, 1) * _half_turn(random.uniform(0.15, 0.85), random.uniform(8, 20))
            for _ in range(random.integers(1, 4))
        ],
        axis=0,
    )


def _waves(random: np.random.Generator) -> Floats:
    """Roll at a rate of a few random waves, the slower the larger."""
    size = np.exp(random.uniform(*np.log(ROLLS)))
    rate = np.full(_PIECES, random.normal())
    for half in range(1, _HALF_WAVES + 1):
        angle = np.pi * half * _middles()
        rate += (random.normal() * np.cos(angle) + random.normal() * np.sin(angle)) * 2 / half
    return np.asarray(rate * size / np.sqrt(np.mean(rate**2)))


def _inserted(curvature: float, length: float, rate: Floats) -> ns.PoseTrajectory:
    twists = np.zeros((_PIECES, 6))
    twists[:, 0], twists[:, 5] = length / _PIECES, curvature * length / _PIECES
    twists[:, 3] = rate / _PIECES
    positions, quaternions = integrated(twists)
    times = np.linspace(0.0, _DURATION, _PIECES + 1)
    rotations = Rotation.from_quat(quaternions, scalar_first=True)
    return ns.PoseTrajectory(times, positions, rotations, name="insertion")


# ---------------------------------------------------------------- what becomes of them


def searched(goals: Sequence[NeedleGoal]) -> Iterator[tuple[bool, float, float]]:
    """Whether a way is found, its length over the insertion's, and CPU time (s)."""
    for goal in goals:
        begun = time.process_time()
        found = beveled(goal.position, goal.rotation.as_quat(scalar_first=True), goal.curvature)
        seconds = time.process_time() - begun
        yield bool(found), found[0].length / goal.length if found else np.nan, seconds


def adapted(goals: Sequence[NeedleGoal]) -> Iterator[tuple[str, list[float], float]]:
    """Refusal, distance off the goal over the way at each of the steps, and CPU time (s)."""
    curvature = goals[0].curvature
    learned = ns.learn(demonstrated(curvature), ns.Needle(curvature=curvature))
    learned.compile()
    for goal in goals:
        begun = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NoslipWarning)
                found = learned.adapt(goal_position=goal.position, goal_rotation=goal.rotation)
        except NoslipError as error:
            yield str(error), [np.inf] * len(STEPS), time.process_time() - begun
            continue
        seconds = time.process_time() - begun
        ends = [found.rollout(time_step=step).positions[-1] for step in STEPS]
        off = [float(np.linalg.norm(end - goal.position)) / goal.length for end in ends]
        yield "", off, seconds


def main(arguments: Sequence[str] | None = None) -> int:
    """Print how many are reached; the exit code is 1 if fewer than nine in ten."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--curvature", type=float, default=5.0, help="of the adapted needle (1/m)")
    parser.add_argument("--ways", action="store_true", help="find ways to goals; adapt to none")
    options = parser.parse_args(arguments)
    found, longer, seconds = map(np.array, zip(*searched(needle_goals(options.count)), strict=True))
    print(
        f"ways found to {found.sum()} of {options.count} goals, at most {np.nanmax(longer):.3f} "
        f"times as long, in {1e3 * np.median(seconds):.0f} ms each, {1e3 * seconds.max():.0f} at "
        "most"
    )
    if options.ways:
        return int(found.mean() < REACHED)
    goals = needle_goals(options.count, curvature=options.curvature)
    refused, ends, seconds = zip(*adapted(goals), strict=True)
    off = np.array(ends)
    reached = (off <= NEAR).all(axis=1)
    worst = ", ".join(f"{share:.1g}" for share in off[reached].max(axis=0))
    usual, most = np.median(seconds), max(seconds)
    print(
        f"adapted to {reached.sum()} of {options.count} goals within {NEAR:g} of the way; these "
        f"end up to {worst} of it off, by default, at 1 ms and at 7 ms, in {usual:.2g} s each, "
        f"{most:.2g} at most"
    )
    for k, (why, each) in enumerate(zip(refused, off, strict=True)):
        if not reached[k]:
            print(f"goal {k}: {why or f'ends {each.max():.2g} of its way off'}")
    return int(min(found.mean(), reached.mean()) < REACHED)


if __name__ == "__main__":
    sys.exit(main())
