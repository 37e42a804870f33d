"""A tool held at an angle: to a direction of the world, or to the surface it works on."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    body_axis,
    direction,
    number,
    point,
    safe_norm,
    settle,
    unit_vector,
)
from noslip.constraints.formula import Surface, checked_surface, surface_normal
from noslip.constraints.instant import Instant
from noslip.edge import Axis, axis_names, checked_axis, other_axes
from noslip.errors import ConstraintError
from noslip.rotations import quaternion_log

_PARALLEL = 1e-6
"""Angles (rad) this close to 0 or pi count as such; there, the angle has no one slope."""


_TOPPLE, _NARROW = 1e-5, 1e-8
"""By how much the axis is turned (rad) where it stands exactly the wrong way round, and the cosine
within which it is, a turn of 1e-4 rad: above rounding, also in single precision, and far below what
anyone sets an axis by."""


@register
@dataclass(frozen=True)
class ToolAxis(Constraint):
    """A body axis keeps its angle to a direction d: ``angle(R axis, d) = angle``.

    Holonomic, about the rotation; a glass carried upright, a torch at its work angle.  Along d
    (angle 0 or pi) that equation is degenerate, and two take its place: the two parts of the
    rotation vector that turns the axis into d, about the body axes e_1, e_2 perpendicular to it.
    Both residuals grow with the angle all the way to pi, so that a tool held the other way round is
    turned, by the shortest way; exactly the other way round, about a direction that is chosen.

    Parameters
    ----------
    axis : str or 3 numbers
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

    axis: Axis = "z"
    direction: Triple = (0.0, 0.0, 1.0)
    angle: float = 0.0
    surface: Surface | None = None
    reference_point: Triple = ORIGIN

    name = "tool-axis"
    level = "position"
    unit = "rad"

    def __post_init__(self) -> None:
        settle(
            self,
            self.name,
            axis=checked_axis,
            direction=direction,
            angle=_angle,
            reference_point=point,
        )
        if self.surface is not None:
            settle(self, self.name, surface=checked_surface)

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Of an axis that must point along the direction, the axes that it leans towards."""
        if not self._parallel:
            return ()
        return tuple(f"leaning to {axis}" for axis in axis_names(other_axes(self.axis)))

    @property
    def _parallel(self) -> bool:
        return min(self.angle, pi - self.angle) <= _PARALLEL

    def residual(self, motion: Instant) -> Expression:
        """Angle's two parts from the wanted direction, or its difference from the angle (rad)."""
        if self.surface is None:
            toward = unit_vector(self.direction)
        else:
            toward = surface_normal(self.surface, motion.at(self.reference_point).position)
        cosine, sine, aside = (
            ca.dot(body_axis(motion, e), toward) for e in (self.axis, *other_axes(self.axis))
        )
        parallel = self._parallel
        if parallel and self.angle > 1:
            cosine, sine, aside = -cosine, -sine, -aside
        # Where both sines vanish they name no direction; one is chosen.
        wrong = 1 + cosine if parallel else 1 - ca.fabs(cosine)
        turn = _TOPPLE * ca.exp(-wrong / _NARROW)
        less = turn**2 / 2
        cosine, sine = (1 - less) * cosine - turn * sine, (1 - less) * sine + turn * cosine
        if parallel:
            # The quaternion of the turn, but for its length: 1 + cos(a) : sin(a) is the half angle.
            return quaternion_log(ca.vertcat(ca.fmax(1 + cosine, 0), sine, aside, 0))[:2]
        return 2 * ca.atan2(safe_norm(ca.vertcat(sine, aside)), 1 + cosine) - self.angle


def _angle(name: str, value: Any) -> float:
    angle = number(name, value, "radians")
    if not 0 <= angle <= pi + _PARALLEL:
        raise ConstraintError(f"{name} must be 0 to pi radians, got {value!r}")
    return angle
