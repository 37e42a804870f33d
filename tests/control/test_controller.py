"""The loop: steps like a rollout, comes back when pushed, reaches goals that move."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from noslip._typing import Floats
from noslip.control.steering import LARGEST_TURN, turn_that_allows
from noslip.experiments.numerical_example import demonstration
from strategies import seeds, unit


@cache
def primitive() -> ns.ConstrainedDMP:
    return ns.learn(demonstration(), [ns.Blade()])


@cache
def length() -> float:
    return primitive().rollout().path_length


STEP = primitive().duration / primitive().steps


def run(
    controller: ns.Controller,
    pushes: dict[int, Floats] | None = None,
    goals: dict[int, Any] | None = None,
    measured: bool = True,
) -> list[ns.State]:
    """Step to the end; each measured state is the last one, pushed where asked."""
    pushes, goals = pushes or {}, goals or {}
    state = controller.reset()
    states = [state]
    while not controller.done:
        k = len(states) - 1
        assert k < 10 * primitive().steps
        given_state = replace(state, position=state.position + pushes.get(k, np.zeros(3)))
        state = controller.step(given_state if measured else None, goals.get(k))
        states.append(state)
    return states


def residual(states: list[ns.State]) -> float:
    return max(float(np.abs(s.constraint_residuals).max()) for s in states)


def misses(state: ns.State, position: Floats, rotation: Rotation) -> tuple[float, float]:
    """Distance from a goal over the path's length, and degrees."""
    off = float(np.linalg.norm(state.position - position)) / length()
    return off, float(np.degrees((state.rotation * rotation.inv()).magnitude()))


@pytest.mark.parametrize("measured", [False, True])
def test_undisturbed_it_is_the_rollout_to_the_bit(measured: bool) -> None:
    dmp = primitive()
    states = run(dmp.controller(time_step=STEP), measured=measured)
    motion = dmp.rollout(time_step=STEP)
    np.testing.assert_allclose([s.position for s in states], motion.positions, rtol=0, atol=1e-12)
    last = states[-1].rotation * motion.rotations[-1].inv()
    assert last.magnitude() <= 1e-12


@given(seeds, st.floats(0, 0.999), st.floats(0.01, 0.2), st.booleans())
@settings(max_examples=25)
def test_a_pushed_tool_reaches_the_goal_and_never_slips(
    seed: int, when: float, size: float, sideways: bool
) -> None:
    rng = np.random.default_rng(seed)
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    k = int(when * dmp.steps)
    direction = unit(rng)
    if sideways:
        direction = dmp.rollout().rotations[k].as_matrix()[:, 1]
    states = run(controller, {k: size * length() * direction})
    assert residual(states) <= 1e-10
    off, turned = misses(states[-1], dmp.goal_position, dmp.goal_rotation)
    assert off <= 1e-3
    assert turned <= 1.0
    assert not any(plan.failure for plan in controller.replanned)


@given(seeds, st.floats(0.05, 0.9))
@settings(max_examples=10)
def test_a_goal_that_moves_is_reached(seed: int, when: float) -> None:
    rng = np.random.default_rng(seed)
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    goal = dmp.goal_position + 0.2 * length() * unit(rng)
    turned_goal = Rotation.from_rotvec(0.5 * unit(rng)) * dmp.goal_rotation
    asked = {int(when * dmp.steps): (goal, turned_goal)}
    states = run(controller, goals=asked)
    assert residual(states) <= 1e-10
    off, turned = misses(states[-1], goal, turned_goal)
    assert off <= 1e-3
    assert turned <= 1.0
    assert [plan.reason for plan in controller.replanned] == ["goal"]


def test_small_sideways_pushes_are_steered_away_without_a_new_plan() -> None:
    dmp = primitive()
    nominal = dmp.rollout(time_step=STEP)
    k = 150
    push = 0.0015 * length() * nominal.rotations[k].as_matrix()[:, 1]
    controller = dmp.controller(time_step=STEP)
    steered = run(controller, {k: push})
    assert controller.replanned == []
    # Without steering: the same steps, none of them measured.
    state = dmp.initial_state()
    for i in range(dmp.steps):
        if i == k:
            state = replace(state, position=state.position + push)
        state = dmp.step(state, STEP)
    halfway = (k + dmp.steps) // 2
    off = np.linalg.norm(steered[halfway].position - nominal.positions[halfway])
    left = np.linalg.norm(state.position - nominal.positions[-1])
    assert off <= 0.25 * np.linalg.norm(push)
    assert np.linalg.norm(steered[-1].position - nominal.positions[-1]) <= left


def test_noise_of_measurement_does_not_make_it_slip_or_miss() -> None:
    rng = np.random.default_rng(0)
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    pushes = {k: 1e-5 * length() * rng.normal(size=3) for k in range(dmp.steps)}
    states = run(controller, pushes)
    assert residual(states) <= 1e-10
    assert misses(states[-1], dmp.goal_position, dmp.goal_rotation)[0] <= 2e-3


