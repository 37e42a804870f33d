"""What movement_primitives' tests ask of its Cartesian primitives, asked of ours as properties.

``docs/peers.md`` lists which of its assertions each test stands for.
"""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation, Slerp

import noslip as ns
from learned import Goal
from measures import end_velocities
from noslip.constraints import KeepOutSphere
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from strategies import seeds, unit


def reaching(seed: int, *, count: int = 201, duration: float = 1.0) -> ns.PoseTrajectory:
    """From a random pose to another one along a sigmoid, which ends while it moves a little."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, count)
    risen = (np.tanh(1.5 * np.pi * (s - 0.5)) + 1) / 2
    start, way = rng.normal(size=3), 0.4 * unit(rng)
    bend = 0.1 * np.outer(np.sin(np.pi * risen), unit(rng))
    turn = Rotation.random(rng=rng)
    ends = Rotation.concatenate(
        [turn, Rotation.from_rotvec(rng.uniform(0.3, 2) * unit(rng)) * turn]
    )
    return ns.PoseTrajectory(
        duration * s, start + np.outer(risen, way) + bend, Slerp([0, 1], ends)(risen)
    )


@cache
def learned(seed: int) -> ns.ConstrainedDMP:
    return ns.learn(reaching(seed), basis_functions=50)


@settings(max_examples=3)
@given(seeds)
def test_weights_read_and_set_change_nothing(seed: int) -> None:
    law = learned(seed % 8).law
    weights = np.array(law.forcing.weights)
    assert weights.shape == (law.basis.count, 6)
    again = copy.copy(law.__dict__) | {"forcing": ForcingTerm(law.basis, weights)}
    fields = {name: again[name] for name in Law.__dataclass_fields__}
    motion = ns.ConstrainedDMP(Law(**fields)).rollout()
    assert np.array_equal(motion.positions, learned(seed % 8).rollout().positions)


@settings(max_examples=3)
@given(seeds)
def test_a_motion_reaches_a_new_goal_from_a_new_start(seed: int) -> None:
    dmp, rng = learned(seed % 8), np.random.default_rng(seed)
    start, goal = (Goal.beside(dmp, rng, 0.4) for _ in range(2))
    motion = dmp.rollout(
        start_position=start.position,
        start_rotation=start.rotation,
        goal_position=goal.position,
        goal_rotation=goal.rotation,
    )
    np.testing.assert_allclose(motion.positions[0], start.position, atol=1e-12)
    assert (motion.rotations[0] * start.rotation.inv()).magnitude() <= 1e-7
    # Theirs, of vectors alone: three or four decimals.  Turns do not add up: half a degree.
    assert motion.end_error <= 1e-4
    assert motion.end_rotation_error <= 1e-2


@settings(max_examples=2)
@given(seeds)
def test_a_velocity_at_the_goal_is_reached_in_any_duration(seed: int) -> None:
    dmp, rng = learned(seed % 8), np.random.default_rng(seed)
    asked = 0.5 * unit(rng)
    for factor in (1.0, 2.0):
        adapted = dmp.adapt(goal_velocity=asked / factor, duration=factor * dmp.duration)
        motion = adapted.rollout()
        linear, _ = end_velocities(motion, -1)
        # Theirs: one or two decimals of speeds up to 2.
        np.testing.assert_allclose(linear, asked / factor, atol=5e-3)
        assert motion.end_error <= 1e-4


@settings(max_examples=2)
@given(seeds)
def test_via_points_are_passed(seed: int) -> None:
    """Theirs of primitives that follow via points: within 0.02."""
    dmp, rng = learned(seed % 8), np.random.default_rng(seed)
    own = dmp.rollout()
    vias = [
        (at, own.positions[round(at * (len(own) - 1))] + 0.03 * unit(rng)) for at in (0.3, 0.6, 0.8)
    ]
    motion = dmp.adapt(via=vias).rollout()
    for at, position in vias:
        near = np.linalg.norm(motion.positions - position, axis=1)
        assert near.min() <= 1e-3
        assert np.linalg.norm(motion.positions[round(at * (len(motion) - 1))] - position) <= 1e-3


@settings(max_examples=2)
@given(seeds)
def test_obstacles_are_avoided(seed: int) -> None:
    """Theirs keep 0.1 from a point in the middle of a straight way; ours keep the radius."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, 201)
    risen = s**3 * (10 - 15 * s + 6 * s**2)
    straight = ns.PoseTrajectory(s, np.outer(risen, [1, 1, 1]), Rotation.identity(201))
    start = 0.1 * rng.normal(size=3)
    sphere = KeepOutSphere(center=(0.5, 0.5, 0.5), radius=0.13)
    motion = ns.learn(straight, [sphere], basis_functions=40).rollout(start_position=start)
    away = np.linalg.norm(motion.positions - 0.5, axis=1)
    assert away.min() >= 0.13 - 1e-6
    assert motion.end_error <= 0.02


@pytest.mark.parametrize(
    "made",
    [
        lambda: ns.learn(reaching(0), ridge=-1.0),
        lambda: ns.learn(reaching(0), basis_functions=-1),
        lambda: ns.learn(reaching(0), alpha_s=-0.01),
        lambda: Attractor(-25.0, 6.25),
        lambda: learned(0).rollout(duration=0.0),
        lambda: learned(0).rollout(start_position=[0.0, 0.0]),
        lambda: learned(0).rollout(goal_position=np.ones((1, 3))),
        lambda: ns.PoseTrajectory([1.0, 0.0], np.zeros((2, 3)), Rotation.identity(2)),
    ],
)
def test_what_is_no_argument_is_refused_in_one_line(made: Any) -> None:
    with pytest.raises(InputError) as raised:
        made()
    assert "\n" not in str(raised.value)
