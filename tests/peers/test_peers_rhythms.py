"""What the code at the end of pydmps' rhythmic module draws, as properties."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import noslip as ns


def period(seed: int, count: int = 201) -> ns.Trajectory:
    """Two coordinates once around, of three harmonics."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2, count)
    waves = [
        [
            amplitude * np.cos(np.pi * k * t + rng.uniform(0, 6))
            for k, amplitude in ((1, 1), (3, 0.2))
        ]
        for _ in range(2)
    ]
    return ns.Trajectory(t, rng.normal(size=2) + np.sum(waves, axis=1).T, names=["x", "y"])


@cache
def learned(seed: int, functions: int = 40) -> ns.ConstrainedDMP:
    return ns.learn(period(seed), rhythmic=True, basis_functions=functions)


@pytest.mark.parametrize("seed", range(3))
def test_a_period_is_imitated_the_better_the_more_functions(seed: int) -> None:
    demonstration = period(seed)
    off = [
        np.abs(
            learned(seed, count).rollout(time_step=demonstration.period).values
            - demonstration.values
        ).max()
        for count in (6, 40)
    ]
    assert off[1] <= 1e-3
    assert off[1] <= off[0] / 10


@settings(max_examples=3)
@given(st.integers(0, 2), st.floats(0.3, 3))
def test_a_rhythm_faster_or_slower_is_the_same_path(seed: int, factor: float) -> None:
    dmp = learned(seed)
    own, other = dmp.rollout(), dmp.rollout(duration=factor * dmp.duration)
    np.testing.assert_allclose(other.values, own.values, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_periods_go_on_as_they_began(seed: int) -> None:
    dmp = learned(seed)
    motion, steps = dmp.rollout(cycles=5), dmp.steps
    first, *others = (motion.values[k * steps : (k + 1) * steps] for k in range(5))
    # The fit leaves a start that the limit cycle draws in within a period.
    np.testing.assert_allclose(others[0], first, atol=1e-5)
    for other in others[1:]:
        np.testing.assert_allclose(other, others[0], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_without_amplitude_it_stays_at_its_goal(seed: int) -> None:
    dmp = learned(seed)
    motion = dmp.rollout(amplitude=1e-9)
    assert np.abs(motion.values[-dmp.steps // 4 :] - dmp.goal_position).max() <= 1e-3
