"""Shorter ways between the same ends, as clear as before.

Between poses along a way the closed-form maneuvers are tried, and of all chains of those that are
clear the cheapest is kept; then its inner poses are moved for as long as that makes it cheaper.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from noslip._typing import Floats
from noslip.maneuvers.clearing import TOUCHING, Clear, swept
from noslip.maneuvers.maneuver import Maneuver, Stretch, composed, exponential, integrated


class Shot(NamedTuple):
    """A maneuver and what it costs (m)."""

    maneuver: Maneuver
    cost: float


@dataclass(frozen=True)
class Ground:
    """What a search stands on.

    Attributes
    ----------
    clear : callable
        Margins of poses, see :data:`noslip.maneuvers.clearing.Clear`.
    shots : callable
        Maneuvers in closed form from a pose (7,) to another.
    spacing, reach : float
        See :func:`noslip.maneuvers.clearing.least_margin`.
    size : float
        Of the tool's turns (m).
    """

    clear: Clear
    shots: Callable[[Floats, Floats], list[Maneuver]]
    spacing: float
    reach: float
    size: float

    def free(self, begins: Floats, twists: Floats) -> NDArray[np.bool_]:
        """Whether stretches (N, 6) from poses (N, 7) are clear, shape (N,)."""
        return swept(begins, twists, self.clear, self.spacing, self.reach) >= -TOUCHING

    def cost(self, stretches: Sequence[Stretch]) -> float:
        """Of a way (m): its length, and a little for turns where it stands and for cusps."""
        cost, way = 0.0, 0.0
        for each in stretches:
            if each.advance:
                cost += abs(each.advance) + CUSP * self.size * (way * each.advance < 0)
                way = each.advance
            else:
                cost += _TURNING * self.size * each.angle
        return cost

    def shot(self, begin: Floats, end: Floats, most: float, words: int = 3) -> Shot | None:
        """The cheapest maneuver from pose to pose that is clear and costs less than the most.

        Of so many: longer ones are rarely part of a short way.
        """
        for cost, maneuver in self.ordered(begin, end)[:words]:
            if cost >= most:
                break
            if self.passes(begin, maneuver):
                return Shot(maneuver, cost)
        return None

    def ordered(self, begin: Floats, end: Floats) -> list[tuple[float, Maneuver]]:
        """The cheapest maneuvers from pose to pose, clear or not."""
        priced = ((self.cost(each.stretches), each) for each in self.shots(begin, end))
        return sorted(priced, key=lambda each: each[0])

    def passes(self, begin: Floats, maneuver: Maneuver) -> bool:
        """Whether a maneuver from a pose is clear."""
        if not maneuver.stretches:
            return True
        twists = np.array([each.twist for each in maneuver.stretches])
        poses = np.column_stack(integrated(twists, begin[:3], begin[3:]))
        return bool(np.all(self.free(poses[:-1], twists)))


CUSP = 0.2
"""What a change of direction costs, in radii: a detour of so much is better than one."""
_TURNING = 0.1
"""What a turn of 1 rad costs where the tool stands, in sizes."""
_NODES = 16
"""Poses along a way between which maneuvers are tried; the time goes with their square."""


def shortened(way: Sequence[Stretch], ground: Ground) -> Maneuver:
    """A maneuver from the origin to the same end, as clear, at most as long."""
    chain = _chained([Maneuver((each,)) for each in way], ground)
    chain = _chained(_moved(chain, ground), ground)
    return Maneuver(_joined(_stretches(chain)))


_WORTH = 2e-3
"""What another link must save, in sizes."""


def _stretches(chain: Sequence[Maneuver]) -> list[Stretch]:
    return [each for link in chain for each in link.stretches]


def _joined(stretches: Sequence[Stretch]) -> tuple[Stretch, ...]:
    """Neighbors of one name and direction are one stretch."""
    found: list[Stretch] = []
    for each in stretches:
        if found and found[-1].name == each.name and found[-1].advance * each.advance > 0:
            each = Stretch(each.name, found[-1].advance + each.advance, _sum(found.pop(), each))
        elif found and found[-1].advance == each.advance == 0:
            turn = _sum(found.pop(), each)
            each = Stretch("turn left" if turn[2] > 0 else "turn right", 0.0, turn)
        if each.advance or each.angle > 1e-12:
            found.append(each)
    return tuple(found)


def _sum(one: Stretch, other: Stretch) -> tuple[float, float, float]:
    a, b, c = (float(x) for x in np.add(one.turn, other.turn))
    return a, b, c


def _chained(chain: Sequence[Maneuver], ground: Ground) -> list[Maneuver]:
    """The cheapest chain of clear maneuvers between poses along a way."""
    pieces = _cut(_stretches(chain), ground)
    poses = _nodes(pieces)
    best, links = np.zeros(len(poses)), [(0, Maneuver(()))]
    for k in range(1, len(poses)):
        kept = (best[k - 1] + ground.cost(pieces[k - 1].stretches), k - 1, pieces[k - 1])
        # At least the distance; what a maneuver costs is asked only of those that come first.
        least = best[:k] + np.linalg.norm(poses[:k, :3] - poses[k, :3], axis=1)
        waiting: list[tuple[float, int, Maneuver | None]] = [
            (total, i, None) for i, total in enumerate(least.tolist())
        ]
        heapq.heapify(waiting)
        while waiting and waiting[0][0] < kept[0] - _WORTH * ground.size:
            total, i, maneuver = heapq.heappop(waiting)
            if maneuver is None:
                for cost, maneuver in ground.ordered(poses[i], poses[k])[:1]:
                    heapq.heappush(waiting, (best[i] + cost, i, maneuver))
            elif ground.passes(poses[i], maneuver):
                kept = (total, i, maneuver)
        best[k] = kept[0]
        links.append(kept[1:])
    found: list[Maneuver] = []
    k = len(poses) - 1
    while k:
        k, maneuver = links[k]
        found.insert(0, maneuver)
    return found


def _nodes(chain: Sequence[Maneuver]) -> Floats:
    """Poses between the links of a chain, shape (N + 1, 7)."""
    poses = np.column_stack(integrated(np.array([e.twist for e in _stretches(chain)])))
    return np.asarray(poses[np.cumsum([0] + [len(link.stretches) for link in chain])])


def _cut(stretches: Sequence[Stretch], ground: Ground) -> list[Maneuver]:
    """A way in pieces of about one cost: what lies between the nodes."""
    total = ground.cost(stretches)
    most = total / np.clip(total / ground.size, _NODES, 2 * _NODES)
    found: list[Maneuver] = []
    piece: list[Stretch] = []
    for each in _joined(stretches):
        parts = max(1, round(ground.cost([each]) / most))
        a, b, c = each.turn
        part = Stretch(each.name, each.advance / parts, (a / parts, b / parts, c / parts))
        for _ in range(parts):
            piece.append(part)
            if ground.cost(piece) > most / 2:
                found.append(Maneuver(tuple(piece)))
                piece = []
    return found + ([Maneuver(tuple(piece))] if piece else [])


def _moved(chain: list[Maneuver], ground: Ground) -> list[Maneuver]:
    """The chain with its inner poses moved, along, aside or about, while that makes it cheaper."""
    poses = _nodes(chain)
    step = 0.5
    while step > _FINEST:
        better = False
        for k, (x, y, turn) in itertools.product(range(1, len(chain)), step * _WAYS):
            most = ground.cost(_stretches(chain[k - 1 : k + 1])) - _WORTH * ground.size
            twist = np.array([[ground.size * x, ground.size * y, 0.0, 0.0, 0.0, turn]])
            pose = composed(poses[k][None], np.column_stack(exponential(twist)))[0]
            links = ((poses[k - 1], pose), (pose, poses[k + 1]))
            pair = [maneuver for ends in links for _, maneuver in ground.ordered(*ends)[:1]]
            if (
                len(pair) == 2
                and ground.cost(_stretches(pair)) < most
                and all(
                    ground.passes(ends[0], link) for ends, link in zip(links, pair, strict=True)
                )
            ):
                chain[k - 1 : k + 1], poses[k], better = pair, pose, True
        if not better:
            step /= 2
    return chain


_WAYS = np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0]], float)
_FINEST = 0.02
"""Of a move, in sizes and rad."""
