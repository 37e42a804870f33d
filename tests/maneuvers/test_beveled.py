"""Ways of a beveled needle: they bend as its tip makes them, and end where they are asked to."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.check import step_residuals
from noslip.constraints.needle import Needle
from noslip.constraints.system import as_system
from noslip.edge import Axis
from noslip.errors import InputError
from noslip.maneuvers.beveled import beveled, nearest_beveled
from noslip.maneuvers.maneuver import Maneuver, integrated
from noslip.maneuvers.steering import Steering
from noslip.quaternions import product
from noslip.trajectory import PoseTrajectory

NEAR = 1e-8
"""Off a pose, of the way and rad: what integrating by another method leaves."""

curvatures = st.floats(2.0, 10.0) | st.floats(-10.0, -2.0)
lengths = st.floats(0.1, 0.3)
rolls = st.floats(0.05, 8.0)
"""Root mean square (rad over the whole way): from nearly an arc to some turns."""
shapes = st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5).filter(
    lambda shape: float(np.linalg.norm(shape)) > 0.3
)


def inserted(
    curvature: float, length: float, roll: float, shape: list[float]
) -> tuple[Floats, Floats]:
    """Where a needle comes to under a smooth roll: the model's equations, integrated."""

    def rate(u: float) -> float:
        steady, *waves = shape
        return steady + sum(
            a * math.sin(2 * math.pi * (k + 1) * u / 2 + k) for k, a in enumerate(waves)
        )

    size = roll / math.sqrt(np.mean([rate(u) ** 2 for u in np.linspace(0, 1, 201)]))
    return moved(lambda u: size * rate(u), curvature * length, length)


