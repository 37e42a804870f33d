"""Tools that may not slip sideways, past obstacles: grazed, entered beside the middle, head-on."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from measures import slip
from motions import eased
from noslip import PoseTrajectory
from noslip.constraints import ConstraintSystem, KeepOutCapsule, PlaneContact
from noslip.projection.detour import around

SHORT = 1e-4
"""How far from its end a tool that passed an obstacle may stop, over the path's length."""


def straight(length: float, duration: float = 4.0) -> PoseTrajectory:
    s = np.linspace(0, 1, 501)
    path = np.outer(length * eased(s), [1, 0, 0])
    return PoseTrajectory(duration * s, path, Rotation.identity(len(s)), name="straight")


def sphere(beside: float) -> ns.Constraint:
    return ns.KeepOutSphere(center=(0.1, beside, 0), radius=0.02)


def capsule(beside: float) -> ns.Constraint:
    return KeepOutCapsule(start=(0.55, beside, -1), end=(0.55, beside, 1), radius=0.12)


CASES: dict[str, tuple[float, list[ns.Constraint]]] = {
    "blade grazes a sphere": (0.2, [ns.Blade(), sphere(0.019)]),
    "blade on a table grazes a sphere": (0.2, [ns.Blade(), PlaneContact(), sphere(0.019)]),
    "needle grazes a sphere": (0.2, [ns.Needle(), sphere(0.019)]),
    "wheel enters a capsule": (1.0, [ns.Wheel(), capsule(0.05)]),
    "wheel meets a capsule head-on": (1.0, [ns.Wheel(), capsule(0.0)]),
    "wheel meets a capsule all but head-on": (1.0, [ns.Wheel(), capsule(1e-12)]),
    "blade meets a sphere head-on": (0.2, [ns.Blade(), sphere(0.0)]),
    "blade on a table meets a sphere head-on": (0.2, [ns.Blade(), PlaneContact(), sphere(0.0)]),
    "blade meets a sphere all but head-on": (0.2, [ns.Blade(), sphere(0.001)]),
    "a point meets a sphere head-on": (0.2, [sphere(0.0)]),
}


@cache
def learned(name: str) -> ns.ConstrainedDMP:
    length, rules = CASES[name]
    return ns.learn(straight(length), rules)


@pytest.mark.parametrize("name", CASES)
def test_the_tool_passes_the_obstacle_and_arrives_at_any_step(name: str) -> None:
    length, rules = CASES[name]
    dmp = learned(name)
    assert dmp.record[0].left_out == ()
    limits = [rule for rule in rules if rule.relation == "nonnegative"]
    for step in (None, 1e-3, 7e-3):
        motion = dmp.rollout(time_step=step)
        assert np.linalg.norm(motion.positions[-1] - [length, 0, 0]) <= SHORT * length
        assert motion.margins.min() >= 0
        # Nor between the samples: it does not leap.
        middles = (motion.positions[1:] + motion.positions[:-1]) / 2
        still = np.zeros((len(middles), 3))
        between = ConstraintSystem(limits).residuals(
            motion.times[1:], middles, motion.quaternions[1:], still, still
        )
        assert between.min() >= -1e-4 * length
        if len(rules) > 1:
            assert np.abs(slip(motion)).max() <= 1e-9
    # No detour wider than a third more than what is in the way.
    way = limits[0].radius - abs(beside(limits[0]))  # type: ignore[attr-defined]
    assert np.abs(dmp.rollout().positions[:, 1]).max() <= 1.35 * way
    np.testing.assert_allclose(dmp.rollout().positions[:, 2], 0, atol=1e-6)


def beside(limit: Any) -> float:
    return float(limit.center[1] if isinstance(limit, ns.KeepOutSphere) else limit.start[1])


def test_adapted_to_a_goal_behind_an_obstacle_the_tool_arrives() -> None:
    # Demonstrated where nothing is in the way.
    dmp = ns.learn(
        straight(0.2), [ns.Blade(), ns.KeepOutSphere(center=(0.1, 0.05, 0), radius=0.02)]
    )
    goal = [0.2, 0.1, 0]
    motion = dmp.adapt(goal_position=goal).rollout()
    assert np.linalg.norm(motion.positions[-1] - goal) <= SHORT * 0.2
    assert motion.margins.min() >= 0


def test_what_keeps_clear_of_obstacles_stays_to_the_bit() -> None:
    motion = straight(0.2)
    assert around(motion, ConstraintSystem([ns.Blade(), sphere(0.03)]), 0.0) is motion
    # The nearest way out leads aside.
    assert around(motion, ConstraintSystem([ns.Blade(), sphere(0.019)]), 0.0) is motion


@pytest.mark.parametrize("yaw", [0.0, 1.0, 3.0])
def test_head_on_it_passes_on_the_tools_left_wherever_that_is(yaw: float) -> None:
    turn = Rotation.from_euler("z", yaw)
    motion = straight(0.2)
    turned = PoseTrajectory(motion.times, turn.apply(motion.positions), turn * motion.rotations)
    ahead = ns.KeepOutSphere(center=turn.apply([0.1, 0, 0]), radius=0.02)
    passed = turn.inv().apply(around(turned, ConstraintSystem(ahead), 0.0).positions)
    assert passed[:, 1].max() == pytest.approx(0.022, rel=0.01)
    assert passed[:, 1].min() >= -1e-12
    np.testing.assert_array_equal(passed[[0, -1]].round(12), motion.positions[[0, -1]].round(12))


def test_a_wall_across_the_path_is_not_passed() -> None:
    wall = ns.constraints.HalfSpace(point=(0.1, 0, 0), normal=(-1, 0, 0))
    motion = straight(0.2)
    assert around(motion, ConstraintSystem(wall), 0.0) is motion
