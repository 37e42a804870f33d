"""Pose primitives: what they learn, and the motion they make of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from motions import cut, numerical_example
from noslip import ConstrainedDMP, PoseTrajectory, State, learn
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law.fitting import fit
from noslip.runtime.motion import Motion
from refusals import refusal
from strategies import seeds

pytestmark = pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
"""A law knows no units."""


@dataclass(frozen=True)
class Smooth:
    """A random smooth motion in closed form over a fraction of its duration from 0 to 1."""

    seed: int
    turning: float = 0.7

    def _curve(self, fractions: Floats, rng: np.random.Generator) -> Floats:
        curve = np.outer(fractions, rng.normal(size=3))
        for k in (1, 2, 3):
            wave = np.pi * k * fractions
            curve += np.outer(np.sin(wave), rng.normal(size=3)) / k**2
            curve += np.outer(np.cos(wave), rng.normal(size=3)) / k**2
        return curve

    def positions(self, fractions: Floats) -> Floats:
        return self._curve(np.asarray(fractions), np.random.default_rng(self.seed))

    def rotations(self, fractions: Floats) -> Rotation:
        turns = self._curve(np.asarray(fractions), np.random.default_rng(self.seed + 1))
        return Rotation.from_rotvec(self.turning * turns) * Rotation.random(
            random_state=self.seed % 2**32
        )

    def sampled(
        self, count: int = 501, *, duration: float = 2.0, start: float = 0.0
    ) -> PoseTrajectory:
        return self.at(np.linspace(0, 1, count), duration=duration, start=start)

    def at(self, fractions: Floats, *, duration: float = 2.0, start: float = 0.0) -> PoseTrajectory:
        return PoseTrajectory(
            times=start + duration * fractions,
            positions=self.positions(fractions),
            rotations=self.rotations(fractions),
            name=f"smooth {self.seed}",
        )

    def distance(
        self, motion: PoseTrajectory, duration: float | None = None
    ) -> tuple[float, float]:
        """Return the largest deviations: in paths' lengths, and in radians.

        What lies beyond the duration has nothing to be compared with.
        """
        fractions = motion.times / (duration or motion.times[-1])
        within = fractions <= 1.0
        off = motion.positions[within] - self.positions(fractions[within])
        turned = motion.rotations[within] * self.rotations(fractions[within]).inv()
        length = self.sampled().path_length
        return np.linalg.norm(off, axis=1).max() / length, turned.magnitude().max()


def differ(a: PoseTrajectory, b: PoseTrajectory) -> float:
    """Largest difference of two motions' poses (m and rad)."""
    off = np.abs(a.positions - b.positions).max()
    return max(off, (a.rotations * b.rotations.inv()).magnitude().max())


def stepped(dmp: ConstrainedDMP, state: State, steps: list[float]) -> list[State]:
    states = [state]
    for step in steps:
        states.append(dmp.step(states[-1], step))
    return states


# -------------------------------------------------------------------- imitation


@given(seeds)
def test_a_rollout_tracks_its_demonstration(seed: int) -> None:
    smooth = Smooth(seed)
    off, turned = smooth.distance(learn(smooth.sampled()).rollout())
    assert off < 2e-5
    assert turned < 2e-4


@given(seeds, st.sampled_from([0.5, 1.0, 3.0]), st.sampled_from([(10.0, 2.0), (40.0, 10.0)]))
@settings(max_examples=20)
def test_other_constants_track_too(
    seed: int, alpha_s: float, attractor: tuple[float, float]
) -> None:
    smooth = Smooth(seed)
    alpha, beta = attractor
    dmp = learn(smooth.sampled(), alpha_s=alpha_s, alpha=alpha, beta=beta)
    off, turned = smooth.distance(dmp.rollout())
    assert off < 2e-3
    assert turned < 1e-2


@pytest.mark.parametrize(("rate", "bound"), [(10, 2e-4), (28.6, 1e-4), (120, 1e-4), (1e4, 1e-5)])
def test_sampling_from_10_hz_to_10_khz_makes_no_difference(rate: float, bound: float) -> None:
    for seed in (1, 2):
        smooth = Smooth(seed)
        count = round(2 * rate) + 1
        dmp = learn(smooth.sampled(count, duration=(count - 1) / rate))
        off, turned = smooth.distance(dmp.rollout())
        assert off < bound
        assert turned < 30 * bound


