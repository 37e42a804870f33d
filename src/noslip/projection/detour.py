"""A trajectory that leads straight into obstacles, led past them.

Of the trajectories outside, the nearest to it waits before such an obstacle and then leaps to the
other side: by itself each sample leaves the obstacle back or ahead.
"""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.projection.blend import spread
from noslip.trajectory import PoseTrajectory

_STRAIGHT = 0.5
"""Share of the ways out that leads across the path, up to which it leads straight in: a circle that
it enters up to a third of the radius beside the center."""
_SIDE = 1e-3
"""Share up to which neither side is the nearer one."""
_CLEAR, _WIDEST = 1.1, 10
"""How far it is moved aside, over the obstacle's depth, and doublings of that: farther, it is not
past an obstacle but within a room."""


def around(trajectory: PoseTrajectory, system: ConstraintSystem, begin: float) -> PoseTrajectory:
    """Lead a trajectory past what it leads straight into.

    It passes where the ways out of the obstacle lead on the whole, across the path.  Where they
    cancel out, it passes on the tool's left (its y axis), or above (z) where left is along the path
    or off a surface that must be kept to.  Rotations stay, and so does what begins or ends inside.

    Parameters
    ----------
    trajectory : PoseTrajectory
    system : ConstraintSystem
        Of it the limits on the position count, and what must be zero of it, to first order.
    begin : float
        Time at the first sample (s).
    """
    limits, held = system.limits.of_poses, system.equalities.of_poses
    positions, quaternions = trajectory.positions, trajectory.quaternions
    times, still = trajectory.clock + begin, np.zeros((len(trajectory), 3))

    def depths(positions: Floats) -> Floats:
        return -np.minimum(limits.residuals(times, positions, quaternions, still, still), 0.0)

    def slopes(part: ConstraintSystem, k: int) -> Floats:
        at = (times[k], positions[k], quaternions[k], still[k], still[k])
        return part.instant(*at)[2][:, :3]

    deep, last = depths(positions), len(trajectory) - 1
    inside = np.flatnonzero(np.diff(deep.any(axis=1), prepend=False, append=False))
    for first, after in inside.reshape(-1, 2).tolist():
        if first == 0 or after > last:
            continue
        deepest = first + int(deep[first:after].max(axis=1).argmax())
        out = sum(deep[k] @ slopes(limits, k) for k in range(first, after))
        along = np.array([positions[after] - positions[first - 1], *slopes(held, deepest)])
        across = np.eye(3) - np.linalg.pinv(along) @ along
        _, left, up = trajectory.rotations[deepest].as_matrix().T
        ways = [across @ way for way in (out / deep[first:after].sum(), left, up)]
        if np.linalg.norm(ways[0]) > _STRAIGHT:
            continue
        aside = next(way for way in ways if np.linalg.norm(way) > _SIDE)
        aside *= _CLEAR * deep[deepest].max() / np.linalg.norm(aside)
        # As long before and behind as within.
        ends = max(2 * first - after, 0), min(2 * after - first, last)
        for doubling in range(_WIDEST):
            far = 2.0**doubling * aside
            knots = {first: far, after - 1: far} | {k: np.zeros(3) for k in ends}
            moved = positions + spread(knots, np.arange(len(trajectory)))
            if not depths(moved)[first:after].any():
                positions = moved
                break
    if positions is trajectory.positions:
        return trajectory
    return PoseTrajectory(trajectory.times, positions, trajectory.rotations, name=trajectory.name)
