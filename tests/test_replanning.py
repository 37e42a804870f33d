"""Re-planning from any state in the middle of a motion: on from there to the goal, no slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import cutting, numerical
from measures import assert_same_poses, degrees, end_velocities, slip
from motions import along, arc, cut
from noslip._typing import Floats
from noslip.adapting.replanning import replan as plan_on
from refusals import refusal
from strategies import seeds, unit

BLADE = ns.Blade()
POSITION, ROTATION = 1e-3, 0.5
"""What a motion may be off its goal or its path: share of the path's length, degrees."""
RESIDUAL = 1e-10
PERIOD, PHASE, SWAY = 1.7, 0.4, 0.05


PRIMITIVES: list[Callable[[], ns.ConstrainedDMP]] = [cutting, numerical]


@cache
def _states(of: Callable[[], ns.ConstrainedDMP]) -> list[ns.State]:
    dmp = of()
    states = [dmp.initial_state()]
    for _ in range(dmp.steps):
        states.append(dmp.step(states[-1], dmp.duration / dmp.steps))
    return states


def state_at(of: Callable[[], ns.ConstrainedDMP], fraction: float) -> ns.State:
    """The state that a motion is in when a fraction of it is done."""
    return _states(of)[round(fraction * of().steps)]


@cache
def path(of: Callable[[], ns.ConstrainedDMP]) -> tuple[Any, float]:
    """Where a motion leads, finely, and its length."""
    usual = of().rollout()
    fine = CubicSpline(usual.times, usual.positions)(np.linspace(0, usual.duration, 40001))
    return cKDTree(fine), usual.path_length


def off_path(of: Callable[[], ns.ConstrainedDMP], motion: ns.PoseTrajectory) -> float:
    """Farthest from the path as it was (share of its length)."""
    tree, length = path(of)
    return float(tree.query(motion.positions)[0].max() / length)


def assert_goes_on(
    new: ns.ConstrainedDMP,
    state: ns.State,
    goal: Any,
    turned: Rotation,
    length: float,
) -> ns.Motion:
    """A re-planned motion begins as the state is, and ends at the goal."""
    motion = new.rollout()
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    np.testing.assert_allclose(motion.positions[0], state.position, atol=1e-12)
    assert degrees(motion.rotations[0], state.rotation) <= 1e-9
    assert motion.times[0] == state.time == new.law.begin
    assert np.linalg.norm(motion.positions[-1] - goal) <= POSITION * length
    assert degrees(motion.rotations[-1], turned) <= ROTATION
    # A blade that was turned or pushed cannot go on as it did; what it may, it does.
    lateral = state.rotation.as_matrix()[:, 1]
    allowed = state.linear_velocity - lateral * (lateral @ state.linear_velocity)
    begins = new.initial_state()
    difference = np.linalg.norm(begins.linear_velocity - allowed)
    assert difference <= 0.05 * length / state.duration
    return motion


# -------------------------------------------------------------------- undisturbed


@pytest.mark.parametrize("of", PRIMITIVES)
@pytest.mark.parametrize("done", [0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 0.95])
def test_undisturbed_it_stays_on_the_path(of: Any, done: float) -> None:
    dmp, state = of(), state_at(of, done)
    new = dmp.replan(state)
    motion = assert_goes_on(new, state, dmp.goal_position, dmp.goal_rotation, path(of)[1])
    assert off_path(of, motion) <= POSITION
    # Nothing makes the way longer; but no plan is of fewer than 20 steps.
    step = dmp.duration / dmp.steps
    assert new.duration == pytest.approx(max((1 - done) * dmp.duration, 20 * step), rel=0.01)


@pytest.mark.parametrize("of", PRIMITIVES)
def test_undisturbed_it_keeps_its_timing(of: Any) -> None:
    dmp, done = of(), 0.4
    state = state_at(of, done)
    motion, usual = dmp.replan(state, duration=0.6 * dmp.duration).rollout(), dmp.rollout()
    wanted = CubicSpline(usual.times, usual.positions)(motion.times)
    assert np.linalg.norm(motion.positions - wanted, axis=1).max() <= 2e-3 * path(of)[1]


