"""Random goals of primitives from every source: reached without slip, rolled out at any step.

The fast tests take a few goals of a few primitives; ``pytest -m slow tests/test_goals.py`` takes
ten of each, 250 in all; ``make reach`` and ``make sweep`` take thousands.
"""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import noslip as ns
from learned import Goal, numerical
from measures import degrees, slip
from noslip._typing import Floats
from noslip.demonstrations.excision import synthetic_excisions
from noslip.errors import MissedError
from noslip.experiments.excision import Excision
from noslip.verification import TOLD, TOLD_TURN, pose_at
from strategies import unit

RATES = (28.6, 100.0)
"""At which the contour runs were recorded, and usual for a motion capture (Hz)."""
RUNS = [f"{placement}_{take}" for placement in "abcd" for take in (1, 2)]
STEPS = (None, 1e-3, 7e-3)
"""The default one; that of a fast controller, and one that divides no duration (s)."""
BY_DEFAULT = 1e-6, 1e-4
"""What a rollout may be off its goal at the step that was planned on: share of the path's length,
degrees."""
AT_ANY = 1e-5, 2e-3
"""At any other step; at a longer one it grows with the square of their ratio, from:"""
TIMES = 1.6, 4.0
SLIP = 1e-10


@cache
def excision(number: int) -> ns.ConstrainedDMP:
    return Excision.run(synthetic_excisions()[number]).primitive


@cache
def contour(recordings: Path, run: str, rate: float) -> ns.ConstrainedDMP:
    (recorded,) = ns.load_demonstrations(recordings / "contour_following" / f"data_demo_{run}.csv")
    return ns.learn(ns.prepare(recorded, trim_speed=0.05, rate=rate, lowpass=4.8), [ns.Blade()])


class Ends(NamedTuple):
    """Of the rollouts to some goals, at each of the steps."""

    moved: Floats
    """Off the goal, over the path's length, shape (goals, steps)."""
    turned: Floats
    """Degrees, shape (goals, steps)."""
    rates: Floats
    """Largest angular speed by default, over that without a new goal, shape (goals,)."""


def ends(dmp: ns.ConstrainedDMP, goals: int, seed: int) -> Ends:
    own, rng = dmp.rollout(), np.random.default_rng(seed)
    usual = np.linalg.norm(own.angular_velocities, axis=1).max()
    moved, turned = np.empty((2, goals, len(STEPS)))
    rates = np.empty(goals)
    for i in range(goals):
        goal = Goal.beside(dmp, rng, own.path_length)
        new = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation)
        for j, step in enumerate(STEPS):
            motion = new.rollout(time_step=step)
            moved[i, j] = np.linalg.norm(motion.positions[-1] - goal.position) / motion.path_length
            turned[i, j] = degrees(motion.rotations[-1], goal.rotation)
            assert np.abs(slip(motion)).max() <= SLIP
            if step is None:
                rates[i] = np.linalg.norm(motion.angular_velocities, axis=1).max() / usual
    return Ends(moved, turned, rates)


def assert_reached(dmp: ns.ConstrainedDMP, goals: int, seed: int = 0) -> None:
    found, learned = ends(dmp, goals, seed), dmp.duration / dmp.steps
    for errors, by_default, at_any, times in zip(
        (found.moved, found.turned), BY_DEFAULT, AT_ANY, TIMES, strict=True
    ):
        most = [
            by_default if step is None else at_any * max(1.0, step / learned / times) ** 2
            for step in STEPS
        ]
        assert np.all(errors <= most), (errors.max(axis=0), most)
    # Nor does the tool spin on its way there.
    assert np.mean(found.rates <= 2) >= 0.9, found.rates


# -------------------------------------------------------------------- a few


@pytest.mark.parametrize("number", [3, 5])
def test_goals_of_an_excision_are_reached_at_any_step(number: int) -> None:
    assert_reached(excision(number), 4)


def test_goals_of_the_numerical_example_are_reached_at_any_step() -> None:
    assert_reached(numerical(), 4)


@pytest.mark.recordings
@pytest.mark.parametrize(("run", "rate"), [("a_1", 28.6), ("c_2", 100.0)])
def test_goals_of_a_recorded_contour_are_reached_at_any_step(
    recordings: Path, run: str, rate: float
) -> None:
    assert_reached(contour(recordings, run, rate), 4)


LONGER = {0.1: (1e-5, 2e-3), 3.0: (1e-4, 4e-3), 10.0: (5e-3, 0.3)}
"""Times the step that was planned on, and what a rollout may be off its goal then."""


