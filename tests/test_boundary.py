"""What a motion must reach: a value like any other, and met by the projection."""

from __future__ import annotations

import copy
import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import Boundary
from noslip._typing import Floats
from noslip.boundary import end_twist, sample_of, twist
from strategies import seeds

BLADE = ns.Blade()
PARTS = ("position", "rotation", "linear_velocity", "angular_velocity")


def some(seed: int) -> dict[str, Any]:
    """Arguments of a boundary, some of them left out."""
    rng = np.random.default_rng(seed)
    named = {name: rng.normal(size=3) for name in PARTS if rng.uniform() < 0.7}
    if "rotation" in named:
        named["rotation"] = Rotation.from_rotvec(named["rotation"])
    return {"at": rng.uniform(), **named}


def bent(count: int = 201) -> ns.PoseTrajectory:
    """A bent cut in 2 s with the edge along it, whose velocity is never zero."""
    s = np.linspace(0, 1, count)
    x = np.column_stack([s, 0.2 * np.sin(2 * s), 0.1 * np.sin(3 * s)])
    v = np.column_stack([np.ones(count), 0.4 * np.cos(2 * s), 0.3 * np.cos(3 * s)])
    yaw, pitch = np.arctan2(v[:, 1], v[:, 0]), -np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1]))
    rotations = Rotation.from_euler("ZY", np.column_stack([yaw, pitch]))
    return ns.PoseTrajectory(2 * s, x, rotations, name="bent")


@cache
def cutting() -> ns.ConstrainedDMP:
    """A blade's primitive, cheap to adapt."""
    return ns.learn(bent(301), [BLADE], basis_functions=40)


def slip(motion: ns.PoseTrajectory) -> float:
    residuals = ns.check(motion, BLADE).constraints[0]
    return float(residuals.peak)


# -------------------------------------------------------------------- a value


@given(seeds)
def test_copies_are_equal_and_others_are_not(seed: int) -> None:
    named = some(seed)
    one = Boundary(**named)
    for other in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one), Boundary(**named)):
        assert other == one and hash(other) == hash(one)
    for name in PARTS:
        changed = dict(named)
        if name in named:
            del changed[name]
        else:
            changed[name] = Rotation.identity() if name == "rotation" else np.zeros(3)
        assert Boundary(**changed) != one
    assert Boundary(**{**named, "at": named["at"] / 2}) != one
    assert one != "a boundary"


@given(seeds)
def test_a_rotation_is_the_same_by_either_quaternion(seed: int) -> None:
    quaternion = Rotation.random(rng=np.random.default_rng(seed)).as_quat()
    one, other = (Boundary(1, rotation=Rotation.from_quat(s * quaternion)) for s in (1, -1))
    assert one == other and hash(one) == hash(other)


def test_what_a_caller_does_to_its_arguments_later_changes_nothing() -> None:
    position, rotation = np.zeros(3), Rotation.identity()
    boundary = Boundary(1, position, rotation)
    position += 1.0
    assert boundary == Boundary(1, np.zeros(3), Rotation.identity())
    for kept in (boundary, pickle.loads(pickle.dumps(boundary))):
        with pytest.raises(ValueError, match="read-only"):
            kept.position[0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"at": -0.1}, "at must be"),
        ({"at": 1.1}, "at must be"),
        ({"at": np.nan}, "at must be"),
        ({"at": "soon"}, "at must be"),
        ({"at": 1, "position": [[1, 2, 3]]}, "position must be 3 finite numbers"),
        ({"at": 1, "position": [np.nan, 0, 0]}, "position must be 3 finite numbers"),
        ({"at": 1, "position": "abc"}, "position must be 3 finite numbers"),
        ({"at": 1, "rotation": np.eye(3)}, "rotation must be a single"),
        ({"at": 1, "rotation": 1.57}, r"of a yaw take Rotation.from_euler\('z', 1.57\)"),
        ({"at": 1, "linear_velocity": 0}, r"linear velocity must be 3 finite numbers.*m/s"),
        ({"at": 1, "angular_velocity": [np.inf, 0, 0]}, r"angular velocity must be 3.*rad/s"),
    ],
)
def test_what_is_no_boundary_is_refused_in_one_line(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ns.errors.InputError, match=said) as error:
        Boundary(**arguments)
    assert "\n" not in str(error.value)


@given(seeds, st.floats(0, 1), st.sampled_from(["free", "position", "rotation", "pose"]))
@settings(max_examples=30)
def test_what_is_kept_of_a_trajectory_is_what_it_has(seed: int, at: float, what: Any) -> None:
    motion = bent(51)
    kept = Boundary.keeping(motion, at, what)
    k = sample_of(at, 51)
    assert (kept.position is not None) == (what in ("position", "pose"))
    assert (kept.rotation is not None) == (what in ("rotation", "pose"))
    if kept.position is not None:
        np.testing.assert_array_equal(kept.position, motion.positions[k])
    if kept.rotation is not None:
        assert (kept.rotation * motion.rotations[k].inv()).magnitude() == 0
    assert kept.is_free == (what == "free") and kept.is_pose == (what == "pose")


