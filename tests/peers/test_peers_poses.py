"""What movement_primitives' tests ask of its Cartesian primitives, asked of ours as properties.

``docs/peers.md`` lists which of its assertions each test stands for.
"""

from __future__ import annotations

import copy
import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation, Slerp

import noslip as ns
from learned import Goal
from measures import apart, end_velocities
from noslip._typing import Floats
from noslip.constraints import KeepOutSphere
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Phase
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


@settings(max_examples=4)
@given(seeds)
def test_a_pose_demonstration_is_reproduced(seed: int) -> None:
    demonstration = reaching(seed % 8)
    motion = learned(seed % 8).rollout()
    np.testing.assert_allclose(motion.times, demonstration.times, atol=1e-12)
    moved, turned = apart(motion, demonstration)
    # Theirs: two decimals.
    assert moved <= 1e-4
    assert turned <= 1e-2


@pytest.mark.parametrize("steps", [100, 601, 999])
def test_a_motion_has_a_sample_a_step_and_both_ends(steps: int) -> None:
    dmp = ns.learn(reaching(1, duration=6.0), basis_functions=10)
    motion = dmp.rollout(time_step=6.0 / steps)
    assert len(motion) == steps + 1
    assert motion.times[-1] == pytest.approx(6.0)


@settings(max_examples=3)
@given(seeds)
def test_stepping_by_hand_is_the_rollout(seed: int) -> None:
    dmp, rng = learned(seed % 8), np.random.default_rng(seed)
    goal = Goal.beside(dmp, rng, 0.4)
    options = {"goal_position": goal.position, "goal_rotation": goal.rotation}
    motion = dmp.rollout(time_step=0.01, **options)
    state = dmp.initial_state(**options)
    for k in range(1, 101):
        state = dmp.step(state, 0.01)
        np.testing.assert_allclose(state.position, motion.positions[k], atol=1e-12)
        assert (state.rotation * motion.rotations[k].inv()).magnitude() <= 1e-11
    # Begun anew, it is the same motion: a state holds all there is.
    again = dmp.step(dmp.initial_state(**options), 0.01)
    np.testing.assert_array_equal(
        again.position, dmp.step(dmp.initial_state(**options), 0.01).position
    )


@settings(max_examples=3)
@given(seeds)
def test_another_duration_is_the_same_path(seed: int) -> None:
    dmp = learned(seed % 8)
    own = dmp.rollout()
    for factor in (0.5, 2.0, 7.0):
        other = dmp.rollout(duration=factor * dmp.duration)
        np.testing.assert_allclose(other.times, factor * own.times, atol=1e-12)
        np.testing.assert_allclose(other.positions, own.positions, atol=1e-12)
        assert (other.rotations * own.rotations.inv()).magnitude().max() <= 1e-11
        np.testing.assert_allclose(
            factor * other.linear_velocities, own.linear_velocities, atol=1e-10
        )


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


@settings(max_examples=3)
@given(seeds)
def test_without_a_learned_force_the_attractor_comes_to_its_goal(seed: int) -> None:
    """Theirs of springs and dampers, for positions and quaternions."""
    law, rng = learned(seed % 8).law, np.random.default_rng(seed)
    fields = {name: getattr(law, name) for name in Law.__dataclass_fields__}
    fields |= {
        "forcing": ForcingTerm(law.basis, np.zeros_like(law.forcing.weights)),
        "start_velocity": np.zeros(6),
    }
    still = ns.ConstrainedDMP(Law(**fields))
    goal = Goal.beside(still, rng, 1.0)
    motion = still.rollout(goal_position=goal.position, goal_rotation=goal.rotation)
    assert motion.end_error <= 1e-3
    assert motion.end_rotation_error <= 1e-3
    # What has no force and no way to go rests.
    at_rest = still.rollout(
        goal_position=still.start_position,
        goal_rotation=still.start_rotation,
        goal_form="paper",
    )
    assert np.abs(at_rest.positions - still.start_position).max() <= 1e-12


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


def test_a_primitive_is_written_and_read(tmp_path: Any) -> None:
    dmp = learned(2)
    for back in (
        pickle.loads(pickle.dumps(dmp)),
        copy.deepcopy(dmp),
        ns.load_primitive(dmp.save(tmp_path / "dmp.json")),
    ):
        assert back == dmp
        assert np.array_equal(back.rollout().positions, dmp.rollout().positions)


@given(seeds)
def test_the_phase_falls_exponentially_from_one(seed: int) -> None:
    rate = float(np.random.default_rng(seed).uniform(0.5, 6))
    times = np.linspace(0, 1, 11)
    np.testing.assert_allclose(Phase(rate).at(times), np.exp(-rate * times), rtol=1e-14)


@given(seeds)
def test_the_force_is_the_weighted_mean_of_its_activations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = Basis(int(rng.integers(2, 40)))
    phases = basis.phase.at(np.sort(rng.uniform(0, 1, 50)))
    weights = rng.normal(size=(basis.count, 2))
    activations = basis.activations(phases)
    assert activations.shape == (50, basis.count)
    np.testing.assert_allclose(activations.sum(axis=1), phases, rtol=1e-12)

    def gaussians() -> Floats:
        return np.exp(-0.5 * ((phases[:, None] - basis.centers) / basis.widths) ** 2)

    by_hand = phases[:, None] * (gaussians() @ weights) / gaussians().sum(axis=1)[:, None]
    np.testing.assert_allclose(ForcingTerm(basis, weights)(phases), by_hand, atol=1e-10)


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
