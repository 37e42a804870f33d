"""Rhythms: a cyclic clock, a periodic basis and winding, laws that go round without drift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints.check import step_residuals
from noslip.errors import InputError
from noslip.law import fit
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Cycle
from noslip.law.law import Law
from noslip.rule import Rule
from noslip.runtime.engine import Compiled, Memory, Virtual
from noslip.runtime.rhythm import modulated, retimed
from noslip.runtime.rollout import initial_state, rollout, step
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of
from noslip.trajectory import PoseTrajectory

PERIOD = 2.0


def _figure_eight(samples: int = 200) -> PoseTrajectory:
    """A lemniscate that bobs, its tool turned into the path: no whole turns in a period."""
    times = np.linspace(0.0, PERIOD, samples + 1)
    angle = 2 * np.pi * times / PERIOD
    places = [0.1 * np.sin(angle), 0.05 * np.sin(2 * angle), 0.01 * np.cos(angle)]
    yaw = np.unwrap(np.arctan2(np.cos(2 * angle), np.cos(angle)))
    return PoseTrajectory(times, np.stack(places, 1), Rotation.from_euler("z", yaw), name="eight")


def _lap(turns: int = 1, samples: int = 200) -> PoseTrajectory:
    """Once round, and so many whole turns of the tool."""
    times = np.linspace(0.0, PERIOD, samples + 1)
    angle = 2 * np.pi * times / PERIOD
    places = np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), 0 * angle], axis=1)
    return PoseTrajectory(times, places, Rotation.from_euler("z", turns * angle), name="lap")


SHAPES = {"eight": _figure_eight(), "lap": _lap(), "two turns a lap": _lap(2)}


@pytest.fixture(scope="module", params=list(SHAPES))
def shape(request: pytest.FixtureRequest) -> tuple[PoseTrajectory, Law]:
    """A period, and the law that was fitted to it."""
    period = SHAPES[request.param]
    return period, fit(period, rhythmic=True)


# -------------------------------------------------------------------- clock and basis


@given(st.integers(1, 997), st.integers(1, 40))
def test_whole_steps_begin_each_period_at_exactly_0(steps: int, periods: int) -> None:
    clock, fraction = Cycle(), 0.0
    for _ in range(periods):
        for _ in range(steps):
            fraction = clock.later_fraction(fraction, 1 / steps)
            assert not clock.is_over(fraction)
        assert fraction == 0.0


@given(st.floats(0, 1, exclude_max=True), st.integers(1, 10_000))
def test_a_cycle_loses_no_more_digits_than_the_time_has(fraction: float, periods: int) -> None:
    apart = float(Cycle().at(fraction + periods)) - fraction
    assert min(abs(apart), 1 - abs(apart)) <= np.spacing(periods + 1.0)


@given(st.integers(3, 200), st.floats(0, 1))
def test_periodic_functions_are_von_mises_that_sum_to_1(count: int, at: float) -> None:
    basis = Basis(count, Cycle())
    found = basis.activations(basis.phase.at(np.array([at, at + 1])))
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)
    # SciPy's density of the same concentration, normalized over the functions.
    kappa = (count / (2 * np.pi)) ** 2
    angles = 2 * np.pi * (at - np.arange(count) / count)
    log_density = scipy.stats.vonmises.logpdf(angles, kappa)
    expected = np.exp(log_density - scipy.special.logsumexp(log_density))
    np.testing.assert_allclose(found[0], expected, atol=1e-9)


# -------------------------------------------------------------------- laws


def test_a_law_reproduces_its_period(shape: tuple[PoseTrajectory, Law]) -> None:
    period, law = shape
    motion = rollout(law, Rule(), cycles=2)
    again = period.resampled(times=np.linspace(0.0, PERIOD, law.steps + 1))
    apart = law.space.difference(motion.points[law.steps :], again.points)
    assert np.abs(apart[:, :3]).max() < 1e-6 * period.path_length
    assert np.abs(apart[:, 3:]).max() < 2e-5
    assert motion.duration == 2 * PERIOD


def test_a_law_repeats_to_rounding(shape: tuple[PoseTrajectory, Law]) -> None:
    _, law = shape
    points = rollout(law, Rule(), cycles=12).points[:: law.steps]
    moved = np.abs(law.space.difference(points[6:], points[5:-1]))
    assert moved.max() <= 1e-13


def test_targets_are_those_of_the_exact_periodic_solution() -> None:
    """A force of one harmonic: the equation's own steady state, in closed form."""
    attractor, omega = Attractor(), 2 * np.pi
    times = np.linspace(0.0, 1.0, 801)
    swing = np.stack([np.cos(omega * times), np.sin(omega * times), 0 * times], axis=1)
    period = PoseTrajectory(times, swing, Rotation.identity(len(times)))
    law = fit(period, rhythmic=True)
    # (alpha beta - w^2 + i alpha w) x = f for x = exp(i w t).
    response = attractor.stiffness - omega**2 + 1j * attractor.alpha * omega
    expected = response * np.exp(1j * omega * times[:-1])
    found = law.forcing(law.clock.at(times[:-1]))[:, :2]
    scale = abs(response)
    np.testing.assert_allclose(found[:, 0], expected.real, atol=2e-4 * scale)
    np.testing.assert_allclose(found[:, 1], expected.imag, atol=2e-4 * scale)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.3, 3), st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_amplitude_and_baseline_map_positions(amplitude: float, center: list[float]) -> None:
    law = _EIGHT
    usual = rollout(law, Rule())
    other = rollout(law, Rule(), amplitude=amplitude, goal_position=center)
    swing = amplitude * (usual.positions - law.goal_position)
    np.testing.assert_allclose(other.positions, center + swing, atol=1e-12)


