"""New goals, starts, durations and via points: reached without slip, whatever the scene."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

import noslip as ns
from learned import Goal, cutting, numerical
from measures import apart, assert_same_poses, degrees, end_velocities, slip
from motions import along, arc, cut, gentle_cut
from noslip._typing import Floats
from refusals import refusal
from strategies import seeds, unit

BLADE = ns.Blade()
POSITION, ROTATION = 1e-3, 0.5
"""What a rollout may be off its goal: share of the path's length, degrees."""
RESIDUAL = 1e-10
KEPT = 1e-6
"""What a limit may be violated by, in its own unit."""


# -------------------------------------------------------------------- what is measured


def peak_rate(motion: ns.PoseTrajectory) -> float:
    return float(np.linalg.norm(motion.step_velocities()[1], axis=1).max())


def reaches(motion: ns.Motion, goal: Floats, turned: Rotation, length: float) -> tuple[bool, str]:
    """Whether a motion ends in a pose and satisfies its constraints throughout."""
    off = float(np.linalg.norm(motion.positions[-1] - goal)) / length
    turn = degrees(motion.rotations[-1], turned)
    residual = float(np.abs(motion.constraint_residuals).max(initial=0.0))
    good = off <= POSITION and turn <= ROTATION and residual <= RESIDUAL
    return good, f"off by {off:.2g} of the path and {turn:.2g} degrees, residual {residual:.2g}"


def assert_reaches(motion: ns.Motion, goal: Any, turned: Rotation, length: float) -> None:
    good, found = reaches(motion, np.asarray(goal), turned, length)
    assert good, found


# -------------------------------------------------------------------- primitives


def own_goal(dmp: ns.ConstrainedDMP) -> tuple[Floats, Rotation]:
    return dmp.goal_position, dmp.goal_rotation


# -------------------------------------------------------------------- new goals, as promised


@given(seeds)
@settings(max_examples=15)
def test_a_new_goal_is_reached_without_slip(seed: int) -> None:
    dmp, rng = cutting(), np.random.default_rng(seed)
    length = dmp.rollout().path_length
    goal = Goal.beside(dmp, rng, length)
    motion = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation).rollout()
    assert_reaches(motion, goal.position, goal.rotation, length)
    assert np.abs(slip(motion)).max() <= RESIDUAL
    # Nothing was said about the start.
    np.testing.assert_allclose(motion.positions[0], dmp.start_position, atol=1e-12)
    assert degrees(motion.rotations[0], dmp.start_rotation) <= 1e-9


# What adapting is for: the coupling term alone stops short of a goal beside the blade.
def test_without_adapting_the_same_goal_is_missed() -> None:
    dmp = cutting()
    length = dmp.rollout().path_length
    goal = dmp.goal_position + 0.2 * length * dmp.goal_rotation.as_matrix()[:, 1]
    missed = dmp.rollout(goal_position=goal).positions[-1] - goal
    assert np.linalg.norm(missed) > 0.02 * length
    assert_reaches(dmp.adapt(goal_position=goal).rollout(), goal, dmp.goal_rotation, length)


def peak_speed(motion: ns.PoseTrajectory) -> float:
    return float(np.linalg.norm(motion.step_velocities()[0], axis=1).max())


@pytest.mark.parametrize("far", [1.0, 17.0, 100.0])
def test_goals_many_lengths_away_are_reached_in_the_time_that_takes(far: float) -> None:
    dmp = cutting()
    usual = dmp.rollout()
    length = usual.path_length
    goal = dmp.goal_position + far * length * np.array([0.6, 0.0, 0.8])
    with pytest.warns(ns.errors.CompromiseWarning, match=r"takes \S+ s, not 2, .* as fast"):
        new = dmp.adapt(goal_position=goal)
    motion = new.rollout()
    assert_reaches(motion, goal, dmp.goal_rotation, far * length)
    # No longer than that takes, either.
    assert peak_speed(motion) == pytest.approx(2 * peak_speed(usual), rel=2e-3)
    # In a time that is given it is on the same path, and that is told.
    with pytest.warns(ns.errors.CompromiseWarning, match="times as fast .* mends that") as told:
        hurried = dmp.adapt(goal_position=goal, duration=dmp.duration)
    assert hurried.duration == dmp.duration and len(told) == 1
    assert f"{peak_speed(hurried.rollout()) / peak_speed(usual):.3g}" in str(told[0].message)
    assert apart(hurried.rollout(), motion)[0] <= 1e-6 * far * length


def test_a_shorter_time_that_is_asked_for_is_taken_without_a_word() -> None:
    assert cutting().adapt(duration=0.1).duration == 0.1


# A moving surface is elsewhere later: it stays in its time, and that is told.
def test_a_far_goal_that_is_there_at_one_time_alone_is_reached_then() -> None:
    _, dmp = learned("plane that moves")
    goal = dmp.goal_position + [3.0, 1.0, 0.0]
    with pytest.warns(ns.errors.CompromiseWarning, match="the motion moves at"):
        new = dmp.adapt(goal_position=goal)
    assert new.duration == dmp.duration
    assert_reaches(new.rollout(), goal, dmp.goal_rotation, 3.0)


@pytest.mark.parametrize("turn", [90, 135, 175])
def test_goals_turned_by_up_to_half_a_turn_are_reached(turn: float) -> None:
    dmp = cutting()
    turned = Rotation.from_rotvec(np.radians(turn) * np.array([0.6, 0, 0.8])) * own_goal(dmp)[1]
    motion = dmp.adapt(goal_rotation=turned).rollout()
    assert_reaches(motion, dmp.goal_position, turned, motion.path_length)


def test_a_goal_equal_to_the_start_is_reached() -> None:
    dmp = cutting()
    motion = dmp.adapt(goal_position=dmp.start_position).rollout()
    assert_reaches(motion, dmp.start_position, dmp.goal_rotation, dmp.rollout().path_length)


@pytest.mark.parametrize("samples", [40, 101, 1500])
def test_the_number_of_samples_does_not_matter_to_where_it_ends(samples: int) -> None:
    dmp = cutting()
    length = dmp.rollout().path_length
    goal = dmp.goal_position + [0.1, 0.1, 0.05]
    motion = dmp.adapt(goal_position=goal, samples=samples).rollout()
    assert_reaches(motion, goal, dmp.goal_rotation, length)
    usual = dmp.adapt(goal_position=goal).rollout()
    assert apart(motion, usual)[0] <= 0.01 * length


# A heavier position keeps the motion closer to the displaced one, the straight way of saying how
# much the path may be reshaped.
def test_the_position_weight_decides_how_much_the_path_is_reshaped() -> None:
    dmp = cutting()
    goal = dmp.goal_position + 0.2 * dmp.goal_rotation.as_matrix()[:, 1]
    changes = [
        dmp.adapt(goal_position=goal, position_weight=weight).record[0].position_change
        for weight in (1.0, 100.0, 10000.0)
    ]
    assert changes[0] > 1.5 * changes[1] > 2 * changes[2]


