"""A primitive of an arm's joints whose tool does not slip: learned, adapted, saved."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robots is not installed")

import noslip as ns
from measures import slip
from noslip import robots
from noslip.constraints import joint_limits
from noslip.errors import CompromiseWarning

from .arms import arc, published_motion

ARM = robots.panda()
CHAIN = robots.chain(ARM)


@cache
def demonstration() -> ns.Trajectory:
    """Joints of an arc before the arm, its edge up to 3 degrees off the path."""
    cut = arc(step=0.02)
    off = Rotation.from_euler("z", 0.05 * np.sin(4 * cut.times)[:, None])
    askew = ns.PoseTrajectory(cut.times, cut.positions, cut.rotations * off, name="arc")
    placed = robots.Placement.of(askew, [0.5, 0.0, 0.2]).apply(askew)
    joints = CHAIN.inverse(placed, ARM.home)
    return ns.Trajectory(placed.times, joints, CHAIN.joint_names, name="arc")


@cache
def learned() -> ns.ConstrainedDMP:
    return ns.learn(demonstration(), ns.Blade(), robot="panda")


def tool(motion: ns.Trajectory) -> ns.PoseTrajectory:
    """Of kinematics that are not the library's."""
    return published_motion(motion.times, motion.values)


def test_the_tool_does_not_slip_and_keeps_its_path() -> None:
    before = tool(demonstration())
    assert np.abs(slip(before)).max() > 1e-3
    for step in (None, 0.0137):
        motion = tool(learned().rollout(time_step=step))
        assert np.abs(slip(motion)).max() <= 1e-10
        fractions = motion.times / motion.times[-1] * before.duration
        there = before.resampled(times=np.minimum(fractions, before.times[-1]))
        assert np.linalg.norm(motion.positions - there.positions, axis=1).max() <= 1e-3


def test_joints_stay_within_limits_and_near_the_demonstration() -> None:
    motion = learned().rollout()
    report = ns.check(motion, joint_limits(CHAIN))
    assert report.satisfied
    nearest = np.abs(motion.values[:, None] - demonstration().values[None]).max(axis=2).min(axis=1)
    assert nearest.max() <= 0.1


def test_other_joints_as_the_goal_are_reached_without_slip() -> None:
    goal = learned().rollout().values[-1] + [0.02, 0.03, -0.02, 0.05, 0.0, 0.02, -0.04]
    adapted = learned().adapt(goal=goal)
    motion = adapted.rollout()
    assert np.abs(motion.values[-1] - goal).max() <= 1e-4
    assert np.abs(slip(tool(motion))).max() <= 1e-10


def test_it_is_saved_with_the_robot(tmp_path: Path) -> None:
    again = ns.load_primitive(learned().save(tmp_path / "arm.json"))
    assert again == learned()
    assert np.array_equal(again.rollout().values, learned().rollout().values)


@pytest.mark.parametrize("robot", [CHAIN, ARM], ids=["chain", "robot"])
def test_recorded_joints_are_read_as_those_of_the_robot(tmp_path: Path, robot: object) -> None:
    file = demonstration().to_csv(tmp_path / "joints.csv")
    read = ns.load_trajectory(file, robot=robot)
    assert read.carrier == CHAIN
    assert read.units == ("rad",) * 7
    assert np.array_equal(read.values, demonstration().values)
    assert np.abs(read.tool.positions - tool(read).positions).max() <= 1e-12


def test_limits_of_all_levels_are_held_by_taking_longer() -> None:
    hurried = demonstration()
    hurried = ns.Trajectory(0.2 * hurried.times, hurried.values, hurried.names, name="hurried")
    with pytest.warns(CompromiseWarning, match=r"takes .* instead of .*'joint \w+ limits'"):
        dmp = ns.learn(hurried, [ns.Blade(), *joint_limits(CHAIN)], robot="panda")
    motion = dmp.rollout()
    assert np.abs(slip(tool(motion))).max() <= 1e-10
    assert dmp.duration > hurried.duration
    # The law's joints, differenced by nothing of the library's.
    rates = np.diff(motion.values, axis=0) / np.diff(motion.times)[:, None]
    accelerations = np.diff(rates, axis=0) / motion.period
    shares = (
        (np.abs(rates) / CHAIN.velocity_limits).max(),
        (np.abs(accelerations) / CHAIN.acceleration_limits).max(),
    )
    assert 0.9 <= max(shares) <= 1 + 1e-6
    slower = learned().rollout()
    assert np.linalg.norm(motion.values[-1] - slower.values[-1]) <= 1e-3