@given(seeds)
@settings(max_examples=20)
def test_irregular_samples_make_no_difference(seed: int) -> None:
    smooth = Smooth(seed)
    gaps = np.random.default_rng(seed).uniform(0.3, 1.7, 300)
    fractions = np.concatenate([[0.0], np.cumsum(gaps)]) / gaps.sum()
    off, turned = smooth.distance(learn(smooth.at(fractions)).rollout())
    assert off < 1e-4
    assert turned < 3e-3


@given(seeds, st.sampled_from([-37.25, 12.5, 4000.0]))
@settings(max_examples=20)
def test_the_time_of_the_first_sample_makes_no_difference(seed: int, start: float) -> None:
    smooth = Smooth(seed)
    here = learn(smooth.sampled()).rollout()
    there = learn(smooth.sampled(start=start)).rollout()
    np.testing.assert_allclose(there.times, here.times, rtol=0, atol=1e-11)
    assert differ(here, there) < 1e-9


def test_stamps_since_1970_make_next_to_no_difference() -> None:
    # Such stamps are rounded to 0.2 us, which is 1e-4 of a step here.
    smooth = Smooth(5)
    here = learn(smooth.sampled()).rollout()
    there = learn(smooth.sampled(start=1.7e9)).rollout()
    assert there.times[0] == 0.0
    assert differ(here, there) < 1e-3


@given(seeds)
@settings(max_examples=20)
def test_signs_of_quaternions_make_no_difference(seed: int) -> None:
    demonstration = Smooth(seed).sampled()
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(demonstration))
    flipped = replace(
        demonstration,
        rotations=Rotation.from_quat(demonstration.rotations.as_quat() * signs[:, None]),
        angular_velocities=None,
    )
    assert differ(learn(demonstration).rollout(), learn(flipped).rollout()) < 1e-10


@given(seeds)
@settings(max_examples=20)
def test_turning_and_shifting_the_world_turns_and_shifts_the_motion(seed: int) -> None:
    demonstration = Smooth(seed).sampled()
    world = Rotation.random(random_state=seed % 2**32)
    shift = np.array([3.0, -1.0, 0.5])
    moved = PoseTrajectory(
        times=demonstration.times,
        positions=world.apply(demonstration.positions) + shift,
        rotations=world * demonstration.rotations,
    )
    here, there = learn(demonstration).rollout(), learn(moved).rollout()
    np.testing.assert_allclose(
        there.positions, world.apply(here.positions) + shift, rtol=0, atol=1e-9
    )
    assert (there.rotations * (world * here.rotations).inv()).magnitude().max() < 1e-8


def test_a_primitive_starts_with_the_demonstrated_pose_and_velocity() -> None:
    demonstration = Smooth(3).sampled()
    state = learn(demonstration).initial_state()
    np.testing.assert_allclose(state.position, demonstration.positions[0], rtol=0, atol=1e-15)
    assert (state.rotation * demonstration.rotations[0].inv()).magnitude() < 1e-15
    np.testing.assert_allclose(state.linear_velocity, demonstration.linear_velocities[0], rtol=1e-3)
    np.testing.assert_allclose(
        state.angular_velocity, demonstration.angular_velocities[0], rtol=1e-2, atol=1e-3
    )


# -------------------------------------------------------------------- the paper's equations


def equation_3(dmp: ConstrainedDMP, weights: Floats, s: float) -> Floats:
    basis = dmp.law.basis
    psi = np.exp(-0.5 * ((s - basis.centers) / basis.widths) ** 2)
    return np.asarray(psi @ weights * s / psi.sum())


def integrated(
    dmp: ConstrainedDMP, tau: float, times: Floats, *, goal: Floats, turned_goal: Rotation
) -> tuple[Floats, Rotation]:
    """Solve the paper's equations, with tau squared, by an adaptive method of eighth order."""
    alpha, beta = dmp.law.attractor.alpha, dmp.law.attractor.beta
    winding = dmp.law.goal.winding

    def rates(t: float, y: Floats) -> Floats:
        s = np.exp(-dmp.law.clock.alpha_s * t / tau)
        p, q, v, w = y[:3], y[3:7], y[7:10], y[10:]
        leading = winding.at([t / tau], turned_goal)[0]
        error = (leading * Rotation.from_quat(q, scalar_first=True).inv()).as_rotvec()
        f_p = equation_3(dmp, dmp.law.forcing.weights[:, :3], s)
        f_q = equation_3(dmp, dmp.law.forcing.weights[:, 3:], s)
        spin = 0.5 * np.array([-w @ q[1:], *(q[0] * w + np.cross(w, q[1:]))])
        return np.concatenate(
            [
                v,
                spin,
                (alpha * (beta * (goal - p) - tau * v) + f_p) / tau**2,
                (alpha * (beta * error - tau * w) + f_q) / tau**2,
            ]
        )

    begin = np.concatenate(
        [
            dmp.law.start,
            dmp.law.start_velocity / tau,
        ]
    )
    solution = solve_ivp(
        rates, (0, tau), begin, method="DOP853", rtol=1e-10, atol=1e-11, t_eval=times
    )
    assert solution.success
    return solution.y[:3].T, Rotation.from_quat(solution.y[3:7].T, scalar_first=True)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "tau"), [(0, 1.0), (1, 0.05), (2, 30.0)])
