"""Several bodies in one primitive: as values, under rules that refer to two, adapted, in C."""

from __future__ import annotations

import pickle
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as options
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased
from noslip.constraints import ConstraintSystem, HoldTogether, OfBody, of, relative_to
from noslip.constraints.catalog import restore, specification
from noslip.constraints.check import step_residuals
from noslip.errors import CompromiseWarning, ConstraintError, InputError
from noslip.law.fitting import fit
from noslip.projection.metric import inverse_metric
from noslip.rule import Rule, no_rule
from noslip.runtime.rollout import rollout
from objects import objects
from strategies import seeds

CUT = relative_to(ns.Blade(), "knife", "tissue")
HELD = 1e-10
"""Slip that counts as none (m/s)."""


def wandering(rng: np.random.Generator, count: int = 40, *, turns: float = 1.0) -> Any:
    """A smooth random motion of a body in 2 s."""
    s = np.linspace(0, 1, count)
    waves = np.array([np.sin(2 * np.pi * (k + 1) * s + rng.uniform(0, 6)) for k in range(3)])
    place = (rng.normal(size=(3, 3)) @ waves * 0.05).T
    turn = Rotation.from_rotvec(turns * (rng.normal(size=(3, 3)) @ waves * 0.4).T)
    return ns.PoseTrajectory(2 * s, place, turn)


def cutting(count: int = 201) -> ns.Bodies:
    """A knife that cuts in tissue that sways and turns, its edge askew by up to 10 degrees."""
    s = np.linspace(0, 1, count)
    u = eased(s)
    heading = 0.5 * np.sin(np.pi * u)
    way = np.column_stack([0.05 * u, 0.01 * np.sin(np.pi * u), 0.003 * u])
    tissue = ns.PoseTrajectory(
        2 * s,
        np.column_stack([0.003 * np.sin(5 * s), 0.004 * np.sin(4 * s), 0.002 * np.sin(6 * s)]),
        Rotation.from_rotvec(0.2 * np.column_stack([np.sin(4 * s), 0 * s, np.sin(5 * s)])),
    )
    seen = Rotation.from_euler("z", heading + 0.17 * np.sin(2.5 * s))
    place = tissue.positions + tissue.rotations.apply(way)
    return ns.Bodies(knife=ns.PoseTrajectory(2 * s, place, tissue.rotations * seen), tissue=tissue)


@cache
def learned() -> ns.ConstrainedDMP:
    return ns.learn(cutting(), [CUT], basis_functions=50)


# -------------------------------------------------------------------- values


def test_bodies_are_poses_side_by_side_and_equal_by_value() -> None:
    rng = np.random.default_rng(0)
    a, b = wandering(rng), wandering(rng)
    both = ns.Bodies(a=a, b=b)
    assert both.names == ("a", "b")
    np.testing.assert_array_equal(both.positions, np.hstack([a.positions, b.positions]))
    np.testing.assert_array_equal(both.points[:, 6:], np.hstack([a.quaternions, b.quaternions]))
    assert both == ns.Bodies({"a": a, "b": b}) == pickle.loads(pickle.dumps(both))
    assert hash(both) == hash(ns.Bodies(a=a, b=b))
    assert both != ns.Bodies(b=b, a=a)
    assert both["b"] == b and both[3:9]["a"] == a[3:9]
    again = both.with_points(both.points)
    np.testing.assert_allclose(again.points, both.points, atol=1e-15)
    linear, angular = both.step_velocities()
    np.testing.assert_array_equal(linear[:, 3:], b.step_velocities()[0])
    np.testing.assert_array_equal(angular[:, :3], a.step_velocities()[1])


