"""Maneuvers in the plane, in closed form.

Each begins at the origin with its heading along +x, which is the edge's travel, and turns about +z:
to the left where that is positive.  Backing up with the wheel to the left is "back left", and turns
the heading to the right.

Here points are complex numbers, and lengths are in turning radii.  On a circle to side ``s`` (1 is
left, -1 right) about ``c``, with the heading ``a``, the tool is at ``c - i s exp(i a)``.  So a word
of arcs and straights tells what lies between the centers of its first and last circle, and that is
solved for headings: the same equations serve arcs that are driven forwards and backwards.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence

from noslip._arguments import LARGEST, between, positive, vector
from noslip.maneuvers.maneuver import Maneuver, Stretch

_TINY = 1e-10
"""What is taken for rounding of a goal, relative to its distance: a tenth of what ends are exact
to."""
_ROUNDING = 1e-13
"""The same of goals within a radius, in radii: centers lie one radius off."""
_MOST_CUSPS = 2
"""No goal needs more (Reeds and Shepp 1990)."""
_LEFT, _STRAIGHT, _RIGHT = 1, 0, -1
_SIDES = (_LEFT, _RIGHT)
_NAMES = {_LEFT: "left", _STRAIGHT: "straight", _RIGHT: "right"}

_Word = list[tuple[int, float]]
"""Sides, and how far along each: rad on circles, radii on straights; negative backs up."""


def dubins(x: float, y: float, heading: float, radius: float) -> list[Maneuver]:
    """Drive forwards to a pose: arcs of the turning radius, and a straight.

    All of left-straight-left, right-straight-right, left-straight-right, right-straight-left,
    left-right-left and right-left-right that lead there, the last two with the middle circle on
    either side (Dubins 1957; Shkel and Lumelsky 2001).  The first is the shortest way there is.

    Parameters
    ----------
    x, y : float
        Of the goal (m).
    heading : float
        Of the goal (rad).
    radius : float
        Of the arcs (m).

    Returns
    -------
    list of Maneuver
        By length, then by turning; never empty.  Stretches that vanish are left out: a goal
        straight ahead has "straight", the start itself "stay", of no stretches.  Ends are exact to
        1e-9 of the length, and 1e-9 rad.

    Raises
    ------
    InputError
        If the goal is not finite, or the radius not positive.
    """
    goal, heading, radius, tiny = _scaled(x, y, heading, radius)
    words = itertools.chain(
        _around_a_straight(goal, heading, tiny, [(0, 0, 1)]), _three_arcs(goal, heading, tiny)
    )
    return _maneuvers(words, radius, tiny, _forwards)


def dubins_to_point(x: float, y: float, radius: float) -> list[Maneuver]:
    """Drive forwards to a point, with any heading: an arc, then a straight or an arc.

    As :func:`dubins`, with the words left-straight, right-straight, left-right and right-left, the
    last two with the second circle on either side (Boissonnat and Bui 1994).
    """
    goal, _, radius, tiny = _scaled(x, y, 0.0, radius)
    return _maneuvers(_to_point(goal, tiny), radius, tiny, _forwards)


def reeds_shepp(x: float, y: float, heading: float, radius: float) -> list[Maneuver]:
    """Drive forwards and backwards to a pose: arcs of the turning radius, and a straight.

    The words of Reeds and Shepp (1990): two arcs with a straight between them, and quarter turns
    the other way before the straight, after it, or both; three arcs; four arcs, the inner two of
    one length.  Each arc is driven the way that is shorter, where that makes no more than the two
    cusps that suffice.

    Parameters, what is returned and raised are as of :func:`dubins`.
    """
    goal, heading, radius, tiny = _scaled(x, y, heading, radius)
    words = itertools.chain(
        _around_a_straight(goal, heading, tiny, itertools.product((0, 1), (0, 1), (1, -1))),
        _three_arcs(goal, heading, tiny),
        _four_arcs(goal, heading, tiny),
    )
    return _maneuvers(words, radius, tiny, _the_shorter_way)


def turn_drive_turn(x: float, y: float, heading: float, *, reverse: bool = False) -> list[Maneuver]:
    """Turn where it stands, drive straight to the goal, turn again; each turn the shorter way.

    Parameters
    ----------
    x, y : float
        Of the goal (m).
    heading : float
        Of the goal (rad).
    reverse : bool
        Whether it may back up, too.

    Returns
    -------
    list of Maneuver
        By turning: one, or with ``reverse`` two.  A goal closer than 1e-10 m is turned to.

    Raises
    ------
    InputError
        If the goal is not finite.
    """
    x, y, heading = vector("x, y and heading", (x, y, heading), "m, m and rad").tolist()
    way = math.hypot(x, y)
    if way <= _TINY:
        return [Maneuver(tuple(_turns_in_place(heading)))]
    found = []
    for sign in (1, -1) if reverse else (1,):
        course = math.atan2(sign * y, sign * x)
        drive = Stretch(_NAMES[_STRAIGHT], sign * way)
        stretches = (*_turns_in_place(course), drive, *_turns_in_place(heading - course))
        found.append(Maneuver(stretches))
    return sorted(found, key=lambda maneuver: maneuver.turning)


def _turns_in_place(angle: float) -> Iterator[Stretch]:
    """One turn, or none if it vanishes."""
    angle = _the_shorter_way(angle, _TINY)
    if abs(angle) > _TINY:
        yield Stretch(f"turn {_NAMES[_LEFT if angle > 0 else _RIGHT]}", 0.0, (0.0, 0.0, angle))


def _scaled(
    x: float, y: float, heading: float, radius: float
) -> tuple[complex, float, float, float]:
    """Return the goal in radii, its heading, the radius (m), and what is none (radii, rad)."""
    x, y, heading = vector("x, y and heading", (x, y, heading), "m, m and rad").tolist()
    radius = positive("radius", radius, "m")
    # Else the goal in radii means nothing.
    between("radius", radius, math.hypot(x, y) / LARGEST, LARGEST)
    goal = complex(x, y) / radius
    return goal, heading, radius, max(_TINY * min(abs(goal), 1.0), _ROUNDING)


def _apart(goal: complex, heading: float, first: int, last: int) -> complex:
    """From the center of the first circle to that of the last, on these sides."""
    return goal + 1j * (last * cmath.exp(1j * heading) - first)


def _argument(z: complex) -> float:
    """Its angle (rad); that of cmath fails where it underflows."""
    return math.atan2(z.imag, z.real)


def _around_a_straight(
    goal: complex, heading: float, tiny: float, kinds: Iterable[tuple[int, int, int]]
) -> Iterator[_Word]:
    """An arc, a straight, an arc; kinds say with a quarter turn before, one after, and which way.

    A quarter turn takes the straight's heading, so its circle lies two radii further along it.
    """
    for (before, after, way), first, last in itertools.product(kinds, _SIDES, _SIDES):
        begin, end = (-first if before else first), (-last if after else last)
        apart, across = _apart(goal, heading, first, last), begin - end
        slack = abs(apart) - abs(across)
        # Of circles that touch, the straight would be the root of rounding.
        along = math.sqrt(slack * (abs(apart) + abs(across))) if slack > tiny else 0.0
        straight = along - 2 * (before + after)
        if min(slack, straight) < -tiny:
            continue
        touching = along == across == 0
        course = heading if touching else _argument(apart / (way * along - 1j * across))
        quarter = way * math.pi / 2
        yield [
            (first, first * (course - before * begin * quarter)),
            (begin, before * quarter),
            (_STRAIGHT, way * straight),
            (end, after * quarter),
            (last, last * (heading - course - after * end * quarter)),
        ]


def _three_arcs(goal: complex, heading: float, tiny: float) -> Iterator[_Word]:
    """An arc, one to the other side, one as the first."""
    for side in _SIDES:
        apart = _apart(goal, heading, side, side)
        # Of one circle, an arc suffices.
        if not tiny < abs(apart) <= 4 + tiny:
            continue
        angle = 2 * math.asin(abs(apart) / 4) if abs(apart) < 4 - tiny else math.pi
        for turn in (angle, -angle):
            first = _argument(1j * side * apart / (1 - cmath.exp(1j * turn)))
            last = heading - first - turn
            yield [(side, side * first), (-side, -side * turn), (side, side * last)]


def _four_arcs(goal: complex, heading: float, tiny: float) -> Iterator[_Word]:
    """An arc, two of one length to the other side and this, one to the other side."""
    for side in _SIDES:
        apart = _apart(goal, heading, side, -side)
        far = abs(apart) / 2
        # The inner arcs with a cusp between them: they turn the same way.
        for sign in (1, -1):
            # Of one circle, any heading in the middle will do; half the way makes them short.
            middle = (
                _argument(sign * 1j * side * apart)
                if 2 * far > tiny
                else heading / 2 + (0 if sign > 0 else math.pi)
            )
            for turn in _angles((1 + sign * far) / 2, tiny):
                yield [
                    (side, side * (middle - turn)),
                    (-side, -side * turn),
                    (side, side * turn),
                    (-side, -side * (heading - middle - turn)),
                ]
        # Without: what one turns, the other turns back.
        for turn in _angles((5 - far**2) / 4, tiny):
            first = _argument(1j * side * apart / (2 - cmath.exp(1j * turn)))
            yield [
                (side, side * first),
                (-side, -side * turn),
                (side, -side * turn),
                (-side, -side * (heading - first)),
            ]


def _to_point(goal: complex, tiny: float) -> Iterator[_Word]:
    """An arc and a straight, or two arcs."""
    for side in _SIDES:
        apart = goal - 1j * side
        far = abs(apart)
        slack = far - 1
        if slack < -tiny:
            continue
        straight = math.sqrt(slack * (far + 1)) if slack > tiny else 0.0
        yield [(side, side * _argument(apart / (straight - 1j * side))), (_STRAIGHT, straight)]
        for bearing in _angles((far**2 + 3) / (4 * far), tiny):
            middle = 2 * apart / far * cmath.exp(1j * bearing)
            first = _argument(1j * side * middle)
            last = _argument(-1j * side * (apart - middle))
            yield [(side, side * first), (-side, -side * (last - first))]


def _angles(cosine: float, tiny: float) -> tuple[float, ...]:
    """Angles with a cosine, or none: the root of rounding is no angle."""
    if abs(cosine) > 1 + tiny:
        return ()
    if abs(cosine) > 1 - tiny:
        return (0.0 if cosine > 0 else math.pi,)
    return math.acos(cosine), -math.acos(cosine)


def _forwards(angle: float, tiny: float) -> float:
    """An arc's angle, from 0 to a full turn; 0 where rounding would make it a full turn."""
    angle %= 2 * math.pi
    return angle if angle < 2 * math.pi - tiny else 0.0


