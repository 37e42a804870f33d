"""How far the demonstrations of one primitive lie apart, starts and goals aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from noslip._typing import Floats
from noslip._values import Value
from noslip.boundary import Boundary
from noslip.errors import InputError
from noslip.law.law import Law
from noslip.projection.blend import through
from noslip.rule import no_rule
from noslip.runtime.rollout import rollout
from noslip.trajectory import PoseTrajectory

_SAMPLES = 101
"""Of the covariances: a demonstration bends far less often than every hundredth of its way."""


@dataclass(frozen=True, eq=False)
class Spread(Value):
    """Covariance of the demonstrations of a primitive about their mean, along the motion.

    Each demonstration is compared with the primitive's motion, moved to the demonstration's own
    start and goal as in :meth:`noslip.ConstrainedDMP.adapt`, at equal fractions of the durations:
    what differs in start, goal and duration is no spread.

    Attributes
    ----------
    demonstrations : int
        How many; two or more.
    positions, rotations : array, shape (K, n, n) and (K, 3 b, 3 b)
        Covariances of position (m^2, or the coordinates' units) and of the rotation vector
        ``Log(R_demo R^T)`` (rad^2), world frame, at fractions of the duration evenly spaced from 0
        to 1; unbiased (over n - 1).
    """

    demonstrations: int
    positions: Floats
    rotations: Floats

    def __post_init__(self) -> None:
        if self.demonstrations < 2:
            raise InputError(f"a spread is of 2 demonstrations or more, not {self.demonstrations}")
        for name in ("positions", "rotations"):
            array = np.array(getattr(self, name), dtype=np.float64)
            square = array.ndim == 3 and array.shape[1] == array.shape[2]
            if not square or not np.isfinite(array).all():
                raise InputError(
                    f"spread: {name} has shape {array.shape}, expected finite (K, d, d)"
                )
            variances = np.diagonal(array, axis1=1, axis2=2)
            skewed = np.any(array != array.swapaxes(1, 2))
            if not len(array) or variances.min(initial=0.0) < 0 or skewed:
                raise InputError(f"spread: {name} must be symmetric, its variances not negative")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

        if len(self.positions) != len(self.rotations):
            raise InputError("spread: positions and rotations must be of equal length")

    @property
    def fractions(self) -> Floats:
        """Where it is known, as fractions of the duration, shape (K,)."""
        return np.linspace(0.0, 1.0, len(self.positions))

    @property
    def position_deviation(self) -> Floats:
        """Standard deviation along each world axis (m), shape (K, 3); or of each coordinate."""
        return np.sqrt(np.diagonal(self.positions, axis1=1, axis2=2))

    @property
    def rotation_deviation(self) -> Floats:
        """Standard deviation about each world axis (rad), shape (K, 3)."""
        return np.sqrt(np.diagonal(self.rotations, axis1=1, axis2=2))

    @classmethod
    def about(cls, law: Law, demonstrations: Sequence[PoseTrajectory]) -> Spread | None:
        """Spread of demonstrations about a law; None of fewer than two.

        Parameters
        ----------
        law : Law
            Fitted to all of them.
        demonstrations : sequence of PoseTrajectory
        """
        if len(demonstrations) < 2:
            return None
        fractions = np.linspace(0.0, 1.0, _SAMPLES)
        space, n = law.space, law.space.linear
        mean = rollout(law, no_rule(space), duration=1.0).resampled(times=fractions)
        apart = []
        for demonstration in demonstrations:
            times = demonstration.times[0] + demonstration.duration * fractions
            theirs = demonstration.resampled(times=times)
            own = through(mean, [Boundary.keeping(theirs, at, "pose") for at in (0.0, 1.0)])
            apart.append(space.difference(theirs.points, own.points))
        moved, turned = zip(*(np.split(each, [n], axis=1) for each in apart), strict=True)
        return cls(len(demonstrations), _covariance(moved), _covariance(turned))


def _covariance(deviations: Sequence[Floats]) -> Floats:
    apart = np.array(deviations)
    apart -= apart.mean(axis=0)
    found = np.einsum("nki,nkj->kij", apart, apart) / (len(apart) - 1)
    return np.asarray((found + found.swapaxes(1, 2)) / 2)
