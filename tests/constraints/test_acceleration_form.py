"""A and b of ``A a = b`` against derivatives that SymPy takes of whole motions."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation

from noslip import Blade, Constraint, position_constraint, velocity_constraint
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem, Instant
from noslip.errors import ConstraintError
from strategies import AXES, axis_vector

Rule = Callable[[Any], Any]


# -------------------------------------------------------------------- rules, in components
#
# Written such that both CasADi's and SymPy's symbols fit in.


def dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def column(rotation: Any, index: int) -> list[Any]:
    return [rotation[i, index] for i in range(3)]


def blade(motion: Any) -> Any:
    return dot(column(motion.rotation, 1), motion.linear_velocity)


def needle(motion: Any) -> list[Any]:
    return [dot(column(motion.rotation, i), motion.linear_velocity) for i in (1, 2)]


def sphere(motion: Any) -> Any:
    return dot(motion.position, motion.position) - 2


def moving_plane(motion: Any) -> Any:
    return motion.position[2] - 0.3 * motion.time**2 - 0.1 * motion.time


def upright_over_a_slope(motion: Any) -> list[Any]:
    return [motion.rotation[2, 0] - 0.2 * motion.position[0], motion.rotation[0, 1]]


def curving(motion: Any) -> Any:
    # Not linear in the velocities: the turn of the tool follows from its speed and from time.
    spin = dot(column(motion.rotation, 2), motion.angular_velocity)
    return spin - (1 + motion.time) * dot(motion.linear_velocity, motion.linear_velocity)


def carried(motion: Any) -> Any:
    # Rheonomic and affine: no slip relative to a belt that speeds up.
    return blade(motion) - 0.4 * motion.time * motion.rotation[0, 1]


VELOCITY_RULES: list[Rule] = [blade, needle, curving, carried]
POSITION_RULES: list[Rule] = [sphere, moving_plane, upright_over_a_slope]
RULES = [(rule, "velocity") for rule in VELOCITY_RULES] + [
    (rule, "position") for rule in POSITION_RULES
]


def declared(rule: Rule, level: str) -> Constraint:
    declare = velocity_constraint if level == "velocity" else position_constraint

    def residual(motion: Instant) -> Any:
        return rule(motion)

    return declare(name=rule.__name__)(residual)


# -------------------------------------------------------------------- SymPy's side


class Symbolic:
    """A motion given by polynomials of time, and what a rule does along it."""

    def __init__(self) -> None:
        self.t = sp.Symbol("t")
        self.coefficients = sp.symbols("c:18")
        c, t = self.coefficients, self.t
        where = [c[i] + c[6 + i] * t + c[12 + i] * t**2 / 2 for i in range(6)]
        position = sp.Matrix(where[:3])
        yaw, pitch, roll = where[3:]
        rotation = (
            sp.rot_axis3(-yaw) * sp.rot_axis2(-pitch) * sp.rot_axis1(-roll)
        )  # SymPy turns the axes, not the vectors
        spin = rotation.diff(t) * rotation.T
        angular = sp.Matrix([spin[2, 1], spin[0, 2], spin[1, 0]])
        self.motion = SimpleNamespace(
            time=t,
            position=position,
            rotation=rotation,
            linear_velocity=position.diff(t),
            angular_velocity=angular,
        )
        quantities = [
            position,
            rotation,
            position.diff(t),
            angular,
            position.diff(t, 2),
            angular.diff(t),
        ]
        self.state = sp.lambdify((t, self.coefficients), quantities, cse=True)
        self._compiled: dict[Rule, Callable[..., list[Any]]] = {}

    def derivatives(self, rule: Rule, level: str) -> Callable[..., list[Any]]:
        """Compile the rule's value and derivatives along the motion, up to the acceleration's."""
        if rule not in self._compiled:
            value = sp.Matrix(sp.flatten([rule(self.motion)]))
            orders = 1 if level == "velocity" else 2
            wanted = [value, *(value.diff(self.t, k) for k in range(1, orders + 1))]
            self._compiled[rule] = sp.lambdify((self.t, self.coefficients), wanted, cse=True)
        return self._compiled[rule]


@pytest.fixture(scope="module")
def symbolic() -> Symbolic:
    return Symbolic()


def motions() -> Iterator[tuple[float, Floats]]:
    """Eight motions through each of three states: same pose and velocity, other accelerations."""
    rng = np.random.default_rng(11)
    for _ in range(3):
        coefficients = rng.normal(size=18)
        for _ in range(8):
            coefficients[12:] = rng.normal(size=6)
            yield 0.0, coefficients.copy()
    for _ in range(10):
        yield rng.uniform(-1, 1), rng.normal(size=18)


def state(symbolic: Symbolic, t: float, coefficients: Floats) -> tuple[tuple[Any, ...], Floats]:
    p, R, v, w, a, alpha = (np.array(x, dtype=float) for x in symbolic.state(t, coefficients))
    quaternion = Rotation.from_matrix(R).as_quat(scalar_first=True)
    return (t, p.ravel(), quaternion, v.ravel(), w.ravel()), np.concatenate([a, alpha]).ravel()


@pytest.mark.parametrize(("rule", "level"), RULES)
@pytest.mark.parametrize("stabilization", [0.0, 3.0])
def test_a_minus_b_is_the_derivative_along_any_motion(
    symbolic: Symbolic, rule: Rule, level: str, stabilization: float
) -> None:
    system = ConstraintSystem(declared(rule, level))
    derivatives = symbolic.derivatives(rule, level)
    zeta = 0.7
    for t, coefficients in motions():
        instant, acceleration = state(symbolic, t, coefficients)
        value, first, *second = (
            np.array(x, dtype=float).ravel() for x in derivatives(t, coefficients)
        )
        expected = first + stabilization * value
        if level == "position":
            expected = second[0] + 2 * zeta * stabilization * first + stabilization**2 * value
        A, b = system.acceleration_form(*instant, stabilization=stabilization, damping_ratio=zeta)
        assert A.shape == (system.size, 6)
        np.testing.assert_allclose(A @ acceleration - b, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("rule", "level"), RULES)
def test_instant_gives_the_value_and_its_rate(symbolic: Symbolic, rule: Rule, level: str) -> None:
    system = ConstraintSystem(declared(rule, level))
    derivatives = symbolic.derivatives(rule, level)
    for t, coefficients in motions():
        instant, _ = state(symbolic, t, coefficients)
        value, first, *_ = (np.array(x, dtype=float).ravel() for x in derivatives(t, coefficients))
        residual, phi, jacobian = system.instant(*instant)
        np.testing.assert_allclose(residual, value, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            phi, value if level == "velocity" else first, rtol=1e-10, atol=1e-11
        )
        A, _ = system.acceleration_form(*instant)
        np.testing.assert_allclose(jacobian, A, rtol=1e-13, atol=1e-13)


def test_stacked_rows_are_the_single_ones_in_the_order_given(symbolic: Symbolic) -> None:
    constraints = [declared(rule, level) for rule, level in RULES]
    stacked = ConstraintSystem(constraints)
    assert stacked.size == sum(stacked.rows) == 9
    t, coefficients = next(motions())
    instant, _ = state(symbolic, t, coefficients)
    A, b = stacked.acceleration_form(*instant, stabilization=2.0)
    single = [
        ConstraintSystem(c).acceleration_form(*instant, stabilization=2.0) for c in constraints
    ]
    np.testing.assert_array_equal(A, np.vstack([a for a, _ in single]))
    np.testing.assert_array_equal(b, np.concatenate([c for _, c in single]))
    assert stacked.row_names == [
        "blade",
        "needle, row 1",
        "needle, row 2",
        "curving",
        "carried",
        "sphere",
        "moving_plane",
        "upright_over_a_slope, row 1",
        "upright_over_a_slope, row 2",
    ]
    assert stacked.row_is_velocity.tolist() == [True] * 5 + [False] * 4


# -------------------------------------------------------------------- the blade in closed form


@pytest.mark.parametrize(
    ("lateral", "edge"), [(a, b) for a, b in itertools.permutations(AXES, 2) if a[-1] != b[-1]]
)
def test_the_blade_is_the_papers_constraint_for_every_axis(lateral: str, edge: str) -> None:
    system = ConstraintSystem(Blade(lateral=lateral, edge=edge))
    rng = np.random.default_rng(5)
    for _ in range(5):
        turn = Rotation.random(random_state=rng)
        p, v, w = rng.normal(size=(3, 3))
        c = turn.apply(axis_vector(lateral))
        instant = (0.3, p, turn.as_quat(scalar_first=True), v, w)
        A, b = system.acceleration_form(*instant, stabilization=1.7)
        # A = [c', 0] and b = -(dc/dt)' v, with dc/dt = w x c.
        np.testing.assert_allclose(A, [[*c, 0, 0, 0]], rtol=0, atol=1e-14)
        assert b == pytest.approx([-np.cross(w, c) @ v - 1.7 * c @ v], abs=1e-13)
        assert system.residuals(*instant) == pytest.approx(np.array([[c @ v]]), abs=1e-14)


def test_the_blade_needs_two_different_axes() -> None:
    for lateral, edge in (("x", "x"), ("y", "-y"), ("-z", "z")):
        with pytest.raises(ConstraintError, match="must not be parallel"):
            Blade(lateral=lateral, edge=edge)


@pytest.mark.parametrize("axis", ["", "w", "xy", "--x", "X", 1, None])
def test_body_axes_are_named_x_y_z(axis: Any) -> None:
    for arguments in ({"lateral": axis}, {"edge": axis}):
        with pytest.raises(ConstraintError, match="x, y, z, -x, -y, -z"):
            Blade(**arguments)


# -------------------------------------------------------------------- many instants at once


@pytest.mark.parametrize("count", [1, 2, 50])
def test_residuals_of_many_instants_are_those_of_each(symbolic: Symbolic, count: int) -> None:
    system = ConstraintSystem([Blade(), declared(needle, "velocity"), declared(sphere, "position")])
    rng = np.random.default_rng(2)
    instants = [state(symbolic, rng.uniform(), rng.normal(size=18))[0] for _ in range(count)]
    together = system.residuals(*(np.array(x) for x in zip(*instants, strict=True)))
    assert together.shape == (count, 4)
    for row, instant in zip(together, instants, strict=True):
        np.testing.assert_allclose(row, system.residuals(*instant)[0], rtol=0, atol=1e-14)


def test_an_empty_system_has_no_rows() -> None:
    system = ConstraintSystem()
    assert system.size == 0
    assert system.row_names == []
    assert system.residuals(np.zeros(7), *(np.zeros((7, n)) for n in (3, 4, 3, 3))).shape == (7, 0)


def test_expressions_take_part_in_other_expressions() -> None:
    system = ConstraintSystem(Blade())
    v = ca.SX.sym("v", 3)
    found = system.residual(0, ca.DM.zeros(3), ca.DM([1, 0, 0, 0]), v, ca.DM.zeros(3))
    assert float(ca.Function("f", [v], [found])([1, 2, 3])) == 2.0
