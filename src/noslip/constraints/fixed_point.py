"""A point of the tool that stays where it is: a ball joint, a hinge, a tip that pivots."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import ORIGIN, Triple, point, settle
from noslip.constraints.instant import Instant
from noslip.constraints.shape import Mark


@register
@dataclass(frozen=True)
class FixedPoint(Constraint):
    """The reference point stays at a point of the world: ``p - point = 0``; a ball joint.

    Holonomic; with :class:`noslip.constraints.ToolAxis` along the hinge's axis, a hinge.

    Parameters
    ----------
    point : 3 numbers
        m, world frame.
    reference_point : 3 numbers
        p, what stays there, m, body frame.
    """

    point: Triple = ORIGIN
    reference_point: Triple = ORIGIN

    name = "fixed-point"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, point=point, reference_point=point)

    row_names = ("x", "y", "z")

    def shape(self) -> Mark:
        return Mark(self.point)

    def residual(self, motion: Instant) -> Expression:
        """How far the reference point is away (m), along the world's axes."""
        return motion.at(self.reference_point).position - ca.DM(list(self.point))
