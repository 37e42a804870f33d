"""A constraint is declared once; what cannot be one is refused by name."""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import Blade, Constraint, Wheel, position_constraint, velocity_constraint
from noslip.constraints import ConstraintSystem, Instant
from noslip.constraints.catalog import restore, specification
from noslip.constraints.declaration import CATALOG, row_units
from noslip.constraints.joints import JointLimits
from noslip.edge import Edge
from noslip.errors import ConstraintError
from noslip.space import vectors
from refusals import refusal

INSTANT = (0.5, [0.1, 0.2, 0.3], [1.0, 0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [0.4, 0.5, 0.6])


def residual(constraint: Constraint) -> list[float]:
    return list(ConstraintSystem(constraint).residuals(*INSTANT)[0])


# -------------------------------------------------------------------- what a declaration may be


def test_a_decorated_function_is_a_constraint() -> None:
    @velocity_constraint
    def no_lateral_slip(motion: Instant) -> Any:
        """Keep to the edge."""
        return motion.rotation[:, 1].T @ motion.linear_velocity

    assert isinstance(no_lateral_slip, Constraint)
    assert no_lateral_slip.level == "velocity"
    assert no_lateral_slip.name == "no lateral slip"
    assert no_lateral_slip.__doc__ == "Keep to the edge."
    assert residual(no_lateral_slip) == [2.0]


def test_a_decorator_takes_a_name() -> None:
    @position_constraint(name="table")
    def stay(motion: Instant) -> Any:
        return motion.position[2]

    assert (stay.name, stay.level) == ("table", "position")
    assert residual(stay) == [0.3]


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda m: m.linear_velocity[0], [1.0]),
        (lambda m: m.linear_velocity, [1.0, 2.0, 3.0]),
        (lambda m: [m.linear_velocity[0], m.angular_velocity[2]], [1.0, 0.6]),
        (lambda m: (m.linear_velocity[1], 2 * m.time * m.linear_velocity[0]), [2.0, 1.0]),
        (lambda m: m.rotation[:, 1:].T @ m.linear_velocity, [2.0, 3.0]),
        (lambda m: ca.vertcat(m.linear_velocity[:2], m.angular_velocity[0]), [1.0, 2.0, 0.4]),
        (lambda m: ca.norm_2(m.linear_velocity) - 1, [np.sqrt(14) - 1]),
        # Structurally sparse columns count as full ones.
        (lambda m: ca.vertcat(m.linear_velocity[0], ca.SX(1, 1)), [1.0, 0.0]),
    ],
)
def test_scalars_columns_and_lists_are_taken(function: Any, expected: list[float]) -> None:
    assert residual(velocity_constraint(function)) == pytest.approx(expected, abs=1e-15)


def test_a_class_may_be_a_constraint() -> None:
    class Wheel(Constraint):
        name = "wheel"
        edge = Edge("x", lateral="z")

        def __init__(self, radius: float) -> None:
            self.radius = radius

        def residual(self, motion: Instant) -> Any:
            return motion.linear_velocity[0] - self.radius * motion.angular_velocity[1]

    assert residual(Wheel(2.0)) == [0.0]


def test_rotation_columns_are_the_body_axes_in_the_world() -> None:
    turn = Rotation.from_euler("xyz", [0.3, -0.7, 1.1])

    @position_constraint
    def forward(motion: Instant) -> Any:
        return motion.rotation[:, 0]

    found = ConstraintSystem(forward).residuals(
        0.0, np.zeros(3), turn.as_quat(scalar_first=True), np.zeros(3), np.zeros(3)
    )
    np.testing.assert_allclose(found[0], turn.apply([1, 0, 0]), atol=1e-15)


# -------------------------------------------------------------------- what is refused


refused = partial(refusal, ConstraintError, ConstraintSystem)


def explodes(motion: Instant) -> Any:
    raise ZeroDivisionError("division\nby zero")


def asks_if(motion: Instant) -> Any:
    return motion.linear_velocity[0] if motion.position[2] > 0 else 0.0


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (lambda m: m.rotation @ ca.diag(m.linear_velocity), "shape (3, 3)"),
        (lambda m: m.linear_velocity.T, "shape (1, 3)"),
        (lambda m: ca.SX(0, 1), "shape (0, 1)"),
        (lambda m: [], "shape (0, "),
        (lambda m: 1.0, "does not depend on the motion: it is 1"),
        (lambda m: ca.DM([1, 2]), "does not depend on the motion"),
        (lambda m: float("nan"), "does not depend on the motion: it is nan"),
        (lambda m: m.time - 1, "does not depend on the motion"),
        (lambda m: m.position[2], "depends on no velocity; declare it with position_constraint"),
        (lambda m: None, "cannot be evaluated"),
        (lambda m: "zero", "cannot be evaluated"),
        (lambda m: np.linalg.norm(m.linear_velocity), "cannot be evaluated"),
        (lambda m: m.linear_velocity[7], "cannot be evaluated"),
        (lambda m: m.linear_velocity @ m.linear_velocity, "cannot be evaluated"),
        (lambda: 0, "cannot be evaluated"),
        (explodes, "cannot be evaluated: ZeroDivisionError: division by zero"),
        (asks_if, "cannot be evaluated"),
        (lambda m: m.velocity[0], "has time, position, rotation, linear_velocity"),
        (lambda m: m.linear_acceleration[1], "accelerations follow from the constraint"),
    ],
)
def test_wrong_declarations_are_refused_by_name(function: Any, reason: str) -> None:
    message = refused(velocity_constraint(name="my rule")(function))
    assert "'my rule'" in message
    assert reason in message


