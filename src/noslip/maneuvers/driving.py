"""A maneuver in time: driven at a demonstration's pace, its bends eased in and out.

Where the tool changes between forwards, backwards and turning where it stands, it rests: these
parts are the legs of a maneuver.  Within a leg its bends would jump from one to the next; they are
averaged over a short way instead, which keeps each below the larger of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from noslip._typing import Floats
from noslip.maneuvers.maneuver import Maneuver, Stretch

EASING = 0.5
"""Way over which bends are averaged, over the least radius of a maneuver's bends: it costs 1 % of
its length, and half of it makes peaks of angular acceleration twice as high."""
_SAME = 1e-9
"""Difference of bends, over the tightest, that is rounding."""
_PEAK = 1.875
"""Speed of a minimum jerk over its mean."""
_FEWEST_STEPS = 8
"""Of a leg: fewer do not tell rest, going and rest."""


@dataclass(frozen=True)
class Pace:
    """How fast a demonstration goes, and so what follows it.

    Attributes
    ----------
    way : float
        Of the demonstration's edge (m).
    duration : float
        s.
    shares : array, shape (K,)
        Of its way that it has gone by equal steps of time, from 0 to 1.
    rate : float
        At most that of turns where the tool stands (rad/s).
    """

    way: float
    duration: float
    shares: Floats
    rate: float = np.inf

    @property
    def lever(self) -> float:
        """Meters that a radian where the tool stands counts for: a whole turn is as much as all."""
        return self.way / (2 * np.pi)

    def time(self, leg: Leg) -> float:
        """Seconds for a leg from rest to rest: neither faster nor harder than demonstrated."""
        share = leg.way / self.way
        found = self.duration * float(max(share, share**0.5))
        if leg.twists[0, :3].any():
            return found
        return max(found, _PEAK * float(np.linalg.norm(leg.twists[0, 3:])) / self.rate)


@dataclass(frozen=True)
class Leg:
    """What lies between two rests.

    Attributes
    ----------
    twists : array, shape (K, 6)
        Body twists, one after the other.
    ways : array, shape (K,)
        What each counts for (m).
    width : float
        Over which they are averaged (m).
    """

    twists: Floats
    ways: Floats
    width: float = 0.0

    @property
    def way(self) -> float:
        """What all counts for (m)."""
        return float(self.ways.sum())

    def after(self, twists: Floats) -> Leg:
        """Return it with body twists before it."""
        ways = np.linalg.norm(twists[:, :3], axis=1)
        return Leg(np.vstack([twists, self.twists]), np.append(ways, self.ways), self.width)


def effort(stretch: Stretch, lever: float) -> float:
    """Way of a stretch (m); of a turn where the tool stands, what it counts for."""
    return abs(stretch.advance) or lever * stretch.angle


def legs(maneuver: Maneuver, lever: float) -> list[Leg]:
    """Return the parts of a maneuver between rests."""

    def kind(stretch: Stretch) -> tuple[float, tuple[float, ...]]:
        way = float(np.sign(stretch.advance))
        # Two turns about different axes where the tool stands are two legs.
        return way, () if way else tuple(np.round(np.divide(stretch.turn, stretch.angle), 6))

    found = []
    moving = [each for each in maneuver.stretches if each.advance or each.angle]
    for _, parts in groupby(moving, kind):
        leg = list(parts)
        twists = np.array([each.twist for each in leg])
        ways = np.array([effort(each, lever) for each in leg])
        bends = twists[:, 4:] / ways[:, None]
        tightest = np.linalg.norm(bends, axis=1).max()
        width = 0.0
        if leg[0].advance and tightest:
            # Of a needle's bend, which is always the same, only the roll is eased; what is longer
            # than an arc would all but take it away.
            same = np.ptp(bends, axis=0).max() <= _SAME * tightest
            arcs = ways[np.linalg.norm(bends, axis=1) > _SAME * tightest]
            eased = EASING / tightest
            width = float(ways.min() if same else np.clip(arcs.min(), eased / 4, eased))
        found.append(Leg(twists, ways, width))
    return found


def time_needed(maneuver: Maneuver, pace: Pace, before: Floats) -> float:
    """Seconds that a maneuver takes at a pace, with the body twists before it."""
    return sum(pace.time(leg) for leg in _all_legs(maneuver, pace, before))


def driven(maneuver: Maneuver, pace: Pace, steps: int, before: Floats) -> Floats:
    """Body twists of equal steps of time that drive a maneuver, shape (steps, 6).

    Parameters
    ----------
    maneuver : Maneuver
    pace : Pace
        One leg is driven as the demonstration was; several each by minimum jerk (Flash and Hogan
        1985).
    steps : int
    before : array, shape (K, 6)
        Body twists that are driven first; without a rest, if the maneuver goes on forwards.

    Returns
    -------
    array
        For :func:`noslip.maneuvers.maneuver.integrated`.  Easing moves the end by a few thousandths
        of the bends' radii.
    """
    parts = _all_legs(maneuver, pace, before)
    if not parts:
        return np.zeros((steps, 6))
    times = [pace.time(leg) for leg in parts]
    ends = np.round(np.cumsum(times) / sum(times) * steps).astype(int)
    counts = np.diff(ends, prepend=0)
    while (short := counts < _FEWEST_STEPS).any() and not short.all():
        counts[np.argmax(counts)] -= np.count_nonzero(short)
        counts[short] += 1
    found = []
    for leg, count in zip(parts, counts.tolist(), strict=True):
        at = np.linspace(0, 1, count + 1)
        if len(parts) == 1:
            shares = np.interp(at, np.linspace(0, 1, len(pace.shares)), pace.shares)
        else:
            shares = at**3 * (10 - 15 * at + 6 * at**2)
        found.append(np.diff(_turned(leg, shares * leg.way), axis=0))
    return np.vstack(found)


def _all_legs(maneuver: Maneuver, pace: Pace, before: Floats) -> list[Leg]:
    parts = legs(maneuver, pace.lever)
    if len(before):
        goes_on = parts and parts[0].twists[0, 0] > 0
        first = parts.pop(0) if goes_on else Leg(np.zeros((0, 6)), np.zeros(0))
        parts.insert(0, first.after(before))
    return parts


def _turned(leg: Leg, at: Floats) -> Floats:
    """Integral of a leg's twists, averaged over its width, at places on its way, (len(at), 6)."""
    once = _sums(leg.twists)
    if len(leg.ways) == 1 or not leg.width:
        knots = _sums(leg.ways)
        return np.column_stack([np.interp(at, knots, each) for each in once.T])
    # Beyond both ends all is mirrored, so that all of it is turned between the ends.
    ways = np.concatenate([leg.ways[::-1], leg.ways, leg.ways[::-1]])
    twists = np.concatenate([leg.twists[::-1], leg.twists, leg.twists[::-1]])
    knots, once = _sums(ways) - leg.way, _sums(twists)
    twice = _sums((once[:-1] + once[1:]) / 2 * ways[:, None])
    width = min(leg.width, leg.way)

    def integral(places: Floats) -> Floats:
        """Of the integral, which is linear from knot to knot."""
        k = np.clip(np.searchsorted(knots, places, side="right") - 1, 0, len(ways) - 1)
        beyond = places - knots[k]
        rates = twists[k] / ways[k, None]
        return np.asarray(twice[k] + once[k] * beyond[:, None] + rates * beyond[:, None] ** 2 / 2)

    return (integral(at + width / 2) - integral(at - width / 2)) / width


def _sums(values: Floats) -> Floats:
    """Cumulative sums, from zero on."""
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
