"""The loop of any space: steps like a rollout, waits for what lags, leads back what was pushed."""

from __future__ import annotations

import pickle
from copy import copy
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from kinds import ARM, KINDS, learned
from motions import eased
from noslip._typing import Floats
from noslip.constraints import JointLimits
from noslip.control import SpaceController
from noslip.control.coordinates import EASE, FASTER, GIVEN_UP, LAG, PERSIST, SILENT
from noslip.errors import InputError
from strategies import seeds

H = 0.02
HELD = 1e-10


@cache
def tools() -> ns.ConstrainedDMP:
    """Two tools that come to rest, one of which turns."""
    s = np.linspace(0, 1, 61)
    u = eased(s)
    place = np.column_stack([0.2 * u, 0.05 * np.sin(np.pi * u), 0 * u])
    knife = ns.PoseTrajectory(2 * s, place, Rotation.from_rotvec(np.outer(u, [0, 0, 0.8])))
    tissue = ns.PoseTrajectory(2 * s, -0.3 * place, knife.rotations.inv())
    return ns.learn(ns.Bodies(knife=knife, tissue=tissue), [], basis_functions=20)


def primitive(kind: str) -> ns.ConstrainedDMP:
    return tools() if kind == "tools" else learned(kind)


def loop_of(kind: str, **options: Any) -> SpaceController:
    loop = primitive(kind).controller(time_step=H, **options)
    assert isinstance(loop, SpaceController)
    return loop


class Robot:
    """Follows its command with a lag of the first order, and stays where it is pushed to."""

    def __init__(self, loop: SpaceController, lag: float = 0.0) -> None:
        self.loop, self.at, self.commands = loop, loop.state.position.copy(), [loop.state]
        self.share = 1 - np.exp(-H / lag) if lag else 1.0
        self.held = False

    def cycle(self, off: Any = 0.0, goal: Any = None, *, sees: bool = True) -> None:
        command = self.loop.step(self.at + off if sees else None, goal)
        self.commands.append(command)
        if not self.held:
            self.at = self.at + self.share * (command.position - self.at)

    @property
    def path(self) -> Floats:
        return np.array([command.position for command in self.commands])

    @property
    def residual(self) -> float:
        return max(np.abs(each.constraint_residuals).max(initial=0) for each in self.commands)


def jerk(path: Floats) -> float:
    """Largest, without the last step, which may be shorter."""
    return float(np.abs(np.diff(path[:-1], 3, axis=0)).max() / H**3)


@pytest.mark.parametrize("kind", ["vectors", "joints", "rhythms", "tools"])
@pytest.mark.parametrize("step", [H, 0.0137])
def test_without_measurements_it_is_the_rollout(kind: str, step: float) -> None:
    dmp = primitive(kind)
    motion = dmp.rollout(time_step=step, **({"cycles": 2} if kind == "rhythms" else {}))
    loop = dmp.controller(time_step=step)
    commands = [loop.step() for _ in motion.times[1:]]
    points = [np.append(each.position, each.quaternion) for each in commands]
    # A loop knows no last, shorter step of a rhythm.
    alike = slice(None, -1 if kind == "rhythms" else None)
    np.testing.assert_allclose(points[alike], motion.points[1:][alike], atol=1e-12)
    if kind != "rhythms":
        assert loop.done and commands[-1].done
        np.testing.assert_array_equal(loop.step().position, commands[-1].position)


def test_compiled_it_makes_the_same_motion(compiling: Any) -> None:
    goal = learned("vectors").goal_position + 0.1
    paths = []
    for _ in range(2):
        loop = loop_of("vectors")
        paths.append([loop.step(None, goal).position for _ in range(150)])
        compiling = learned("vectors").compile()
    assert compiling
    np.testing.assert_allclose(*paths, atol=1e-9)


@settings(max_examples=6, deadline=None)
@given(seeds, st.sampled_from(["vectors", "joints", "rhythms"]), st.floats(0.0, 0.05))
def test_lag_noise_and_bias_neither_stop_nor_shake_it(seed: int, kind: str, lag: float) -> None:
    dmp, rng = primitive(kind), np.random.default_rng(seed)
    loop = loop_of(kind)
    robot = Robot(loop, lag)
    bias = 0.4 * loop.tolerance * rng.uniform(-1, 1, len(robot.at))
    for _ in range(round(1.3 * dmp.duration / H)):
        robot.cycle(bias + 1e-3 * rng.normal(size=len(bias)))
        if loop.done:
            break
    assert loop.done != dmp.law.clock.returns
    assert loop.taken_over == 0
    assert robot.residual <= HELD
    assert jerk(robot.path) <= 1.5 * jerk(dmp.rollout(time_step=H).positions)