# -------------------------------------------------------------------- nothing new


@pytest.mark.parametrize("of", [numerical, cutting])
def test_adapting_to_nothing_new_changes_next_to_nothing(of: Callable[[], Any]) -> None:
    dmp = of()
    moved, turned = apart(dmp.adapt().rollout(), dmp.rollout())
    assert moved <= 1e-4 * dmp.rollout().path_length and turned <= 0.05


def test_adapting_to_its_own_values_is_adapting_to_nothing_new() -> None:
    dmp = cutting()
    goal, turned = own_goal(dmp)
    spelled_out = dmp.adapt(
        goal_position=goal,
        goal_rotation=turned,
        start_position=dmp.start_position,
        start_rotation=dmp.start_rotation,
        duration=dmp.duration,
    )
    assert max(apart(spelled_out.rollout(), dmp.adapt().rollout())) <= 1e-9


@pytest.mark.parametrize("duration", [0.05, 3.0, 1000.0])
def test_another_duration_keeps_the_path(duration: float) -> None:
    dmp = cutting()
    new = dmp.adapt(duration=duration)
    motion = new.rollout()
    assert new.duration == duration and motion.duration == pytest.approx(duration)
    moved, turned = apart(motion, dmp.rollout())
    assert moved <= 1e-4 * motion.path_length and turned <= 0.05
    assert np.abs(slip(motion)).max() * duration / dmp.duration <= RESIDUAL


def test_a_new_goal_in_another_time_lies_on_the_same_path() -> None:
    dmp = cutting()
    goal = dmp.goal_position + [0.2, -0.1, 0.1]
    slow = dmp.adapt(goal_position=goal, duration=7.0)
    usual = dmp.adapt(goal_position=goal)
    assert apart(slow.rollout(), usual.rollout())[0] <= 1e-8
    # Adapting for a duration is adapting, then rolling out in that duration.
    assert apart(slow.rollout(), usual.rollout(duration=7.0))[0] <= 1e-8


# -------------------------------------------------------------------- a primitive like any other


@cache
def adapted() -> ns.ConstrainedDMP:
    dmp = cutting()
    goal = Goal.beside(dmp, np.random.default_rng(7), dmp.rollout().path_length)
    return dmp.adapt(
        goal_position=goal.position,
        goal_rotation=goal.rotation,
        start_velocity=[0.5, 0.1, 0.2, 0.1, 0, 0.3],
        duration=2.5,
    )


def test_saved_and_loaded_its_motion_is_the_same_to_the_bit(tmp_path: Path) -> None:
    dmp = adapted()
    loaded = ns.load_primitive(dmp.save(tmp_path / "adapted.json"))
    for one, other in [
        (dmp.rollout(), loaded.rollout()),
        (dmp.rollout(duration=1.0, time_step=0.003), loaded.rollout(duration=1.0, time_step=0.003)),
        (dmp.regular.rollout(), loaded.regular.rollout()),
        (dmp.constrained.rollout(), loaded.constrained.rollout()),
        (dmp.adapt().rollout(), loaded.adapt().rollout()),
    ]:
        assert_same_poses(one, other)
    assert loaded.record == dmp.record


@given(seeds, st.floats(0.2, 20), st.integers(50, 3000))
@settings(max_examples=20)
def test_other_durations_and_time_steps_keep_the_constraint(
    seed: int, duration: float, steps: int
) -> None:
    dmp = adapted()
    motion = dmp.rollout(duration=duration, time_step=duration / steps)
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    assert np.abs(slip(motion)).max() <= RESIDUAL
    if steps >= 300:
        assert_reaches(motion, *own_goal(dmp), motion.path_length)


def test_its_variants_roll_out_to_its_goal() -> None:
    dmp = adapted()
    regular, constrained = dmp.regular.rollout(), dmp.constrained.rollout()
    for motion in (regular, constrained):
        np.testing.assert_allclose(motion.positions[0], dmp.start_position, atol=1e-12)
        assert motion.duration == pytest.approx(dmp.duration)
    assert np.linalg.norm(regular.positions[-1] - dmp.goal_position) <= 1e-3
    assert degrees(regular.rotations[-1], dmp.goal_rotation) <= ROTATION
    assert np.abs(slip(constrained)).max() <= RESIDUAL
    # The regular one knows of no constraint.
    assert np.abs(slip(regular)).max() > 1e-3


def test_steps_give_the_rollout() -> None:
    dmp = adapted()
    motion, state = dmp.rollout(), dmp.initial_state()
    for _ in range(dmp.steps):
        state = dmp.step(state, dmp.duration / dmp.steps)
    np.testing.assert_allclose(state.position, motion.positions[-1], atol=1e-9)
    assert degrees(state.rotation, motion.rotations[-1]) <= 1e-6


def test_the_record_tells_what_was_done() -> None:
    (record,) = adapted().record
    assert record.residual <= RESIDUAL and record.iterations >= 1 and record.left_out == ()
    assert record.position_change > 0 and record.rotation_change > 0


@given(seeds)
@settings(max_examples=3)
def test_adapting_again_and_again_stays_exact(seed: int) -> None:
    dmp, rng = cutting(), np.random.default_rng(seed)
    length = dmp.rollout().path_length
    for _ in range(4):
        goal = Goal.beside(dmp, rng, length, farthest=0.2, turned=20)
        dmp = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation)
        assert_reaches(dmp.rollout(), goal.position, goal.rotation, length)


# -------------------------------------------------------------------- starts


def at_start(steps: Floats) -> Floats:
    """Velocity at the start; that of a step is the one half a step later."""
    return np.asarray(1.5 * steps[0] - 0.5 * steps[1])


@given(seeds)
@settings(max_examples=10)
def test_it_starts_in_the_pose_and_with_the_velocities_wanted(seed: int) -> None:
    dmp, rng = cutting(), np.random.default_rng(seed)
    length = dmp.rollout().path_length
    start = dmp.start_position + rng.uniform(0, 0.2) * length * unit(rng)
    held = Rotation.from_rotvec(rng.uniform(0, 0.6) * unit(rng)) * dmp.start_rotation
    velocity = rng.normal(size=6) * [0.5, 0.5, 0.5, 1, 1, 1]
    lateral = held.as_matrix()[:, 1]
    allowed = velocity[:3] - lateral * (lateral @ velocity[:3])
    for given_, turning in [(velocity[:3], np.zeros(3)), (velocity, velocity[3:])]:
        new = dmp.adapt(start_position=start, start_rotation=held, start_velocity=given_)
        motion = new.rollout()
        np.testing.assert_allclose(motion.positions[0], start, atol=1e-12)
        assert degrees(motion.rotations[0], held) <= 1e-9
        # What the blade does not allow of a velocity is taken away.
        np.testing.assert_allclose(motion.linear_velocities[0], allowed, atol=1e-9)
        np.testing.assert_allclose(motion.angular_velocities[0], turning, atol=1e-9)
        # The motion itself begins like that, not only its state.
        linear, angular = motion.step_velocities()
        speed = length / dmp.duration
        np.testing.assert_allclose(at_start(linear), allowed, atol=0.05 * speed)
        rate = max(peak_rate(motion), float(np.linalg.norm(turning)))
        np.testing.assert_allclose(at_start(angular), turning, atol=0.1 * rate)
        # A start in another direction is a sharp bend to 40 basis functions.
        assert_reaches(motion, *own_goal(dmp), 3 * length)


