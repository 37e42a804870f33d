"""Rules that are no number somewhere on a motion: who says so, where, and of what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import constrained
from motions import gentle_cut
from noslip.constraints import ConstraintSystem, Instant
from noslip.constraints.check import step_residuals
from noslip.errors import ConstraintError
from refusals import refusal

FULL = (1.0,) * 6
MOVING = gentle_cut()


def paused() -> ns.PoseTrajectory:
    """At rest from sample 40 to 50, along x all the same."""
    way = np.concatenate([np.arange(40), np.full(10, 39.0), np.arange(39, 140)])
    return ns.PoseTrajectory(
        0.01 * np.arange(151),
        np.outer(1e-3 * way, [1, 0, 0]),
        Rotation.identity(151),
        name="paused",
    )


def direction(motion: Instant) -> Any:
    return (motion.linear_velocity / ca.norm_2(motion.linear_velocity))[2]


def heading(motion: Instant) -> Any:
    return ca.atan2(motion.linear_velocity[1], motion.linear_velocity[0])


def root(motion: Instant) -> Any:
    return ca.sqrt(0.05 - motion.position[0]) * motion.linear_velocity[1]


def guarded(motion: Instant) -> Any:
    v = motion.linear_velocity
    return ca.if_else(ca.sumsqr(v) > 1e-20, ca.atan2(v[1], v[0]), 0)


UNDEFINED = {
    "direction": (direction, 0.39, 39, "0 / 0"),
    "heading": (heading, 0.39, 39, "atan2(0, 0)"),
    "root": (root, 0.61, 61, "sqrt(-0.0005)"),
}


@pytest.mark.parametrize("name", UNDEFINED)
def test_a_check_says_where_a_rule_is_undefined_and_by_what(name: str) -> None:
    function, time, step, what = UNDEFINED[name]
    message = refusal(
        ConstraintError, ns.check, paused(), [ns.Blade(), ns.velocity_constraint(function)]
    )
    assert message.startswith(
        f"constraint '{name}' is nan at {time:g} s (step {step}): {what} is undefined; "
    )
    assert "low-pass" not in message


@pytest.mark.parametrize("name", UNDEFINED)
@pytest.mark.parametrize("beside", [[], [ns.constraints.ToolAxis()]])
def test_learning_says_it_too_and_not_to_low_pass(name: str, beside: list[Any]) -> None:
    function, _, _, what = UNDEFINED[name]
    rules = [ns.velocity_constraint(function), *beside]
    message = refusal(ConstraintError, ns.learn, paused(), rules, basis_functions=20)
    assert f"constraint '{name}' is nan at " in message
    assert what.partition("(")[0] in message
    assert "low-pass" not in message


def test_a_row_of_several_is_named() -> None:
    @ns.velocity_constraint
    def both(motion: Instant) -> Any:
        return [motion.linear_velocity[2], direction(motion)]

    assert "'both, row 2' is nan at 0.39 s" in refusal(ConstraintError, ns.check, paused(), both)


def test_what_is_guarded_is_defined() -> None:
    rule = ns.velocity_constraint(guarded)
    assert ns.check(paused(), rule).satisfied
    np.testing.assert_array_equal(step_residuals(paused(), rule), 0)


@pytest.mark.parametrize("function", [direction, heading])
def test_a_rule_that_is_defined_on_the_motion_is_learned(
    function: Callable[[Instant], Any],
) -> None:
    # Undefined at rest alone, where this motion, which begins and ends slowly, never is.
    def rise(motion: Instant) -> Any:
        v = motion.linear_velocity
        return function(replace(motion, linear_velocity=ca.vertcat(v[0], v[2], v[2])))

    (record,) = ns.learn(MOVING, [ns.velocity_constraint(rise)], basis_functions=30).record
    assert record.residual < 1e-9
    assert record.smoothing == pytest.approx(1e-6)


def test_a_rollout_that_is_lost_names_the_rule() -> None:
    # The square root ends where the motion has come half its way.
    @ns.keep_nonnegative
    def side(motion: Instant) -> Any:
        return ca.sqrt(0.05 - motion.position[0])

    dmp = constrained([side], FULL, plain=ns.learn(MOVING, basis_functions=30))
    message = refusal(ConstraintError, dmp.rollout)
    assert message.startswith("constraint 'side' is nan at 0.7")
    assert "sqrt(-" in message


def test_steps_controllers_and_many_rollouts_name_it_too() -> None:
    @ns.keep_nonnegative
    def side(motion: Instant) -> Any:
        return ca.sqrt(0.05 - motion.position[0])

    dmp = constrained([side], FULL, plain=ns.learn(MOVING, basis_functions=30))

    def steps() -> None:
        state = dmp.initial_state()
        for _ in range(200):
            state = dmp.step(state, 0.01)

    def control() -> None:
        controller = dmp.controller(time_step=0.01)
        for _ in range(200):
            controller.step()

    goals = np.tile(dmp.goal_position, (2, 1))
    for lost in (steps, control, lambda: dmp.rollout_many(goals=goals)):
        message = refusal(ConstraintError, lost)
        assert message.startswith("constraint 'side' is nan at 0.7"), message


def test_a_start_where_a_rule_is_undefined_is_refused() -> None:
    @ns.position_constraint
    def shell(motion: Instant) -> Any:
        return ca.log(motion.position[0] - 1)

    dmp = constrained([shell], FULL, plain=ns.learn(MOVING, basis_functions=30))
    for project in ("velocity", "pose", "nothing"):
        message = refusal(ConstraintError, dmp.rollout, project_start=project)
        assert message.startswith("constraint 'shell' is nan at 0 s: log(-1) is undefined; ")


def test_a_slope_that_is_undefined_is_told_from_a_value() -> None:
    system = ConstraintSystem(
        ns.velocity_constraint(name="length")(lambda m: ca.norm_2(m.linear_velocity))
    )
    still = np.zeros((1, 3))
    pose = ([0.5], still, [[1.0, 0, 0, 0]])
    np.testing.assert_array_equal(system.residuals(*pose, still, still), [[0.0]])
    message = refusal(ConstraintError, system.require_slopes, *pose, still, still)
    assert message.startswith("constraint 'length' has a slope of nan at 0.5 s: ")
