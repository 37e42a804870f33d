"""Samples that stay as they are between the ends, and the clock that a projection starts at."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from measures import slip
from motions import along
from noslip import (
    Blade,
    Boundary,
    PoseTrajectory,
    position_constraint,
    project_trajectory,
    velocity_constraint,
)
from noslip.constraints import Instant, PlaneContact
from noslip.errors import ConvergenceError, InputError
from strategies import seeds

BLADE = Blade()
LAST = 200


def askew(seed: int) -> PoseTrajectory:
    """A random smooth cut of about 1.5 m in 1 s, its edge beside the path by up to 15 degrees."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, LAST + 1)
    x = np.outer(s, [1.5, 0, 0])
    for k in (1, 2):
        x += np.outer(np.sin(np.pi * k * s + rng.uniform(0, 6)), 0.1 * rng.uniform(-1, 1, 3) / k)
    error = np.outer(np.sin(np.pi * rng.uniform(0.5, 2) * s), 0.15 * rng.uniform(-1, 1, 3))
    rotations = Rotation.from_rotvec(error) * along(x, s)
    return PoseTrajectory(s, x, rotations, name=f"cut {seed}")


def kept(motion: PoseTrajectory, what: dict[int, Any]) -> list[Boundary]:
    """What a motion has at some of its samples."""
    last = len(motion) - 1
    return [Boundary.keeping(motion, k / last, part) for k, part in what.items()]


def turned(one: PoseTrajectory, other: PoseTrajectory, k: int) -> float:
    return float((one.rotations[k] * other.rotations[k].inv()).magnitude())


@position_constraint
def breathing(motion: Instant) -> Any:
    return motion.position[2] - 0.1 * ca.sin(3 * motion.time)


@velocity_constraint
def drifting(motion: Instant) -> Any:
    lateral = motion.rotation[:, 1]
    return ca.dot(lateral, motion.linear_velocity) - 0.1 * ca.cos(2 * motion.time)


# -------------------------------------------------------------------- kept


@given(seeds, st.lists(st.sampled_from(["pose", "position", "rotation"]), min_size=1, max_size=4))
@settings(max_examples=25)
def test_kept_samples_stay_and_the_blade_does_not_slip(seed: int, what: list[Any]) -> None:
    motion = askew(seed)
    places = np.linspace(0, LAST, len(what) + 2).astype(int)[1:-1]
    keep = dict(zip(places.tolist(), what, strict=True))
    found = project_trajectory(
        motion, BLADE, boundaries=kept(motion, keep), position_weight=10
    ).trajectory
    assert np.abs(slip(found)).max() <= 1e-10
    for k, part in keep.items():
        if part in ("pose", "position"):
            np.testing.assert_array_equal(found.positions[k], motion.positions[k])
        if part in ("pose", "rotation"):
            assert turned(found, motion, k) <= 1e-14


# Without this, the test above could pass because nothing moves anyway.
@given(seeds)
@settings(max_examples=10)
def test_only_what_is_kept_stays(seed: int) -> None:
    motion = askew(seed)
    found = project_trajectory(motion, BLADE, position_weight=10).trajectory
    moved = np.abs(found.positions - motion.positions).max(axis=1)
    k = int(np.argmax(moved[1:-1])) + 1
    assert moved[k] > 1e-6
    found = project_trajectory(
        motion, BLADE, position_weight=10, boundaries=kept(motion, {k: "rotation"})
    ).trajectory
    assert np.abs(found.positions[k] - motion.positions[k]).max() > 1e-9
    found = project_trajectory(
        motion, BLADE, position_weight=10, boundaries=kept(motion, {k: "position"})
    ).trajectory
    assert turned(found, motion, k) > 1e-9


def test_keeping_nothing_changes_nothing() -> None:
    motion = askew(3)
    plain = project_trajectory(motion, BLADE).trajectory
    for boundaries in ((), kept(motion, {50: "free"})):
        found = project_trajectory(motion, BLADE, boundaries=boundaries).trajectory
        np.testing.assert_array_equal(found.positions, plain.positions)


# A feasible trajectory is its own projection, whatever of it is kept.
@given(seeds, st.sets(st.integers(1, LAST - 1), min_size=1, max_size=12))
@settings(max_examples=15)
def test_of_a_feasible_trajectory_any_samples_can_be_kept(seed: int, places: set[int]) -> None:
    feasible = project_trajectory(askew(seed), BLADE).trajectory
    keep: dict[int, Any] = dict.fromkeys(places, "pose")
    found = project_trajectory(
        feasible, BLADE, start="pose", end="pose", boundaries=kept(feasible, keep)
    ).trajectory
    assert np.abs(found.positions - feasible.positions).max() < 1e-8
    assert max(turned(found, feasible, k) for k in range(LAST + 1)) < 1e-7


@given(seeds)
@settings(max_examples=10)
def test_the_second_sample_kept_with_the_first_keeps_the_first_velocity(seed: int) -> None:
    feasible = project_trajectory(askew(seed), BLADE).trajectory
    # From the second step on askew again, so that the projection has something to do.
    error = np.zeros((LAST + 1, 3))
    error[2:, 2] = 0.1 * np.sin(np.linspace(0, np.pi, LAST - 1))
    motion = PoseTrajectory(
        feasible.times, feasible.positions, Rotation.from_rotvec(error) * feasible.rotations
    )
    found = project_trajectory(
        motion, BLADE, start="pose", boundaries=kept(motion, {1: "pose"}), position_weight=10
    ).trajectory
    for before, after in zip(feasible.step_velocities(), found.step_velocities(), strict=True):
        np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-11)
    assert np.abs(slip(found)).max() <= 1e-10


