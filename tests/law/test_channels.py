"""Channels follow the phase: what is fitted, and what becomes of it in a primitive's life."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import noslip as ns
from motions import planar_cut
from noslip.errors import InputError
from noslip.law.basis import Basis
from noslip.law.channels import SAMPLES, Channels
from noslip.law.clock import Phase
from refusals import refusal

FRACTIONS = np.linspace(0.0, 1.0, 401)


def recorded(values, duration: float = 2.0, begin: float = 5.0, **named) -> ns.Trajectory:
    values = np.atleast_2d(np.transpose(values)).T
    return ns.Trajectory(begin + np.linspace(0, duration, len(values)), values, **named)


@settings(max_examples=25)
@given(
    arrays(np.float64, (2, 3), elements=st.floats(-1e6, 1e6)),
    st.integers(1, 60),
    st.sampled_from([0.3, 1.0, 5.0]),
)
def test_constants_and_lines_are_met_to_rounding(line, count, alpha_s) -> None:
    values = line[0] + FRACTIONS[:, None] * line[1]
    found = Channels.fit(Basis(count, Phase(alpha_s)), [recorded(values)])
    assert np.abs(found.at(FRACTIONS) - values).max() <= 1e-12 * (1 + np.abs(line).max())


@settings(max_examples=15)
@given(arrays(np.float64, (30, 2), elements=st.floats(-10, 10)), st.integers(5, 30))
def test_what_lines_leave_is_the_ridge_regression_of_the_mean(values, count) -> None:
    """Against the same minimum as one dense least-squares problem."""
    ridge, basis = 1e-4, Basis(count)
    two = [recorded(values), recorded(3 - values[::-1], duration=7.0, begin=-3.0)]
    u = np.linspace(0, 1, SAMPLES * count + 1)
    both = [
        np.column_stack([np.interp(u, np.linspace(0, 1, 30), c) for c in d.values.T]) for d in two
    ]
    mean = np.mean(both, axis=0)
    line = np.vander(u, 2, increasing=True)
    left = mean - line @ np.linalg.pinv(line) @ mean
    psi = basis.activations(basis.phase.at(u))
    pull = np.sqrt(ridge * np.sum(psi**2) / count) * np.eye(count)
    weights = np.linalg.lstsq(
        np.vstack([psi, pull]), np.vstack([left, np.zeros((count, 2))]), rcond=None
    )[0]
    expected = np.clip(mean - left + psi @ weights, mean.min(axis=0), mean.max(axis=0))
    found = Channels.fit(basis, two, ridge=ridge).at(u)
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_smooth_channels_are_followed_and_jumps_do_not_overshoot() -> None:
    smooth = 10 * np.sin(5 * FRACTIONS)
    jump = (FRACTIONS > 0.4) * 0.08
    found = Channels.fit(Basis(100), [recorded(np.column_stack([smooth, jump]))]).at(FRACTIONS)
    assert np.abs(found[:, 0] - smooth).max() < 2e-3 * 10
    assert found[:, 1].min() >= 0
    assert found[:, 1].max() <= 0.08
    # A basis function is as wide as a hundredth of the motion; some rings are left beyond.
    far = np.abs(FRACTIONS - 0.4) > 0.05
    assert np.abs(found[far, 1] - jump[far]).max() < 3e-2 * 0.08


@given(st.floats(0, 1), st.floats(0, 1), st.floats(-1, 2))
@settings(max_examples=30)
def test_what_is_left_goes_on_where_the_whole_was(first, second, at) -> None:
    whole = Channels.fit(Basis(20), [recorded(np.cos(4 * FRACTIONS))])
    rest = whole.after(first)
    inside = min(max(at, 0.0), 1.0)
    np.testing.assert_allclose(rest.at(at), whole.at(first + (1 - first) * inside), atol=1e-9)
    assert rest.after(second).begin == pytest.approx(first + (1 - first) * second)


@pytest.fixture(scope="module")
def learned() -> ns.ConstrainedDMP:
    demonstrations = []
    for k in range(2):
        cut = planar_cut(0.5 + 0.05 * k)
        u = cut.clock / cut.duration
        force, grip = -3 - 2 * np.sin(np.pi * u) - k, (u > 0.5) * 1.0
        beside = ns.Trajectory(
            cut.times,
            np.column_stack([force, grip, np.full_like(u, 400.0)]),
            names=("fz", "grip", "stiffness"),
            units=("N", "1", "N/m"),
        )
        demonstrations.append(cut.with_channels(beside))
    return ns.learn(demonstrations, [ns.Blade()])


def test_a_primitive_learns_them_and_every_rollout_has_them(learned) -> None:
    assert learned.channels.names == ("fz", "grip", "stiffness")
    for motion in (
        learned.rollout(),
        learned.rollout(duration=5.0, time_step=0.03),
        learned.adapt(goal_position=[0.11, 0.01, 0.0]).rollout(),
        learned.regular.rollout(),
    ):
        u = (motion.times - motion.times[0]) / motion.duration
        fz, stiffness = motion.channels.column("fz"), motion.channels.column("stiffness")
        np.testing.assert_allclose(fz, -3.5 - 2 * np.sin(np.pi * u), atol=5e-3)
        np.testing.assert_allclose(stiffness, 400.0, rtol=1e-12)
        np.testing.assert_array_equal(motion.channels.times, motion.times)
    same = learned.rollout(), ns.learn(planar_cut(), [ns.Blade()]).rollout()
    assert same[1].channels is None


def test_a_new_plan_goes_on_with_them(learned) -> None:
    state = learned.initial_state()
    while state.time < 0.7 * state.duration:
        state = learned.step(state, 0.005)
    done = learned.law.clock.fraction(state.phase)
    planned = learned.replan(state, goal_position=[0.1, 0.012, 0.0])
    assert planned.channels.begin == pytest.approx(done)
    first = planned.rollout().channels.values[0]
    np.testing.assert_allclose(first, learned.channels.at(done)[0], atol=1e-12)


def test_they_are_saved_to_the_bit(learned, tmp_path: Path) -> None:
    read = ns.load_primitive(learned.save(tmp_path / "cut.json"))
    assert read.channels == learned.channels
    assert read.rollout().channels.values.tobytes() == learned.rollout().channels.values.tobytes()


def test_what_does_not_go_together_is_refused(learned) -> None:
    cut = planar_cut()
    one, other = (
        cut.with_channels(recorded(np.zeros(len(cut)), names=[name], begin=0.0, duration=2.0))
        for name in "ab"
    )
    assert "has channels b (1), but" in refusal(InputError, ns.learn, [one, other])
    assert "has no channels" in refusal(InputError, ns.learn, [one, cut])
