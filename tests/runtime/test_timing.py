"""Time gives way before the path: durations in which limits on speeds and accelerations hold."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import cut, eased
from noslip import Motion, PoseTrajectory
from noslip.constraints import AccelerationLimit, AngularRateLimit, ForwardOnly, Instant
from noslip.constraints.system import ConstraintSystem
from noslip.errors import CompromiseWarning, MissedError
from noslip.runtime.timing import paces, unhurried
from refusals import refusal

SLOW = ns.SpeedLimit(0.03)
PATH = 5e-5
"""How far a slower motion may be from the path (m)."""


def bend(duration: float = 2.0) -> PoseTrajectory:
    """A quarter of a circle from rest to rest, at up to 0.15 m/s; the edge is a little askew."""
    s = np.linspace(0, 1, 501)
    angle = np.pi / 2 * eased(s)
    # The eased rise is at most 1.875 times as fast as it is on average.
    radius = 0.15 * 2 / 1.875 / (np.pi / 2)
    path = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * s])
    turns = Rotation.from_euler("z", angle + 0.1 * np.sin(3 * s))
    return PoseTrajectory(duration * s, path, turns, name="bend")


def learned(*limits: ns.Constraint, **options: Any) -> ns.ConstrainedDMP:
    with pytest.warns(CompromiseWarning):
        return ns.learn(bend(), [ns.Blade(), *limits], **options)


@cache
def slow() -> ns.ConstrainedDMP:
    return learned(SLOW)


@cache
def free() -> Motion:
    return ns.learn(bend(), [ns.Blade()]).rollout()


@pytest.mark.parametrize("jump", [0.2, 1.0])
def test_the_first_kick_lasts_half_a_step(jump: float) -> None:
    # From a speed to that of the first step, in the time from the start to the step's middle.
    motion = free()
    h, velocities = motion.times[1] - motion.times[0], motion.linear_velocities.copy()
    velocities[0] = velocities[1] + [0.0, 0.0, jump]
    jerked = replace(motion, linear_velocities=velocities)
    most = 0.3 * jump / (h / 2)
    (found,) = paces(jerked, ConstraintSystem([AccelerationLimit(linear=most)]))
    assert found is not None
    # Twice as long is a quarter of the acceleration.
    assert found.factor == pytest.approx((jump / (h / 2) / most) ** 0.5, rel=1e-6)


def peaks(motion: PoseTrajectory) -> dict[str, float]:
    """Largest speeds and accelerations of the steps, by differences of the poses."""
    h = motion.times[1] - motion.times[0]
    linear = np.diff(motion.positions, axis=0) / h
    angular = (motion.rotations[1:] * motion.rotations[:-1].inv()).as_rotvec() / h
    sizes = {
        "speed": linear,
        "rate": angular,
        "acceleration": np.diff(linear, axis=0) / h,
        "angular acceleration": np.diff(angular, axis=0) / h,
    }
    return {name: float(np.linalg.norm(size, axis=1).max()) for name, size in sizes.items()}


def test_a_speed_limit_takes_time_and_leaves_the_path() -> None:
    with pytest.warns(CompromiseWarning, match=r"takes 10 s instead of 2 s.*'speed-limit'"):
        dmp = ns.learn(bend(), [ns.Blade(), SLOW])
    assert dmp.duration == pytest.approx(10.0, abs=0.05)
    motion = dmp.rollout()
    assert np.linalg.norm(motion.positions - free().positions, axis=1).max() <= PATH
    assert np.linalg.norm(motion.positions - bend().positions, axis=1).max() <= PATH
    assert motion.margins.min() >= 0 and motion.margins.min() <= 1e-9
    assert np.abs(motion.constraint_residuals).max() <= 1e-12
    for step in (1e-3, 7e-3):
        fine = dmp.rollout(time_step=step)
        assert fine.margins.min() >= -1e-12
        assert np.linalg.norm(fine.positions[-1] - bend().positions[-1]) <= PATH
    assert dmp.demonstrated.duration == dmp.duration


LIMITS: dict[str, Callable[[], tuple[ns.Constraint, float]]] = {
    "speed": lambda: (ns.SpeedLimit(0.05), peaks(free())["speed"] / 0.05),
    "soft speed": lambda: (ns.SpeedLimit(0.05, priority=1), peaks(free())["speed"] / 0.05),
    "rate": lambda: (AngularRateLimit(0.4), peaks(free())["rate"] / 0.4),
    "acceleration": lambda: (
        AccelerationLimit(linear=0.02),
        np.sqrt(peaks(free())["acceleration"] / 0.02),
    ),
    "angular acceleration": lambda: (
        AccelerationLimit(linear=None, angular=0.1),
        np.sqrt(peaks(free())["angular acceleration"] / 0.1),
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_the_duration_is_the_least_that_satisfies_the_limit(name: str) -> None:
    limit, factor = LIMITS[name]()
    dmp = learned(limit)
    # By the formulas: speeds fall with the duration, accelerations with its square.
    assert dmp.duration == pytest.approx(2 * factor, rel=1e-4)
    motion = dmp.rollout()
    assert motion.margins.min() >= -1e-9
    assert np.linalg.norm(motion.positions - free().positions, axis=1).max() <= PATH
    assert dmp.record[0].left_out == ()


def test_of_several_limits_the_slowest_counts() -> None:
    limits = [make()[0] for make in LIMITS.values()]
    with pytest.warns(CompromiseWarning) as told:
        dmp = ns.learn(bend(), [ns.Blade(), *limits])
    assert dmp.duration == pytest.approx(2 * max(make()[1] for make in LIMITS.values()), rel=1e-4)
    assert len(told) == 1
    assert dmp.rollout().margins.min() >= -1e-9


@ns.keep_nonnegative
def gentle(motion: Instant) -> Any:
    """Neither homogeneous in the velocities nor smooth: half of what may be is any bend's."""
    turning = ca.fabs(motion.angular_velocity[2])
    return 0.05 - ca.norm_2(motion.linear_velocity) - 0.02 * turning**2


