"""The loop: steps like a rollout, tells what is measured apart, reaches goals that move."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from copy import copy, deepcopy
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from motions import along, eased
from noslip._typing import Floats
from noslip.adapting import compiled
from noslip.control.clock import HASTE
from noslip.control.controller import ACCEPT, FASTER, SILENT
from noslip.errors import NoslipError
from noslip.experiments.numerical_example import demonstration
from plants import Plant, Run, drive
from strategies import seeds, unit

H = 0.005
"""Of the loops with plants (s): 200 Hz."""


@cache
def primitive() -> ns.ConstrainedDMP:
    return ns.learn(demonstration(), [ns.Blade()])


@cache
def length() -> float:
    return primitive().rollout().path_length


STEP = primitive().duration / primitive().steps


@cache
def s_cut() -> ns.ConstrainedDMP:
    """A cut of 0.13 m in 2 s, from rest to rest."""
    s = np.linspace(0, 1, 201)
    u = eased(s)
    path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
    return ns.learn(ns.PoseTrajectory(2 * s, path, along(path, s)), [ns.Blade()])


@cache
def way() -> float:
    return s_cut().rollout().path_length


@cache
def peaks() -> dict[str, float]:
    """Of the primitive's own motion, between cycles."""
    motion = s_cut().rollout(time_step=H)
    v, w = motion.linear_velocities[1:], motion.angular_velocities[1:]
    return {
        "speed": np.linalg.norm(v, axis=1).max(),
        "turn": np.linalg.norm(w, axis=1).max(),
        "acceleration": np.linalg.norm(np.diff(v, axis=0), axis=1).max() / H,
        "angular acceleration": np.linalg.norm(np.diff(w, axis=0), axis=1).max() / H,
    }


def sideways(k: int) -> Floats:
    """Where a tool must not go, at a cycle of the undisturbed motion."""
    return s_cut().rollout(time_step=H).rotations[k].as_matrix()[:, 1]


def usual(**more: Any) -> Plant:
    """An ordinary robot and an ordinary camera."""
    given: dict[str, Any] = {
        "lag": 0.03,
        "delay": 0.005,
        "rate": 60.0,
        "noise": 1e-4,
        "angle_noise": 0.002,
    }
    return Plant(**(given | more))


def held(by: Floats, begin: float, end: float) -> Callable[[float], Floats | None]:
    """A hand that displaces the tool within a tenth of a second, and holds it."""

    def hand(time: float) -> Floats | None:
        if not begin <= time < end:
            return None
        return by * float(eased(np.minimum((time - begin) / 0.1, 1.0)))

    return hand


def keeps_its_bounds(run: Run) -> None:
    """No faster, and no more abrupt, than was said; no slip."""
    assert run.residual <= 1e-12 * peaks()["speed"]
    speeds, turns = run.rates(H)
    assert speeds.max() <= 1.3 * peaks()["speed"]
    assert turns.max() <= 1.55 * peaks()["turn"]
    poses = run.states
    for name, velocities in (
        ("acceleration", np.array([s.linear_velocity for s in poses])),
        ("angular acceleration", np.array([s.angular_velocity for s in poses])),
    ):
        changes = np.linalg.norm(np.diff(velocities, axis=0), axis=1) / H
        assert changes.max() <= 1.05 * HASTE * FASTER * peaks()[name], name


def misses(state: ns.State, position: Floats, rotation: Rotation) -> tuple[float, float]:
    """Distance from a goal (m), and degrees."""
    off = float(np.linalg.norm(state.position - position))
    return off, float(np.degrees((state.rotation * rotation.inv()).magnitude()))


# -------------------------------------------------------------------- undisturbed


@pytest.mark.parametrize("measured", [False, True])
def test_undisturbed_it_is_the_rollout_to_the_bit(measured: bool) -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    states = [controller.reset()]
    while not controller.done:
        states.append(controller.step(states[-1] if measured else None))
    motion = dmp.rollout(time_step=STEP)
    np.testing.assert_allclose([s.position for s in states], motion.positions, rtol=0, atol=1e-12)
    last = states[-1].rotation * motion.rotations[-1].inv()
    assert last.magnitude() <= 1e-12


PLANTS = {
    "none": Plant(),
    "usual": usual(),
    "slow": usual(lag=0.1, delay=0.02, rate=30.0, noise=5e-4, angle_noise=0.005),
    "biased": usual(bias=0.025 * 0.132 * np.array([0.6, 0.8, 0.0])),
    "fast sensor": usual(rate=0.0, noise=5e-4),
    "all of it": usual(lag=0.1, delay=0.02, rate=30.0, noise=5e-4, bias=[0, 2e-3, 2e-3]),
}


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("name", PLANTS)
def test_what_robots_and_sensors_do_changes_nothing(name: str, follows: bool) -> None:
    dmp = s_cut()
    nominal, path = dmp.rollout(time_step=H), dmp.rollout(time_step=H / 50).positions
    for seed in range(2):
        plant = replace(PLANTS[name], seed=seed)
        controller = ns.Controller(dmp, H, follows=follows)
        run = drive(controller, plant)
        assert run.time <= 1.03 * dmp.duration
        assert controller.replanned == []
        assert not controller.blocked
        # A bias as large as may be expected costs a little time at first; nothing else does.
        off = [np.linalg.norm(path - p, axis=1).min() for p in run.positions]
        assert max(off) <= 1e-4 * way()
        if name not in ("biased", "all of it"):
            np.testing.assert_allclose(
                run.positions[: len(nominal)], nominal.positions, rtol=0, atol=1e-12
            )


