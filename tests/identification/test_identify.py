"""What a tool obeys, told from exact motions of random tools seen by random sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import noslip as ns
from identification.worlds import CURVATURE, TIGHTEST, World, world
from measures import residuals
from motions import planar_cut
from noslip._typing import Floats
from noslip.demonstrations.preparation import apply_tool_frame
from noslip.errors import InputError
from refusals import refusal

FINE = 1e-4, np.radians(0.05)
COARSE = 5e-4, np.radians(0.3)
EXACT = 0.0, 0.0
RULES = {
    "none": (),
    "blade": ("blade",),
    "needle": ("needle",),
    "bevel": ("needle",),
    "wheel": ("wheel",),
    "car": ("wheel", "turning-radius"),
    "plane": ("plane-contact",),
    "sphere": ("sphere-contact",),
    "cylinder": ("cylinder-contact",),
    "remote center": ("remote-center",),
    "fixed point": ("fixed-point",),
    "fixed axis": ("fixed-point", "tool-axis"),
    "rolling disc": ("rolling-disc",),
    "rolling sphere": ("rolling-sphere",),
}
"""The constraints that each kind is."""
TOOLS = ["blade", "needle", "bevel", "wheel"]


def is_right(kind: str, found: ns.identification.Identified) -> bool:
    return found.kinds == RULES[kind] and (found.curvature is not None) == (kind == "bevel")


def misplaced(seen: World, found: ns.identification.Identified) -> Floats:
    """How far the point found is from the tool's, across what is not told (m)."""
    assert found.reference_point is not None
    away = found.reference_point - seen.point
    unknown = found.rows[0].unknown
    return np.asarray(away - unknown.T @ (unknown @ away))


def askew(kind: str, seen: World, found: ns.identification.Identified) -> float:
    """Largest angle (degrees) of an axis that the kind has."""
    x, y, _ = seen.axes
    pairs = [] if kind == "blade" else [(found.travel, x)]
    pairs += [] if kind == "needle" else [(found.lateral, y)]
    # An axis has no sign; of small angles the sine tells.
    sines = [float(np.linalg.norm(np.cross(a, b))) for a, b in pairs]  # type: ignore[arg-type]
    return float(np.degrees(np.arcsin(min(1.0, max(sines)))))


def is_within(error: Floats, covariance: Floats) -> bool:
    """Whether an error is in the 95 % region of a covariance, across what that does not span."""
    values, directions = np.linalg.eigh(covariance)
    told = values > 1e-9 * values[-1]
    share = (directions.T[told] @ error) ** 2 / values[told]
    return bool(share.sum() < chi2.ppf(0.95, told.sum()))


# ---------------------------------------------------------------- which, and where


@pytest.mark.parametrize("noise", [EXACT, FINE], ids=["exact", "fine"])
@pytest.mark.parametrize("kind", RULES)
def test_a_tool_is_told_by_its_motion(kind: str, noise: tuple[float, float]) -> None:
    seen = world(kind, 1, noise)
    found = ns.identify(seen.trajectory)
    assert is_right(kind, found)
    if found.rows:
        assert np.linalg.norm(misplaced(seen, found)) < (1e-3 if noise == FINE else 1e-5)
        assert askew(kind, seen, found) < (0.5 if noise == FINE else 0.01)


def test_a_bent_needle_has_its_curvature() -> None:
    for seed in range(3):
        found = ns.identify(world("bevel", seed, FINE).trajectory)
        assert found.curvature is not None and found.curvature_error is not None
        assert abs(found.curvature - CURVATURE) < 4 * found.curvature_error < 0.05 * CURVATURE


def test_a_car_has_its_turning_radius_about_the_middle_of_its_axle() -> None:
    for seed in range(3):
        seen = world("car", seed, FINE)
        found = ns.identify(seen.trajectory)
        _, bound = found.constraints
        assert isinstance(bound, ns.constraints.TurningRadius)
        assert found.turning_radius == bound.radius == pytest.approx(TIGHTEST, rel=0.03)
        across = (bound.reference_point - seen.point) @ seen.axes[1]
        assert abs(across) < 0.03 * TIGHTEST


# ---------------------------------------------------------------- what follows from it