def test_a_tool_that_is_held_is_waited_for() -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    state = controller.reset()
    for _ in range(300):
        state = controller.step(state)
    held = state
    for _ in range(2000):
        pose = replace(
            controller.state,
            position=held.position,
            rotation=held.rotation,
            linear_velocity=np.zeros(3),
            angular_velocity=np.zeros(3),
        )
        state = controller.step(pose)
    assert not controller.done
    while not controller.done:
        state = controller.step(state)
        assert np.abs(state.constraint_residuals).max() <= 1e-10
    off, turned = misses(state, dmp.goal_position, dmp.goal_rotation)
    assert off <= 2e-3
    assert turned <= 1.0


def test_a_goal_that_no_motion_reaches_is_told_and_the_old_one_kept() -> None:
    t = np.linspace(0, 1, 101)
    flat = np.column_stack([t, 0.2 * np.sin(2 * t), 0 * t])
    heading = np.arctan2(0.4 * np.cos(2 * t), 1.0)
    dmp = ns.learn(
        ns.PoseTrajectory(t, flat, Rotation.from_euler("z", heading)),
        [ns.Blade(), ns.constraints.PlaneContact()],
    )
    controller = dmp.controller(time_step=dmp.duration / dmp.steps)
    state = controller.step(goal=[1.0, 0.2, 0.1])
    while not controller.done:
        state = controller.step(state)
        assert np.abs(state.constraint_residuals).max() <= 1e-10
    assert "plane-contact" in controller.replanned[0].failure
    np.testing.assert_allclose(state.position, dmp.goal_position, atol=2e-3)


def test_cycles_that_come_late_are_caught_up_with() -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    rng = np.random.default_rng(1)
    while not controller.done:
        state = controller.step(controller.state, time_step=STEP * rng.choice([0.5, 1, 1, 3]))
        assert np.abs(state.constraint_residuals).max() <= 1e-10
    assert misses(state, dmp.goal_position, dmp.goal_rotation)[0] <= 3e-3


def test_reset_begins_anew() -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    push = {400: 0.1 * length() * np.array([0.0, 1.0, 0.0])}
    first = run(controller, push)
    second = run(controller, push)
    np.testing.assert_array_equal(first[-1].position, second[-1].position)
    assert len(controller.replanned) == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"time_step": 0.0}, "time_step"),
        ({"time_step": np.nan}, "time_step"),
        ({"time_step": 1e-3, "tolerance": -1}, "tolerance"),
        ({"time_step": 1e-3, "angle_tolerance": 0}, "angle_tolerance"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ns.errors.InputError, match=said):
        primitive().controller(**options)


def test_wrong_steps_are_named() -> None:
    controller = primitive().controller(time_step=STEP)
    with pytest.raises(ns.errors.InputError, match="measured_state"):
        controller.step(np.zeros(3))
    with pytest.raises(ns.errors.InputError, match="goal"):
        controller.step(goal=[1, 2])
    with pytest.raises(ns.errors.InputError, match="time_step"):
        controller.step(time_step=-1)


# -------------------------------------------------------------------- steering


def steering(system: Any, speed: float, *values: Floats) -> Floats:
    """Value of the turn at a path's time, position, quaternion, velocities, and a wish."""
    symbols = [ca.SX.sym("x", np.size(value)) for value in values]
    turn = ca.Function("turn", symbols, [turn_that_allows(system, speed, *symbols)])
    return np.asarray(turn(*values)).ravel()


@given(seeds)
def test_the_turned_blade_allows_the_wish(seed: int) -> None:
    # Of first order: what is left is of second order in the wish.
    rng = np.random.default_rng(seed)
    system = ns.learn(demonstration(), [ns.Blade()]).system if seed == 0 else primitive().system
    R = Rotation.random(rng=rng)
    along = R.as_matrix() @ [1.0, 0, 0.3 * rng.normal()]
    left = []
    for size in (1e-2, 1e-3):
        wish = size * unit(np.random.default_rng(seed))
        quaternion = R.as_quat(scalar_first=True)
        turn = steering(system, 1e-9, 0.0, np.zeros(3), quaternion, along, np.zeros(3), wish)
        lateral = (Rotation.from_rotvec(turn) * R).as_matrix()[:, 1]
        left.append(abs(lateral @ (along + wish)))
    assert left[0] <= 2e-4
    assert left[1] <= 2e-6


def test_steering_is_bounded_and_nothing_where_the_tool_rests() -> None:
    at = (primitive().system, 1.0, 0.0, np.zeros(3), np.array([1.0, 0, 0, 0]))
    far = steering(*at, np.array([1.0, 0, 0]), np.zeros(3), np.array([0, 1e3, 0]))
    assert np.linalg.norm(far) <= LARGEST_TURN * (1 + 1e-12)
    rest = steering(*at, np.zeros(3), np.zeros(3), np.array([0, 1e-3, 0]))
    np.testing.assert_allclose(rest, 0, atol=1e-12)