_EIGHT = fit(_figure_eight(), rhythmic=True)
_COARSE = fit(_figure_eight(), rhythmic=True, basis_functions=30)


def test_a_baseline_turned_turns_all_in_the_tools_frame() -> None:
    turn = Rotation.from_euler("x", 30, degrees=True)
    usual = rollout(_EIGHT, Rule())
    other = rollout(_EIGHT, Rule(), goal_rotation=_EIGHT.goal_rotation * turn)
    apart = (other.rotations.inv() * usual.rotations * turn).magnitude()
    assert apart.max() < 1e-9


def test_several_periods_are_learned_as_their_mean() -> None:
    whole = _figure_eight()
    apart = [replace(whole, positions=whole.positions + [x, 0, 0]) for x in (-0.01, 0.01)]
    law = fit(apart, rhythmic=True)
    one, several = rollout(_EIGHT, Rule()), rollout(law, Rule())
    np.testing.assert_allclose(several.positions, one.positions, atol=1e-9)
    assert (several.rotations * one.rotations.inv()).magnitude().max() < 1e-9


def test_an_open_period_is_refused_with_a_number() -> None:
    with pytest.raises(InputError, match=r"ends 0\.\d+ m and .* degrees from where it begins"):
        ns.learn(_figure_eight()[:-40], rhythmic=True)


def test_what_runs_once_goes_round_no_more_than_once() -> None:
    law = fit(_figure_eight()[:100])
    with pytest.raises(InputError, match="rhythmic=True"):
        rollout(law, Rule(), cycles=2)
    with pytest.raises(InputError, match="rhythmic=True"):
        rollout(law, Rule(), amplitude=2.0)


# -------------------------------------------------------------------- at run time


def _periods(law: Law, count: int) -> State:
    state = initial_state(law, Rule())
    for _ in range(count * law.steps):
        state = step(law, Rule(), state, law.duration / law.steps)
    return state


def test_steps_are_the_rollout() -> None:
    law = fit(_lap(), rhythmic=True, basis_functions=20)
    law = replace(law, steps=60)
    state, motion = _periods(law, 2), rollout(law, Rule(), cycles=2)
    np.testing.assert_allclose(state.vector()[:7], motion.points[-1], atol=1e-12)
    assert state.phase == 0.0 and not state.done


