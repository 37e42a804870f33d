"""Who gives way: metrics by name, the rotation's share, and motions that come to rest."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import constrained
from noslip import (
    ConstrainedDMP,
    PoseTrajectory,
    learn,
    project_trajectory,
    velocity_constraint,
)
from noslip.constraints import ConstraintSystem, Instant
from noslip.law.step import StepSymbols
from noslip.projection.metric import inverse_metric
from noslip.projection.pointwise import POSITION_ONLY, coupling
from refusals import refusal

BLADE = ConstraintSystem(ns.Blade())
ROTATION_ONLY = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)


def curved(samples: int = 301) -> PoseTrajectory:
    """A cut along a curve, which the blade follows but for a yaw that comes and goes."""
    s = np.linspace(0, 1, samples)
    positions = np.column_stack([s, 0.3 * s**2, 0.05 * np.sin(3 * s)])
    heading = np.arctan(0.6 * s) + 0.2 * np.sin(np.pi * s) ** 2
    return PoseTrajectory(times=s, positions=positions, rotations=Rotation.from_euler("z", heading))


def back_and_forth() -> PoseTrajectory:
    """Forth and back along a line, the speed through zero; the blade askew by a varying yaw."""
    s = np.linspace(0, 1, 601)
    positions = np.column_stack([0.3 * np.sin(np.pi * s), 0.01 * np.sin(2 * np.pi * s), 0 * s])
    yaw = 0.15 * np.sin(3 * s)
    return PoseTrajectory(times=s, positions=positions, rotations=Rotation.from_euler("z", yaw))


def cusp() -> PoseTrajectory:
    """A semicubical parabola: at rest at its point, where the path turns round."""
    s = np.linspace(0, 1, 601)
    u = s - 0.5
    positions = np.column_stack([0.6 * u**2, 0.5 * u**3, 0 * s])
    yaw = 0.75 * u + 0.1 * np.sin(5 * s)
    return PoseTrajectory(times=s, positions=positions, rotations=Rotation.from_euler("z", yaw))


DEMONSTRATIONS = {"curved": curved, "back and forth": back_and_forth, "cusp": cusp}


@cache
def primitive(name: str) -> ConstrainedDMP:
    return learn(DEMONSTRATIONS[name](), basis_functions=40)


# -------------------------------------------------------------------- names and weights


def test_names_and_weights_are_inverse_inertias() -> None:
    length = 0.02
    turn = 1 / length**2
    assert inverse_metric(BLADE, "position", length, 1.0) == POSITION_ONLY
    assert inverse_metric(BLADE, "shared", length, 1.0) == (1, 1, 1, turn, turn, turn)
    found = inverse_metric(BLADE, (1, 2, 4, 5, 8, 10), length, 1.0)
    np.testing.assert_allclose(found, (1, 0.5, 0.25, turn / 5, turn / 8, turn / 10), rtol=1e-15)


def test_the_length_is_the_usual_one_unless_given() -> None:
    assert inverse_metric(BLADE, "shared", None, 0.01)[3] == pytest.approx(1e4)
    # A demonstration that does not move has no step.
    assert inverse_metric(BLADE, "shared", None, 0.0) == (1.0,) * 6


@pytest.mark.parametrize(
    ("rules", "metric"),
    [
        ([ns.Blade()], "position"),
        ([ns.Needle()], "position"),
        ([ns.constraints.PlaneContact()], "position"),
        ([ns.constraints.RemoteCenter()], "position"),
        ([ns.SpeedLimit(), ns.Blade()], "position"),
        ([], "position"),
        ([ns.constraints.ToolAxis()], "shared"),
        ([ns.Blade(), ns.constraints.ToolAxis()], "shared"),
        ([ns.Needle(curvature=2.0)], "shared"),
        ([ns.constraints.AngularRateLimit()], "shared"),
        ([ns.constraints.AccelerationLimit(angular=1.0)], "shared"),
        # Before an obstacle a tool that may not turn can only stop.
        ([ns.Blade(), ns.KeepOutSphere()], "shared"),
        ([ns.Wheel(), ns.DepthLimit()], "shared"),
        ([ns.constraints.PlaneContact(), ns.KeepOutSphere()], "position"),
        ([ns.KeepOutSphere()], "position"),
    ],
)
def test_the_default_is_the_position_where_that_can_hold_all(rules: Any, metric: str) -> None:
    system = ConstraintSystem(rules)
    expected = inverse_metric(system, metric, 0.1, 1.0)
    assert inverse_metric(system, "auto", 0.1, 1.0) == expected
    assert inverse_metric(system, "auto", 0.1, 1.0, [curved()]) == expected


@pytest.mark.parametrize(
    "metric",
    [
        "both",
        "",
        (1, 1, 1),
        (1,) * 7,
        (1, 1, 1, 1, 1, 0),
        (1, 1, 1, 1, 1, -2),
        (1, 1, 1, 1, 1, np.nan),
        (np.inf,) * 6,
        3.0,
        ("a",) * 6,
    ],
)
def test_other_metrics_are_refused_in_one_line(metric: Any) -> None:
    assert "metric" in refusal(ns.errors.InputError, inverse_metric, BLADE, metric, None, 0.01)


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan, np.inf, "long", [1.0]])
def test_lengths_out_of_range_are_refused_in_one_line(length: Any) -> None:
    assert "metric_length" in refusal(
        ns.errors.InputError, inverse_metric, BLADE, "shared", length, 0.01
    )


def test_a_metric_that_cannot_hold_a_constraint_says_which_can() -> None:
    with pytest.raises(ns.errors.ConstraintError, match=r"'tool-axis, leaning to x'.*=.shared"):
        constrained([ns.constraints.ToolAxis()], POSITION_ONLY, plain=primitive("curved")).rollout()
    with pytest.raises(ns.errors.ConstraintError, match=r"'plane-contact'.*metric=.shared"):
        constrained(
            [ns.constraints.PlaneContact()], ROTATION_ONLY, plain=primitive("curved")
        ).rollout()


# -------------------------------------------------------------------- who moves


@pytest.mark.parametrize("name", DEMONSTRATIONS)
def test_the_position_alone_leaves_every_bit_of_the_rotation(name: str) -> None:
    rules = [ns.Blade(), ns.constraints.HalfSpace(point=(0, 0, -0.01)), ns.SpeedLimit(speed=0.9)]
    motion = constrained(rules, POSITION_ONLY, plain=primitive(name)).rollout()
    free = primitive(name).rollout()
    np.testing.assert_array_equal(motion.rotations.as_quat(), free.rotations.as_quat())
    np.testing.assert_array_equal(motion.row_forces[:, :, 3:], 0.0)
    assert np.abs(motion.constraint_residuals).max() <= 1e-10
    assert np.abs(motion.positions - free.positions).max() > 1e-4


@pytest.mark.parametrize("metric", ["rotation", (np.inf, np.inf, np.inf, 1, 1, 1)])
def test_the_rotation_alone_is_refused_with_the_reason(metric: Any) -> None:
    for call in (
        lambda: inverse_metric(BLADE, metric, None, 0.01),
        lambda: learn(curved(), ns.Blade(), metric=metric),
    ):
        told = refusal(ns.errors.InputError, call)
        assert "swings" in told and "hold_position=True" in told and "shared" in told


def test_the_rotation_alone_swings_about_the_heading_for_ever() -> None:
    """``theta' = 2 direction - theta``: as far beyond the path's direction as it was off before."""
    step, off, h = blade_step(ROTATION_ONLY), 0.1, 1e-3
    q = Rotation.from_euler("z", off).as_quat(scalar_first=True)
    for sign in (-1, 1, -1):
        v, w = step(np.zeros(3), q, [1, 0, 0], np.zeros(3), h, 1e6, [1, 0, 0, 0, 0, 0])
        np.testing.assert_array_equal(np.array(v).ravel(), [1, 0, 0])
        turned = Rotation.from_rotvec(h * np.array(w).ravel()) * Rotation.from_quat(
            q, scalar_first=True
        )
        np.testing.assert_allclose(turned.as_rotvec(), [0, 0, sign * off], rtol=0, atol=1e-9)
        q = turned.as_quat(scalar_first=True)


def test_holding_the_position_turns_a_moving_blade_into_its_path() -> None:
    motion = curved()
    found = project_trajectory(motion, ns.Blade(), hold_position=True)
    np.testing.assert_array_equal(found.trajectory.positions, motion.positions)
    assert ns.check(found.trajectory, ns.Blade()).peak <= 1e-9
    assert np.linalg.norm(found.turns, axis=1).max() > 0.1


@cache
def blade_step(metric: tuple[float, ...]) -> ca.Function:
    p, q, v, w = (ca.SX.sym(name, n) for name, n in zip("pqvw", (3, 4, 3, 3), strict=True))
    dt, rate, free = ca.SX.sym("dt"), ca.SX.sym("rate"), ca.SX.sym("free", 6)
    # The first step, whose residual is that of the instant.
    symbols = StepSymbols(p, q, v, w, ca.SX(1, 1), dt, dt, ca.SX(0), dt, rate, rate, rate)
    held = coupling(BLADE, inverse_metric=metric, push="steering")(symbols, free[:3], free[3:])
    return ca.Function("step", [p, q, v, w, dt, rate, free], [held.linear, held.angular])


@given(st.floats(0.05, 2), st.floats(-3, 3), st.floats(-6, -2), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_the_rotation_takes_the_share_that_its_way_in_a_step_gives_it(
    speed: float, ratio: float, small: float, seed: int
) -> None:
    # The blade moves at speed s along its edge e, the step adds a slip d along the lateral axis c.
    # To first order  c . dv - ds u . dw = -d,  u = e x c,  with ds = s dt / 2, half a step's way;
    # least in  |dv|^2 + L^2 |dw|^2:  dv = -d c L^2 / (ds^2 + L^2), and the turn takes
    # d ds^2 / (ds^2 + L^2).
    dt, turn = 1e-3, Rotation.random(random_state=np.random.default_rng(seed))
    way = speed * dt / 2
    length = way * 10**ratio
    edge, lateral, _ = turn.apply(np.eye(3))
    slip = speed * 10**small * 1e-2
    metric = inverse_metric(BLADE, "shared", length, 1.0)
    free = np.concatenate([speed * edge + slip * lateral, np.zeros(3)])
    linear, angular = (
        np.array(x).ravel()
        for x in blade_step(metric)(
            np.zeros(3), turn.as_quat(scalar_first=True), speed * edge, np.zeros(3), dt, 0.0, free
        )
    )
    share = way**2 / (way**2 + length**2)
    # What is left of the velocity along the old lateral axis, the turned blade follows.
    assert lateral @ linear == pytest.approx(share * slip, rel=1e-3, abs=1e-6 * slip)
    assert np.linalg.norm(linear - free[:3]) == pytest.approx(
        (1 - share) * slip, rel=1e-3, abs=1e-6 * slip
    )
    about = np.cross(edge, lateral)
    assert way * about @ angular == pytest.approx(share * slip, rel=1e-3, abs=1e-6 * slip)
    np.testing.assert_allclose(
        angular - about * (about @ angular), 0, rtol=0, atol=1e-3 * np.linalg.norm(angular) + 1e-15
    )


def test_the_metrics_limits_are_the_position_and_the_rotation_alone() -> None:
    metric = inverse_metric(BLADE, "shared", 1e4, 1.0)
    far = constrained([ns.Blade()], metric, plain=primitive("curved")).rollout()
    # Pushed along the same rows.
    alone = constrained([ns.Blade()], POSITION_ONLY, plain=primitive("curved"), push="steering")
    position = alone.rollout()
    np.testing.assert_allclose(far.positions, position.positions, rtol=0, atol=1e-6)
    # Of one step: the rotation alone swings.
    q = Rotation.from_euler("z", 0.005).as_quat(scalar_first=True)
    given = (np.zeros(3), q, [1, 0, 0], np.zeros(3), 1e-3, 1e6, [1, 0, 0, 0, 0, 0])
    near = blade_step(inverse_metric(BLADE, "shared", 1e-8, 1.0))(*given)
    for found, expected in zip(near, blade_step(ROTATION_ONLY)(*given), strict=True):
        np.testing.assert_allclose(np.array(found), np.array(expected), rtol=1e-6, atol=1e-9)


@velocity_constraint
def vanishing(motion: Instant) -> Any:
    """A roll in proportion to how fast the tool moves aside, by less and less along x."""
    return (0.5 - motion.position[0]) * motion.linear_velocity[1] - 0.1 * motion.angular_velocity[0]


def test_a_row_of_which_the_position_holds_nothing_somewhere_is_shared() -> None:
    system, turning = ConstraintSystem(vanishing), ConstraintSystem([ns.Blade(), vanishing])
    for rules in (system, turning):
        assert inverse_metric(rules, "auto", 0.1, 1.0)[3] == 0
        assert inverse_metric(rules, "auto", 0.1, 1.0, [curved()])[3] > 0
        # Up to where a half of it is left, the position holds it.
    ahead = curved()[:60]
    assert inverse_metric(system, "auto", 0.1, 1.0, [ahead])[3] == 0
    assert learn(curved(), vanishing, basis_functions=20).rule.inverse_metric[3] > 0


def test_rules_that_are_given_twice_are_the_positions_all_the_same() -> None:
    twice = ConstraintSystem([ns.Blade(), ns.Blade(), ns.Needle()])
    assert inverse_metric(twice, "auto", 0.1, 1.0, [curved(), cusp()]) == POSITION_ONLY


# -------------------------------------------------------------------- at rest


def greatest_turn(name: str, metric: Sequence[float], steps: int) -> float:
    """Largest angular acceleration that the rule adds near rest, which both pass at t = 0.5."""
    motion = constrained([ns.Blade()], metric, plain=primitive(name)).rollout(time_step=1 / steps)
    free = primitive(name).rollout(time_step=1 / steps)
    if any(metric[:3]):
        assert np.abs(motion.constraint_residuals).max() <= 1e-10
    spins = motion.angular_velocities[1:] - free.angular_velocities[1:]
    near = np.abs(motion.times[2:] - 0.5) < 0.1
    return float(np.linalg.norm(np.diff(spins, axis=0) * steps, axis=1)[near].max())


@pytest.mark.parametrize("name", ["back and forth", "cusp"])
@pytest.mark.parametrize("factor", [1, 6])
def test_a_shared_metric_passes_through_rest_without_a_spike(name: str, factor: int) -> None:
    length = factor * primitive(name).rollout().path_length / 600
    metric = inverse_metric(BLADE, "shared", length, 1.0)
    found = [greatest_turn(name, metric, steps) for steps in (600, 2400, 9600)]
    # The rotation's part shrinks with the step.
    assert found[1] <= found[0] and found[2] <= found[1], found
    # The rotation alone must turn by as much as the path does, at once.
    spikes = [greatest_turn(name, ROTATION_ONLY, steps) for steps in (600, 2400, 9600)]
    assert spikes[0] > 2 * found[0], (spikes, found)
    assert spikes[2] > 40 * found[2], (spikes, found)
    assert spikes[2] > 0.9 * spikes[0], (spikes, found)


# -------------------------------------------------------------------- learning


def test_learning_takes_a_metric_and_a_length_and_saving_keeps_them(tmp_path: Path) -> None:
    learned = ns.learn(
        curved(), ns.Blade(), basis_functions=30, metric="shared", metric_length=0.02
    )
    assert learned.rule.inverse_metric == pytest.approx((1, 1, 1, 2500, 2500, 2500))
    loaded = ns.load_primitive(learned.save(tmp_path / "primitive.json"))
    assert loaded.rule.inverse_metric == learned.rule.inverse_metric
    goal = learned.goal_position + [0.05, -0.1, 0.02]
    np.testing.assert_array_equal(
        loaded.rollout(goal_position=goal).positions, learned.rollout(goal_position=goal).positions
    )


def test_learning_chooses_the_position_or_both_and_a_mean_steps_length() -> None:
    demonstration = curved()
    assert (
        ns.learn(demonstration, ns.Blade(), basis_functions=20).rule.inverse_metric == POSITION_ONLY
    )
    upright = ns.learn(demonstration, ns.constraints.ToolAxis(), basis_functions=20)
    step = demonstration.path_length / upright.law.steps
    assert upright.rule.inverse_metric == pytest.approx((1, 1, 1, *([1 / step**2] * 3)))
    assert np.abs(upright.rollout().constraint_residuals).max() <= 1e-10


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"metric": "both"}, "metric is one of auto, position, shared"),
        ({"metric": (1, 2)}, "metric"),
        ({"metric": "shared", "metric_length": 0.0}, "metric_length"),
        ({"barrier_rate": 0.0}, "barrier_rate"),
        ({"barrier_rate": np.nan}, "barrier_rate"),
        ({"stabilization": -1.0}, "stabilization"),
    ],
)
def test_learning_refuses_what_is_out_of_range_in_one_line(arguments: Any, match: str) -> None:
    assert re.search(
        match, refusal(ns.errors.InputError, ns.learn, curved(), ns.Blade(), **arguments)
    )