def test_without_a_start_velocity_it_begins_as_suits_the_motion() -> None:
    dmp = cutting()
    start = dmp.start_position + [0.02, 0.1, 0.02]
    motion = dmp.adapt(start_position=start).rollout()
    edge = motion.rotations[0].as_matrix()[:, 0]
    assert motion.linear_velocities[0] @ edge > 0.1
    assert_reaches(motion, *own_goal(dmp), motion.path_length)


def test_a_motion_can_begin_at_rest() -> None:
    dmp = cutting()
    motion = dmp.adapt(start_velocity=[0, 0, 0]).rollout()
    np.testing.assert_allclose(motion.linear_velocities[0], 0, atol=1e-12)
    speeds = np.linalg.norm(motion.step_velocities()[0], axis=1)
    assert speeds[0] < 0.1 * speeds.mean()
    assert_reaches(motion, *own_goal(dmp), motion.path_length)


# -------------------------------------------------------------------- velocities at the ends


STEPS = (None, 1e-3, 7e-3)
"""Time steps at which a motion must be the same (s); the first is its own."""


def rolled_out(dmp: ns.ConstrainedDMP, step: float | None) -> ns.Motion:
    """The motion in equal steps of about a length."""
    return dmp.rollout(time_step=step and dmp.duration / round(dmp.duration / step))


def assert_ends(motion: ns.Motion, at: int, linear: Any, angular: Any) -> None:
    """A motion has these velocities at its start (0) or end (-1), to a thousandth of its peaks."""
    for found, asked, of_steps in zip(
        end_velocities(motion, at), (linear, angular), motion.step_velocities(), strict=True
    ):
        peak = np.linalg.norm(of_steps, axis=1).max()
        assert np.linalg.norm(found - asked) <= 1e-3 * peak


def assert_arrives(motion: ns.Motion, dmp: ns.ConstrainedDMP, step: float | None) -> None:
    # Chords of 7 ms cut the bends of a motion that takes a second.
    share = 2e-4 if step == 7e-3 else 1e-5
    off = np.linalg.norm(motion.positions[-1] - dmp.goal_position)
    assert off <= share * motion.path_length
    assert degrees(motion.rotations[-1], dmp.goal_rotation) <= 300 * share


# It began and ended at 6 mm/s and 0.5 rad/s.
@pytest.mark.parametrize("hold_position", [False, True])
def test_what_rests_at_its_ends_rests_there_on_the_way_to_another_goal(hold_position: bool) -> None:
    dmp = ns.learn(gentle_cut(), [BLADE], hold_position=hold_position)
    new = dmp.adapt(goal_position=dmp.goal_position + [0, 0.02, 0])
    assert np.abs(new.initial_state().linear_velocity).max() == 0
    for step in STEPS:
        motion = rolled_out(new, step)
        for at in (0, -1):
            assert_ends(motion, at, 0, 0)
        assert_arrives(motion, new, step)
    # Nor is it turned any faster for that.
    assert peak_rate(new.rollout()) <= 1.05 * peak_rate(dmp.rollout())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("of", [numerical, lambda: ns.learn(gentle_cut(), [BLADE])])
def test_the_velocities_at_the_ends_are_its_own_turned_with_the_tool(of: Any, seed: int) -> None:
    dmp, rng = of(), np.random.default_rng(seed)
    start = Goal.beside(dmp, rng, dmp.rollout().path_length, farthest=0.2, turned=30)
    goal = Goal.beside(dmp, rng, dmp.rollout().path_length)
    first = dmp.start_position + start.position - dmp.goal_position
    held = start.rotation * dmp.goal_rotation.inv() * dmp.start_rotation
    new = dmp.adapt(
        goal_position=goal.position,
        goal_rotation=goal.rotation,
        start_position=first,
        start_rotation=held,
    )
    free = ns.ConstrainedDMP(dmp.law).rollout(time_step=dmp.duration / 1000)
    for step in STEPS:
        motion = rolled_out(new, step)
        for at, turned in ((0, held), (-1, goal.rotation)):
            turn = turned * free.rotations[at].inv()
            # What is next to rest is at rest.
            linear, angular = (
                turn.apply(v) * (np.linalg.norm(v) > 1e-3 * np.linalg.norm(of_steps, axis=1).max())
                for v, of_steps in zip(
                    end_velocities(free, at), free.step_velocities(), strict=True
                )
            )
            lateral = turned.as_matrix()[:, 1]
            assert_ends(motion, at, linear - lateral * (lateral @ linear), angular)
        assert_arrives(motion, new, step)


def test_velocities_at_the_ends_may_be_left_open() -> None:
    dmp = ns.learn(gentle_cut(), [BLADE])
    goal = dmp.goal_position + [0, 0.02, 0]
    kept = dmp.adapt(goal_position=goal).rollout()
    free = dmp.adapt(goal_position=goal, start_velocity="free", goal_velocity="free").rollout()
    for at in (0, -1):
        assert (
            np.linalg.norm(end_velocities(free, at)[1])
            > 0.1
            > 100 * np.linalg.norm(end_velocities(kept, at)[1])
        )


@pytest.mark.parametrize("kept", ["position", "rotation", "free"])
def test_an_end_that_is_not_kept_whole_rests_if_the_motion_did(kept: Any) -> None:
    dmp = ns.learn(gentle_cut(), [BLADE])
    goal = dmp.goal_position + [0, 0.02, 0]
    for step in STEPS:
        motion = rolled_out(dmp.adapt(goal_position=goal, start=kept, end=kept), step)
        for at in (0, -1):
            assert_ends(motion, at, 0, 0)


# -------------------------------------------------------------------- on the way


@given(seeds, st.integers(1, 4), st.booleans())
@settings(max_examples=15)
def test_points_and_poses_on_the_way_are_passed(seed: int, count: int, poses: bool) -> None:
    dmp, rng = cutting(), np.random.default_rng(seed)
    usual = dmp.rollout()
    length = usual.path_length
    via = []
    for place in np.linspace(0, dmp.steps, count + 2).astype(int)[1:-1]:
        point = usual.positions[place] + 0.05 * length * rng.uniform() * unit(rng)
        held = Rotation.from_rotvec(rng.uniform(0, 0.3) * unit(rng)) * usual.rotations[place]
        via.append((place / dmp.steps, point, held) if poses else (place / dmp.steps, point))
    motion = dmp.adapt(via=via).rollout()
    for at, point, *held in via:
        k = round(at * dmp.steps)
        assert np.linalg.norm(motion.positions[k] - point) <= POSITION * length
        if held:
            assert degrees(motion.rotations[k], held[0]) <= ROTATION
    assert_reaches(motion, *own_goal(dmp), length)