@settings(max_examples=6, deadline=None)
@given(st.floats(0.1, 1.2), seeds)
def test_what_was_pushed_and_stays_is_led_back(when: float, seed: int) -> None:
    """Also in the last moment, and after the end; the clock goes on as it was."""
    dmp, rng = primitive("vectors"), np.random.default_rng(seed)
    loop = loop_of("vectors")
    robot = Robot(loop)
    pushed, held = when * dmp.duration, 0.5
    place = None
    for k in range(round(4 * dmp.duration / H)):
        if pushed <= k * H < pushed + held:
            if place is None:
                # Off the path: what is pushed along it is just early, or late.
                place = robot.at + 0.2 * rng.choice([-1, 1]) * np.array([1, -1, 1])
            robot.at, robot.held = place, True
        else:
            robot.held = False
        robot.cycle()
        if loop.done and place is not None and not robot.held:
            break
    assert loop.taken_over >= 1
    assert loop.done
    assert np.abs(robot.at - dmp.goal_position).max() <= 1e-3
    assert loop.speed > 0.99


def test_a_knock_is_not_taken_over_and_a_force_is_once() -> None:
    for seconds, times in ((0.5 * PERSIST, 0), (3.0, 1)):
        loop = loop_of("vectors")
        robot = Robot(loop)
        for _ in range(50):
            robot.cycle()
        for _ in range(round(seconds / H)):
            # A spring that a hand loads: as far off the command, wherever that goes.
            robot.cycle(0.3)
        assert loop.taken_over == times
        assert times == 0 or "off by" in loop.reason


def test_the_clock_waits_for_a_robot_that_stands_and_goes_on_with_it() -> None:
    dmp, loop = primitive("vectors"), loop_of("vectors")
    robot = Robot(loop)
    for _ in range(40):
        robot.cycle()
    robot.held = True
    for _ in range(round(1.5 * LAG / H)):
        robot.cycle()
    slowed = loop.speed
    robot.held = False
    while not loop.done:
        robot.cycle()
        assert len(robot.commands) * H < 2 * dmp.duration
    assert slowed < 0.95
    assert loop.taken_over == 0
    free = dmp.rollout(time_step=H).positions
    assert jerk(robot.path) <= 3 * jerk(free)
    assert np.abs(robot.at - dmp.goal_position).max() <= 1e-3


@settings(max_examples=8, deadline=None)
@given(st.floats(0.0, 1.1), seeds)
def test_goals_are_reached_smoothly_however_late_they_come(when: float, seed: int) -> None:
    dmp, rng = primitive("vectors"), np.random.default_rng(seed)
    goal, loop = dmp.goal_position + rng.uniform(-0.2, 0.2, 3), loop_of("vectors")
    robot = Robot(loop)
    for k in range(round(3 * dmp.duration / H)):
        robot.cycle(goal=goal if k * H >= when * dmp.duration else None)
        if loop.done and k * H > when * dmp.duration:
            break
    assert loop.done
    assert np.abs(robot.at - goal).max() <= 1e-3
    # That of the demonstration, and of the filter: displacement over its time constant cubed.
    most = jerk(dmp.rollout(time_step=H).positions)
    assert jerk(robot.path) <= most + 0.2 / (EASE * dmp.duration) ** 3 / 5


def test_a_rhythm_goes_on_about_the_goal_it_is_given() -> None:
    dmp, loop = primitive("rhythms"), loop_of("rhythms")
    period = round(dmp.duration / H)
    goal = dmp.goal_position + [0.3, -0.2]
    path = np.array([loop.step(None, goal).position for _ in range(6 * period)])
    np.testing.assert_allclose(path[-period:], path[-2 * period : -period], atol=1e-9)
    own = dmp.rollout(time_step=H, cycles=1).positions[1:]
    np.testing.assert_allclose(path[-period:], own + [0.3, -0.2], atol=1e-3)
    assert not loop.done


@settings(max_examples=4, deadline=None)
@given(seeds)
def test_joints_that_are_pushed_come_to_another_goal_under_their_blade(seed: int) -> None:
    """Where the law would end is where the blade lets it; a plan ends at the goal."""
    dmp, rng = primitive("joints"), np.random.default_rng(seed)
    loop = loop_of("joints")
    robot = Robot(loop, 0.03)
    pushed = rng.uniform(0.1, 1.1) * dmp.duration
    other = dmp.goal_position + 0.05 * rng.uniform(-1, 1, 4)
    taken, was_held = [0], False
    for k in range(round(10 * dmp.duration / H)):
        robot.held = pushed <= k * H < pushed + 0.4
        if robot.held and not was_held:
            robot.at = robot.at + 0.05 * rng.choice([-1, 1], 4)
        was_held = robot.held
        goal = other if k * H > pushed else None
        robot.cycle(1e-3 * rng.normal(size=4), goal)
        taken.append(loop.taken_over)
        if loop.done and k * H > pushed + 0.4:
            break
    assert loop.done
    assert np.abs(robot.path[-1] - other).max() <= 1e-3
    assert loop.replanned[-1].failure == loop.reason == ""
    assert robot.residual <= HELD
    # The tool's own slip, of each step but where the command moves to what was measured.
    places, turns = ARM.forward(robot.path)
    half = Rotation.from_rotvec((turns[:-1].inv() * turns[1:]).as_rotvec() / 2)
    lateral = (turns[:-1] * half).apply([0, 1, 0])
    slip = np.sum(np.diff(places, axis=0) * lateral, axis=1) / H
    assert taken[-1] > 0
    assert np.abs(slip[np.diff(taken) == 0]).max() <= HELD
    # As fast as bounds allow, and what the attractor makes of a push while a plan is sought.
    rates = np.linalg.norm(np.diff(robot.path, axis=0), axis=1)[np.diff(taken) == 0] / H
    own = np.linalg.norm(dmp.rollout().linear_velocities, axis=1).max()
    assert rates.max() <= 2 * FASTER * own