def test_bodies_that_were_not_sampled_together_meet_at_the_first_ones_times() -> None:
    rng = np.random.default_rng(1)
    a, b = wandering(rng), wandering(rng, 101)[20:90]
    both = ns.Bodies(a=a, b=b)
    assert b.times[0] <= both.times[0] and both.times[-1] <= b.times[-1]
    assert set(both.times) <= set(a.times)
    expected = b.resampled(times=both.times)
    np.testing.assert_allclose(both["b"].positions, expected.positions, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda a: ns.Bodies(a=a), "two bodies or more"),
        (lambda a: ns.Bodies({"a in b": a, "b": a}), "without ' in '"),
        (lambda a: ns.Bodies({"": a, "b": a}), "a text"),
        (lambda a: ns.Bodies(a=a, b=a.positions), "b must be a PoseTrajectory, got ndarray"),
        (lambda a: ns.Bodies(a=a, b=_later(a)), "at one time, got a 0 to 2 s, b 9 to 11 s"),
        (lambda a: ns.Bodies(a=a, b=a)["c"], "no body 'c'; there are a, b, a in b, b in a"),
    ],
)
def test_what_are_no_bodies_is_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make(wandering(np.random.default_rng(2)))


def _later(motion: ns.PoseTrajectory) -> ns.PoseTrajectory:
    return ns.PoseTrajectory(motion.times + 9, motion.positions, motion.rotations)


# -------------------------------------------------------------------- rules that refer to two


def _everything(motion: Any) -> Any:
    return [motion.linear_velocity[k] for k in range(3)] + [
        motion.angular_velocity[k] for k in range(3)
    ]


TWIST = relative_to(ns.velocity_constraint(_everything), "a", "b")


@options(max_examples=20, deadline=None)
@given(seed=seeds)
def test_a_body_is_seen_from_another_as_mechanics_says(seed: int) -> None:
    """Oracle: v' = R_b^T (v_a - v_b - w_b x d), w' = R_b^T (w_a - w_b), in NumPy."""
    rng = np.random.default_rng(seed)
    both = ns.Bodies(a=wandering(rng), b=wandering(rng))
    system = ConstraintSystem([TWIST], both.space)
    v, w = rng.normal(size=(2, 6))
    k = int(rng.integers(len(both)))
    found = system.residuals(0.0, both.positions[k], both.quaternions[k], v, w)[0]
    d = both.positions[k, :3] - both.positions[k, 3:]
    back = both["b"].rotations[k].inv()
    expected = [
        *back.apply(v[:3] - v[3:] - np.cross(w[3:], d)),
        *back.apply(w[:3] - w[3:]),
    ]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@options(max_examples=10, deadline=None)
@given(seed=seeds)
def test_steps_of_a_body_in_another_are_those_of_its_relative_poses(seed: int) -> None:
    """A rule about two bodies holds exactly where the rule of one holds of the relative motion."""
    rng = np.random.default_rng(seed)
    both = ns.Bodies(a=wandering(rng), b=wandering(rng))
    found = step_residuals(both, [TWIST, relative_to(ns.DepthLimit(), "b", "a")])
    alone = step_residuals(both["a in b"], [TWIST.inner])
    np.testing.assert_allclose(found[:, :6], alone, atol=1e-9)
    depth = step_residuals(both["b in a"], [ns.DepthLimit()])
    np.testing.assert_allclose(found[:, 6:], depth, atol=1e-12)


