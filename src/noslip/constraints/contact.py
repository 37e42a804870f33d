"""A point of the tool stays on a surface: plane, sphere, cylinder, or one given by a formula."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    direction,
    length,
    point,
    safe_norm,
    settle,
    unit_vector,
)
from noslip.constraints.formula import Surface, checked_surface, surface_value
from noslip.constraints.instant import Instant
from noslip.constraints.shape import Ball, Implicit, Plane, Tube
from noslip.errors import ConstraintError


@register
@dataclass(frozen=True)
class PlaneContact(Constraint):
    """The reference point stays on a plane: ``n . (p - point) = 0``; polishing a table.

    Parameters
    ----------
    point : 3 numbers
        Any point of the plane, m, world frame.
    normal : 3 numbers
        World frame, any length; the residual is positive on its side.
    reference_point : 3 numbers
        What touches the plane, m, body frame.
    """

    point: Triple = ORIGIN
    normal: Triple = (0.0, 0.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "plane-contact"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, point=point, normal=direction, reference_point=point)

    def shape(self) -> Plane:
        return Plane("contact", self.point, self.normal)

    def residual(self, motion: Instant) -> Expression:
        """Signed distance (m)."""
        return ca.dot(unit_vector(self.normal), _from(self.point, self.reference_point, motion))


@register
@dataclass(frozen=True)
class SphereContact(Constraint):
    """The reference point stays on a sphere: ``|p - center| - radius = 0``.

    Parameters
    ----------
    center : 3 numbers
        m, world frame.
    radius : float
        m.
    reference_point : 3 numbers
        What touches the sphere, m, body frame.
    """

    center: Triple = ORIGIN
    radius: float = 0.1
    reference_point: Triple = ORIGIN

    name = "sphere-contact"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, center=point, radius=length, reference_point=point)

    def shape(self) -> Ball:
        return Ball("contact", self.center, self.radius)

    def residual(self, motion: Instant) -> Expression:
        """Signed distance, positive outside (m)."""
        return safe_norm(_from(self.center, self.reference_point, motion)) - self.radius


@register
@dataclass(frozen=True)
class CylinderContact(Constraint):
    """The reference point stays on an endless cylinder: its distance from the axis is ``radius``.

    Parameters
    ----------
    point : 3 numbers
        Any point of the cylinder's axis, m, world frame.
    axis : 3 numbers
        The axis' direction, world frame, any length.
    radius : float
        m.
    reference_point : 3 numbers
        What touches the cylinder, m, body frame.
    """

    point: Triple = ORIGIN
    axis: Triple = (0.0, 0.0, 1.0)
    radius: float = 0.1
    reference_point: Triple = ORIGIN

    name = "cylinder-contact"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, point=point, axis=direction, radius=length, reference_point=point)

    def shape(self) -> Tube:
        return Tube("contact", self.point, self.axis, self.radius)

    def residual(self, motion: Instant) -> Expression:
        """Signed distance, positive outside (m)."""
        axis = unit_vector(self.axis)
        away = _from(self.point, self.reference_point, motion)
        return safe_norm(away - ca.dot(axis, away) * axis) - self.radius


@register
@dataclass(frozen=True)
class SurfaceContact(Constraint):
    """The reference point stays on an implicit surface: ``f(p) = 0``.

    Parameters
    ----------
    surface : str or callable
        f as text in x, y, z (m, world frame) such as ``"z - 0.1*x**2"``, with ``+ - * / **``,
        numbers, pi, and abs, cos, exp, log, sin, sqrt, tan; nothing in it is evaluated as code.  Or
        a function that takes the position, a CasADi expression of shape (3,), and returns a
        number's expression.
    unit : str
        Of f.  The residual is f itself; it is a distance only if ``|grad f| = 1``.
    reference_point : 3 numbers
        What touches the surface, m, body frame.
    """

    surface: Surface = "z"
    unit: str = "m"
    reference_point: Triple = ORIGIN

    name = "surface-contact"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, surface=checked_surface, unit=_unit, reference_point=point)

    def shape(self) -> Implicit:
        return Implicit("contact", self.surface)

    def residual(self, motion: Instant) -> Expression:
        """What f is at the reference point, in its own unit."""
        return surface_value(self.surface, motion.at(self.reference_point).position)


def _from(place: Triple, reference_point: Triple, motion: Instant) -> Expression:
    return motion.at(reference_point).position - ca.DM(list(place))


def _unit(name: str, value: str) -> str:
    if not isinstance(value, str) or not value.isprintable():
        raise ConstraintError(f"{name} must be text, such as 'm', got {value!r}")
    return value
