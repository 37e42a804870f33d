"""Maneuvers in space, for a tool that moves along its edge: from one pose to another.

All start at the edge's own frame (x along its travel) and lead to a position and a rotation seen
from there.  Each function returns all that it finds, the shortest first, then what turns least.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.maneuvers import planar
from noslip.maneuvers.bending import Sequence, poses
from noslip.maneuvers.maneuver import Maneuver, Stretch, rotated
from noslip.quaternions import inverse, product, turns_between

_ANGLES = 384
"""Of the first arc, at which straights to the last arc are looked for: the shortest way of 4 of 600
random goals is lost, with a quarter of the angles of 15."""
_NEAR = 0.02
"""Where two solutions meet, the search may see no change of sign: cosines this near are tried."""
_HOPEFUL = 0.5
"""By how much the straight of what is found first may be too short (radii)."""
_SAME = 1e-9
"""How far what counts as the same may be apart, in radii and rad."""
_MOST = 4
"""Candidates whose roll is spread, the shortest; of three arcs, twice as many are worked out."""
_DETOUR = 5.0
"""Way beyond the distance (radii) that tells of a goal so near that three arcs may be shorter: so
it is of all those, and of no others, of 100 random goals where they are by 3 % or more."""
_TRIES = 32
"""Random starts of three arcs."""
_BEND = 1.8
"""Standard deviation of the starts' bends about each axis (rad): arcs of 130 degrees on average."""

_ARC_STRAIGHT_ARC = Sequence("CSC")
_IN_HALVES = Sequence("CCSCC")
_THREE_ARCS = Sequence("CCC")


def arc_straight_arc(position: Floats, quaternion: Floats, radius: float) -> list[Maneuver]:
    """Forwards, with a path that bends nowhere tighter than a radius: arc, straight, arc.

    The arcs bend about any axis across the travel.  The straight's direction is where the cone of
    straights that leave the first arc meets the last arc (the numerical problem of Hota and Ghose
    2010; Vana et al. 2020).  Roll that is left is the straight's where that is half of the way or
    more; else it is spread evenly over the whole way, and each arc is two helices.

    A goal so near that this leads far around is also reached by three arcs, and a goal in a plane
    that holds the travel, without roll, by what :func:`noslip.maneuvers.planar.dubins` finds there.
    Of goals that are to be rolled by half a turn or so within three radii, the shortest way is
    sometimes missed.

    Parameters
    ----------
    position : array, shape (3,)
        Of the goal, in the edge's frame at the start (m).
    quaternion : array, shape (4,)
        Rotation of the edge's frame at the goal.
    radius : float
        Of the arcs (m).

    Returns
    -------
    list of Maneuver
        The shortest first, none a whole circle longer; the start itself has "stay".  Ends are exact
        to 1e-9 radii and rad.  Empty if nothing is found, which is no proof that there is nothing.

    Raises
    ------
    InputError
        If the goal is not finite, or the radius not positive.
    """
    radius = _arguments.positive("radius", radius, "meters")
    goal = _pose(position, quaternion)
    goal[:3, 3] /= radius
    if _at_rest(goal):
        return [Maneuver(())]
    found = _in_plane(goal) or _found(goal)
    shortest = min((float(twists[:, 0].sum()) for twists in found), default=0.0)
    good = [twists for twists in found if twists[:, 0].sum() <= shortest + 2 * np.pi]
    return _told_apart([_as_maneuver(twists, radius) for twists in good], radius)


def blade_turns(position: Floats, quaternion: Floats, radius: float) -> list[Maneuver]:
    """Forwards, where only turning about z is bound to a radius: pitch and roll are free at rest.

    - Turn, straight, turn.  Turns about axes across z lead any axis anywhere; between them, the
      straight rolls by what then is left.  No way is shorter, and none turns more.
    - Turn until the goal lies in the x-y plane, and drive there
      (:func:`noslip.maneuvers.planar.dubins`) to the heading from which a turn about an axis across
      z does the rest; of a goal in the plane nothing is left.

    Parameters and what is raised are as of :func:`arc_straight_arc`; at least one is found.
    """
    radius = _arguments.positive("radius", radius, "meters")
    position, quaternion = _normal(position, quaternion)
    way = _size(position)
    if way <= _SAME * radius:
        roll, last = _roll_and_swing(quaternion)
        return [_without_nothing([Stretch("roll", 0.0, (roll, 0.0, 0.0)), _turn(last)])]
    first = _swing_to(position / way)
    roll, last = _roll_and_swing(product(inverse(first), quaternion))
    straight = Stretch("straight", way, (roll, 0.0, 0.0))
    found = [_without_nothing([_turn(first), straight, _turn(last)])]
    first, (x, y) = _tilted(position)
    heading, last = _heading_and_swing(product(inverse(first), quaternion))
    for driven in planar.dubins(x, y, heading, radius):
        found.append(_without_nothing([_turn(first), *driven.stretches, _turn(last)]))
    return _told_apart(found, radius)


