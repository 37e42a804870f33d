"""Figures of the arm: what they show is what was computed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robots is not installed")
pytest.importorskip("daqp", reason="the extra robots is not installed")

import noslip as ns
from motions import eased
from noslip import robots
from noslip.figures import executed_slip, joint_limits


@pytest.fixture(scope="module")
def tracked() -> robots.TrackedMotion:
    s = np.linspace(0, 1, 501)
    u = eased(s)
    motion = ns.PoseTrajectory(s, u[:, None] * [0.1, 0, 0], Rotation.identity(501), name="line")
    arm = robots.panda()
    placement = robots.Placement(np.array([0.4, 0.0, 0.3]), Rotation.identity())
    return robots.track(arm, motion, ns.Blade(), placement=placement, start=arm.home)


def test_joints_are_shown_as_shares_of_their_limits(tracked: robots.TrackedMotion) -> None:
    figure = joint_limits(tracked)
    places, rates, gains = figure.axes
    arm = tracked.robot
    shown = np.array([line.get_ydata() for line in rates.lines[:7]]).T
    assert np.allclose(shown, tracked.joint_velocities / arm.velocity_limits)
    shown = np.array([line.get_ydata() for line in places.lines[:7]]).T
    assert np.allclose(
        (shown + 1) / 2 * (arm.upper - arm.lower) + arm.lower, tracked.joint_positions
    )
    assert all(np.abs(line.get_ydata()).max() <= 1 for ax in figure.axes for line in ax.lines)
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [*arm.joint_names, "limits"]
    least, whose = tracked.margins.smallest
    assert whose in figure.get_suptitle()
    assert f"{least:.0%}" in figure.get_suptitle()
    assert gains.get_ylabel().startswith("acceleration")


def test_slip_and_errors_of_both_executions_are_shown(tracked: robots.TrackedMotion) -> None:
    done = robots.execute(tracked, noise=1.0)
    figure = executed_slip(tracked, done)
    slip, along, lateral, depth, angle, way = figure.axes
    assert np.allclose(slip.lines[1].get_ydata(), np.abs(done.slip[:, 0]))
    for ax, values in ((along, done.errors.along), (lateral, done.errors.lateral)):
        assert np.allclose(ax.lines[1].get_ydata(), 1e3 * values)
    assert np.allclose(depth.lines[0].get_ydata(), 1e3 * tracked.errors.depth)
    assert np.allclose(angle.lines[1].get_ydata(), np.degrees(done.errors.rotation))
    assert way.lines[1].get_ydata()[-1] == pytest.approx(1e3 * done.slip_distance[0])
    [legend] = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == ["kinematic", "dynamic, torque control"]
    assert len(executed_slip(tracked, title="mine").axes[0].lines) == 1
    assert executed_slip(tracked, title="mine").get_suptitle() == "mine"
