"""Symbolic rotations equal SciPy's, and their derivatives the known Jacobians of SO(3)."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.rotations import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)

EXP_SWITCH = np.sqrt(1e-3)
"""Angle at which the exponential changes from its series to the closed form."""
LOG_SWITCH = 2 * np.arctan(np.sqrt(1e-3))
SPECIAL_ANGLES = [
    0.0,
    1e-300,
    *(10.0**power for power in range(-12, 0)),
    *(switch * (1 + gap) for switch in (EXP_SWITCH, LOG_SWITCH) for gap in (-1e-9, 0, 1e-9)),
    np.pi / 2,
    np.pi - 1e-3,
    np.pi - 1e-8,
    np.pi,
]


def compiled(expression: Any, *symbols: Any) -> Any:
    function = ca.Function("f", list(symbols), [ca.densify(expression)])

    def evaluate(*values: Any) -> Floats:
        result = np.array(function(*values))
        return result.ravel() if result.shape[1] == 1 else result

    return evaluate


VECTOR, NUDGE = ca.SX.sym("x", 3), ca.SX.sym("e", 3)
A, B = ca.SX.sym("a", 4), ca.SX.sym("b", 4)

exp = compiled(quaternion_exp(VECTOR), VECTOR)
log = compiled(quaternion_log(A), A)
product = compiled(quaternion_product(A, B), A, B)
conjugate = compiled(quaternion_conjugate(A), A)
matrix = compiled(rotation_matrix(A), A)

# The world-frame rotation that a small change of the vector makes: twice the vector part of
# Exp(x + e) Exp(x)^-1 at e = 0, which is the left Jacobian of SO(3).
turned = quaternion_product(
    quaternion_exp(VECTOR + NUDGE), quaternion_conjugate(quaternion_exp(VECTOR))
)
exp_jacobian = compiled(
    ca.substitute(ca.jacobian(2 * turned[1:4], NUDGE), NUDGE, ca.DM.zeros(3)), VECTOR
)
# The change of the logarithm under a small rotation: the left Jacobian's inverse.
logged = quaternion_log(quaternion_product(quaternion_exp(NUDGE), A))
log_jacobian = compiled(ca.substitute(ca.jacobian(logged, NUDGE), NUDGE, ca.DM.zeros(3)), A)
log_hessians = compiled(
    ca.vertcat(
        *(ca.substitute(ca.hessian(logged[i], NUDGE)[0], NUDGE, ca.DM.zeros(3)) for i in range(3))
    ),
    A,
)
exp_hessians = compiled(
    ca.vertcat(*(ca.hessian(quaternion_exp(VECTOR)[i], VECTOR)[0] for i in range(4))), VECTOR
)


@st.composite
def directions(draw: st.DrawFn) -> Floats:
    vector = draw(arrays(np.float64, 3, elements=st.floats(-1, 1)))
    norm = np.linalg.norm(vector)
    return vector / norm if norm > 1e-3 else np.array([0.0, 1.0, 0.0])


def angles(most: float = np.pi) -> st.SearchStrategy[float]:
    special = [angle for angle in SPECIAL_ANGLES if angle <= most]
    return st.sampled_from(special) | st.floats(0, most, allow_subnormal=False)


def skew(vector: Floats) -> Floats:
    return np.cross(np.eye(3), vector)


def scalar_first(rotation: Rotation) -> Floats:
    return np.asarray(rotation.as_quat(scalar_first=True))


def random_quaternions() -> st.SearchStrategy[Floats]:
    return st.integers(0, 2**32 - 1).map(
        lambda seed: scalar_first(Rotation.random(random_state=seed))
    )


# -------------------------------------------------------------------- values


@given(directions(), angles(4 * np.pi))
def test_exponential_equals_scipy(direction: Floats, angle: float) -> None:
    mine, theirs = exp(angle * direction), scalar_first(Rotation.from_rotvec(angle * direction))
    # SciPy may return the quaternion of the other sign.
    np.testing.assert_allclose(mine, np.copysign(1, mine @ theirs) * theirs, rtol=0, atol=2e-15)


@given(directions(), angles())
def test_exponential_keeps_what_a_tiny_angle_says(direction: Floats, angle: float) -> None:
    # An absolute tolerance would accept zero here.
    np.testing.assert_allclose(
        exp(angle * direction)[1:], np.sin(angle / 2) * direction, rtol=1e-14, atol=1e-300
    )


@given(directions(), angles(), st.sampled_from([-1.0, 1.0]))
def test_logarithm_equals_scipy(direction: Floats, angle: float, sign: float) -> None:
    quaternion = scalar_first(Rotation.from_rotvec(angle * direction))
    mine = log(sign * quaternion)
    theirs = Rotation.from_quat(quaternion, scalar_first=True).as_rotvec()
    if angle > np.pi - 1e-7 and mine @ theirs < 0:
        # Half a turn one way is half a turn the other way.
        theirs -= 2 * np.pi * theirs / np.linalg.norm(theirs)
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-13)


@given(directions(), angles(np.pi - 1e-8))
def test_logarithm_undoes_the_exponential(direction: Floats, angle: float) -> None:
    vector = angle * direction
    error = np.linalg.norm(log(exp(vector)) - vector)
    assert error <= 3e-13 * angle + 1e-300


def test_logarithm_is_exact_in_double_below_its_switch() -> None:
    vector = np.array([0.98 * LOG_SWITCH, 0, 0])
    assert log(exp(vector))[0] == pytest.approx(vector[0], rel=2e-15, abs=0)


@given(directions(), st.floats(np.pi, 3 * np.pi))
def test_logarithm_takes_the_shorter_way_round(direction: Floats, angle: float) -> None:
    quaternion = exp(angle * direction)
    found = log(quaternion)
    assert np.linalg.norm(found) <= np.pi * (1 + 1e-15)
    back = exp(found)
    assert abs(back @ quaternion) == pytest.approx(1, abs=1e-14)


@given(directions())
def test_logarithm_of_half_a_turn_is_one_of_its_two_values(direction: Floats) -> None:
    for quaternion in (np.array([0.0, *direction]), np.array([-0.0, *-direction])):
        found = log(quaternion)
        assert np.linalg.norm(found) == pytest.approx(np.pi, rel=1e-15, abs=0)
        assert abs(found @ direction) == pytest.approx(np.pi, rel=1e-14, abs=0)


@given(random_quaternions(), random_quaternions())
def test_product_turns_by_the_second_then_the_first(a: Floats, b: Floats) -> None:
    first, second = (Rotation.from_quat(q, scalar_first=True) for q in (a, b))
    expected = scalar_first(first * second)
    found = product(a, b)
    np.testing.assert_allclose(found, np.sign(found @ expected) * expected, rtol=0, atol=4e-15)


@given(random_quaternions())
def test_conjugate_is_the_inverse(a: Floats) -> None:
    np.testing.assert_allclose(product(a, conjugate(a)), [1, 0, 0, 0], rtol=0, atol=4e-15)


@given(random_quaternions())
def test_matrix_equals_scipy(a: Floats) -> None:
    expected = Rotation.from_quat(a, scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrix(a), expected, rtol=0, atol=4e-15)


# -------------------------------------------------------------------- derivatives


def left_jacobian(vector: Floats) -> Floats:
    """``I + (1 - cos t) / t^2 [x] + (t - sin t) / t^3 [x]^2``, by its power series."""
    total, term = np.zeros((3, 3)), np.eye(3)
    for k in range(1, 60):
        total += term
        term = term @ skew(vector) / (k + 1)
    return total


@given(directions(), angles())
def test_jacobian_of_the_exponential_is_the_left_jacobian(direction: Floats, angle: float) -> None:
    vector = angle * direction
    np.testing.assert_allclose(exp_jacobian(vector), left_jacobian(vector), rtol=0, atol=1e-12)


@given(directions(), angles(3.0))
def test_jacobian_of_the_logarithm_is_the_inverse_left_jacobian(
    direction: Floats, angle: float
) -> None:
    vector = angle * direction
    expected = np.linalg.inv(left_jacobian(vector))
    np.testing.assert_allclose(log_jacobian(exp(vector)), expected, rtol=0, atol=1e-10)


@given(directions(), angles())
def test_all_first_and_second_derivatives_are_finite(direction: Floats, angle: float) -> None:
    vector = angle * direction
    quaternion = exp(vector)
    for values in (
        exp_jacobian(vector),
        exp_hessians(vector),
        log_jacobian(quaternion),
        log_jacobian(-quaternion),
        log_hessians(quaternion),
    ):
        assert np.all(np.isfinite(values))


@given(directions(), st.floats(-9, -1))
def test_second_derivatives_at_small_angles_are_those_at_zero(
    direction: Floats, exponent: float
) -> None:
    # Smooth functions: the difference is of the order of the angle, on either side of a switch.
    angle = 10**exponent
    for hessians, at_zero in ((exp_hessians, np.zeros(3)), (log_hessians, exp(np.zeros(3)))):
        here = angle * direction if hessians is exp_hessians else exp(angle * direction)
        np.testing.assert_allclose(hessians(here), hessians(at_zero), rtol=0, atol=2 * angle)


def test_second_derivatives_of_the_exponential_at_zero_are_known() -> None:
    # qw = 1 - |x|^2 / 8, and the vector part is x / 2 to third order.
    expected = np.vstack([-np.eye(3) / 4, np.zeros((9, 3))])
    np.testing.assert_allclose(exp_hessians(np.zeros(3)), expected, rtol=0, atol=4e-15)


@pytest.mark.parametrize("angle", [1e-7, 0.5, 2.0, np.pi - 0.1])
def test_derivatives_agree_with_differences(angle: float) -> None:
    rng = np.random.default_rng(3)
    direction = rng.normal(size=3)
    vector = angle * direction / np.linalg.norm(direction)
    h, difference = 1e-6, np.empty((3, 3))
    for i in range(3):
        nudge = h * np.eye(3)[i]
        difference[:, i] = (
            log(product(exp(nudge), exp(vector))) - log(product(exp(-nudge), exp(vector)))
        ) / (2 * h)
    np.testing.assert_allclose(log_jacobian(exp(vector)), difference, rtol=0, atol=1e-8)
