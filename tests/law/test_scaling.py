"""How the learned force follows the goal: the demonstrated path, stretched or turned, exactly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from noslip import ConstrainedDMP, PoseTrajectory, learn
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law.scaling import scaled
from refusals import refusal
from strategies import seeds

pytestmark = pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
"""A law knows no units."""
SCALED: Any = ["difference", "rotation-dilation"]
ALL: Any = ["none", *SCALED]


def curve(seed: int, way: Floats | None = None, count: int = 301) -> PoseTrajectory:
    """A random smooth path from a random start; it starts moving, and goes the way told."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, count)
    if way is None:
        # No axis is so short that it would not be scaled.
        way = rng.choice([-1, 1], 3) * rng.uniform(0.3, 1, 3)
    x = rng.normal(size=3) + np.outer(s, way)
    for k in (1, 2, 3):
        x += np.outer(np.sin(np.pi * k * s), 0.3 * rng.normal(size=3) / k)
    return PoseTrajectory(2 * s, x, Rotation.concatenate([Rotation.identity()] * count))


def fitted(seed: int, way: Floats | None = None) -> ConstrainedDMP:
    return learn(curve(seed, way), basis_functions=30)


def path(dmp: ConstrainedDMP, **arguments: Any) -> Floats:
    """The motion of the scaled primitive."""
    moved = replace(dmp, law=scaled(dmp.law, **arguments))
    return moved.rollout().positions


