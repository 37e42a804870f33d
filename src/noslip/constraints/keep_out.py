"""Where the tool must not go: obstacles with round boundaries.

All take ``barrier_rate`` and ``priority`` too, see :class:`noslip.constraints.limit.Limit`.
The margins are distances: inside an obstacle they are negative, and lead out the nearest way.  At
the very center no way is nearest: there the margin has slope 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from noslip._typing import Expression
from noslip.constraints.declaration import register
from noslip.constraints.fields import ORIGIN, Triple, length, point, settle
from noslip.constraints.instant import Instant
from noslip.constraints.limit import ROUNDING, Limit, rounded_length
from noslip.constraints.shape import Ball, Capsule


@register
@dataclass(frozen=True)
class KeepOutSphere(Limit):
    """``|p - c| - r >= 0``: the tool stays out of a sphere.

    Parameters
    ----------
    center : 3 numbers
        c (m, world frame).
    radius : float
        r (m); add the tool's own size to that of the obstacle.
    reference_point : 3 numbers
        The point of the tool that must stay out (m, body frame).
    """

    center: Triple = ORIGIN
    radius: float = 0.05
    reference_point: Triple = ORIGIN

    name = "keep-out-sphere"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, center=point, radius=length, reference_point=point)

    def shape(self) -> Ball:
        return Ball("keep-out", self.center, self.radius)

    def residual(self, motion: Instant) -> Expression:
        """Distance to the sphere (m)."""
        position = motion.at(self.reference_point).position
        return _clearance(position - ca.DM(list(self.center)), self.radius)


@register
@dataclass(frozen=True)
class KeepOutCapsule(Limit):
    """``min_s |p - a - s (b - a)| - r >= 0`` over s in [0, 1]: the tool stays out of a capsule.

    A capsule is what lies within a radius of a line segment: vessels, fingers, clamps.  The nearest
    point of the segment has ``s = (p - a) . (b - a) / |b - a|^2``, clamped to [0, 1] (Ericson,
    Real-Time Collision Detection, section 5.1.2).

    Parameters
    ----------
    start, end : 3 numbers
        a and b (m, world frame); equal ones make a sphere.
    radius : float
        r (m); add the tool's own size to that of the obstacle.
    reference_point : 3 numbers
        The point of the tool that must stay out (m, body frame).
    """

    start: Triple = ORIGIN
    end: Triple = (0.0, 0.0, 0.1)
    radius: float = 0.02
    reference_point: Triple = ORIGIN

    name = "keep-out-capsule"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, start=point, end=point, radius=length, reference_point=point)

    def shape(self) -> Capsule:
        return Capsule("keep-out", self.start, self.end, self.radius)

    def residual(self, motion: Instant) -> Expression:
        """Distance to the capsule (m)."""
        axis = np.subtract(self.end, self.start)
        offset = motion.at(self.reference_point).position - ca.DM(list(self.start))
        square = float(axis @ axis)
        if square > 0:
            along = ca.dot(ca.DM(axis), offset) / square
            offset = offset - ca.fmax(0, ca.fmin(1, along)) * ca.DM(axis)
        return _clearance(offset, self.radius)


def _clearance(offset: Expression, radius: float) -> Expression:
    # Less what the rounding may add: the distance is never overestimated.
    return rounded_length(offset, radius) - (1 + ROUNDING) * radius