def test_drop_outs_and_late_cycles_cost_time_alone() -> None:
    dmp, rng = s_cut(), np.random.default_rng(0)
    plant = usual(lag=0.1, delay=0.02, rate=30.0, noise=5e-4, dropout=0.3)
    for h in (0.005, 0.001):
        controller = ns.Controller(dmp, h)
        late = 0.03 * rng.uniform(0.3, 1, 100_000) * (rng.random(100_000) < 0.03)
        run = drive(controller, plant, late=lambda k, late=late: late[k])  # type: ignore[misc]
        assert controller.done
        assert run.time <= 1.7 * dmp.duration
        assert run.residual <= 1e-12
        # No command jumps by more than is made good of a late cycle.
        jumps = np.linalg.norm(np.diff(run.positions, axis=0), axis=1)
        assert jumps.max() <= 0.0151 * peaks()["speed"]
        path = dmp.rollout(time_step=1e-3).positions
        off = [np.linalg.norm(path - p, axis=1).min() for p in run.positions[::10]]
        assert max(off) <= 1e-3 * way()


def test_a_lag_that_is_told_may_be_longer_than_one_that_is_not() -> None:
    dmp = s_cut()
    slow = usual(lag=0.4)
    for seed in range(3):
        told = ns.Controller(dmp, H, lag=0.4)
        drive(told, replace(slow, seed=seed))
        assert told.done
        assert told.lag_and_bias[0] == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("lag", [0.02, 0.08])
def test_lag_and_bias_are_told_apart(lag: float) -> None:
    dmp = s_cut()
    bias = np.array([-1e-3, 1.5e-3, 1e-3])
    for seed in range(3):
        controller = ns.Controller(dmp, H)
        drive(controller, usual(lag=lag, delay=0.0, bias=bias, seed=seed))
        found, off = controller.lag_and_bias
        assert found == pytest.approx(lag, abs=0.01)
        np.testing.assert_allclose(off, bias, atol=3e-4)


# -------------------------------------------------------------------- disturbed


@given(seeds, st.floats(0.05, 0.9), st.floats(0.01, 0.2))
@settings(max_examples=15)
def test_a_stiff_robot_that_is_pushed_is_waited_for(seed: int, at: float, size: float) -> None:
    dmp = s_cut()
    begin = at * dmp.duration
    by = size * way() * sideways(int(begin / H))
    controller = ns.Controller(dmp, H)
    run = drive(controller, usual(hand=held(by, begin, begin + 0.3), seed=seed))
    assert controller.done
    assert controller.replanned == []
    # Held for 0.3 s, and a tenth of the duration to stop and to start again.
    assert run.time <= dmp.duration + 0.3 + 0.2 * dmp.duration
    keeps_its_bounds(run)
    assert misses(run.states[-1], dmp.goal_position, dmp.goal_rotation)[0] <= 4e-3 * way()


@given(seeds, st.floats(0.1, 0.8), st.floats(0.06, 0.2))
@settings(max_examples=15)
def test_a_hand_that_holds_a_compliant_robot_is_followed(seed: int, at: float, size: float) -> None:
    dmp = s_cut()
    begin = at * dmp.duration
    by = size * way() * sideways(int(begin / H))
    controller = ns.Controller(dmp, H, follows=True)
    run = drive(controller, usual(hand=held(by, begin, begin + 0.8), seed=seed))
    assert controller.done
    assert [(plan.reason, plan.failure) for plan in controller.replanned] == [("push", "")]
    assert "yield" in run.modes
    # It was led to where the hand held the tool.
    k = max(i for i, mode in enumerate(run.modes) if mode == "yield")
    assert np.linalg.norm(run.positions[k] - run.tool[k]) <= 0.02 * way()
    keeps_its_bounds(run)
    off, turned = misses(run.states[-1], dmp.goal_position, dmp.goal_rotation)
    assert off <= 4e-3 * way()
    assert turned <= 1.0


def test_a_tool_that_hardly_comes_back_from_aside_is_waited_for() -> None:
    # A beveled tip bends with a radius twice as long as its way: it must draw back to get aside.
    u = eased(np.linspace(0, 1, 201))
    path = 0.2 * np.column_stack([np.sin(u / 2), 1 - np.cos(u / 2), 0 * u])
    turns = Rotation.from_euler("z", u[:, None] / 2)
    trajectory = ns.PoseTrajectory(3 * np.linspace(0, 1, 201), path, turns)
    dmp = ns.learn(trajectory, [ns.Needle(curvature=5.0)])
    nominal = dmp.rollout(time_step=H)
    fine, length = dmp.rollout(time_step=H / 50).positions, nominal.path_length
    begin = 1.2
    # Out of the plane in which it bends.
    body = nominal.rotations[int(begin / H)].apply([0, 0, 1])
    for hold in (0.3, 3.0):
        controller = ns.Controller(dmp, H, follows=True)
        run = drive(controller, usual(hand=held(0.1 * length * body, begin, begin + hold)))
        assert controller.done
        assert misses(run.states[-1], dmp.goal_position, dmp.goal_rotation)[0] <= 4e-3 * length
        found = [plan for plan in controller.replanned if not plan.failure]
        if hold < ACCEPT:
            assert found == []
            assert run.time <= 1.2 * dmp.duration + hold
        if not found:
            # Nothing has led the command off its way.
            off = [np.linalg.norm(fine - p, axis=1).min() for p in run.positions]
            assert max(off) <= 1e-4 * length
            assert run.residual <= 1e-12


