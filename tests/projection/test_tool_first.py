"""Joints that carry a tool, projected: the tool keeps its path, and the joints stay near."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from measures import slip
from noslip.boundary import Boundary
from noslip.chain import Chain, Joint
from noslip.constraints.joints import JointLimits
from noslip.errors import ConvergenceError

LINKS = (0.4, 0.3, 0.2, 0.1)
ARM = Chain(
    [Joint(f"j{k}", position=(length, 0, 0)) for k, length in enumerate((0.0, *LINKS[:-1]))],
    (LINKS[-1], 0, 0),
    name="planar",
)
"""Four hinges in a plane: one more than a pose of the plane takes."""


@cache
def demonstration() -> ns.Trajectory:
    """Joints of a cut of 0.4 m along a bend, whose edge is a little off its path."""
    share = np.linspace(0, 1, 101)
    eased = share**2 * (3 - 2 * share)
    heading = 0.3 + 0.8 * eased
    speed = 0.4 * np.gradient(eased, share)
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading), 0 * share])
    path = np.array([0.35, 0.1, 0]) + np.cumsum(velocity, axis=0) / len(share)
    turned = Rotation.from_euler("z", (heading + 0.1 * np.sin(6 * share))[:, None])
    tool = ns.PoseTrajectory(2 * share, path, turned)
    joints = ARM.inverse(tool, [-0.8, 1.2, 1.0, -1.0])
    return ns.Trajectory(tool.times, joints, ARM.joint_names, carrier=ARM)


@cache
def projected() -> ns.Trajectory:
    return ns.project_trajectory(demonstration(), ns.Blade()).trajectory


def apart(one: ns.Trajectory, other: ns.Trajectory) -> float:
    """How far the tool is from where it was, at most (m)."""
    return float(np.linalg.norm(one.tool.positions - other.tool.positions, axis=1).max())


def test_the_tool_does_not_slip_and_keeps_its_path() -> None:
    assert np.abs(slip(demonstration().tool)).max() > 0.01
    assert np.abs(slip(projected().tool)).max() <= 1e-12
    assert apart(projected(), demonstration()) <= 1e-4
    assert np.abs(projected().values - demonstration().values).max() < 0.15


def test_it_moves_as_it_would_if_nothing_carried_it() -> None:
    alone = ns.project_trajectory(demonstration().tool, ns.Blade()).trajectory
    ends = slice(0, 101, 100)
    assert np.abs(alone.positions - projected().tool.positions).max() <= 1e-9
    assert (alone.rotations * projected().tool.rotations.inv()).magnitude().max() <= 1e-9
    kept = ns.project_trajectory(demonstration(), ns.Blade(), start="position", end="position")
    there = kept.trajectory.tool.positions[ends] - demonstration().tool.positions[ends]
    assert np.abs(there).max() <= 1e-9


def test_redundant_joints_stay_as_near_as_they_can() -> None:
    """Along what leaves the tool where it is, nothing is nearer to the demonstration."""
    moved = projected().values - demonstration().values
    for q, change in zip(projected().values[::10], moved[::10], strict=True):
        # Of a plane, x, y and the angle.
        J = np.array(ARM._evaluated(q[None])[2][0])[[0, 1, 5]]
        (free,) = np.linalg.svd(J)[2][3:]
        assert abs(free @ change) <= 1e-6


def test_a_feasible_motion_of_joints_comes_back() -> None:
    again = ns.project_trajectory(projected(), ns.Blade())
    assert again.iterations <= 1
    assert np.abs(again.trajectory.values - projected().values).max() <= 1e-7


def test_limits_of_joints_are_kept_while_the_tool_keeps_its_path() -> None:
    """One joint may not go as far as it went: the redundant others take it over."""
    most = float(projected().values[:, 2].max()) - 0.1
    limit = JointLimits([None] * 4, [None, None, most, None])
    found = ns.project_trajectory(demonstration(), [ns.Blade(), limit])
    assert found.trajectory.values[:, 2].max() <= most + 1e-9
    assert np.abs(slip(found.trajectory.tool)).max() <= 1e-12
    assert apart(found.trajectory, demonstration()) <= 1e-3


def test_the_positions_of_the_tool_may_be_held() -> None:
    held = ns.project_trajectory(demonstration(), ns.Blade(), hold_position=True).trajectory
    assert apart(held, demonstration()) <= 1e-11
    assert np.abs(slip(held.tool)).max() <= 1e-11


def test_joints_at_the_ends_are_reached_to_the_bit() -> None:
    first, last = projected().values[[0, -1]]
    goal = last + [0.05, -0.1, 0.08, 0.02]
    ends = Boundary(0.0, first), Boundary(1.0, goal)
    found = ns.project_trajectory(
        demonstration(), ns.Blade(), start=ends[0], end=ends[1], position_weight=10.0
    ).trajectory
    assert np.array_equal(found.values[0], first)
    assert np.array_equal(found.values[-1], goal)
    assert np.abs(slip(found.tool)).max() <= 1e-11


def test_what_no_tool_can_do_is_told() -> None:
    """The tool of two slides cannot turn into its path."""
    table = Chain([Joint("x", "slide", (1, 0, 0)), Joint("y", "slide", (0, 1, 0))])
    share = np.linspace(0, 1, 50)
    values = np.column_stack([share, 0.3 * np.sin(3 * share)])
    across = ns.Trajectory(share, values, table.joint_names, carrier=table)
    found = ns.project_trajectory(across, ns.Blade(), on_failure="return").trajectory
    # It has no way but straight ahead.
    assert np.ptp(found.values[:, 1]) <= 1e-6
    with pytest.raises(ConvergenceError):
        ns.project_trajectory(across, ns.Blade(), start="pose", end="pose")
    with pytest.raises(ConvergenceError, match="no joints hold the positions of the tool: chain"):
        ns.project_trajectory(across, ns.Blade(), hold_position=True)


def test_limits_of_joints_alone_may_hold_the_tool_where_it_is() -> None:
    """What is redundant keeps the limit; no constraint of the tool asks for anything."""
    joints = demonstration().values
    most = float(joints[:, 2].max()) - 0.1
    limit = JointLimits([None] * 4, [None, None, most, None])
    found = ns.project_trajectory(demonstration(), limit).trajectory
    assert found.values[:, 2].max() <= most + 1e-9
    assert apart(found, demonstration()) <= 1e-3
