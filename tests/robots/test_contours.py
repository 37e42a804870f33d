"""Recorded contours, learned and executed by the arm: the person slipped, the arm does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra robots is not installed")
pytest.importorskip("daqp", reason="the extra robots is not installed")

import noslip as ns
from measures import slip
from noslip import robots

from .arms import published_motion
from .test_tracking import assert_kept

pytestmark = pytest.mark.recordings
BLADE = ns.Blade()
QUICK = ("a_1", "c_2")
NAMES = ["a_1", "c_2", "d_1"]
"""Of three placements of the contour one of two recordings each."""
LOWPASS = 2.0
"""Hz, as the other recordings are learned."""
BETTER = 10.0
"""Times that the arm slips less than the person."""


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in NAMES],
)
def test_a_contour_is_executed_without_slip(recordings: Path, name: str) -> None:
    file = recordings / "contour_following" / f"data_demo_{name}.csv"
    [person] = ns.load_demonstrations(file)
    demonstration = ns.prepare(person, lowpass=LOWPASS)
    motion = ns.learn(demonstration, BLADE).rollout(time_step=1e-3)
    tracked = robots.track(robots.panda(), motion, BLADE, level="tool")
    assert_kept(tracked)
    assert tracked.margins.smallest[0] > 0.02
    # In front of the arm, above its table.
    assert np.all(tracked.executed.positions[:, 2] >= 0.005 - 1e-9)
    assert tracked.placement.middle(motion)[0] > 0.1
    # As learned: only the ramps, half of each, are added.
    assert tracked.times[-1] == pytest.approx(motion.duration + robots.RAMP, abs=2e-3)
    assert tracked.commanded.path_length == pytest.approx(motion.path_length, rel=1e-3)

    # The filter has taken slip out of the recording: the arm has to beat what is left, too.
    slipped = {
        "person": slip_distance(person),
        "filtered": slip_distance(demonstration),
    }
    assert slipped["person"] > slipped["filtered"] > 0.01
    ideal = robots.execute(tracked)
    real = robots.execute(tracked, noise=1.0, delay=0.001)
    for done in (ideal, real):
        executed = published_motion(tracked.times, done.joint_positions)
        way = float(np.abs(slip(executed)) @ np.diff(tracked.times))
        assert done.slip_distance[0] == pytest.approx(way, rel=1e-6)
        assert way * BETTER <= slipped["filtered"]
        assert done.errors.position.max() <= 1e-4
        assert done.distance >= 0.005 - 1e-4
        assert np.all(done.torque_share < 1)
        assert_inside(tracked.robot, done)


def slip_distance(motion: ns.PoseTrajectory) -> float:
    return float(np.abs(slip(motion)) @ np.diff(motion.times))


def assert_inside(arm: robots.Robot, done: robots.Execution) -> None:
    q = done.joint_positions
    assert np.all((q > arm.lower) & (q < arm.upper))
    assert np.all(np.abs(done.joint_velocities) < arm.velocity_limits)
