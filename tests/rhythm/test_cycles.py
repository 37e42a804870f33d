"""Recordings of several periods: how long they are, where they are cut, and what is learned."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.demonstrations.cycles import periods
from noslip.errors import InputError, RecordingWarning

PERIOD, RATE = 2.0, 100.0


def _curve(seed: int, angle: np.ndarray) -> np.ndarray:
    """A closed curve of three harmonics, the first the largest."""
    rng = np.random.default_rng(seed)
    waves = [
        np.outer(np.cos(k * angle), rng.normal(size=2))
        + np.outer(np.sin(k * angle), rng.normal(size=2))
        for k in (1, 2, 3)
    ]
    return np.asarray(waves[0] / np.abs(waves[0]).max() + 0.1 * (waves[1] + waves[2]))


def _by_hand(seed: int, count: int, more: float, hurry: float) -> tuple[ns.Trajectory, np.ndarray]:
    """Several periods and a part of one by a hand that is no clock; and when each begins."""
    rng = np.random.default_rng(seed)
    lasting = PERIOD * (1 + rng.uniform(-hurry, hurry, count + 1))
    begins = np.concatenate([[0.0], np.cumsum(lasting)])
    end = begins[count] + more * (begins[count + 1] - begins[count])
    times = np.arange(0.0, end + 0.5 / RATE, 1 / RATE)
    turns = PchipInterpolator(begins, np.arange(count + 2))
    values = _curve(seed, 2 * np.pi * turns(times))
    return ns.Trajectory(times, values, names=["x", "y"], name="hand"), begins


@settings(max_examples=25)
@given(st.integers(0, 50), st.integers(2, 7), st.floats(0, 0.4), st.floats(0, 0.08))
def test_periods_of_a_hand_are_found_and_follow_one_another(
    seed: int, count: int, more: float, hurry: float
) -> None:
    recording, begins = _by_hand(seed, count, more, hurry)
    with pytest.warns(RecordingWarning, match="periods of"):
        found = periods(recording)
    assert count - 1 <= len(found) <= count
    for one, next_one in pairwise(found):
        assert one.times[-1] == next_one.times[0]
    # Each is as long as the hand took from that phase to the same one.
    turns = PchipInterpolator(begins, np.arange(count + 2))
    phases = turns([*(p.times[0] for p in found), found[-1].times[-1]])
    np.testing.assert_allclose(np.diff(phases), 1, atol=0.02)
    for one in found:
        gap = np.linalg.norm(one.values[-1] - one.values[0])
        assert gap <= 0.02 * one.path_length


@given(st.integers(0, 50))
def test_one_period_and_a_motion_that_ends_are_left_as_they_are(seed: int) -> None:
    recording, _ = _by_hand(seed, 1, 0.0, 0.0)
    assert periods(recording)[0] is recording
    s = np.linspace(0, 1, 101)
    reach = ns.Trajectory(2 * s, np.outer(s**2 * (3 - 2 * s), [1, seed]), names=["x", "y"])
    assert periods(reach)[0] is reach


def test_a_period_that_is_given_is_taken_and_nothing_said() -> None:
    recording, _ = _by_hand(3, 6, 0.0, 0.0)
    assert len(periods(recording, 2 * PERIOD)) == 3
    assert periods(recording, recording.duration)[0] is recording
    [one] = periods(recording[:270], PERIOD)
    assert one.duration == pytest.approx(PERIOD, rel=5e-3)
    with pytest.raises(InputError, match="longer than its 12 s"):
        periods(recording, 13.0)
    with pytest.raises(InputError, match="at least 8 are needed"):
        periods(recording, 0.05)
    with pytest.raises(InputError, match="period must be"):
        periods(recording, -1.0)


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_what_is_learned_of_several_is_their_mean(noise: float) -> None:
    recording, _ = _by_hand(5, 6, 0.3, 0.0)
    rng = np.random.default_rng(0)
    shaken = recording.with_points(recording.points + noise * rng.normal(size=(len(recording), 2)))
    with pytest.warns(RecordingWarning, match=r"hand: holds [56] periods of (1\.99|2)"):
        dmp = ns.learn(shaken, rhythmic=True, basis_functions=12)
    # Where a hand is back is as uncertain as where it is.
    assert dmp.duration == pytest.approx(PERIOD, rel=1e-3 + noise)
    assert [record.demonstration for record in dmp.record][:2] == [
        "hand, period 1",
        "hand, period 2",
    ]
    # The curve itself, wherever the cuts are.
    own = dmp.rollout().values
    curve = _curve(5, np.linspace(0, 2 * np.pi, 2000))
    away = np.linalg.norm(own[:, None] - curve, axis=2).min(axis=1)
    assert away.max() <= 0.004 + noise


def test_laps_of_a_wheel_are_cut_and_keep_their_whole_turns() -> None:
    times = np.arange(0, 7.0, 0.02)
    angle = np.pi * times + 0.3
    places = np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), 0 * angle], axis=1)
    laps = ns.PoseTrajectory(
        times, places, Rotation.from_euler("z", angle + np.pi / 2), name="laps"
    )
    dmp = ns.learn(laps, [ns.Wheel()], rhythmic=True, period=PERIOD, basis_functions=20)
    assert len(dmp.record) == 3
    motion = dmp.rollout(cycles=2)
    assert motion.end_error < 1e-9
    assert np.abs(motion.constraint_residuals).max() < 1e-10
    turned = np.sum((motion.rotations[1:] * motion.rotations[:-1].inv()).magnitude())
    assert turned == pytest.approx(4 * np.pi, rel=1e-3)


@pytest.mark.parametrize(
    "given",
    [{"start": "pose"}, {"end": "position"}, {"project_start": "velocity"}, {"alpha_s": 2.0}],
)
def test_what_is_of_motions_that_end_is_refused(given: dict[str, object]) -> None:
    recording, _ = _by_hand(1, 1, 0.0, 0.0)
    with pytest.raises(InputError, match=f"{next(iter(given))} is of motions that end"):
        ns.learn(recording, rhythmic=True, **given)
    with pytest.raises(InputError, match="period is of a rhythm"):
        ns.learn(recording, period=2.0)