def test_a_tool_that_stalls_is_waited_for() -> None:
    dmp = s_cut()
    controller = ns.Controller(dmp, H)
    run = drive(controller, usual(hand=held(np.zeros(3), 0.8, 1.3)))
    assert controller.done
    assert controller.replanned == []
    assert run.speeds.min() == 0.0
    keeps_its_bounds(run)


def test_a_small_offset_that_stays_is_taken_for_a_bias_a_large_one_blocks() -> None:
    dmp = s_cut()
    for size, blocks in ((0.02, False), (0.1, True)):
        controller = ns.Controller(dmp, H)
        off = size * way() * sideways(200)
        state, plant = controller.reset(), usual()
        plant.begin(state.position, state.rotation)
        was_blocked = False
        for k in range(int((1.5 + ACCEPT + 1.0) / H)):
            measured = plant.measured()
            if measured is not None and k > 200:
                measured = measured[0] + off, measured[1]
            state = controller.step(measured)
            plant.advance(state.position, state.rotation, H)
            was_blocked |= controller.blocked
        assert was_blocked == blocks
        assert controller.done != blocks
        assert ("blocked" in controller.reason) == blocks


def test_a_sensor_that_falls_silent_stops_the_clock_until_it_speaks() -> None:
    dmp = s_cut()
    controller, plant = ns.Controller(dmp, H), usual()
    state = controller.reset()
    plant.begin(state.position, state.rotation)
    speeds = []
    for k in range(1000):
        silent = 100 <= k < 300
        state = controller.step(None if silent else plant.measured())
        plant.advance(state.position, state.rotation, H)
        speeds.append(controller.speed)
        if k == 299:
            assert "nothing was measured" in controller.reason
    assert min(speeds[: 100 + int((SILENT - 1 / 60) / H) - 1]) == 1.0
    assert speeds[299] == 0.0
    assert controller.done
    assert controller.reason == ""


# -------------------------------------------------------------------- goals


@given(seeds, st.floats(0.05, 0.8), st.floats(0.02, 0.2))
@settings(max_examples=15)
def test_a_goal_that_jumps_is_reached(seed: int, at: float, size: float) -> None:
    rng = np.random.default_rng(seed)
    dmp = s_cut()
    goal = dmp.goal_position + size * way() * unit(rng)
    turned = Rotation.from_rotvec(0.3 * unit(rng)) * dmp.goal_rotation
    begin = at * dmp.duration
    controller = ns.Controller(dmp, H)
    run = drive(
        controller,
        usual(seed=seed),
        goal=lambda t: (goal, turned) if t >= begin else None,
        beyond=begin + 0.1,
    )
    assert controller.done
    assert 1 <= len(controller.replanned) <= 2
    assert not any(plan.failure for plan in controller.replanned)
    off, angle = misses(run.states[-1], goal, turned)
    assert off <= 4e-3 * way()
    assert angle <= 1.0
    keeps_its_bounds(run)


def test_a_second_change_of_goal_takes_no_longer_than_the_first() -> None:
    dmp = s_cut()
    first, second = (dmp.goal_position + 0.1 * way() * np.array([0, y, 0]) for y in (1, -1))

    def goal(time: float) -> Floats:
        return dmp.goal_position if time < 0.8 else first if time < 1.4 else second

    controller = ns.Controller(dmp, H)
    run = drive(controller, usual(), goal=goal, beyond=1.5)
    assert [plan.reason for plan in controller.replanned] == ["goal", "goal"]
    assert max(plan.duration for plan in controller.replanned) <= 2 * dmp.duration
    assert run.time <= 1.75 * dmp.duration
    assert misses(run.states[-1], second, dmp.goal_rotation)[0] <= 4e-3 * way()
    keeps_its_bounds(run)


def test_a_goal_that_moves_after_the_end_is_gone_to() -> None:
    dmp = s_cut()
    moved = dmp.goal_position + 0.1 * way() * np.array([0.5, 0.87, 0])
    controller = ns.Controller(dmp, H)
    run = drive(
        controller,
        usual(),
        goal=lambda t: moved if t > 1.2 * dmp.duration else dmp.goal_position,
        beyond=1.2 * dmp.duration + 0.1,
    )
    assert controller.done
    assert len(controller.replanned) == 1
    assert misses(run.states[-1], moved, dmp.goal_rotation)[0] <= 4e-3 * way()
    keeps_its_bounds(run)


def test_a_noisy_goal_is_no_other_goal() -> None:
    dmp, rng = s_cut(), np.random.default_rng(0)
    noisy = {k: dmp.goal_position + 5e-4 * rng.normal(size=3) for k in range(1000)}
    controller = ns.Controller(dmp, H)
    run = drive(controller, usual(), goal=lambda t: noisy[int(60 * t + 1e-9)])
    assert controller.replanned == []
    assert run.time <= 1.03 * dmp.duration


