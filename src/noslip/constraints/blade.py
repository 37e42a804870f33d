"""A blade moves along its edge and may plunge, but never slides sideways."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import ORIGIN, Triple, body_axis, point, settle, settle_edge
from noslip.constraints.instant import Instant
from noslip.edge import Axis, Edge, checked_axis


@register
@dataclass(frozen=True)
class Blade(Constraint):
    """The paper's constraint ``(R y_b) . dp/dt = 0`` (eq. 16): no velocity across the blade.

    Non-holonomic: it forbids a direction of motion, not a place.

    Parameters
    ----------
    lateral : str or 3 numbers
        The body axis across the blade, which must not move: ``"y"``, or a direction in the body's
        frame such as ``(0.02, 1, 0)``.
    edge : str or 3 numbers
        The body axis that leads the cut; ``"-x"`` for a tool recorded backwards.  Its part
        perpendicular to the lateral axis counts.  The constraint itself does not depend on it: it
        tells which of the two ways round the blade faces.
    reference_point : 3 numbers
        The point of the tool that must not slip, m, body frame; the blade's own turning moves every
        other one sideways.
    """

    lateral: Axis = "y"
    edge: Edge | Axis = "x"  # type: ignore[assignment]
    reference_point: Triple = ORIGIN

    name = "blade"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(self, self.name, lateral=checked_axis, reference_point=point)
        settle_edge(self, self.name, self.lateral, "the lateral axis and the edge")

    def residual(self, motion: Instant) -> Expression:
        """Lateral speed of the reference point (m/s)."""
        velocity = motion.at(self.reference_point).linear_velocity
        return ca.dot(body_axis(motion, self.lateral), velocity)