def _the_shorter_way(angle: float, tiny: float) -> float:
    """An arc's angle, from -pi to pi; pi where rounding would make it -pi."""
    angle = math.remainder(angle, 2 * math.pi)
    return angle if angle > tiny - math.pi else angle + 2 * math.pi


def _maneuvers(
    words: Iterable[_Word], radius: float, tiny: float, way: Callable[[float, float], float]
) -> list[Maneuver]:
    """What the words are: in order, each once, with as few cusps as suffice."""
    found: dict[tuple[int, ...], list[_Word]] = {}
    for word in words:
        tidy = _tidied(word, tiny, way)
        alike = found.setdefault(tuple(side for side, _ in tidy), [])
        if _cusps(tidy) <= _MOST_CUSPS and not any(_same(tidy, other) for other in alike):
            alike.append(tidy)

    def order(word: _Word) -> tuple[float, float, int]:
        length = sum(abs(amount) for _, amount in word)
        turning = sum(abs(amount) for side, amount in word if side)
        # Lengths that differ by rounding are one.
        return round(length, 9), round(turning, 9), _cusps(word)

    ordered = sorted(itertools.chain(*found.values()), key=order)
    return [
        Maneuver(
            tuple(
                Stretch(_NAMES[side], radius * amount, (0.0, 0.0, side * amount))
                for side, amount in word
            )
        )
        for word in ordered
    ]


def _tidied(word: _Word, tiny: float, way: Callable[[float, float], float]) -> _Word:
    """Arcs the right way round, without what vanishes; neighbors on one circle are one."""
    tidy: _Word = []
    for side, amount in word:
        if tidy and tidy[-1][0] == side:
            amount += tidy.pop()[1]
        amount = way(amount, tiny) if side else amount
        if abs(amount) > tiny:
            tidy.append((side, amount))
    return tidy


def _same(one: _Word, other: _Word) -> bool:
    """Whether words of the same sides differ by rounding."""
    return all(
        math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9)
        for (_, a), (_, b) in zip(one, other, strict=True)
    )


def _cusps(word: Sequence[tuple[int, float]]) -> int:
    return sum(a[1] * b[1] < 0 for a, b in itertools.pairwise(word))
