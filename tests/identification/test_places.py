"""Where a body stays, told from exact motions of random tools seen by random sensors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import noslip as ns
from identification.worlds import RADIUS, World, world
from noslip._typing import Floats
from noslip.identification import Place
from noslip.identification.places import TOLD, fit_places

FINE = 1e-4, np.radians(0.05)
COARSE = 5e-4, np.radians(0.3)
EXACT = 0.0, 0.0
RULES = {
    "plane": ("plane-contact",),
    "sphere": ("sphere-contact",),
    "cylinder": ("cylinder-contact",),
    "remote center": ("remote-center",),
    "fixed point": ("fixed-point",),
    "fixed axis": ("fixed-point", "tool-axis"),
    "rolling disc": ("rolling-disc",),
    "rolling sphere": ("rolling-sphere",),
}
"""Kinds at position level, and the constraints that they are."""


def told(kind: str, seed: int, noise: tuple[float, float]) -> tuple[World, list[Place]]:
    """A world, and what is believed of it."""
    seen = world(kind, seed, noise)
    return seen, [place for place in fit_places([seen.trajectory], noise) if place.holds]


def truths(kind: str, seen: World) -> dict[str, Any]:
    """Parameters as they are; points of planes, cylinders and hinges may be any along them."""
    _, y, z = seen.axes
    world_axis = {"axis": seen.normal} if kind == "cylinder" else {"axis": z}
    points = {} if kind in ("plane", "cylinder", "fixed axis") else {"point": seen.center}
    return {
        "reference_point": seen.point,
        "radius": RADIUS,
        "normal": seen.normal,
        "direction": seen.normal,
        "shaft": z,
        "axle": y,
        **world_axis,
        **points,
    }


def deviations(kind: str, seen: World, place: Place) -> dict[str, tuple[Any, Any]]:
    """By parameter how far it is off, across what is not told, and its covariance there."""
    found = {}
    for name, truth in truths(kind, seen).items():
        if name not in place.values:
            continue
        value, error = place.values[name], np.asarray(place.errors[name])
        if name == "radius":
            found[name] = np.array([value - truth]), error.reshape(1, 1) ** 2
            continue
        # An axis has no sign.
        sign = 1.0 if "point" in name else np.sign(value @ truth)
        squares, directions = np.linalg.eigh(error)
        told = squares < TOLD**2 if "point" in name else squares > 1e-6 * squares[-1]
        kept = directions.T[told]
        found[name] = kept @ (sign * value - truth), kept @ error @ kept.T
    return found


def is_within(error: Floats, covariance: Floats) -> bool:
    """Whether an error is in the 95 % region."""
    return bool(error @ np.linalg.solve(covariance, error) < chi2.ppf(0.95, len(error)))


@pytest.mark.parametrize("noise", [EXACT, FINE], ids=["exact", "fine"])
@pytest.mark.parametrize("kind", RULES)
def test_a_place_is_told_by_the_motion(kind: str, noise: tuple[float, float]) -> None:
    seen, places = told(kind, 0, noise)
    assert [place.kind for place in places] == [kind]
    for name, (error, _) in deviations(kind, seen, places[0]).items():
        bound = 5e-4 if "point" in name or name == "radius" else np.radians(0.5)
        assert np.linalg.norm(error) < (bound if any(noise) else 0.02 * bound)
    names = tuple(type(constraint).name for constraint in places[0].constraints)
    assert names == RULES[kind]
    assert ns.check(seen.exact, list(places[0].constraints)).satisfied


@pytest.mark.parametrize("kind", ["none", "blade", "needle", "bevel"])
def test_a_tool_that_may_go_anywhere_has_no_place(kind: str) -> None:
    assert not told(kind, 0, FINE)[1]


def test_a_vehicle_keeps_to_its_floor_and_nothing_tells_of_which_point() -> None:
    seen, places = told("wheel", 1, FINE)
    assert [place.kind for place in places] == ["tool axis", "plane"]
    # That noise turns the vehicle a little tells nothing of it.
    np.testing.assert_allclose(places[1].values["reference_point"], 0, atol=2e-6)
    assert "cannot be told" in places[1].notes[0]
    assert abs(abs(places[1].values["normal"] @ seen.normal) - 1) < 1e-6


def test_a_line_lies_on_everything_and_shows_nothing() -> None:
    rng = np.random.default_rng(0)
    times = np.linspace(0, 5, 501)
    noise = 5e-4, np.radians(0.3)
    positions = np.outer(0.1 * times, [1.0, 0, 0]) + noise[0] * rng.normal(size=(501, 3))
    held = Rotation.from_rotvec(noise[1] * rng.normal(size=(501, 3)))
    line = ns.PoseTrajectory(times, positions, held)
    assert {place.kind for place in fit_places([line], noise) if place.holds} <= {"tool axis"}


@pytest.mark.parametrize("kind", RULES)
def test_identify_says_it_and_coarse_noise_breaks_nothing(kind: str) -> None:
    seen = world(kind, 2, FINE)
    found = ns.identify(seen.trajectory)
    assert found.kinds == RULES[kind]
    assert str(found).startswith(f"{kind} in 1 recording")
    assert found.reference_point is not None
    for place in fit_places([world(kind, 2, COARSE).trajectory], COARSE):
        if place.holds and place.kind == kind:
            for error, covariance in deviations(kind, seen, place).values():
                assert error @ np.linalg.solve(covariance, error) < chi2.ppf(1 - 1e-6, len(error))


def test_recordings_of_one_world_are_held_out_in_turn() -> None:
    seen = world("sphere", 3, FINE)
    quarter = len(seen.trajectory) // 4
    parts = [
        ns.PoseTrajectory(
            seen.trajectory.times[k : k + quarter],
            seen.trajectory.positions[k : k + quarter],
            seen.trajectory.rotations[k : k + quarter],
        )
        for k in range(0, 4 * quarter, quarter)
    ]
    places = fit_places(parts, FINE)
    assert places[-1].kind == "sphere" and places[-1].holds
    assert places[-1].holdout < 1.15 * places[-1].residual