# Two neighbors that the blade cannot lead from one to the other.
def test_samples_that_contradict_the_constraint_fail_clearly() -> None:
    motion = askew(1)
    keep: dict[int, Any] = {100: "pose", 101: "pose"}
    assert abs(slip(motion)[100]) > 1e-3
    with pytest.raises(ConvergenceError, match="no trajectory near it"):
        project_trajectory(motion, BLADE, boundaries=kept(motion, keep))
    result = project_trajectory(motion, BLADE, boundaries=kept(motion, keep), on_failure="return")
    assert not result.converged and result.residual > 1e-4


@pytest.mark.parametrize("what", ["position", "pose"])
def test_a_kept_sample_off_a_surface_fails_clearly(what: Any) -> None:
    with pytest.raises(ConvergenceError, match="plane-contact"):
        motion = askew(1)
        project_trajectory(
            motion, PlaneContact(point=(0, 0, 5)), boundaries=kept(motion, {70: what})
        )


@pytest.mark.parametrize("at", [0.2 / LAST, 1 - 0.2 / LAST, 100.2 / LAST])
def test_a_sample_can_have_one_boundary_only(at: float) -> None:
    motion = askew(1)
    ends = {"start": "pose", "end": "pose"}
    with pytest.raises(InputError, match="falls on an end or on another via; 201 samples"):
        project_trajectory(
            motion,
            BLADE,
            **ends,
            boundaries=[*kept(motion, {100: "pose"}), Boundary(at, [0, 0, 0])],
        )


@pytest.mark.parametrize("what", [(0.5, [0, 0, 0]), "pose", None])
def test_what_is_no_boundary_is_refused(what: Any) -> None:
    with pytest.raises(InputError, match="expected a Boundary"):
        project_trajectory(askew(1), BLADE, boundaries=[what])


def test_an_unknown_part_of_a_sample_is_refused() -> None:
    with pytest.raises(InputError, match=r"must be free, position, rotation or pose"):
        Boundary.keeping(askew(1), 0.5, "everything")  # type: ignore[arg-type]


@given(seeds)
@settings(max_examples=5)
def test_with_the_position_held_a_kept_rotation_still_stays(seed: int) -> None:
    # The edge is right where it is kept: with the position held nothing else could be.
    motion = project_trajectory(askew(seed), BLADE, hold_position=True).trajectory
    error = np.zeros((LAST + 1, 3))
    error[:, 0] = 0.1 * np.sin(np.linspace(0, 2 * np.pi, LAST + 1))
    askew_again = PoseTrajectory(
        motion.times, motion.positions, Rotation.from_rotvec(error) * motion.rotations
    )
    found = project_trajectory(
        askew_again, BLADE, hold_position=True, boundaries=kept(askew_again, {100: "rotation"})
    ).trajectory
    np.testing.assert_array_equal(found.positions, motion.positions)
    assert turned(found, askew_again, 100) <= 1e-14
    assert np.abs(slip(found)).max() <= 1e-10


# -------------------------------------------------------------------- the clock


@given(seeds, st.floats(-5, 50))
@settings(max_examples=10)
def test_the_clock_starts_where_it_is_told(seed: int, begin: float) -> None:
    motion = askew(seed)
    on = project_trajectory(motion, breathing, begin=begin).trajectory
    heights = 0.1 * np.sin(3 * (begin + motion.times))
    np.testing.assert_allclose(on.positions[:, 2], heights, rtol=0, atol=1e-10)
    on = project_trajectory(motion, drifting, begin=begin).trajectory
    middles = (motion.times[1:] + motion.times[:-1]) / 2
    wanted = 0.1 * np.cos(2 * (begin + middles))
    np.testing.assert_allclose(slip(on), wanted, rtol=0, atol=1e-10)


# What a recording calls its first instant says nothing about the constraint's clock.
def test_stamps_do_not_move_the_clock() -> None:
    motion = askew(5)
    late = PoseTrajectory(motion.times + 1000.0, motion.positions, motion.rotations)
    for begin in (0.0, 0.7):
        early, shifted = (
            project_trajectory(m, breathing, begin=begin).trajectory for m in (motion, late)
        )
        np.testing.assert_allclose(shifted.positions, early.positions, rtol=0, atol=1e-8)


def test_a_constraint_that_knows_no_time_ignores_the_clock() -> None:
    motion = askew(6)
    found = [project_trajectory(motion, BLADE, begin=begin).trajectory for begin in (0.0, 123.0)]
    np.testing.assert_allclose(found[0].positions, found[1].positions, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_samples_are_kept_of_a_long_recording_too() -> None:
    base = askew(2)
    long = base.resampled(times=np.linspace(0, 1, 4201))
    boundaries = kept(long, {1234: "pose", 3000: "position"})
    found = project_trajectory(long, BLADE, boundaries=boundaries).trajectory
    np.testing.assert_array_equal(found.positions[[1234, 3000]], long.positions[[1234, 3000]])
    assert turned(found, long, 1234) <= 1e-14
    assert np.abs(slip(found)).max() <= 1e-10
