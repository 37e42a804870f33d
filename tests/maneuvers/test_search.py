"""Ways around obstacles: clear, exact, no tighter than allowed, and near the shortest."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noslip._typing import Floats
from noslip.errors import InputError
from noslip.maneuvers.clearing import Clear, least_margin
from noslip.maneuvers.maneuver import Maneuver, Stretch, integrated
from noslip.maneuvers.planar import dubins
from noslip.maneuvers.search import through

RADIUS = 0.5


def capsules(segments: object, radius: float, point: tuple[float, float] = (0.0, 0.0)) -> Clear:
    """Distances of a point of the tool from line segments, shape (K, 2, 2), in closed form."""
    begins, ends = np.moveaxis(np.reshape(segments, (-1, 2, 2)), 1, 0)
    ways = ends - begins

    def clear(positions: Floats, quaternions: Floats) -> Floats:
        angle = 2 * np.arctan2(quaternions[:, 3], quaternions[:, 0])
        turn = np.exp(1j * angle) * complex(*point)
        at = positions[:, :2] + np.column_stack([turn.real, turn.imag])
        offset = at[:, None] - begins
        along = np.sum(offset * ways, axis=2) / np.maximum(np.sum(ways**2, axis=1), 1e-300)
        offset -= np.clip(along, 0, 1)[..., None] * ways
        return np.min(np.linalg.norm(offset, axis=2), axis=1) - radius

    return clear


def discs(centers: object, radius: float) -> Clear:
    return capsules(np.repeat(np.reshape(centers, (-1, 1, 2)), 2, axis=1), radius)


def ring(center: tuple[float, float], size: float, sides: int = 24) -> Floats:
    corners = np.add(center, size * np.column_stack([f(_angles(sides)) for f in (np.cos, np.sin)]))
    return np.stack([corners[:-1], corners[1:]], axis=1)


def _angles(sides: int) -> Floats:
    return np.linspace(0, 2 * np.pi, sides + 1)


def sampled(maneuver: Maneuver, count: int = 2000) -> tuple[Floats, Floats]:
    """Poses in the plane along circles and straights, by trigonometry of its own."""
    at, heading, points, headings = 0j, 0.0, [], []
    for each in maneuver.stretches:
        assert each.turn[:2] == (0.0, 0.0)
        share, turn = np.linspace(0, 1, count), each.turn[2]
        angle = heading + share * turn
        if abs(turn) > 1e-12:
            way = each.advance / (1j * turn) * (np.exp(1j * angle) - np.exp(1j * heading))
        else:
            way = share * each.advance * np.exp(1j * heading)
        points.append(at + way)
        headings.append(angle)
        at, heading = points[-1][-1], angle[-1]
    z, angle = np.concatenate(points), np.concatenate(headings)
    zero = np.zeros(len(z))
    positions = np.column_stack([z.real, z.imag, zero])
    return positions, np.column_stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)])


def judge(found: Maneuver, goal: tuple[float, float, float], clear: Clear) -> None:
    positions, quaternions = sampled(found)
    assert np.min(clear(positions, quaternions)) >= -1e-9
    assert positions[-1] == pytest.approx([*goal[:2], 0.0], abs=1e-9)
    angle = 2 * np.arctan2(quaternions[-1, 3], quaternions[-1, 0])
    assert abs(np.exp(1j * angle) - np.exp(1j * goal[2])) < 1e-9


WALL = [[1.0, -1.5], [1.0, 1.5]]
BEHIND = (2.0, 0.0, 0.0)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("radius", [RADIUS, None])
def test_a_goal_behind_a_wall_is_reached(radius: float | None, reverse: bool) -> None:
    clear = capsules(WALL, 0.02)
    found = through(*BEHIND, radius, clear, reverse=reverse)
    assert found is not None
    judge(found, BEHIND, clear)
    for each in found.stretches:
        assert reverse or each.advance >= 0
        assert abs(each.turn[2]) <= abs(each.advance) / (radius or 1e-9) + 1e-12 or not radius
    # The band around the wall's end, and for what turns where it stands no more than that.
    shortest = 2 * np.hypot(1.0, 1.5)
    assert shortest < found.length < (1.3 if radius else 1.03) * shortest


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([RADIUS, None]), st.booleans())
def test_what_is_found_is_clear_exact_and_the_same_again(
    seed: int, radius: float | None, reverse: bool
) -> None:
    rng = np.random.default_rng(seed)
    clear = discs(rng.uniform(-3, 3, (12, 2)), rng.uniform(0.1, 0.4))
    goal = (*rng.uniform(-3, 3, 2), rng.uniform(-np.pi, np.pi))
    found = through(*goal, radius, clear, reverse=reverse, expansions=800)
    if found is None:
        return
    judge(found, goal, clear)
    for each in found.stretches:
        assert reverse or each.advance >= 0
        if radius is not None:
            assert abs(each.turn[2]) <= abs(each.advance) / radius * (1 + 1e-9)
    assert through(*goal, radius, clear, reverse=reverse, expansions=800) == found


def test_most_goals_among_obstacles_are_reached() -> None:
    """Of 10, at most one is not."""
    rng, reached = np.random.default_rng(0), 0
    clear = discs(rng.uniform(-3, 3, (12, 2)) + [0, 0.5], 0.25)
    free = []
    while len(free) < 11:
        pose = rng.uniform(-3, 3, 2)
        if clear(np.array([[*pose, 0]]), np.array([[1.0, 0, 0, 0]]))[0] > 0.1:
            free.append(pose)
    for goal in free[1:]:
        reached += through(*goal, 1.0, 0.4, clear, expansions=800) is not None
    assert reached >= 9


def test_where_nothing_is_in_the_way_it_is_the_shortest_word() -> None:
    goal = (-0.4, 1.1, 2.0)
    assert through(*goal, RADIUS, discs([[50, 50]], 1)) == dubins(*goal, RADIUS)[0]


@pytest.mark.parametrize("radius", [RADIUS, None])
def test_a_goal_within_a_closed_ring_is_not_found(radius: float | None) -> None:
    assert through(3.0, 0.0, 0.0, radius, capsules(ring((3, 0), 1), 1e-3), expansions=500) is None


@pytest.mark.parametrize("goal", [(1.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
def test_a_start_or_goal_within_an_obstacle_is_not_found(goal: tuple[float, float, float]) -> None:
    place = (0.0, 0.0) if goal[0] == 3 else goal[:2]
    assert through(*goal, RADIUS, discs([place], 0.3)) is None


def test_a_point_ahead_of_the_edge_is_kept_clear_as_well() -> None:
    """A tool with a nose may not turn it through the wall."""
    nose, goal = 0.4, (0.0, -1.0, np.pi / 2)
    wall = capsules([[0.5, -3.0], [0.5, 3.0]], 0.05, (nose, 0.0))
    found = through(*goal, None, wall, reach=nose)
    assert found is not None
    judge(found, goal, wall)
    assert least_margin(found, wall, 0.05, reach=nose) >= -1e-9


def test_the_margin_is_a_bound_and_no_worse_than_said() -> None:
    arc = Maneuver((Stretch("left", 1.0, (0.0, 0.0, 2.0)), Stretch("straight", -0.7)))
    for spacing in (0.3, 0.1, 0.03):
        for center in ([0.3, 0.9], [0.55, 0.4], [2.0, 0.0]):
            clear = discs([center], 0.05)
            true = float(np.min(clear(*sampled(arc))))
            assert true - spacing / 2 <= least_margin(arc, clear, spacing) <= true + 1e-6


def test_what_lies_between_samples_is_seen() -> None:
    """A thread across the way, thinner than any spacing."""
    straight = Maneuver((Stretch("straight", 1.0),))
    thread = capsules([[0.437, -1], [0.437, 1]], 1e-6)
    assert least_margin(straight, thread, 0.1) < 0
    assert least_margin(Maneuver(()), thread, 0.1) == pytest.approx(0.437 - 1e-6)


def test_a_margin_that_is_no_number_is_not_clear() -> None:
    def nowhere(positions: Floats, quaternions: Floats) -> Floats:
        return np.where(positions[:, 0] > 0.5, np.nan, 1.0)

    assert through(2.0, 0.0, 0.0, RADIUS, nowhere, expansions=200) is None
    assert not least_margin(Maneuver((Stretch("straight", 1.0),)), nowhere, 0.1) >= 0


@pytest.mark.parametrize(
    "wrong", [{"x": np.nan}, {"radius": 0.0}, {"reach": -1.0}, {"expansions": 0}]
)
def test_what_means_nothing_is_refused(wrong: dict[str, float]) -> None:
    given = {"x": 1.0, "y": 0.0, "heading": 0.0, "radius": RADIUS, "clear": discs([9, 9], 1)}
    with pytest.raises(InputError, match=next(iter(wrong))):
        through(**(given | wrong))


def test_stretches_of_one_kind_are_one() -> None:
    found = through(*BEHIND, RADIUS, capsules(WALL, 0.02))
    assert found is not None
    kinds = [(each.name, each.advance > 0) for each in found.stretches]
    assert all(one != other for one, other in itertools.pairwise(kinds))
    twists = np.array([each.twist for each in found.stretches])
    assert integrated(twists)[0][-1] == pytest.approx(found.end[0])