@pytest.mark.parametrize("of", PRIMITIVES)
@pytest.mark.parametrize("done", [0.98, 0.999, 1.0])
def test_at_the_very_end_it_stays_where_the_goal_is(of: Any, done: float) -> None:
    dmp, state = of(), state_at(of, done)
    new = dmp.replan(state)
    motion = new.rollout()
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    np.testing.assert_allclose(motion.positions[0], state.position, atol=1e-12)
    length = path(of)[1]
    assert np.linalg.norm(motion.positions[-1] - dmp.goal_position) <= POSITION * length
    assert degrees(motion.rotations[-1], dmp.goal_rotation) <= ROTATION
    # A tool in motion overshoots a little before it comes back to rest at the goal.
    assert motion.path_length <= 0.05 * length
    assert off_path(of, motion) <= 0.02


def test_from_the_very_start_it_is_the_motion_itself() -> None:
    for of in PRIMITIVES:
        dmp = of()
        motion, usual = dmp.replan(dmp.initial_state()).rollout(), dmp.rollout()
        wanted = CubicSpline(usual.times, usual.positions)(motion.times)
        off = np.linalg.norm(motion.positions - wanted, axis=1).max()
        assert off <= POSITION * usual.path_length


# A motion in another duration, to another goal: it is the state that says so.
def test_the_states_own_duration_and_goal_are_gone_on_with() -> None:
    dmp = cutting()
    goal = dmp.goal_position + [0.02, 0.05, 0.02]
    state = dmp.initial_state(duration=5.0, goal_position=goal)
    for _ in range(100):
        state = dmp.step(state, 0.02)
    new = dmp.replan(state)
    assert 3.0 <= new.duration <= 5.0
    assert_goes_on(new, state, goal, dmp.goal_rotation, path(cutting)[1])


@pytest.mark.parametrize("of", PRIMITIVES)
@pytest.mark.parametrize("done", [0.0, 0.3, 0.7])
def test_it_ends_as_fast_as_it_would_have(of: Any, done: float) -> None:
    usual, state = of().rollout(), state_at(of, done)
    pushed = replace(state, position=state.position + 0.02 * path(of)[1] * np.array([0, 0.6, 0.8]))
    for begins in (state, pushed):
        motion = of().replan(begins).rollout()
        for found, asked, peak in zip(
            end_velocities(motion, -1),
            end_velocities(usual, -1),
            motion.step_velocities(),
            strict=True,
        ):
            assert np.linalg.norm(found - asked) <= 0.05 * np.linalg.norm(peak, axis=1).max()


def test_it_comes_to_rest_if_asked_to() -> None:
    motion = cutting().replan(state_at(cutting, 0.4), goal_velocity=0).rollout()
    speeds = np.linalg.norm(motion.step_velocities()[0], axis=1)
    assert np.linalg.norm(end_velocities(motion, -1)[0]) <= 1e-3 * speeds.max()


# -------------------------------------------------------------------- disturbed


def disturbed(
    state: ns.State,
    rng: np.random.Generator,
    length: float,
    *,
    lateral: bool = False,
    farthest: float = 0.2,
    turned: float = 30.0,
) -> ns.State:
    """Pushed by 1 to 20 % of the path and turned by up to 30 degrees."""
    towards = state.rotation.as_matrix()[:, 1] if lateral else unit(rng)
    turn = np.radians(rng.uniform(0, turned)) * unit(rng)
    return replace(
        state,
        position=state.position + rng.uniform(0.01, farthest) * length * towards,
        rotation=Rotation.from_rotvec(turn) * state.rotation,
    )


