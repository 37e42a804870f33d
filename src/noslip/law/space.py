"""The space that a law moves in: poses, positions and rotations together.

All that a law must know of its space stands here and in :mod:`noslip.law.layout`: points, their
differences, means, and the goal that a motion is drawn to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.layout import FORCE, POINT, STATE
from noslip.law.winding import Winding, farthest_from_goal
from noslip.quaternions import inverse, product, turns_between
from noslip.trajectory import PoseTrajectory


@dataclass(frozen=True, eq=False)
class Goal(Value):
    """Where a motion ends, and what leads to it.

    Attributes
    ----------
    position : array, shape (3,)
        Meters.
    winding : Winding
        R_g, or what leads to it where the demonstration turns beyond half a turn.
    """

    position: Floats
    winding: Winding

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen("goal position", self.position, 3))

    @property
    def rotation(self) -> Rotation:
        """The last of the winding."""
        return self.winding.goal

    @cached_property
    def point(self) -> Floats:
        """Position and quaternion, shape (7,)."""
        return np.concatenate([self.position, self.winding.quaternions[-1]])

    def pull(self, points: Floats, attractor: Attractor, count: int) -> Floats:
        """Return what draws the first samples to the last one, by way of the winding.

        Parameters
        ----------
        points : array, shape (N, 7)
            Evenly spaced from the start to the end.
        attractor : Attractor
        count : int
            How many samples, at most all but the last.

        Returns
        -------
        array, shape (count, 6)
            As the step that leaves the sample feels it.
        """
        fraction = 1 / (len(points) - 1)
        rotations, left_out = self.winding.along(
            0.0, count, fraction, attractor, 0.0, _rotation(points[-1])
        )
        ends = np.hstack([np.broadcast_to(points[-1, STATE["position"]], (count, 3)), rotations])
        found = POSE.difference(ends, points[:count])
        found[:, FORCE["angular"]] += left_out
        return found


@dataclass(frozen=True)
class PoseSpace:
    """R^3 x SO(3): points (x, y, z, qw, qx, qy, qz), world velocities, linear then angular."""

    def points(self, trajectory: PoseTrajectory) -> Floats:
        """Samples of a trajectory, shape (N, 7)."""
        return np.hstack([trajectory.positions, trajectory.quaternions])

    def difference(self, ends: Floats, begins: Floats) -> Floats:
        """``(p' - p, Log(R' R^T))`` of points, shape (N, 6)."""
        moved = ends[:, STATE["position"]] - begins[:, STATE["position"]]
        return np.hstack([moved, turns_between(_quaternions(begins), _quaternions(ends))])

    def mean(self, points: Sequence[Floats]) -> Floats:
        """Mean point; of one, that one to the last bit."""
        if len(points) == 1:
            return points[0]
        stacked = np.array(points)
        rotation = _rotation(stacked).mean()
        return np.concatenate(
            [stacked[:, STATE["position"]].mean(axis=0), rotation.as_quat(scalar_first=True)]
        )

    def goal(self, demonstrations: Sequence[Floats]) -> Goal:
        """Mean of where demonstrations end, with what leads the one to it that turns farthest."""
        point = self.mean([points[-1] for points in demonstrations])
        turning = [_quaternions(points) for points in demonstrations]
        farthest = max(turning, key=farthest_from_goal)
        led = product(inverse(farthest[-1]), _quaternions(point))
        return Goal(point[STATE["position"]], Winding.around(product(farthest, led)))


POSE = PoseSpace()
"""The one space there is."""


def _quaternions(points: Floats) -> Floats:
    return points[..., STATE["quaternion"]]


def _rotation(points: Floats) -> Rotation:
    return Rotation.from_quat(_quaternions(points), scalar_first=True)


def frozen(name: str, values: ArrayLike, size: int) -> Floats:
    """Return a read-only copy of so many finite numbers."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name} must be {size} finite numbers, got shape {array.shape}")
    array.flags.writeable = False
    return array


POINT_SIZE, VELOCITY_SIZE = POINT.stop, FORCE.size
"""Numbers of a point, and of a velocity or force."""