def test_c_and_the_virtual_machine_step_alike(
    compiling: None, shape: tuple[PoseTrajectory, Law]
) -> None:
    _, law = shape
    begun = initial_state(law, Rule(), amplitude=1.2, goal_position=[0.1, 0.2, 0.3])
    motion = rollout(law, Rule(), amplitude=1.2, goal_position=[0.1, 0.2, 0.3], cycles=2)
    h = law.duration / law.steps
    library = stepper_of(Rule()).native.wait()
    makers = [lambda memory: Virtual(law, Rule(), memory, h)]
    if library is not None:
        makers.append(lambda memory: Compiled(law, Rule(), memory, library))
    for make in makers:
        memory = Memory(law.clock, Rule().system)
        memory.set(begun)
        stepped = make(memory)
        for _ in range(2 * law.steps):
            stepped.step(h)
        apart = law.space.difference(memory.state().vector()[:7], motion.points[-1])
        assert np.abs(apart).max() < 1e-12


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_another_frequency_is_the_same_path_without_a_jump(factor: float) -> None:
    law, state, h = _COARSE, initial_state(_COARSE, Rule()), 0.01
    twists, points = [], [state.vector()[:7]]
    for k in range(300):
        if k > 60:
            state = modulated(law, state, h, within=1.0, period=PERIOD / factor)
        state = step(law, Rule(), state, h)
        twists.append(np.concatenate([state.linear_velocity, state.angular_velocity]))
        points.append(state.vector()[:7])
    assert state.duration == pytest.approx(PERIOD / factor, rel=0.01)
    # The steps' own accelerations bound how much twist changes; a jump would be of its size.
    found = np.array(twists)
    assert np.abs(np.diff(found, axis=0)).max() < 0.25 * np.abs(found).max()
    # All along the same curve.
    usual = rollout(law, Rule(), time_step=PERIOD / 8000)
    away, _ = scipy.spatial.cKDTree(usual.positions).query(np.array(points)[:, :3])
    assert away.max() < 2e-3 * usual.path_length


@given(st.floats(0.3, 3))
def test_a_state_retimed_travels_in_the_same_direction(factor: float) -> None:
    state = initial_state(_EIGHT, Rule())
    faster = retimed(state, PERIOD / factor)
    np.testing.assert_allclose(faster.linear_velocity, factor * state.linear_velocity, atol=1e-15)
    np.testing.assert_allclose(faster.angular_velocity, factor * state.angular_velocity, atol=1e-14)


def test_amplitude_and_baseline_are_led_smoothly() -> None:
    state, h = initial_state(_COARSE, Rule()), PERIOD / 100
    center = _COARSE.goal_position + [0.0, 0.05, 0.0]
    velocities = []
    for _ in range(400):
        state = modulated(_COARSE, state, h, within=1.0, amplitude=0.5, baseline=center)
        state = step(_COARSE, Rule(), state, h)
        velocities.append(state.linear_velocity)
    expected = rollout(_COARSE, Rule(), time_step=h, amplitude=0.5, goal_position=center).positions[
        0
    ]
    np.testing.assert_allclose(state.position, expected, atol=1e-3)
    jumps = np.abs(np.diff(velocities, axis=0)).max()
    assert jumps < 0.1 * np.abs(velocities).max()


# -------------------------------------------------------------------- learned under constraints


@pytest.fixture(scope="module")
def wheel() -> ns.ConstrainedDMP:
    """A wheel on a lap, recorded with some play."""
    lap, angle = _lap(), 2 * np.pi * np.linspace(0, 1, 201)
    play = 0.002 * np.stack([np.cos(3 * angle), np.sin(2 * angle), 0 * angle], axis=1)
    forwards = Rotation.from_euler("z", 90, degrees=True)
    worn = replace(lap, positions=lap.positions + play, rotations=lap.rotations * forwards)
    return ns.learn(worn, [ns.Wheel()], rhythmic=True)


def test_a_wheel_laps_without_slip_or_drift(wheel: ns.ConstrainedDMP) -> None:
    motion = wheel.rollout(cycles=10)
    laps = motion.points[:: wheel.steps]
    assert np.abs(wheel.law.space.difference(laps[1:], laps[:-1])).max() < 1e-10
    assert np.abs(motion.constraint_residuals).max() < 1e-10
    assert ns.check(motion, [ns.Wheel()]).satisfied
    assert motion.end_error < 1e-10