def test_rollouts_converge_to_the_papers_equations_with_the_square_of_the_step(
    seed: int, tau: float
) -> None:
    dmp = learn(Smooth(seed).sampled())
    goal = dmp.goal_position + np.array([0.3, -0.2, 0.1])
    turned_goal = Rotation.from_rotvec([0.2, 0.3, -0.1]) * dmp.goal_rotation
    times = np.linspace(0, tau, 11)
    positions, rotations = integrated(dmp, tau, times, goal=goal, turned_goal=turned_goal)
    errors = []
    for steps in (100, 200, 400, 800):
        motion = dmp.rollout(
            duration=tau,
            time_step=tau / steps,
            goal_position=goal,
            goal_rotation=turned_goal,
            goal_form="paper",
        )[:: steps // 10]
        errors.append(
            (
                np.abs(motion.positions - positions).max(),
                (motion.rotations * rotations.inv()).magnitude().max(),
            )
        )
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(ratios > 3.6), errors
    assert errors[-1][0] < 1e-4
    assert errors[-1][1] < 1e-3


# -------------------------------------------------------------------- goals and starts


CRITICAL_POLE = 12.5
"""Double pole of the default attractor, per duration."""
NOT_YET_ARRIVED = (1 + CRITICAL_POLE) * np.exp(-CRITICAL_POLE)
"""Share of a new goal's distance that a critically damped attractor still has to go: 5e-5."""


@given(seeds)
def test_a_new_goal_adds_the_attractors_own_response_and_nothing_else(seed: int) -> None:
    dmp = learn(Smooth(seed).sampled())
    shift = np.random.default_rng(seed).normal(size=3)
    here = dmp.rollout()
    there = dmp.rollout(goal_position=dmp.goal_position + shift, goal_form="paper")
    x = CRITICAL_POLE * here.times / here.times[-1]
    response = 1 - (1 + x) * np.exp(-x)
    np.testing.assert_allclose(
        there.positions - here.positions, np.outer(response, shift), rtol=0, atol=2e-4
    )
    off = there.positions[-1] - here.positions[-1] - shift
    assert np.linalg.norm(off) <= 1.02 * NOT_YET_ARRIVED * np.linalg.norm(shift)


@given(seeds, st.floats(0.05, 600))
def test_new_goal_positions_are_reached_at_the_end(seed: int, duration: float) -> None:
    smooth = Smooth(seed)
    dmp = learn(smooth.sampled())
    shift = np.random.default_rng(seed).normal(size=3)
    motion = dmp.rollout(goal_position=dmp.goal_position + shift, duration=duration)
    off = np.linalg.norm(motion.positions[-1] - dmp.goal_position - shift)
    length = smooth.sampled().path_length
    assert off <= 2 * NOT_YET_ARRIVED * np.linalg.norm(shift) + 2e-5 * length


def off_the_goal(demonstration: PoseTrajectory, turn: Rotation) -> float:
    """Angle between a turned goal and the end of the motion to it."""
    dmp = learn(demonstration)
    goal = turn * dmp.goal_rotation
    return float((dmp.rollout(goal_rotation=goal).rotations[-1] * goal.inv()).magnitude())


@given(seeds, st.floats(0, 1))
def test_new_goal_rotations_are_reached_at_the_end(seed: int, angle: float) -> None:
    # Turning little enough for a fixed goal; the tool need not be at rest at the end.
    axis = np.random.default_rng(seed).normal(size=3)
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    assert off_the_goal(Smooth(seed, turning=0.2).sampled(), turn) <= 8e-3


# The error E = W R^T obeys dE/dt = [w_W] E - E [w]: it is the same for W X and R X, not for X W.
@pytest.mark.parametrize("turns", [0.6, 1.5])
def test_new_goal_rotations_are_reached_after_many_turns(turns: float) -> None:
    for moving in (False, True):
        demonstration = winding_motion(turns, moving)
        assert off_the_goal(demonstration, Rotation.from_rotvec([0, 0.5, 0])) <= 1e-2


@pytest.mark.parametrize("turns", [0.2, pytest.param(1.5)])
def test_turning_start_and_goal_in_the_tools_frame_turns_the_whole_motion(turns: float) -> None:
    # Angular velocities and forces are in the world frame, so they are the same for R and R X.
    dmp = learn(winding_motion(turns, moving=True))
    turn = Rotation.from_rotvec([0.4, -0.2, 0.3])
    here = dmp.rollout()
    there = dmp.rollout(
        start_rotation=dmp.start_rotation * turn, goal_rotation=dmp.goal_rotation * turn
    )
    assert (there.rotations * (here.rotations * turn).inv()).magnitude().max() < 1e-9


@given(seeds)
@settings(max_examples=20)
def test_a_new_start_dies_out_before_the_end(seed: int) -> None:
    dmp = learn(Smooth(seed).sampled())
    rng = np.random.default_rng(seed)
    shift, turn = rng.normal(size=3), Rotation.from_rotvec(0.3 * rng.normal(size=3))
    here = dmp.rollout()
    there = dmp.rollout(
        start_position=dmp.start_position + shift, start_rotation=turn * dmp.start_rotation
    )
    np.testing.assert_allclose(there.positions[0], dmp.start_position + shift, rtol=1e-15)
    assert (there.rotations[0] * (turn * dmp.start_rotation).inv()).magnitude() < 1e-15
    off = np.linalg.norm(there.positions[-1] - here.positions[-1])
    assert off <= 1.02 * NOT_YET_ARRIVED * np.linalg.norm(shift)
    # SO(3) is curved: where the motion winds, what is left decays along a turned path.
    assert (there.rotations[-1] * here.rotations[-1].inv()).magnitude() < 0.1 * turn.magnitude()


def test_a_goal_equal_to_the_start_is_like_any_other() -> None:
    # A closed path: the classic goal scaling g - x0 would divide by zero or flatten it.
    fractions = np.linspace(0, 1, 401)
    loop = 2 * np.pi * fractions**2 * (3 - 2 * fractions)
    zero = np.zeros_like(loop)
    demonstration = PoseTrajectory(
        times=fractions,
        positions=np.column_stack([np.sin(loop), 1 - np.cos(loop), zero]),
        rotations=Rotation.from_rotvec(np.column_stack([zero, zero, 0.4 * np.sin(loop)])),
    )
    dmp = learn(demonstration)
    motion = dmp.rollout()
    length = demonstration.path_length
    expected = demonstration.resampled(times=motion.times)
    np.testing.assert_allclose(motion.positions, expected.positions, rtol=0, atol=2e-5 * length)
    again = dmp.rollout(goal_position=motion.positions[0])
    assert differ(motion, again) < 1e-4


def test_an_open_path_is_led_back_to_its_own_start() -> None:
    dmp = learn(Smooth(8).sampled())
    distance = np.linalg.norm(dmp.goal_position - dmp.start_position)
    motion = dmp.rollout(goal_position=dmp.start_position)
    off = np.linalg.norm(motion.positions[-1] - dmp.start_position)
    assert off < 1e-4 * (1 + distance)
    assert motion.path_length > distance


def test_a_tool_at_rest_stays_at_rest() -> None:
    still = PoseTrajectory(
        times=np.arange(50) / 25,
        positions=np.tile([0.4, -0.2, 1.0], (50, 1)),
        rotations=Rotation.from_rotvec(np.tile([0.3, 0.2, -0.1], (50, 1))),
    )
    motion = ConstrainedDMP(fit(still)).rollout()
    np.testing.assert_allclose(motion.positions, [[0.4, -0.2, 1.0]] * len(motion), atol=1e-14)
    assert (motion.rotations * still.rotations[0].inv()).magnitude().max() < 1e-13
    assert np.abs(motion.linear_velocities).max() < 1e-12
    assert np.abs(motion.angular_velocities).max() < 1e-12


# -------------------------------------------------------------------- durations and steps


@given(seeds, st.floats(0.05, 600))
def test_another_duration_keeps_the_shape_and_scales_the_speed(seed: int, duration: float) -> None:
    dmp = learn(Smooth(seed).sampled())
    here, there = dmp.rollout(), dmp.rollout(duration=duration)
    assert len(there) == len(here)
    assert there.times[-1] == pytest.approx(duration, rel=1e-14)
    assert differ(here, there) < 1e-11
    scale = here.times[-1] / duration
    for name in ("linear_velocities", "angular_velocities"):
        expected = getattr(here, name) * scale
        np.testing.assert_allclose(
            getattr(there, name), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )


@given(seeds, st.floats(0.05, 600), st.floats(100, 1500))
def test_an_explicit_step_keeps_the_shape(seed: int, duration: float, steps: float) -> None:
    smooth = Smooth(seed)
    motion = learn(smooth.sampled()).rollout(duration=duration, time_step=duration / steps)
    off, turned = smooth.distance(motion, duration)
    assert off < 1e-3
    # Turning about a moving axis costs more: the error falls with the square of the step.
    assert turned < 1e-2


@given(st.floats(0.05, 600), st.floats(1.0, 900))
def test_steps_are_as_long_as_asked_and_the_last_one_ends_the_motion(
    duration: float, steps: float
) -> None:
    dmp = learn(Smooth(1).sampled(101), basis_functions=10)
    time_step = duration / steps
    motion = dmp.rollout(duration=duration, time_step=time_step)
    before = np.arange(len(motion) - 1) * time_step
    np.testing.assert_allclose(motion.times[:-1], before, rtol=1e-15)
    assert motion.times[-1] == pytest.approx(duration, rel=1e-9)
    assert motion.times[-1] - motion.times[-2] <= time_step * (1 + 1e-9)


@pytest.mark.parametrize(
    ("count", "steps"), [(11, 200), (58, 228), (200, 398), (201, 200), (1000, 999)]
)
def test_a_rollout_has_the_demonstrations_own_samples_or_a_multiple(count: int, steps: int) -> None:
    dmp = learn(Smooth(2).sampled(count), basis_functions=10)
    assert len(dmp.rollout()) == steps + 1
    assert steps % (count - 1) == 0


def test_rollouts_start_at_zero_and_move_by_their_velocities() -> None:
    motion = learn(Smooth(6).sampled(start=100.0)).rollout()
    assert motion.times[0] == 0.0
    step = motion.times[1]
    np.testing.assert_allclose(
        motion.positions[1:],
        motion.positions[:-1] + step * motion.linear_velocities[1:],
        rtol=0,
        atol=1e-15,
    )
    turned = Rotation.from_rotvec(step * motion.angular_velocities[1:]) * motion.rotations[:-1]
    assert (motion.rotations[1:] * turned.inv()).magnitude().max() < 1e-14


@given(seeds, st.floats(0.05, 600), st.booleans())
@settings(max_examples=10)
def test_a_rollout_is_the_repeated_step(seed: int, duration: float, moved: bool) -> None:
    dmp = learn(Smooth(seed).sampled(301))
    asked: dict[str, Any] = {"duration": duration}
    if moved:
        asked |= {
            "goal_position": dmp.goal_position + np.array([0.2, 0.1, -0.3]),
            "goal_rotation": Rotation.from_rotvec([0.3, 0, 0.2]) * dmp.goal_rotation,
            "start_position": dmp.start_position + np.array([0.1, 0, 0]),
        }
    motion = dmp.rollout(**asked)
    states = stepped(dmp, dmp.initial_state(**asked), [duration / dmp.steps] * dmp.steps)
    for name, attribute in (
        ("times", "time"),
        ("positions", "position"),
        ("linear_velocities", "linear_velocity"),
        ("angular_velocities", "angular_velocity"),
    ):
        found = np.array([getattr(state, attribute) for state in states])
        expected = getattr(motion, name)
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=1e-12 * max(1, np.abs(expected).max())
        )
    turns = Rotation.concatenate([state.rotation for state in states])
    assert (turns * motion.rotations.inv()).magnitude().max() < 1e-12
    assert states[-1].phase == pytest.approx(np.exp(-dmp.law.clock.alpha_s), rel=1e-12)


