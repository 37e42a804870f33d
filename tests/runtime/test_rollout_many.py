"""Thousands of rollouts at once are those that one by one gives."""

from __future__ import annotations

import tracemalloc
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.experiments.numerical_example import demonstration
from noslip.runtime.stepper import stepper_of

COUNT = 7


@cache
def primitive(name: str = "blade") -> ns.ConstrainedDMP:
    constraints: dict[str, Any] = {
        "blade": [ns.Blade()],
        "free": [],
        "limits": [ns.Blade(), ns.constraints.HalfSpace(point=(0.9, 0, 0), normal=(-1, 0, 0))],
        "breathing": [ns.constraints.InMovingFrame(ns.Blade())],
    }
    return ns.learn(demonstration(), constraints[name], metric="position")


def variants(dmp: ns.ConstrainedDMP) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    turns = Rotation.from_rotvec(0.3 * rng.normal(size=(COUNT, 3)))
    return {
        "goals": dmp.goal_position + 0.1 * rng.normal(size=(COUNT, 3)),
        "goal_rotations": turns * dmp.goal_rotation,
        "starts": dmp.start_position + 0.05 * rng.normal(size=(COUNT, 3)),
        "start_rotations": turns.inv() * dmp.start_rotation,
        "durations": rng.uniform(0.5, 3.0, COUNT),
    }


ONE = {
    "goals": "goal_position",
    "goal_rotations": "goal_rotation",
    "starts": "start_position",
    "start_rotations": "start_rotation",
    "durations": "duration",
}


def same_as_one_by_one(dmp: ns.ConstrainedDMP, given: dict[str, Any]) -> None:
    seen: list[tuple[int, int]] = []
    motions = dmp.rollout_many(**given, progress=lambda done, total: seen.append((done, total)))
    assert len(motions) == COUNT
    assert seen[-1] == (COUNT, COUNT)
    for i in range(COUNT):
        one = dmp.rollout(**{ONE[name]: values[i] for name, values in given.items()})
        close = {"rtol": 0, "atol": 1e-12}
        np.testing.assert_allclose(motions.times[i], one.times, **close)
        np.testing.assert_allclose(motions.positions[i], one.positions, **close)
        sign = np.sign(np.sum(motions.quaternions[i] * one.quaternions, axis=1))
        np.testing.assert_allclose(sign[:, None] * motions.quaternions[i], one.quaternions, **close)
        for name in ("linear_velocities", "angular_velocities", "constraint_residuals", "margins"):
            own = getattr(one, name)
            far = max(1.0, float(np.abs(own).max(initial=0)))
            np.testing.assert_allclose(getattr(motions, name)[i], own, rtol=0, atol=1e-11 * far)
        np.testing.assert_array_equal(motions[i].positions, motions.positions[i])


def test_their_paths_are_as_long_as_those_of_each() -> None:
    dmp = primitive()
    goals = dmp.goal_position + 0.1 * np.random.default_rng(1).normal(size=(70, 3))
    motions = dmp.rollout_many(goals=goals, steps=20)
    each = [motions[k].path_length for k in range(70)]
    np.testing.assert_allclose(motions.path_lengths, each, rtol=1e-14)


@pytest.mark.parametrize("name", ["blade", "free", "limits", "breathing"])
def test_compiled_they_are_those_of_one_by_one(name: str, compiling: Path) -> None:
    # A primitive of its own: what one test compiles no other must find.
    dmp = primitive.__wrapped__(name)
    same_as_one_by_one(dmp, variants(dmp))
    assert stepper_of(dmp.rule).native.library is not None


def test_without_a_compiler_too() -> None:
    dmp = primitive()
    same_as_one_by_one(dmp, variants(dmp))
    assert stepper_of(dmp.rule).native.library is None


@pytest.mark.parametrize("name", ["goals", "durations", "start_rotations"])
def test_what_is_not_given_is_the_primitives_own(name: str) -> None:
    dmp = primitive()
    same_as_one_by_one(dmp, {name: variants(dmp)[name]})


def test_it_holds_little_more_than_its_result(compiling: Path) -> None:
    dmp = primitive.__wrapped__()
    goals = dmp.goal_position + 0.1 * np.random.default_rng(1).normal(size=(400, 3))
    dmp.rollout_many(goals=goals[:2])
    tracemalloc.start()
    motions = dmp.rollout_many(goals=goals)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    result = motions.states.nbytes + motions.constraint_residuals.nbytes + motions.margins.nbytes
    assert peak <= 1.1 * result + 1e6


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "nothing differs"),
        ({"goals": [[1, 2]]}, r"goals must have shape \(M, 3\)"),
        ({"goals": [[1, 2, np.nan]]}, r"goals\[0\] is not finite"),
        ({"goals": np.zeros((0, 3))}, "goals is empty"),
        ({"goals": np.zeros((2, 3)), "durations": [1.0]}, "durations has 1 rows, but goals has 2"),
        ({"durations": [[1.0]]}, r"durations must have shape \(M,\)"),
        ({"durations": [1.0, 0.0]}, r"durations\[1\] is not positive"),
        ({"goal_rotations": Rotation.identity()}, "goal_rotations must be a SciPy Rotation of"),
        ({"starts": "here"}, "starts is not an array"),
        ({"durations": [1.0], "steps": 0}, "steps"),
        ({"durations": [1.0], "jobs": 0}, "jobs"),
    ],
)
def test_wrong_arguments_are_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ns.errors.InputError, match=said):
        primitive().rollout_many(**given)
