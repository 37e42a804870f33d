"""Discs and spheres that roll without slipping: the material point at the contact is at rest."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    body_axis,
    direction,
    length,
    point,
    safe_norm,
    settle,
    unit_vector,
)
from noslip.constraints.instant import Instant
from noslip.edge import Axis, checked_axis


@register
@dataclass(frozen=True)
class RollingDisc(Constraint):
    """A thin disc that rolls on a plane: ``v + w x (-radius u) = 0`` at its lowest point.

    ``u = (n - (n.a) a) / |n - (n.a) a|`` is the direction within the disc that rises most steeply,
    a its axle.  Upright, it is the rolling penny; leaning, Euler's disc.  Pizza cutters and rotary
    knives roll so.  Two rows forbid slipping, the third lifting off.  Lying flat, a disc has no
    lowest point.

    Parameters
    ----------
    radius : float
        m.
    axle : str or 3 numbers
        The body axis about which the disc is round.
    normal : 3 numbers
        Of the plane, away from it towards the disc, world frame, any length.
    reference_point : 3 numbers
        The disc's center, m, body frame.
    """

    radius: float = 0.1
    axle: Axis = "y"
    normal: Triple = (0.0, 0.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "rolling-disc"
    level = "velocity"
    row_names = ("along x", "along y", "along z")

    def __post_init__(self) -> None:
        settle(
            self,
            self.name,
            radius=length,
            axle=checked_axis,
            normal=direction,
            reference_point=point,
        )

    def residual(self, motion: Instant) -> Expression:
        """Velocity of the disc's lowest point (m/s), world frame."""
        normal, axle = unit_vector(self.normal), body_axis(motion, self.axle)
        upward = normal - ca.dot(normal, axle) * axle
        return _contact_velocity(
            motion.at(self.reference_point), self.radius * upward / safe_norm(upward)
        )


@register
@dataclass(frozen=True)
class RollingSphere(Constraint):
    """A ball that rolls on a plane: ``v + w x (-radius n) = 0`` at its contact.

    The plate-and-ball system; spinning about the normal is free.

    Parameters
    ----------
    radius : float
        m.
    normal : 3 numbers
        Of the plane, away from it towards the ball, world frame, any length.
    reference_point : 3 numbers
        The ball's center, m, body frame.
    """

    radius: float = 0.1
    normal: Triple = (0.0, 0.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "rolling-sphere"
    level = "velocity"
    row_names = ("along x", "along y", "along z")

    def __post_init__(self) -> None:
        settle(self, self.name, radius=length, normal=direction, reference_point=point)

    def residual(self, motion: Instant) -> Expression:
        """Velocity of the material point at the contact (m/s), world frame."""
        return _contact_velocity(
            motion.at(self.reference_point), self.radius * unit_vector(self.normal)
        )


def _contact_velocity(center: Instant, above: Expression) -> Expression:
    """Velocity of the point of the body that lies below its center."""
    return center.linear_velocity - ca.cross(center.angular_velocity, above)