@pytest.mark.parametrize("of", PRIMITIVES)
@given(seeds, st.floats(0.02, 0.95), st.booleans())
@settings(max_examples=25)
def test_pushed_and_turned_it_still_reaches_the_goal(
    of: Any, seed: int, done: float, lateral: bool
) -> None:
    dmp, length = of(), path(of)[1]
    state = disturbed(state_at(of, done), np.random.default_rng(seed), length, lateral=lateral)
    new = dmp.replan(state)
    motion = assert_goes_on(new, state, dmp.goal_position, dmp.goal_rotation, length)
    assert np.abs(slip(motion)).max() <= RESIDUAL
    # A longer way takes longer, never shorter.
    assert new.duration >= (1 - done) * dmp.duration - 0.01


@given(seeds, st.floats(0.02, 0.8))
@settings(max_examples=15)
def test_a_goal_that_moved_is_reached(seed: int, done: float) -> None:
    dmp, rng, length = cutting(), np.random.default_rng(seed), path(cutting)[1]
    state = disturbed(state_at(cutting, done), rng, length)
    goal = dmp.goal_position + rng.uniform(0.01, 0.3) * length * unit(rng)
    turned = Rotation.from_rotvec(rng.uniform(0, 0.7) * unit(rng)) * dmp.goal_rotation
    new = dmp.replan(state, goal_position=goal, goal_rotation=turned)
    assert_goes_on(new, state, goal, turned, length)
    np.testing.assert_allclose(new.goal_position, goal, atol=1e-6)


def angular_start(of: Any, *, shaken: bool) -> list[float]:
    """How far off the first angular velocity is (share of the new motion's peak)."""
    rng, dmp = np.random.default_rng(0), of()
    off = []
    for _ in range(20):
        state = state_at(of, rng.uniform(0.02, 0.9))
        if shaken:
            state = disturbed(state, rng, path(of)[1])
        new = dmp.replan(state)
        turning = new.rollout().step_velocities()[1]
        peak = np.linalg.norm([*turning, state.angular_velocity], axis=1).max()
        begins = new.initial_state().angular_velocity
        off.append(float(np.linalg.norm(begins - state.angular_velocity) / peak))
    return off


@pytest.mark.parametrize("of", PRIMITIVES)
def test_undisturbed_it_begins_with_the_states_angular_velocity(of: Any) -> None:
    assert max(angular_start(of, shaken=False)) <= 0.2


@pytest.mark.parametrize("of", PRIMITIVES)
def test_disturbed_it_begins_with_the_states_angular_velocity(of: Any) -> None:
    assert max(angular_start(of, shaken=True)) <= 0.2


@pytest.mark.parametrize("of", PRIMITIVES)
@pytest.mark.parametrize("done", [0.2, 0.35, 0.6, 0.8])
def test_a_plan_begins_with_the_velocities_between_two_steps(of: Any, done: float) -> None:
    dmp, state = of(), state_at(of, done)
    first = plan_on(dmp.law, dmp.rule, state).request.boundaries[0]
    assert first.linear_velocity is not None and first.angular_velocity is not None
    # Central differences about the state; a state's own velocities are half a step older.
    h, k = state.previous_step, round(done * dmp.steps)
    before, after = (_states(of)[k + way] for way in (-1, 1))
    linear = (after.position - before.position) / (2 * h)
    angular = (after.rotation * before.rotation.inv()).as_rotvec() / (2 * h)
    for found, old, now in (
        (first.linear_velocity, state.linear_velocity, linear),
        (first.angular_velocity, state.angular_velocity, angular),
    ):
        assert np.linalg.norm(found - now) <= 0.1 * np.linalg.norm(now - old)


