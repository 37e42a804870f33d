"""What movement_primitives' tests ask of primitives of vectors, asked of ours as properties.

``docs/peers.md`` lists which of its assertions each test stands for.
"""

from __future__ import annotations

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import noslip as ns
from noslip._typing import Floats
from noslip.errors import InputError
from strategies import seeds, unit


def waves(seed: int, *, count: int = 301, duration: float = 1.0) -> ns.Trajectory:
    """From 1 to 4 coordinates, each a wave of up to two periods."""
    rng = np.random.default_rng(seed)
    s, size = np.linspace(0, 1, count), 1 + seed % 4
    each = [
        rng.normal() + np.cos(np.pi * rng.uniform(0.5, 4) * s + rng.uniform(0, 6))
        for _ in range(size)
    ]
    names = [f"q{k}" for k in range(size)]
    return ns.Trajectory(duration * s, np.column_stack(each), names=names)


@cache
def learned(seed: int) -> ns.ConstrainedDMP:
    return ns.learn(waves(seed))


def values(motion: Any) -> Floats:
    return np.asarray(motion.values)


@settings(max_examples=8)
@given(st.integers(0, 7))
def test_a_demonstration_of_any_size_is_reproduced(seed: int) -> None:
    demonstration = waves(seed)
    motion = learned(seed).rollout(time_step=demonstration.period)
    assert values(motion).shape == demonstration.values.shape
    # Theirs: two decimals.
    assert np.abs(values(motion) - demonstration.values).max() <= 1e-4


@settings(max_examples=5)
@given(seeds)
def test_vectors_reach_a_new_goal_from_a_new_start(seed: int) -> None:
    dmp, rng = learned(seed % 8), np.random.default_rng(seed)
    size = len(dmp.start_position)
    start, goal = (rng.normal(size=size) for _ in range(2))
    motion = dmp.rollout(start=start, goal=goal)
    np.testing.assert_allclose(values(motion)[0], start, atol=1e-12)
    # Theirs: three or four decimals.
    assert np.abs(values(motion)[-1] - goal).max() <= 2e-4
    # A goal that is the start is like any other.
    assert (
        np.abs(values(dmp.rollout(goal=dmp.start_position))[-1] - dmp.start_position).max() <= 2e-4
    )


@settings(max_examples=3)
@given(seeds)
def test_stepping_vectors_by_hand_is_the_rollout(seed: int) -> None:
    dmp = learned(seed % 8)
    goal = np.random.default_rng(seed).normal(size=len(dmp.start_position))
    motion, state = dmp.rollout(goal=goal, time_step=0.01), dmp.initial_state(goal=goal)
    for k in range(1, 101):
        state = dmp.step(state, 0.01)
        np.testing.assert_allclose(state.position, values(motion)[k], atol=1e-12)
    # After its end a motion holds where it is.
    after = dmp.step(state, 0.01)
    np.testing.assert_allclose(after.position, state.position, atol=1e-2)


@settings(max_examples=3)
@given(seeds)
def test_vectors_in_another_duration_take_the_same_path(seed: int) -> None:
    dmp = learned(seed % 8)
    own = values(dmp.rollout())
    for factor in (0.5, 2.0):
        motion = dmp.rollout(duration=factor * dmp.duration)
        np.testing.assert_allclose(values(motion), own, atol=1e-12)


@settings(max_examples=3)
@given(seeds)
def test_smaller_steps_come_nearer(seed: int) -> None:
    """Theirs of a better integrator: ours is of a high order, so a coarse one is seen to fall."""
    dmp = learned(seed % 8)
    fine = values(dmp.rollout(time_step=1 / 1600))
    off = [
        np.abs(values(dmp.rollout(time_step=1 / n)) - fine[:: 1600 // n]).max() for n in (50, 200)
    ]
    assert off[1] <= off[0] / 8 + 1e-9


@settings(max_examples=2)
@given(seeds)
def test_a_velocity_at_the_goal_of_vectors_is_reached(seed: int) -> None:
    dmp = learned(8 + seed % 4)
    size = len(dmp.start_position)
    asked = 0.5 * unit(np.random.default_rng(seed), size) if size > 1 else np.array([0.5])
    motion = dmp.adapt(goal_velocity=asked).rollout()
    last = np.diff(values(motion), axis=0)[-3:] / motion.period
    found = np.array([3, -10, 15]) @ last / 8
    np.testing.assert_allclose(found, asked, atol=2e-2)


def test_the_number_of_weights_is_that_of_functions_times_coordinates() -> None:
    for seed in range(4):
        weights = ns.learn(waves(seed), basis_functions=9).law.forcing.weights
        assert weights.shape == (9, 1 + seed)


@pytest.mark.parametrize("size", [1, 3])
def test_a_start_of_another_size_is_refused(size: int) -> None:
    dmp = learned(1)
    with pytest.raises(InputError) as raised:
        dmp.rollout(start=np.zeros(size))
    assert "\n" not in str(raised.value)
    assert "2" in str(raised.value)


def test_vectors_are_written_and_read(tmp_path: Any) -> None:
    dmp = learned(3)
    for back in (pickle.loads(pickle.dumps(dmp)), ns.load_primitive(dmp.save(tmp_path / "v.json"))):
        assert back == dmp
        assert np.array_equal(values(back.rollout()), values(dmp.rollout()))
