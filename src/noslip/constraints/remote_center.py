"""A shaft through a fixed point: the remote center of motion of keyhole surgery."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import ORIGIN, Triple, body_axis, point, settle
from noslip.constraints.instant import Instant
from noslip.constraints.shape import Mark
from noslip.edge import Axis, axis_names, checked_axis, other_axes


@register
@dataclass(frozen=True)
class RemoteCenter(Constraint):
    """The shaft's line passes through a point: ``(R e_1) . (c - p) = (R e_2) . (c - p) = 0``.

    Holonomic: the trocar constraint of laparoscopic robots, whose instruments pivot about the
    incision and slide through it.  e_1, e_2 are the body axes perpendicular to the shaft.

    Parameters
    ----------
    point : 3 numbers
        c, the incision, m, world frame.
    shaft : str or 3 numbers
        The body axis along the shaft.
    reference_point : 3 numbers
        p, any point of the shaft's line, m, body frame.
    """

    point: Triple = ORIGIN
    shaft: Axis = "z"
    reference_point: Triple = ORIGIN

    name = "remote-center"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, point=point, shaft=checked_axis, reference_point=point)

    def shape(self) -> Mark:
        return Mark(self.point)

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Along the axes across the shaft."""
        return tuple(f"aside {axis}" for axis in axis_names(other_axes(self.shaft)))

    def residual(self, motion: Instant) -> Expression:
        """Where the point lies beside the shaft (m), along both perpendicular body axes."""
        away = ca.DM(list(self.point)) - motion.at(self.reference_point).position
        return ca.vertcat(*(ca.dot(body_axis(motion, e), away) for e in other_axes(self.shaft)))