def smallest_rotation(a: Floats, b: Floats) -> Floats:
    """The rotation that turns a into b about what is square to both, without an angle."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    x, y, z = np.cross(a, b)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + a @ b)


def matrix(scaling: str, way: Floats, wanted: Floats) -> Floats:
    if scaling == "difference":
        return np.diag(wanted / way)
    ratio = np.linalg.norm(wanted) / np.linalg.norm(way)
    return ratio * smallest_rotation(way, wanted)


@pytest.mark.parametrize("scaling", SCALED)
@given(seeds)
@settings(max_examples=25)
def test_the_path_is_an_affine_image_of_the_demonstrated_one(scaling: str, seed: int) -> None:
    dmp, rng = fitted(seed), np.random.default_rng(seed + 1)
    start, goal = rng.normal(size=(2, 3))
    own = dmp.law
    way, wanted = own.goal_position - own.start_position, goal - start
    # Next to the opposite direction the smallest rotation is about any axis.
    assume(way @ wanted > -0.99 * np.linalg.norm(way) * np.linalg.norm(wanted))
    found = path(dmp, scaling=scaling, start_position=start, goal_position=goal)
    S = matrix(scaling, way, wanted)
    image = start + (dmp.rollout().positions - own.start_position) @ S.T
    np.testing.assert_allclose(found, image, rtol=0, atol=1e-9 * max(1, np.abs(S).max()))


@pytest.mark.parametrize("scaling", ALL)
@given(seeds)
@settings(max_examples=5)
def test_the_demonstrated_goal_gives_the_demonstrated_motion(scaling: Any, seed: int) -> None:
    dmp = fitted(seed)
    own = dmp.law
    for given_ in ({}, {"goal_position": own.goal_position, "start_position": own.start_position}):
        found = path(dmp, scaling=scaling, **given_)
        np.testing.assert_allclose(found, dmp.rollout().positions, rtol=0, atol=1e-12)


@given(seeds)
@settings(max_examples=10)
def test_without_scaling_start_and_goal_move_the_attractor_alone(seed: int) -> None:
    dmp = fitted(seed)
    start, goal = np.random.default_rng(seed + 1).normal(size=(2, 3))
    found = path(dmp, scaling="none", start_position=start, goal_position=goal)
    plain = dmp.rollout(start_position=start, goal_position=goal, goal_form="paper").positions
    np.testing.assert_array_equal(found, plain)


# A shift of the whole scene is no change of direction or length.
@pytest.mark.parametrize("scaling", ALL)
@given(seeds)
@settings(max_examples=5)
def test_a_shift_of_start_and_goal_shifts_the_path(scaling: Any, seed: int) -> None:
    dmp, shift = fitted(seed), np.random.default_rng(seed).normal(size=3)
    own = dmp.law
    found = path(
        dmp,
        scaling=scaling,
        start_position=own.start_position + shift,
        goal_position=own.goal_position + shift,
    )
    np.testing.assert_allclose(found, dmp.rollout().positions + shift, rtol=0, atol=1e-11)


@pytest.mark.parametrize("scaling", SCALED)
def test_a_goal_equal_to_the_start_gives_a_motion_that_stays(scaling: Any) -> None:
    dmp = fitted(1)
    found = path(dmp, scaling=scaling, goal_position=dmp.start_position)
    np.testing.assert_allclose(found - dmp.start_position, 0, atol=1e-13)


@pytest.mark.parametrize("scaling", SCALED)
def test_the_path_shrinks_evenly_with_its_goal(scaling: Any) -> None:
    dmp = fitted(2)
    own = dmp.law
    for part in (1e-12, 1e-6, 1e-2, 1e3):
        goal = own.start_position + part * (own.goal_position - own.start_position)
        found = path(dmp, scaling=scaling, goal_position=goal) - own.start_position
        wanted = part * (dmp.rollout().positions - own.start_position)
        # Adding so little to the start rounds it.
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 + 1e-9 * part)


# -------------------------------------------------------------------- opposite directions


@given(seeds)
@settings(max_examples=10)
def test_into_the_opposite_direction_it_turns_about_the_vertical(seed: int) -> None:
    rng = np.random.default_rng(seed)
    level = np.array([*rng.uniform(0.3, 1, 2) * rng.choice([-1, 1], 2), 0.0])
    dmp = fitted(seed, level)
    own = dmp.law
    goal = own.start_position - 0.7 * (own.goal_position - own.start_position)
    found = path(dmp, scaling="rotation-dilation", goal_position=goal) - own.start_position
    about_z = 0.7 * np.diag([-1.0, -1.0, 1.0])
    wanted = (dmp.rollout().positions - own.start_position) @ about_z.T
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("way", [(0, 0, 1), (0, 0, -1), (0.01, 0, 1), (1, 2, 3), (0, -1, 0)])
def test_the_opposite_of_any_direction_is_a_rotation(way: Any) -> None:
    dmp = fitted(3, np.array(way, dtype=float))
    own = dmp.law
    goal = own.start_position - (own.goal_position - own.start_position)
    found = path(dmp, scaling="rotation-dilation", goal_position=goal) - own.start_position
    given_ = dmp.rollout().positions - own.start_position
    # A primitive ends next to its goal, not in it.
    np.testing.assert_allclose(found[-1], -given_[-1], atol=1e-5)
    # Distances and handedness: mirrored paths would keep the one and not the other.
    picked = [60, 120, 240]
    np.testing.assert_allclose(found[picked] @ found[picked].T, given_[picked] @ given_[picked].T)
    volumes = [float(np.linalg.det(x[picked])) for x in (found, given_)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-6) and abs(volumes[1]) > 1e-6


@given(seeds, st.floats(1e-12, 1e-3))
@settings(max_examples=15)
def test_near_the_opposite_direction_the_path_is_still_a_rotated_one(
    seed: int, beside: float
) -> None:
    dmp = fitted(seed)
    own = dmp.law
    way = own.goal_position - own.start_position
    sideways = np.cross(way, np.random.default_rng(seed).normal(size=3))
    goal = own.start_position - way + beside * sideways
    found = path(dmp, scaling="rotation-dilation", goal_position=goal) - own.start_position
    given_ = dmp.rollout().positions - own.start_position
    ratio = np.linalg.norm(goal - own.start_position) / np.linalg.norm(way)
    lengths = [np.linalg.norm(x, axis=1) for x in (found, given_)]
    np.testing.assert_allclose(lengths[0], ratio * lengths[1], atol=1e-9)


@given(seeds)
@settings(max_examples=10)
def test_difference_mirrors_an_axis_whose_goal_changes_sides(seed: int) -> None:
    dmp = fitted(seed)
    own = dmp.law
    goal = own.start_position + (own.goal_position - own.start_position) * [1, -1, 1]
    found = path(dmp, scaling="difference", goal_position=goal) - own.start_position
    wanted = (dmp.rollout().positions - own.start_position) * [1, -1, 1]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10)


# -------------------------------------------------------------------- where no stretch means much


@pytest.mark.parametrize("way", [(1, 0, 0.5), (1, 0.04, 0.5), (1, -0.049, 0.5)])
def test_an_axis_without_a_way_of_its_own_is_not_stretched(way: Any) -> None:
    dmp = fitted(4, np.array(way))
    goal = dmp.start_position + [2.0, 0.3, 1.0]
    found = path(dmp, scaling="difference", goal_position=goal)
    plain = dmp.rollout(goal_position=goal, goal_form="paper").positions
    np.testing.assert_allclose(found[:, 1], plain[:, 1], rtol=0, atol=1e-12)
    # The other axes are.
    given_ = dmp.rollout().positions - dmp.start_position
    wanted = 2.0 * given_[:, 0]
    np.testing.assert_allclose(found[:, 0] - dmp.start_position[0], wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scaling", SCALED)
@given(seeds, st.sampled_from([0.0, 1e-15, 1e-9, 1e-5]))
@settings(max_examples=10)
def test_a_closed_path_is_not_scaled(scaling: Any, seed: int, gap: float) -> None:
    dmp = fitted(seed, gap * np.array([1.0, -2.0, 0.5]))
    goal = dmp.goal_position + [0.1, 0.2, -0.3]
    found = path(dmp, scaling=scaling, goal_position=goal)
    plain = dmp.rollout(goal_position=goal, goal_form="paper").positions
    np.testing.assert_array_equal(found, plain)


# Millimeters or kilometers: what counts as closed is relative.
@pytest.mark.parametrize("scaling", SCALED)
@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e3, 1e6])
def test_scaling_knows_no_unit_of_length(scaling: Any, size: float) -> None:
    small = curve(5)
    large = PoseTrajectory(small.times, size * small.positions, small.rotations)
    goal = np.array([0.4, -0.3, 0.8])
    one = path(learn(small, basis_functions=30), scaling=scaling, goal_position=goal)
    other = path(learn(large, basis_functions=30), scaling=scaling, goal_position=size * goal)
    np.testing.assert_allclose(other / size, one, rtol=0, atol=1e-9)


# -------------------------------------------------------------------- arguments


@pytest.mark.parametrize(
    "arguments",
    [
        {"scaling": "ratio"},
        {"scaling": None},
        {"scaling": "none", "goal_position": [0, np.nan, 0]},
        {"scaling": "difference", "goal_position": [0, 1]},
        {"scaling": "rotation-dilation", "start_position": "here"},
    ],
)
def test_bad_arguments_are_refused_in_one_line(arguments: Any) -> None:
    refusal(InputError, scaled, fitted(1).law, **arguments)
