"""What real recordings obey: hands along a contour, a driven needle, robots, a trolley, a peg."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
from measures import rms, speed_along
from noslip.edge import other_axes, unit_axis


def load(recordings: Path, pattern: str, **options: Any) -> list[ns.PoseTrajectory]:
    return ns.load_demonstrations(recordings / pattern, **options)


def test_contour_runs_have_two_directions_free_of_slip(recordings: Path) -> None:
    runs = load(recordings, "contour_following/*.csv")
    found = ns.identify(runs)
    assert found.kinds == ("needle",)
    assert len(found.rows) == 2
    assert found.travel is not None and found.travel[0] > 0.999
    given, slip = (
        np.sqrt(sum(getattr(row, name) ** 2 for row in found.rows)) for name in ("given", "slip")
    )
    # 7.9 % and 4.5 % by another program, of the velocities low-passed at 3 Hz.
    assert 0.07 < given < 0.09
    assert slip < 0.047


def slipped(run: ns.PoseTrajectory, rule: ns.Needle) -> float:
    """Share of the speed across a needle's shaft, averaged over 7 steps (0.25 s) against noise."""
    along, *across = (
        np.convolve(speed_along(run, axis, rule.reference_point), np.ones(7) / 7, "valid")
        for axis in (unit_axis(rule.shaft), *other_axes(rule.shaft))
    )
    return rms(np.hypot(*across)) / rms(along)


@pytest.mark.parametrize("placement", "abcd")
def test_held_out_slip_falls_in_each_placement(recordings: Path, placement: str) -> None:
    runs = load(recordings, "contour_following/*.csv")
    own = [run for run in runs if f"demo_{placement}" in run.name]
    found = ns.identify([run for run in runs if run not in own])
    (needle,) = found.constraints
    assert isinstance(needle, ns.Needle) and len(own) == 2
    for run in own:
        assert slipped(run, needle) < 0.8 * slipped(run, ns.Needle())


def test_needle_runs_are_a_bent_needle_that_travels_backwards(recordings: Path) -> None:
    runs = load(recordings, "needle_insertion/*.csv", rate=14.5)
    found = ns.identify(runs)
    assert found.kinds == ("needle",)
    assert found.travel is not None and found.travel[0] < -0.99
    # The arcs of a circular needle, of about 20 mm.
    assert found.curvature is not None and 0.015 < 1 / found.curvature < 0.02


def test_robots_are_wheels_about_the_center_of_their_track(recordings: Path) -> None:
    found = ns.identify(load(recordings, "wheeled_robots/*.csv"))
    (wheel,) = found.constraints
    assert isinstance(wheel, ns.Wheel)
    assert found.reference_point is not None and found.travel is not None
    np.testing.assert_allclose(found.reference_point, 0, atol=2e-3)
    np.testing.assert_allclose(found.travel, [1, 0, 0], atol=0.01)
    np.testing.assert_allclose(wheel.normal, [0, 0, 1], atol=1e-9)  # type: ignore[arg-type]


def test_the_trolley_turns_about_its_axle(recordings: Path) -> None:
    with pytest.warns(ns.errors.RecordingWarning, match="stands still"):
        runs = load(recordings, "trolley_mocap/trolley_fast.csv")
    found = ns.identify(runs)
    assert found.kinds == ("wheel",)
    assert found.reference_point is not None
    assert np.linalg.norm(found.reference_point - [-0.09, -0.02, 0]) < 0.015
    assert found.travel is not None
    np.testing.assert_allclose(found.travel, [0.996, 0.093, 0], atol=0.005)


def test_a_peg_obeys_nothing(recordings: Path) -> None:
    found = ns.identify(load(recordings, "peg_on_hole/*.csv"))
    assert (found.constraints, found.kinds, found.rows) == ((), (), ())
    assert found.lateral is found.travel is found.reference_point is found.tool_frame is None
    assert min(row.holdout for row in found.candidates) > 0.2
