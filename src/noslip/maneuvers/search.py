"""Ways around obstacles: hybrid A* on the curves that a tool may follow.

Nodes are poses in cells of position and heading, their successors short arcs, straights or turns
where the tool stands; from promising nodes the closed-form maneuvers to the goal are tried (Dolgov,
Thrun, Montemerlo and Diebel 2010).  What still lies ahead is estimated by the shortest way on a
grid around the obstacles.  What is found is shortened, see :mod:`noslip.maneuvers.shortening`.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noslip._arguments import count, not_negative, positive, vector
from noslip._typing import Floats
from noslip.maneuvers.clearing import TOUCHING, Clear, swept
from noslip.maneuvers.maneuver import Maneuver, Stretch, composed, exponential
from noslip.maneuvers.planar import dubins, reeds_shepp, turn_drive_turn
from noslip.maneuvers.shortening import CUSP, Ground, shortened

_LEVELS = ((0.35, 6.0, 20_000), (0.35, 20.0, 20_000), (0.18, 10.0, 160_000))
"""Way of a move, how far around start and goal is searched, in radii, and points of the grid at
most: near, then wide, then fine.  Coarser moves find goals sooner, by ways up to 30 % longer."""
_BATCH = 48
"""Nodes that are expanded at once: enough that arrays cost more than their calls."""
_TURN = np.pi / 8
"""Of a move where the tool stands (rad)."""


def through(
    x: float,
    y: float,
    heading: float,
    radius: float | None,
    clear: Clear,
    *,
    reverse: bool = False,
    reach: float = 0.0,
    expansions: int = 20_000,
) -> Maneuver | None:
    """A short maneuver in the plane, from the origin to a pose, that is clear all along.

    Parameters
    ----------
    x, y, heading : float
        The goal in the edge's frame at the start (m, rad).
    radius : float or None
        Of the tightest turn (m); None for a tool that turns where it stands.
    clear : callable
        Margins of poses in the edge's frame at the start, see
        :data:`noslip.maneuvers.clearing.Clear`.
    reverse : bool
        Whether it may back up.
    reach : float
        From the edge's point to the farthest point of the tool for which there is a margin (m).
    expansions : int
        Of nodes, at most, at each of three resolutions.

    Returns
    -------
    Maneuver or None
        None where nothing was found, which does not mean that there is nothing.

    Raises
    ------
    InputError
        If the goal is not finite, or another number is out of its bounds.
    """
    x, y, heading = vector("x, y and heading", (x, y, heading), "m, m and rad").tolist()
    radius = radius if radius is None else positive("radius", radius, "m")
    reach, expansions = not_negative("reach", reach), count("expansions", expansions)
    size = radius or max(np.hypot(x, y) / 10, reach / 4) or 1.0
    ground = Ground(clear, _shots(radius, reverse), size / 16, reach, size)
    goal = np.array([x, y, 0.0, np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)])
    start = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    ends = np.array([start, goal])
    if not np.all(clear(ends[:, :3], ends[:, 3:]) >= -TOUCHING):
        return None
    straightaway = ground.shot(start, goal, np.inf, words=1)
    if straightaway is not None:
        return straightaway.maneuver
    for step, around, points in _LEVELS:
        moves = _moves(step * size, radius, reverse)
        estimate = _Estimate.over(goal, step * size / 2, around * size, points, clear, reach)
        found = _searched(goal, moves, estimate, ground, expansions)
        if found is not None:
            return shortened(found, ground)
    return None


def _shots(radius: float | None, reverse: bool) -> Callable[[Floats, Floats], list[Maneuver]]:
    def shots(begin: Floats, end: Floats) -> list[Maneuver]:
        w, z = begin[3], begin[6]
        cosine, sine = w * w - z * z, 2 * w * z
        x, y = end[0] - begin[0], end[1] - begin[1]
        x, y = cosine * x + sine * y, cosine * y - sine * x
        heading = 2 * np.arctan2(w * end[6] - z * end[3], w * end[3] + z * end[6])
        if radius is None:
            return turn_drive_turn(x, y, heading, reverse=reverse)
        return (reeds_shepp if reverse else dubins)(x, y, heading, radius)

    return shots


def _moves(step: float, radius: float | None, reverse: bool) -> list[Stretch]:
    ways = (step, -step) if reverse else (step,)
    found = [Stretch("straight", way) for way in ways]
    if radius is None:
        turns = (("turn left", _TURN), ("turn right", -_TURN))
        return found + [Stretch(name, 0.0, (0.0, 0.0, turn)) for name, turn in turns]
    sides = (("left", 1.0), ("right", -1.0))
    return found + [
        Stretch(name, way, (0.0, 0.0, side * way / radius)) for way in ways for name, side in sides
    ]


@dataclass(frozen=True)
class _Estimate:
    """Ways to the goal on a grid around the obstacles."""

    origin: Floats
    cell: float
    ways: Floats

    @classmethod
    def over(
        cls, goal: Floats, cell: float, around: float, points: int, clear: Clear, reach: float
    ) -> _Estimate:
        """Shortest ways from a grid's points to the goal, along edges that are clear."""
        import scipy.ndimage
        import scipy.sparse

        low, high = np.minimum(goal[:2], 0) - around, np.maximum(goal[:2], 0) + around
        cell = max(cell, float(np.sqrt(np.prod(high - low) / points)))
        # The goal is a point of the grid.
        before = np.ceil((goal[:2] - low) / cell).astype(int)
        shape = before + np.ceil((high - goal[:2]) / cell).astype(int) + 1
        origin = goal[:2] - before * cell
        index = np.arange(np.prod(shape)).reshape(shape)
        links = []
        for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
            begin, end = _shifted(index, step)
            way, angle = cell * np.hypot(*step), np.arctan2(step[1], step[0])
            where = origin + cell * np.column_stack(np.unravel_index(begin, shape))
            free = np.zeros(len(begin), bool)
            for turn in (angle, angle + np.pi) if reach else (angle,):
                rotation = [np.cos(turn / 2), 0, 0, np.sin(turn / 2)]
                poses = np.column_stack(
                    [where, np.zeros(len(where)), np.tile(rotation, (len(where), 1))]
                )
                twists = np.zeros((len(where), 6))
                twists[:, 0] = way if turn == angle else -way
                free |= swept(poses, twists, clear, way, reach) >= -TOUCHING
            links.append((begin[free], end[free], np.full(np.sum(free), way)))
        begin, end, way = map(np.concatenate, zip(*links, strict=True))
        graph = scipy.sparse.coo_array((way, (begin, end)), (index.size, index.size)).tocsr()
        ways = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=index[tuple(before)])
        ways = ways.reshape(shape)
        # A pose may be free where the grid's nearest point is not.
        near = scipy.ndimage.minimum_filter(ways, 3, mode="nearest") + cell
        return cls(origin, cell, np.where(np.isfinite(ways), ways, near))

    def __call__(self, positions: Floats) -> Floats:
        """Ways from positions (N, 3) to the goal (m); infinite where none was found."""
        index = np.round((positions[:, :2] - self.origin) / self.cell).astype(int)
        inside = np.all((index >= 0) & (index < self.ways.shape), axis=1)
        index[~inside] = 0
        return np.where(inside, self.ways[index[:, 0], index[:, 1]], np.inf)