def test_a_goal_that_drifts_is_met_where_it_will_be() -> None:
    dmp, rng = s_cut(), np.random.default_rng(0)
    v = 0.05 * way() / dmp.duration * np.array([0.7, 0.7, 0])

    def goal(time: float) -> Floats:
        return dmp.goal_position + max(time - 0.4, 0.0) * v + 1e-4 * rng.normal(size=3)

    controller = ns.Controller(dmp, H)
    run = drive(controller, usual(), goal=goal)
    assert controller.done
    assert not any(plan.failure for plan in controller.replanned)
    assert misses(run.states[-1], goal(run.time), dmp.goal_rotation)[0] <= 0.01 * way()
    keeps_its_bounds(run)


def test_a_goal_may_be_a_position_a_rotation_or_both(either: str) -> None:
    dmp = primitive()
    goal = dmp.goal_position + [0.05, 0.02, 0.0]
    turned = Rotation.from_rotvec([0, 0, 0.1]) * dmp.goal_rotation
    for asked in (goal, turned, (goal, turned)):
        controller = dmp.controller(time_step=STEP)
        for _ in range(200):
            controller.step()
        # Asked for again and again, it is planned once.
        while not controller.done:
            state = controller.step(goal=asked)
        assert len(controller.replanned) == 1
        off, angle = misses(
            state,
            dmp.goal_position if asked is turned else goal,
            dmp.goal_rotation if asked is goal else turned,
        )
        assert off <= 1e-3 * length()
        assert angle <= 1.0


def test_a_goal_that_no_motion_reaches_is_told_and_the_old_one_kept() -> None:
    t = np.linspace(0, 1, 101)
    flat = np.column_stack([t, 0.2 * np.sin(2 * t), 0 * t])
    heading = np.arctan2(0.4 * np.cos(2 * t), 1.0)
    dmp = ns.learn(
        ns.PoseTrajectory(t, flat, Rotation.from_euler("z", heading)),
        [ns.Blade(), ns.constraints.PlaneContact()],
    )
    controller = dmp.controller(time_step=dmp.duration / dmp.steps)
    for _ in range(3000):
        state = controller.step(goal=[1.0, 0.2, 0.1])
        assert np.abs(state.constraint_residuals).max() <= 1e-10
    assert controller.done
    assert "plane-contact" in controller.replanned[0].failure
    # Ever more seldom.
    assert len(controller.replanned) <= 8
    np.testing.assert_allclose(state.position, dmp.goal_position, atol=2e-3)


def test_noise_off_the_ground_is_no_displacement() -> None:
    # No wheel leaves its ground, so there is no plan from above it, nor to there.
    s = np.linspace(0, 1, 201)
    u = eased(s)
    path = np.column_stack([1.2 * u, 0.2 * np.sin(2 * np.pi * u), 0 * u])
    dmp = ns.learn(ns.PoseTrajectory(4 * s, path, along(path, s)), [ns.Wheel()])
    rng = np.random.default_rng(0)
    goal = dmp.goal_position + [0.1, 0.1, 0.0]
    by = 0.1 * dmp.rollout(time_step=H).rotations[250].as_matrix()[:, 1] + [0, 0, 1e-3]
    controller = ns.Controller(dmp, H, follows=True)
    plant = usual(noise=1e-3, hand=held(by, 1.2, 2.2))
    drive(
        controller,
        plant,
        goal=lambda t: goal + 1e-3 * rng.normal(size=3) if t > 2.6 else None,
        beyond=2.7,
    )
    assert controller.done
    assert {(plan.reason, plan.failure) for plan in controller.replanned} == {
        ("push", ""),
        ("goal", ""),
    }


def test_a_goal_out_of_all_proportion_is_not_planned_for() -> None:
    controller = primitive().controller(time_step=STEP)
    for _ in range(100):
        controller.step(goal=[50.0, 0.0, 0.0])
    assert "adapt the primitive to it first" in controller.replanned[0].failure


# -------------------------------------------------------------------- plans beside the loop


def test_a_plan_that_comes_late_is_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    dmp = s_cut()
    controller = ns.Controller(dmp, H, real_time=True)
    goal = dmp.goal_position + 0.1 * way() * np.array([0.5, 0.87, 0])
    taken = []
    begin = controller._planner.begin

    def slow(task: Any) -> Any:
        """Ready the third time only."""
        job = begin(task)
        job.result()
        taken.append(task)
        ready = len(taken) > 2
        monkeypatch.setattr(job, "done", lambda: ready)
        return job

    monkeypatch.setattr(controller._planner, "begin", slow)
    run = drive(controller, Plant(), goal=lambda t: goal if t > 0.5 else None, beyond=0.6)
    assert controller.done
    assert len(taken) == 3
    assert len(controller.replanned) == 1
    assert misses(run.states[-1], goal, dmp.goal_rotation)[0] <= 4e-3 * way()
    keeps_its_bounds(run)


