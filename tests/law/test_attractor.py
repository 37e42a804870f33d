"""The attractor's step has the poles of its differential equation, at any step size."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from noslip import ConstrainedDMP
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Phase
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from noslip.law.points import Goal
from noslip.law.winding import Winding
from refusals import refusal

OVERDAMPED, CRITICAL, UNDERDAMPED = (25.0, 2.0), (25.0, 6.25), (25.0, 60.0)
DAMPINGS = [OVERDAMPED, CRITICAL, UNDERDAMPED]
START, GOAL = np.array([0.3, -1.2, 0.5]), np.array([1.0, 2.0, -0.4])
VELOCITY = np.array([2.0, -1.0, 5.0])


@given(st.floats(0.0, 0.999), st.floats(0.101, 99.0), st.floats(0.1, 10.0), st.integers(1, 500))
def test_a_late_cycle_is_made_good_in_usual_steps_and_ends_with_the_motion(
    fraction: float, late: float, duration: float, steps: int
) -> None:
    count, seconds = Phase().made_good(fraction, late * duration, duration, steps)
    assert seconds <= duration / steps * (1 + 1e-12)
    assert count * seconds == pytest.approx(duration * min(late, 1 - fraction), rel=1e-12)
    # After its end all of it is made good.
    count, seconds = Phase().made_good(1.0, late * duration, duration, steps)
    assert count * seconds == pytest.approx(duration * late, rel=1e-12)


@pytest.mark.parametrize("knots", [np.ones((2, 3)), np.ones(4), np.ones((0, 4)), [[np.nan] * 4]])
def test_what_are_no_knots_of_a_winding_is_refused(knots: Any) -> None:
    with pytest.raises(InputError, match="finite quaternions"):
        Winding(knots)


def companion(attractor: Attractor) -> Floats:
    """Matrix of the homogeneous equation on (x, x') with tau = 1."""
    return np.array([[0.0, 1.0], [-attractor.alpha * attractor.beta, -attractor.alpha]])


def solution(attractor: Attractor, times: Floats, value: Floats, velocity: Floats) -> Floats:
    """Values of the unforced attractor, shape (N, d), by the matrix exponential."""
    state = np.stack([value - GOAL, velocity])
    return np.asarray((expm(companion(attractor) * times[:, None, None]) @ state)[:, 0] + GOAL)


def unforced(
    attractor: Attractor, velocity: Floats = VELOCITY, *, steps: int = 200
) -> ConstrainedDMP:
    """Build a primitive of one second that nothing but its goal moves; it turns about z alone."""
    basis = Basis(5, Phase())
    force = ForcingTerm(basis, np.zeros((5, 6)))
    turned = Rotation.from_rotvec([0, 0, 0.9]).as_quat(scalar_first=True)
    law = Law(
        attractor,
        force,
        np.concatenate([START, turned]),
        np.concatenate([velocity, [0, 0, 1.5]]),
        Goal(GOAL, Winding(np.array([[1.0, 0.0, 0.0, 0.0]]))),
        duration=1.0,
        steps=steps,
    )
    return ConstrainedDMP(law)


positive = st.floats(0.05, 200, allow_subnormal=False)


@given(positive, positive, st.floats(-7, 1.5))
def test_factors_are_the_product_and_sum_of_the_exact_poles(
    alpha: float, beta: float, exponent: float
) -> None:
    h = 10**exponent
    product, gain = Attractor(alpha, beta).factors(h, h)
    with mpmath.workdps(60):
        a, b = mpmath.mpf(alpha), mpmath.mpf(beta)
        root = mpmath.sqrt(a * a / 4 - a * b)
        poles = [mpmath.exp((-a / 2 + sign * root) * mpmath.mpf(h)) for sign in (-1, 1)]
        expected = mpmath.re(poles[0] * poles[1])
        # 1 - S + P, the numerator of the step.
        numerator = mpmath.re((1 - poles[0]) * (1 - poles[1]))
    assert product == pytest.approx(float(expected), rel=1e-12, abs=1e-300)
    assert gain * h == pytest.approx(float(numerator), rel=1e-10, abs=0)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(DAMPINGS),
    st.just(0.0) | st.floats(1e-3, 0.1),
    st.floats(1e-3, 0.1),
)
def test_a_step_after_one_of_any_length_is_exact_for_a_quadratic_target(
    seed: int, damping: tuple[float, float], before: float, step: float
) -> None:
    attractor = Attractor(*damping)
    # Value, velocity, and the target's value, slope and bend.
    matrix = np.zeros((5, 5))
    matrix[:2, :2] = companion(attractor)
    matrix[1, 2] = attractor.stiffness
    matrix[[0, 2, 3], [1, 3, 4]] = 1.0
    state = np.random.default_rng(seed).normal(size=5)
    if not before:
        state[4] = 0.0  # where the target came from is not known at the start
    later, earlier = (expm(matrix * t) @ state for t in (step, -step))
    velocity = (state[0] - (expm(-matrix * before) @ state)[0]) / before if before else state[1]
    product, gain = attractor.factors(before, step)
    change, bend = attractor.led_by(before, step)
    target = state[2] + change * (later[2] - earlier[2]) / 2
    target += bend * (later[2] - 2 * state[2] + earlier[2])
    found = product * velocity + gain * (target - state[0])
    assert found == pytest.approx((later[0] - state[0]) / step, rel=0, abs=1e-9)