def test_accelerations_are_those_of_the_relative_motion() -> None:
    """Oracle: differences of the velocities along a motion of known accelerations."""
    rng = np.random.default_rng(3)

    @ns.keep_nonnegative(level="acceleration")
    def pushed(motion: Any) -> Any:
        return [motion.linear_acceleration[k] for k in range(3)] + [
            motion.angular_acceleration[k] for k in range(3)
        ]

    space = ns.Bodies(a=wandering(rng), b=wandering(rng)).space
    system = ConstraintSystem([relative_to(pushed, "a", "b")], space)
    twist = ConstraintSystem([TWIST], space)
    x, v, a, w, alpha = rng.normal(size=(5, 6))
    q = np.hstack([Rotation.random(random_state=k).as_quat() for k in (1, 2)])
    h = 1e-4

    def seen(t: float) -> Any:
        turned = np.concatenate(
            [
                (
                    Rotation.from_rotvec(t * w[k : k + 3] + t**2 / 2 * alpha[k : k + 3])
                    * Rotation.from_quat(q[4 * k // 3 : 4 * k // 3 + 4], scalar_first=True)
                ).as_quat(scalar_first=True)
                for k in (0, 3)
            ]
        )
        moved = x + t * v + t**2 / 2 * a
        return twist.residuals(0.0, moved, turned, v + t * a, w + t * alpha)[0]

    found = system.residuals(0.0, x, q, v, w, a, alpha)[0]
    np.testing.assert_allclose(found, (seen(h) - seen(-h)) / (2 * h), rtol=1e-5, atol=1e-5)


def test_rules_of_bodies_are_values() -> None:
    for rule in (CUT, of(ns.SpeedLimit(0.2), "tissue"), HoldTogether("knife", "tissue")):
        assert restore(specification(rule)) == rule == pickle.loads(pickle.dumps(rule))
    assert OfBody("blade(lateral='z')", "knife") == of(ns.Blade(lateral="z"), "knife")
    assert of(ns.SpeedLimit(0.2), "tissue").radii == ns.SpeedLimit(0.2).radii
    for wrong, message in (
        (lambda: of(CUT, "knife"), "is of body 'knife in tissue' already"),
        (lambda: of(ns.Blade, "knife"), "call it: Blade()"),  # type: ignore[arg-type]
        (lambda: ns.check(cutting(), [of(ns.Blade(), "fork")]), "no body 'fork'"),
        (lambda: HoldTogether("a", "b", quaternion=(0.0, 0.0, 0.0, 0.0)), "not be zero"),
    ):
        with pytest.raises((ConstraintError, InputError), match=re.escape(message)):
            wrong()


# -------------------------------------------------------------------- a blade in tissue that moves


def test_a_knife_does_not_slip_in_tissue_that_moves() -> None:
    dmp, recorded = learned(), cutting()
    assert np.abs(step_residuals(recorded, [CUT])).max() > 1e-3
    motion = dmp.rollout()
    assert np.abs(motion.constraint_residuals).max() <= HELD
    assert np.abs(step_residuals(motion["knife in tissue"], [ns.Blade()])).max() <= HELD
    assert motion.end_error <= 1e-6 and motion.end_rotation_error <= 1e-6
    # The tissue, which could give way, stays near where it was.
    apart = np.linalg.norm(motion["tissue"].positions - recorded["tissue"].positions, axis=1)
    assert apart.max() <= 1e-3
    assert motion["tissue"].times is motion.times or np.array_equal(
        motion["tissue"].times, motion.times
    )
    assert pickle.loads(pickle.dumps(motion)) == motion
    np.testing.assert_array_equal(motion[5:9].margins.shape, (4, 0))


def test_goals_of_one_body_or_both_are_adapted_to() -> None:
    dmp = learned()
    knife, tissue = (dmp.rollout()[name] for name in ("knife", "tissue"))
    turn = Rotation.from_euler("z", 0.2)
    goals = {
        "knife": (knife.positions[-1] + [0.01, 0.004, 0], turn * knife.rotations[-1]),
        "tissue": (tissue.positions[-1] + [0, 0.005, 0.002], turn * tissue.rotations[-1]),
    }
    for named in ({"knife": goals["knife"]}, goals):
        motion = dmp.adapt(goal=named).rollout()
        wanted = {"tissue": (dmp.goal_position[3:], dmp.goal_rotation[1])} | named
        for name, (place, rotation) in wanted.items():
            np.testing.assert_allclose(motion[name].positions[-1], place, atol=1e-6)
            assert (motion[name].rotations[-1] * rotation.inv()).magnitude() <= 1e-5
        assert np.abs(step_residuals(motion["knife in tissue"], [ns.Blade()])).max() <= HELD
    with pytest.warns(CompromiseWarning, match="from its goal"):
        led = dmp.rollout(goal=goals)
    assert np.abs(led.constraint_residuals).max() <= HELD
    with pytest.raises(InputError, match="no body 'fork'; there are knife, tissue"):
        dmp.rollout(goal={"fork": goals["knife"]})
    with pytest.raises(InputError, match="goal of knife is a pair"):
        dmp.rollout(goal={"knife": knife.positions[-1]})


def test_many_motions_and_via_points_are_of_both_bodies() -> None:
    dmp = learned()
    motion = dmp.rollout()
    many = dmp.rollout_many(goals=[dmp.goal_position, dmp.goal_position])
    np.testing.assert_allclose(many[1]["tissue"].positions, motion["tissue"].positions, atol=1e-12)
    passed = motion.positions[100] + [0, 0.002, 0, 0, 0, 0.001]
    led = dmp.adapt(via=[(0.5, passed)]).rollout()
    np.testing.assert_allclose(led.positions[led.times.searchsorted(1.0)], passed, atol=1e-6)
    assert np.abs(led.constraint_residuals).max() <= HELD


def test_stepping_is_rolling_out_and_files_lose_nothing(tmp_path: Path) -> None:
    dmp = learned()
    motion, state = dmp.rollout(), dmp.initial_state()
    for _ in range(5):
        state = dmp.step(state, motion.period)
    np.testing.assert_allclose(state.position, motion.positions[5], atol=1e-12)
    read = ns.load_primitive(dmp.save(tmp_path / "cut.json"))
    assert read == dmp
    assert read.rollout() == motion


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) on this machine")
def test_both_bodies_step_in_c(tmp_path: Path, uncounted: None) -> None:
    dmp = learned()
    dmp.export_c(tmp_path, name="cut")
    strict = ["cc", "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O1"]
    parts = objects(tmp_path, ("noslip.c", "cut.c"), *strict)
    for main in ("test", "example"):
        (code,) = objects(tmp_path, (f"{main}.c",), *strict)
        command = ["cc", *map(str, parts), str(code), "-lm", "-o", main]
        subprocess.run(command, cwd=tmp_path, check=True)
    subprocess.run(["./test"], cwd=tmp_path, check=True)
    told = subprocess.run(["./example"], cwd=tmp_path, check=True, capture_output=True, text=True)
    head, *rows = told.stdout.split()
    assert head.split(",")[1:5] == ["knife.x", "knife.y", "knife.z", "tissue.x"]
    found = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(found[:, 1:], dmp.rollout().points, rtol=0, atol=1e-12)


def test_a_figure_says_what_became_of_the_rule() -> None:
    figure = learned().rollout().plot([CUT])
    assert "no slip" in figure._suptitle.get_text()
    assert [ax.get_title() for ax in figure.axes][1].startswith("knife in tissue")


# -------------------------------------------------------------------- laws of several bodies


def test_two_hands_hold_a_tray_to_a_goal_that_tears_at_it() -> None:
    s = np.linspace(0, 1, 101)
    u = eased(s)
    turn = Rotation.from_rotvec(np.column_stack([0.2 * np.sin(np.pi * u), 0 * u, 0.8 * u]))
    middle = np.column_stack([0.3 * u, 0.1 * np.sin(np.pi * u), 0 * u])
    hands = {
        name: ns.PoseTrajectory(s, middle + turn.apply([0, side, 0]), turn)
        for name, side in (("left", 0.2), ("right", -0.2))
    }
    both = ns.Bodies(hands)
    hold = HoldTogether.as_recorded(both, "left", "right")
    np.testing.assert_allclose(hold.position, [0, 0.4, 0], atol=1e-12)
    law, system = fit(both, basis_functions=30), ConstraintSystem([hold], both.space)
    rule = Rule(system, inverse_metric(system, "auto", None, 0.01))
    goal = {"left": (hands["left"].positions[-1] + [0.1, 0, 0.1], turn[-1])}
    free = rollout(law, no_rule(law.space), goal=goal)
    assert np.abs(step_residuals(free, [hold])).max() > 0.05
    held = rollout(law, rule, goal=goal)
    assert np.abs(held.constraint_residuals[1:]).max() <= 1e-9


def test_bodies_that_turn_round_wind_by_as_many_knots() -> None:
    s = np.linspace(0, 1, 201)
    still = ns.PoseTrajectory(s, np.outer(s, [0.1, 0, 0]), Rotation.identity(201))
    round_ = ns.PoseTrajectory(s, still.positions, Rotation.from_euler("z", 3 * np.pi * eased(s)))
    law = fit(ns.Bodies(still=still, round=round_), basis_functions=50)
    knots = {len(winding.quaternions) for winding in law.goal.windings}
    assert len(knots) == 1 and knots.pop() > 1
    motion = rollout(law, no_rule(law.space))
    turned = motion["round"].rotations * round_.rotations.inv()
    assert turned.magnitude().max() <= 2e-3
    assert motion["still"].rotations.magnitude().max() <= 1e-9