def turn_drive_turn(
    position: Floats, quaternion: Floats, *, reverse: bool = False
) -> list[Maneuver]:
    """Turn where it stands, drive straight to the goal, turn again: each the shortest there is.

    Parameters
    ----------
    position, quaternion : arrays, shape (3,) and (4,)
        Of the goal, in the edge's frame at the start (m).
    reverse : bool
        Whether it may back up, too.

    Returns
    -------
    list of Maneuver
        By turning: one, or with ``reverse`` two.

    Raises
    ------
    InputError
        If the goal is not finite.
    """
    position, quaternion = _normal(position, quaternion)
    way = float(np.linalg.norm(position))
    if way <= _SAME:
        return [_without_nothing([_turn(quaternion)])]
    found = []
    for sign in (1, -1) if reverse else (1,):
        first = _shortest_to(sign * position / way)
        last = product(inverse(first), quaternion)
        drive = Stretch("straight", sign * way)
        found.append(_without_nothing([_turn(first), drive, _turn(last)]))
    return sorted(found, key=lambda each: each.turning)


_STILL = np.array([1.0, 0.0, 0.0, 0.0])


def _shortest_to(travel: Floats) -> Floats:
    """Quaternion of the shortest rotation of x to a unit vector; straight behind it is about z."""
    x, y, z = travel
    axis = np.array([-z, y]) if np.hypot(y, z) > _SAME else np.array([0.0, 1.0])
    half = np.arctan2(np.hypot(y, z), x) / 2
    return np.array([np.cos(half), 0.0, *(np.sin(half) * axis / np.linalg.norm(axis))])


def _swing_to(travel: Floats) -> Floats:
    """Quaternion of the rotation of x to a unit vector about an axis across z."""
    first = _shortest_to(travel)
    # What x is rolled by before changes nothing: (w, 0, y, z) (c, s, 0, 0), the last of it 0.
    half = np.arctan2(first[3], first[2])
    half = half - np.pi * np.round(half / np.pi)
    return product(first, np.array([np.cos(half), np.sin(half), 0.0, 0.0]))


def _roll_and_swing(quaternion: Floats) -> tuple[float, Floats]:
    """Roll (rad) first, then a rotation about an axis across z: together a rotation."""
    half = np.arctan2(quaternion[3], quaternion[2])
    half = half - np.pi * np.round(half / np.pi)
    rest = product(np.array([np.cos(half), -np.sin(half), 0.0, 0.0]), quaternion)
    return 2 * half, rest


def _tilted(position: Floats) -> tuple[Floats, Floats]:
    """The least rotation about an axis across z that brings the x-y plane to a point, and where."""
    x, y, z = position
    flat = np.hypot(x, y)
    ahead = position[:2] / flat if flat > _SAME * abs(z) else np.array([1.0, 0.0])
    half = np.arctan2(z, flat) / 2
    sine = np.sin(half)
    rotation = np.array([np.cos(half), sine * ahead[1], -sine * ahead[0], 0.0])
    return rotation, np.hypot(flat, z) * ahead


def _heading_and_swing(quaternion: Floats) -> tuple[float, Floats]:
    """Turn about z (rad) first, then a rotation about an axis across z: together a rotation."""
    half = np.arctan2(quaternion[3], quaternion[0])
    rest = product(np.array([np.cos(half), 0.0, 0.0, -np.sin(half)]), quaternion)
    return 2 * half, rest


def _turn(quaternion: Floats) -> Stretch:
    """Where it stands, the shorter way, and half a turn to the left; named by where travel goes."""
    turn = turns_between(_STILL[None], quaternion[None])[0]
    angle = _size(turn)
    if angle > np.pi - _SAME and tuple(turn[::-1]) < (0.0, 0.0, 0.0):
        turn *= 1 - 2 * np.pi / angle
    _, left, up = rotated(quaternion[None], np.array([[1.0, 0.0, 0.0]]))[0]
    there = _direction(-up, left) or _direction(turn[1], turn[2])
    return Stretch(f"turn {there}" if there else "roll", 0.0, tuple(turn.tolist()))