@pytest.mark.parametrize("make", [numerical, lambda: excision(0)], ids=["example", "excision"])
def test_goals_are_reached_and_nothing_slips_from_a_tenth_to_ten_times_the_step(make: Any) -> None:
    dmp, rng = make(), np.random.default_rng(7)
    for _ in range(2):
        goal = Goal.beside(dmp, rng, dmp.rollout().path_length)
        new = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation)
        for times, (moved, turned) in LONGER.items():
            motion = new.rollout(time_step=times * new.duration / new.steps)
            off = np.linalg.norm(motion.positions[-1] - goal.position)
            assert off <= moved * motion.path_length
            assert degrees(motion.rotations[-1], goal.rotation) <= turned
            assert np.abs(slip(motion)).max() <= SLIP


# -------------------------------------------------------------------- beyond them

FAR = 1.2, 170.0
"""Path lengths and degrees to a goal that is far."""
SLOWER = 0.2, 5.0
"""Factors on the duration."""


def assert_never_silently_missed(dmp: ns.ConstrainedDMP, goals: int, seed: int) -> tuple[int, int]:
    """Ask for far goals, odd durations and places to pass; how many are reached, and refused."""
    own, rng, reached = dmp.rollout(), np.random.default_rng(seed), 0
    for _ in range(goals):
        goal = Goal.beside(dmp, rng, own.path_length, farthest=FAR[0], turned=FAR[1])
        at = float(rng.uniform(0.1, 0.9))
        passed = own.resampled(times=[own.times[0], own.times[0] + at * own.duration]).positions[1]
        passed = passed + rng.uniform(0, 0.1) * own.path_length * unit(rng)
        via = [(at, passed)] if rng.random() < 0.5 else []
        duration = None
        if rng.random() < 0.5:
            duration = own.duration * float(np.exp(rng.uniform(*np.log(SLOWER))))
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            try:
                new = dmp.adapt(
                    goal_position=goal.position,
                    goal_rotation=goal.rotation,
                    duration=duration,
                    via=via,
                )
            except (MissedError, ns.errors.ConvergenceError):
                continue
        text = " ".join(str(one.message) for one in told)
        motion = new.rollout()
        length, turned = motion.path_length, degrees(motion.rotations[-1], goal.rotation)
        assert np.abs(slip(motion)).max() <= SLIP * max(1.0, length / motion.duration)
        assert motion.duration == pytest.approx(duration or new.duration)
        assert motion.duration == pytest.approx(duration or dmp.duration) or "takes" in text
        off = np.linalg.norm(motion.positions[-1] - goal.position)
        assert (off <= TOLD * length and turned <= np.degrees(TOLD_TURN) * 3) or "its goal" in text
        if via:
            position, _ = pose_at(motion, at)
            assert np.linalg.norm(position - passed) <= TOLD * length or "from via" in text
        reached += "the motion ends" not in text and "the motion passes" not in text
    return reached, goals


def test_far_goals_are_reached_or_refused() -> None:
    reached, asked = assert_never_silently_missed(numerical(), 4, seed=1)
    assert reached >= asked - 1


@pytest.mark.slow
@pytest.mark.parametrize("number", range(8))
def test_more_far_goals_of_an_excision_are_reached_or_refused(number: int) -> None:
    reached, asked = assert_never_silently_missed(excision(number), 5, seed=number)
    assert reached >= 0.8 * asked


@pytest.mark.slow
def test_more_far_goals_of_the_numerical_example_are_reached_or_refused() -> None:
    reached, asked = assert_never_silently_missed(numerical(), 10, seed=2)
    assert reached >= 0.8 * asked


# -------------------------------------------------------------------- all 250


@pytest.mark.slow
@pytest.mark.parametrize("number", range(8))
def test_every_goal_of_an_excision_is_reached_at_any_step(number: int) -> None:
    assert_reached(excision(number), 10, seed=1 + number)


@pytest.mark.slow
def test_every_goal_of_the_numerical_example_is_reached_at_any_step() -> None:
    assert_reached(numerical(), 10)


@pytest.mark.slow
@pytest.mark.recordings
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("run", RUNS)
def test_every_goal_of_a_recorded_contour_is_reached_at_any_step(
    recordings: Path, run: str, rate: float
) -> None:
    assert_reached(contour(recordings, run, rate), 10, seed=9 + RUNS.index(run))