@pytest.mark.parametrize("kind", TOOLS)
def test_what_was_found_holds(kind: str) -> None:
    seen = world(kind, 0)
    found = ns.identify(seen.trajectory)
    # Exact in time, not from sample to sample.
    assert np.abs(residuals(seen.trajectory, found.constraints)).max() < 1e-4
    assert ns.check(seen.trajectory, found.constraints).satisfied


def test_the_tool_frame_makes_a_blade_of_it() -> None:
    seen = world("blade", 1)
    found = ns.identify(seen.trajectory)
    assert found.tool_frame is not None
    np.testing.assert_allclose(
        found.tool_frame[:3, :3].T @ found.tool_frame[:3, :3], np.eye(3), atol=1e-12
    )
    tool = apply_tool_frame(seen.trajectory, found.tool_frame)
    assert ns.check(tool, [ns.Blade()]).satisfied


@pytest.mark.parametrize("kind", TOOLS)
def test_a_turned_sensor_sees_the_same_tool(kind: str) -> None:
    recorded = world(kind, 2, FINE).trajectory
    turn = Rotation.from_rotvec([0.4, -1.2, 0.7])
    one, other = (
        ns.identify(replace(recorded, rotations=recorded.rotations * held), noise=FINE)
        for held in (Rotation.identity(), turn)
    )
    assert one.kinds == other.kinds
    for name in ("travel", "reference_point"):
        a, b = getattr(one, name), turn.apply(getattr(other, name))
        np.testing.assert_allclose(a, b, atol=1e-5)


@pytest.mark.parametrize("kind", TOOLS)
def test_rests_irregular_times_and_held_poses_change_nothing(kind: str) -> None:
    seen = world(kind, 3, FINE)
    recorded, rng = seen.trajectory, np.random.default_rng(0)
    kept = np.sort(rng.choice(len(recorded), len(recorded) * 2 // 3, replace=False))
    # Every tenth pose is held for a sample; the tool rests for 2 s in the middle.
    held = np.sort(np.concatenate([kept, kept[::10]]))
    times = recorded.times[held] + np.concatenate([[0], np.cumsum(np.diff(held) == 0)]) * 0.003
    times = times + 2.0 * (np.arange(len(held)) > len(held) // 2)
    found = ns.identify(
        ns.PoseTrajectory(times, recorded.positions[held], recorded.rotations[held])
    )
    assert is_right(kind, found)
    assert np.linalg.norm(misplaced(seen, found)) < 1e-3


def test_several_recordings_tell_more_than_one() -> None:
    errors = []
    for count in (1, 4):
        seen = [world("needle", seed, COARSE, frame=False) for seed in range(count)]
        found = ns.identify([s.trajectory for s in seen])
        assert found.kinds == ("needle",)
        errors.append(np.trace(found.rows[0].point_covariance))
    assert errors[1] < errors[0] / 2


@pytest.mark.parametrize("noise", [FINE, COARSE])
def test_noise_is_told(noise: tuple[float, float]) -> None:
    recorded = world("blade", 4, noise).trajectory
    np.testing.assert_allclose(ns.identify(recorded).noise, noise, rtol=0.1)
    assert ns.identify(recorded, noise=noise).noise == pytest.approx(noise)


# ---------------------------------------------------------------- what is not believed


def test_a_blade_that_did_not_turn_is_no_evidence() -> None:
    found = ns.identify(planar_cut(bend=0.01))
    assert found.constraints == ()
    assert "turn the tool" in found.notes[0]


def test_a_center_farther_than_any_tool_is_not_believed() -> None:
    seen = world("blade", 5, frame=False).exact
    far = replace(seen, positions=seen.positions + seen.rotations.apply([0.7, 0, 0]))
    found = ns.identify(far)
    assert found.reference_point is None or np.linalg.norm(found.reference_point) < 0.5


def test_too_little_is_refused() -> None:
    still = ns.PoseTrajectory(np.arange(20.0), np.zeros((20, 3)), Rotation.identity(20))
    assert "does not move" in refusal(InputError, ns.identify, still)
    assert "12 poses or more" in refusal(InputError, ns.identify, planar_cut(count=8))
    assert "Trajectory objects, got int" in refusal(InputError, ns.identify, 3)
