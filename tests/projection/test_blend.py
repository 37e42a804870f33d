"""Spread displacements: by minimum jerk from each known one to the next."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary, sample_of
from noslip.projection.blend import spread, through
from noslip.trajectory import PoseTrajectory
from strategies import seeds

counts = st.integers(1, 5)


def known(seed: int, count: int, size: int = 3) -> dict[float, Floats]:
    """Random displacements at the first place (0), the last (1) and some between."""
    rng = np.random.default_rng(seed)
    inside = 0.05 + 0.9 * (np.arange(count) + rng.uniform(0, 0.5, count)) / count
    return {float(k): rng.normal(size=size) for k in (0.0, *inside, 1.0)}


def hermite(
    values: dict[float, Floats],
    at: Floats,
    slope: Floats | None = None,
    last_slope: Floats | None = None,
) -> Floats:
    """SciPy's quintic with these values and, but for slopes given, no slope and no curvature."""
    ends = np.stack([[v, 0 * v, 0 * v] for v in values.values()])
    if slope is not None:
        ends[0, 1] = slope
    if last_slope is not None:
        ends[-1, 1] = last_slope
    return np.asarray(BPoly.from_derivatives(list(values), ends)(at))


@given(seeds, counts)
def test_it_is_the_quintic_that_rests_at_every_known_place(seed: int, count: int) -> None:
    values, at = known(seed, count), np.linspace(0, 1, 301)
    np.testing.assert_allclose(spread(values, at), hermite(values, at), rtol=0, atol=1e-12)


@given(seeds, counts)
def test_a_slope_at_the_first_place_changes_the_first_stretch_alone(seed: int, count: int) -> None:
    values, at = known(seed, count), np.linspace(0, 1, 301)
    slope = np.random.default_rng(seed + 1).normal(size=3)
    found = spread(values, at, slope)
    np.testing.assert_allclose(found, hermite(values, at, slope), rtol=0, atol=1e-12)
    after = at >= list(values)[1]
    np.testing.assert_array_equal(found[after], spread(values, at)[after])


@given(seeds, counts)
def test_a_slope_at_the_last_place_changes_the_last_stretch_alone(seed: int, count: int) -> None:
    values, at = known(seed, count), np.linspace(0, 1, 301)
    first, last = np.random.default_rng(seed + 1).normal(size=(2, 3))
    for slope in (None, first):
        found = spread(values, at, slope, last)
        np.testing.assert_allclose(found, hermite(values, at, slope, last), rtol=0, atol=1e-12)
    before = at < list(values)[-2]
    np.testing.assert_array_equal(found[before], spread(values, at, first)[before])


@given(seeds, st.floats(0.2, 0.8))
def test_a_motion_is_moved_through_poses_and_velocities(seed: int, middle: float) -> None:
    errors = []
    for count in (201, 801):
        rng = np.random.default_rng(seed)
        s = np.linspace(0, 1, count)
        free = PoseTrajectory(
            3 * s,
            np.outer(s, rng.normal(size=3)) + np.outer(s**2, rng.normal(size=3)),
            Rotation.from_rotvec(np.outer(s, rng.normal(size=3))),
        )
        asked = [
            Boundary(
                at,
                rng.normal(size=3),
                Rotation.from_rotvec(0.3 * rng.normal(size=3)) * free.rotations[k],
                *(rng.normal(size=(2, 3)) if at in (0, 1) else ()),
            )
            for at, k in ((0.0, 0), (round(200 * middle) / 200, round(200 * middle)), (1.0, -1))
        ]
        moved = through(free, asked)
        for boundary in asked:
            k = sample_of(boundary.at, count)
            np.testing.assert_array_equal(moved.positions[k], boundary.position)
            assert (moved.rotations[k] * boundary.rotation.inv()).magnitude() <= 1e-12
        found = PoseTrajectory(moved.times, moved.positions, moved.rotations)
        errors.append(
            [
                [
                    np.abs(found.linear_velocities[k] - boundary.linear_velocity).max(),
                    np.abs(found.angular_velocities[k] - boundary.angular_velocity).max(),
                ]
                for k, boundary in ((0, asked[0]), (-1, asked[-1]))
            ]
        )
    # Positions to the differences' own error; turns to third order in the turn besides.
    coarse, fine = np.array(errors)
    assert np.all(fine[:, 0] <= coarse[:, 0] / 8 + 1e-9)
    assert np.all(fine[:, 1] <= coarse[:, 1] / 4 + 0.02)


@given(seeds, st.sets(st.integers(1, 99), max_size=4))
def test_known_places_get_their_displacement_to_rounding(seed: int, inside: set[int]) -> None:
    rng = np.random.default_rng(seed)
    values = {k: rng.normal(size=2) for k in (0, *inside, 100)}
    found = spread(values, np.arange(101))
    for k, value in values.items():
        np.testing.assert_allclose(found[k], value, rtol=0, atol=1e-15)


@given(seeds)
def test_it_stays_between_its_neighbors(seed: int) -> None:
    values, at = known(seed, 3), np.linspace(0, 1, 301)
    found, places = spread(values, at), list(values)
    for a, b in itertools.pairwise(places):
        within = found[(at >= a) & (at <= b)]
        low, high = np.minimum(values[a], values[b]), np.maximum(values[a], values[b])
        assert np.all((within >= low - 1e-12) & (within <= high + 1e-12))


def test_ends_that_are_not_told_stay() -> None:
    found = spread({5: [1.0, -2.0]}, np.arange(11))
    np.testing.assert_array_equal(found[[0, 10]], 0.0)
    np.testing.assert_allclose(found[5], [1.0, -2.0])
    # Symmetric about the middle, as minimum jerk is.
    np.testing.assert_allclose(found, found[::-1], atol=1e-15)


# 0.1 * 3 is not 0.3: places that are times are looked up as the same floats they were given as.
@pytest.mark.parametrize("scale", [1.0, 0.1, 1e-3, 1e6])
def test_the_unit_of_the_places_does_not_matter(scale: float) -> None:
    at = scale * np.arange(11)
    slope = np.array([0.7])
    found = spread({at[0]: [0.0], at[3]: [1.0], at[10]: [2.0]}, at, slope / scale)
    wanted = spread({0: [0.0], 3: [1.0], 10: [2.0]}, np.arange(11), slope)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


@given(seeds)
def test_it_is_linear_in_the_displacements(seed: int) -> None:
    one, other = known(seed, 2), known(seed + 1, 2)
    other = dict(zip(one, other.values(), strict=True))
    at = np.linspace(0, 1, 101)
    both = {k: 2 * one[k] - 3 * other[k] for k in one}
    wanted = 2 * spread(one, at) - 3 * spread(other, at)
    np.testing.assert_allclose(spread(both, at), wanted, rtol=0, atol=1e-12)
