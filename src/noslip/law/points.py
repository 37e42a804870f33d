"""Points of a space as a law sees them: those of a trajectory, their mean, and the goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value
from noslip.boundary import rotations_of
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.winding import Winding, farthest_from_goal, turning
from noslip.quaternions import inverse, product, turns_between
from noslip.space import Space


@dataclass(frozen=True, eq=False)
class Goal(Value):
    """Where a motion ends, and what leads to it.

    Attributes
    ----------
    position : array, shape (n,)
        Meters, or the coordinates' own units.
    *windings : Winding
        Of each rotation: R_g, or what leads to it where the demonstration turns beyond half a turn.
    """

    position: Floats
    windings: tuple[Winding, ...]

    def __init__(self, position: ArrayLike, *windings: Winding) -> None:
        object.__setattr__(self, "position", frozen("goal position", position, np.size(position)))
        object.__setattr__(self, "windings", windings)

    @property
    def winding(self) -> Winding:
        """That of the one rotation of a pose."""
        (winding,) = self.windings
        return winding

    @cached_property
    def quaternions(self) -> Floats:
        """The last of the windings, shape (4 b,)."""
        return np.concatenate([np.zeros(0), *(each.quaternions[-1] for each in self.windings)])

    @cached_property
    def rotation(self) -> Rotation:
        """The same: one, several, or none at all, which is the identity."""
        if len(self.windings) == 1:
            return self.windings[0].goal
        return rotation_of(self.quaternions)

    @cached_property
    def point(self) -> Floats:
        """Coordinates and quaternions, shape (n + 4 b,)."""
        return np.concatenate([self.position, self.quaternions])

    def pull(
        self, points: Floats, attractor: Attractor, count: int, end: Floats, before: float = 0.0
    ) -> Floats:
        """Return what draws the first samples to where they end, by way of the windings.

        Parameters
        ----------
        points : array, shape (N, n + 4 b)
            Evenly spaced from the start to the end.
        attractor : Attractor
        count : int
            How many samples, at most all but the last.
        end : array, shape (n + 4 b,)
            Their own goal: the last sample, or what a cycle goes around.
        before : float
            The step that led to the first sample, over the duration; 0 at the start of the motion.

        Returns
        -------
        array, shape (count, n + 3 b)
            As the step that leaves the sample feels it.
        """
        fraction, n = 1 / (len(points) - 1), len(self.position)
        found = [np.broadcast_to(end[:n], (count, n)) - points[:count, :n]]
        for k, winding in enumerate(self.windings):
            at = slice(n + 4 * k, n + 4 * k + 4)
            last = Rotation.from_quat(end[at], scalar_first=True)
            rotations, left_out = winding.along(0.0, count, fraction, attractor, before, last)
            found.append(turns_between(points[:count, at], rotations) + left_out)
        return np.hstack(found)


def mean(space: Space, points: Sequence[Floats]) -> Floats:
    """Mean point; of one, that one to the last bit."""
    if len(points) == 1:
        return points[0]
    stacked, n = np.array(points), space.linear
    found = [stacked[:, :n].mean(axis=0)]
    for k in range(space.rotations):
        turned = stacked[:, n + 4 * k : n + 4 * k + 4]
        rotation = Rotation.from_quat(turned, scalar_first=True).mean()
        found.append(rotation.as_quat(scalar_first=True))
    return np.concatenate(found)


def baseline(space: Space, points: Floats) -> Floats:
    """What a cycle goes around: the mean of its samples, shape (N, n + 4 b), the last left out."""
    return mean(space, list(points[:-1]))


def around(space: Space, demonstrations: Sequence[Floats]) -> Goal:
    """What demonstrated cycles go around (mean), with what leads the rotations that turn far."""
    n = space.linear
    middle = mean(space, [baseline(space, points) for points in demonstrations])
    windings = []
    for k in range(space.rotations):
        at = slice(n + 4 * k, n + 4 * k + 4)
        first = max((points[:, at] for points in demonstrations), key=turning)
        windings.append(Winding.cycle(first, middle[at]))
    return Goal(middle[:n], *windings)


def goal(space: Space, demonstrations: Sequence[Floats]) -> Goal:
    """Mean of where demonstrations end, with what leads the one to it that turns farthest."""
    n = space.linear
    point = mean(space, [points[-1] for points in demonstrations])
    turned = []
    for k in range(space.rotations):
        at = slice(n + 4 * k, n + 4 * k + 4)
        farthest = max((points[:, at] for points in demonstrations), key=farthest_from_goal)
        led = product(inverse(farthest[-1]), point[at])
        turned.append(product(farthest, led))
    windings = [Winding.around(each) for each in turned]
    # Of as many knots, for C.
    most = max((len(winding.quaternions) for winding in windings), default=1)
    if any(len(winding.quaternions) < most for winding in windings):
        windings = [Winding.around(each, most - 1) for each in turned]
    return Goal(point[:n], *windings)


def rotation_of(quaternions: Floats) -> Rotation:
    """Rotation of a point: one, several, or none at all, which is the identity."""
    found = rotations_of(quaternions)
    return Rotation.identity() if found is None else found


def each_of(rotation: Rotation) -> list[Rotation]:
    """Rotations one by one, of one or several."""
    return [rotation] if rotation.single else list(rotation)


def quaternions_of(space: Space, rotation: Rotation) -> Floats:
    """Quaternions of a point from its rotation, the inverse of :func:`rotation_of`."""
    if not space.rotations:
        return np.zeros(0)
    return np.ravel(rotation.as_quat(scalar_first=True))


def frozen(name: str, values: ArrayLike, size: int) -> Floats:
    """Return a read-only copy of so many finite numbers."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name} must be {size} finite numbers, got shape {array.shape}")
    array.flags.writeable = False
    return array
