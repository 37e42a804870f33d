"""A trajectory that leads straight into obstacles, led past them.

Of the trajectories outside, the nearest to it waits before such an obstacle and then leaps to the
other side: by itself each sample leaves the obstacle back or ahead.
"""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.projection.blend import spread
from noslip.quaternions import inverse, product
from noslip.space import Placed, Samples, Space

_STRAIGHT = 0.5
"""Share of the ways out that leads across the path, up to which it leads straight in: a circle that
it enters up to a third of the radius beside the center."""
_SIDE = 1e-3
"""Share up to which neither side is the nearer one."""
_CLEAR, _WIDEST = 1.1, 10
"""How far it is moved aside, over the obstacle's depth, and doublings of that: farther, it is not
past an obstacle but within a room."""
_LEFT_AND_UP = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def around(trajectory: Samples, system: ConstraintSystem, begin: float) -> Samples:
    """Lead a trajectory past what it leads straight into.

    It passes where the ways out of the obstacle lead on the whole, across the path.  Where they
    cancel out, it passes on the tool's left (its y axis), or above (z) where left is along the path
    or off a surface that must be kept to; of vectors, on the side of a coordinate.  Rotations stay,
    and so does what begins or ends inside.

    Parameters
    ----------
    trajectory : PoseTrajectory or Trajectory
    system : ConstraintSystem
        Of it the limits on the position count, and what must be zero of it, to first order.
    begin : float
        Time at the first sample (s).
    """
    limits, held = system.limits.of_poses, system.equalities.of_poses
    positions, quaternions = trajectory.positions, trajectory.quaternions
    times, n = trajectory.clock + begin, system.space.linear
    still = np.zeros((len(trajectory), n)), np.zeros((len(trajectory), system.space.angular))

    def depths(positions: Floats) -> Floats:
        return -np.minimum(limits.residuals(times, positions, quaternions, *still), 0.0)

    def slopes(part: ConstraintSystem, k: int) -> Floats:
        at = (times[k], positions[k], quaternions[k], still[0][k], still[1][k])
        return part.instant(*at)[2][:, :n]

    deep, last = depths(positions), len(trajectory) - 1
    inside = np.flatnonzero(np.diff(deep.any(axis=1), prepend=False, append=False))
    for first, after in inside.reshape(-1, 2).tolist():
        if first == 0 or after > last:
            continue
        deepest = first + int(deep[first:after].max(axis=1).argmax())
        out = sum(deep[k] @ slopes(limits, k) for k in range(first, after))
        along = np.array([positions[after] - positions[first - 1], *slopes(held, deepest)])
        across = np.eye(n) - np.linalg.pinv(along) @ along
        sides = _sides(system.space, quaternions[deepest])
        ways = [across @ way for way in (out / deep[first:after].sum(), *sides)]
        if np.linalg.norm(ways[0]) > _STRAIGHT:
            continue
        aside = next((way for way in ways if np.linalg.norm(way) > _SIDE), None)
        if aside is None:
            continue
        aside *= _CLEAR * deep[deepest].max() / np.linalg.norm(aside)
        # As long before and behind as within.
        ends = max(2 * first - after, 0), min(2 * after - first, last)
        for doubling in range(_WIDEST):
            far = 2.0**doubling * aside
            knots = {first: far, after - 1: far} | {k: np.zeros(n) for k in ends}
            moved = positions + spread(knots, np.arange(len(trajectory)))
            if not depths(moved)[first:after].any():
                positions = moved
                break
    if positions is trajectory.positions:
        return trajectory
    return trajectory.with_points(np.hstack([positions, quaternions]))


def _sides(space: Space, quaternion: Floats) -> Floats:
    """Ways aside, in the order in which to try them: left and up of each tool; else each axis."""
    if not space.rotations:
        return np.eye(space.linear)
    turning = [body for body in space.bodies if isinstance(body, Placed) and body.turn is not None]
    ways = np.zeros((len(turning), 2, space.linear))
    for way, body in zip(ways, turning, strict=True):
        turn = quaternion[4 * (body.turn or 0) :][:4]
        way[:, body.first : body.first + 3] = product(product(turn, _LEFT_AND_UP), inverse(turn))[
            :, 1:
        ]
    return ways.reshape(-1, space.linear)