def test_a_rotation_alone_can_be_passed() -> None:
    dmp = cutting()
    usual = dmp.rollout()
    k = dmp.steps // 2
    held = Rotation.from_rotvec([0, 0.3, 0.1]) * usual.rotations[k]
    motion = dmp.adapt(via=[ns.Boundary(0.5, rotation=held)]).rollout()
    assert degrees(motion.rotations[k], held) <= ROTATION
    assert degrees(usual.rotations[k], held) > 10


def test_passing_where_it_passes_anyway_changes_little() -> None:
    dmp = cutting()
    usual = dmp.rollout()
    places = [dmp.steps // 4, dmp.steps // 2, 3 * dmp.steps // 4]
    via = [(k / dmp.steps, usual.positions[k], usual.rotations[k]) for k in places]
    moved, turned = apart(dmp.adapt(via=via).rollout(), usual)
    assert moved <= 1e-4 * usual.path_length and turned <= 0.05


def test_via_points_in_any_order_are_the_same() -> None:
    dmp = cutting()
    usual = dmp.rollout()
    via = [(f, usual.positions[round(f * dmp.steps)] + [0, 0, 0.03]) for f in (0.3, 0.6, 0.8)]
    one, other = dmp.adapt(via=via).rollout(), dmp.adapt(via=reversed(via)).rollout()
    np.testing.assert_array_equal(one.positions, other.positions)


def pose_at(motion: ns.PoseTrajectory, at: float) -> tuple[Floats, Rotation]:
    """Between samples: on the chord, and turned at one rate."""
    time = motion.times[0] + at * motion.duration
    positions = [np.interp(time, motion.times, column) for column in motion.positions.T]
    return np.array(positions), Slerp(motion.times, motion.rotations)([time])[0]


def near(dmp: ns.ConstrainedDMP, at: float, beside: float) -> tuple[float, Floats, Rotation]:
    """A pose beside a motion's own at a fraction of it (share of its path)."""
    position, rotation = pose_at(dmp.rollout(), at)
    shift = beside * dmp.rollout().path_length * np.array([0, 0.8, 0.6])
    return at, position + shift, Rotation.from_rotvec(3 * beside * np.ones(3)) * rotation


# By the nearest sample 0.37 degrees off; two close ones by 1.9 mm.
@pytest.mark.parametrize("of", [cutting, numerical])
@pytest.mark.parametrize(
    ("places", "beside", "pose"),
    [
        ([0.3337], 0.02, True),
        ([0.21, 0.5003, 0.7771], 0.01, True),
        ([0.5, 0.505], 0.002, True),
        ([0.5, 0.505], 0.002, False),
        ([0.995], 0.0, False),
    ],
)
def test_vias_are_met_between_samples_and_close_to_each_other(
    of: Any, places: list[float], beside: float, pose: bool
) -> None:
    dmp = of()
    length = dmp.rollout().path_length
    vias = [near(dmp, at, beside) for at in places]
    new = dmp.adapt(via=[via if pose else via[:2] for via in vias])
    motion = new.rollout()
    for at, position, rotation in vias:
        passed, turned = pose_at(motion, at)
        assert np.linalg.norm(passed - position) <= 1e-5 * length
        assert not pose or degrees(turned, rotation) <= 2e-3
    assert np.linalg.norm(motion.positions[-1] - dmp.goal_position) <= 1e-5 * length
    assert degrees(motion.rotations[-1], dmp.goal_rotation) <= 2e-3


# It was passed, the end left 2 mm off at 160 rad/s.
@pytest.mark.filterwarnings("ignore::noslip.errors.CompromiseWarning")
def test_a_via_that_leaves_no_time_to_come_to_the_goal_is_refused() -> None:
    with pytest.raises(
        ns.errors.MissedError, match=r"0.995, 1: places 0.005 .* leave more"
    ) as told:
        cutting().adapt(via=[near(cutting(), 0.995, 0.01)[:2]])
    assert told.value.code is ns.errors.Refusal.NOT_FOUND


@pytest.mark.parametrize("at", [0, 1, -0.1, 1.5, np.nan, "half"])
def test_a_via_outside_of_the_motion_is_refused(at: Any) -> None:
    with pytest.raises(ns.errors.InputError, match=r"^via at must be"):
        cutting().adapt(via=[(at, [0.5, 0.1, 0.1])])


@pytest.mark.parametrize("via", [[1e-4], [0.9999], [0.5, 0.5001]])
def test_a_via_that_falls_on_another_sample_is_refused(via: list[float]) -> None:
    point = cutting().rollout().positions[150]
    with pytest.raises(ns.errors.InputError, match="falls on an end or on another via"):
        cutting().adapt(via=[(at, point) for at in via])


# -------------------------------------------------------------------- what of the ends is kept


@given(seeds)
@settings(max_examples=4)
def test_only_what_is_asked_of_the_goal_is_kept(seed: int) -> None:
    dmp = cutting()
    length = dmp.rollout().path_length
    goal = Goal.beside(dmp, np.random.default_rng(seed), length, farthest=0.2)
    found = {
        end: dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation, end=end).rollout()
        for end in ("pose", "position", "rotation", "free")
    }
    for end, motion in found.items():
        assert np.abs(slip(motion)).max() <= RESIDUAL
        np.testing.assert_allclose(motion.positions[0], dmp.start_position, atol=1e-9)
        if end in ("pose", "position"):
            assert np.linalg.norm(motion.positions[-1] - goal.position) <= POSITION * length
        if end in ("pose", "rotation"):
            assert degrees(motion.rotations[-1], goal.rotation) <= ROTATION
    # Free ends: nothing that was given for the goal matters.
    plain = dmp.adapt(end="free").rollout()
    assert apart(found["free"], plain)[0] <= 1e-6 * length


@pytest.mark.parametrize("start", ["free", "position", "rotation", "pose"])
def test_only_what_is_asked_of_the_start_is_kept(start: Any) -> None:
    dmp = cutting()
    length = dmp.rollout().path_length
    first = dmp.start_position + [0.05, 0.1, 0.02]
    held = Rotation.from_rotvec([0, 0.1, 0.3]) * dmp.start_rotation
    motion = dmp.adapt(start_position=first, start_rotation=held, start=start).rollout()
    assert_reaches(motion, *own_goal(dmp), length)
    there = np.linalg.norm(motion.positions[0] - first) <= 1e-9
    assert there == (start in ("position", "pose"))
    assert (degrees(motion.rotations[0], held) <= 1e-6) == (start in ("rotation", "pose"))


# -------------------------------------------------------------------- seen from elsewhere


def moved(motion: ns.PoseTrajectory, turn: Rotation, shift: Floats, size: float = 1.0) -> Any:
    return ns.PoseTrajectory(
        motion.times, size * turn.apply(motion.positions) + shift, turn * motion.rotations
    )


