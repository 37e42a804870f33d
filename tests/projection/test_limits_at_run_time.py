"""Limits in rollouts: against quadratic programs, recursions and the barriers' closed forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import constrained, fitted
from measures import assert_same_poses
from noslip import ConstrainedDMP, Constraint, Motion
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem
from noslip.errors import ConstraintError, InputError
from noslip.law import fit
from noslip.law.layout import VELOCITY, layouts
from noslip.law.step import StepSymbols
from noslip.projection.metric import inverse_metric
from noslip.projection.pointwise import POSITION_ONLY, coupling, holdable_rows
from noslip.runtime.rollout import initial_state, integrate, steps_ahead
from noslip.runtime.stepper import stepper_of
from strategies import seeds, triple, unit

FULL = (1.0,) * 6
STEPS = 200


@cache
def free_motion(seed: int = 0) -> Motion:
    return fitted(seed).rollout()


def shared(length: float, constraints: Sequence[Constraint] = ()) -> tuple[float, ...]:
    return inverse_metric(ConstraintSystem(constraints), "shared", length, 1.0)


def wall(x: float, **settings: Any) -> ns.constraints.HalfSpace:
    """The tool stays at smaller x; all demonstrations lead there."""
    return ns.constraints.HalfSpace(point=(x, 0, 0), normal=(-1, 0, 0), **settings)


def accelerations(motion: Motion) -> Floats:
    """Of each step but the first, from velocities alone, shape (N - 2, 6)."""
    velocities = np.hstack([motion.linear_velocities, motion.angular_velocities])
    return np.asarray(np.diff(velocities[1:], axis=0) / motion.times[1])


def allowed(margins: Floats, rate: float, h: float) -> Floats:
    """What each margin at position level may be after a step, from the margins alone.

    The critically damped oscillator on from the last two samples, never below ``exp(-rate h)``
    times what the margin is, and never more than it is; outside the oscillator alone.
    """
    now, before = margins[1:-1], margins[:-2]
    left = np.exp(-rate * h)
    asked = left * (2 * now - left * before)
    return np.where(now >= 0, np.clip(asked, left * now, now), asked)


# -------------------------------------------------------------------- inactive limits


def idle_limits(seed: int) -> list[Constraint]:
    """All of the catalog, none of which the motion comes near."""
    motion = free_motion(seed)
    far = float(np.abs(motion.positions).max()) + 50
    return [
        ns.constraints.HalfSpace(point=(0, 0, -far)),
        ns.DepthLimit(depth=far),
        ns.constraints.Box(lower=(-far,) * 3, upper=(far,) * 3),
        ns.KeepOutSphere(center=(0, 0, far), radius=0.1),
        ns.constraints.KeepOutCapsule(start=(0, far, 0), end=(far, far, 0), radius=0.1),
        ns.SpeedLimit(speed=1e3),
        ns.constraints.AngularRateLimit(rate=1e3),
        ns.constraints.AccelerationLimit(linear=1e5, angular=1e6),
        ns.keep_nonnegative(lambda m: m.linear_velocity[0] + 100),
        ns.keep_nonnegative(lambda m: 100 + m.position[1] + m.angular_velocity[2]),
    ]


@pytest.mark.parametrize("index", range(10))
def test_a_limit_that_is_never_met_changes_no_bit_of_an_unconstrained_motion(index: int) -> None:
    motion = constrained([idle_limits(0)[index]], FULL).rollout()
    assert_same_poses(motion, free_motion())
    np.testing.assert_array_equal(motion.limit_multipliers, 0.0)
    np.testing.assert_array_equal(motion.row_forces, 0.0)
    assert motion.gave_way == ()


@pytest.mark.parametrize("metric", [POSITION_ONLY, FULL], ids=["position", "full"])
def test_limits_that_are_never_met_change_nothing_of_a_constrained_motion(metric: Any) -> None:
    limits = idle_limits(1)
    if metric is POSITION_ONLY:
        # Without what a held rotation cannot influence.
        limits = [*limits[:6], *limits[8:]]
    alone = constrained([ns.Blade()], metric, seed=1).rollout()
    motion = constrained([ns.Blade(), *limits], metric, seed=1).rollout()
    # Limits come with more passes, each of which rounds.
    np.testing.assert_allclose(motion.positions, alone.positions, rtol=0, atol=1e-13)
    assert (motion.rotations * alone.rotations.inv()).magnitude().max() <= 1e-12
    np.testing.assert_array_equal(motion.limit_multipliers, 0.0)


def test_a_limit_does_nothing_before_it_is_met() -> None:
    motion = constrained([wall(0.7)]).rollout()
    first = int(np.argmax(motion.limit_multipliers[:, 0] > 0))
    assert first > 50
    np.testing.assert_array_equal(motion.positions[:first], free_motion().positions[:first])


# -------------------------------------------------------------------- limits that are just met


@cache
def turning_step() -> ca.Function:
    """One step of a blade at its turning radius; free velocities to those that are kept."""
    limits = (ns.constraints.ForwardOnly(), ns.constraints.TurningRadius(0.3))
    system = ConstraintSystem([ns.Blade(), *limits])
    symbols = [ca.SX.sym(name, n) for name, n in zip("pqvw", (3, 4, 3, 3), strict=True)]
    h, free = ca.SX.sym("h"), ca.SX.sym("free", 6)
    state = StepSymbols(*symbols, ca.SX(system.size, 1), h, h, h, 0.5, 5.0, 5.0, 5.0)
    held = coupling(system, inverse_metric=shared(1.0))(state, free[:3], free[3:])
    return ca.Function("step", [*symbols, h, free], [held.linear, held.angular])


@settings(max_examples=300)
@given(seeds, st.floats(-14, -4), st.floats(-4, -2))
def test_what_hardly_violates_a_limit_is_not_stopped(
    seed: int, violation: float, step: float
) -> None:
    rng, h = np.random.default_rng(seed), 10.0**step
    rotation, speed = Rotation.random(random_state=rng), rng.uniform(0.2, 2)
    turning = np.array([*rng.normal(size=2), speed / 0.3])
    now = rotation.apply([[speed, 0, 0.1 * rng.normal()], turning])
    # Its turn goes on, but for what violates the limit, and its travel turns with it.
    after = rotation.apply(turning + [*h * rng.normal(size=2), 10.0**violation])
    forward = Rotation.from_rotvec(h / 2 * after).apply(now[0])
    kept = turning_step()(
        rng.uniform(-1.5, 1.5, 3),
        rotation.as_quat(scalar_first=True),
        *now,
        h,
        np.concatenate([forward, after]),
    )
    assert np.linalg.norm(np.array(kept[0]).ravel() - forward) <= 1e-3 * speed


# -------------------------------------------------------------------- what is evaluated

BLADE = ns.Blade()
NEAR: dict[str, tuple[Sequence[Constraint], Sequence[float]]] = {
    "wall": ([BLADE, wall(0.6)], POSITION_ONLY),
    "wall, turning": ([BLADE, wall(0.6)], FULL),
    "wall, free": ([wall(0.6)], POSITION_ONLY),
    "soft wall": ([BLADE, wall(0.6, priority=1)], FULL),
    "sphere": ([BLADE, ns.KeepOutSphere(center=(0.3, 0.05, 0), radius=0.1)], FULL),
    "speed": ([BLADE, ns.SpeedLimit(speed=1.0), wall(0.7)], FULL),
    "acceleration": ([BLADE, ns.constraints.AccelerationLimit(linear=20.0, angular=50.0)], FULL),
    "needle": ([ns.Needle(), ns.constraints.AngularRateLimit(rate=2.0), wall(0.7)], FULL),
    "wheel": ([ns.Wheel(), ns.SpeedLimit(speed=1.0)], FULL),
}


@pytest.mark.parametrize("pushed", [0.0, 0.1])
@pytest.mark.parametrize("name", NEAR)
def test_limits_are_left_out_only_where_they_change_nothing(name: str, pushed: float) -> None:
    dmp = constrained(*NEAR[name])
    function, system, rng = stepper_of(dmp.rule).function, dmp.rule.system, np.random.default_rng(0)
    whole, short = (function.find_function(part) for part in ("whole", "short"))
    start = initial_state(dmp.law, dmp.rule)
    before, left_out = start.carried(system), 0.0
    for step in steps_ahead(dmp.law, dmp.rule, start, STEPS, start.duration / STEPS):
        found = (*function(before, step), whole(before, step)[0])
        after, output, limited = (np.array(each).ravel() for each in found)
        scale = max(1.0, float(np.abs(limited).max()))
        np.testing.assert_allclose(after, limited, rtol=0, atol=1e-9 * scale)
        suffices = float(short(before, step)[2])
        places = layouts(system.space).output(system.size)
        multipliers = output[places["multipliers"]][system.equalities.size :]
        assert not suffices or not multipliers.any()
        left_out += suffices
        before = after
        before[VELOCITY] += pushed * rng.normal(size=6)
    # Some steps are stopped by a limit, others are not.
    assert 0 < left_out < STEPS


def test_limits_that_are_far_are_left_out_of_every_step_but_the_first() -> None:
    dmp = constrained([ns.Blade(), *idle_limits(1)], FULL, seed=1)
    short = stepper_of(dmp.rule).function.find_function("short")
    start = initial_state(dmp.law, dmp.rule)
    before, suffices = start.carried(dmp.rule.system), np.empty(STEPS)
    table = steps_ahead(dmp.law, dmp.rule, start, STEPS, start.duration / STEPS)
    for k, step in enumerate(table):
        before, _, suffices[k] = short(before, step)
    assert suffices[1:].all()


def test_a_limit_that_is_undefined_somewhere_is_not_left_out_there() -> None:
    @ns.keep_nonnegative
    def log(motion: ns.constraints.Instant) -> Any:
        return 10 + ca.log(0.5 - motion.position[0])

    dmp = constrained([ns.Blade(), log, wall(50.0)])
    with pytest.raises(InputError, match="not finite"):
        dmp.rollout()
    with pytest.raises(ConstraintError, match="'log' is nan"):
        state = dmp.initial_state()
        while not state.done:
            state = dmp.step(state, 1 / STEPS)


# -------------------------------------------------------------------- one step, linear limits


def least(free: Floats, A: Floats, along: Floats, G: Floats, c: Floats) -> Floats:
    """The velocity with ``A v = 0`` and ``G v >= c`` whose equalities push along other rows.

    ``v = free + along' l + G' m`` with ``m >= 0``, zero where a limit is not tight; by trying all
    sets of tight rows.  Where the rows are those that are asked, it is the nearest one.
    """
    found = []
    for count in range(len(c) + 1):
        for chosen in combinations(range(len(c)), count):
            rows, pushes = (np.vstack([first, G[list(chosen)]]) for first in (A, along))
            if np.linalg.matrix_rank(rows, 1e-9) < len(rows):
                continue
            wanted = np.concatenate([np.zeros(len(A)), c[list(chosen)]])
            multipliers = np.linalg.solve(rows @ pushes.T, wanted - rows @ free)
            v = free + pushes.T @ multipliers
            if (G @ v - c).min(initial=0) >= -1e-12 and multipliers[len(A) :].min(initial=0) >= 0:
                found.append(v)
    assert found
    return found[0]


@given(seeds)
@settings(max_examples=8)
def test_each_step_is_the_quadratic_programs_solution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = fitted().start_position
    normals = np.array([unit(rng) for _ in range(2)])
    normals[0] = -np.array([1, *rng.uniform(-0.5, 0.5, 2)])
    normals[0] /= np.linalg.norm(normals[0])
    gaps = rng.uniform(0.02, 0.4, 2)
    limits = [
        ns.constraints.HalfSpace(point=triple(start - gap * n), normal=triple(n))
        for gap, n in zip(gaps, normals, strict=True)
    ]
    dmp = constrained([ns.Blade(), *limits])
    rate, h = dmp.rule.barrier_rate, 1 / STEPS
    state = dmp.initial_state()
    margins = [gaps - h * normals @ state.linear_velocity, gaps]
    pushed = 0
    for _ in range(STEPS):
        free = dmp.regular.step(state, h)
        after = dmp.step(state, h)
        if state.previous_step == 0:
            drift = normals @ state.linear_velocity
            asked = np.exp(-rate * h) * (gaps + (drift + rate * gaps) * h)
            asked = np.clip(asked, np.exp(-rate * h) * gaps, gaps)
        else:
            asked = allowed(np.array([margins[-2], margins[-1], margins[-1]]), rate, h)[0]
        # The blade is asked in the middle of the step and pushed across where it begins.
        middle = Rotation.from_rotvec(h / 2 * free.angular_velocity) * state.rotation
        asks, pushes = (turn.apply([0, 1, 0])[None] for turn in (middle, state.rotation))
        expected = least(free.linear_velocity, asks, pushes, normals, (asked - margins[-1]) / h)
        np.testing.assert_allclose(after.linear_velocity, expected, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(after.angular_velocity, free.angular_velocity)
        pushed += bool((after.limit_multipliers > 0).any())
        margins.append(after.margins)
        state = after
    assert pushed > 0


# -------------------------------------------------------------------- barriers


@pytest.mark.parametrize("rate", [20.0, 60.0, 150.0])
@pytest.mark.parametrize("h", [1 / 200, 1 / 2000])
def test_the_margin_of_a_wall_ahead_follows_the_critically_damped_law(
    rate: float, h: float
) -> None:
    motion = constrained([wall(0.7, barrier_rate=rate)]).rollout(time_step=h)
    margin, push = motion.margins[:, 0], motion.limit_multipliers[:, 0]
    asked = allowed(margin, rate, h)
    active = push[2:] > 0
    assert active.sum() > 10
    np.testing.assert_allclose(margin[2:][active], asked[active], rtol=0, atol=1e-14)
    assert np.all(margin[2:] >= asked - 1e-14)
    # Complementarity: no push where the margin is above its barrier.
    np.testing.assert_array_equal(push[2:][margin[2:] > asked + 1e-12], 0.0)
    # Never used up, never faster than exponentially.
    assert np.all(margin > -1e-15)
    assert np.all(margin[1:] >= np.exp(-rate * h) * margin[:-1] - 1e-15)


@pytest.mark.parametrize("rate", [20.0, 60.0])
def test_a_wall_is_approached_without_a_jolt(rate: float) -> None:
    # From a constant speed s the barrier (d/dt + rate)^2 h >= 0 engages at h = 2 s / rate with no
    # jump; on it h = (2 s / rate + s t) exp(-rate t), and the deceleration rate^2 s t exp(-rate t)
    # is at most rate s / e, at t = 1 / rate.
    h = 1e-4
    motion = constrained([wall(0.8, barrier_rate=rate)]).rollout(time_step=h)
    margin, push = motion.margins[:, 0], motion.limit_multipliers[:, 0]
    first = int(np.argmax(push > 0))
    speed = -(margin[first] - margin[first - 1]) / h
    assert margin[first] == pytest.approx(2 * speed / rate, rel=0.02)
    slowing = accelerations(motion)[:, 0]
    own = np.abs(np.diff(free_motion().linear_velocities[1:], axis=0)).max() * STEPS
    assert np.abs(slowing).max() <= rate * speed / np.e + own
    assert np.abs(slowing).max() >= 0.9 * rate * speed / np.e
    # No jump when it engages: the acceleration changes by rate^2 speed h a step.
    assert np.abs(np.diff(slowing)).max() <= 1.5 * rate**2 * speed * h + 1e-3
    t = motion.times[first:] - motion.times[first]
    closed = (2 * speed / rate + speed * t) * np.exp(-rate * t)
    active = push[first:] > 0
    np.testing.assert_allclose(
        margin[first:][active], closed[active], rtol=0, atol=0.03 * margin[first]
    )


@pytest.mark.parametrize("rate", [30.0, 100.0])
@pytest.mark.parametrize("h", [1 / 200, 1 / 1000])
def test_a_start_outside_is_pulled_in_like_a_critically_damped_oscillator(
    rate: float, h: float
) -> None:
    off = 0.05
    dmp = constrained([wall(-off, barrier_rate=rate)])
    motion = dmp.rollout(time_step=h)
    speed = -dmp.initial_state().linear_velocity[0]
    t = motion.times
    expected = (-off + (speed - rate * off) * t) * np.exp(-rate * t)
    margin, push = motion.margins[:, 0], motion.limit_multipliers[:, 0]
    # Until the tool, by its inertia, comes in faster by itself.
    alone = int(np.argmax(push <= 0)) if np.any(push <= 0) else len(t)
    assert alone >= 0.015 / h
    np.testing.assert_allclose(margin[:alone], expected[:alone], rtol=0, atol=1e-12)
    assert np.all(margin >= expected - 1e-12)
    asked = allowed(margin, rate, h)
    active = push[2:] > 0
    np.testing.assert_allclose(margin[2:][active], asked[active], rtol=0, atol=1e-12)
    (gave_way,) = motion.gave_way
    assert gave_way.violation == pytest.approx(-expected.min(), abs=1e-12)


@pytest.mark.parametrize("h", [1 / 200, 1 / 2000])
@pytest.mark.parametrize("pull_in", [5.0, 20.0])
@pytest.mark.parametrize("blade", [False, True])
def test_a_start_outside_is_not_flung_in(h: float, pull_in: float, blade: bool) -> None:
    # At rest, 30 mm within what is kept out; alone the law would not move.
    off, start = 0.03, np.array([0.2, -0.1, 0.3])
    rest = ns.PoseTrajectory(
        np.linspace(0, 1, 51), start + np.zeros((51, 3)), Rotation.identity(51)
    )
    here = fit(rest, basis_functions=10)
    sphere = ns.KeepOutSphere(center=triple(start - [0.02, 0, 0]), radius=0.02 + off)
    plain = ConstrainedDMP(here)
    rules = [ns.Blade(), sphere] if blade else [sphere]
    motion = constrained(rules, plain=plain).rollout(time_step=h, pull_in=pull_in)
    margin = motion.margins[:, 0]
    assert margin[0] == pytest.approx(-off, abs=1e-9)
    # The oscillator's own, whatever the step: its speed is greatest, rate off / e, at 1 / rate.
    expected = -off * (1 + pull_in * motion.times) * np.exp(-pull_in * motion.times)
    np.testing.assert_allclose(margin, expected, rtol=0, atol=0.02 * off)
    speeds = np.linalg.norm(motion.linear_velocities, axis=1)
    assert speeds.max() <= 1.02 * pull_in * off / np.e
    assert np.all(np.diff(margin) >= -1e-9)


def test_a_tool_outside_that_moves_out_is_stopped_at_the_barriers_rate() -> None:
    off = 0.05
    dmp = constrained([wall(-off)])
    speed = float(dmp.initial_state().linear_velocity[0])
    margin = dmp.rollout(time_step=1 / 2000).margins[:, 0]
    rate = dmp.rule.barrier_rate
    assert speed > 0.5
    # Farther out by no more than that rate's oscillator would go.
    t = np.linspace(0, 0.1, 10_000)
    farthest = ((-off + (-speed - rate * off) * t) * np.exp(-rate * t)).min()
    assert margin.min() >= farthest - 1e-6
    assert farthest < -off


def test_a_start_outside_of_a_velocity_limit_is_projected_onto_it() -> None:
    limit = ns.SpeedLimit(speed=0.3)
    assert np.linalg.norm(fitted().initial_state().linear_velocity) > 0.5
    motion = constrained([limit]).rollout()
    assert motion.margins.min() >= -1e-12
    outside = constrained([limit]).rollout(project_start="nothing")
    assert outside.margins[0, 0] < -0.2
    # What no rate is named for must hold after one step.
    named = constrained([ns.SpeedLimit(speed=0.3, barrier_rate=20.0)])
    motion = named.rollout(project_start="nothing", time_step=1e-3)
    # Of steps, in their middles.
    middles = np.append(0.0, motion.times[1:] - 0.5e-3)
    expected = motion.margins[0, 0] * np.exp(-20.0 * middles)
    assert np.all(motion.margins[:, 0] >= expected - 1e-9)
    active = motion.limit_multipliers[1:, 0] > 0
    np.testing.assert_allclose(motion.margins[1:, 0][active][:20], expected[1:21], atol=1e-9)


@pytest.mark.parametrize("rate", [None, 20.0])
@pytest.mark.parametrize("share", [0.9, 0.5, 0.1, 0.0, -0.5])
def test_a_velocity_limit_lets_the_tool_stop_at_once_unless_a_rate_is_named(
    share: float, rate: float | None
) -> None:
    limit = ns.keep_nonnegative(lambda m: m.linear_velocity[0], barrier_rate=rate)
    dmp, h = constrained([limit]), 1 / STEPS
    state = dmp.initial_state()
    for _ in range(40):
        state = dmp.step(state, h)
    now = float(state.linear_velocity[0])
    assert now > 0.1

    def pushed(ahead: float) -> ns.State:
        return replace(state, position=state.position + [ahead, 0, 0])

    # The law pulls back in proportion: as far ahead as leaves this share of the velocity.
    here, there = (dmp.regular.step(pushed(x), h).linear_velocity[0] for x in (0.0, 1.0))
    at = pushed((share * now - here) / (there - here))
    free = dmp.regular.step(at, h).linear_velocity
    np.testing.assert_allclose(free[0], share * now, rtol=0, atol=1e-9)
    least = 0.0 if rate is None else np.exp(-rate * h) * now
    np.testing.assert_allclose(
        dmp.step(at, h).linear_velocity, [max(free[0], least), *free[1:]], rtol=0, atol=1e-9
    )


def test_a_limit_that_is_met_and_left_again_leaves_no_jump() -> None:
    obstacle = ns.KeepOutSphere(
        center=triple(free_motion().positions[100] + [0, 0.03, 0.01]), radius=0.06
    )
    worst = []
    for h in (1e-3, 5e-4, 2.5e-4):
        motion = constrained([obstacle]).rollout(time_step=h)
        assert (motion.limit_multipliers > 0).any()
        assert motion.limit_multipliers[-1, 0] == 0
        worst.append(np.abs(np.diff(motion.linear_velocities, axis=0)).max())
    # Velocities are continuous: their changes shrink with the step.
    assert worst[1] <= 0.6 * worst[0]
    assert worst[2] <= 0.6 * worst[1]


# -------------------------------------------------------------------- accelerations, priorities


@pytest.mark.parametrize("linear", [0.3, 0.8])
@pytest.mark.parametrize("h", [1 / 200, 1 / 2000])
def test_no_step_accelerates_more_than_its_limit(linear: float, h: float) -> None:
    own = np.linalg.norm(accelerations(free_motion())[:, :3], axis=1).max()
    assert own > linear
    motion = constrained([ns.constraints.AccelerationLimit(linear=linear)]).rollout(time_step=h)
    found = np.linalg.norm(accelerations(motion)[:, :3], axis=1)
    assert found.max() <= linear + 1e-9
    assert found.max() >= linear - 1e-6
    np.testing.assert_allclose(motion.margins[2:, 0], linear - found, rtol=0, atol=1e-8)
    assert motion.gave_way == ()


def test_no_step_turns_with_more_acceleration_than_its_limit() -> None:
    own = np.linalg.norm(accelerations(free_motion())[:, 3:], axis=1).max()
    motion = constrained(
        [ns.constraints.AccelerationLimit(linear=None, angular=0.5 * own)], FULL
    ).rollout()
    found = np.linalg.norm(accelerations(motion)[:, 3:], axis=1)
    assert found.max() <= 0.5 * own + 1e-9


@pytest.mark.parametrize("linear", [4.0, 8.0, 30.0])
def test_a_wall_holds_against_a_soft_acceleration_limit_which_is_reported(linear: float) -> None:
    dmp = constrained([wall(0.5), ns.constraints.AccelerationLimit(linear=linear, priority=1)])
    motion = dmp.rollout()
    assert motion.positions[:, 0].max() <= 0.5 + 1e-9
    (gave_way,) = motion.gave_way
    assert gave_way.name == "acceleration-limit"
    found = np.linalg.norm(accelerations(motion)[:, :3], axis=1)
    assert gave_way.violation == pytest.approx(found.max() - linear, rel=1e-9)
    assert motion.times[1 + 1 + int(found.argmax())] == pytest.approx(gave_way.time)


@pytest.mark.parametrize("linear", [4.0, 8.0, 30.0])
def test_what_a_soft_acceleration_limit_gives_way_by_is_what_the_wall_needs(linear: float) -> None:
    alone = np.linalg.norm(accelerations(constrained([wall(0.5)]).rollout())[:, :3], axis=1).max()
    dmp = constrained([wall(0.5), ns.constraints.AccelerationLimit(linear=linear, priority=1)])
    found = np.linalg.norm(accelerations(dmp.rollout())[:, :3], axis=1).max()
    assert found <= 1.5 * alone


@pytest.mark.parametrize("linear", [4.0, 8.0, 30.0])
def test_an_acceleration_limit_holds_against_a_soft_wall(linear: float) -> None:
    dmp = constrained([wall(0.5, priority=1), ns.constraints.AccelerationLimit(linear=linear)])
    motion = dmp.rollout()
    found = np.linalg.norm(accelerations(motion)[:, :3], axis=1)
    assert found.max() <= linear + 1e-6
    assert [g.name for g in motion.gave_way] == ["half-space"]


@pytest.mark.parametrize("linear", [4.0, 8.0])
def test_two_hard_limits_that_cannot_both_hold_do_not_fling_the_tool_away(linear: float) -> None:
    dmp = constrained([wall(0.5), ns.constraints.AccelerationLimit(linear=linear)])
    motion = dmp.rollout()
    assert len(motion.gave_way) >= 1
    alone = np.linalg.norm(accelerations(constrained([wall(0.5)]).rollout())[:, :3], axis=1).max()
    assert np.linalg.norm(accelerations(motion)[:, :3], axis=1).max() <= 1.5 * alone


# -------------------------------------------------------------------- balls


def nearest_in_ball(
    free: Floats, G: Floats, c: Floats, center: Floats, radius: float
) -> Floats | None:
    """The point nearest to one with ``G x >= c`` in a ball; none if there is none.

    By trying all sets of up to three tight rows: within their plane the ball is a smaller one.
    """
    found = []
    for count in range(min(3, len(c)) + 1):
        for chosen in map(list, combinations(range(len(c)), count)):
            back = np.linalg.pinv(G[chosen]) if count else np.zeros((3, 0))
            point, middle = (x + back @ (c[chosen] - G[chosen] @ x) for x in (free, center))
            room = radius**2 - np.sum((middle - center) ** 2)
            if room < 0:
                continue
            if (off := np.linalg.norm(point - middle)) ** 2 > room:
                point = middle + np.sqrt(room) / off * (point - middle)
            if (G @ point - c).min(initial=0) >= -1e-11:
                found.append(point)
    return min(found, key=lambda x: float(np.linalg.norm(x - free)), default=None)


def walled_ball(rng: np.random.Generator, count: int) -> tuple[list[Constraint], Floats, Floats]:
    """Walls close to the start, and a limit of speed or acceleration; normals and gaps."""
    start = fitted().start_position
    normals, gaps = np.array([unit(rng) for _ in range(count)]), 10 ** rng.uniform(-4, -2, count)
    walls = [
        ns.constraints.HalfSpace(point=triple(start - gap * n), normal=triple(n))
        for gap, n in zip(gaps, normals, strict=True)
    ]
    ball = (
        ns.SpeedLimit(speed=10 ** rng.uniform(-1, 0.5))
        if rng.integers(2)
        else ns.constraints.AccelerationLimit(linear=10 ** rng.uniform(0, 2))
    )
    return [*walls, ball], normals, gaps


def ball_of(dmp: ConstrainedDMP, state: ns.State, h: float) -> tuple[Floats, float]:
    """Center and radius of the velocities that the last limit allows."""
    limit, before = dmp.constraints[-1], state.linear_velocity
    if isinstance(limit, ns.constraints.AccelerationLimit):
        assert limit.linear is not None
        return before, limit.linear * h
    assert isinstance(limit, ns.SpeedLimit)
    over = max(0.0, float(np.linalg.norm(before)) - limit.speed)
    return np.zeros(3), limit.speed + np.exp(-dmp.rule.barrier_rate * h) * over


def asked_of(margins: Floats, before: Floats, rate: float, h: float) -> Floats:
    """How fast each wall may be approached, at the least."""
    return np.asarray((allowed(np.array([before, margins, margins]), rate, h)[0] - margins) / h)


@given(seeds)
@settings(max_examples=30)
def test_a_ball_beside_walls_leaves_the_nearest_velocity_within_both(seed: int) -> None:
    rng, h = np.random.default_rng(seed), 1 / STEPS
    limits, normals, gaps = walled_ball(rng, int(rng.integers(1, 4)))
    dmp = constrained(limits)
    fast = 10 ** rng.uniform(-1, 0.5) * unit(rng)
    state, alone = (
        replace(each.initial_state(), linear_velocity=fast, previous_step=h)
        for each in (dmp, dmp.regular)
    )
    free, found = (
        each.step(at, h).linear_velocity for each, at in ((dmp.regular, alone), (dmp, state))
    )
    (center, radius) = ball_of(dmp, state, h)
    c = asked_of(gaps, gaps - h * normals @ fast, dmp.rule.barrier_rate, h)
    assert (normals @ found - c).min() >= -1e-9
    nearest = nearest_in_ball(free, normals, c, center, radius)
    off = float(np.linalg.norm(found - center))
    if nearest is not None:
        assert off <= radius * (1 + 1e-9)
        scale = float(np.linalg.norm(free - center))
        np.testing.assert_allclose(found, nearest, rtol=0, atol=1e-8 * scale)
    else:
        # As little beyond it as the walls need.
        least = nearest_in_ball(center, normals, c, center, 1e9)
        assert least is not None
        assert off <= (1 + 1e-6) * np.linalg.norm(least - center)


@pytest.mark.parametrize("seed", range(8))
def test_a_ball_holds_at_every_step_that_blade_and_wall_allow_though_pushed(seed: int) -> None:
    rng, h = np.random.default_rng(seed), 1 / STEPS
    limits, normals, margins = walled_ball(rng, 1)
    dmp = constrained([ns.Blade(), *limits])
    state = replace(dmp.initial_state(), previous_step=h)
    feasible = 0
    for step in range(STEPS // 2):
        if step % 10 == 0:
            push = 0.3 * rng.normal(size=3)
            state = replace(state, linear_velocity=state.linear_velocity + push)
        v = state.linear_velocity
        after = dmp.step(state, h)
        found = after.linear_velocity
        # The blade's plane, at the offset that the motion has: what it asks is not judged here.
        middle = Rotation.from_rotvec(h / 2 * after.angular_velocity) * state.rotation
        across = middle.apply([0, 1, 0])
        G = np.vstack([normals, across, -across])
        c = asked_of(margins, margins - h * normals @ v, dmp.rule.barrier_rate, h)
        c = np.append(c, [across @ found, -across @ found])
        assert (G @ found - c).min() >= -1e-9
        center, radius = ball_of(dmp, state, h)
        if nearest_in_ball(center, G, c, center, radius * (1 - 1e-6)) is not None:
            assert np.linalg.norm(found - center) <= radius * (1 + 1e-9)
            feasible += 1
        margins = margins + h * normals @ found
        state = after
    assert feasible > STEPS // 10


@pytest.mark.parametrize("priorities", [(0, 1, 2), (2, 1, 0), (1, 3, 2), (3, 2, 1), (2, 5, 9)])
def test_contradicting_limits_give_way_in_the_order_of_their_priorities(priorities: Any) -> None:
    # Three places of which each excludes the others; they are pulled in at 300 per duration.
    slabs = [
        ns.constraints.Box(
            lower=(x, None, None), upper=(x + 0.02, None, None), priority=p, barrier_rate=300
        )
        for x, p in zip((0.1, 0.2, 0.3), priorities, strict=True)
    ]
    motion = constrained(slabs).rollout()
    best = int(np.argmin(priorities))
    late = motion.times > 0.3
    assert motion.positions[late, 0].min() >= 0.1 * (best + 1) - 1e-6
    assert motion.positions[late, 0].max() <= 0.1 * (best + 1) + 0.02 + 1e-6


def test_what_gave_way_is_recomputed_from_the_positions() -> None:
    soft = ns.constraints.HalfSpace(point=(0.4, 0, 0), normal=(-1, 0, 0), priority=2)
    motion = constrained(
        [soft, ns.constraints.HalfSpace(point=(0.5, 0, 0), normal=(1, 0, 0))]
    ).rollout()
    violation = motion.positions[:, 0] - 0.4
    found = {g.name: g for g in motion.gave_way}["half-space"]
    worst = int(np.argmax(violation))
    assert found.violation == pytest.approx(violation[worst], abs=1e-12)
    assert found.time == motion.times[worst]
    assert found.share == pytest.approx(np.mean(violation > 1e-9))


# -------------------------------------------------------------------- forces


def busy(metric: Sequence[float] = POSITION_ONLY) -> ConstrainedDMP:
    path = free_motion().positions
    return constrained(
        [
            ns.Blade(),
            ns.KeepOutSphere(center=triple(path[60] + [0, 0.02, 0]), radius=0.05),
            wall(0.55),
            ns.SpeedLimit(speed=0.9),
        ],
        metric,
    )


@pytest.mark.parametrize("metric", [POSITION_ONLY, shared(0.05)], ids=["position", "shared"])
def test_forces_of_the_rows_add_up(metric: Any) -> None:
    motion = busy(metric).rollout()
    names = (*motion.constraint_names, *motion.limit_names)
    assert len(names) == 4
    scale = np.abs(motion.constraint_forces).max()
    total = motion.row_forces.sum(axis=1)
    np.testing.assert_allclose(total, motion.constraint_forces, rtol=0, atol=1e-9 * scale)
    for row, name in enumerate(names):
        np.testing.assert_array_equal(motion.force_of(name), motion.row_forces[:, row])
    # All took part; who pushes, and only who pushes, has a force.
    assert np.all(motion.limit_multipliers.max(axis=0) > 0)
    idle = motion.limit_multipliers == 0
    np.testing.assert_array_equal(motion.row_forces[:, 1:][idle], 0.0)
    assert motion.limit_multipliers.min() >= -1e-9 * scale
    with pytest.raises(ns.errors.InputError, match="no constraint 'needle'"):
        motion.force_of("needle")


def test_a_half_spaces_force_is_its_multiplier_along_its_normal() -> None:
    motion = busy().rollout()
    force = motion.force_of("half-space")[:, :3]
    expected = motion.limit_multipliers[:, [1]] * [-1.0, 0, 0]
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-9 * np.abs(force).max())


# -------------------------------------------------------------------- redundancy, steps


REPEATED: dict[str, Callable[[], list[Constraint]]] = {
    "half-space": lambda: [wall(0.5)],
    "sphere": lambda: [
        ns.KeepOutSphere(center=triple(free_motion().positions[100] + [0, 0.02, 0.01]), radius=0.08)
    ],
    "speed": lambda: [ns.SpeedLimit(speed=0.8)],
    "box": lambda: [ns.constraints.Box(upper=(0.5, 0.1, 1.0))],
    "blade and half-space": lambda: [ns.Blade(), wall(0.5)],
    "turning radius": lambda: [ns.constraints.TurningRadius(radius=0.6)],
    "acceleration": lambda: [ns.constraints.AccelerationLimit(linear=0.5)],
}


@pytest.mark.parametrize(
    ("name", "times"),
    [(name, n) for name in REPEATED for n in (2, 3)],
)
def test_a_repeated_limit_changes_nothing(name: str, times: int) -> None:
    metric = shared(0.1)
    once = constrained(REPEATED[name](), metric).rollout()
    assert (once.limit_multipliers > 0).any()
    again = constrained(REPEATED[name]() * times, metric).rollout()
    np.testing.assert_allclose(again.positions, once.positions, rtol=0, atol=1e-9)
    assert (again.rotations * once.rotations.inv()).magnitude().max() <= 1e-8


@pytest.mark.parametrize("factor", [2.0, 1e-3, 1e3])
def test_a_limit_stated_twice_in_other_units_changes_nothing(factor: float) -> None:
    def limit(unit: float) -> Constraint:
        return ns.keep_nonnegative(lambda motion: unit * (0.5 - motion.position[0]))

    once = constrained([ns.Blade(), wall(0.5)]).rollout()
    alone = constrained([ns.Blade(), limit(factor)]).rollout()
    both = constrained([ns.Blade(), wall(0.5), limit(factor)]).rollout()
    np.testing.assert_allclose(alone.positions, once.positions, rtol=0, atol=1e-9)
    np.testing.assert_allclose(both.positions, once.positions, rtol=0, atol=1e-9)


@pytest.mark.parametrize("metric", [POSITION_ONLY, shared(0.05)], ids=["position", "shared"])
def test_a_rollout_with_limits_is_the_repeated_step(metric: Any) -> None:
    dmp = busy(metric)
    motion = dmp.rollout(duration=2.0)
    state = dmp.initial_state(duration=2.0)
    for k in range(dmp.steps):
        state = dmp.step(state, 2.0 / dmp.steps)
        np.testing.assert_allclose(state.position, motion.positions[k + 1], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.margins, motion.margins[k + 1], rtol=0, atol=1e-11)
    assert (state.rotation * motion.rotations[-1].inv()).magnitude() <= 1e-12


def test_steps_of_uneven_length_keep_the_limits() -> None:
    dmp = busy(shared(0.05))
    rng = np.random.default_rng(0)
    state = dmp.initial_state()
    while state.time < 1:
        state = dmp.step(state, float(rng.uniform(5e-4, 8e-3)))
        assert state.margins.min() >= -1e-9
        assert np.abs(state.constraint_residuals).max() <= 1e-10


# -------------------------------------------------------------------- starts


@pytest.mark.parametrize("h", [1 / 200, 1 / 1000])
@pytest.mark.parametrize("rate", [5.0, 30.0])
def test_a_start_off_both_levels_decays_exponentially_beside_limits(rate: float, h: float) -> None:
    start = fitted().start_position
    rules: list[Constraint] = [
        ns.Blade(),
        ns.constraints.PlaneContact(point=triple(start + [0, 0, 0.02])),
        wall(0.9),
    ]
    motion = constrained(rules).rollout(time_step=h, pull_in=rate)
    expected = -0.02 * np.exp(-rate * motion.times)
    np.testing.assert_allclose(motion.constraint_residuals[:, 0], 0, atol=1e-10)
    np.testing.assert_allclose(motion.constraint_residuals[:, 1], expected, rtol=0, atol=1e-9)
    moved = constrained(rules).rollout(time_step=h, pull_in=rate, project_start="pose")
    assert np.abs(moved.constraint_residuals).max() <= 1e-10
    np.testing.assert_allclose(moved.positions[0], start + [0, 0, 0.02], rtol=0, atol=1e-12)


# -------------------------------------------------------------------- compositions


def equalities(rng: np.random.Generator, p: Floats, R: Rotation, lever: float) -> dict[str, Any]:
    """Constraints through a pose, by name."""

    def arm() -> tuple[float, float, float]:
        return triple(lever * rng.normal(size=3)) if rng.random() < 0.4 else (0.0, 0.0, 0.0)

    def plane() -> Constraint:
        r = arm()
        return ns.constraints.PlaneContact(
            point=triple(p + R.apply(r)), normal=triple(unit(rng)), **at(r)
        )

    def sphere() -> Constraint:
        r = arm()
        center = p + R.apply(r) - 0.8 * unit(rng)
        return ns.constraints.SphereContact(center=triple(center), radius=0.8, **at(r))

    def cylinder() -> Constraint:
        r, axis = arm(), unit(rng)
        away = np.cross(axis, unit(rng))
        center = p + R.apply(r) - 0.6 * away / np.linalg.norm(away) + 0.3 * axis
        return ns.constraints.CylinderContact(
            point=triple(center), axis=triple(axis), radius=0.6, **at(r)
        )

    def remote_center() -> Constraint:
        r = arm()
        away = rng.uniform(0.25, 1) * R.apply([0, 0, 1])
        return ns.constraints.RemoteCenter(point=triple(p + R.apply(r) + away), **at(r))

    def tool_axis() -> Constraint:
        index, toward = int(rng.integers(3)), unit(rng)
        axis = R.apply(np.eye(3)[index])
        if rng.random() < 0.4:
            return ns.constraints.ToolAxis(axis="xyz"[index], direction=triple(axis))
        angle = float(np.arccos(toward @ axis))
        return ns.constraints.ToolAxis(axis="xyz"[index], direction=triple(toward), angle=angle)

    def wheel() -> Constraint:
        normal = triple(R.apply([0, 0, 1])) if rng.random() < 0.5 else None
        return ns.Wheel(normal=normal, **at(arm()))

    return {
        "blade": lambda: ns.Blade(**at(arm())),
        "needle": lambda: ns.Needle(curvature=float(rng.choice([0, 1.5])), **at(arm())),
        "plane": plane,
        "sphere": sphere,
        "cylinder": cylinder,
        "remote center": remote_center,
        "tool axis": tool_axis,
        "wheel": wheel,
    }


def at(r: tuple[float, float, float]) -> dict[str, Any]:
    return {"reference_point": r}


def limits(rng: np.random.Generator, p: Floats, motion: Motion) -> dict[str, Any]:
    """Limits that allow a start and some of which a motion meets; rest violates none."""
    path = motion.positions
    middle = path[int(rng.integers(len(path) // 3, 2 * len(path) // 3))]
    size = float(np.ptp(path, axis=0).max())
    fast = float(np.linalg.norm(motion.linear_velocities, axis=1).max())
    turning = float(np.linalg.norm(motion.angular_velocities, axis=1).max())

    def near() -> Floats:
        return np.asarray(middle + 0.05 * size * unit(rng))

    def half_space() -> Constraint:
        normal = unit(rng)
        point = p - normal * rng.uniform(0.01, 0.3) * size
        return ns.constraints.HalfSpace(point=triple(point), normal=triple(normal))

    def depth() -> Constraint:
        depth = float(rng.uniform(0.01, 0.1) * size)
        return ns.DepthLimit(depth=depth, surface_point=triple(p), normal=triple(unit(rng)))

    def box() -> Constraint:
        lower, upper = np.minimum(p, path.min(0) * 0.8), np.maximum(p, path.max(0) * 0.8)
        return ns.constraints.Box(lower=triple(lower - 0.01), upper=triple(upper + 0.01))

    def capsule() -> Constraint:
        start = near()
        end = start + 0.2 * size * unit(rng)
        return ns.constraints.KeepOutCapsule(
            start=triple(start), end=triple(end), radius=0.05 * size
        )

    return {
        "half-space": half_space,
        "depth": depth,
        "box": box,
        "sphere": lambda: ns.KeepOutSphere(center=triple(near()), radius=0.15 * size),
        "capsule": capsule,
        "speed": lambda: ns.SpeedLimit(speed=float(rng.uniform(0.3, 1.2) * fast)),
        "rate": lambda: ns.constraints.AngularRateLimit(
            rate=float(rng.uniform(0.3, 1.2) * turning)
        ),
        "forward": lambda: ns.constraints.ForwardOnly(edge=str(rng.choice(["x", "y", "-x"]))),
        "radius": lambda: ns.constraints.TurningRadius(
            radius=float(rng.uniform(0.001, 0.05) * size)
        ),
    }


def composition(seed: int, lever: float = 0.0, shortest: float = 1e-3) -> ConstrainedDMP | None:
    """Up to three equalities, up to three limits and a metric; None where the rows depend."""
    rng = np.random.default_rng(seed)
    which = int(rng.integers(7))
    plain, motion = fitted(which), free_motion(which)
    p, R = plain.start_position, plain.start_rotation
    chosen: list[Constraint] = []
    for rules in (equalities(rng, p, R, lever), limits(rng, p, motion)):
        names = rng.choice(list(rules), int(rng.integers(0, 4)), replace=False)
        chosen += [rules[str(name)]() for name in names]
    system = ConstraintSystem(chosen)
    velocity_limits = any(c.name in ("turning-radius", "angular-rate-limit") for c in chosen)
    size = float(np.ptp(motion.positions, axis=0).max())
    length = float(size * 10 ** rng.uniform(np.log10(shortest), 0))
    kinds = {
        "shared": shared(length),
        "uneven": inverse_metric(system, 10 ** rng.uniform(-1, 1, 6), length, 1.0),
    }
    if all(holdable_rows(system, POSITION_ONLY)) and not velocity_limits:
        kinds["position"] = POSITION_ONLY
    metric = kinds[str(rng.choice(list(kinds)))]
    count = system.equalities.size
    if count:
        moving = rng.normal(size=(2, 3))
        quaternion = R.as_quat(scalar_first=True)
        rows = system.equalities.instant(0.0, p, quaternion, *moving)[2]
        values = np.linalg.svd(rows * (np.array(metric) > 0))[1]
        if count > (2 if metric is POSITION_ONLY else 5) or values[count - 1] < 0.05:
            return None
    if not chosen:
        return None
    return constrained(chosen, metric, seed=which)


def holds(dmp: ConstrainedDMP, seed: int) -> int:
    """Assert that three motions are finite, on the equalities and within the limits."""
    rng = np.random.default_rng(seed)
    size = float(np.ptp(free_motion().positions, axis=0).max())
    taken = 0
    for trial, steps in enumerate((200, 1000, 300)):
        goal = dmp.goal_position + (rng.normal(size=3) * 0.2 * size if trial else 0)
        duration = float(10 ** rng.uniform(-1, 2)) if trial == 2 else 1.0
        # As a controller steps it: a rollout is refused a duration too short for its limits.
        state = dmp.initial_state(goal_position=goal, duration=duration)
        motion = integrate(dmp.law, dmp.rule, state, [(steps, duration / steps)])
        fast = max(1.0, 1 / duration)
        assert np.isfinite(motion.positions).all() and np.isfinite(motion.row_forces).all()
        assert np.abs(motion.constraint_residuals).max(initial=0) <= 1e-10 * fast, (seed, trial)
        if motion.margins[0].min(initial=0) >= 0:
            assert motion.margins.min(initial=0) >= -1e-6 * size * fast, (seed, trial)
        taken += steps
    return taken


SEEDS = [*range(24), 45, 54]
"""Of compositions; in the last two a step's passes do not suffice."""