def test_a_limit_of_any_expression_is_satisfied_in_the_least_duration() -> None:
    dmp = learned(gentle)
    motion, h = dmp.rollout(), dmp.duration / dmp.steps
    speed = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1) / h
    turn = np.abs((motion.rotations[1:] * motion.rotations[:-1].inv()).as_rotvec()[:, 2]) / h
    least = float((0.05 - speed - 0.02 * turn**2).min())
    assert least == pytest.approx(0.0, abs=1e-9)


def test_what_a_limit_allows_takes_as_long_as_it_did() -> None:
    dmp = ns.learn(bend(), [ns.Blade(), ns.SpeedLimit(0.16), AccelerationLimit(linear=1.0)])
    assert dmp.duration == 2.0
    np.testing.assert_allclose(dmp.rollout().positions, free().positions, rtol=0, atol=1e-12)


def test_a_limit_that_no_duration_satisfies_takes_no_time() -> None:
    """Backing up is backing up at any speed."""
    hand = bend()
    back = PoseTrajectory(hand.times, hand.positions[::-1], hand.rotations[::-1])
    dmp = ns.learn(back, [ForwardOnly()])
    assert dmp.duration == 2.0
    assert dmp.rollout().margins.min() >= -1e-9


def test_of_limits_that_no_duration_satisfies_together_the_soft_one_is_given_up() -> None:
    hurry, slowly = ForwardOnly(minimum=0.4, priority=1), ns.SpeedLimit(0.3)
    moving = ns.learn(cut(), [ns.Blade()])
    tried = []

    def carry_out(shaping: ConstraintSystem, factor: float) -> float:
        tried.append((shaping.names, factor))
        return factor

    _, pace = unhurried(
        ConstraintSystem([ns.Blade(), hurry, slowly]),
        carry_out,
        lambda factor, _: moving.rollout(duration=2 * factor),
    )
    assert pace.name == "speed-limit"
    assert pace.factor == pytest.approx(peaks(moving.rollout())["speed"] / 0.3, rel=1e-6)
    assert tried[-1] == (("blade", "forward-only"), pace.factor)


def test_position_limits_still_shape_the_path_that_takes_longer() -> None:
    wall = ns.constraints.HalfSpace(point=(0, 0.095, 0), normal=(0, -1, 0))
    dmp = learned(SLOW, wall)
    shaped = ns.learn(bend(), [ns.Blade(), wall]).rollout()
    motion = dmp.rollout()
    assert motion.margins.min() >= -1e-9
    assert motion.positions[:, 1].max() <= 0.095 + 1e-9
    assert np.linalg.norm(motion.positions - shaped.positions, axis=1).max() <= 1e-3


def test_several_demonstrations_take_longer_together() -> None:
    fast = bend(1.0)
    with pytest.warns(CompromiseWarning):
        dmp = ns.learn([bend(2.0), fast], [ns.Blade(), SLOW])
    assert dmp.duration == pytest.approx(10.0, abs=0.05)
    assert dmp.rollout().margins.min() >= -1e-9