def test_a_long_rollout_is_the_repeated_step() -> None:
    # Longer than the blocks in which activations are computed.
    dmp = learn(Smooth(4).sampled(101), basis_functions=20)
    motion = dmp.rollout(time_step=dmp.duration / 4500)
    states = stepped(dmp, dmp.initial_state(), [dmp.duration / 4500] * 4500)
    found = np.array([state.position for state in states])
    np.testing.assert_allclose(found, motion.positions, rtol=0, atol=1e-11)


@given(seeds)
@settings(max_examples=20)
def test_steps_of_changing_length_make_nearly_the_same_motion(seed: int) -> None:
    smooth = Smooth(seed)
    dmp = learn(smooth.sampled())
    gaps = np.random.default_rng(seed).uniform(0.4, 1.6, 500)
    states = stepped(dmp, dmp.initial_state(), list(dmp.duration * gaps / gaps.sum()))
    motion = PoseTrajectory(
        times=[state.time for state in states],
        positions=[state.position for state in states],
        rotations=Rotation.concatenate([state.rotation for state in states]),
    )
    off, turned = smooth.distance(motion)
    assert off < 1e-3
    assert turned < 5e-3


@pytest.mark.parametrize("steps", [75, 150, 300])
def test_a_shorter_last_step_is_as_right_as_one_like_the_others(steps: int) -> None:
    dmp = learn(cut(), basis_functions=40)
    exact = dmp.rollout(time_step=dmp.duration / 3000)

    def off(last: float) -> Floats:
        """Of the end, with a last step of a share of the others (m, rad)."""
        motion = dmp.rollout(time_step=dmp.duration / (steps - 1 + last))
        turned = (motion.rotations[-1] * exact.rotations[-1].inv()).magnitude()
        return np.array([np.linalg.norm(motion.positions[-1] - exact.positions[-1]), turned])

    for last in (0.1, 0.25, 0.5, 0.75, 0.9):
        assert np.all(off(last) <= 2 * off(1.0)), (last, off(last), off(1.0))


