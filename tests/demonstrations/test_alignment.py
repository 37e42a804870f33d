"""Alignment: timings that differ are brought together, and nothing else changes."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.demonstrations.alignment import align
from noslip.demonstrations.excision import TOOL_FRAME, synthetic_excisions
from noslip.demonstrations.preparation import prepare
from noslip.errors import InputError, MissingDependencyError
from noslip.spread import Spread

needs_dtw = pytest.mark.skipif(
    __import__("importlib.util").util.find_spec("dtaidistance") is None,
    reason="dtaidistance is not installed (noslip[align])",
)


def wave():
    """A path with a turning tool, in 2 s."""
    s = np.linspace(0, 1, 241)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(2 * np.pi * s), -0.004 * np.sin(np.pi * s)])
    yaw = np.arctan2(0.04 * np.pi * np.cos(2 * np.pi * s), 0.1)
    return ns.PoseTrajectory(2 * s, path, Rotation.from_euler("z", yaw), name="wave")


def excision():
    (cut,) = synthetic_excisions(seed=7, count=1)
    return prepare(cut, tool_frame=TOOL_FRAME, trim_speed=0.003, lowpass=True, relative=True)


def copies(motion, rng, count=5, noise=0.0):
    """One motion in random timings: the speed varies by up to 7 along it, and the duration."""
    made = []
    u = np.linspace(0, 1, len(motion))
    for number in range(count):
        knots = np.concatenate([[0], np.cumsum(rng.uniform(0.25, 1.75, 5))])
        warp = PchipInterpolator(np.linspace(0, 1, 6), knots / knots[-1])(u)
        times = motion.times[0] + motion.duration * np.clip(warp, 0, 1)
        moved = motion.resampled(times=times)
        path = moved.positions + noise * rng.standard_normal((len(u), 3))
        duration, start = rng.uniform(2, 6), rng.uniform(-5, 5)
        made.append(
            ns.PoseTrajectory(start + duration * u, path, moved.rotations, name=f"copy {number}")
        )
    return made


def spreads(motions):
    """Rms distance (m) and angle (rad) to the mean at equal fractions of the durations."""
    sampled = [m.resampled(times=np.linspace(*m.times[[0, -1]], 101)) for m in motions]
    paths = np.array([m.positions for m in sampled])
    angles = []
    for k in range(101):
        turns = Rotation.concatenate([m.rotations[k] for m in sampled])
        angles.append((turns * turns.mean().inv()).magnitude())
    away = np.sum((paths - paths.mean(axis=0)) ** 2, axis=2)
    return np.sqrt([np.mean(away), np.mean(np.square(angles))])


@needs_dtw
@settings(max_examples=12)
@given(
    seed=st.integers(0, 100_000),
    made=st.sampled_from([wave, excision]),
    noise=st.sampled_from([0.0, 1e-4]),
)
def test_copies_in_random_timings_come_together(seed, made, noise):
    motions = copies(made(), np.random.default_rng(seed), noise=noise)
    before, after = spreads(motions), spreads(align(motions))
    assert np.all(after < before / 10)


@needs_dtw
@pytest.mark.filterwarnings("ignore:.*out of step:noslip.errors.RecordingWarning")
@pytest.mark.parametrize("seed", range(3))
def test_the_primitive_of_aligned_copies_has_a_smaller_spread_and_a_truer_path(seed):
    motion = wave()
    motions = copies(motion, np.random.default_rng(seed))
    found = []
    for given_motions in (motions, align(motions)):
        primitive = ns.learn(given_motions)
        spread = Spread.about(primitive.law, given_motions)
        path = primitive.rollout().positions
        # Of each sample to the path, whatever its time.
        fine = CubicSpline(motion.times, motion.positions)(np.linspace(0, 2, 2001))
        off = [np.linalg.norm(fine - point, axis=1).min() for point in path[::5]]
        found.append([spread.position_deviation.max(), spread.rotation_deviation.max(), max(off)])
    unaligned, aligned = found
    assert np.all(np.array(aligned) < np.array(unaligned) / 3)


@needs_dtw
@pytest.mark.parametrize("seed", range(3))
def test_ends_clocks_and_paths_stay_and_time_runs_on(seed):
    rng = np.random.default_rng(seed)
    motions = copies(wave(), rng)
    for before, after in zip(motions, align(motions), strict=True):
        assert after.name == before.name
        assert len(after) == len(before)
        assert after.is_uniform
        np.testing.assert_allclose(after.times[[0, -1]], before.times[[0, -1]])
        np.testing.assert_allclose(after.positions[[0, -1]], before.positions[[0, -1]], atol=1e-12)
        ends = before.rotations[[0, -1]].inv() * after.rotations[[0, -1]]
        assert ends.magnitude().max() < 1e-9
        # x grows along the wave, so it tells the time that the motion has reached.
        assert np.all(np.diff(after.positions[:, 0]) > 0)
        curve = CubicSpline(before.positions[:, 0], before.positions[:, 1])
        np.testing.assert_allclose(after.positions[:, 1], curve(after.positions[:, 0]), atol=1e-5)
        # No staircase: the speed is that of some smooth timing.
        speeds = np.linalg.norm(np.diff(after.positions, axis=0), axis=1)
        assert np.abs(np.diff(speeds)).max() < 0.15 * speeds.max()


@needs_dtw
def test_motions_in_step_stay_as_they_are():
    motion = wave()
    for after in align([motion, motion, motion]):
        np.testing.assert_allclose(after.positions, motion.positions, atol=1e-6)


@needs_dtw
def test_real_cuts_that_differ_come_no_further_apart():
    cuts = [
        prepare(x, tool_frame=TOOL_FRAME, trim_speed=0.003, lowpass=True, relative=True)
        for x in synthetic_excisions(seed=7)
    ]
    assert np.all(spreads(align(cuts)) < spreads(cuts))


@needs_dtw
def test_one_or_a_still_one_cannot_be_aligned():
    with pytest.raises(InputError, match="2 demonstrations or more, got 1"):
        align(wave())
    still = ns.PoseTrajectory([0, 1], np.zeros((2, 3)), Rotation.identity(2), name="still")
    with pytest.raises(InputError, match="still: stands still"):
        align([wave(), still])


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "dtaidistance.dtw_ndim", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'noslip\[align\]'"):
        align([wave(), wave()])