@pytest.mark.parametrize("rule", [ns.Blade(), ns.constraints.InMovingFrame(ns.Blade())])
def test_pose_and_twist_are_handed_over_as_they_are(rule: Any) -> None:
    dmp = under(s_cut(), [rule])
    goal = dmp.goal_position + 0.2 * way() * np.array([-0.5, 0.87, 0])
    controller = ns.Controller(dmp, H)
    controller.reset()
    plan, before, seen = controller.plan, controller.state, 0
    while not controller.done:
        state = controller.step(goal=goal if before.time > 0.7 else None)
        if controller.plan is not plan:
            plan, seen = controller.plan, seen + 1
            change = np.linalg.norm(state.vector()[7:10] - before.vector()[7:10]) / H
            turn = np.linalg.norm(state.vector()[10:] - before.vector()[10:]) / H
            assert change <= 1.5 * peaks()["acceleration"]
            assert turn <= 1.5 * peaks()["angular acceleration"]
        before = state
    assert seen >= 1


def test_a_copy_in_the_middle_of_a_plan_goes_on_alike() -> None:
    import pickle

    dmp = s_cut()
    goal = dmp.goal_position + 0.1 * way() * np.array([0.5, 0.87, 0])
    controller = ns.Controller(dmp, H)
    for _ in range(100):
        controller.step(goal=goal)
        if controller._task is not None:
            break
    copied = pickle.loads(pickle.dumps(controller))
    assert copied == controller
    for _ in range(200):
        one, other = controller.step(), copied.step()
        np.testing.assert_allclose(one.position, other.position, rtol=0, atol=1e-12)
    assert len(copied.replanned) == len(controller.replanned) == 1


# -------------------------------------------------------------------- what must not end a loop


@pytest.mark.parametrize("pair", [False, True])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_a_sample_that_was_lost(
    value: float, pair: bool, either: str
) -> None:
    dmp = primitive()
    controller, other = (dmp.controller(time_step=STEP) for _ in range(2))
    for k in range(50):
        state = other.state
        lost: Any = replace(state, position=np.array([0.0, value, 0.0]))
        if pair:
            lost = lost.position, lost.rotation
        one, expected = (
            controller.step(lost if k % 2 else state),
            other.step(None if k % 2 else state),
        )
        np.testing.assert_array_equal(one.vector(), expected.vector())


@pytest.mark.parametrize("size", [1e7, 1e12, 1e200, 1e308])
def test_what_is_out_of_all_proportion_is_no_measurement_and_no_goal(size: float) -> None:
    controller = s_cut().controller(time_step=H)
    for k in range(60):
        place, turned = controller.state.position, controller.state.rotation
        far = place + [0.0, size, 0.0]
        controller.step((far if k % 3 == 0 else place, turned))
        before = controller.memory.data.copy()
        with pytest.raises(NoslipError, match="goal"):
            controller.step(goal=far)
        np.testing.assert_array_equal(controller.memory.data, before)
    assert controller.mode == "track"
    assert controller.reason == ""
    assert controller.speed == 1.0


def test_a_goal_is_taken_whole_or_not_at_all() -> None:
    controller = s_cut().controller(time_step=H)
    other = deepcopy(controller)
    wrong: Any = (s_cut().goal_position + 0.01, "up")
    with pytest.raises(NoslipError, match="goal"):
        controller.step(goal=wrong)
    assert controller == other


def test_a_copy_shares_nothing() -> None:
    controller = s_cut().controller(time_step=H)
    controller.step()
    other = copy(controller)
    before = other.memory.data.copy()
    for _ in range(20):
        controller.step()
    np.testing.assert_array_equal(other.memory.data, before)


