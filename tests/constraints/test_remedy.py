"""A check that finds slip says about which point of the tool there is less, if that is so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from measures import speed_along
from motions import planar_cut
from noslip import Blade, Needle, PoseTrajectory, Wheel, check, load_demonstrations, prepare
from strategies import seeds


def seen_from(motion: PoseTrajectory, point: Any) -> PoseTrajectory:
    """The same tool, recorded by a sensor from which the body's origin is at a point."""
    return PoseTrajectory(
        motion.times, motion.positions - motion.rotations.apply(point), motion.rotations, name="cut"
    )


def noisy(motion: PoseTrajectory, rng: np.random.Generator, size: float) -> PoseTrajectory:
    moved = motion.positions + size * rng.normal(size=motion.positions.shape)
    return PoseTrajectory(motion.times, moved, motion.rotations)


def slipped(motion: PoseTrajectory, point: Any) -> float:
    return float(np.abs(speed_along(motion, (0, 1, 0), point)) @ np.diff(motion.times))


@given(seeds)
@settings(max_examples=20)
def test_the_point_that_does_not_slip_is_found(seed: int) -> None:
    point = np.round(np.random.default_rng(seed).uniform(-0.05, 0.05, 3), 4)
    point[0] = np.copysign(0.02 + abs(point[0]), point[0])
    recorded = seen_from(planar_cut(), point)
    for constraint in (Blade(), Wheel(normal=None)):
        (found,) = check(recorded, constraint).constraints
        assert found.verdict == "violated" and found.better_point is not None
        better, slip = found.better_point.point, found.better_point.slip_distance
        # Turning about z tells where the point is along x; along the axis y, and z, nothing does.
        np.testing.assert_allclose(better, [point[0], 0, 0], atol=1e-9)
        assert slip == pytest.approx(slipped(recorded, better), rel=1e-6)
        assert slip < 1e-3 * slipped(recorded, (0, 0, 0))
        assert f"with reference_point=({better[0]:g}, 0, 0) it slips" in str(found)


def test_it_is_plain_data_and_what_is_said_comes_true() -> None:
    recorded = seen_from(planar_cut(wavering=0.02), (0.052, 0.0, 0.013))
    report = check(recorded, [Blade(reference_point=(0.01, 0.003, 0.013)), Needle()])
    data = json.loads(json.dumps(report.to_dict()))["constraints"][0]
    point = data["better_point"]["point"]
    again = check(recorded, Blade(reference_point=point)).constraints[0]
    assert again.slip_distance == pytest.approx(data["better_point"]["slip_distance"], rel=1e-6)
    # The given point stays where the motion tells nothing.
    assert point[1:] == [0.003, 0.013]


@given(seeds)
@settings(max_examples=15)
def test_a_hands_slip_and_noise_have_no_remedy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for motion in (
        planar_cut(beside=0.2),
        planar_cut(bend=0.0, beside=0.3),
        noisy(planar_cut(), rng, 1e-3),
        slide(0.7),
    ):
        (found,) = check(motion, Blade()).constraints
        assert found.verdict == "violated"
        assert found.better_point is None, str(found)
        assert "reference_point" not in str(found)


def slide(radius: float) -> PoseTrajectory:
    """Sideways about a far center: about that it does not slip, but does not move either."""
    angles = np.linspace(0.0, 0.8, 101)
    turns = Rotation.from_euler("z", angles)
    return PoseTrajectory(np.linspace(0, 2, 101), turns.apply([radius, 0, 0]), turns)


def test_what_holds_needs_no_remedy() -> None:
    assert check(planar_cut(), Blade()).constraints[0].better_point is None


@pytest.mark.recordings
def test_recorded_contours_are_told_their_point(recordings: Path) -> None:
    # In the sensor's frame, as if nobody had measured where the edge is.
    runs = load_demonstrations(recordings / "contour_following" / "*.csv")
    found = []
    for run in runs:
        motion = seen_from(prepare(run, trim_speed=0.05, rate=120, lowpass=4.8), (0.08, 0, 0))
        (one,) = check(motion, Blade()).constraints
        assert one.better_point is not None and one.slip_distance is not None
        assert one.better_point.slip_distance < 0.5 * one.slip_distance
        found.append(one.better_point.point[0])
    assert np.median(found) == pytest.approx(0.08, abs=0.02)