def _without_nothing(stretches: list[Stretch]) -> Maneuver:
    return Maneuver(tuple(each for each in stretches if each.advance or each.angle > _SAME))


def _normal(position: Floats, quaternion: Floats) -> tuple[Floats, Floats]:
    """The goal, checked, of unit norm."""
    given = _arguments.numbers("quaternion", quaternion)
    size = np.linalg.norm(given)
    if given.shape != (4,) or not abs(size - 1) <= 1e-6:
        raise InputError(
            f"quaternion must be 4 numbers of norm 1 (w first), got {_arguments.short(quaternion)}"
        )
    return _arguments.vector("position", position), given / size


def _pose(position: Floats, quaternion: Floats) -> Floats:
    """The goal, shape (4, 4)."""
    found = np.eye(4)
    found[:3, 3], (w, x, y, z) = _normal(position, quaternion)
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return found


def _at_rest(goal: Floats) -> bool:
    return bool(np.abs(goal - np.eye(4)).max() < _SAME)


def _found(goal: Floats) -> list[Floats]:
    """Twists of each stretch, shape (stretches, 4), of all that leads to the goal."""
    starts = _starts(goal)
    hopeful = _ARC_STRAIGHT_ARC.straight(starts) > -_HOPEFUL
    plain, missed = _ARC_STRAIGHT_ARC.solved(starts[hopeful], 0.0, goal, 6)
    plain = _valid(_ARC_STRAIGHT_ARC, plain, missed)
    rolls = np.abs(_ARC_STRAIGHT_ARC.roll(plain)) > _SAME
    rolls &= _ARC_STRAIGHT_ARC.straight(plain) < _ARC_STRAIGHT_ARC.length(plain) / 2
    found = list(_ARC_STRAIGHT_ARC.twists(plain[~rolls], 0.0))
    if rolls[:1].any():
        found += _spread(plain[rolls][:_MOST], goal)
    shortest = min((twists[:, 0].sum() for twists in found), default=np.inf)
    if shortest > np.linalg.norm(goal[:3, 3]) + _DETOUR:
        found += _three_arcs(goal)
    return found


def _in_plane(goal: Floats) -> list[Floats]:
    """Twists of what leads to a goal in a plane that holds x, without leaving it."""
    position, travel = goal[:3, 3], goal[:3, 0]
    sideways = max(position[1:], travel[1:], key=_size)
    if _size(sideways) < _SAME:
        # Of a half turn it is twice the projection onto its axis, the normal; of none, twice one.
        z, y = max((goal[1:3, 1:3] + np.eye(2)).T[::-1], key=_size) * [-1, 1]
        sideways = np.array([y, z])
    ((y, z),) = _unit(sideways[None])
    normal, side = np.array([0.0, -z, y]), np.array([0.0, y, z])
    if abs(position @ normal) > _SAME or np.abs(goal[:3, :3] @ normal - normal).max() > _SAME:
        return []
    words = planar.dubins(position[0], position @ side, np.arctan2(travel @ side, travel[0]), 1.0)
    return [
        np.array([[each.advance, *(each.turn[2] * normal)] for each in word.stretches])
        for word in words
    ]


def _size(vector: Floats) -> float:
    return float(np.linalg.norm(vector))


def _spread(plain: Floats, goal: Floats) -> Iterator[Floats]:
    """Arc, straight, arc with the roll spread over all, from those where the straight alone rolls.

    As it rolls, an arc would become a helix, and lead elsewhere.  Two halves of it, each with its
    own bend, are near enough to the arc that what is found without roll is never far.
    """
    halves = np.column_stack([plain[:, [0, 1, 0, 1, 2, 3, 2, 3]] / 2, plain[:, 4:]])
    for part in (1 / 3, 2 / 3):
        halves, _ = _IN_HALVES.solved(halves, part, goal, 2)
    halves = _valid(_IN_HALVES, *_IN_HALVES.solved(halves, 1.0, goal, 7))
    yield from _IN_HALVES.twists(halves, 1.0)


def _three_arcs(goal: Floats) -> Iterator[Floats]:
    """For goals that are near: three arcs, made as short as they are nearby."""
    random = np.random.default_rng(0)
    bends = random.normal(scale=_BEND, size=(_TRIES, 2 * len(_THREE_ARCS.stretches)))
    tried = np.column_stack([bends, random.uniform(-1, 1, _TRIES)])
    tried, missed = _THREE_ARCS.solved(tried, 1.0, goal, 3)
    tried = tried[np.argsort(missed)[: 2 * _MOST]]
    tried = _valid(_THREE_ARCS, *_THREE_ARCS.solved(tried, 1.0, goal, 12, shortening=0.6))
    yield from _THREE_ARCS.twists(tried, 1.0)