@pytest.mark.parametrize("late", [0.12, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("at", [20, 300, 500])
def test_however_late_a_cycle_is_nothing_jumps(late: float, at: int) -> None:
    controller, places = s_cut().controller(time_step=H), []
    for k in range(700):
        controller.step(time_step=late if k == at else H)
        places.append(controller.state.position)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() <= 3 * FASTER * peaks()["speed"] * H
    assert controller.done
    assert np.linalg.norm(places[-1] - s_cut().goal_position) <= 1e-4 * way()


@given(st.floats(0.4, 0.95), st.floats(2e-4, 0.02))
@settings(max_examples=3)
def test_every_cycle_keeps_the_bounds_however_long_it_is(faster: float, h: float) -> None:
    # The whole turn of a cycle is asked, and the way: a motion of 2 s has 5 ms between its samples.
    controller = ns.Controller(s_cut(), h, faster=faster)
    states, reached = [controller.reset()], 0.0
    while not controller.done:
        states.append(controller.step())
    for before, after in pairwise(states):
        way = np.linalg.norm(after.position - before.position) / h
        turn = float((after.rotation * before.rotation.inv()).magnitude()) / h
        assert way <= faster * peaks()["speed"] * (1 + 1e-3)
        assert turn <= faster * peaks()["turn"] * (1 + 1e-3)
        reached = max(reached, turn / peaks()["turn"])
    assert reached >= 0.95 * faster


@pytest.mark.parametrize("short", [1e-6, 1e-4])
def test_a_command_that_is_led_to_the_tool_keeps_its_bounds_in_a_short_cycle(short: float) -> None:
    controller = ns.Controller(s_cut(), H, follows=True)
    state = controller.reset()
    for _ in range(100):
        state = controller.step(state)
    there = state.position + 0.1 * way() * sideways(100), state.rotation
    while controller._stage != "move":
        controller.step(there)
        assert controller.state.time < 5.0
    led = []
    for k in range(2000):
        before = controller.state.position
        passed = H if k % 2 else short
        controller.step(there if controller.mode == "yield" else controller.state, time_step=passed)
        if controller.mode == "yield":
            led.append(float(np.linalg.norm(controller.state.position - before)) / passed)
    assert 0.0 < max(led) <= 2 * 1.3 * peaks()["speed"]
    assert controller.done
    assert misses(controller.state, s_cut().goal_position, s_cut().goal_rotation)[0] <= 4e-3 * way()


def test_a_plan_from_where_it_stands_finds_it_there() -> None:
    # A cycle that is very late halts it just when the goal jumps.
    goal = s_cut().goal_position + 0.1 * way() * np.array([0.5, 0.87, 0])
    controller = ns.Controller(s_cut(), H, plan_within=0.3)
    for _ in range(150):
        controller.step()
    controller.step(goal=goal, time_step=0.5)
    stands = controller.state
    while not controller.replanned:
        assert controller.speed == 0.0
        np.testing.assert_array_equal(controller.state.vector()[:7], stands.vector()[:7])
        controller.step(goal=goal)
    assert controller.state.time - stands.time <= 0.3 + 2 * H
    np.testing.assert_allclose(controller.plan.start[:3], stands.position, rtol=0, atol=1e-12)
    while not controller.done:
        controller.step(goal=goal)
    assert misses(controller.state, goal, s_cut().goal_rotation)[0] <= 4e-3 * way()


def test_a_rule_that_knows_the_time_knows_the_true_one_after_a_late_cycle() -> None:
    breathing = ns.learn(demonstration(), [ns.constraints.InMovingFrame(ns.Blade())])
    controller, time = breathing.controller(time_step=H), 0.0
    for k in range(120):
        late = 2.0 if k == 100 else H
        controller.step(time_step=late)
        time += late
    assert controller.mode == "track"
    assert controller.state.time == pytest.approx(time, abs=1e-9)


def test_a_step_that_fails_holds_and_says_why() -> None:
    controller = primitive().controller(time_step=STEP)
    for _ in range(100):
        state = controller.step()
    controller.memory.data[controller.memory.equalities] = np.nan
    held_there = controller.step()
    assert controller.mode == "fault"
    assert "not finite" in controller.reason
    np.testing.assert_array_equal(held_there.position, state.position)
    assert controller.speed == 0.0
    controller.reset()
    assert controller.mode == "track"
    assert controller.reason == ""


def test_reset_begins_anew() -> None:
    dmp = s_cut()
    goal = dmp.goal_position + 0.1 * way() * np.array([0.5, 0.87, 0])
    controller = ns.Controller(dmp, H)
    runs = [drive(controller, usual(), goal=lambda _: goal, beyond=0.2) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].positions, runs[1].positions)
    assert len(controller.replanned) == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"time_step": 0.0}, "time_step"),
        ({"time_step": np.nan}, "time_step"),
        ({"time_step": 1e-3, "tolerance": -1}, "tolerance"),
        ({"time_step": 1e-3, "angle_tolerance": 0}, "angle_tolerance"),
        ({"time_step": 1e-3, "lag": -1}, "lag"),
        ({"time_step": 1e-3, "faster": 0}, "faster"),
        ({"time_step": 1e-3, "bias": -1}, "bias"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ns.errors.InputError, match=said):
        primitive().controller(**options)


def test_wrong_steps_are_named() -> None:
    controller = primitive().controller(time_step=STEP)
    before = controller.state
    with pytest.raises(ns.errors.InputError, match="measured_state"):
        controller.step(np.zeros(3))  # type: ignore[arg-type]
    with pytest.raises(ns.errors.InputError, match="measured_state"):
        controller.step((np.zeros(2), Rotation.identity()))
    with pytest.raises(ns.errors.InputError, match="goal"):
        controller.step(goal=[1, 2])
    with pytest.raises(ns.errors.InputError, match="time_step"):
        controller.step(time_step=-1)
    assert controller.state == before


def test_without_plans_it_waits_and_takes_no_goals(either: str) -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP, replan=False, follows=True)
    for _ in range(300):
        state = controller.step(controller.state)
    for _ in range(600):
        pushed = replace(state, position=state.position + [0.0, 0.0, 0.05 * length()])
        state = controller.step(pushed)
    assert controller.speed == 0.0
    assert controller.replanned == []
    with pytest.raises(ns.errors.InputError, match="makes no plans"):
        controller.step(goal=dmp.goal_position)
    while not controller.done:
        state = controller.step(state)
    assert misses(state, dmp.goal_position, dmp.goal_rotation)[0] <= 2e-3 * length()


# -------------------------------------------------------------------- the clock


def at_speed() -> ns.ConstrainedDMP:
    """Begins and ends at half its peak speed."""
    s = np.linspace(0, 1, 201)
    u = 0.6 * s + 0.4 * eased(s)
    path = np.column_stack([0.1 * u, 0.02 * np.sin(np.pi * u), 0 * u])
    return ns.learn(ns.PoseTrajectory(2 * s, path, along(path, s)), [ns.Blade()])