def test_a_state_is_not_changed_by_the_step_that_leaves_it() -> None:
    dmp = learn(Smooth(1).sampled(101), basis_functions=10)
    state = dmp.initial_state()
    before = state.vector().copy()
    assert dmp.step(state, 0.01) is not state
    np.testing.assert_array_equal(state.vector(), before)
    assert state.time == 0.0


# -------------------------------------------------------------------- several demonstrations


@given(seeds)
@settings(max_examples=20)
def test_demonstrations_of_one_rate_give_the_mean_of_their_own_motions(seed: int) -> None:
    # Of the same number of samples; goals and durations differ.
    demonstrations = [
        Smooth(seed + k).sampled(501, duration=1.0 + k, start=10.0 * k) for k in range(3)
    ]
    together = ConstrainedDMP(fit(demonstrations))
    assert together.duration == pytest.approx(2.0)
    alone = [learn(d).rollout(duration=2.0).positions for d in demonstrations]
    np.testing.assert_allclose(
        together.rollout().positions, np.mean(alone, axis=0), rtol=0, atol=1e-6
    )


@given(seeds, st.lists(st.integers(100, 900), min_size=2, max_size=4))
@settings(max_examples=20)
def test_the_motion_lies_between_those_of_all_demonstrations(seed: int, counts: list[int]) -> None:
    # Shares of one path that stay apart: every coordinate lies between 1 and 3 times the share.
    rng = np.random.default_rng(seed)
    curve = Smooth(seed).positions(np.linspace(0, 1, 901))
    low, high = curve.min(axis=0), curve.max(axis=0)

    def path(at: Floats) -> Floats:
        return np.asarray(1 + 2 * (Smooth(seed).positions(at) - low) / (high - low))

    shares = np.linspace(0.5, 1.5, len(counts))
    demonstrations = [
        replace(
            Smooth(seed).sampled(count, duration=rng.uniform(0.5, 5)),
            positions=share * path(np.linspace(0, 1, count)),
            linear_velocities=None,
        )
        for count, share in zip(counts, shares, strict=True)
    ]
    motion = learn(demonstrations).rollout()
    share = motion.positions / path(motion.times / motion.times[-1])
    assert np.all(share > 0.5)
    assert np.all(share < 1.5)


