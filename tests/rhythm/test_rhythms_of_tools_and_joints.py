"""Rhythms of two tools, and of joints that carry a blade."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from kinds import ARM
from noslip.constraints import of
from noslip.constraints.check import step_residuals

PERIOD = 2.0


def _saw(wavering: float) -> ns.PoseTrajectory:
    """To and fro along a bow in the plane, held a little off its path."""
    times = np.linspace(0.0, PERIOD, 101)
    angle = 2 * np.pi * times / PERIOD
    x = 0.06 * np.cos(angle)
    yaw = np.arctan(4 * x) + wavering * np.sin(2 * angle + 1)
    path = np.stack([x, 2 * x**2, 0 * x], axis=1)
    return ns.PoseTrajectory(times, path, Rotation.from_euler("z", yaw), name="saw")


def _joints() -> ns.Trajectory:
    saw = _saw(0.05)
    tool = saw.with_points(saw.points + [0.45, 0.1, 0, 0, 0, 0, 0])
    joints = ARM.inverse(tool, [-0.8, 1.2, 1.0, -1.0])
    # Inverse kinematics follow a branch, which comes back to where it began but for its tolerance.
    return ns.Trajectory(tool.times, joints, ARM.joint_names, carrier=ARM)


def _tools() -> ns.Bodies:
    """A knife that saws, and what holds the work and gives way to it."""
    knife = _saw(0.05)
    aside = knife.points[:1] + np.zeros((len(knife), 7))
    aside[:, 1] += 0.2 + 0.01 * np.sin(2 * np.pi * knife.times / PERIOD)
    return ns.Bodies(knife=knife, holder=knife.with_points(aside))


@cache
def _learned(kind: str) -> ns.ConstrainedDMP:
    recorded: Any = {"joints": _joints, "tools": _tools}[kind]()
    rule = {"joints": ns.Blade(), "tools": of(ns.Blade(), "knife")}[kind]
    return ns.learn(recorded, rule, rhythmic=True, basis_functions=20)


def _slip(motion: Any, kind: str) -> float:
    tool = ARM.poses(motion.times, motion.values) if kind == "joints" else motion["knife"]
    return float(np.abs(step_residuals(tool, ns.Blade())).max())


@pytest.mark.parametrize("kind", ["joints", "tools"])
def test_it_goes_round_without_slip_or_drift(kind: str) -> None:
    dmp = _learned(kind)
    motion = dmp.rollout(cycles=4)
    assert _slip(motion, kind) <= 1e-10
    periods = motion.points[:: dmp.steps]
    away = dmp.law.space.difference(periods[1:], np.tile(periods[:1], (4, 1)))
    assert np.abs(away).max() <= 1e-10
    # As it was shown: the blade is turned into its path, which stays.
    shown = _saw(0.0)
    tool = ARM.poses(motion.times, motion.values) if kind == "joints" else motion["knife"]
    offset = [0.45, 0.1, 0] if kind == "joints" else 0.0
    own = tool.positions[: dmp.steps : dmp.steps // 100] - offset
    assert np.linalg.norm(own - shown.positions[:-1], axis=1).max() <= 0.01


@pytest.mark.parametrize("kind", ["joints", "tools"])
def test_it_is_another_frequency_and_in_a_loop_the_same(kind: str) -> None:
    dmp = _learned(kind)
    slower = dmp.rollout(duration=3 * PERIOD)
    np.testing.assert_allclose(slower.points, dmp.rollout().points, atol=1e-9)
    assert _slip(slower, kind) <= 1e-10
    h = dmp.duration / dmp.steps
    loop = dmp.controller(time_step=h)
    for _ in range(60):
        command = loop.step()
    np.testing.assert_allclose(
        command.position, dmp.rollout().points[60][: len(command.position)], atol=1e-9
    )


def test_it_is_saved(tmp_path: Path) -> None:
    for kind in ("joints", "tools"):
        dmp = _learned(kind)
        assert ns.load_primitive(dmp.save(tmp_path / f"{kind}.json")) == dmp