@pytest.mark.parametrize("scaling", ["none", "rotation-dilation"])
@given(seeds)
@settings(max_examples=5)
def test_adapting_commutes_with_moving_the_scene(scaling: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # About the vertical for scaling into the opposite direction, else about anything.
    turn = Rotation.from_rotvec(rng.uniform(-3, 3) * np.array([0, 0, 1]))
    if scaling == "none":
        turn = Rotation.random(random_state=seed)
    shift, dmp = rng.normal(size=3), cutting()
    other = ns.learn(moved(cut(), turn, shift), [BLADE], basis_functions=40)
    length = dmp.rollout().path_length
    goal = Goal.beside(dmp, rng, length)
    via = dmp.rollout().positions[100] + [0, 0.02, 0.03]
    velocity = np.array([0.6, 0.1, 0.1])
    one = dmp.adapt(
        goal_position=goal.position,
        goal_rotation=goal.rotation,
        start_velocity=velocity,
        via=[(1 / 3, via)],
        scaling=scaling,
    )
    two = other.adapt(
        goal_position=turn.apply(goal.position) + shift,
        goal_rotation=turn * goal.rotation,
        start_velocity=turn.apply(velocity),
        via=[(1 / 3, turn.apply(via) + shift)],
        scaling=scaling,
    )
    off, angle = apart(two.rollout(), moved(one.rollout(), turn, shift))
    assert off <= 1e-6 * length and angle <= 1e-3


@pytest.mark.filterwarnings("ignore:.*other units:noslip.errors.RecordingWarning")
@pytest.mark.parametrize("scaling", ["none", "difference", "rotation-dilation"])
@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_adapting_knows_no_unit_of_length(scaling: Any, size: float) -> None:
    dmp, none = cutting(), (Rotation.identity(), np.zeros(3))
    other = ns.learn(moved(cut(), *none, size), [BLADE], basis_functions=40)
    goal = dmp.goal_position + [0.2, 0.1, -0.1]
    one = dmp.adapt(goal_position=goal, scaling=scaling).rollout()
    two = other.adapt(goal_position=size * goal, scaling=scaling).rollout()
    off, angle = apart(two, moved(one, *none, size))
    assert off <= 1e-6 * size and angle <= 1e-3


# The blade with its other side up cuts the same.
def test_adapting_commutes_with_naming_the_tools_axes_otherwise() -> None:
    renamed = Rotation.from_matrix(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).T)
    given_ = cut()
    tool = ns.PoseTrajectory(given_.times, given_.positions, given_.rotations * renamed)
    y = renamed.inv().apply([0, 1, 0])
    x = renamed.inv().apply([1, 0, 0])
    name = {tuple(np.eye(3)[i]): axis for i, axis in enumerate("xyz")}
    blade = ns.Blade(lateral=name[tuple(np.round(y) + 0.0)], edge=name[tuple(np.round(x) + 0.0)])
    other = ns.learn(tool, [blade], basis_functions=40)
    dmp = cutting()
    goal = Goal.beside(dmp, np.random.default_rng(3), 1.0)
    one = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation).rollout()
    two = other.adapt(goal_position=goal.position, goal_rotation=goal.rotation * renamed).rollout()
    as_before = ns.PoseTrajectory(two.times, two.positions, two.rotations * renamed.inv())
    off, angle = apart(one, as_before)
    assert off <= 1e-6 and angle <= 1e-3


# -------------------------------------------------------------------- closed form


def minimum_jerk(s: Floats) -> Floats:
    return np.asarray(10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]


def assert_displaced(dmp: ns.ConstrainedDMP, shift: Floats, turn: Floats) -> None:
    """Where nothing needs to be projected, the adapted motion is known in closed form."""
    usual, s = dmp.rollout(), np.linspace(0, 1, dmp.steps + 1)
    # Turned in the tool's frame.
    goal = dmp.goal_position + shift
    held = dmp.goal_rotation * Rotation.from_rotvec(turn)
    found = dmp.adapt(goal_position=goal, goal_rotation=held).rollout()
    blend = minimum_jerk(s)
    wanted = usual.positions + blend * shift
    turned = usual.rotations * Rotation.from_rotvec(blend * turn)
    assert np.abs(found.positions - wanted).max() <= 1e-4 * usual.path_length
    assert np.degrees((found.rotations * turned.inv()).magnitude().max()) <= 0.05


@given(seeds)
@settings(max_examples=5)
def test_within_a_plane_the_displacement_is_of_minimum_jerk(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dmp = ns.learn(cut(height=0), [ns.constraints.PlaneContact()], basis_functions=40)
    assert_displaced(dmp, 0.3 * unit(rng) * [1, 1, 0], 0.5 * unit(rng))


def test_without_constraints_too() -> None:
    dmp = ns.learn(cut(), basis_functions=40)
    assert_displaced(dmp, np.array([0.1, 0.2, -0.1]), np.array([0.3, 0.1, 0.2]))


# -------------------------------------------------------------------- scaling


@pytest.mark.parametrize("scaling", ["none", "difference", "rotation-dilation"])
@given(seeds)
@settings(max_examples=4)
def test_whatever_the_scaling_the_goal_is_reached(scaling: Any, seed: int) -> None:
    dmp, rng = cutting(), np.random.default_rng(seed)
    length = dmp.rollout().path_length
    goal = Goal.beside(dmp, rng, length)
    new = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation, scaling=scaling)
    assert_reaches(new.rollout(), goal.position, goal.rotation, length)


# A blade's motion turned as a whole is a blade's motion, if its rotations turn too; stretched as a
# whole it is one with the rotations as they are.
@pytest.mark.filterwarnings("ignore:the motion takes")
@pytest.mark.parametrize("scaling", ["difference", "rotation-dilation"])
@pytest.mark.parametrize("factor", [0.1, 0.5, 3.0])
def test_a_goal_farther_along_the_way_stretches_the_cut(scaling: Any, factor: float) -> None:
    # A way along every axis: one that has next to none would not be stretched.
    s, x = arc()
    x = x + np.outer(s, [0, 0, 0.3])
    dmp = ns.learn(ns.PoseTrajectory(2 * s, x, along(x, s)), [BLADE], basis_functions=40)
    start, usual = dmp.start_position, dmp.rollout()
    goal = start + factor * (dmp.goal_position - start)
    found = dmp.adapt(goal_position=goal, scaling=scaling).rollout()
    wanted = ns.PoseTrajectory(
        usual.times, start + factor * (usual.positions - start), usual.rotations
    )
    off, angle = apart(found, wanted)
    assert off <= 1e-4 * factor and angle <= 0.05


@pytest.mark.parametrize("scaling", ["none", "difference", "rotation-dilation"])
@pytest.mark.parametrize("part", [0.0, -1.0, 1e-6])
def test_goals_at_the_start_or_opposite_to_it_are_reached(scaling: Any, part: float) -> None:
    dmp = cutting()
    start = dmp.start_position
    goal = start + part * (dmp.goal_position - start)
    new = dmp.adapt(goal_position=goal, scaling=scaling)
    # What is not named turns along with the path.
    turned = new.goal_rotation if scaling == "rotation-dilation" else dmp.goal_rotation
    assert_reaches(new.rollout(), goal, turned, dmp.rollout().path_length)