def turning_about_z(degrees: float, count: int = 301) -> PoseTrajectory:
    """From 0 to an angle, and the way along x, both with rest at the ends."""
    fractions = np.linspace(0, 1, count)
    eased = fractions**2 * (3 - 2 * fractions)
    zero = np.zeros(count)
    return PoseTrajectory(
        times=fractions,
        positions=np.column_stack([eased, zero, zero]),
        rotations=Rotation.from_rotvec(np.column_stack([zero, zero, np.radians(degrees) * eased])),
    )


def turned_so_far(motion: PoseTrajectory) -> Floats:
    """Angle about z since the start, unwrapped (degrees)."""
    steps = (motion.rotations[1:] * motion.rotations[:-1].inv()).as_rotvec()[:, 2]
    return np.degrees(np.concatenate([[0.0], np.cumsum(steps)]))


@pytest.mark.parametrize(
    "degrees", [(20, 80), (100, 134), (300, 340), (500, 560), (350, 370), (200, 120)]
)
def test_demonstrated_turns_are_averaged(degrees: tuple[float, float]) -> None:
    motion = learn([turning_about_z(angle) for angle in degrees]).rollout()
    eased = turning_about_z(np.mean(degrees), len(motion))
    np.testing.assert_allclose(turned_so_far(motion), turned_so_far(eased), rtol=0, atol=0.1)


