"""Maneuvers in space: they lead where they say, within their bends, and none is needlessly long."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._typing import Floats
from noslip.constraints import ForwardOnly, TurningRadius
from noslip.errors import InputError
from noslip.maneuvers import planar
from noslip.maneuvers.maneuver import Maneuver, Stretch, integrated
from noslip.maneuvers.spatial import arc_straight_arc, blade_turns, turn_drive_turn
from strategies import seeds

PI = math.pi
ACROSS = 1e-8
"""Ends are exact to this, in radii and rad."""
NEAR = 5.0
"""Radii: where ways lead round."""

radii = st.sampled_from((1e-3, 0.3, 1.0, 40.0))
# Places and turns of which arcs, straights and half turns are made, hardly off them, and any.
special = st.sampled_from((0.0, 1e-12, 1e-7, -1e-3, 0.5, 1.0, 2.0, -1.0, -2.0, 4.0, 30.0))
places = st.tuples(*3 * [special | st.floats(-NEAR, NEAR)]).map(np.array)
# A goal must be more than rounding off its start to tell a plane.
apart = st.sampled_from((0.0, 1.0, 2.0, -4.0)) | st.floats(-8, 8).filter(lambda x: abs(x) > 1e-3)
angles = st.sampled_from((0.0, 1e-9, 1e-4, PI / 2, -PI / 2, PI, PI - 1e-9)) | st.floats(-PI, PI)
turns = st.one_of(
    st.tuples(st.just(0.0), st.just(0.0), angles),
    st.tuples(angles, st.just(0.0), st.just(0.0)),
    st.tuples(*3 * [angles]),
).map(Rotation.from_rotvec)


def quaternion(rotation: Rotation) -> Floats:
    return np.asarray(rotation.as_quat(scalar_first=True))


def random_goal(rng: np.random.Generator, farthest: float, nearest: float = 0.0) -> tuple:
    """A pose in a ball, any rotation as likely as any other."""
    direction = rng.normal(size=3)
    distance = rng.uniform(nearest**3, farthest**3) ** (1 / 3)
    return distance * direction / np.linalg.norm(direction), Rotation.random(rng=rng)


def led(maneuver: Maneuver) -> tuple[Floats, Rotation]:
    """Where it leads: the matrix exponential of each stretch, by SciPy."""
    twists = [
        [[0, -z, y, way], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]]
        for way, (x, y, z) in ((each.advance, each.turn) for each in maneuver.stretches)
    ]
    pose = np.eye(4)
    for each in expm(np.array(twists).reshape(-1, 4, 4)):
        pose = pose @ each
    return pose[:3, 3], Rotation.from_matrix(pose[:3, :3])


def require_end(maneuver: Maneuver, position: Floats, rotation: Rotation, radius: float) -> None:
    reached, turned = led(maneuver)
    off = np.linalg.norm(reached - position)
    assert off <= ACROSS * (radius + maneuver.length), (str(maneuver), off)
    assert (turned * rotation.inv()).magnitude() <= ACROSS, str(maneuver)


def require_bends(maneuver: Maneuver, radius: float) -> None:
    """Forwards, nowhere tighter than the radius, and never much more roll than on the whole way."""
    rolled = sum(abs(each.turn[0]) for each in maneuver.stretches)
    for each in maneuver.stretches:
        assert each.advance > 0
        assert math.hypot(*each.turn[1:]) <= each.advance / radius * (1 + 1e-9)
        assert abs(each.turn[0]) * maneuver.length <= 2.001 * rolled * each.advance + 1e-8


@settings(max_examples=50)
@given(places, turns, radii)
@example(np.zeros(3), Rotation.from_rotvec([PI, 0, 0]), 1.0)
@example(np.zeros(3), Rotation.from_rotvec([0, PI, 0]), 1.0)
@example(np.array([-3.0, 0, 0]), Rotation.identity(), 1.0)
@example(np.array([0.0, 2.0, 0]), Rotation.from_rotvec([0, 0, PI]), 1.0)
@example(np.array([1e-4, 0, 0]), Rotation.from_rotvec([3, 0, 0]), 0.3)
def test_arcs_and_straights_lead_to_the_goal(
    place: Floats, rotation: Rotation, radius: float
) -> None:
    position = radius * place
    found = arc_straight_arc(position, quaternion(rotation), radius)
    assert found
    for maneuver in found[:6]:
        require_end(maneuver, position, rotation, radius)
        require_bends(maneuver, radius)
    lengths = [round(each.length / radius, 9) for each in found]
    assert lengths == sorted(lengths)


def test_every_pose_is_reached_by_a_way_of_reasonable_length() -> None:
    rng = np.random.default_rng(19)
    goals = [random_goal(rng, NEAR) for _ in range(60)]
    beyond = []
    for position, rotation in goals:
        found = arc_straight_arc(position, quaternion(rotation), 1.0)
        least = shortest_conceivable(position, rotation)
        assert found[0].length >= least - 1e-9
        beyond.append(found[0].length / least)
    assert np.median(beyond) < 1.3


def shortest_conceivable(position: Floats, rotation: Rotation) -> float:
    """No way with curvature 1 is shorter: to the goal's place or travel alone, and backwards."""
    back = -rotation.inv().apply(position)
    travel = rotation.apply([1.0, 0.0, 0.0])
    ways = [math.acos(np.clip(travel[0], -1, 1))]
    for x, y, z in (position, (-back[0], back[1], back[2])):
        ways.append(math.hypot(x, y, z))
        # Outside of the first circles the shortest way to a point lies in the plane of its travel.
        if math.hypot(x, math.hypot(y, z) - 1) >= 1:
            ways.append(planar.dubins_to_point(x, math.hypot(y, z), 1.0)[0].length)
    return max(ways)


