"""First guess of the trajectory projection: turn the tool until its edge leads along the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.edge_motion import edge_motion
from noslip.constraints.system import ConstraintSystem
from noslip.quaternions import inverse, product
from noslip.space import Placed, Samples, Seen, Space

REACH = 0.005
"""Of the path's extent: nothing nearer than that says where a tool is heading."""
REST = 0.05
"""Fraction of the typical speed below which the direction of travel says nothing."""
BACKWARDS = 0.3
"""Share of its way that a stretch must go backwards, net, to count as backed up on purpose."""
PLUNGING = 0.2
"""Share of its speed in the blade's plane up to which a tool that goes backwards just plunges."""
SIDEWAYS = 0.01
"""Share of the speed within the blade's plane below which its direction there is not trusted."""
_ROUND, _IN_PLANE = 2.0, 0.35
"""Turn (rad) that takes a tool round, and mean slip (rad) of one that had better stay: of a circle
with the tool held still it is 1."""
_ROUNDS = 3
"""Of a period, so that the middle one feels no ends."""
_MOST_SMOOTHED = 5_000
"""Samples smoothed one by one: where a tool rests, fourth differences of three times as many may be
off by a percent; those of a hundred thousand lose all digits."""
_ROUNDED = 1e-9
"""Share of a length that its sum over a path may be wrong by."""


@dataclass(frozen=True)
class Heading:
    """The guess and what it found out about the demonstration.

    Attributes
    ----------
    turns : array, shape (N, 3 b)
        Rotation vectors, world frame (rad): ``R_guess = Exp(turns) R``.
    backing : int
        Stretches between rests in which the demonstration itself moves backwards; there the edge
        trails, as it did when recorded.
    """

    turns: Floats
    backing: int


NO_TURN = Heading(np.zeros((1, 1)), 0)
"""Of any motion: as it is."""