# The first alone would do with a fixed goal, for which the second one's logarithm jumps.
@pytest.mark.parametrize("degrees", [(120, 200), (130, 185)])
def test_demonstrated_turns_are_averaged_in_any_order(degrees: tuple[float, float]) -> None:
    motion = learn([turning_about_z(angle) for angle in degrees]).rollout()
    eased = turning_about_z(np.mean(degrees), len(motion))
    np.testing.assert_allclose(turned_so_far(motion), turned_so_far(eased), rtol=0, atol=0.1)


# -------------------------------------------------------------------- turns of any size


def winding_motion(turns: float, moving: bool, count: int = 801) -> PoseTrajectory:
    fractions = np.linspace(0, 1, count)
    eased = fractions**2 * (3 - 2 * fractions)
    rotations = Rotation.from_rotvec(np.outer(2 * np.pi * turns * eased, [0.6, 0.0, 0.8]))
    if moving:
        sway = [0.4 * np.sin(7 * fractions), 0.5 * fractions, 0.3 * np.cos(5 * fractions)]
        roll = [fractions, 0.2 * fractions**2, -0.5 * fractions]
        rotations = (
            Rotation.from_rotvec(np.column_stack(sway))
            * rotations
            * Rotation.from_rotvec(np.column_stack(roll))
        )
    return PoseTrajectory(
        times=fractions,
        positions=np.column_stack([eased, fractions, -eased]),
        rotations=rotations,
    )


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("turns", [0.25, 0.5, 0.6, 1.0, 1.5, 7.0])
def test_any_number_of_turns_is_followed(turns: float, moving: bool) -> None:
    demonstration = winding_motion(turns, moving)
    motion = learn(demonstration).rollout()
    off = (motion.rotations * demonstration.rotations.inv()).magnitude()
    assert off.max() < 2e-4
    # Followed sample by sample, so that none of the turns is left out.
    _, speeds = demonstration.step_velocities()
    _, found = motion.step_velocities()
    np.testing.assert_allclose(found, speeds, rtol=0, atol=0.02 * np.abs(speeds).max())


@pytest.mark.parametrize("degrees", [134.9, 135.1, 179.9999, 180.0, 180.0001, 359.999, 360.0])
def test_turns_near_the_logarithms_jump_are_followed(degrees: float) -> None:
    demonstration = turning_about_z(degrees, 601)
    motion = learn(demonstration).rollout()
    np.testing.assert_allclose(
        turned_so_far(motion), turned_so_far(demonstration), rtol=0, atol=0.01
    )


@pytest.mark.parametrize("degrees", [45.0, 69.0, 110.0])
def test_turns_of_up_to_110_degrees_between_samples_are_followed(degrees: float) -> None:
    angles = np.radians(degrees) * np.arange(601)
    zero = np.zeros(601)
    demonstration = PoseTrajectory(
        times=np.arange(601) / 100,
        positions=np.zeros((601, 3)),
        rotations=Rotation.from_rotvec(np.column_stack([zero, zero, angles])),
    )
    motion = learn(demonstration).rollout()
    assert (motion.rotations * demonstration.rotations.inv()).magnitude().max() < 0.01


# -------------------------------------------------------------------- what is refused


@pytest.fixture(scope="module")
def fitted() -> ConstrainedDMP:
    return learn(Smooth(1).sampled(101), basis_functions=10)


def refused(call: Callable[..., object], *given: Any, **asked: Any) -> str:
    """Message of the InputError that a call raises; of readable length."""
    message = refusal(InputError, call, *given, **asked)
    assert len(message) < 300
    return message