def moved(roll: Callable[[float], float], bend: float, length: float) -> tuple[Floats, Floats]:
    """Unicycle of Webster et al.: roll (rad) per share of the way, bend (rad) and length of all."""

    def change(u: float, pose: Floats) -> Floats:
        axes = pose[3:].reshape(3, 3)
        turn = np.array([[0, -bend, 0], [bend, 0, -roll(u)], [0, roll(u), 0]])
        return np.concatenate([length * axes[:, 0], (axes @ turn).ravel()])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    end = solve_ivp(change, (0, 1), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    quaternion = Rotation.from_matrix(end[3:].reshape(3, 3)).as_quat(scalar_first=True)
    return end[:3], quaternion


def missed(maneuver: Maneuver, position: Floats, quaternion: Floats) -> tuple[float, float]:
    """Off a pose (m, rad)."""
    there, turned = maneuver.end
    one, other = (Rotation.from_quat(q, scalar_first=True) for q in (turned, quaternion))
    return float(np.linalg.norm(there - position)), float((one * other.inv()).magnitude())


@settings(max_examples=15)
@given(curvatures, lengths, rolls, shapes)
def test_what_a_needle_reaches_it_is_led_to(
    curvature: float, length: float, roll: float, shape: list[float]
) -> None:
    position, quaternion = inserted(curvature, length, roll, shape)
    found = beveled(position, quaternion, curvature)
    if not found:
        nearest = nearest_beveled(position, quaternion, curvature)
        # Next to an arc, beside all that a few cosines reach: by less than anyone measures.
        assert nearest.moved <= 1e-4 * length
        assert nearest.turned <= 1e-3
        return
    for maneuver in found:
        moved, turned = missed(maneuver, position, quaternion)
        assert moved <= NEAR * length
        assert turned <= NEAR
    # No detour to save some roll.
    assert found[0].length <= 1.1 * length


@settings(max_examples=6)
@given(curvatures, lengths, rolls, shapes)
def test_it_bends_everywhere_alike_and_rolls_smoothly(
    curvature: float, length: float, roll: float, shape: list[float]
) -> None:
    for maneuver in beveled(*inserted(curvature, length, roll, shape), curvature, stretches=400):
        advances = np.array([each.advance for each in maneuver.stretches])
        turns = np.array([each.turn for each in maneuver.stretches])
        assert len(advances) == 400
        assert np.all(advances > 0)
        np.testing.assert_array_equal(turns[:, 1], 0)
        np.testing.assert_allclose(turns[:, 2], curvature * advances, rtol=1e-12)
        # Cosines of up to 19 half waves change by 19 pi / 400 of the largest (Bernstein).
        changes = np.abs(np.diff(turns[:, 0]))
        assert changes.max() <= 0.15 * np.abs(turns[:, 0]).max() + 1e-12
        assert max(changes[0], changes[-1]) <= 0.02 * np.abs(turns[:, 0]).max() + 1e-12


@settings(max_examples=5)
@given(curvatures, lengths, rolls, shapes)
def test_its_end_is_that_of_the_model(
    curvature: float, length: float, roll: float, shape: list[float]
) -> None:
    for maneuver in beveled(*inserted(curvature, length, roll, shape), curvature, stretches=16)[:1]:
        position, axes = np.zeros(3), Rotation.identity()
        for each in maneuver.stretches:
            step, turned = moved(lambda u, r=each.turn[0]: r, each.turn[2], each.advance)
            position = position + axes.apply(step)
            axes = axes * Rotation.from_quat(turned, scalar_first=True)
        assert max(missed(maneuver, position, axes.as_quat(scalar_first=True))) <= NEAR


@given(curvatures, lengths)
@settings(max_examples=5)
def test_without_roll_it_is_an_arc(curvature: float, length: float) -> None:
    bend = curvature * length
    position = np.array([math.sin(bend), 1 - math.cos(bend), 0.0]) / curvature
    quaternion = np.array([math.cos(bend / 2), 0.0, 0.0, math.sin(bend / 2)])
    shortest = beveled(position, quaternion, curvature)[0]
    assert shortest.length == pytest.approx(length, rel=1e-6)
    assert max(abs(each.turn[0]) for each in shortest.stretches) <= 1e-3


def test_it_goes_straight_by_rolling_all_the_way() -> None:
    shortest = beveled((0.1, 0, 0), (1, 0, 0, 0), 5.0)[0]
    assert max(missed(shortest, np.array([0.1, 0, 0]), np.array([1.0, 0, 0, 0]))) <= NEAR
    # A bend of half a radian, straightened by two turns of roll, is hardly longer.
    assert 0.1 < shortest.length <= 0.1005
    assert shortest.turning <= 4.1 * math.pi


def test_the_same_pose_gives_the_same_ways_whatever_was_asked_before() -> None:
    pose = inserted(4.0, 0.2, 2.0, [0.5, 1, -1, 0.3, 0.2])
    found = beveled(*pose, 4.0)
    beveled((0.1, 0, 0), (1, 0, 0, 0), 5.0)
    assert beveled(*pose, 4.0) == found


@settings(max_examples=5)
@given(curvatures, lengths, rolls, shapes)
def test_of_the_mirrored_bend_it_leads_to_the_mirrored_pose(
    curvature: float, length: float, roll: float, shape: list[float]
) -> None:
    position, quaternion = inserted(curvature, length, roll, shape)
    mirrored = position * [1, -1, 1], quaternion * [1, -1, 1, -1]
    for maneuver in beveled(*mirrored, -curvature):
        assert max(missed(maneuver, *mirrored)) <= NEAR


def test_its_ways_to_one_pose_roll_differently() -> None:
    found = beveled((0.15, 0, 0), (1, 0, 0, 0), 5.0)
    assert len(found) > 1
    rolls = np.array([[each.turn[0] for each in way.stretches] for way in found])
    for k, one in enumerate(rolls):
        for other in rolls[:k]:
            assert np.abs(one - other).sum() > 0.3


def test_where_it_is_it_may_roll() -> None:
    (rolled,) = beveled((0, 0, 0), (math.cos(0.3), math.sin(0.3), 0, 0), 5.0)
    assert rolled.length == 0
    assert rolled.turning == pytest.approx(0.6)
    assert beveled((0, 0, 0), (math.cos(0.3), 0, math.sin(0.3), 0), 5.0) == []


@pytest.mark.parametrize("curvature", [5.0, -3.0])
def test_what_bends_more_than_it_does_is_come_near_to(curvature: float) -> None:
    # Twice the bend that it has.
    bend = 0.2 * curvature
    position = np.array([math.sin(bend), 1 - math.cos(bend), 0.0]) / (2 * curvature)
    quaternion = np.array([math.cos(bend / 2), 0.0, 0.0, math.sin(bend / 2)])
    assert beveled(position, quaternion, curvature) == []
    nearest = nearest_beveled(position, quaternion, curvature)
    moved, turned = missed(nearest.maneuver, position, quaternion)
    assert nearest.moved == pytest.approx(moved, rel=1e-9)
    assert nearest.turned == pytest.approx(turned, rel=1e-9)
    straight = np.linalg.norm(position - [0.1, 0, 0]), abs(bend)
    assert 0 < moved < straight[0]
    assert 0 < turned < straight[1]
    # It lacks bend in the plane: aside and about the bevel axis.
    assert "moved along y" in nearest.directions
    assert nearest.lost.shape[1] == 6


@settings(max_examples=4)
@given(curvatures, st.integers(0, 2**16))
def test_in_lost_directions_its_end_hardly_moves(curvature: float, seed: int) -> None:
    nearest = nearest_beveled((0.1, 0.03, 0.0), (1, 0, 0, 0), curvature)
    assert len(nearest.lost)
    np.testing.assert_allclose(nearest.lost @ nearest.lost.T, np.eye(len(nearest.lost)), atol=1e-9)
    way = nearest.maneuver
    before = way.end
    # Roll that changes a little, smoothly and at random, seen from the end as it was.
    u = (np.arange(len(way.stretches)) + 0.5) / len(way.stretches)
    waves = np.random.default_rng(seed).normal(size=4)
    change = 1e-4 * sum(a * np.cos(k * math.pi * u) for k, a in enumerate(waves)) / len(u)
    twisted = np.array([each.twist for each in way.stretches])
    twisted[:, 3] += change
    positions, quaternions = integrated(twisted)
    axes = Rotation.from_quat(before[1], scalar_first=True)
    there = Rotation.from_quat(quaternions[-1], scalar_first=True)
    distance = math.hypot(0.1, 0.03)
    step = np.concatenate(
        [axes.inv().apply(positions[-1] - before[0]) / distance, (axes.inv() * there).as_rotvec()]
    )
    assert np.abs(nearest.lost @ step).max() <= 0.03 * 1e-4 * np.linalg.norm(waves)


@pytest.mark.parametrize(
    ("position", "quaternion", "curvature", "says"),
    [
        ((0.1, 0, 0), (1, 0, 0, 0), 0.0, "curvature is 0"),
        ((0.1, 0, 0), (1, 0, 0, 0), 1e-300, "does not bend"),
        ((0.1, 0, 0), (1, 0, 0, 0), math.nan, "curvature"),
        ((0.1, 0, math.nan), (1, 0, 0, 0), 5.0, "position"),
        ((0.1, 0, 0), (0, 0, 0, 0), 5.0, "quaternion"),
        ((0.1, 0, 0), (1, 0, 0), 5.0, "quaternion"),
        ((0.1, 0, 0), (1, math.nan, 0, 0), 5.0, "quaternion"),
    ],
)
def test_what_is_no_pose_is_refused(
    position: tuple[float, ...], quaternion: tuple[float, ...], curvature: float, says: str
) -> None:
    for asked in (beveled, nearest_beveled):
        with pytest.raises(InputError, match=says):
            asked(position, quaternion, curvature)
    with pytest.raises(InputError, match="stretches"):
        beveled((0.1, 0, 0), (1, 0, 0, 0), 5.0, stretches=0)


@pytest.mark.parametrize("curvature", [4.0, -4.0])
@pytest.mark.parametrize(
    ("shaft", "bevel"),
    [("x", "z"), ("x", "-z"), ("-x", "y"), ("z", "-x"), ("y", (1.0, 0.2, -1.0))],
)
def test_whatever_its_axes_its_ways_keep_its_declaration(
    shaft: Axis, bevel: Axis, curvature: float
) -> None:
    needle = Needle(shaft, curvature, bevel, reference_point=(0.01, 0.02, -0.03))
    steering = Steering.of(as_system(needle), reverse=False)
    assert steering is not None
    origin, turn = np.array([0.3, -0.2, 0.1]), Rotation.from_rotvec([0.5, 1.0, -2.0])
    first = steering.seen(origin, turn)
    goal = inserted(steering.curvature, 0.2, 3.0, [0.5, 1.0, -1.0, 0.3, 0.2])
    axes = Rotation.from_quat(first[1], scalar_first=True)
    last = first[0] + axes.apply(goal[0]), product(first[1], goal[1])
    maneuver = steering.proposals(first, last)[0]
    # In steps that are so short that a helix is its middle.
    twists = np.repeat([each.twist / 100 for each in maneuver.stretches], 100, axis=0)
    positions, rotations = steering.carried(*integrated(twists, *first))
    motion = PoseTrajectory(np.arange(len(positions)) * 1e-3, positions, rotations)
    speed = motion.path_length / motion.duration
    assert np.abs(step_residuals(motion, needle)).max() <= 1e-4 * speed