@pytest.mark.parametrize("seed", SEEDS)
def test_random_compositions_hold_in_random_metrics(seed: int) -> None:
    dmp = composition(seed)
    if dmp is not None:
        holds(dmp, seed)


def test_a_motion_does_not_stop_and_go_from_step_to_step() -> None:
    dmp = composition(14)
    assert dmp is not None
    speeds = np.linalg.norm(dmp.rollout(time_step=1 / STEPS).linear_velocities, axis=1)
    moving = speeds[1:] > 0.1
    assert np.count_nonzero(moving[1:] != moving[:-1]) <= 4


# A metric's length of no less than the constraints' levers.
@pytest.mark.parametrize("seed", SEEDS)
def test_random_compositions_of_points_off_the_origin_hold(seed: int) -> None:
    dmp = composition(seed, lever=0.1, shortest=0.1)
    if dmp is not None:
        holds(dmp, seed)


@pytest.mark.parametrize("h", [1 / 200, 1 / 1000, 1 / 5000])
def test_a_remote_center_is_held_by_the_position_alone(h: float) -> None:
    start, turn = fitted().start_position, fitted().start_rotation
    rule = ns.constraints.RemoteCenter(point=triple(start + 0.5 * turn.apply([0, 0, 1])))
    motion = constrained([rule]).rollout(time_step=h)
    assert np.abs(motion.constraint_residuals).max() <= 1e-12