def test_a_rate_limit_holds_through_a_cusp() -> None:
    s = np.linspace(0, 1, 601)
    u = s - 0.5
    path = np.column_stack([0.6 * u**2, 0.5 * u**3, 0 * s])
    hand = PoseTrajectory(s, path, Rotation.from_euler("z", 0.75 * u + 0.1 * np.sin(5 * s)))
    with pytest.warns(CompromiseWarning, match="angular-rate-limit"):
        dmp = ns.learn(hand, [ns.Blade(), AngularRateLimit(0.5)])
    for step in (None, 1e-3):
        motion = dmp.rollout(time_step=step)
        assert motion.margins.min() >= -1e-9
        assert np.linalg.norm(motion.positions[-1] - path[-1]) <= 1e-3 * motion.path_length


# -------------------------------------------------------------------- durations that are asked for


def needed(told: str) -> float:
    """Seconds that a refusal names."""
    return float(re.findall(r"takes ([\d.]+) s", told)[-1])


def test_adapting_takes_as_long_as_the_new_path_needs() -> None:
    goal = slow().goal_position + [0.05, 0.02, 0]
    with pytest.warns(CompromiseWarning, match=r"takes 1\d\.\d+ s instead of 10 s.*'speed-limit'"):
        there = slow().adapt(goal_position=goal)
    motion = there.rollout()
    assert there.duration == motion.duration > slow().duration
    assert motion.margins.min() == pytest.approx(0, abs=1e-9)
    assert np.linalg.norm(motion.positions[-1] - goal) <= 1e-6
    path = ns.learn(bend(), [ns.Blade()]).adapt(goal_position=goal).rollout()
    assert np.linalg.norm(motion.positions - path.positions, axis=1).max() <= PATH


def test_a_duration_too_short_for_a_hard_limit_is_refused_with_one_that_is_not() -> None:
    goal = slow().goal_position + [0.05, 0.02, 0]
    told = refusal(MissedError, slow().adapt, goal_position=goal, duration=2.0)
    assert "'speed-limit'" in told and "2 s" in told
    there = slow().adapt(goal_position=goal, duration=needed(told))
    assert there.rollout().margins.min() >= -1e-9
    # No more than it must be.
    with pytest.warns(CompromiseWarning, match="another shape"):
        slow().adapt(goal_position=goal, duration=0.99 * needed(told))


def test_a_rollout_too_fast_for_a_hard_limit_is_refused_with_a_duration_that_is_not() -> None:
    told = refusal(MissedError, slow().rollout, duration=2.0)
    assert needed(told) == pytest.approx(10.0, abs=0.05)
    assert slow().rollout(duration=needed(told)).margins.min() >= -1e-9
    assert slow().rollout(duration=20.0).margins.min() > 0.01


def test_a_soft_limit_gives_way_to_a_duration_with_a_warning() -> None:
    dmp = learned(ns.SpeedLimit(0.03, priority=1))
    with pytest.warns(CompromiseWarning, match="'speed-limit' cannot be kept in 2 s"):
        assert dmp.rollout(duration=2.0).duration == 2.0
    # It still pushes, so that a goal is missed: that is refused.
    goal = dmp.goal_position + [0.05, 0, 0]
    told = refusal(MissedError, dmp.adapt, goal_position=goal, duration=2.0)
    assert "'speed-limit' cannot be kept in 2 s" in told


def test_what_was_slower_than_it_must_may_be_run_faster() -> None:
    dmp = ns.learn(bend(), [ns.Blade(), ns.SpeedLimit(0.3)])
    assert dmp.rollout(duration=1.01).margins.min() >= 0
    assert needed(refusal(MissedError, dmp.rollout, duration=0.9)) == pytest.approx(1.0, abs=0.01)


def test_a_saved_primitive_keeps_its_duration(tmp_path: Path) -> None:
    loaded = ns.load_primitive(slow().save(tmp_path / "slow.json"))
    assert loaded.duration == slow().duration
    np.testing.assert_array_equal(loaded.rollout().positions, slow().rollout().positions)


def test_learning_from_each_recording_tells_both_durations(tmp_path: Path) -> None:
    bend().to_csv(tmp_path / "bend.csv")
    with pytest.warns(CompromiseWarning):
        found = ns.learn_each(tmp_path / "bend.csv", [ns.Blade(), SLOW])
    (result,) = found.results
    assert result.duration_s == 2.0
    assert result.motion_duration_s == pytest.approx(10.0, abs=0.05)