def _valid(sequence: Sequence, parameters: Floats, missed: Floats) -> Floats:
    """Those that reach the goal, by length."""
    arcs = sequence.arcs(parameters)
    length = sequence.length(parameters)
    good = (missed < _SAME) & (arcs < 2 * np.pi).all(axis=1)
    good &= sequence.straight(parameters) > -_SAME
    good &= np.abs(sequence.roll(parameters)) <= 2 * np.pi
    good &= length > _SAME
    return parameters[np.flatnonzero(good)[np.argsort(length[good])]]


def _as_maneuver(twists: Floats, radius: float) -> Maneuver:
    """Of advances and rotation vectors, shape (stretches, 4).

    What vanishes is left out, and what goes on alike is one stretch.
    """
    kept: list[Floats] = []
    for twist in twists:
        if np.abs(twist).max() <= _SAME:
            continue
        if kept and np.abs(kept[-1] * twist[0] - twist * kept[-1][0]).max() <= _SAME:
            kept[-1] = kept[-1] + twist
        else:
            kept.append(twist)
    return Maneuver(
        tuple(
            Stretch(_direction(turn[1], turn[2]) or "straight", advance * radius, tuple(turn))
            for advance, *turn in (twist.tolist() for twist in kept)
        )
    )


def _told_apart(maneuvers: list[Maneuver], radius: float) -> list[Maneuver]:
    """Each once, by length, then by turning."""
    kept: dict[tuple[str, float, float], Maneuver] = {}
    for each in maneuvers:
        kept.setdefault((each.name, round(each.length / radius, 5), round(each.turning, 5)), each)
    # Lengths that differ by rounding are one.
    return sorted(kept.values(), key=lambda each: (round(each.length / radius, 9), each.turning))


def _direction(pitch: float, yaw: float) -> str:
    """Where travel turns to, seen along it with z up: "left", "up left", ...; "" if nowhere."""
    if np.hypot(pitch, yaw) < _SAME:
        return ""
    names = ("left", "up left", "up", "up right", "right", "down right", "down", "down left")
    return names[round(np.arctan2(-pitch, yaw) / (np.pi / 4)) % 8]


def _starts(goal: Floats) -> Floats:
    """Where arcs and straights may lead to the goal, as starts of Newton's method, shape (K, 6)."""
    position, travel = goal[:3, 3], goal[:3, 0]
    step = 2 * np.pi / _ANGLES
    angles: Floats = step * np.arange(0.5, _ANGLES)
    signs = np.array([[1.0], [-1.0]])
    error = _cone(angles, signs, position, travel)[0]
    branch, k = np.nonzero(error[:, 1:] * error[:, :-1] < 0)
    before, after = error[branch, k], error[branch, k + 1]
    crossing = angles[k] + step * before / (before - after)
    size = np.abs(error)
    least = (size[:, 1:-1] <= size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:])
    touching, j = np.nonzero(least & (size[:, 1:-1] < _NEAR))
    # Where the line comes to miss the cone, one of its two corners becomes the other.
    missing = np.isnan(error[0])
    beside = (missing != np.roll(missing, 1)) | (missing != np.roll(missing, -1))
    folded = np.flatnonzero(beside & (error[0] * error[1] < 0))
    first = np.concatenate([crossing, angles[j + 1], angles[folded]])
    sign = signs[np.concatenate([branch, touching, np.zeros_like(folded)]), 0]
    _, sine, cosine, away = _cone(first, sign, position, travel)
    sideways = (cosine[:, None] * position - sine[:, None] * travel)[:, 1:] * away[:, None]
    last = 2 * np.arctan2(sine, cosine) % (2 * np.pi)
    # Straight to the goal, for goals far away, and where the search sees nothing: straight ahead.
    first = np.append(first, np.arctan2(np.hypot(*position[1:]), position[0]))
    sideways = np.vstack([sideways, position[1:]])
    last = np.append(last, 0.0)
    return _parameters(first, sideways, last, goal)


