"""A needle or catheter follows its shaft: no sideways motion, and a beveled tip bends the path."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    body_axis,
    number,
    point,
    settle,
)
from noslip.constraints.instant import Instant
from noslip.edge import Axis, Edge, across, axis_names, checked_axis, other_axes, unit_axis


@register
@dataclass(frozen=True)
class Needle(Constraint):
    """A needle in tissue moves along its shaft: ``(R e_1) . v = (R e_2) . v = 0``.

    A needle with a beveled tip also turns as it is pushed: its path has the curvature ``kappa``
    (the unicycle model of Webster et al., "Nonholonomic modeling of needle steering", 2006):

        ``w . R e_1 = 0``,    ``w . R bevel = kappa v . R shaft``

    with ``e_1`` the axis perpendicular to both.  Roll about the shaft, which steers it, is free.

    Parameters
    ----------
    shaft : str or 3 numbers
        The body axis along which the needle advances; it may carry a sign, as in ``"-x"``.
    curvature : float or None
        kappa (1/m): the path's turning about the bevel axis, by the right-hand rule, per meter
        forward.  0 or None leaves the rotation free: a straight shaft that is turned from outside,
        two rows.  Otherwise four.
    bevel : str or 3 numbers
        The body axis about which the tip turns: its part perpendicular to the shaft.  Of a straight
        needle it says nothing but which way the shaft's third axis points.
    reference_point : 3 numbers
        The tip, m, body frame.
    """

    shaft: Axis = "x"
    curvature: float | None = 0.0
    bevel: Axis = "z"
    reference_point: Triple = ORIGIN

    name = "needle"
    level = "velocity"

    def __post_init__(self) -> None:
        axes = {"shaft": checked_axis, "bevel": checked_axis}
        settle(self, self.name, curvature=_curvature, reference_point=point, **axes)
        # The shaft leads, and the path bends to the side that is perpendicular to the bevel axis.
        bevel = across(self.bevel, self.shaft, "needle: bevel and shaft")
        lateral = np.cross(unit_axis(self.shaft), bevel)
        lateral *= np.sign(lateral[np.argmax(np.abs(lateral))])
        object.__setattr__(self, "edge", Edge(self.shaft, lateral, self.reference_point))
        if self.curvature:
            object.__setattr__(self, "unit", "m/s, rad/s")

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Along and, of a curved one, about the axes across the shaft."""
        across_shaft = axis_names(other_axes(self.shaft))
        kinds = ("sideways", "turning about") if self.curvature else ("sideways",)
        return tuple(f"{kind} {axis}" for kind in kinds for axis in across_shaft)

    def residual(self, motion: Instant) -> Expression:
        """Both lateral speeds (m/s); of a curved one, two angular speeds (rad/s) too."""
        velocity = motion.at(self.reference_point).linear_velocity
        sideways = [body_axis(motion, axis) for axis in other_axes(self.shaft)]
        rows = [ca.dot(axis, velocity) for axis in sideways]
        if self.curvature:
            forward = ca.dot(body_axis(motion, self.shaft), velocity)
            turn = self.curvature * forward * body_axis(motion, across(self.bevel, self.shaft))
            rows += [ca.dot(axis, motion.angular_velocity - turn) for axis in sideways]
        return ca.vertcat(*rows)


def _curvature(name: str, value: float | None) -> float:
    return 0.0 if value is None else number(name, value, "1/m")