def driven(rng: np.random.Generator) -> Maneuver:
    """Arc, straight, arc: bent about any axes, rolled evenly."""
    bends = rng.uniform(0, PI, 2)
    axes = rng.uniform(-PI, PI, 2)
    straight = rng.uniform(0, 4)
    # A short way that rolls far is one of its kind, and not always found.
    rate = rng.uniform(-0.5, 0.5)
    arcs = [
        Stretch("arc", bend, (rate * bend, bend * math.cos(axis), bend * math.sin(axis)))
        for bend, axis in zip(bends, axes, strict=True)
    ]
    return Maneuver((arcs[0], Stretch("straight", straight, (rate * straight, 0, 0)), arcs[1]))


def test_no_longer_than_the_way_by_which_a_goal_was_made() -> None:
    rng = np.random.default_rng(20)
    shares = []
    for _ in range(60):
        made = driven(rng)
        position, rotation = led(made)
        found = arc_straight_arc(position, quaternion(rotation), 1.0)
        shares.append(found[0].length / made.length)
    assert np.mean(np.array(shares) <= 1.02) >= 0.95
    assert max(shares) <= 1.15


@settings(max_examples=60)
@given(apart, apart, apart, angles, radii)
def test_in_a_plane_it_is_dubins(
    x: float, y: float, heading: float, tilt: float, radius: float
) -> None:
    """In any plane that holds the travel, which is kept."""
    plane = Rotation.from_rotvec([tilt, 0, 0])
    position = plane.apply([radius * x, radius * y, 0])
    rotation = plane * Rotation.from_rotvec([0, 0, heading]) * plane.inv()
    found = arc_straight_arc(position, quaternion(rotation), radius)
    flat = planar.dubins(radius * x, radius * y, heading, radius)
    assert found[0].length == pytest.approx(flat[0].length, abs=1e-7 * radius)
    # A goal straight ahead lies in many planes.
    told = abs(y) > 1e-3 or abs(math.sin(heading)) > 1e-3
    for maneuver in found if told else ():
        for stretch in maneuver.stretches:
            inside = plane.inv().apply(stretch.turn)
            np.testing.assert_allclose(inside[:2], 0, atol=1e-6)


@settings(max_examples=30)
@given(seeds, angles)
def test_the_way_is_the_same_seen_otherwise(seed: int, angle: float) -> None:
    """Rolled, mirrored, and driven back from the goal: far away, where straights do the rolling."""
    position, rotation = random_goal(np.random.default_rng(seed), 40.0, 20.0)
    rolled = Rotation.from_rotvec([angle, 0, 0])
    mirror = np.diag([1.0, 1.0, -1.0])
    about = Rotation.from_rotvec([0, 0, PI])
    length = arc_straight_arc(position, quaternion(rotation), 1.0)[0].length
    for other, turned in (
        (rolled.apply(position), rolled * rotation * rolled.inv()),
        (mirror @ position, Rotation.from_matrix(mirror @ rotation.as_matrix() @ mirror)),
        (about.apply(-rotation.inv().apply(position)), about * rotation.inv() * about.inv()),
    ):
        found = arc_straight_arc(other, quaternion(turned), 1.0)
        assert found[0].length == pytest.approx(length, rel=1e-7)


def poses(maneuver: Maneuver, most: float) -> ns.PoseTrajectory:
    """It driven in small steps of 10 ms, each of a way and an angle below the most."""
    pieces = []
    for stretch in maneuver.stretches:
        count = math.ceil(max(stretch.advance, stretch.angle) / most)
        pieces.append(np.tile(stretch.twist / count, (count, 1)))
    positions, quaternions = integrated(np.vstack(pieces))
    rotations = Rotation.from_quat(quaternions, scalar_first=True)
    return ns.PoseTrajectory(0.01 * np.arange(len(positions)), positions, rotations)


@pytest.mark.parametrize("way", [arc_straight_arc, blade_turns])
def test_a_blade_follows(way: Callable[[Floats, Floats, float], list[Maneuver]]) -> None:
    """The constraints as they are declared hold on its way."""
    rng = np.random.default_rng(5)
    rules = [ns.Blade(), ForwardOnly(), TurningRadius(1.0)]
    for _ in range(8):
        position, rotation = random_goal(rng, NEAR)
        # With some margin for steps.
        for maneuver in way(position, quaternion(rotation), 1.001)[:3]:
            report = ns.check(poses(maneuver, 0.01), rules, tolerance=1e-4)
            assert report.satisfied, report