@pytest.mark.filterwarnings("ignore:the motion takes")
@given(st.floats(-np.pi, np.pi), st.floats(0.3, 3.0))
@settings(max_examples=15)
def test_a_turned_and_stretched_way_turns_and_stretches_the_whole_motion(
    angle: float, ratio: float
) -> None:
    dmp = cutting()
    own = dmp.rollout()
    start, way = dmp.start_position, dmp.goal_position - dmp.start_position
    # About what is square to the way: the smallest turn from the one way to the other.
    axis = np.cross(way, [0.0, 0.0, 1.0])
    axis = np.cross(axis, way) / np.linalg.norm(np.cross(axis, way))
    turn = Rotation.from_rotvec(angle * axis)
    new = dmp.adapt(
        goal_position=start + ratio * turn.apply(way), scaling="rotation-dilation"
    ).rollout()
    expected = start + ratio * turn.apply(own.positions - start)
    apart = np.linalg.norm(new.positions - expected, axis=1).max()
    assert apart <= 1e-3 * ratio * own.path_length
    assert np.degrees((new.rotations * (turn * own.rotations).inv()).magnitude()).max() <= 1.0


def test_a_closed_cut_is_adapted_under_any_scaling() -> None:
    s = np.linspace(0, 1, 301)
    x = np.column_stack([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s), 0 * s])
    held = Rotation.from_euler("Z", 2 * np.pi * s + np.pi / 2)
    dmp = ns.learn(ns.PoseTrajectory(2 * s, x, held, name="circle"), [BLADE])
    goal = dmp.goal_position + [0.3, 0.2, 0.1]
    motions = [
        dmp.adapt(goal_position=goal, scaling=scaling).rollout()
        for scaling in ("none", "difference", "rotation-dilation")
    ]
    for motion in motions:
        assert_reaches(motion, goal, dmp.goal_rotation, dmp.rollout().path_length)
    # Nothing says how to scale what returns to its start, so the force stays; only how the goal's
    # displacement spreads is the attractor's.
    assert apart(motions[1], motions[2])[0] <= 1e-9


# -------------------------------------------------------------------- other constraints


@dataclass(frozen=True)
class Case:
    """Constraints, what is learned under them, and a goal that they allow."""

    constraints: Any
    demonstration: ns.PoseTrajectory
    goal: Floats
    turned: Rotation
    end: Any = "pose"
    position: float = POSITION
    start_velocity: Any = None


def posed(constraints: Any, given_: ns.PoseTrajectory, shift: Any, turn: Any) -> Case:
    turned = Rotation.from_rotvec(turn) * given_.rotations[-1]
    return Case(constraints, given_, given_.positions[-1] + shift, turned)


def on_a_sphere() -> Case:
    center, radius = np.array([0.5, 0.0, -2.0]), 2.0
    s, x = arc(height=0)
    x = center + radius * (x - center) / np.linalg.norm(x - center, axis=1)[:, None]
    goal = x[-1] + [0.1, -0.2, 0.0]
    goal = center + radius * (goal - center) / np.linalg.norm(goal - center)
    contact = ns.constraints.SphereContact(center=tuple(center), radius=radius)
    given_ = ns.PoseTrajectory(2 * s, x, along(x, s))
    return Case(contact, given_, goal, Rotation.from_rotvec([0.1, 0, 0.3]) * given_.rotations[-1])


def aimed(x: Floats, center: Floats) -> Rotation:
    """Shafts (z) that point away from a center, turned as little as possible."""
    z = (x - center) / np.linalg.norm(x - center, axis=-1, keepdims=True)
    axis = np.stack([-z[..., 1], z[..., 0], 0 * z[..., 0]], axis=-1)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, z[..., 2:3]))


def through_an_incision() -> Case:
    center = np.array([0.45, 0.05, -0.5])
    s, x = arc()
    goal = x[-1] + [-0.15, 0.1, 0.05]
    given_ = ns.PoseTrajectory(2 * s, x, aimed(x, center))
    return Case(ns.constraints.RemoteCenter(point=tuple(center)), given_, goal, aimed(goal, center))


def rolling(radius: float = 0.2) -> Case:
    s, x = arc(height=0)
    v = np.gradient(x, s, axis=0)
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    yaw = np.arctan2(v[:, 1], v[:, 0])
    held = Rotation.from_euler("ZY", np.column_stack([yaw, way / radius]))
    given_ = ns.PoseTrajectory(2 * s, x, held)
    # How far it has rolled when it arrives follows from the way; nobody can ask for both.
    goal = x[-1] + [0.1, 0.05, 0]
    return Case(
        ns.constraints.RollingDisc(radius=radius), given_, goal, given_.rotations[-1], "position"
    )


def swaying(constraint: Any) -> Any:
    return ns.constraints.InMovingFrame(constraint, amplitude=(0, 0, 0.05), period=1.7, phase=0.4)


def on_a_swaying_plane() -> Case:
    s, x = arc(height=0)
    x[:, 2] = 0.05 * np.sin(2 * np.pi / 1.7 * 2 * s + 0.4)
    given_ = ns.PoseTrajectory(2 * s, x, along(x, s))
    return posed(swaying(ns.constraints.PlaneContact()), given_, [0.1, 0.2, 0.0], [0.1, 0.1, 0.3])


CASES: dict[str, Callable[[], Case]] = {
    "needle": lambda: posed(ns.Needle(), cut(), [0.1, 0.05, 0.1], [0.1, 0.2, 0.1]),
    "curved needle": lambda: replace(
        posed(ns.Needle(curvature=0.5), cut(), [0.03, 0.02, 0.0], [0, 0, 0]),
        end="position",
        # Along a bend of its own it cannot leave as it did.
        start_velocity="free",
        # Its turning is tied to its way step by step, and the projection took shorter steps.
        position=3e-3,
    ),
    "wheel": lambda: posed(ns.Wheel(), cut(height=0), [0.1, 0.2, 0.0], [0, 0, 0.3]),
    "plane": lambda: posed(
        ns.constraints.PlaneContact(), cut(height=0), [0.1, 0.2, 0.0], [0.3, 0.2, 0.1]
    ),
    "sphere": on_a_sphere,
    "remote center": through_an_incision,
    "tool axis": lambda: posed(
        ns.constraints.ToolAxis(), cut(height=0), [0.1, 0.2, 0.1], [0, 0, 0.5]
    ),
    "tilted axis": lambda: posed(
        ns.constraints.ToolAxis(angle=0.4),
        ns.PoseTrajectory(
            cut(height=0).times, cut().positions, cut(0).rotations * Rotation.from_euler("X", 0.4)
        ),
        [0.1, 0.2, 0.1],
        [0, 0, 0.5],
    ),
    "rolling disc": rolling,
    "blade in tissue that moves": lambda: posed(
        swaying(BLADE), cut(), [0.1, 0.2, 0.05], [0.1, 0.2, 0.3]
    ),
    "plane that moves": on_a_swaying_plane,
    "blade on a plane": lambda: posed(
        [BLADE, ns.constraints.PlaneContact()], cut(height=0), [0.1, 0.2, 0], [0.1, 0.1, 0.3]
    ),
    "upright blade": lambda: posed(
        [BLADE, ns.constraints.ToolAxis()], cut(height=0), [0.1, 0.2, 0.1], [0, 0, 0.5]
    ),
}