@pytest.mark.parametrize("argument", ["goal_position", "start_position"])
@pytest.mark.parametrize(
    "value",
    [
        [1.0, 2.0],
        [[1.0, 2.0, 3.0]],
        3.0,
        [1.0, np.nan, 2.0],
        [np.inf, 0.0, 0.0],
        pytest.param("abc"),
        pytest.param([[1.0], [2.0, 3.0]]),
        pytest.param(np.zeros((100, 3)), id="many rows"),
    ],
)
def test_a_position_must_be_three_finite_numbers(
    fitted: ConstrainedDMP, argument: str, value: object
) -> None:
    assert argument in refused(fitted.rollout, **{argument: value})


@pytest.mark.parametrize("argument", ["goal_rotation", "start_rotation"])
@pytest.mark.parametrize(
    "value",
    [
        [1.0, 0.0, 0.0, 0.0],
        "identity",
        pytest.param(np.eye(3), id="matrix"),
        pytest.param(Rotation.identity(2), id="two rotations"),
    ],
)
def test_a_rotation_must_be_a_single_scipy_rotation(
    fitted: ConstrainedDMP, argument: str, value: object
) -> None:
    assert argument in refused(fitted.rollout, **{argument: value})


@pytest.mark.parametrize("argument", ["duration", "time_step"])
@pytest.mark.parametrize(
    "value", [0, -1.0, np.nan, np.inf, *(pytest.param(v) for v in ("abc", [1, 2]))]
)
def test_times_must_be_positive_numbers(
    fitted: ConstrainedDMP, argument: str, value: object
) -> None:
    assert argument in refused(fitted.rollout, **{argument: value})


@pytest.mark.parametrize("value", [0, -0.1, np.nan, np.inf])
def test_a_step_must_take_time(fitted: ConstrainedDMP, value: float) -> None:
    assert "time_step" in refused(fitted.step, fitted.initial_state(), value)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("basis_functions", 0),
        ("basis_functions", -3),
        pytest.param("basis_functions", 2.7),
        pytest.param("basis_functions", np.nan),
        ("ridge", -1e-9),
        ("ridge", np.nan),
        ("ridge", np.inf),
        ("alpha", 0),
        ("alpha", np.nan),
        ("beta", -6.25),
        ("beta", np.inf),
        ("alpha_s", 0),
        ("alpha_s", np.nan),
        *(pytest.param(name, "abc") for name in ("ridge", "alpha", "beta", "alpha_s")),
    ],
)
def test_constants_out_of_range_are_refused_by_name(argument: str, value: object) -> None:
    demonstration = Smooth(1).sampled(101)
    assert argument in refused(learn, demonstration, **{argument: value})


@pytest.mark.parametrize(
    ("demonstrations", "message"),
    [
        ([], "no demonstration given"),
        (iter(()), "no demonstration given"),
        ("cut.csv", "load_demonstrations"),
        ([np.zeros((10, 3))], "got ndarray"),
        pytest.param(None, "demonstrations"),
    ],
)
def test_demonstrations_must_be_trajectories(demonstrations: Any, message: str) -> None:
    assert message in refused(learn, demonstrations)


def test_generators_of_demonstrations_are_taken() -> None:
    paths = [Smooth(0).sampled(101) for _ in range(2)]
    listed, generated = (learn(d, basis_functions=10).rollout() for d in (paths, iter(paths)))
    np.testing.assert_array_equal(listed.positions, generated.positions)


def test_a_motion_introduces_itself_in_one_line(fitted: ConstrainedDMP) -> None:
    motion = fitted.rollout()
    assert isinstance(motion, Motion)
    assert "\n" not in repr(motion)


def test_a_measured_state_without_a_step_behind_it_goes_on_from_its_phase() -> None:
    dmp = learn(Smooth(4).sampled())
    motion = dmp.rollout()
    time_step, state = motion.times[1], dmp.initial_state()
    for _ in range(dmp.steps // 2):
        state = dmp.step(state, time_step)
    state = replace(state, previous_step=0.0)
    for _ in range(dmp.steps - dmp.steps // 2):
        state = dmp.step(state, time_step)
    off = np.linalg.norm(state.position - motion.positions[-1])
    assert off <= 1e-2 * motion.path_length


@pytest.mark.parametrize("make", [cut, numerical_example, Smooth(1).sampled])
def test_fifty_steps_keep_the_shape(make: Callable[[], PoseTrajectory]) -> None:
    dmp = learn(make())
    usual, hasty = dmp.rollout(), dmp.rollout(duration=0.05, time_step=0.001)
    assert len(hasty) == 51
    there = usual.resampled(times=hasty.times * usual.duration / hasty.duration)
    off = np.linalg.norm(hasty.positions - there.positions, axis=1).max()
    assert off <= 1e-4 * usual.path_length
