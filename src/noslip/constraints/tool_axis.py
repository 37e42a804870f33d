"""A tool held at an angle: to a direction of the world, or to the surface it works on."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi
from typing import Any

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    axis,
    body_axis,
    direction,
    number,
    other_axes,
    point,
    settle,
    unit_vector,
)
from noslip.constraints.formula import Surface, checked_surface, surface_normal
from noslip.constraints.instant import Instant
from noslip.errors import ConstraintError

_PARALLEL = 1e-6
"""Angles (rad) this close to 0 or pi count as such; there, the cosine says nothing."""


@register
@dataclass(frozen=True)
class ToolAxis(Constraint):
    """A body axis keeps its angle to a direction d: ``d . (R axis) = cos(angle)``.

    Holonomic, about the rotation; a glass carried upright, a torch at its work angle.  Along d
    (angle 0 or pi) that equation is degenerate, and two take its place: ``(R e_1) . d =
    (R e_2) . d = 0`` with e_1, e_2 the body axes perpendicular to the axis.  They hold for a tool
    the other way round as well; it stays the way round it starts.

    Parameters
    ----------
    axis : str
        The body axis.
    direction : 3 numbers
        d, world frame, any length.
    angle : float
        Radians, 0 to pi.
    surface : str or callable, optional
        f of an implicit surface, as for :class:`noslip.constraints.SurfaceContact`.  d is then its
        normal ``grad f / |grad f|`` at the reference point: the stand-off angle to a surface.
    reference_point : 3 numbers
        Where the surface's normal is taken, m, body frame.
    """

    axis: str = "z"
    direction: Triple = (0.0, 0.0, 1.0)
    angle: float = 0.0
    surface: Surface | None = None
    reference_point: Triple = ORIGIN

    name = "tool-axis"
    level = "position"
    unit = "1"

    def __post_init__(self) -> None:
        settle(self, self.name, axis=axis, direction=direction, angle=_angle, reference_point=point)
        if self.surface is not None:
            settle(self, self.name, surface=checked_surface)

    def residual(self, motion: Instant) -> Expression:
        """Sines of the angle's two parts, or the difference of the cosines; no unit."""
        if self.surface is None:
            toward = unit_vector(self.direction)
        else:
            toward = surface_normal(self.surface, motion.at(self.reference_point).position)
        if min(self.angle, pi - self.angle) <= _PARALLEL:
            return ca.vertcat(
                *(ca.dot(body_axis(motion, e), toward) for e in other_axes(self.axis))
            )
        return ca.dot(body_axis(motion, self.axis), toward) - cos(self.angle)


def _angle(name: str, value: Any) -> float:
    angle = number(name, value, "radians")
    if not 0 <= angle <= pi + _PARALLEL:
        raise ConstraintError(f"{name} must be 0 to pi radians, got {value!r}")
    return angle
