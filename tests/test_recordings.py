"""Recorded needles, robots and trolleys: learned without slip, close to what was recorded."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from measures import rms, speed_along, steps
from noslip import (
    ConstrainedDMP,
    Motion,
    Needle,
    PoseTrajectory,
    Wheel,
    learn,
    load_demonstrations,
    load_primitive,
    prepare,
)
from noslip.constraints.declaration import Constraint
from noslip.errors import InputError

pytestmark = pytest.mark.recordings

LOWPASS = 2.0
"""Hz; what the tools and vehicles do is slower, and what a tracker adds at rest is faster."""
RESIDUAL = 1e-10


@dataclass(frozen=True)
class Family:
    """Recordings of one kind and how closely they are learned, as measured.

    Attributes
    ----------
    across : arrays, shape (3,)
        The directions that must not move: body axes, then world axes.
    position, rotation : float
        Rms from the recording: share of the extent (filtered or not), degrees (filtered).
    backwards : float
        Share of the way that the motion goes backwards.
    """

    folder: str
    constraint: Constraint
    forward: tuple[float, float, float]
    body: tuple[tuple[float, float, float], ...]
    world: tuple[tuple[float, float, float], ...]
    position: float
    rotation: float
    backwards: float
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    load: dict[str, Any] = field(default_factory=dict)


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
AXLE = (-0.09, -0.02, 0.0)
NEEDLE = Family(
    folder="needle_insertion",
    constraint=Needle(shaft="-x"),
    forward=(-1.0, 0.0, 0.0),
    body=(Y, Z),
    world=(),
    position=0.2e-2,
    rotation=12.0,
    backwards=0.0,
    load={"rate": 14.5},
)
ROBOT = Family(
    folder="wheeled_robots",
    constraint=Wheel(),
    forward=X,
    body=(Y,),
    world=(Z,),
    position=0.2e-2,
    rotation=4.0,
    backwards=0.01,
)
TROLLEY = Family(
    folder="trolley_mocap",
    constraint=Wheel(reference_point=AXLE),
    forward=X,
    body=(Y,),
    world=(Z,),
    position=0.5e-2,
    rotation=9.0,
    backwards=0.01,
    point=AXLE,
)

NEEDLES = [f"trial_{number:02d}" for number in range(1, 21)]
ROBOTS = [
    "diff_free__020120212354_run-01",
    "diff_free__030120210001_run-01",
    "diff_free__030120210001_run-02",
    "diff_free__030120210006_run-01",
    "diff_free__030120210006_run-02",
    "diff_free__030120210006_run-03",
    "diff_free__030120210006_run-04",
    *(f"diff_square__230620202042_run-{number:02d}" for number in range(1, 7)),
]


# -------------------------------------------------------------------- measures, by NumPy and SciPy


def extent(trajectory: PoseTrajectory) -> float:
    """Largest range of the path along a world axis (m)."""
    return float(np.ptp(trajectory.positions, axis=0).max())


def largest_slip(motion: PoseTrajectory, family: Family) -> float:
    speeds = [speed_along(motion, axis, family.point) for axis in family.body]
    speeds += [steps(motion).velocities_of(family.point) @ axis for axis in family.world]
    return float(np.abs(speeds).max())


def share_backwards(motion: PoseTrajectory, family: Family) -> float:
    along = speed_along(motion, family.forward, family.point)
    return float(-np.minimum(along, 0).sum() / np.abs(along).sum())


def off_position(motion: PoseTrajectory, demonstration: PoseTrajectory) -> float:
    """Rms distance at equal times, as a share of the demonstration's extent."""
    held = at_equal_times(motion, demonstration)
    off = np.linalg.norm(motion.positions - held.positions, axis=1)
    return rms(off) / extent(demonstration)


def off_rotation(motion: PoseTrajectory, demonstration: PoseTrajectory) -> float:
    held = at_equal_times(motion, demonstration)
    return float(np.degrees(rms((motion.rotations * held.rotations.inv()).magnitude())))


def at_equal_times(motion: PoseTrajectory, demonstration: PoseTrajectory) -> PoseTrajectory:
    times = demonstration.times
    return demonstration.resampled(times=np.clip(times[0] + motion.times, times[0], times[-1]))


# -------------------------------------------------------------------- learned


def learned(
    file: Path, family: Family, **preparation: Any
) -> tuple[PoseTrajectory, PoseTrajectory, ConstrainedDMP]:
    [recording] = load_demonstrations(file, **family.load)
    demonstration = prepare(recording, **preparation)
    return recording, demonstration, learn(demonstration, family.constraint)


def assert_held(motion: Motion, family: Family) -> None:
    assert np.all(np.isfinite(motion.positions))
    assert np.abs(motion.constraint_residuals).max() <= RESIDUAL
    assert largest_slip(motion, family) <= RESIDUAL


def assert_learned_as_recorded(file: Path, family: Family) -> None:
    recording, demonstration, dmp = learned(file, family, lowpass=LOWPASS)
    motion = dmp.rollout()
    assert motion.times[-1] == pytest.approx(demonstration.duration)
    assert_held(motion, family)
    assert off_position(motion, demonstration) <= family.position
    # The filter has hidden nothing: it is as close to what was recorded.
    assert off_position(motion, recording) <= family.position
    assert off_rotation(motion, demonstration) <= family.rotation
    assert share_backwards(motion, family) <= family.backwards
    [record] = dmp.record
    assert record.residual <= RESIDUAL
    assert record.smoothing == pytest.approx(1e-6)


