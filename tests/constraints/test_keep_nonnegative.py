"""A user's own inequality: its level found or given, what it may not be, saved and read back."""

from __future__ import annotations

import json
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import Constraint, NoslipError, keep_nonnegative
from noslip.constraints import ConstraintSystem, Instant
from noslip.constraints.catalog import restore, specification
from noslip.constraints.declaration import AcceleratedInstant
from noslip.errors import ConstraintError
from refusals import refusal

INSTANT = (
    0.5,
    [0.1, 0.2, 0.3],
    Rotation.from_euler("xyz", [0.2, 0.4, -0.9]).as_quat(scalar_first=True),
    [1.0, 2.0, 3.0],
    [0.4, 0.5, 0.6],
    [7.0, 8.0, 9.0],
    [-1.0, -2.0, -3.0],
)


def margin(limit: Constraint) -> list[float]:
    return list(ConstraintSystem(limit).residuals(*INSTANT)[0])


def above(motion: Instant) -> Any:
    """Stay above the table."""
    return motion.position[2] - 0.1


def slow(motion: Instant) -> Any:
    return 9 - ca.sumsqr(motion.linear_velocity)


def gentle(motion: AcceleratedInstant) -> Any:
    return [
        10 - motion.linear_acceleration[2],
        motion.time - motion.angular_acceleration[1] * motion.linear_velocity[0],
    ]


# -------------------------------------------------------------------- what a declaration may be


def test_a_decorated_function_is_an_inequality() -> None:
    @ns.keep_nonnegative
    def above_the_table(motion: Instant) -> Any:
        """Stay above the table."""
        return motion.position[2]

    assert isinstance(above_the_table, Constraint)
    assert above_the_table.name == "above the table"
    assert above_the_table.__doc__ == "Stay above the table."
    assert above_the_table.relation == "nonnegative"
    assert (above_the_table.barrier_rate, above_the_table.priority) == (None, 0)
    assert repr(above_the_table) == "<position inequality 'above the table'>"
    assert margin(above_the_table) == [0.3]


@pytest.mark.parametrize(
    ("function", "level", "unit"),
    [
        (lambda m: m.position[2], "position", "m"),
        (lambda m: m.rotation[2, 2] - 0.5, "position", "m"),
        (lambda m: m.position[0] - 0.1 * m.time, "position", "m"),
        (lambda m: [m.position[0], m.rotation[0, 0]], "position", "m"),
        (lambda m: m.linear_velocity[0], "velocity", "m/s"),
        (lambda m: 1 - m.angular_velocity[2], "velocity", "rad/s"),
        (lambda m: m.position[2] + m.linear_velocity[2], "velocity", "m/s"),
        (lambda m: [m.linear_velocity[0], m.linear_velocity[2]], "velocity", "m/s"),
        (lambda m: m.at((0, 0, 0.1)).position[2], "position", "m"),
        (lambda m: m.at((0, 0, 0.1)).linear_velocity[2], "velocity", "m/s"),
    ],
)
def test_the_level_follows_from_what_the_margin_depends_on(
    function: Any, level: str, unit: str
) -> None:
    limit = keep_nonnegative(function)
    assert limit.level == level
    assert set(ConstraintSystem(limit).row_units) == {unit}


@pytest.mark.parametrize(
    ("function", "level"), [(above, "position"), (slow, "velocity"), (gentle, "acceleration")]
)
def test_the_level_may_be_given(function: Any, level: Any) -> None:
    limit = keep_nonnegative(level=level)(function)
    assert limit.level == level
    assert set(ConstraintSystem(limit).row_levels) == {level}


def test_a_limit_at_acceleration_level_is_given_accelerations() -> None:
    limit = keep_nonnegative(level="acceleration")(gentle)
    assert margin(limit) == [1.0, 2.5]
    system = ConstraintSystem(limit)
    assert system.row_units == ["m/s²"] * 2
    # Without accelerations, those of a motion at constant velocity.
    assert list(system.residuals(*INSTANT[:5])[0]) == [10.0, 0.5]


def test_name_rate_and_priority_may_be_given() -> None:
    limit = keep_nonnegative(name="table", barrier_rate=20, priority=3)(above)
    assert (limit.name, limit.barrier_rate, limit.priority) == ("table", 20, 3)
    assert ConstraintSystem(limit).names == ("table",)


@given(st.tuples(*[st.floats(-5, 5)] * 6))
def test_margins_are_what_the_function_says(x: tuple[float, ...]) -> None:
    limit = keep_nonnegative(lambda m: [m.position + m.linear_velocity, 1 - m.angular_velocity[0]])
    found = ConstraintSystem(limit).residuals(0.0, x[:3], [1, 0, 0, 0], x[3:], np.zeros(3))
    np.testing.assert_array_equal(found[0], [x[0] + x[3], x[1] + x[4], x[2] + x[5], 1])


def test_a_system_tells_equalities_from_limits() -> None:
    blade, low, fast = ns.Blade(), keep_nonnegative(above), keep_nonnegative(slow)
    system = ConstraintSystem([low, blade, fast])
    assert system.row_is_limit.tolist() == [True, False, True]
    assert system.equalities.constraints == (blade,)
    assert system.limits.constraints == (low, fast)


def test_an_equality_is_no_limit() -> None:
    for constraint in (ns.Blade(), ns.position_constraint(above), ns.velocity_constraint(slow)):
        assert constraint.relation == "zero"
        assert ConstraintSystem(constraint).limits.size == 0


# -------------------------------------------------------------------- what is refused