def test_constraints_on_poses_do_not_steer() -> None:
    system = ns.learn(demonstration(), [ns.constraints.PlaneContact()]).system
    identity = np.array([1.0, 0, 0, 0])
    assert not steering(system, 1.0, 0.0, np.zeros(3), identity, *np.eye(3)).any()


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
def test_its_steps_are_those_of_the_primitive(name: str, either: str) -> None:
    dmp = CASES[name]()
    h = dmp.duration / 400
    controller = dmp.controller(time_step=h)
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
    dmp = CASES["turning over"]()
    controller = dmp.controller(time_step=1e-3)
    expected, rng = dmp.initial_state(), np.random.default_rng(0)
    # Even for a while, as late cycles come, then even again.
    lengths = [1e-3] * 20 + list(rng.uniform(1e-4, 9e-3, 60)) + [1e-3] * 300 + [2e-3] * 50
    for h in lengths:
        expected = dmp.step(expected, h)
        agrees(controller.step(time_step=h), expected)


def test_what_was_stepped_stays_as_it_was(either: str) -> None:
    controller = primitive().controller(time_step=STEP)
    first = controller.step()
    kept = first.position.copy()
    controller.step()
    np.testing.assert_array_equal(first.position, kept)


def test_stepping_in_place_allocates_nothing_that_stays(either: str) -> None:
    dmp = CASES["blade"]()
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


@pytest.mark.parametrize("turn", [False, True])
def test_after_any_push_the_next_step_does_not_slip(turn: bool, either: str) -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    rng = np.random.default_rng(3)
    state = controller.reset()
    for k in range(600):
        if k % 7 == 3:
            state = replace(
                state,
                rotation=Rotation.from_rotvec(0.02 * turn * unit(rng)) * state.rotation,
                linear_velocity=state.linear_velocity + 0.1 * unit(rng),
                angular_velocity=state.angular_velocity + 0.1 * unit(rng),
            )
        state = controller.step(state)
        assert np.abs(state.constraint_residuals).max() <= 1e-10


def test_it_pauses_on_its_path_and_goes_on(either: str) -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP)
    motion = dmp.rollout(time_step=STEP)
    states = [controller.reset()]
    while not controller.done:
        k = len(states)
        if k == 300:
            controller.pause()
        if k == 600:
            controller.resume(within=0.1)
        states.append(controller.step(states[-1] if k % 2 else None))
        assert len(states) < 3000
    assert residual(states) <= 1e-10
    held = states[400:600]
    assert controller.speed == 1.0
    np.testing.assert_allclose([s.position - held[0].position for s in held], 0, atol=1e-15)
    np.testing.assert_allclose([s.linear_velocity for s in held], 0, atol=1e-15)
    assert held[0].phase == pytest.approx(held[-1].phase, rel=1e-12)
    assert held[-1].time - held[0].time == pytest.approx(199 * STEP)
    # It halts without a jerk, and on the path it would have taken.
    speeds = np.linalg.norm([s.linear_velocity for s in states], axis=1)
    assert np.abs(np.diff(speeds)).max() <= 0.2 * speeds.max()
    path = motion.positions
    off = [np.linalg.norm(path - s.position, axis=1).min() for s in states]
    assert max(off) <= 2e-3 * length()
    assert misses(states[-1], dmp.goal_position, dmp.goal_rotation)[0] <= 2e-3
    assert controller.replanned == []


def test_a_halted_tool_moves_along_with_what_moves(either: str) -> None:
    dmp = CASES["breathing"]()
    controller = dmp.controller(time_step=dmp.duration / 400)
    states = [controller.step() for _ in range(100)]
    controller.pause(within=0.0)
    states += [controller.step() for _ in range(100)]
    controller.resume(within=0.0)
    states += [controller.step() for _ in range(100)]
    assert residual(states) <= 1e-10


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
        assert (
            misses(
                state,
                dmp.goal_position if asked is turned else goal,
                dmp.goal_rotation if asked is goal else turned,
            )[0]
            <= 1e-3
        )


@pytest.mark.parametrize("field", ["position", "linear_velocity", "angular_velocity"])
def test_what_is_not_finite_is_refused_and_changes_nothing(field: str, either: str) -> None:
    controller = primitive().controller(time_step=STEP)
    state = controller.step()
    with pytest.raises(ns.errors.InputError, match="not finite"):
        controller.step(replace(state, **{field: np.array([0, np.nan, 0])}))
    np.testing.assert_array_equal(controller.state.position, state.position)


def test_without_plans_it_steers_and_waits_and_takes_no_goals(either: str) -> None:
    dmp = primitive()
    controller = dmp.controller(time_step=STEP, replan=False)
    state = controller.reset()
    for _ in range(300):
        state = controller.step(state)
    state = replace(state, position=state.position + [0.0, 0.0, 0.05 * length()])
    pushed = controller.step(state)
    # Beyond the tolerance the phase stands.
    assert pushed.phase == pytest.approx(state.phase, rel=1e-12)
    assert controller.replanned == []
    with pytest.raises(ns.errors.InputError, match="makes no plans"):
        controller.step(goal=dmp.goal_position)


def test_a_goal_out_of_all_proportion_is_not_planned_for() -> None:
    controller = primitive().controller(time_step=STEP)
    controller.step(goal=[50.0, 0.0, 0.0])
    assert "adapt the primitive to it first" in controller.replanned[0].failure
