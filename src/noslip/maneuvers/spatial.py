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
from noslip.maneuvers.bending import Sequence, poses
from noslip.maneuvers.maneuver import Maneuver, Stretch, rotated
from noslip.quaternions import inverse, product, turns_between

_ANGLES = 384
"""Of the first arc, at which straights to the last arc are looked for: those that lead to the
shortest way are lost in 3 of 1000 random goals (with 96 angles, in 30)."""
_NEAR = 0.02
"""Where two solutions meet, the search may see no change of sign: cosines this near are tried."""
_SAME = 1e-9
"""How far what counts as the same may be apart, in radii and rad."""
_MOST = 8
"""Candidates that are worked out; the longer ones are dropped."""

_ARC_STRAIGHT_ARC = Sequence("CSC")
_IN_HALVES = Sequence("CCSCC")
_THREE_ARCS = Sequence("CCC")


def arc_straight_arc(position: Floats, quaternion: Floats, radius: float) -> list[Maneuver]:
    """Forwards, with a path that bends nowhere tighter than a radius: arc, straight, arc.

    The arcs bend about any axis across the travel.  The straight's direction is where the cone of
    straights that leave the first arc meets the last arc (the numerical problem of Hota and Ghose
    2010).  Roll that is left is the straight's where that is half of the way or more; else it is
    spread over the whole way, and arcs become helices.

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
        The shortest first.

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
    found = [_as_maneuver(twists, radius) for twists in _rolled(_starts(goal), goal)]
    return _told_apart(found, radius)


def blade_turns(position: Floats, quaternion: Floats, radius: float) -> list[Maneuver]:
    """Forwards, where only turning about z is bound to a radius: pitch and roll are free at rest.

    A turn about an axis across z leads any axis anywhere, so a blade can always turn to the goal
    where it stands, drive straight, rolling as far as the last turn needs, and turn again.

    Parameters, what is returned and raised are as of :func:`arc_straight_arc`.
    """
    _arguments.positive("radius", radius, "meters")
    goal, (position, quaternion) = _pose(position, quaternion), _normal(position, quaternion)
    if _at_rest(goal):
        return [Maneuver(())]
    way = float(np.linalg.norm(position))
    first = _swing_to(position / way) if way > _SAME else _STILL
    roll, last = _roll_and_swing(product(inverse(first), quaternion))
    stretches = [
        _turn(first),
        Stretch("straight" if way > _SAME else "roll", way, (roll, 0.0, 0.0)),
        _turn(last),
    ]
    return [_without_nothing(stretches)]


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


def _turn(quaternion: Floats) -> Stretch:
    """Where it stands, the shorter way; named by where travel goes."""
    turn = turns_between(_STILL[None], quaternion[None])[0]
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


def _rolled(starts: Floats, goal: Floats) -> Iterator[Floats]:
    """Twists of each stretch, shape (stretches, 4), that lead to the goal."""
    plain = _valid(_ARC_STRAIGHT_ARC, *_ARC_STRAIGHT_ARC.solved(starts, 0.0, goal, 6))[:_MOST]
    arcs = _ARC_STRAIGHT_ARC.arcs(plain).sum(axis=1)
    length, roll = _ARC_STRAIGHT_ARC.length(plain), _ARC_STRAIGHT_ARC.roll(plain)
    done = (arcs <= length / 2) & (length > _SAME) | (np.abs(roll) < _SAME)
    yield from _ARC_STRAIGHT_ARC.twists(plain[done], 0.0)
    plain = plain[~done]
    if not len(plain):
        return
    spread, missed = _ARC_STRAIGHT_ARC.solved(plain, 1.0, goal, 10)
    valid = _valid(_ARC_STRAIGHT_ARC, spread, missed)
    yield from _ARC_STRAIGHT_ARC.twists(valid, 1.0)
    if len(valid) or done.any():
        return
    # Arcs in halves, each with its own bend, keep more of their form as they roll.
    halves = np.column_stack([plain[:, [0, 1, 0, 1, 2, 3, 2, 3]] / 2, plain[:, 4:]])
    for part in (0.25, 0.5, 0.75):
        halves, _ = _IN_HALVES.solved(halves, part, goal, 3)
    halves, missed = _IN_HALVES.solved(halves, 1.0, goal, 8)
    yield from _IN_HALVES.twists(_valid(_IN_HALVES, halves, missed), 1.0)


def _valid(sequence: Sequence, parameters: Floats, missed: Floats) -> Floats:
    """Those that reach the goal, by length."""
    arcs = sequence.arcs(parameters)
    length = sequence.length(parameters)
    good = (missed < _SAME) & (arcs < 2 * np.pi).all(axis=1)
    good &= length - arcs.sum(axis=1) > -_SAME
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
    angles: Floats = (np.arange(_ANGLES) + 0.5) * step
    signs = np.array([[1.0], [-1.0]])
    error = _cone(angles, signs, position, travel)[0]
    branch, k = np.nonzero(error[:, 1:] * error[:, :-1] < 0)
    before, after = error[branch, k], error[branch, k + 1]
    size = np.abs(error)
    least = (size[:, 1:-1] <= size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:])
    touching, j = np.nonzero(least & (size[:, 1:-1] < _NEAR))
    crossing = angles[k] + step * before / (before - after)
    first: Floats = np.concatenate([crossing, angles[j + 1]])
    sign = signs[np.concatenate([branch, touching]), 0]
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
