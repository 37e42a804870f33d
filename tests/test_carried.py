"""Whatever takes a motion with channels, and makes another of it, gives them back."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import planar_cut
from noslip.bodies import Bodies
from noslip.constraints.system import ConstraintSystem
from noslip.demonstrations.alignment import align
from noslip.demonstrations.cycles import closed
from noslip.errors import InputError
from noslip.identification.calibration import synchronized
from noslip.law.fitting import evenly_sampled
from noslip.recordings import write_recording
from noslip.robots.placement import Placement
from noslip.robots.timing import timed
from noslip.runtime.timing import stretched
from noslip.series import Series
from noslip.shielding.datasets import shielded
from refusals import refusal

Made = Callable[[ns.PoseTrajectory], Any]


def with_clock(motion: ns.PoseTrajectory) -> ns.PoseTrajectory:
    """A motion beside which its own time stands, as seconds since its beginning, and as a share."""
    told = np.column_stack([motion.clock, motion.clock / motion.duration])
    beside = ns.Trajectory(motion.times, told, names=["told", "share"], units=("s", "1"))
    return motion.with_channels(beside)


@cache
def cut() -> ns.PoseTrajectory:
    return with_clock(planar_cut(0.3))


def there_and_back() -> ns.PoseTrajectory:
    one = planar_cut(0.3, count=61)
    points = np.vstack([one.points, one.points[-2::-1]])
    times = np.linspace(0.0, 4.0, len(points))
    turns = Rotation.from_quat(points[:, 3:], scalar_first=True)
    return with_clock(ns.PoseTrajectory(times, points[:, :3], turns))


@cache
def primitive() -> ns.ConstrainedDMP:
    return ns.learn(cut(), [ns.Blade()], basis_functions=30)


def chunked(motion: ns.PoseTrajectory) -> ns.PoseTrajectory:
    shield = ns.Shield([ns.Blade()], rate=1 / motion.period)
    return shield.chunk(motion[20:60])


def read_back(motion: ns.PoseTrajectory, folder: Path, name: str) -> ns.PoseTrajectory:
    asked = {} if name.endswith("npz") else {"channels": "told,share"}
    return ns.load_demonstrations(write_recording(motion, folder / name), **asked)[0]


SAME_TIME: dict[str, Made] = {
    "a slice": lambda m: m[10:90],
    "other points": lambda m: m.with_points(m.points),
    "other velocities": lambda m: m.with_velocities(
        0 * m.linear_velocities, 0 * m.angular_velocities
    ),
    "resampled": lambda m: m.resampled(rate=70),
    "prepare": lambda m: ns.prepare(
        m, trim_time=(0.2, 1.8), trim_speed=1e-4, rate=60, lowpass=4.0, tool_frame=[0, 0, 0.1]
    ),
    "segment": lambda m: ns.segment(m, times=[(0.5, 1.5)]).pieces[0],
    "project_trajectory": lambda m: ns.project_trajectory(m, [ns.Blade()]).trajectory,
    "evenly sampled": lambda m: evenly_sampled(m, 20),
    "synchronized": lambda m: synchronized(m, 0.03),
    "before an arm": lambda m: Placement(np.ones(3), Rotation.identity()).apply(m),
    "among bodies": lambda m: Bodies(knife=m, holder=m)["knife in holder"],
    "timed for an arm": lambda m: timed(m, ramp=0.0, time_step=0.01),
    "shielded as a whole": lambda m: shielded(m, ConstraintSystem([ns.Blade()]))[0],
    "closed": lambda m: closed(there_and_back()),
    "written as CSV": lambda m: read_back(m, _FOLDER, "a.csv"),
    "written as npz": lambda m: read_back(m, _FOLDER, "a.npz"),
}
"""What tells the time of each sample as the recording did."""
SAME_SHARE: dict[str, Made] = {
    "align": lambda m: align([m, m])[1],
    "stretched": lambda m: stretched(m, 3.0),
    "rollout": lambda m: primitive().rollout(duration=5.0),
    "one of many": lambda m: primitive().rollout_many(durations=[1.0, 3.0])[1],
    "adapted": lambda m: (
        primitive().adapt(goal_position=primitive().goal_position + [0.01, 0, 0]).rollout()
    ),
    "replanned from its start": lambda m: primitive().replan(primitive().initial_state()).rollout(),
    "regular": lambda m: primitive().regular.rollout(),
    "saved": lambda m: ns.load_primitive(primitive().save(_FOLDER / "p.json")).rollout(),
    "a chunk": lambda m: with_share_of(chunked(m)),
}
"""What tells the share of the motion that is done at each sample."""
_FOLDER = Path()


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}._FOLDER", tmp_path)


def with_share_of(chunk: ns.PoseTrajectory) -> ns.PoseTrajectory:
    """A chunk is a part of the recording: which one, its first and last sample say."""
    first, last = chunk.channels.values[[0, -1], 1]
    share = (chunk.channels.values - [0.0, first]) / [1.0, last - first]
    assert (first, last) == pytest.approx((20 / 120, 59 / 120))
    return chunk.with_channels(chunk.channels.with_points(share))


def carried(found: Any) -> Series:
    beside = found.channels
    assert (beside.names, beside.units) == (("told", "share"), ("s", "1"))
    np.testing.assert_array_equal(beside.times, found.times)
    return beside


@pytest.mark.parametrize("name", SAME_TIME)
def test_each_sample_keeps_what_was_recorded_then(name: str) -> None:
    found = SAME_TIME[name](cut())
    told = carried(found).column("told")
    # Those of a recording that is cut begin where it does.
    np.testing.assert_allclose(told, found.times, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", SAME_SHARE)
def test_each_sample_has_what_was_recorded_at_its_share(name: str) -> None:
    found = SAME_SHARE[name](cut())
    share = found.clock / found.duration
    np.testing.assert_allclose(carried(found).column("share"), share, rtol=0, atol=1e-9)


def test_several_samples_of_a_distribution_have_them() -> None:
    several = [with_clock(planar_cut(bend)) for bend in (0.28, 0.3, 0.33)]
    found = ns.learn(several, [ns.Blade()], basis_functions=15, distribution=True)
    for motion in (found.motion, *found.sample(1, seed=1)):
        share = motion.clock / motion.duration
        np.testing.assert_allclose(carried(motion).column("share"), share, rtol=0, atol=1e-9)


def test_what_has_no_place_for_them_says_so(tmp_path: Path) -> None:
    both = Bodies(knife=cut(), holder=cut().with_channels(None))
    assert "knife has channels" in refusal(InputError, ns.learn, both)
    told = refusal(InputError, write_recording, cut(), tmp_path / "a.tum")
    assert "poses alone; write a CSV" in told