def refused(function: Any, **arguments: Any) -> str:
    declare = keep_nonnegative(name="my rule", **arguments)
    message = refusal(NoslipError, lambda: ConstraintSystem(declare(function)))
    assert "'my rule'" in message
    return message


@pytest.mark.parametrize(
    ("function", "arguments", "reason"),
    [
        (lambda m: m.rotation, {}, "shape (3, 3)"),
        (lambda m: m.rotation, {}, "column of numbers, all 0 or more"),
        (lambda m: m.position.T, {}, "shape (1, 3)"),
        (lambda m: m.linear_velocity.T, {"level": "velocity"}, "shape (1, 3)"),
        (lambda m: ca.SX(0, 1), {}, "shape (0, 1)"),
        (lambda m: [], {}, "shape (0, "),
        (lambda m: [m.position[2], m.linear_velocity[2]], {}, "row 0 depends on no velocity"),
        (lambda m: 1.0, {}, "does not depend on the motion: it is 1"),
        (lambda m: 2 - m.time, {}, "does not depend on the motion"),
        (lambda m: 1.0, {"level": "acceleration"}, "does not depend on the motion"),
        (lambda m: None, {}, "cannot be evaluated"),
        (lambda m: "above", {}, "cannot be evaluated"),
        (lambda m: m.position[7], {}, "cannot be evaluated"),
        (lambda m: np.linalg.norm(m.position), {}, "cannot be evaluated"),
        (lambda: 0, {}, "cannot be evaluated"),
        (lambda m: 1 / 0, {}, "division by zero"),
        (lambda m: m.height, {}, "no 'height'"),
        (lambda m: m.height, {}, "has time, position, rotation, linear_velocity"),
        (lambda m: 1 - m.linear_acceleration[0], {}, 'keep_nonnegative(level="acceleration")'),
        (
            lambda m: 1 - m.angular_acceleration[0],
            {"level": "velocity"},
            'keep_nonnegative(level="acceleration")',
        ),
        (slow, {"level": "position"}, "keep_nonnegative(level='velocity')"),
        (above, {"level": "velocity"}, "keep_nonnegative(level='position')"),
        (above, {"level": "acceleration"}, "depends on no acceleration; leave out its level"),
        (slow, {"level": "acceleration"}, "depends on no acceleration; leave out its level"),
        (above, {"level": "jerk"}, "level is position, velocity, acceleration"),
        (above, {"barrier_rate": 0}, "barrier_rate must be a positive number of 1/s"),
        (above, {"barrier_rate": -1}, "got -1"),
        (above, {"barrier_rate": "fast"}, "got 'fast'"),
        (above, {"priority": -1}, "priority is 0 (hard) or a whole number up to 9"),
        (above, {"priority": 10}, "got 10"),
        (above, {"priority": 0.5}, "got 0.5"),
        (above, {"priority": True}, "got True"),
        (above, {"priority": "soft"}, "got 'soft'"),
    ],
)
def test_wrong_declarations_are_refused_by_name(
    function: Any, arguments: dict[str, Any], reason: str
) -> None:
    assert reason in refused(function, **arguments)


@pytest.mark.parametrize("what", [3.0, "above", [above]])
def test_only_functions_are_declared(what: Any) -> None:
    for declare in (keep_nonnegative, keep_nonnegative(name="my rule", level="position")):
        with pytest.raises(ConstraintError, match="@keep_nonnegative is put before a function"):
            declare(what)


# -------------------------------------------------------------------- as plain data, and back


@pytest.mark.parametrize(
    "limit",
    [
        keep_nonnegative(above),
        keep_nonnegative(name="slow", barrier_rate=12.5, priority=2)(slow),
        keep_nonnegative(level="acceleration", priority=9)(gentle),
        keep_nonnegative(lambda m: ca.fmax(m.position[0], 0) + ca.tanh(m.linear_velocity[1])),
    ],
    ids=["position", "velocity", "acceleration", "kinked"],
)
@pytest.mark.parametrize("unit", [None, "rad/s"])
def test_a_specification_restores_the_same_inequality(limit: Constraint, unit: str | None) -> None:
    limit.unit = unit
    data = json.loads(json.dumps(specification(limit), allow_nan=False))
    again = restore(data)
    for what in ("name", "level", "relation", "unit", "barrier_rate", "priority"):
        assert getattr(again, what) == getattr(limit, what), what
    assert margin(again) == margin(limit)
    system, original = ConstraintSystem(again), ConstraintSystem(limit)
    assert system.row_units == original.row_units
    assert system.limits.size == original.size
    # Saved, loaded and saved again.
    assert json.loads(json.dumps(specification(again))) == data


def test_incomplete_data_are_refused_in_one_line() -> None:
    data = specification(ns.position_constraint(above))
    for missing in ("relation", "unit", "barrier_rate", "priority"):
        with pytest.raises(NoslipError, match=missing) as caught:
            restore({key: value for key, value in data.items() if key != missing})
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("relation", "positive"),
        ("level", "jerk"),
        ("level", "velocity"),
        ("level", "acceleration"),
        ("barrier_rate", -1),
        ("priority", 99),
    ],
)
def test_wrong_data_are_refused_in_one_line(key: str, value: Any) -> None:
    data = specification(keep_nonnegative(above)) | {key: value}
    assert "'above'" in refusal(NoslipError, restore, data)


def test_repr_says_what_was_read_back() -> None:
    limit = keep_nonnegative(above)
    assert repr(restore(specification(limit))) == repr(limit)