def levers() -> dict[str, list[Constraint]]:
    """Constraints of points far off the origin, through the start."""
    start, turn = fitted().start_position, fitted().start_rotation
    r = (-0.08, -0.14, 0.03)
    center = start + turn.apply(r) - [0, 0, 0.8]
    axle = (-0.055, 0.098, -0.031)
    angle = float(np.arccos(turn.apply([1, 0, 0])[2]))
    return {
        "sphere": [ns.constraints.SphereContact(center=triple(center), radius=0.8, **at(r))],
        "wheel": [ns.Wheel(normal=triple(turn.apply([0, 0, 1])), **at(axle))],
        "remote center at an angle": [
            ns.constraints.RemoteCenter(point=triple(start + 0.5 * turn.apply([0, 0, 1]))),
            ns.constraints.ToolAxis(axis="x", direction=(0, 0, 1), angle=angle),
        ],
    }


@cache
def reaching(name: str) -> tuple[Motion, ...]:
    """Motions to goals all round, in the default length of a shared metric: that of a step."""
    dmp = constrained(levers()[name], shared(free_motion().path_length / STEPS))
    rng = np.random.default_rng(0)
    goals = dmp.goal_position + 0.3 * rng.normal(size=(40, 3))
    return tuple(dmp.rollout(goal_position=goal) for goal in goals)


@pytest.mark.parametrize(
    "name",
    ["sphere", "wheel", "remote center at an angle"],
)
def test_points_off_the_origin_are_held_in_the_default_shared_metric(name: str) -> None:
    for motion in reaching(name):
        assert np.abs(motion.constraint_residuals).max() <= 2e-10


@pytest.mark.parametrize("name", ["sphere", "wheel"])
def test_a_tool_that_can_move_on_does_not_stand_still(name: str) -> None:
    for motion in reaching(name):
        speeds = np.linalg.norm(motion.linear_velocities[1:], axis=1)
        assert speeds.min() > 1e-6
