"""Maneuvers in the plane: they end where they say, and none is shorter."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from noslip.errors import InputError
from noslip.maneuvers.maneuver import Maneuver, Stretch
from noslip.maneuvers.planar import dubins, dubins_to_point, reeds_shepp, turn_drive_turn

PI = math.pi
SIDES = {"left": 1, "straight": 0, "right": -1}
SAME = 1e-8
"""Lengths, over that of the way, that differ by less are one."""

radii = st.sampled_from((1e-3, 0.3, 1.0, 7.0, 1e3))
# Goals that lie on what maneuvers are made of, where words appear and vanish, and any others.
special = st.sampled_from((0.0, 1e-13, -1e-12, 1e-6, -1e-3, 1.0, 2.0, -2.0, 4.0, 6.0))
coordinates = special | st.floats(-8.0, 8.0)
headings = st.sampled_from(
    (0.0, 1e-13, -1e-13, -1e-7, PI / 3, PI / 2, -PI / 2, PI, -PI, 2 * PI, 2 * PI - 1e-12)
) | st.floats(-7.0, 7.0)
# Arcs and straights, in radii.
amounts = st.sampled_from((0.0, 1e-12, 1e-5, PI / 2, PI)) | st.floats(0.0, PI)
words_forwards = st.lists(st.tuples(st.sampled_from(list(SIDES)), amounts), max_size=4)
words_both = st.lists(
    st.tuples(st.sampled_from(list(SIDES)), amounts | amounts.map(lambda x: -x)), max_size=5
)
# One of each of the families of Reeds and Shepp, which they mirror and turn round.
FAMILIES = ("+L+S+L", "+L+S+R", "+L-R+L", "+L+R-L", "+L-R-L", "+L+U-V-R", "+L-U-V+R")
QUARTERED = ("+L-Q-S-R", "+L-Q-S-L", "+L-Q-S-E+R")


def driven(word: Sequence[tuple[str, float]], radius: float) -> Maneuver:
    return Maneuver(
        tuple(
            Stretch(name, radius * amount, (0.0, 0.0, SIDES[name] * amount))
            for name, amount in word
        )
    )


def planar(maneuver: Maneuver) -> tuple[float, float, float]:
    """Where it leads: x, y (m) and heading (rad)."""
    (x, y, z), (w, i, j, k) = maneuver.end
    assert z == i == j == 0
    return x, y, 2 * math.atan2(k, w)


def require_end(maneuver: Maneuver, goal: Sequence[float], radius: float) -> None:
    """It ends at the goal, and is made of arcs of the radius and straights."""
    x, y, heading = planar(maneuver)
    off = math.hypot(x - goal[0], y - goal[1])
    assert off <= 1e-9 * maneuver.length + 1e-12 * radius, (str(maneuver), off)
    assert abs(math.remainder(heading - goal[2], 2 * PI)) <= 1e-9, str(maneuver)
    for stretch in maneuver.stretches:
        curvature = SIDES[stretch.name] / radius
        assert stretch.turn[2] == pytest.approx(curvature * stretch.advance, rel=1e-12)
        assert stretch.advance != 0


@settings(max_examples=150)
@given(coordinates, coordinates, headings, radii)
def test_dubins_ends_at_the_goal(x: float, y: float, heading: float, radius: float) -> None:
    goal = (radius * x, radius * y, heading)
    found = dubins(*goal, radius)
    assert found
    for maneuver in found:
        require_end(maneuver, goal, radius)
        assert all(each.advance > 0 for each in maneuver.stretches)
        assert all(each.angle < 2 * PI for each in maneuver.stretches)


@settings(max_examples=100)
@given(coordinates, coordinates, headings, radii)
def test_reeds_shepp_ends_at_the_goal(x: float, y: float, heading: float, radius: float) -> None:
    goal = (radius * x, radius * y, heading)
    found = reeds_shepp(*goal, radius)
    assert found
    for maneuver in found:
        require_end(maneuver, goal, radius)
        assert maneuver.cusps <= 2
        assert all(each.angle <= PI + 1e-9 for each in maneuver.stretches)


@settings(max_examples=80)
@given(coordinates, coordinates, radii)
def test_dubins_to_a_point_ends_there_and_is_the_shortest_of_all_headings(
    x: float, y: float, radius: float
) -> None:
    point = (radius * x, radius * y)
    found = dubins_to_point(*point, radius)
    ends = [planar(maneuver) for maneuver in found]
    for maneuver, end in zip(found, ends, strict=True):
        require_end(maneuver, (*point, end[2]), radius)
        assert all(each.advance > 0 for each in maneuver.stretches)
    lengths = [dubins(*point, turn, radius)[0].length for turn in np.arange(0, 2 * PI, 0.3)]
    assert found[0].length <= min(lengths) + SAME * radius


@given(coordinates, coordinates, headings, radii)
def test_no_maneuver_comes_twice_and_the_shorter_come_first(
    x: float, y: float, heading: float, radius: float
) -> None:
    for plan in (dubins, reeds_shepp):
        found = plan(radius * x, radius * y, heading, radius)
        for one, two in itertools.pairwise(found):
            assert one.length <= two.length + SAME * radius
        for one, two in itertools.combinations(found, 2):
            if one.name == two.name:
                ways = [[each.advance for each in m.stretches] for m in (one, two)]
                assert not np.allclose(*ways, rtol=1e-10, atol=1e-10 * radius)
        for maneuver in found:
            names = [each.name for each in maneuver.stretches]
            assert all(one != two for one, two in itertools.pairwise(names))


@settings(max_examples=150)
@given(words_forwards, radii)
def test_no_way_forwards_is_shorter_than_dubins(
    word: list[tuple[str, float]], radius: float
) -> None:
    # Whatever is driven with such curvature: no one of it may be shorter.
    way = driven(word, radius)
    assert dubins(*planar(way), radius)[0].length <= way.length + SAME * radius
    (x, y, _) = planar(way)
    assert dubins_to_point(x, y, radius)[0].length <= way.length + SAME * radius


@settings(max_examples=100)
@given(words_both, radii)
def test_no_way_is_shorter_than_reeds_and_shepp(
    word: list[tuple[str, float]], radius: float
) -> None:
    way = driven(word, radius)
    assert reeds_shepp(*planar(way), radius)[0].length <= way.length + SAME * radius


@settings(max_examples=100)
@given(
    st.sampled_from(FAMILIES + QUARTERED),
    st.tuples(amounts, amounts, amounts),
    st.sampled_from((1, -1)),
    st.booleans(),
    st.booleans(),
)
def test_no_family_of_reeds_and_shepp_is_missing(
    family: str, sizes: tuple[float, float, float], way: int, mirrored: bool, turned: bool
) -> None:
    first, inner, last = sizes
    # U and V are of one length, Q and E are quarter turns; each is to the other side.
    size = {"U": inner, "V": inner, "S": inner, "Q": PI / 2, "E": PI / 2}
    side = {"L": "left", "R": "right", "S": "straight", "U": "right", "V": "left", "Q": "right"}
    side["E"] = "left"
    signs, letters = family[::2], family[1::2]
    given_sizes = [size.get(letter, inner) for letter in letters]
    given_sizes[0], given_sizes[-1] = first, last
    word = [
        (side[letter], way * float(f"{sign}1") * amount)
        for sign, letter, amount in zip(signs, letters, given_sizes, strict=True)
    ]
    mirror = {"left": "right", "right": "left", "straight": "straight"}
    word = [(mirror[name], amount) if mirrored else (name, amount) for name, amount in word]
    driven_way = driven(word[::-1] if turned else word, 1.0)
    found = reeds_shepp(*planar(driven_way), 1.0)
    assert found[0].length <= driven_way.length + SAME
    # If its arcs are the shorter way round, the very same is among what is found.
    if min(sizes) > 1e-3 and max(first, last, inner) < PI - 1e-3:
        advances = [each.advance for each in driven_way.stretches]
        alike = [m for m in found if m.name == driven_way.name]
        assert any(
            np.allclose([e.advance for e in m.stretches], advances, atol=1e-6) for m in alike
        ), (str(driven_way), [str(m) for m in found])


@settings(max_examples=80)
@given(coordinates, coordinates, headings)
def test_distance_reeds_and_shepp_and_dubins_are_in_order(
    x: float, y: float, heading: float
) -> None:
    both, forwards = reeds_shepp(x, y, heading, 1.0)[0], dubins(x, y, heading, 1.0)[0]
    assert math.hypot(x, y) - SAME <= both.length <= forwards.length + SAME


def continuous(plan: object, *goals: tuple[float, float, float]) -> list[float]:
    return [plan(*goal, 1.0)[0].length for goal in goals]  # type: ignore[operator]


@settings(max_examples=80)
@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3.1, 3.1))
def test_mirrored_goals_and_ways_back_are_as_long(x: float, y: float, heading: float) -> None:
    c, s = math.cos(heading), math.sin(heading)
    # Where the start is, seen from the goal.
    back = (-c * x - s * y, s * x - c * y, -heading)
    # The same way back, with the tool turned round.
    round_about = (-back[0], -back[1], back[2])
    lengths = continuous(dubins, (x, y, heading), (x, -y, -heading), round_about)
    assert np.ptp(lengths) < SAME
    mirrored = ((x, -y, -heading), back, (-x, y, -heading))
    lengths = continuous(reeds_shepp, (x, y, heading), *mirrored)
    assert np.ptp(lengths) < SAME


@settings(max_examples=50)
@given(coordinates, coordinates, headings)
def test_lengths_scale(x: float, y: float, heading: float) -> None:
    for plan in (dubins, reeds_shepp):
        one, other = plan(x, y, heading, 1.0), plan(1e3 * x, 1e3 * y, heading, 1e3)
        assert other[0].length == pytest.approx(1e3 * one[0].length, rel=1e-9, abs=1e-7)


@settings(max_examples=100)
@given(st.floats(0.1, 6.0), st.sampled_from((1e-15, -1e-15, 1e-12, -1e-12, 0.0)), radii)
def test_rounding_makes_no_full_circle(amount: float, noise: float, radius: float) -> None:
    for name in SIDES:
        x, y, heading = planar(driven([(name, amount)], radius))
        for goal in (
            (x * (1 + noise), y, heading),
            (x, y + radius * noise, heading),
            (x, y, heading + noise),
        ):
            (stretch,) = dubins(*goal, radius)[0].stretches
            assert stretch.name == name
            assert stretch.advance == pytest.approx(radius * amount, rel=1e-9)
            (closest,) = {dubins_to_point(x, y, radius)[0].name} - {"stay"}
            assert closest == name
    # Backwards it is as well.
    for name in SIDES:
        amount = min(amount, 3.0)
        x, y, heading = planar(driven([(name, -amount)], radius))
        assert reeds_shepp(x, y, heading + noise, radius)[0].name == f"back {name}"


@given(radii)
def test_at_the_goal_it_stays(radius: float) -> None:
    for maneuvers in (
        dubins(0, 0, 0, radius),
        dubins(0, 0, 2 * PI, radius),
        dubins_to_point(0, 0, radius),
        reeds_shepp(0, 0, 0, radius),
        turn_drive_turn(0, 0, 0),
    ):
        assert str(maneuvers[0]) == "stay, 0 m"
        assert planar(maneuvers[0]) == (0, 0, 0)


@pytest.mark.parametrize(
    ("goal", "names"),
    [
        ((1.0, 0.0, 0.0), ["straight"]),
        ((-1.0, 0.0, 0.0), ["left-straight-left", "right-straight-right"]),
        ((0.0, 0.6, PI), ["left"]),
        ((0.3, -0.3, -PI / 2), ["right"]),
    ],
)
def test_plain_goals_have_plain_names(goal: tuple[float, float, float], names: list[str]) -> None:
    assert [maneuver.name for maneuver in dubins(*goal, 0.3)[: len(names)]] == names


def test_names_say_where_it_stops() -> None:
    assert reeds_shepp(-1.0, 0.0, 0.0, 0.3)[0].name == "back straight"
    assert reeds_shepp(0.0, 0.0, PI / 2, 0.3)[0].name == "left, back right, left"
    assert turn_drive_turn(1.0, 1.0, 0.0)[0].name == "turn left, straight, turn right"


@example(-1.0, 0.0, 0.0)
@example(0.0, 0.0, 2.0)
@given(coordinates, coordinates, headings)
def test_turn_drive_turn_ends_at_the_goal(x: float, y: float, heading: float) -> None:
    found = turn_drive_turn(x, y, heading, reverse=True)
    assert found[0].turning == min(each.turning for each in found)
    assert str(turn_drive_turn(x, y, heading)[0]) in [str(each) for each in found]
    for maneuver in found:
        assert np.allclose(planar(maneuver)[:2], (x, y), rtol=0, atol=1e-9)
        assert abs(math.remainder(planar(maneuver)[2] - heading, 2 * PI)) <= 1e-9
        assert maneuver.length == pytest.approx(math.hypot(x, y), abs=1e-9)
        for each in maneuver.stretches:
            assert each.angle <= PI + 1e-9
            assert (each.angle == 0) != (each.advance == 0)
            if each.angle:
                assert each.name == ("turn left" if each.turn[2] > 0 else "turn right")


def test_a_solver_of_differential_equations_ends_there_too() -> None:
    radius, goal = 0.3, (-0.7, 0.4, 2.0)
    for maneuver in (*dubins(*goal, radius), *reeds_shepp(*goal, radius)):
        pose = np.zeros(3)
        for each in maneuver.stretches:
            speed, rate = each.advance, each.turn[2]

            def unicycle(_: float, q: Sequence[float], v: float = speed, w: float = rate) -> list:
                return [v * math.cos(q[2]), v * math.sin(q[2]), w]

            pose = solve_ivp(unicycle, (0, 1), pose, rtol=1e-10, atol=1e-12).y[:, -1]
        off = pose - goal
        assert np.allclose([*off[:2], math.remainder(off[2], 2 * PI)], 0, atol=1e-8)


@pytest.mark.parametrize("plan", [dubins, reeds_shepp])
def test_what_is_no_goal_or_radius_is_refused(plan: object) -> None:
    for values in ((math.nan, 0, 0, 1), (0, math.inf, 0, 1), (0, 0, "left", 1)):
        with pytest.raises(InputError, match="x, y and heading must be 3 finite numbers"):
            plan(*values)  # type: ignore[operator]
    for radius in (0.0, -1.0, math.nan, 1e-15):
        with pytest.raises(InputError, match="radius must be"):
            plan(1.0, 0.0, 0.0, radius)  # type: ignore[operator]
    with pytest.raises(InputError, match="x, y and heading must be 3 finite numbers"):
        turn_drive_turn(math.nan, 0, 0)