@pytest.mark.parametrize(("alpha", "beta"), DAMPINGS)
@pytest.mark.parametrize("steps", [4, 10, 50, 500, 20000])
def test_unforced_motion_is_the_analytic_solution(alpha: float, beta: float, steps: int) -> None:
    attractor = Attractor(alpha, beta)
    # The last step is shorter.
    motion = unforced(attractor).rollout(time_step=1 / (steps - 0.4))
    picked = np.unique(np.linspace(0, steps, 60).astype(int))
    expected = solution(attractor, motion.times[picked], START, VELOCITY)
    # The velocity is a difference of two samples: their rounding grows with the number of steps.
    tolerance = 1e-14 * max(100, steps)
    np.testing.assert_allclose(motion.positions[picked], expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize(("alpha", "beta"), DAMPINGS)
def test_turning_about_one_axis_follows_the_same_equation(alpha: float, beta: float) -> None:
    attractor = Attractor(alpha, beta)
    motion = unforced(attractor).rollout(time_step=1 / 400)
    angles = motion.rotations.as_rotvec()
    expected = (expm(companion(attractor) * motion.times[:, None, None]) @ [0.9, 1.5])[:, 0]
    np.testing.assert_allclose(angles[:, :2], 0, atol=1e-15)
    np.testing.assert_allclose(angles[:, 2], expected, rtol=0, atol=1e-11)


@given(
    st.floats(1, 100, allow_subnormal=False),
    st.floats(0.2, 100, allow_subnormal=False),
    st.floats(0.5, 2),
)
def test_no_step_of_constant_length_is_too_long(alpha: float, beta: float, exponent: float) -> None:
    step = 10**exponent
    assert distances((step,), alpha, beta, min(50, int(600 / step)), VELOCITY)[-1] < 1e-6


def distances(
    steps: tuple[float, ...], alpha: float, beta: float, count: int, velocity: Any = 0.0
) -> Floats:
    """Distance from the goal after each of a sequence of steps, repeated; beyond any end."""
    attractor, x, before, found = Attractor(alpha, beta), np.array(START), 0.0, []
    for k in range(count):
        h = steps[k % len(steps)]
        decay, gain = attractor.factors(before, h)
        velocity = decay * velocity + gain * (GOAL - x)
        x, before = x + h * velocity, h
        found.append(np.linalg.norm(x - GOAL))
    return np.array(found)


@given(st.integers(0, 2**32 - 1), st.sampled_from(DAMPINGS))
@settings(max_examples=15)
def test_steps_of_changing_length_stay_on_the_solution(
    seed: int, damping: tuple[float, float]
) -> None:
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.2, 2.0, 100) / 50 * rng.choice([1.0, 1e-3], 100)
    # Together no longer than the motion.
    lengths *= min(1.0, 1 / lengths.sum())
    attractor = Attractor(*damping)
    dmp = unforced(attractor)
    state, found = dmp.initial_state(), []
    for length in lengths:
        state = dmp.step(state, float(length))
        found.append(state.position)
    expected = solution(attractor, np.cumsum(lengths), START, VELOCITY)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def _around(velocities: Floats) -> tuple[Floats, Floats]:
    """Velocities before and after the inner samples."""
    return velocities[:-1], velocities[1:]


@given(st.integers(0, 2**32 - 1), st.sampled_from(DAMPINGS), st.floats(-4, 0))
def test_demonstrated_pulls_reproduce_any_samples(
    seed: int, damping: tuple[float, float], exponent: float
) -> None:
    rng = np.random.default_rng(seed)
    attractor, h = Attractor(*damping), 10**exponent
    values = rng.normal(size=(9, 2))
    targets = values[1:-1] + attractor.demonstrated_pull(*_around(np.diff(values, axis=0) / h), h)
    # The recursion written with the poles: x+ = S x - P x- + K x*.
    transition = expm(companion(attractor) * h)
    product, total = np.exp(-attractor.alpha * h), np.trace(transition)
    gain = attractor.factors(h, h)[1] * h
    following = total * values[1:-1] - product * values[:-2] + gain * targets
    np.testing.assert_allclose(following, values[2:], rtol=0, atol=1e-9)


# exp(-alpha_s t / tau) is no more than zero after 745 durations, and its logarithm is asked for.
def test_a_primitive_holds_its_end_for_a_thousand_durations() -> None:
    # Of few steps: a longer one is taken in steps of the law's own.
    dmp = unforced(Attractor(), steps=10)
    state = dmp.initial_state()
    for _ in range(2000):
        state = dmp.step(state, 0.5)
    np.testing.assert_allclose(state.position, dmp.rollout(time_step=0.5).positions[-1], atol=1e-15)
    assert state.time == pytest.approx(1 + 1998 * 0.5, rel=1e-11)


def test_the_time_scale_is_the_duration() -> None:
    # tau^2 x'' with tau the duration: ten times slower, the same path.
    dmp = unforced(Attractor())
    slow = replace(dmp, law=replace(dmp.law, duration=10.0))
    fast, same = dmp.rollout(), slow.rollout()
    assert same.times[-1] == pytest.approx(10.0)
    np.testing.assert_allclose(same.positions, fast.positions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        same.linear_velocities, fast.linear_velocities / 10, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("name", ["alpha", "beta"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_constants_must_be_positive(name: str, value: float) -> None:
    assert f"{name} must be a positive number" in refusal(InputError, Attractor, **{name: value})