def _shifted(
    index: NDArray[np.intp], step: tuple[int, int]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Points of a grid that have a neighbor one step on, and these."""
    rows, columns = index.shape
    dx, dy = step
    begin = index[: rows - dx, max(0, -dy) : columns - max(0, dy)]
    end = index[dx:, max(0, dy) : columns + min(0, dy)]
    return begin.ravel(), end.ravel()


def _searched(
    goal: Floats,
    moves: Sequence[Stretch],
    estimate: _Estimate,
    ground: Ground,
    expansions: int,
) -> list[Stretch] | None:
    """Stretches from the origin to the goal; None if the nodes or the expansions run out."""
    twists = np.array([each.twist for each in moves])
    ends = np.column_stack(exponential(twists))
    ways = np.sign(twists[:, 0])
    costs = np.array([ground.cost([each]) for each in moves])
    fineness = 2 / max(abs(twists[:, 0]))
    turning = 1.5 / max(abs(twists[:, 5]))

    def keys(poses: Floats) -> list[tuple[int, ...]]:
        place = np.round(fineness * poses[:, :2])
        angle = 2 * np.arctan2(poses[:, 6], poses[:, 3])
        heading = np.round(turning * (angle % (2 * np.pi)))
        return list(map(tuple, np.column_stack([place, heading]).astype(int).tolist()))

    limit = expansions * len(moves) + 1
    poses, cost = np.zeros((limit, 7)), np.zeros(limit)
    poses[0, 3] = 1
    parent, move = np.full(limit, -1), np.full(limit, -1)
    named = keys(poses[:1])
    best = {named[0]: 0.0}
    ahead = float(estimate(poses[:1, :3])[0])
    if not np.isfinite(ahead):
        return None
    waiting = [(ahead, ahead, 0)]
    bound, found = np.inf, None
    expanded = 0
    while waiting and expanded < expansions:
        batch: list[int] = []
        nearest, least = -1, np.inf
        while waiting and len(batch) < _BATCH:
            total, ahead, node = heapq.heappop(waiting)
            if total >= bound:
                waiting.clear()
                break
            if cost[node] <= best[named[node]]:
                batch.append(node)
                if ahead < least:
                    nearest, least = node, ahead
        if not batch:
            break
        expanded += len(batch)
        shot = ground.shot(poses[nearest], goal, bound - cost[nearest])
        if shot is not None:
            bound, found = cost[nearest] + shot.cost, (nearest, shot.maneuver)
        begin = np.repeat(batch, len(moves))
        kind = np.tile(np.arange(len(moves)), len(batch))
        after = composed(poses[begin], ends[kind])
        spent = cost[begin] + costs[kind]
        spent += np.where(
            (move[begin] >= 0) & (ways[move[begin]] * ways[kind] < 0), CUSP * ground.size, 0
        )
        ahead_of = estimate(after[:, :3])
        names = keys(after)
        promising = [
            k
            for k in np.flatnonzero(spent + ahead_of < bound)
            if spent[k] < best.get(names[k], np.inf) - TOUCHING
        ]
        if not promising:
            continue
        free = ground.free(poses[begin[promising]], twists[kind[promising]])
        for k in itertools.compress(promising, free):
            if spent[k] < best.get(names[k], np.inf) - TOUCHING:
                best[names[k]] = spent[k]
                node = len(named)
                poses[node], cost[node] = after[k], spent[k]
                parent[node], move[node] = begin[k], kind[k]
                named.append(names[k])
                heapq.heappush(waiting, (spent[k] + ahead_of[k], ahead_of[k], node))
    if found is None:
        return None
    node, maneuver = found
    way = list(maneuver.stretches)
    while node:
        way.insert(0, moves[move[node]])
        node = parent[node]
    return way
