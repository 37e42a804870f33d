"""What the comparison of filters measures, and that what it compares with is what it says."""

from __future__ import annotations

import numpy as np
import pytest

import noslip as ns
from benchmarks import filters
from benchmarks.filters import FAMILIES, RATE, Bounds, Kinematics, Nothing, measure
from motions import planar_cut

BLADE = FAMILIES[0]
CUT = planar_cut(beside=0.05, count=61).resampled(rate=RATE)
"""It slips by a twentieth of its speed."""


def through(each: filters.Filter, given: ns.PoseTrajectory) -> ns.PoseTrajectory:
    each.reset(BLADE, given)
    return each.chunk(given, len(given))


def slip(motion: ns.PoseTrajectory) -> float:
    return float(np.abs(motion.body_velocities[:, 1]).max())


def test_bounds_clip_positions_and_end_at_a_jump() -> None:
    each = Bounds()
    inside = through(each, CUT)
    np.testing.assert_array_equal(inside.positions, CUT.positions)
    low, high = CUT.positions.min(axis=0), CUT.positions.max(axis=0)
    beyond = ns.PoseTrajectory(CUT.times, CUT.positions + [0, 0.01, 0], CUT.rotations)
    each.reset(BLADE, CUT)
    clipped = each.chunk(beyond, len(beyond))
    np.testing.assert_array_equal(clipped.positions, np.clip(beyond.positions, low, high))
    assert clipped.rotations[3].approx_equal(CUT.rotations[3])
    jumping = ns.PoseTrajectory(
        CUT.times,
        np.where(np.arange(len(CUT))[:, None] < 30, low, low + [0.06, 0, 0]),
        CUT.rotations,
    )
    each.reset(BLADE, CUT)
    with pytest.raises(ValueError, match="EE jump"):
        each.chunk(jumping, len(jumping))


def test_bounds_are_those_of_lerobot() -> None:
    theirs = pytest.importorskip(
        "lerobot.robots.so_follower.robot_kinematic_processor", reason="lerobot is not installed"
    ).EEBoundsAndSafety
    names = ("x", "y", "z", "wx", "wy", "wz")
    bounds = {"min": CUT.positions.min(axis=0), "max": CUT.positions.max(axis=0)}
    step, each = theirs(bounds), Bounds()
    assert step.max_ee_step_m == each.max_ee_step_m
    noisy = ns.PoseTrajectory(
        CUT.times,
        CUT.positions + 0.01 * np.random.default_rng(0).normal(size=(len(CUT), 3)),
        CUT.rotations,
    )
    each.reset(BLADE, CUT)
    ours = each.chunk(noisy, len(noisy))
    for k, pose in enumerate(np.hstack([noisy.positions, noisy.rotations.as_rotvec()])):
        action = step.action({f"ee.{name}": x for name, x in zip(names, pose, strict=True)})
        np.testing.assert_array_equal([action[f"ee.{n}"] for n in names[:3]], ours.positions[k])


@pytest.mark.parametrize("library", ["mink", "pink"])
def test_the_kinematics_follow_what_is_feasible(library) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed")
    fair = planar_cut(count=61).resampled(rate=RATE)
    followed = through(Kinematics(substeps=10, library=library), fair)
    assert np.linalg.norm(followed.positions - fair.positions, axis=1).max() < 2e-4
    assert (followed.rotations * fair.rotations.inv()).magnitude().max() < 1e-3


@pytest.mark.parametrize("library", ["mink", "pink"])
def test_the_kinematics_hold_their_equality_the_better_the_shorter_their_steps(library) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed")
    slips = [slip(through(Kinematics(substeps=n, library=library), CUT)) for n in (1, 10)]
    assert slips[0] < slip(CUT)
    assert slips[1] < max(slips[0] / 5, 1e-5)


def test_a_point_ahead_leads_the_tool_back_to_its_path() -> None:
    pytest.importorskip("mink", reason="mink is not installed")
    aside = np.linalg.norm(through(Kinematics(turning=0.01), CUT).positions - CUT.positions, axis=1)
    ahead = through(Kinematics(ahead=0.02, turning=0.01), CUT)
    led = np.linalg.norm(ahead.positions - CUT.positions, axis=1)
    assert led[-1] < aside[-1] / 2


def test_what_is_measured_of_no_filter_is_the_noise() -> None:
    fair = planar_cut(count=601).resampled(times=np.linspace(0, 2, 401))
    slow = ns.PoseTrajectory(np.arange(401) / RATE, fair.positions, fair.rotations)
    found = measure(Nothing(), BLADE, [slow], 16, 8)
    assert found.moved == found.turned == found.rejected == 0
    assert found.off == pytest.approx(np.sqrt(3) * filters.NOISE, rel=0.1)
    assert found.turned_off == pytest.approx(np.sqrt(3) * filters.TURN_NOISE, rel=0.1)
    white = np.sqrt(6 * 3) * filters.NOISE * RATE**2
    assert found.acceleration == pytest.approx(white, rel=0.1)


def test_each_chunk_begins_where_the_last_was_left() -> None:
    parts = list(filters.chunks(CUT, 16, 8, np.random.default_rng(0)))
    for k, part in enumerate(parts):
        meant = CUT[8 * k : 8 * k + 16]
        np.testing.assert_array_equal(part.times, meant.times)
        assert np.abs(part.positions - meant.positions).max() < 6 * filters.NOISE
        assert (part.rotations * meant.rotations.inv()).magnitude().max() < 8 * filters.TURN_NOISE


def test_what_is_not_installed_is_left_out(monkeypatch, capsys) -> None:
    monkeypatch.setattr(filters, "find_spec", lambda name: None)
    names = [each.name for each in filters.rows(BLADE)]
    assert names == [each.name for each in (Nothing, Bounds, filters.Streamed, filters.Shielded)]
    assert "mink is not installed" in capsys.readouterr().err


def test_without_recordings_it_says_so(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr(filters, "RECORDINGS", tmp_path / "none")
    monkeypatch.setattr("sys.argv", ["filters"])
    assert filters.main() == 1
    assert "is absent" in capsys.readouterr().err