def test_without_plans_it_ends_where_the_blade_lets_it() -> None:
    dmp = primitive("joints")
    loop = dmp.controller(time_step=H, replan=False)
    goal = dmp.goal_position + [0.05, -0.05, 0.05, 0.05]
    while not loop.done:
        state = loop.step(None, goal)
    assert not loop.replanned
    assert np.abs(state.position - goal).max() > 5e-3


def test_a_goal_that_no_plan_comes_to_is_told_and_given_up() -> None:
    """Beyond a limit: as close as another goal, but not allowed."""
    cut = KINDS["joints"].demonstration()
    most = cut.values.max(axis=0) + 0.02
    limit = JointLimits((-9.0,) * 4, tuple(most))
    dmp = ns.learn(cut, [ns.Blade(), limit], basis_functions=30)
    loop = dmp.controller(time_step=H)
    goal = np.where(np.arange(4) == np.argmax(cut.values[-1] - most), most + 0.05, cut.values[-1])
    while not loop.done:
        state = loop.step(None, goal)
    assert len(loop.replanned) == GIVEN_UP
    assert "goal violates" in loop.reason
    assert np.abs(state.position - dmp.goal_position).max() <= 1e-3


def test_tools_are_led_to_the_poses_that_are_asked_for() -> None:
    dmp, loop = primitive("tools"), loop_of("tools")
    turn = Rotation.from_rotvec([0.1, 0.2, 0.6])
    pose = np.array([0.25, 0.02, 0.03]), turn
    state = loop.state
    for k in range(round(3 * dmp.duration / H)):
        state = loop.step(state, {"knife": pose} if k > 20 else None)
        if loop.done:
            break
    assert loop.done
    np.testing.assert_allclose(state.position[:3], pose[0], atol=1e-3)
    assert (state.rotation[0] * turn.inv()).magnitude() <= 2e-3
    # A tool that was turned by hand is seen by its turn.
    loop.reset()
    aside = loop.state.position, Rotation.from_rotvec([0, 0, 0.3]) * loop.state.rotation
    for _ in range(round(PERSIST / H) + 2):
        loop.step(aside)
    assert loop.taken_over == 1


def test_it_waits_for_a_sensor_that_falls_silent() -> None:
    loop = loop_of("vectors")
    robot = Robot(loop)
    for k in range(100):
        robot.cycle(sees=k < 30)
    assert loop.speed < 0.01
    assert "nothing was measured" in loop.reason
    robot.cycle()
    assert loop.reason == ""
    assert SILENT >= LAG


def test_copies_go_their_own_way_and_are_equal() -> None:
    loop = loop_of("vectors")
    for _ in range(30):
        loop.step(loop.state.position + 0.08, primitive("vectors").goal_position + 0.1)
    twins = copy(loop), pickle.loads(pickle.dumps(loop))
    assert all(twin == loop for twin in twins)
    after = [each.step().position for each in (loop, *twins)]
    np.testing.assert_array_equal(after[0], after[1])
    np.testing.assert_array_equal(after[0], after[2])
    loop.step()
    assert loop != twins[0]


@pytest.mark.parametrize(
    ("kind", "call"),
    [
        ("vectors", lambda loop: loop.step([0.0, np.nan, 0.0])),
        ("vectors", lambda loop: loop.step([0.0, 0.0])),
        ("vectors", lambda loop: loop.step(None, [0.0, np.inf, 0.0])),
        ("vectors", lambda loop: loop.step(None, "there")),
        ("vectors", lambda loop: loop.step(time_step=0.0)),
        ("tools", lambda loop: loop.step([0.0] * 6)),
        ("tools", lambda loop: loop.step({"knife": (np.zeros(3), Rotation.identity())})),
        ("tools", lambda loop: loop.step((np.zeros(6), Rotation.identity()))),
        ("vectors", lambda loop: loop_of("vectors", tolerance=[1.0, -1.0, 1.0])),
        ("vectors", lambda loop: loop_of("vectors", tolerance=0.0)),
        ("rhythms", lambda loop: ns.Controller(primitive("rhythms"), time_step=H)),
        ("vectors", lambda loop: ns.Controller(primitive("vectors"), time_step=H)),
    ],
)
def test_what_is_not_of_its_kind_is_refused_in_one_line(kind: str, call: Any) -> None:
    loop = loop_of(kind)
    before = loop.state
    with pytest.raises(InputError) as told:
        call(loop)
    assert "\n" not in str(told.value)
    assert loop.state == before
