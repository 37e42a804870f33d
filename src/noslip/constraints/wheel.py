"""A wheel rolls along its plane: no slip along the axle, no lifting off the ground."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import SIDEWAYS, Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    body_axis,
    direction,
    point,
    settle,
    settle_edge,
    unit_vector,
)
from noslip.constraints.instant import Instant
from noslip.edge import Axis, Edge, checked_axis


@register
@dataclass(frozen=True)
class Wheel(Constraint):
    """A wheel, a unicycle, a differential drive: ``(R axle) . v = 0`` and ``n . v = 0``.

    The frame is that of the vehicle or the fork, which does not spin with the wheel; for the disc
    itself see :class:`noslip.constraints.RollingDisc`.  The first row is non-holonomic and the
    standard model of mobile robots; the second keeps the height above the ground.

    Parameters
    ----------
    axle : str or 3 numbers
        The body axis along the axle, which must not move along itself.
    edge : str or 3 numbers
        The body axis that leads, as for :class:`noslip.Blade`; ``"-x"`` for a vehicle in reverse.
    normal : 3 numbers or None
        Of the ground, world frame, any length; None leaves the height free (one row).
    reference_point : 3 numbers
        A point of the axle, m, body frame.
    """

    axle: Axis = "y"
    edge: Edge | Axis = "x"  # type: ignore[assignment]
    normal: Triple | None = (0.0, 0.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "wheel"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(self, self.name, axle=checked_axis, reference_point=point)
        if self.normal is not None:
            settle(self, self.name, normal=direction)
        settle_edge(self, self.name, self.axle, "the axle and the edge")

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Along the axle; off the ground."""
        return (SIDEWAYS,) if self.normal is None else (SIDEWAYS, "vertical")

    def residual(self, motion: Instant) -> Expression:
        """Speed along the axle, and off the ground (m/s)."""
        velocity = motion.at(self.reference_point).linear_velocity
        slip = ca.dot(body_axis(motion, self.axle), velocity)
        if self.normal is None:
            return slip
        return ca.vertcat(slip, ca.dot(unit_vector(self.normal), velocity))