@pytest.fixture(scope="module")
def saw() -> ns.ConstrainedDMP:
    """A blade to and fro, held by a hand that wavers: nothing but a turn leads it aside."""
    times = np.linspace(0.0, PERIOD, 201)
    angle = np.pi * times
    places = [0.06 * np.cos(angle), 0.001 * np.sin(2 * angle + 1), 0.003 * np.sin(angle)]
    turns = np.column_stack([0.02 * np.cos(3 * angle), 0.05 * np.sin(angle), 0.01 * np.cos(angle)])
    cut = PoseTrajectory(times, np.stack(places, 1), Rotation.from_euler("zyx", turns), name="saw")
    return ns.learn(cut, [ns.Blade()], rhythmic=True)


def test_a_saw_that_was_pushed_aside_comes_back_to_its_cycle(saw: ns.ConstrainedDMP) -> None:
    aside = saw.start_position + 0.005 * saw.start_rotation.as_matrix()[:, 1]
    motion, own = saw.rollout(cycles=4, start_position=aside), saw.rollout()
    away = np.linalg.norm(motion.positions[:: saw.steps] - own.positions[0], axis=1)
    assert away[0] == pytest.approx(0.005)
    assert away[2] < 1e-6
    assert np.abs(motion.constraint_residuals).max() < 1e-10


def test_what_ends_within_a_period_ends_where_its_law_does(saw: ns.ConstrainedDMP) -> None:
    motion, own = saw.rollout(cycles=1.5), saw.rollout(cycles=2)
    there = own.positions[len(motion) - 1]
    np.testing.assert_allclose(motion.positions[-1], there, atol=1e-12)
    assert motion.end_error < 1e-5 * motion.path_length < np.linalg.norm(there - own.positions[0])


@pytest.mark.parametrize("share", [1, 0.63])
def test_a_saw_does_not_drift_at_any_step(saw: ns.ConstrainedDMP, share: float) -> None:
    steps = round(saw.steps / share)
    motion = saw.rollout(cycles=12, time_step=saw.duration / steps)
    periods = motion.points[::steps]
    # At its own step it begins on its cycle, at another it comes to one in a few periods.
    first = 0 if share == 1 else 8
    moved = saw.law.space.difference(periods[first:], np.tile(periods[-1], (13 - first, 1)))
    assert np.abs(moved).max() < 1e-13


def test_a_rhythm_survives_its_file(wheel: ns.ConstrainedDMP, tmp_path: object) -> None:
    again = ns.load_primitive(wheel.save(f"{tmp_path}/wheel.json"))
    assert again == wheel
    np.testing.assert_array_equal(again.rollout(cycles=2).points, wheel.rollout(cycles=2).points)


def _straight(rule: ns.Constraint, state: State, *, ends: bool) -> ns.ConstrainedDMP:
    """A cut of 10 cm that ends in a state's pose, or begins in it, at rest."""
    held = Rotation.from_quat(state.quaternion, scalar_first=True)
    ahead = held.as_matrix()[:, 0] * np.sign(state.linear_velocity @ held.as_matrix()[:, 0])
    s = np.linspace(0, 1, 81)
    u = s**3 * (10 - 15 * s + 6 * s**2) - ends
    path = state.position + 0.1 * u[:, None] * ahead
    return ns.learn(PoseTrajectory(1.5 * s, path, Rotation.concatenate([held] * 81)), [rule])


def _twist(state: State) -> np.ndarray:
    return np.concatenate([state.linear_velocity, state.angular_velocity])