def _cone(
    angle: Floats, sign: Floats, position: Floats, travel: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Straights that leave a first arc, and where they meet the line through the goal.

    Straights after arcs of one angle lie on a cone about x (radius 1):

        rho cos(angle) = x sin(angle) - 1 + cos(angle),   rho the distance from x's axis.

    An arc between two straights is told by their corner, at ``tan(turn / 2)`` from both its ends.
    The last one's is where the line through the goal, along its travel t, meets the cone: at
    ``p - s t``, two of them, by a quadratic equation in s.  That must be the tangent of half the
    angle between straight and t.

    Parameters
    ----------
    angle : array, shape (N,)
        Of the first arc (rad).
    sign : array
        1 or -1: which of the two; it broadcasts.

    Returns
    -------
    error : array, shape of both
        Cosine of the angle that the corner tells, less that between straight and t; NaN where the
        line misses the cone.
    sine, cosine : arrays
        Of half of the last arc: s as their ratio, which may be infinite.
    away : array
        1 or -1: whether the arc bends to the corner, or away from it.
    """
    C, S = np.cos(angle), np.sin(angle)
    along, c = position[0], travel[0]
    # Squared distance of p - s t from the axis: n0 - 2 n1 s + n2 s^2.
    n0 = position[1:] @ position[1:]
    n1 = position[1:] @ travel[1:]
    n2 = travel[1:] @ travel[1:]
    offset = S * along - 1 + C
    a0 = C * C * n0 - offset**2
    a1 = S * c * offset - C * C * n1
    a2 = C * C * n2 - S * S * c * c
    # The discriminant has a factor C^2, over which the two corners change places.
    rest = C * C * (n1 * n1 - n0 * n2) - 2 * n1 * S * c * offset
    rest = rest + n2 * offset**2 + S * S * c * c * n0
    root = sign * C * np.sqrt(np.maximum(rest, 0))
    well = root * a1 <= 0
    sine, cosine = np.where(well, root - a1, a0), np.where(well, a2, -a1 - root)
    size = np.hypot(sine, cosine)
    size = np.where(size > 0, size, 1)
    sine, cosine = sine / size, cosine / size
    distance = offset * cosine - S * c * sine
    safe = np.where(distance == 0, 1e-300, distance)
    most = np.sqrt(n2)
    side = np.clip(C * (n1 * cosine - n2 * sine) / safe, -most, most)
    error = cosine**2 - sine**2 - C * c - S * side
    away = np.where(distance * C < 0, -1.0, 1.0)
    return np.where(rest >= 0, error, np.nan), sine, cosine, away


def _parameters(first: Floats, sideways: Floats, last: Floats, goal: Floats) -> Floats:
    """Of arcs, given the first one's angle and direction, and the last one's angle."""
    zero = np.zeros_like(first)
    bend = first[:, None] * np.column_stack([-_unit(sideways)[:, 1], _unit(sideways)[:, 0]])
    begun = poses(first, np.column_stack([zero, bend]))
    seen = goal[:3, 0] @ begun[:, :3, :3]
    # The direct one, which has none yet, takes the shorter way to the goal's travel.
    last = np.where(last > 0, last, np.arctan2(np.hypot(seen[:, 1], seen[:, 2]), seen[:, 0]))
    bend_back = np.where(last <= np.pi, last, -last)[:, None] * np.column_stack(
        [-_unit(seen[:, 1:])[:, 1], _unit(seen[:, 1:])[:, 0]]
    )
    ended = poses(last, np.column_stack([zero, bend_back]))
    between = goal[:3, 3] - begun[:, :3, 3]
    between = between - (begun[:, :3, :3] @ ended[:, :3, 3:])[:, :, 0]
    straight = np.sum(between * begun[:, :3, 0], axis=1)
    left = np.swapaxes(begun[:, :3, :3] @ ended[:, :3, :3], 1, 2) @ goal[:3, :3]
    roll = np.arctan2(left[:, 2, 1] - left[:, 1, 2], left[:, 1, 1] + left[:, 2, 2])
    C, S = np.cos(roll), np.sin(roll)
    # The roll comes before the last arc, which bends about the same axis in space.
    bend_back = np.column_stack(
        [
            C * bend_back[:, 0] + S * bend_back[:, 1],
            C * bend_back[:, 1] - S * bend_back[:, 0],
        ]
    )
    return np.column_stack([bend, bend_back, roll, straight + first + last])


def _unit(directions: Floats) -> Floats:
    """Unit vectors in a plane, shape (N, 2); the first axis where there is no direction."""
    size = np.hypot(directions[:, 0], directions[:, 1])[:, None]
    none = size < _SAME
    return np.where(none, [1.0, 0.0], directions / np.where(none, 1.0, size))