@pytest.mark.parametrize("name", NEEDLES)
def test_needles_are_learned_as_recorded(recordings: Path, name: str) -> None:
    assert_learned_as_recorded(recordings / NEEDLE.folder / f"{name}.csv", NEEDLE)


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_are_learned_as_recorded(recordings: Path, name: str) -> None:
    assert_learned_as_recorded(recordings / ROBOT.folder / f"{name}.csv", ROBOT)


def first_of_each_stamp(file: Path, folder: Path) -> Path:
    """The recording without the seven samples that repeat a stamp with another pose."""
    header, *rows = file.read_text().splitlines()
    stamps = [row.split(",")[0] for row in rows]
    kept = [row for k, row in enumerate(rows) if k == 0 or stamps[k] != stamps[k - 1]]
    assert len(rows) - len(kept) == 7
    cleaned = folder / file.name
    cleaned.write_text("\n".join([header, *kept, ""]))
    return cleaned


@pytest.mark.filterwarnings("ignore:.*stands still:noslip.errors.RecordingWarning")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["trolley_fast", "trolley_mid"])
def test_trolleys_are_learned_as_recorded(recordings: Path, tmp_path: Path, name: str) -> None:
    file = recordings / TROLLEY.folder / f"{name}.csv"
    if name == "trolley_mid":
        with pytest.raises(InputError, match="trolley_mid"):
            load_demonstrations(file)
        file = first_of_each_stamp(file, tmp_path)
    assert_learned_as_recorded(file, TROLLEY)


def test_all_recordings_are_covered(recordings: Path) -> None:
    found = {
        family.folder: {file.stem for file in (recordings / family.folder).glob("*.csv")}
        for family in (NEEDLE, ROBOT, TROLLEY)
    }
    assert found == {
        NEEDLE.folder: set(NEEDLES),
        ROBOT.folder: set(ROBOTS),
        TROLLEY.folder: {"trolley_fast", "trolley_mid"},
    }


# -------------------------------------------------------------------- asked for something else


@pytest.mark.parametrize(
    ("family", "name"),
    [(NEEDLE, NEEDLES[0]), (ROBOT, ROBOTS[0]), (ROBOT, ROBOTS[-1])],
    ids=lambda value: value if isinstance(value, str) else value.folder,
)
def test_nothing_slips_on_the_way_to_another_goal(
    recordings: Path, family: Family, name: str
) -> None:
    file = recordings / family.folder / f"{name}.csv"
    _, demonstration, dmp = learned(file, family, lowpass=LOWPASS)
    shift = 0.1 * extent(demonstration) * np.array([1.0, -1.0, 0.0])
    for asked in (
        {"goal_position": dmp.goal_position + shift},
        {"start_rotation": Rotation.from_rotvec([0, 0, 0.5]) * dmp.start_rotation},
        {"duration": 2.5 * dmp.duration},
        {"time_step": 0.37 * dmp.duration / dmp.steps},
    ):
        assert_held(dmp.rollout(**asked), family)


# -------------------------------------------------------------------- without a filter


@pytest.mark.parametrize("name", NEEDLES)
def test_needles_are_learned_as_they_come(recordings: Path, name: str) -> None:
    file = recordings / NEEDLE.folder / f"{name}.csv"
    _, demonstration, dmp = learned(file, NEEDLE)
    motion = dmp.rollout()
    assert_held(motion, NEEDLE)
    assert off_position(motion, demonstration) <= 0.7e-2


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_are_learned_as_they_come(recordings: Path, name: str) -> None:
    file = recordings / ROBOT.folder / f"{name}.csv"
    _, demonstration, dmp = learned(file, ROBOT)
    motion = dmp.rollout()
    assert largest_slip(motion, ROBOT) <= RESIDUAL
    assert off_position(motion, demonstration) <= 0.5e-2


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_without_a_filter_do_not_slip_either(recordings: Path, name: str) -> None:
    _, _, dmp = learned(recordings / ROBOT.folder / f"{name}.csv", ROBOT)
    assert_held(dmp.rollout(), ROBOT)


# -------------------------------------------------------------------- from a shell


@pytest.mark.filterwarnings("ignore:.*stands still:noslip.errors.RecordingWarning")
@pytest.mark.parametrize(
    ("family", "name", "options"),
    [
        (NEEDLE, "trial_07", ["--sample-rate", 14.5, "--constraint", "needle(shaft='-x')"]),
        (ROBOT, "diff_square__230620202042_run-03", ["--constraint", "wheel"]),
        pytest.param(
            TROLLEY,
            "trolley_fast",
            ["--constraint", "wheel(reference_point=[-0.09,-0.02,0])"],
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_recordings_are_learned_from_a_shell(
    recordings: Path,
    tmp_path: Path,
    noslip: Callable[..., Any],
    family: Family,
    name: str,
    options: list[object],
) -> None:
    file, out = recordings / family.folder / f"{name}.csv", tmp_path / f"{name}.json"
    result = noslip("learn", file, *options, "--lowpass", LOWPASS, "--json", "--out", out)
    assert result.code == 0
    # The trolley's tracker lost it once, and held its pose.
    assert ("warning" in result.err) == (name == "trolley_fast") == ("stands still" in result.err)
    figures = json.loads(result.out)
    assert figures["residual_peak"] <= RESIDUAL
    [recording] = load_demonstrations(file, **family.load)
    demonstration = prepare(recording, lowpass=LOWPASS)
    [compared] = figures["demonstrations"]
    assert compared["position_rms"] <= family.position * extent(demonstration)
    motion = load_primitive(out).rollout()
    assert_held(motion, family)
    assert off_position(motion, demonstration) * extent(demonstration) == pytest.approx(
        compared["position_rms"], rel=0.02
    )