def test_what_begins_and_ends_at_speed_is_run_into_and_out_of() -> None:
    dmp = at_speed()
    nominal = dmp.rollout(time_step=1e-3)
    least = np.linalg.norm(nominal.linear_velocities, axis=1).min()
    change = np.linalg.norm(np.diff(nominal.linear_velocities[1:], axis=0), axis=1).max() / 1e-3
    # That of a bend alone says little of what a robot can.
    change = max(change, 4 * nominal.path_length / dmp.duration**2)
    assert least > 0.01
    for h in (0.005, 0.001):
        controller = ns.Controller(dmp, h)
        run = drive(controller, Plant())
        assert controller.done
        speeds = np.linalg.norm([s.linear_velocity for s in run.states], axis=1)
        assert speeds[0] == 0.0
        assert np.abs(np.diff(speeds)).max() / h <= HASTE * FASTER * change
        assert speeds[-1] / h <= HASTE * FASTER * change
        off = [np.linalg.norm(nominal.positions - p, axis=1).min() for p in run.positions]
        assert max(off) <= 1e-3 * nominal.path_length
        assert np.linalg.norm(run.positions[-1] - nominal.positions[-1]) <= 1e-4
    unbounded = ns.Controller(dmp, 1e-3, faster=np.inf)
    run = drive(unbounded, Plant())
    np.testing.assert_allclose(run.positions[: len(nominal)], nominal.positions, atol=1e-12)


@pytest.mark.parametrize("name", ["needle", "wheel", "blade"])
def test_rules_that_know_no_time_hold_at_any_speed(name: str) -> None:
    from noslip.control.clock import runs_in_plan_time

    rules = {"needle": ns.Needle(), "wheel": ns.Wheel(), "blade": ns.Blade()}
    assert runs_in_plan_time(ns.constraints.ConstraintSystem([rules[name]]))


def test_rules_that_know_the_time_or_the_speed_run_in_true_time() -> None:
    from noslip.control.clock import runs_in_plan_time

    moving = ns.constraints.InMovingFrame(ns.Blade())

    @ns.velocity_constraint
    def drifts(motion: ns.constraints.Instant) -> Any:
        return motion.linear_velocity[2] - 0.01

    assert not runs_in_plan_time(ns.constraints.ConstraintSystem([moving]))
    assert not runs_in_plan_time(ns.constraints.ConstraintSystem([ns.Blade(), drifts]))
    # A slower motion keeps a limit all the more.
    limits = ns.SpeedLimit(speed=1.0)
    assert runs_in_plan_time(ns.constraints.ConstraintSystem([ns.Blade(), limits]))


def test_in_true_time_rules_hold_while_the_clock_slows_and_plans_change(either: str) -> None:
    dmp = case("breathing")
    goal = dmp.goal_position + [0.03, 0.02, 0.0]
    controller = dmp.controller(time_step=dmp.duration / 400)
    states, largest = [controller.reset()], 0.0
    for k in range(1500):
        if k == 100:
            controller.pause()
        if k == 250:
            controller.resume()
        states.append(controller.step(goal=goal if k > 150 else None))
        largest = max(largest, float(np.linalg.norm(states[-1].linear_velocity)))
    assert controller.done
    assert max(np.abs(s.constraint_residuals).max() for s in states) <= 1e-10
    usual_speed = np.linalg.norm(dmp.rollout().linear_velocities, axis=1).max()
    assert largest <= 1.5 * usual_speed
    assert [plan.failure for plan in controller.replanned] == [""]
    # It ends there, and goes on with what moves.
    ended = next(state for state in states if state.done and state.time > 1.2 * dmp.duration)
    assert misses(ended, goal, dmp.goal_rotation)[0] <= 0.05 * length()


def test_it_pauses_on_its_path_and_goes_on(either: str) -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    motion = dmp.rollout(time_step=STEP)
    states = [controller.reset()]
    while not controller.done:
        k = len(states)
        if k == 300:
            controller.pause()
        if k == 800:
            controller.resume(within=0.1)
        states.append(controller.step(states[-1] if k % 2 else None))
        assert len(states) < 3000
    assert max(np.abs(s.constraint_residuals).max() for s in states) <= 1e-10
    held_still = states[600:800]
    assert controller.speed == 1.0
    np.testing.assert_allclose(
        [s.position - held_still[0].position for s in held_still], 0, atol=1e-15
    )
    np.testing.assert_allclose([s.linear_velocity for s in held_still], 0, atol=1e-15)
    assert held_still[0].phase == pytest.approx(held_still[-1].phase, rel=1e-12)
    assert held_still[-1].time - held_still[0].time == pytest.approx(199 * STEP)
    # It halts without a jerk, and on the path it would have taken.
    speeds = np.linalg.norm([s.linear_velocity for s in states], axis=1)
    assert np.abs(np.diff(speeds)).max() <= 0.05 * speeds.max()
    off = [np.linalg.norm(motion.positions - s.position, axis=1).min() for s in states]
    assert max(off) <= 2e-3 * length()
    assert misses(states[-1], dmp.goal_position, dmp.goal_rotation)[0] <= 2e-3 * length()
    assert controller.replanned == []


def test_a_halted_tool_moves_along_with_what_moves(either: str) -> None:
    dmp = case("breathing")
    controller = dmp.controller(time_step=dmp.duration / 400)
    states = [controller.step() for _ in range(100)]
    controller.pause(within=0.0)
    states += [controller.step() for _ in range(100)]
    controller.resume(within=0.0)
    states += [controller.step() for _ in range(100)]
    assert max(np.abs(s.constraint_residuals).max() for s in states) <= 1e-10