@pytest.fixture(scope="module")
def joined_run(
    saw: ns.ConstrainedDMP,
) -> tuple[list[State], tuple[int, int], ns.ConstrainedDMP, float]:
    """A cut that goes over into sawing, and out of it to a goal: states, and where it goes over."""
    h = 0.004
    entering = _straight(ns.Blade(), saw.initial_state(), ends=True).adapt(goal=saw.initial_state())
    state = entering.initial_state()
    states = [state]
    while not state.done:
        states.append(state := entering.step(state, h))
    into = len(states)
    state = saw.initial_state(start=state)
    for _ in range(round(1.3 * saw.duration / h)):
        states.append(state := saw.step(state, h))
    out = len(states)
    leaving = _straight(ns.Blade(), state, ends=False).adapt(start=state)
    state = leaving.initial_state()
    while not state.done:
        states.append(state := leaving.step(state, h))
    return states, (into, out), leaving, h


def test_a_motion_goes_over_into_a_rhythm_and_out_of_it_without_a_jump(
    saw: ns.ConstrainedDMP,
    joined_run: tuple[list[State], tuple[int, int], ns.ConstrainedDMP, float],
) -> None:
    states, seams, _, _ = joined_run
    changes = np.abs(np.diff([_twist(state) for state in states], axis=0))
    for seam in seams:
        # No more than accelerations change in a step on both sides of it.
        beside = changes[[*range(seam - 6, seam - 2), *range(seam + 1, seam + 5)]]
        for part in (slice(3), slice(3, 6)):
            allowed = np.linalg.norm(beside[:, part], axis=1).max()
            assert np.linalg.norm(changes[seam - 1, part]) <= 1.05 * allowed
    assert np.linalg.norm(states[seams[0]].position - saw.start_position) < 1e-3


def test_entering_and_leaving_keep_the_constraint_and_come_to_rest_at_the_goal(
    joined_run: tuple[list[State], tuple[int, int], ns.ConstrainedDMP, float],
) -> None:
    states, (_, out), leaving, h = joined_run
    poses = np.array([state.vector()[:7] for state in states])
    turned = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    moved = PoseTrajectory(h * np.arange(len(poses)), poses[:, :3], turned)
    assert np.abs(step_residuals(moved, ns.Blade())).max() < 1e-10
    last = states[-1]
    assert np.linalg.norm(last.position - leaving.goal_position) < 1e-4 * 0.1
    assert np.linalg.norm(last.linear_velocity) < 1e-3
    # Times go on: rules that depend on them do.
    assert leaving.law.begin == pytest.approx(states[out - 1].time)
    assert states[-1].time == pytest.approx(states[out - 1].time + leaving.duration)


def test_a_state_is_no_goal_of_a_rollout_and_has_one_velocity(saw: ns.ConstrainedDMP) -> None:
    state = saw.initial_state()
    cut = _straight(ns.Blade(), state, ends=True)
    with pytest.raises(InputError, match="adapt"):
        cut.rollout(goal=state)
    with pytest.raises(InputError, match="goal_velocity is given twice"):
        cut.adapt(goal=state, goal_velocity=0)
    with pytest.raises(InputError, match="start is given twice"):
        cut.adapt(start=state, start_position=[0, 0, 0])
    with pytest.raises(InputError, match="another baseline"):
        saw.adapt(goal=state)
    vectors = ns.learn(ns.Trajectory([0, 1, 2], [[0, 0], [1, 1], [2, 0]], names=["x", "y"]))
    with pytest.raises(InputError, match="another kind of motion"):
        vectors.rollout(start=state)


def test_a_rhythm_is_led_to_another_baseline_under_its_rule(wheel: ns.ConstrainedDMP) -> None:
    turn = Rotation.from_euler("z", 40, degrees=True)
    moved = np.array([0.2, -0.1, 0.05])
    there = wheel.adapt(
        goal_position=wheel.goal_position + moved, goal_rotation=turn * wheel.goal_rotation
    )
    motion, own = there.rollout(cycles=2), wheel.rollout(cycles=2)
    assert np.abs(motion.constraint_residuals).max() < 1e-10
    assert motion.end_error < 1e-10
    expected = wheel.goal_position + moved + turn.apply(own.positions - wheel.goal_position)
    # The rule asks the same of it there: a rigid motion changes nothing.
    np.testing.assert_allclose(motion.positions, expected, rtol=0, atol=2e-4 * own.path_length)
    with pytest.raises(InputError, match="another baseline"):
        wheel.adapt(start_position=[0, 0, 0])
