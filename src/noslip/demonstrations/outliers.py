"""Demonstrations that lie far from the others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.demonstrations._several import at_fractions, several
from noslip.trajectory import PoseTrajectory

THRESHOLD = 3.5
"""Robust standard deviations above the median (Iglewicz and Hoaglin, "How to detect and handle
outliers", 1993)."""
TIMES_MEDIAN = 2.0
"""Of the median distance, the least that is far: of a few, the deviation is known badly."""
FEWEST = 4
"""Demonstrations: of three, no one can tell which two belong together."""
SAMPLES = 101
"""Instants at which motions are compared, a hundredth of their duration apart."""
ROUNDING = 1e-9
"""Distances below this (m, rad) are none: copies differ by rounding."""
GAUSSIAN = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True, eq=False)
class Outliers(Value):
    """How far each demonstration lies from the others, and which are too far.

    Attributes
    ----------
    names : tuple of str
        Of the demonstrations.
    position_distances, rotation_distances : array, shape (n,)
        Median over the others of the rms distance (m) and of the rms angle (rad).
    position_limit, rotation_limit : float
        Above which a demonstration is an outlier.
    """

    names: tuple[str, ...]
    position_distances: Floats
    rotation_distances: Floats
    position_limit: float
    rotation_limit: float

    @property
    def outlying(self) -> NDArray[np.bool_]:
        """Whether each is an outlier, shape (n,)."""
        far = self.position_distances > self.position_limit
        turned = self.rotation_distances > self.rotation_limit
        return np.asarray(far | turned)

    def reason(self, index: int) -> str:
        """Say by how much a demonstration lies far from the others, or how near it is."""
        position, angle = self.position_distances[index], self.rotation_distances[index]
        parts = []
        if position > self.position_limit:
            parts.append(f"{position * 1e3:.3g} mm away (limit {self.position_limit * 1e3:.3g} mm)")
        if angle > self.rotation_limit:
            turn, limit = np.degrees([angle, self.rotation_limit])
            parts.append(f"turned by {turn:.3g} degrees (limit {limit:.3g})")
        if not parts:
            return f"within {position * 1e3:.3g} mm and {np.degrees(angle):.3g} degrees of most"
        return f"far from the others: {', '.join(parts)}"


def outliers(demonstrations: Iterable[PoseTrajectory], *, threshold: float = THRESHOLD) -> Outliers:
    """Find demonstrations that lie far from the others.

    Two demonstrations are compared at equal fractions of their durations, their positions relative
    to their first ones: the distance is the rms over the motion.  Rotations are compared as they
    are, because how the tool is held against the world is part of the task.  Of each demonstration
    the median of its distances to the others counts, and it is an outlier if that exceeds

        max(median + threshold * 1.4826 MAD, 2 * median)

    of all, in position or in rotation.  Nothing is dropped here: see ``outlying``.

    Parameters
    ----------
    demonstrations : several PoseTrajectory
        4 or more; of any duration and rate.
    threshold : float
        Robust standard deviations above the median.

    Raises
    ------
    InputError
        If there are fewer than 4, or the threshold is not positive.
    """
    motions = several(demonstrations, FEWEST, "outliers")
    threshold = _arguments.positive("threshold", threshold)
    sampled = [at_fractions(motion, SAMPLES) for motion in motions]
    position, rotation = np.zeros((2, len(motions), len(motions)))
    for i, one in enumerate(sampled):
        for j, other in enumerate(sampled[:i]):
            apart = (one.positions - one.positions[0]) - (other.positions - other.positions[0])
            turned = (one.rotations * other.rotations.inv()).magnitude()
            position[i, j] = position[j, i] = np.sqrt(np.mean(np.sum(apart**2, axis=1)))
            rotation[i, j] = rotation[j, i] = np.sqrt(np.mean(turned**2))
    away, turned_by = _to_most(position), _to_most(rotation)
    return Outliers(
        names=tuple(motion.name for motion in motions),
        position_distances=away,
        rotation_distances=turned_by,
        position_limit=_limit(away, threshold),
        rotation_limit=_limit(turned_by, threshold),
    )


def _to_most(pairs: Floats) -> Floats:
    others = ~np.eye(len(pairs), dtype=bool)
    return np.asarray(np.median(pairs[others].reshape(len(pairs), -1), axis=1))


def _limit(distances: Floats, threshold: float) -> float:
    middle = float(np.median(distances))
    deviation = GAUSSIAN * float(np.median(np.abs(distances - middle)))
    return max(middle + threshold * deviation, TIMES_MEDIAN * middle, ROUNDING)