# -------------------------------------------------------------------- compiled or not


@pytest.fixture(params=["compiled", "virtual machine"])
def either(request: pytest.FixtureRequest) -> Iterator[str]:
    """Let controllers step one way or the other."""
    if request.param == "compiled":
        request.getfixturevalue("compiling")
    yield request.param


CASES: dict[str, Any] = {
    "blade": lambda: ns.learn(demonstration(), [ns.Blade()]),
    "free": lambda: ns.learn(demonstration()),
    "turning over": lambda: ns.learn(turning_over(), [ns.Blade()]),
    "steep phase": lambda: ns.learn(
        demonstration(), [ns.Blade()], alpha_s=10.0, basis_functions=100
    ),
    "few basis functions": lambda: ns.learn(demonstration(), [ns.Needle()], basis_functions=9),
    "limits": lambda: under(
        ns.learn(demonstration(), ns.Blade()), [ns.Blade(), ns.SpeedLimit(speed=2.0)]
    ),
    "breathing": lambda: ns.learn(demonstration(), [ns.constraints.InMovingFrame(ns.Blade())]),
    "off its surface": lambda: ns.learn(demonstration(), [ns.constraints.PlaneContact()]),
}


@cache
def case(name: str) -> ns.ConstrainedDMP:
    """One of these; learned without machine code, which would be made of each rule's plans."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NOSLIP_COMPILE", "0")
        return CASES[name]()


def turning_over() -> ns.PoseTrajectory:
    s = np.linspace(0, 1, 401)
    yaw = 3 * np.pi * s
    path = np.cumsum(np.column_stack([np.cos(yaw), np.sin(yaw), 0 * s]), axis=0) / 400
    return ns.PoseTrajectory(2 * s, path, Rotation.from_euler("z", yaw))


def start_of(name: str, dmp: ns.ConstrainedDMP) -> ns.State:
    off = [0, 0, 0.02] if name == "off its surface" else [0, 0, 0]
    return dmp.initial_state(start_position=dmp.start_position + off, project_start="nothing")


def agrees(state: ns.State, expected: ns.State) -> None:
    for name in ("time", "phase", "previous_step", "duration", "done"):
        assert getattr(state, name) == pytest.approx(getattr(expected, name), rel=1e-12, abs=1e-12)
    for name in (
        *("position", "linear_velocity", "angular_velocity", "constraint_residuals", "margins"),
        *("goal_position", "acceleration", "constraint_forces", "multipliers"),
    ):
        own, other = getattr(state, name), getattr(expected, name)
        # Accelerations divide velocities by a step.
        digits = {"position": 1e-12, "linear_velocity": 1e-11}.get(name, 2e-9)
        far = max(1.0, float(np.abs(other).max(initial=0)))
        np.testing.assert_allclose(own, other, rtol=0, atol=digits * far, err_msg=name)
    apart = (state.rotation * expected.rotation.inv()).as_matrix() - np.eye(3)
    assert np.abs(apart).max() <= 1e-12


@pytest.mark.parametrize("name", CASES)
def test_its_steps_are_those_of_the_primitive(
    name: str, either: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Nothing is planned here, and to compile what plans takes seconds a rule.
    monkeypatch.setattr(compiled, "compile_for", lambda rule: None)
    dmp = case(name)
    h = dmp.duration / 400
    # Not bounded: some begin at speed.
    controller = dmp.controller(time_step=h, faster=np.inf)
    # The step without constraints is shared: once compiled it stays so.
    assert controller.is_compiled == (either == "compiled") or name == "free"
    expected = start_of(name, dmp)
    state = controller.reset(expected)
    agrees(state, expected)
    motion = dmp.rollout(start_position=expected.position, project_start="nothing", time_step=h)
    for k in range(1, 401):
        state, expected = controller.step(), dmp.step(expected, h)
        agrees(state, expected)
        np.testing.assert_allclose(state.position, motion.positions[k], rtol=0, atol=1e-12)
    assert state.done


def test_steps_may_differ_in_length(either: str) -> None:
    dmp = case("turning over")
    controller = dmp.controller(time_step=1e-3, faster=np.inf)
    expected, rng = dmp.initial_state(), np.random.default_rng(0)
    # Even for a while, as late cycles come, then even again.
    lengths = [1e-3] * 20 + list(rng.uniform(1e-4, 9e-3, 60)) + [1e-3] * 300 + [2e-3] * 50
    for h in lengths:
        # Of a late cycle, in steps as they are meant to be.
        count = max(1, round(h / 1e-3))
        for _ in range(count):
            expected = dmp.step(expected, h / count)
        agrees(controller.step(time_step=h), expected)


def test_what_was_stepped_stays_as_it_was(either: str) -> None:
    controller = primitive().controller(time_step=STEP)
    first = controller.step()
    kept = first.position.copy()
    controller.step()
    np.testing.assert_array_equal(first.position, kept)


def test_stepping_in_place_allocates_nothing_that_stays(either: str) -> None:
    dmp = case("blade")
    controller = dmp.controller(time_step=dmp.duration / 5000)
    for _ in range(100):
        controller.advance()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        controller.advance()
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before <= 2000
    assert peak - before <= 4000
