"""Limits of joints: declared of coordinates, beside constraints of the tool that they carry."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import noslip as ns
from noslip.chain import Chain, Joint
from noslip.constraints import ConstraintSystem
from noslip.constraints.catalog import (
    constraint_text,
    parse_constraint,
    restore,
    specification,
)
from noslip.constraints.declaration import constraint_function, row_units
from noslip.constraints.joints import JointLimits, joint_limits
from noslip.errors import ConstraintError
from noslip.space import POSE, jointed

CHAIN = Chain(
    [
        Joint("turn", lower=-1.0, upper=2.0, velocity=3.0),
        Joint("reach", "slide", (1, 0, 0), (0.3, 0, 0), upper=0.4, velocity=0.5, acceleration=6.0),
        Joint("roll", axis=(1, 0, 0), position=(0.1, 0, 0.2)),
    ],
    (0.1, 0, 0),
)
FREE = Chain([Joint("free")])
JOINTS = jointed(CHAIN, CHAIN.joint_names, CHAIN.units)
finite = st.floats(-5, 5)


@given(st.lists(st.tuples(finite, finite, finite), min_size=3, max_size=3))
@settings(max_examples=20)
def test_margins_are_the_distances_to_bounds(state: list[Any]) -> None:
    x, rates, accelerations = (np.array(each) for each in state)
    position, velocity, acceleration = (
        np.array(constraint_function(each)(0.0, x, rates, accelerations)).ravel()
        for each in joint_limits(CHAIN)
    )
    assert np.allclose(position, [min(x[0] + 1, 2 - x[0]), 0.4 - x[1]], atol=1e-14)
    assert np.allclose(velocity, [3 - abs(rates[0]), 0.5 - abs(rates[1])], atol=1e-14)
    assert np.allclose(acceleration, [6 - abs(accelerations[1])], atol=1e-14)


def test_rows_have_the_units_of_their_joints() -> None:
    position, velocity, acceleration = joint_limits(CHAIN)
    assert row_units(position) == ["rad", "m"]
    assert row_units(velocity) == ["rad/s", "m/s"]
    assert row_units(acceleration) == ["m/s²"]
    assert JointLimits([0.0], [None]).unit == "rad"


def test_they_stand_beside_constraints_of_the_tool() -> None:
    """In one system: the blade's row is that of the tool that the joints carry."""
    system = ConstraintSystem([ns.Blade(), *joint_limits(CHAIN)], JOINTS)
    times = np.linspace(0, 1, 30)
    q = np.column_stack([np.sin(times), 0.2 * times**2, np.cos(3 * times)])
    motion = CHAIN.poses(times, q)
    none = np.empty((30, 0))
    rates = np.diff(q, axis=0) / np.diff(times)[:, None]
    seen = system.of_steps(times, q, none, rates, none[1:], 0 * rates, none[1:])
    tool = ConstraintSystem(ns.Blade()).of_steps(
        times, motion.positions, motion.quaternions, *motion.step_velocities()
    )
    assert np.abs(seen[:, 0] - tool[:, 0]).max() <= 1e-12
    assert np.allclose(seen[:, 1], np.minimum(q[1:, 0] + 1, 2 - q[1:, 0]))
    assert np.allclose(seen[:, 3], 3 - abs(rates[:, 0]))


@pytest.mark.parametrize("limits", joint_limits(CHAIN), ids=lambda each: each.level)
def test_they_are_values_and_are_saved(limits: JointLimits) -> None:
    assert pickle.loads(pickle.dumps(limits)).level == limits.level
    again = restore(json.loads(json.dumps(specification(limits))))
    assert again == limits
    assert ConstraintSystem(again, JOINTS) == ConstraintSystem(limits, JOINTS)
    arguments = [ca.DM([0.5, -0.25, 1.0])] * 3
    found = [constraint_function(each)(0.0, *arguments) for each in (limits, again)]
    assert np.array_equal(np.array(found[0]), np.array(found[1]))
    assert limits != JointLimits([-9.0] * 3, [9.0] * 3, limits.level)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: JointLimits([0], [1], "jerk"), "level is position, velocity, acceleration"),  # type: ignore[arg-type]
        (lambda: JointLimits([0, 0], [1]), "2 lower bounds, 1 upper ones and 2 units"),
        (lambda: JointLimits([2], [1]), r"lower\[0\] must be less than upper\[0\], got 2 and 1"),
        (lambda: JointLimits([None], [np.inf]), "no bound is finite"),
        (lambda: JointLimits([np.nan], [1]), "lower must be a number or None"),
        (lambda: JointLimits(0.0, [1]), "lower must be a number or None"),  # type: ignore[arg-type]
        (lambda: ConstraintSystem(JointLimits([0], [1]), JOINTS), "of 1 coordinates, but .* has 3"),
    ],
)
def test_what_bounds_nothing_is_refused(wrong: Any, message: str) -> None:
    with pytest.raises(ConstraintError, match=message):
        wrong()


@pytest.mark.parametrize("limits", joint_limits(CHAIN), ids=lambda each: each.level)
def test_without_bounds_they_are_the_robot_s(limits: JointLimits) -> None:
    """By the name of the command line, too, and saved as what they came to."""
    asked = parse_constraint(f"joint-limits(level={limits.level!r}, priority=2)")
    system = ConstraintSystem([ns.Blade(), asked], JOINTS)
    assert system.constraints[1] == replace(limits, priority=2)
    assert parse_constraint(constraint_text(limits)) == limits
    for space, message in ((POSE, "of which robot"), (jointed(FREE, ["free"], ["rad"]), "has no")):
        with pytest.raises(ConstraintError, match=message):
            ConstraintSystem(asked, space)


def test_a_chain_that_knows_no_limits_has_none() -> None:
    assert joint_limits(FREE) == []