@settings(max_examples=30)
@given(places, turns, radii)
def test_blades_turn_where_they_stand(place: Floats, rotation: Rotation, radius: float) -> None:
    position = radius * place
    found = blade_turns(position, quaternion(rotation), radius)
    assert found[0].length == pytest.approx(np.linalg.norm(position), abs=1e-8 * radius)
    for maneuver in found[:4]:
        require_end(maneuver, position, rotation, radius)
        for each in maneuver.stretches:
            assert each.advance >= 0
            assert abs(each.turn[2]) <= each.advance / radius * (1 + 1e-9) + 1e-14


@given(places, angles, radii)
def test_in_its_plane_a_blade_drives_as_a_car(place: Floats, heading: float, radius: float) -> None:
    x, y, _ = radius * place
    rotation = Rotation.from_rotvec([0, 0, heading])
    found = [each.name for each in blade_turns(np.array([x, y, 0]), quaternion(rotation), radius)]
    if math.hypot(x, y) > 1e-8 * radius:
        assert planar.dubins(x, y, heading, radius)[0].name in found


@given(places, turns)
def test_turn_drive_turn_leads_to_the_goal(position: Floats, rotation: Rotation) -> None:
    found = turn_drive_turn(position, quaternion(rotation), reverse=True)
    way = float(np.linalg.norm(position))
    courses = []
    for maneuver in found:
        require_end(maneuver, position, rotation, 1.0)
        assert maneuver.length == pytest.approx(way, abs=1e-8)
        courses.append(sum(each.advance for each in maneuver.stretches))
        # No rotation of the travel to the way, and from there to the goal, is shorter.
        if way > 1e-8:
            x = math.copysign(1.0, courses[-1]) * position / way
            between = math.acos(np.clip(x[0], -1, 1))
            assert maneuver.stretches[0].angle == pytest.approx(between, abs=1e-6) or between < 1e-6
    assert sorted(courses) == pytest.approx([-way, way] if way > 1e-9 else [0.0])
    turning = [each.turning for each in found]
    assert turning == sorted(turning)
    (forwards,) = turn_drive_turn(position, quaternion(rotation))
    assert forwards in found


@given(apart, apart, st.floats(-3, 3))
def test_turn_drive_turn_in_the_plane_is_that_of_the_plane(
    x: float, y: float, heading: float
) -> None:
    flat = planar.turn_drive_turn(x, y, heading, reverse=True)
    rotation = Rotation.from_rotvec([0, 0, heading])
    found = turn_drive_turn(np.array([x, y, 0.0]), quaternion(rotation), reverse=True)
    assert [each.turning for each in found] == pytest.approx([each.turning for each in flat])
    for one, other in itertools.product(found, flat):
        if ("back" in one.name) == ("back" in other.name):
            assert one.name == other.name


def test_names_say_where_travel_goes() -> None:
    still = [1.0, 0.0, 0.0, 0.0]
    up = quaternion(Rotation.from_rotvec([0, -PI / 2, 0]))
    assert arc_straight_arc([2, 0, 0], still, 1.0)[0].name == "straight"
    assert arc_straight_arc([2, 0, 1], up, 1.0)[0].name == "straight-up"
    left = quaternion(Rotation.from_rotvec([0, 0, PI / 2]))
    assert arc_straight_arc([1, 1, 0], left, 1.0)[0].name == "left"
    assert turn_drive_turn([0, 0, -1], up)[0].name == "turn down, straight, turn down"
    assert turn_drive_turn([0, 0, 0], [0, 1, 0, 0])[0].name == "roll"
    assert arc_straight_arc([0, 0, 0], still, 1.0)[0].name == "stay"
    # Half a turn over, and half a turn back: upside down, back is to the left, too.
    assert str(blade_turns([0, 2, 0], still, 1.0)[0]) == "turn left, straight, turn left, 2 m"


@pytest.mark.parametrize("way", [arc_straight_arc, blade_turns])
def test_what_is_no_goal_is_told(way: Callable[..., list[Maneuver]]) -> None:
    still = [1.0, 0.0, 0.0, 0.0]
    with pytest.raises(InputError, match="position must be 3 finite numbers"):
        way([0, math.nan, 1], still, 1.0)
    with pytest.raises(InputError, match="quaternion must be 4 numbers of norm 1"):
        way([0, 0, 1], [1.0, 1.0, 0.0, 0.0], 1.0)
    with pytest.raises(InputError, match="quaternion must be 4 numbers of norm 1"):
        way([0, 0, 1], [math.nan, 0.0, 0.0, 0.0], 1.0)
    with pytest.raises(InputError, match="radius must be a positive number of meters"):
        way([0, 0, 1], still, 0.0)
    with pytest.raises(InputError, match="position must be 3 finite numbers"):
        turn_drive_turn([math.inf, 0, 1], still)