def test_a_velocity_in_a_position_constraint_is_refused_by_name() -> None:
    for function in (lambda m: m.linear_velocity[0], lambda m: m.position[0] * m.angular_velocity):
        message = refused(position_constraint(name="my rule")(function))
        assert "'my rule'" in message
        assert "declare it with velocity_constraint" in message


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ([Blade], "call it: Blade()"),
        (["blade"], "got 'blade'; call it: Blade()"),
        (["a rule"], "got 'a rule'"),
        ([Wheel], "call it: Wheel()"),
        ([None], "got None"),
        ([lambda motion: motion.position[2]], "declare it first"),
        pytest.param(
            Blade,
            "call it: Blade()",
        ),
    ],
)
def test_only_constraints_are_constraints(given: Any, reason: str) -> None:
    assert reason in refused(given)


@pytest.mark.parametrize("declare", [velocity_constraint, position_constraint])
def test_only_functions_are_declared(declare: Any) -> None:
    with pytest.raises(ConstraintError, match="before a function of the motion"):
        declare(3.0)


@pytest.mark.parametrize(
    "rule",
    [
        lambda m: m.rotation[:, 1].T @ m.linear_velocity == 0,
        lambda m: m.linear_velocity[0] > 0.1,
        lambda m: m.linear_velocity[1] <= m.linear_velocity[0],
        lambda m: [m.linear_velocity[0], m.linear_velocity[1] != 0],
    ],
)
def test_a_comparison_is_no_rule(rule: Any) -> None:
    # It is 0 or 1 whatever the motion does: it would hold, or not, without a reason.
    with pytest.raises(
        ns.errors.ConstraintError, match=r"returns a comparison.*return the quantity"
    ):
        ConstraintSystem([velocity_constraint(name="rule")(rule)])
    with pytest.raises(ns.errors.ConstraintError, match="a - b for a >= b"):
        ConstraintSystem([ns.keep_nonnegative(name="rule")(rule)])


def test_a_rule_without_return_and_one_that_decides_are_told_what_to_do() -> None:
    with pytest.raises(ns.errors.ConstraintError, match="returns nothing; is a return missing"):
        ConstraintSystem([position_constraint(name="rule")(lambda m: None)])
    with pytest.raises(ns.errors.ConstraintError, match=r"casadi\.if_else, casadi\.fmin"):
        ConstraintSystem(
            [position_constraint(name="rule")(lambda m: 1.0 if m.position[0] > 0 else 0.0)]
        )


def test_a_choice_within_a_rule_is_fine() -> None:
    rule = ns.keep_nonnegative(name="rule")(
        lambda m: ca.if_else(m.position[0] > 0, m.position[1], m.position[2] + 1)
    )
    assert ConstraintSystem([rule]).size == 1


def test_rows_have_the_names_that_their_constraint_gives_them() -> None:
    limits = JointLimits((None, -1.0, -2.0), (None, 1.0, 2.0))
    assert ConstraintSystem(limits, vectors("abc", ["rad"] * 3)).row_names == [
        "joint position limits, joint 2",
        "joint position limits, joint 3",
    ]
    assert restore(specification(limits)).row_names == ("joint 2", "joint 3")
    seen = ns.constraints.InMovingFrame(ns.Wheel())
    assert ConstraintSystem([ns.Wheel(), ns.Wheel(normal=None), seen]).row_names == [
        *("wheel, sideways", "wheel, vertical", "wheel 2"),
        *(f"wheel in moving frame, {row}" for row in ("sideways", "vertical")),
    ]
    curved = ns.Needle(shaft="-y", curvature=3.0)
    kinds = ("sideways", "turning about")
    assert curved.row_names == tuple(f"{kind} {axis}" for kind in kinds for axis in "zx")
    box = ns.constraints.Box(lower=(0.0, None, -1.0), upper=(None, 1.0, None))
    assert box.row_names == ("least x", "least z", "largest y")


@pytest.mark.parametrize("kind", CATALOG.values(), ids=list(CATALOG))
def test_every_constraint_of_several_rows_names_each(kind: type[Constraint]) -> None:
    # Without a robot, limits of joints have no rows yet.
    constraint = JointLimits([0.0, 0.0], [1.0, 2.0]) if kind is JointLimits else kind()
    rows = len(row_units(constraint))
    assert rows == 1 or len(set(constraint.row_names)) == rows


def test_names_that_are_no_rows_are_refused() -> None:
    @ns.velocity_constraint
    def one(motion: Instant) -> Any:
        return motion.linear_velocity[0]

    one.row_names = ("a", "b")  # type: ignore[attr-defined]
    with pytest.raises(ConstraintError, match="has 1 rows and 2 row_names"):
        ConstraintSystem(one)