# Leads back onto the path as it was, the longer before the end the better.
def test_pushed_aside_it_returns_to_the_path() -> None:
    state = state_at(cutting, 0.2)
    length = path(cutting)[1]
    pushed = replace(
        state, position=state.position + 0.05 * length * state.rotation.as_matrix()[:, 1]
    )
    motion = cutting().replan(pushed).rollout()
    tree = path(cutting)[0]
    off = tree.query(motion.positions)[0] / length
    assert off[0] == pytest.approx(0.05, rel=0.2)
    assert off[-len(off) // 4 :].max() <= 0.01


@pytest.mark.parametrize("duration", [0.3, 2.0, 10.0])
def test_it_takes_the_time_it_is_told_to(duration: float) -> None:
    dmp, state = cutting(), state_at(cutting, 0.5)
    new = dmp.replan(state, duration=duration)
    assert new.duration == duration
    motion = new.rollout()
    assert motion.times[-1] == pytest.approx(state.time + duration)
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    assert np.linalg.norm(motion.positions[-1] - dmp.goal_position) <= POSITION * path(cutting)[1]
    begins = new.initial_state().linear_velocity
    np.testing.assert_allclose(begins, state.linear_velocity, atol=0.05 * path(cutting)[1] / 2)


@pytest.mark.parametrize("end", ["position", "rotation", "free"])
def test_only_what_is_asked_of_the_goal_is_kept(end: Any) -> None:
    dmp, length = cutting(), path(cutting)[1]
    state = state_at(cutting, 0.4)
    goal = dmp.goal_position + 0.1 * dmp.goal_rotation.as_matrix()[:, 1]
    turned = Rotation.from_rotvec([0, 0.2, 0.3]) * dmp.goal_rotation
    motion = dmp.replan(state, goal_position=goal, goal_rotation=turned, end=end).rollout()
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    there = np.linalg.norm(motion.positions[-1] - goal) <= POSITION * length
    assert there == (end == "position")
    assert (degrees(motion.rotations[-1], turned) <= ROTATION) == (end == "rotation")


# -------------------------------------------------------------------- again and again


@given(seeds)
@settings(max_examples=5)
def test_what_was_replanned_can_be_replanned(seed: int) -> None:
    rng, length = np.random.default_rng(seed), path(cutting)[1]
    dmp, now = cutting(), 0.0
    state = dmp.initial_state()
    for _ in range(3):
        for _ in range(60):
            state = dmp.step(state, 0.005)
        assert state.time == pytest.approx(now + 0.3)
        state = replace(state, position=state.position + 0.03 * length * unit(rng))
        dmp = dmp.replan(state)
        assert_goes_on(dmp, state, cutting().goal_position, cutting().goal_rotation, length)
        now = dmp.law.begin
        state = dmp.initial_state()


# As a controller would: every few steps from where the tool really is.
def test_replanned_in_a_loop_it_arrives_in_spite_of_pushes() -> None:
    rng, length = np.random.default_rng(0), path(cutting)[1]
    dmp = cutting()
    state, worst = dmp.initial_state(), 0.0
    for _ in range(8):
        for _ in range(20):
            state = dmp.step(state, 0.01)
            worst = max(worst, float(np.abs(state.constraint_residuals).max()))
        state = replace(state, position=state.position + 0.005 * length * unit(rng))
        dmp = dmp.replan(state)
        state = dmp.initial_state()
    motion = dmp.rollout()
    assert worst <= RESIDUAL and np.abs(motion.constraint_residuals).max() <= RESIDUAL
    assert np.linalg.norm(motion.positions[-1] - cutting().goal_position) <= POSITION * length
    assert degrees(motion.rotations[-1], cutting().goal_rotation) <= ROTATION
    assert motion.times[-1] < 1.5 * cutting().duration


def test_replanned_motions_are_adapted_like_any_other() -> None:
    dmp, length = cutting(), path(cutting)[1]
    late = dmp.replan(state_at(cutting, 0.5))
    goal = dmp.goal_position + [0.05, 0.05, 0.0]
    motion = late.adapt(goal_position=goal).rollout()
    assert motion.times[0] == late.law.begin
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    assert np.linalg.norm(motion.positions[-1] - goal) <= POSITION * length


def test_an_adapted_motion_is_replanned_like_any_other() -> None:
    goal = cutting().goal_position + [0.1, 0.2, 0.1]
    dmp = cutting().adapt(goal_position=goal)
    state = dmp.initial_state()
    for _ in range(150):
        state = dmp.step(state, 0.005)
    state = disturbed(state, np.random.default_rng(4), path(cutting)[1])
    assert_goes_on(dmp.replan(state), state, goal, dmp.goal_rotation, path(cutting)[1])


# -------------------------------------------------------------------- saved


def test_saved_and_loaded_a_replanned_motion_is_the_same_to_the_bit(tmp_path: Path) -> None:
    state = disturbed(state_at(cutting, 0.3), np.random.default_rng(1), path(cutting)[1])
    dmp = cutting().replan(state)
    loaded = ns.load_primitive(dmp.save(tmp_path / "replanned.json"))
    one, other = dmp.rollout(), loaded.rollout()
    assert_same_poses(one, other)
    assert loaded.law.begin == state.time


@given(seeds, st.floats(0.3, 10), st.integers(50, 2000))
@settings(max_examples=10)
def test_other_durations_and_time_steps_keep_the_constraint(
    seed: int, duration: float, steps: int
) -> None:
    rng = np.random.default_rng(seed)
    state = disturbed(state_at(cutting, rng.uniform(0.05, 0.9)), rng, path(cutting)[1])
    motion = cutting().replan(state).rollout(duration=duration, time_step=duration / steps)
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    assert np.abs(slip(motion)).max() <= RESIDUAL


def test_its_variants_roll_out() -> None:
    new = cutting().replan(state_at(cutting, 0.3))
    assert np.abs(slip(new.constrained.rollout())).max() <= RESIDUAL
    assert np.isfinite(new.regular.rollout().positions).all()


# -------------------------------------------------------------------- seen from elsewhere


@given(seeds)
@settings(max_examples=5)
def test_replanning_commutes_with_moving_the_scene(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=seed), rng.normal(size=3)
    given_ = cut()
    moved = ns.PoseTrajectory(
        given_.times, turn.apply(given_.positions) + shift, turn * given_.rotations
    )
    other = ns.learn(moved, [BLADE], basis_functions=40)
    # Far from the path there may be two ways back, and rounding decides which is found.
    state = disturbed(
        state_at(cutting, rng.uniform(0.1, 0.7)), rng, path(cutting)[1], farthest=0.05, turned=10
    )
    elsewhere = replace(
        state,
        position=turn.apply(state.position) + shift,
        rotation=turn * state.rotation,
        linear_velocity=turn.apply(state.linear_velocity),
        angular_velocity=turn.apply(state.angular_velocity),
        goal_position=turn.apply(state.goal_position) + shift,
        goal_rotation=turn * state.goal_rotation,
    )
    one, two = cutting().replan(state).rollout(), other.replan(elsewhere).rollout()
    np.testing.assert_allclose(two.positions, turn.apply(one.positions) + shift, atol=1e-6)
    assert np.degrees((two.rotations * (turn * one.rotations).inv()).magnitude().max()) <= 1e-3


# -------------------------------------------------------------------- other constraints, the clock


def plane(times: Floats | float) -> Any:
    return SWAY * np.sin(2 * np.pi / PERIOD * np.asarray(times) + PHASE)


@cache
def swaying() -> ns.ConstrainedDMP:
    """On a plane that moves up and down."""
    s, x = arc(height=0)
    x[:, 2] = plane(2 * s)
    contact = ns.constraints.InMovingFrame(
        ns.constraints.PlaneContact(), amplitude=(0, 0, SWAY), period=PERIOD, phase=PHASE
    )
    return ns.learn(ns.PoseTrajectory(2 * s, x, along(x, s)), [contact, BLADE])


@pytest.mark.parametrize("duration", [None, 1.0, 1.9])
def test_a_constraint_that_moves_keeps_its_clock(duration: float | None) -> None:
    dmp, state = swaying(), state_at(swaying, 0.45)
    new = dmp.replan(state, duration=duration)
    for motion in (new.rollout(), new.rollout(time_step=0.0123)):
        assert motion.times[0] == state.time
        np.testing.assert_allclose(motion.positions[:, 2], plane(motion.times), atol=1e-9)
    level = (motion.positions[-1] - dmp.goal_position)[:2]
    assert np.linalg.norm(level) <= 5e-3


def test_pushed_off_a_surface_that_moves_it_is_led_back_in_time() -> None:
    dmp, state = swaying(), state_at(swaying, 0.3)
    state = replace(state, position=state.position + [0.02, 0.03, 0.04])
    motion = dmp.replan(state).rollout()
    np.testing.assert_allclose(motion.positions[:, 2], plane(motion.times), atol=1e-9)


# Where the surface is when the motion ends, not where it is now.
def test_a_moved_goal_lies_where_the_surface_will_be() -> None:
    dmp, state, duration = swaying(), state_at(swaying, 0.45), 1.3
    goal = dmp.goal_position + [0.05, 0.05, 0]
    goal[2] = plane(state.time + duration)
    motion = dmp.replan(state, goal_position=goal, duration=duration).rollout()
    assert np.linalg.norm(motion.positions[-1] - goal) <= POSITION
    goal[2] = plane(state.time)
    with pytest.raises(ns.errors.ConstraintError, match="goal violates 'plane-contact in moving"):
        dmp.replan(state, goal_position=goal, duration=duration)


SURFACES: dict[str, tuple[Any, Any]] = {
    "needle": (ns.Needle(), cut()),
    "blade on a plane": ([BLADE, ns.constraints.PlaneContact()], cut(height=0)),
    "upright blade": ([BLADE, ns.constraints.ToolAxis()], cut(height=0)),
    "wheel": (ns.Wheel(), cut(height=0)),
    "blade in tissue that moves": (
        ns.constraints.InMovingFrame(BLADE, amplitude=(0, 0.02, 0.03)),
        cut(),
    ),
}


@cache
def under(name: str) -> ns.ConstrainedDMP:
    constraints, given_ = SURFACES[name]
    return ns.learn(given_, constraints)


@pytest.mark.parametrize("name", SURFACES)
def test_under_any_constraint_it_goes_on_to_the_goal(name: str) -> None:
    dmp = under(name)
    length = dmp.rollout().path_length
    state = dmp.initial_state()
    for _ in range(dmp.steps // 3):
        state = dmp.step(state, dmp.duration / dmp.steps)
    # Sideways and about the vertical: what all of them allow.
    state = replace(
        state,
        position=state.position + [0.02, 0.06, 0],
        rotation=Rotation.from_rotvec([0, 0, 0.2]) * state.rotation,
    )
    motion = dmp.replan(state).rollout()
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    np.testing.assert_allclose(motion.positions[0], state.position, atol=1e-9)
    assert np.linalg.norm(motion.positions[-1] - dmp.goal_position) <= POSITION * length
    assert degrees(motion.rotations[-1], dmp.goal_rotation) <= ROTATION


def test_checking_it_goes_by_the_constraints_own_clock() -> None:
    motion = swaying().replan(state_at(swaying, 0.45)).rollout()
    assert ns.check(motion, swaying().constraints, tolerance=1e-9).satisfied


def test_pushed_off_a_surface_the_plan_lies_on_it() -> None:
    dmp = under("blade on a plane")
    state = dmp.initial_state()
    for _ in range(150):
        state = dmp.step(state, dmp.duration / dmp.steps)
    pushed = replace(state, position=state.position + [0.0, 0.03, 0.05])
    motion = dmp.replan(pushed).rollout()
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    np.testing.assert_allclose(motion.positions[:, 2], 0, atol=1e-10)
    np.testing.assert_allclose(motion.positions[0, :2], pushed.position[:2], atol=1e-9)


def test_goals_that_no_motion_can_end_in_are_refused_by_name() -> None:
    dmp = under("blade on a plane")
    with pytest.raises(
        ns.errors.ConstraintError, match=r"^goal violates 'plane-contact' by 0\.1 m; "
    ):
        dmp.replan(dmp.initial_state(), goal_position=[1, 0.2, 0.1])


def test_limits_hold_after_replanning() -> None:
    limit = ns.constraints.HalfSpace(point=(0, 0.25, 0), normal=(0, -1, 0))
    dmp = ns.learn(cut(), [BLADE, limit])
    state = dmp.initial_state()
    for _ in range(100):
        state = dmp.step(state, dmp.duration / dmp.steps)
    # Towards the plane, turned towards it too.
    state = replace(
        state,
        position=state.position + [0, 0.03, 0],
        rotation=Rotation.from_rotvec([0, 0, 0.3]) * state.rotation,
    )
    new = dmp.replan(state)
    motion = new.rollout()
    assert motion.margins.min() >= -1e-6 and new.record[0].left_out == ()
    assert np.linalg.norm(motion.positions[-1] - dmp.goal_position) <= 2 * POSITION


# A meter in 0.3 s at no more than 0.9 m/s: whoever runs the plan must be able to tell.
def test_a_hard_limit_that_leaves_no_time_is_no_silent_failure() -> None:
    dmp = ns.learn(cut(), [BLADE, ns.SpeedLimit(speed=0.9)])
    try:
        new = dmp.replan(dmp.initial_state(), duration=0.3)
    except ns.errors.ConvergenceError as error:
        assert "speed-limit" in str(error)
        return
    assert new.record[0].left_out == ("speed-limit",)
    assert new.rollout().margins.min() >= -1e-6


# -------------------------------------------------------------------- arguments


BAD: list[dict[str, Any]] = [
    {"goal_position": [np.nan, 0, 0]},
    {"goal_position": [1, 2]},
    {"goal_rotation": 3},
    {"duration": -1},
    {"duration": 0},
    {"duration": np.nan},
    {"duration": "long"},
    {"samples": 5},
    {"samples": 10**6},
    {"samples": 25.5},
    {"end": "everywhere"},
    {"position_weight": -1},
    {"rotation_smoothing": 0},
]


@pytest.mark.parametrize("arguments", BAD, ids=repr)
def test_bad_arguments_are_refused_in_one_line(arguments: dict[str, Any]) -> None:
    (name,) = arguments
    assert name in refusal(
        ns.errors.InputError, cutting().replan, state_at(cutting, 0.5), **arguments
    )


@pytest.mark.parametrize(
    "measured",
    [
        {"position": np.array([np.nan, 0, 0])},
        {"position": np.zeros(2)},
        {"linear_velocity": np.array([np.inf, 0, 0])},
        {"angular_velocity": np.array([0, 0, np.nan])},
        {"phase": np.nan},
        {"time": np.nan},
    ],
    ids=repr,
)
def test_a_sensor_that_fails_is_noticed(measured: dict[str, Any]) -> None:
    state = replace(state_at(cutting, 0.5), **measured)
    refusal(ns.errors.InputError, cutting().replan, state)


@pytest.mark.parametrize("state", [None, [0.5, 0.2, 0.1], 0.5])
def test_what_is_no_state_is_refused(state: Any) -> None:
    with pytest.raises(ns.errors.InputError, match="state"):
        cutting().replan(state)


def test_the_state_and_the_primitive_stay_as_they_are() -> None:
    dmp, state = cutting(), state_at(cutting, 0.5)
    before, pose = dmp.rollout(), state.vector()
    dmp.replan(state, goal_position=[1.1, 0.2, 0.1]).rollout()
    np.testing.assert_array_equal(dmp.rollout().positions, before.positions)
    np.testing.assert_array_equal(state.vector(), pose)
