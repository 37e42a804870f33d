"""A needle or catheter follows its shaft: no sideways motion, and a beveled tip bends the path."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    axis,
    body_axis,
    number,
    other_axes,
    point,
    settle,
)
from noslip.constraints.instant import Instant
from noslip.edge import AXES, Edge, axis_index
from noslip.errors import ConstraintError


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
    shaft : str
        The body axis along which the needle advances; it may carry a sign, as in ``"-x"``.
    curvature : float or None
        kappa (1/m): the path's turning about the bevel axis, by the right-hand rule, per meter
        forward.  0 or None leaves the rotation free: a straight shaft that is turned from outside,
        two rows.  Otherwise four.
    bevel : str
        The body axis about which the tip turns, perpendicular to the shaft; of a straight needle,
        it only gives the rows their order.
    reference_point : 3 numbers
        The tip, m, body frame.
    """

    shaft: str = "x"
    curvature: float | None = 0.0
    bevel: str = "z"
    reference_point: Triple = ORIGIN

    name = "needle"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(self, self.name, shaft=axis, curvature=_curvature, bevel=axis, reference_point=point)
        shaft, bevel = axis_index(self.shaft)[0], axis_index(self.bevel)[0]
        if shaft == bevel:
            raise ConstraintError(
                f"needle: bevel must be perpendicular to the shaft {self.shaft!r}, "
                f"got {self.bevel!r}"
            )
        # The shaft leads, and the path bends to the side that is perpendicular to the bevel axis.
        lateral = AXES[3 - shaft - bevel]
        object.__setattr__(self, "edge", Edge(self.shaft, lateral, self.reference_point))
        if self.curvature:
            object.__setattr__(self, "unit", "m/s, rad/s")

    def residual(self, motion: Instant) -> Expression:
        """Both lateral speeds (m/s); of a curved one, two angular speeds (rad/s) too."""
        velocity = motion.at(self.reference_point).linear_velocity
        sideways = [body_axis(motion, name) for name in other_axes(self.shaft)]
        rows = [ca.dot(axis, velocity) for axis in sideways]
        if self.curvature:
            forward = ca.dot(body_axis(motion, self.shaft), velocity)
            turn = self.curvature * forward * body_axis(motion, self.bevel)
            rows += [ca.dot(axis, motion.angular_velocity - turn) for axis in sideways]
        return ca.vertcat(*rows)


def _curvature(name: str, value: float | None) -> float:
    return 0.0 if value is None else number(name, value, "1/m")