@cache
def learned(name: str) -> tuple[Case, ns.ConstrainedDMP]:
    case = CASES[name]()
    return case, ns.learn(case.demonstration, case.constraints)


@pytest.mark.parametrize("name", CASES)
def test_goals_are_reached_under_any_constraint(name: str) -> None:
    case, dmp = learned(name)
    length = dmp.rollout().path_length
    new = dmp.adapt(
        goal_position=case.goal,
        goal_rotation=case.turned,
        end=case.end,
        start_velocity=case.start_velocity,
    )
    motion = new.rollout()
    turned = case.turned if case.end == "pose" else motion.rotations[-1]
    assert_reaches(motion, case.goal, turned, length * case.position / POSITION)
    assert ns.check(motion, dmp.constraints, tolerance=1e-9).satisfied
    # Not by standing about: the goal moved, so did the motion.
    assert apart(motion, dmp.rollout())[0] >= 0.9 * np.linalg.norm(case.goal - dmp.goal_position)


@pytest.mark.parametrize("name", ["sphere", "remote center", "tool axis", "plane that moves"])
def test_starts_off_the_constraint_are_moved_onto_it(name: str) -> None:
    _, dmp = learned(name)
    motion = dmp.adapt(
        start_position=dmp.start_position + [0.03, 0.03, 0.03],
        start_rotation=Rotation.from_rotvec([0.1, -0.1, 0.1]) * dmp.start_rotation,
    ).rollout()
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    # As near as the constraint lets it: a nudge, no leap.
    assert np.linalg.norm(motion.positions[0] - dmp.start_position) < 0.15
    goal = motion.positions[-1] - dmp.goal_position
    assert np.linalg.norm(goal) <= POSITION * motion.path_length


# -------------------------------------------------------------------- limits


LIMITS: dict[str, tuple[Callable[[int], Any], list[float]]] = {
    "half-space": (
        lambda p: ns.constraints.HalfSpace(point=(0, 0.12, 0), normal=(0, -1, 0), priority=p),
        [1.05, 0.1, 0.05],
    ),
    "depth": (
        lambda p: ns.DepthLimit(depth=0.08, normal=(0, 0, -1), priority=p),
        [1.05, 0.25, 0.02],
    ),
    "keep-out sphere": (
        lambda p: ns.KeepOutSphere(center=(0.6, 0.25, 0.1), radius=0.1, priority=p),
        [1.05, 0.25, 0.05],
    ),
}


@pytest.mark.parametrize("priority", [0, 1])
@pytest.mark.parametrize("name", LIMITS)
def test_limits_hold_on_the_way_to_a_new_goal(name: str, priority: int) -> None:
    make, goal = LIMITS[name]
    dmp = ns.learn(cut(), [BLADE, make(priority)], basis_functions=40)
    new = dmp.adapt(goal_position=goal)
    motion = new.rollout()
    assert new.record[0].left_out == ()
    assert motion.margins.min() >= -KEPT
    assert_reaches(motion, goal, dmp.goal_rotation, motion.path_length)
    # Without it the same goal would violate it.
    free = cutting().adapt(goal_position=goal).rollout()
    assert not ns.check(free, [make(priority)], tolerance=1e-3).satisfied


BEYOND: dict[str, tuple[Any, list[float]]] = {
    "half-space": (ns.constraints.HalfSpace(point=(0, 0.25, 0), normal=(0, -1, 0)), [1, 0.3, 0]),
    "depth-limit": (ns.DepthLimit(depth=0.05), [1, 0.1, -0.1]),
    "keep-out-sphere": (ns.KeepOutSphere(center=(0.6, 0.5, 0.1), radius=0.2), [0.6, 0.45, 0.1]),
    "plane-contact": (ns.constraints.PlaneContact(), [1, 0.1, -0.05]),
    "sphere-contact": (
        ns.constraints.SphereContact(center=(0.5, 0, -2), radius=2.0),
        [1, 0.1, 0.3],
    ),
}


@cache
def under(name: str) -> ns.ConstrainedDMP:
    return ns.learn(cut(height=0), [BLADE, BEYOND[name][0]], basis_functions=40)


@pytest.mark.parametrize("name", BEYOND)
def test_goals_that_no_motion_can_end_in_are_refused_by_name(name: str) -> None:
    for end in ("pose", "position"):
        with pytest.raises(
            ns.errors.ConstraintError, match=rf"^goal violates '{name}' by 0\.\d+ m; "
        ):
            under(name).adapt(goal_position=BEYOND[name][1], end=end)


@pytest.mark.parametrize("name", BEYOND)
def test_via_points_that_no_motion_can_pass_are_refused_by_name(name: str) -> None:
    with pytest.raises(ns.errors.ConstraintError, match=name):
        under(name).adapt(via=[(0.5, BEYOND[name][1])])


def test_a_rotation_that_no_motion_can_end_in_is_refused_by_name() -> None:
    dmp = ns.learn(cut(height=0), [ns.constraints.ToolAxis()], basis_functions=40)
    turned = Rotation.from_rotvec([0.2, 0, 0]) * dmp.goal_rotation
    with pytest.raises(ns.errors.ConstraintError, match=r"^goal violates 'tool-axis"):
        dmp.adapt(goal_rotation=turned)


# Two and a half meters in 2 s at no more than 0.9 m/s.
@pytest.mark.parametrize("priority", [0, 1])
def test_a_goal_too_far_for_a_speed_limit_takes_longer_or_is_refused(priority: int) -> None:
    limit = ns.SpeedLimit(speed=0.9, priority=priority)
    dmp = ns.learn(cut(), [BLADE, limit], basis_functions=40)
    goal = [2.5, 0.2, 0.0]
    told = r"takes 4\.\d+ s instead of 2 s, the least .*'speed-limit'"
    with pytest.warns(ns.errors.CompromiseWarning, match=told):
        longer = dmp.adapt(goal_position=goal)
    for there in (longer, dmp.adapt(goal_position=goal, duration=8.0)):
        motion = there.rollout()
        assert motion.margins.min() >= -KEPT
        assert_reaches(motion, goal, dmp.goal_rotation, motion.path_length)
    # A soft limit goes on pushing, so that the goal would be missed.
    with pytest.raises(ns.errors.MissedError, match="'speed-limit' cannot be kept in 2 s"):
        dmp.adapt(goal_position=goal, duration=2.0)