def test_vias_of_every_form_are_the_same() -> None:
    turned = Rotation.from_rotvec([0, 0, 1])
    for form, meant in (
        ((0.5, [1, 2, 3]), Boundary(0.5, [1, 2, 3])),
        ((0.5, [1, 2, 3], turned), Boundary(0.5, [1, 2, 3], turned)),
        (Boundary(0.5, rotation=turned), Boundary(0.5, rotation=turned)),
    ):
        assert Boundary.via(form) == meant
        assert Boundary.vias([(0.7, [0, 0, 0]), form])[0] == meant


@pytest.mark.parametrize("value", [[1, 2], "fast", 1.0, [np.nan, 0, 0], [[1], [2, 3]]])
def test_what_is_no_twist_is_refused(value: Any) -> None:
    with pytest.raises(ns.errors.InputError, match=r"^speed must be 0, 3 finite numbers"):
        twist("speed", value)


def test_a_twist_is_at_rest_without_turning_or_whole() -> None:
    for value, meant in ((0, np.zeros(6)), ([1, 2, 3], [1, 2, 3, 0, 0, 0]), (range(6), range(6))):
        np.testing.assert_array_equal(np.concatenate(twist("speed", value)), list(meant))


# -------------------------------------------------------------------- velocities at the ends


def twisted(seed: int, motion: ns.PoseTrajectory, k: int, at: float) -> Boundary:
    """A pose near a motion's sample with velocities near its own that the blade allows."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)) * motion.rotations[k]
    lateral = rotation.as_matrix()[:, 1]
    linear = motion.linear_velocities[k] + rng.uniform(-0.1, 0.1, 3)
    linear -= lateral * (lateral @ linear)
    position = motion.positions[k] + rng.uniform(-0.03, 0.03, 3)
    return Boundary(at, position, rotation, linear, rng.uniform(-0.3, 0.3, 3))


@given(seeds, st.sampled_from(["start", "end", "both"]))
@settings(max_examples=10)
def test_velocities_at_either_end_are_met(seed: int, which: str) -> None:
    motion = bent()
    ends = {"start": twisted(seed, motion, 0, 0.0), "end": twisted(seed + 1, motion, -1, 1.0)}
    asked = ends if which == "both" else {which: ends[which]}
    result = ns.project_trajectory(motion, BLADE, **asked, position_weight=10)
    found = result.trajectory
    assert len(found) == len(motion) == len(result.turns) == len(result.residuals)
    np.testing.assert_array_equal(found.times, motion.times)
    assert slip(found) <= 1e-10 and result.residual <= 1e-10
    for name, k in (("start", 0), ("end", -1)):
        if name not in asked:
            continue
        boundary = asked[name]
        np.testing.assert_allclose(found.positions[k], boundary.position, atol=1e-14)
        assert (found.rotations[k] * boundary.rotation.inv()).magnitude() < 1e-14
        np.testing.assert_allclose(found.linear_velocities[k], boundary.linear_velocity, atol=1e-9)
        np.testing.assert_allclose(
            found.angular_velocities[k], boundary.angular_velocity, atol=1e-9
        )


def at_end(steps: Floats, side: int) -> Floats:
    """Velocity at an end; that of a step is the one half a step from it."""
    near, next_ = (0, 1) if side < 0 else (-1, -2)
    return np.asarray(1.5 * steps[near] - 0.5 * steps[next_])


# What the samples do, not only what the trajectory says of itself.
def test_the_samples_approach_the_velocities_as_steps_grow_shorter() -> None:
    missed = []
    for count in (101, 401):
        motion = bent(count)
        start, end = twisted(3, motion, 0, 0.0), twisted(4, motion, -1, 1.0)
        found = ns.project_trajectory(
            motion,
            BLADE,
            start=start,
            end=end,
            position_weight=10,
            position_smoothing=1e-2,
            rotation_smoothing=1e-2,
        ).trajectory
        linear, angular = found.step_velocities()
        missed.append(
            [
                np.abs(at_end(steps, side) - asked).max()
                for side, boundary in ((-1, start), (1, end))
                for steps, asked in (
                    (linear, boundary.linear_velocity),
                    (angular, boundary.angular_velocity),
                )
            ]
        )
    coarse, fine = np.array(missed)
    assert np.all(fine <= 0.35 * coarse)
    assert fine[[0, 2]].max() <= 0.01 and fine[[1, 3]].max() <= 0.1


def test_velocities_that_are_not_named_are_the_references() -> None:
    motion = bent()
    start = Boundary(0, motion.positions[0], motion.rotations[0], motion.linear_velocities[0])
    found = ns.project_trajectory(motion, BLADE, start=start).trajectory
    np.testing.assert_allclose(found.angular_velocities[0], end_twist(motion, 0)[1], atol=1e-12)


@given(seeds)
@settings(max_examples=5)
def test_a_motion_adapted_to_come_to_rest_does(seed: int) -> None:
    dmp, rng = cutting(), np.random.default_rng(seed)
    goal = dmp.goal_position + rng.uniform(-0.1, 0.1, 3)
    moving, resting = (dmp.adapt(goal_position=goal, **v) for v in ({}, {"goal_velocity": 0}))
    motion = resting.rollout()
    assert np.linalg.norm(motion.positions[-1] - goal) <= 1e-3
    speeds, usual = (
        np.linalg.norm(m.step_velocities()[0], axis=1) for m in (motion, moving.rollout())
    )
    assert usual[-1] >= 0.3 * usual.mean()
    assert speeds[-1] <= 0.1 * speeds.mean()
    assert slip(motion) <= 1e-10
