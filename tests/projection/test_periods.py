"""Trajectory projection of periods: the last sample is the first one again, and a step leads on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from noslip import Blade, Boundary, KeepOutSphere, PoseTrajectory, velocity_constraint
from noslip.constraints import ConstraintSystem
from noslip.demonstrations.cycles import closed
from noslip.errors import ConvergenceError, InputError
from noslip.projection import problem
from noslip.projection.band import Band, Ring
from noslip.projection.request import LEARNING, Request
from noslip.projection.trajectory import project_trajectory
from strategies import seeds

SYSTEM = ConstraintSystem(Blade())


def loop(kind: str, seed: int = 0, count: int = 61) -> PoseTrajectory:
    """A closed cut of about half a meter in 2 s, its blade askew by up to 20 degrees."""
    s = np.linspace(0, 1, count)
    a, rng = 2 * np.pi * s, np.random.default_rng(seed)
    x, y, z = {
        "eight": (0.1 * np.sin(a), 0.05 * np.sin(2 * a), 0 * a),
        "lap": (0.1 * np.cos(a), 0.07 * np.sin(a), 0.01 * np.sin(2 * a)),
        "saw": (0.1 * np.sin(a), 0.004 * np.sin(2 * a), 0.02 * np.cos(a)),
    }[kind]
    positions = np.column_stack([x, y, z])
    askew = 0.2 * rng.uniform(-1, 1) + 0.1 * np.sin(a + rng.uniform(0, 6))
    v = np.roll(positions[:-1], -1, axis=0) - np.roll(positions[:-1], 1, axis=0)
    v = np.vstack([v, v[:1]])
    heading = 0 * a if kind == "saw" else np.unwrap(np.arctan2(v[:, 1], v[:, 0]))
    rotations = Rotation.from_euler("z", heading + askew)
    return closed(PoseTrajectory(2 * s, positions, rotations, name=kind))


def slip(motion: PoseTrajectory) -> float:
    return float(np.abs(motion.body_velocities[:, 1]).max())


def again(motion: PoseTrajectory, times: int) -> PoseTrajectory:
    """So many periods, one after the other."""
    rows = np.append(np.tile(np.arange(len(motion) - 1), times), 0)
    clock = np.linspace(0, times * motion.duration, len(rows))
    return motion.with_points(motion.points[rows], clock)


@given(st.sampled_from(["eight", "lap", "saw"]), seeds)
@settings(max_examples=6)
def test_a_period_closes_and_does_not_slip(kind: str, seed: int) -> None:
    cut = loop(kind, seed)
    found = project_trajectory(cut, [Blade()], periodic=True)
    motion = found.trajectory
    assert found.residual <= 1e-11 * cut.path_length / cut.duration
    assert slip(motion) < 1e-12
    np.testing.assert_array_equal(motion.positions[-1], motion.positions[0])
    assert (motion.rotations[-1] * motion.rotations[0].inv()).magnitude() < 1e-12
    # Nothing changes more where it closes than anywhere else.
    for steps in motion.step_velocities():
        changes = np.linalg.norm(np.diff(np.vstack([steps, steps[:1]]), axis=0), axis=1)
        assert changes[-1] <= changes[:-1].max()
    away = np.linalg.norm(motion.positions - cut.positions, axis=1)
    assert away.max() < 2e-3 * cut.path_length


@pytest.mark.parametrize("kind", ["eight", "lap"])
def test_it_is_the_middle_of_several_periods(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cut, times = loop(kind), 5
    one = project_trajectory(cut, SYSTEM, periodic=True).trajectory
    # The same cost, over the duration of all of them.
    monkeypatch.setattr(problem, "_SLOPE", problem._SLOPE / times**2)
    weights = replace(
        LEARNING,
        position=LEARNING.position * times**2,
        position_smoothing=LEARNING.position_smoothing / times**2,
        rotation_smoothing=LEARNING.rotation_smoothing / times**4,
    )
    several = project_trajectory(
        again(cut, times),
        SYSTEM,
        position_weight=weights.position,
        position_smoothing=weights.position_smoothing,
        rotation_smoothing=weights.rotation_smoothing,
    ).trajectory
    middle = several[2 * (len(cut) - 1) : 3 * (len(cut) - 1) + 1]
    np.testing.assert_allclose(middle.positions, one.positions, atol=1e-7)
    assert (middle.rotations * one.rotations.inv()).magnitude().max() < 1e-5


@given(st.integers(1, 59))
@settings(max_examples=3)
def test_where_a_period_begins_does_not_matter(shift: int) -> None:
    cut = loop("lap")
    rows = (np.arange(len(cut)) + shift) % (len(cut) - 1)
    one = project_trajectory(cut, SYSTEM, periodic=True).trajectory
    other = project_trajectory(cut.with_points(cut.points[rows]), SYSTEM, periodic=True).trajectory
    np.testing.assert_allclose(other.positions, one.positions[rows], atol=1e-8)
    assert (other.rotations * one.rotations[rows].inv()).magnitude().max() < 1e-6


def test_a_tool_held_still_turns_round_with_its_lap() -> None:
    """Its turn goes on and on: what closes is the rotation, not its vector."""
    lap = loop("lap")
    flat = lap.positions * [1.0, 1.0, 0.0]
    still = PoseTrajectory(lap.times, flat, Rotation.identity(len(lap)))
    motion = project_trajectory(still, SYSTEM, periodic=True).trajectory
    assert slip(motion) < 1e-12
    turned = np.sum(motion.step_velocities()[1][:, 2]) * motion.period
    assert turned == pytest.approx(2 * np.pi, abs=1e-9)


def test_what_is_passed_on_the_way_is_passed() -> None:
    lap = loop("lap")
    via = Boundary(0.25, lap.positions[15] + [0.0, 0.002, 0.0])
    motion = project_trajectory(lap, SYSTEM, periodic=True, boundaries=[via]).trajectory
    np.testing.assert_allclose(motion.positions[15], via.position, atol=1e-12)
    assert slip(motion) < 1e-11


def test_limits_hold_all_around() -> None:
    lap = loop("lap")
    # In the way where the period begins.
    rules = [Blade(), KeepOutSphere(tuple(lap.positions[0] * 1.02), 0.01)]
    found = project_trajectory(lap, rules, periodic=True)
    away = np.linalg.norm(found.trajectory.positions - lap.positions[0] * 1.02, axis=1)
    assert away.min() > 0.01 - 1e-7
    assert slip(found.trajectory) < 1e-10


@velocity_constraint
def carried(motion: Any) -> Any:
    """A belt takes it along at 10 mm/s."""
    return motion.linear_velocity[0] - 0.01


def test_what_cannot_close_says_by_how_much() -> None:
    lap = loop("lap", count=41)
    with pytest.raises(
        ConvergenceError, match=r"end 0\.02 m from where it begins, turned by .*deg"
    ):
        project_trajectory(lap, [carried], periodic=True, max_iterations=3)


def test_what_is_no_period_is_refused() -> None:
    lap = loop("lap")
    for wrong, said in (
        ({"start": "pose", "end": "pose"}, "not both"),
        ({"start": replace(Boundary.keeping(lap, 0.0, "pose"), linear_velocity=[0, 0, 0])}, "ends"),
        ({"periodic": "yes"}, "periodic must be True or False"),
    ):
        with pytest.raises(InputError, match=said):
            project_trajectory(lap, SYSTEM, **{"periodic": True, **wrong})
    with pytest.raises(InputError, match=r"ends where it begins.*close it first"):
        project_trajectory(lap[:40], SYSTEM, periodic=True)
    with pytest.raises(InputError, match="6 or more samples"):
        project_trajectory(lap[::15], SYSTEM, periodic=True)


@given(seeds, st.integers(6, 12), st.booleans())
@settings(max_examples=20)
def test_a_ring_is_solved_as_a_dense_matrix(seed: int, count: int, over: bool) -> None:
    rng, stage = np.random.default_rng(seed), 3
    ring = Ring(count, stage, stage if over else 0)
    dense = np.zeros((count, stage, count, stage))
    stages = np.arange(count)

    def put(a: int, i: int, b: int, j: int, values: Any) -> None:
        np.add.at(dense, ((stages + a) % count, i, (stages + b) % count, j), values)

    for i, j in np.ndindex(stage, stage):
        for shift in (-1, 0, 1):
            values = rng.normal(size=count) + 20 * (i == j and shift == 0)
            ring.add(shift, i, j, values)
            put(0, i, shift, j, values)
            np.testing.assert_array_equal(ring.entries(shift, i, j)[0], dense[0, i, shift, j])
            ring.add_transposed(shift, i, j, values)
            put(shift, j, 0, i, values)
        if over:
            values = rng.normal(size=count)
            ring.add_between(-1, i, 1, j, values)
            put(-1, i, 1, j, values)
    ring.add_bending(1, 2.0)
    for shift, share in ((-2, 1), (-1, -4), (0, 6), (1, -4), (2, 1)):
        put(0, 1, shift, 1, 2.0 * share)
    slopes = rng.uniform(size=count)
    ring.add_slope(2, slopes)
    first = np.eye(count) - np.roll(np.eye(count), -1, axis=1)
    dense[:, 2, :, 2] += first.T @ np.diag(slopes) @ first
    ring.fix(4, 0)
    dense[4, 0], dense[:, :, 4, 0], dense[4, 0, 4, 0] = 0.0, 0.0, 1.0
    right = rng.normal(size=count * stage)
    size = count * stage
    expected = np.linalg.solve(dense.reshape(size, size), right)
    np.testing.assert_allclose(ring.solve(right), expected, atol=1e-9)
    assert isinstance(ring, Band)


def test_a_request_of_a_period_is_one_of_its_own_kind() -> None:
    lap = loop("lap")
    assert Request(lap, SYSTEM, is_periodic=True) != Request(lap, SYSTEM)