@pytest.mark.parametrize("priority", [0, 1])
def test_a_limit_is_kept_in_less_time_by_another_shape_and_that_is_told(priority: int) -> None:
    limit = ns.SpeedLimit(speed=0.62, priority=priority)
    dmp = ns.learn(cut(), [BLADE, limit], basis_functions=40)
    with pytest.warns(ns.errors.CompromiseWarning, match="motion of another shape") as told:
        motion = dmp.adapt(duration=1.7).rollout()
    assert motion.duration == pytest.approx(1.7) and motion.margins.min() >= -KEPT
    assert_reaches(motion, dmp.goal_position, dmp.goal_rotation, motion.path_length)
    (needed,) = re.findall(r"of its own it takes ([\d.]+) s", str(told[0].message))
    assert dmp.adapt(duration=float(needed)).rollout().margins.min() >= -KEPT


@pytest.mark.parametrize("factor", [0.3, 0.6, 1.0])
def test_the_duration_named_for_a_hasty_motion_is_enough(factor: float) -> None:
    dmp = ns.learn(cut(), [BLADE], basis_functions=40)
    goal = dmp.goal_position + [2.0, 0.5, 0]
    with pytest.warns(ns.errors.CompromiseWarning, match="times as fast as its law") as told:
        dmp.adapt(goal_position=goal, duration=factor * dmp.duration)
    (needed,) = re.findall(r"a duration of ([\d.]+) s or more", str(told[0].message))
    dmp.adapt(goal_position=goal, duration=float(needed))


def test_what_is_told_of_a_far_goal_is_told_once_and_of_the_motion_that_is_made() -> None:
    dmp = ns.learn(cut(), [BLADE, ns.constraints.TurningRadius(radius=0.05)], basis_functions=40)
    passed = dmp.rollout().resampled(times=[0, 0.8, 2]).positions[1] + [0, 0.1, 0]
    goal = dmp.goal_position + [2.5, 0.2, 0]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        far = dmp.adapt(goal_position=goal, via=[(0.4, passed)])
    texts = [str(one.message) for one in told]
    (longer,) = (text for text in texts if "the motion takes" in text)
    assert float(re.findall(r"takes ([\d.]+) s", longer)[0]) == pytest.approx(
        far.duration, rel=5e-3
    )
    assert len([text for text in texts if "via points the motion turns" in text]) <= 1


# -------------------------------------------------------------------- the clock


def test_a_motion_under_way_is_adapted_by_the_constraints_own_clock() -> None:
    _, dmp = learned("plane that moves")
    state = dmp.initial_state()
    while state.time <= 0.5:
        state = dmp.step(state, dmp.duration / dmp.steps)
    late = dmp.replan(state)
    assert late.law.begin == pytest.approx(state.time)
    end = late.law.begin + late.duration
    goal = late.goal_position + [0.05, 0.1, 0]
    goal[2] = 0.05 * np.sin(2 * np.pi / 1.7 * end + 0.4)
    motion = late.adapt(goal_position=goal).rollout()
    assert motion.times[0] == late.law.begin
    heights = 0.05 * np.sin(2 * np.pi / 1.7 * motion.times + 0.4)
    np.testing.assert_allclose(motion.positions[:, 2], heights, atol=1e-9)
    assert np.linalg.norm(motion.positions[-1] - goal) <= POSITION


# In another duration the plane is elsewhere at the end: the own goal goes with it, one that is
# given and does not lie there is refused.
def test_a_goal_on_a_moving_surface_is_where_that_is_at_the_end() -> None:
    case, dmp = learned("plane that moves")
    motion = dmp.adapt(duration=2.6).rollout()
    heights = 0.05 * np.sin(2 * np.pi / 1.7 * motion.times + 0.4)
    np.testing.assert_allclose(motion.positions[:, 2], heights, atol=1e-9)
    with pytest.raises(ns.errors.ConstraintError, match="goal violates 'plane-contact in moving"):
        dmp.adapt(duration=2.6, goal_position=case.goal)


# -------------------------------------------------------------------- arguments


NAN = [np.nan, 0, 0]
BAD: list[dict[str, Any]] = [
    {"goal_position": NAN},
    {"goal_position": [0, 1]},
    {"goal_position": "there"},
    {"goal_rotation": [1, 0, 0, 0]},
    {"goal_rotation": Rotation.identity(2)},
    {"start_position": [[0, 0, 0]]},
    {"start_rotation": 3},
    {"start_velocity": NAN},
    {"start_velocity": [1, 2]},
    {"start_velocity": "fast"},
    {"start_velocity": 1.0},
    {"goal_velocity": NAN},
    {"goal_velocity": [1, 2]},
    {"goal_velocity": 0.3},
    {"start_velocity": [1, 2, "x"]},
    {"start_velocity": [1, [2], 3]},
    {"duration": -1},
    {"duration": 0},
    {"duration": np.inf},
    {"duration": "long"},
    {"samples": 19},
    {"samples": 1e9},
    {"samples": 30.5},
    {"position_weight": 0},
    {"position_weight": np.nan},
    {"position_smoothing": -1},
    {"rotation_smoothing": 0},
    {"scaling": "big"},
    {"start": "nowhere"},
    {"end": "everywhere"},
    {"end": None},
    {"via": 0.5},
    {"via": [0.5]},
    {"via": (0.5, [0, 0, 0])},
    {"via": [(0.5,)]},
    {"via": [(0.5, NAN)]},
    {"via": [(0.5, [0, 0, 0], "x")]},
    {"via": [(0.5, [0, 0, 0], Rotation.identity(), 7)]},
]


@pytest.mark.parametrize("arguments", BAD, ids=lambda a: " ".join(repr(a).split())[:40])
def test_bad_arguments_are_refused_in_one_line(arguments: dict[str, Any]) -> None:
    refusal(ns.errors.InputError, cutting().adapt, **arguments)


@pytest.mark.parametrize("start", ["free", "position", "rotation"])
def test_a_start_velocity_with_a_start_that_is_not_kept_works_or_is_refused(start: Any) -> None:
    dmp = cutting()
    try:
        motion = dmp.adapt(start_velocity=[0.5, 0, 0], start=start).rollout()
    except ns.errors.InputError:
        return
    assert_reaches(motion, *own_goal(dmp), motion.path_length)


@pytest.mark.parametrize(
    "via",
    [ns.Boundary(0.5), (0.5, None), (0.5, [0, 1]), (0.5, None, "x"), ns.Boundary(1, [0, 0, 0])],
)
def test_a_via_that_names_nothing_is_refused(via: Any) -> None:
    with pytest.raises(ns.errors.InputError, match=r"^(via|boundary)"):
        cutting().adapt(via=[via])


def test_the_primitive_that_is_adapted_stays_as_it_is() -> None:
    dmp = cutting()
    before = dmp.rollout()
    goal = np.array([1.1, 0.3, 0.1])
    new = dmp.adapt(goal_position=goal, start_velocity=[0.3, 0, 0], via=[(0.5, [0.5, 0.2, 0.1])])
    goal += 1.0
    after = dmp.rollout()
    np.testing.assert_array_equal(before.positions, after.positions)
    # Nor does what the caller does with an argument later change the new one.
    assert np.linalg.norm(new.rollout().positions[-1] - [1.1, 0.3, 0.1]) <= POSITION