def turn_edge_into_path(
    trajectory: Samples, system: ConstraintSystem, smoothing: float, *, periodic: bool = False
) -> Heading:
    """Smallest turns that bring each sample's velocity into the blade's plane, edge leading.

    A blade has one edge, so of the two turns that satisfy the constraint the one with
    ``R x_b . v >= 0`` is taken.  Turns are followed continuously as long as the tool moves.  Where
    it comes to rest and goes on backwards (``R x_b . v < 0`` on the whole, clearly, until the next
    rest), it was moved backwards on purpose and the edge stays behind.  Directions are smoothed
    with weights that vanish with the speed, so that the noise of a tool at rest turns nothing.

    Constraints that name no edge get no turn, nor do tools that joints carry.  A tool under a rule
    about its motion as another body sees it is turned into its path there.  A period is turned
    as in the middle of several; one that is sawn to and fro within the blade's plane stays so.
    """
    if periodic:
        steps = len(trajectory) - 1
        rows = np.append(np.tile(np.arange(steps), _ROUNDS), 0)
        times = np.linspace(0.0, _ROUNDS * trajectory.duration, len(rows))
        rounds = trajectory.with_points(trajectory.points[rows], times)
        found = _turned(rounds, system, smoothing / _ROUNDS**4, sawing=True)
        middle = slice(_ROUNDS // 2 * steps, (_ROUNDS // 2 + 1) * steps + 1)
        return Heading(found.turns[middle], -(-found.backing // _ROUNDS))
    return _turned(trajectory, system, smoothing, sawing=False)


def _turned(
    trajectory: Samples, system: ConstraintSystem, smoothing: float, *, sawing: bool
) -> Heading:
    space, points = system.space, trajectory.points
    turns, backing = np.zeros((len(trajectory), space.angular)), 0
    for k, body in enumerate(space.seen):
        of_body = [not c.coordinates and space.body(c.body) == k for c in system.constraints]
        constraint = system.part(of_body).edged
        tool = body.body if isinstance(body, Seen) else body
        if constraint is None or not isinstance(tool, Placed) or tool.turn is None:
            continue
        poses, work = _poses(space, tool, points), None
        if isinstance(body, Seen):
            working = _poses(space, body.work, points)
            work = Rotation.from_quat(working[:, 3:], scalar_first=True)
            place = work.inv().apply(poses[:, :3] - working[:, :3])
            poses = np.hstack([place, product(inverse(working[:, 3:]), poses[:, 3:])])
        turned, backed = _turned_into_path(
            trajectory.clock, poses, constraint, smoothing, sawing=sawing
        )
        at = slice(3 * tool.turn, 3 * tool.turn + 3)
        turns[:, at] = turned if work is None else work.apply(turned)
        backing += backed
    return Heading(turns, backing)


def _poses(space: Space, body: Placed, points: Floats) -> Floats:
    """Position and quaternion of a body, shape (N, 7)."""
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))
    if body.turn is not None:
        own = space.linear + 4 * body.turn
        turns = points[:, own : own + 4]
    return np.hstack([points[:, body.first : body.first + 3], turns])


def _turned_into_path(
    clock: Floats, poses: Floats, constraint: Constraint, smoothing: float, *, sawing: bool
) -> tuple[Floats, int]:
    none = np.zeros((len(poses), 3)), 0
    if constraint.edge is None or constraint.edge.lateral is None:
        return none
    positions = poses[:, :3]
    rotations = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    seen = edge_motion(constraint, clock, positions, rotations)
    velocities = _travel(seen.points, clock)
    speed = np.linalg.norm(velocities, axis=1)
    if speed.max() == 0:
        return none
    frame = constraint.edge.frame
    ahead, aside, across = frame @ seen.rotations.inv().apply(velocities).T

    # By distance, not by time: rests and single wrong stamps say nothing.
    typical = float(np.sum(speed**2) / np.sum(speed))
    moving = speed > REST * typical
    angles = np.zeros(len(speed))
    axes = np.zeros((len(speed), 3))
    backing, last = 0, 0.0
    for stretch in _stretches(moving):
        facing = -1.0 if ahead[stretch].sum() < -BACKWARDS * speed[stretch].sum() else 1.0
        backing += facing < 0
        # Direction within the blade's plane that is to lie along the path, edge leading.
        along, plunge = facing * ahead[stretch], facing * across[stretch]
        # A plunging blade goes a hair backwards as often as forwards: no reason to turn it round.
        side = np.where(along >= -PLUNGING * np.hypot(along, plunge), 1.0, -1.0)
        tilt = np.arctan2(side * plunge, side * along)
        # Moving sideways leaves that direction open: as before and after, or the edge itself.
        open_ = np.hypot(along, plunge) < SIDEWAYS * speed[stretch]
        if open_.any():
            known = np.flatnonzero(~open_)
            between = np.interp(np.flatnonzero(open_), known, tilt[known]) if len(known) else 0.0
            tilt[open_] = between
        lead = np.column_stack([np.cos(tilt), np.sin(tilt)])
        reach = lead[:, 0] * along + lead[:, 1] * plunge
        angle = np.unwrap(np.arctan2(facing * aside[stretch], reach))
        angle += 2 * np.pi * np.round((last - angle[0]) / (2 * np.pi))
        last = angle[-1]
        angles[stretch] = angle
        # The axis is perpendicular to the lateral axis and to that direction.
        axes[stretch] = lead @ [frame[2], -frame[0]]
    slips = np.arcsin(np.clip(np.abs(aside) / np.where(speed > 0, speed, 1.0), 0.0, 1.0))
    if sawing and np.abs(angles).max() > _ROUND and speed @ slips < _IN_PLANE * speed.sum():
        return none[0], 1
    turns = rotations.apply(axes * angles[:, None])
    sure = np.minimum(speed, 2 * typical) ** 2
    weights = np.where(moving, sure / sure.mean(), 0.0)
    return _smoothed(turns, weights, smoothing), int(backing)


def _travel(positions: Floats, times: Floats) -> Floats:
    """Velocity of the chord that reaches ``REACH`` of the extent to either side of each sample.

    Noise of a tool at rest stays within that reach, so that rest is slow in it whatever the rate.
    """
    reach = REACH * np.ptp(positions, axis=0).max()
    last = len(times) - 1
    ahead = _first_beyond(positions, reach)
    behind = last - _first_beyond(positions[::-1], reach)[::-1]
    chord = positions[ahead] - positions[behind]
    return np.asarray(chord / (times[ahead] - times[behind])[:, None])


def _first_beyond(positions: Floats, reach: float) -> NDArray[np.intp]:
    """For each sample the first later one that is farther than a reach, or the last."""
    last = len(positions) - 1
    # None before as much of the path lies between.
    path = np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))
    found = np.searchsorted(path, np.append(0.0, path) + (1 - _ROUNDED) * reach) + 1
    found = np.clip(found, np.minimum(np.arange(last + 1) + 1, last), last)
    near = np.arange(last)
    while len(near):
        away = np.sum((positions[found[near]] - positions[near]) ** 2, axis=1)
        near = near[(away <= reach**2) & (found[near] < last)]
        found[near] += 1
    return found


def _stretches(moving: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Runs of consecutive samples that move."""
    indices = np.flatnonzero(moving)
    return np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)


def _smoothed(values: Floats, weights: Floats, smoothing: float) -> Floats:
    """Minimize ``sum w |x - value|^2 + smoothing |x''|^2`` with time normalized."""
    count = len(values)
    if count < 4 or not values.any():
        return values
    if (stride := -(-count // _MOST_SMOOTHED)) > 1:
        starts = np.arange(0, count, stride)
        sums = np.add.reduceat(weights, starts)
        means = np.add.reduceat(weights[:, None] * values, starts)
        means /= np.where(sums > 0, sums, 1.0)[:, None]
        smooth = _smoothed(means, sums / stride, smoothing)
        samples, middles = np.arange(count), starts + (stride - 1) / 2
        return np.column_stack([np.interp(samples, middles, each) for each in smooth.T])
    strength = smoothing * (count - 1) ** 4
    bands = np.zeros((3, count))
    bands[2] = 6.0
    bands[2, [0, -1]], bands[2, [1, -2]] = 1.0, 5.0
    bands[1, 1:] = -4.0
    bands[1, [1, -1]] = -2.0
    bands[0, 2:] = 1.0
    bands *= strength
    # The floor keeps the system definite for a tool that moves in one or two samples only.
    bands[2] += weights + 1e-9
    return np.asarray(solveh_banded(bands, weights[:, None] * values))
