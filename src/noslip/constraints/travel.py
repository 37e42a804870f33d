"""Which way the tool may travel: edge first, and not round too tight a bend.

All take ``barrier_rate`` and ``priority`` too, see :class:`noslip.constraints.limit.Limit`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip import _arguments
from noslip._typing import Expression
from noslip.constraints.declaration import register
from noslip.constraints.fields import (
    ORIGIN,
    Triple,
    body_axis,
    length,
    point,
    settle,
    settle_edge,
)
from noslip.constraints.instant import Instant
from noslip.constraints.limit import Limit
from noslip.edge import Axis, Edge, across, checked_axis

_KINK = 1e-3
"""Speed (m/s) below which the margin of a turning radius is rounded where a tool changes between
forwards and backwards: far below that of a motion, far above the change of speed in a step."""


@register
@dataclass(frozen=True)
class ForwardOnly(Limit):
    """``(R e_b) . v - s >= 0``: the edge leads; the tool never backs up.

    Parameters
    ----------
    edge : str or 3 numbers
        e_b, the body axis that leads; ``"-x"`` for a tool recorded backwards.
    minimum : float
        s (m/s), the least speed along the edge.  A motion that starts or ends at rest satisfies no
        minimum above 0 there.
    reference_point : 3 numbers
        The point of the tool that must not back up (m, body frame).
    """

    edge: Edge | Axis = "x"  # type: ignore[assignment]
    minimum: float = 0.0
    reference_point: Triple = ORIGIN

    name = "forward-only"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(self, self.name, minimum=_arguments.not_negative, reference_point=point)
        settle_edge(self, self.name, None)

    def residual(self, motion: Instant) -> Expression:
        """Speed along the edge, less the minimum (m/s)."""
        velocity = motion.at(self.reference_point).linear_velocity
        return ca.dot(body_axis(motion, _travel(self)), velocity) - self.minimum


@register
@dataclass(frozen=True)
class TurningRadius(Limit):
    """``v_f - r |w_u| >= 0``: the tool's path bends no tighter than a radius, as a car's (Dubins).

    With the forward speed ``v_f = (R e_b) . v`` and the turning rate ``w_u = (R u_b) . w``, the
    path's radius is ``v_f / |w_u|``.  Two rows that are linear in the velocities say the same
    without the kink: ``v_f - r w_u >= 0`` and ``v_f + r w_u >= 0``.  Their sum is ``2 v_f >= 0``:
    the tool moves forward only, and does not turn on the spot.

    Of a tool that may back up, as a car may (Reeds and Shepp 1990), it is ``|v_f| - r |w_u| >= 0``,
    in one row without kinks: ``sqrt(v_f^2 + e^2) - sqrt(r^2 w_u^2 + e^2)`` has the same sign, for
    any speed e.

    Parameters
    ----------
    radius : float
        r (m).
    edge : str or 3 numbers
        e_b, the body axis that leads.
    up : str or 3 numbers
        u_b, the body axis about which the tool turns into the bend: its part perpendicular to
        the edge.
    reference_point : 3 numbers
        The point of the tool whose path it is (m, body frame).
    reverse : bool
        Whether the tool may back up.
    """

    radius: float = 0.05
    edge: Edge | Axis = "x"  # type: ignore[assignment]
    up: Axis = "z"
    reference_point: Triple = ORIGIN
    reverse: bool = False

    name = "turning-radius"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(
            self,
            self.name,
            radius=length,
            up=checked_axis,
            reference_point=point,
            reverse=_arguments.flag,
        )
        settle_edge(self, self.name, None)
        across(self.up, _travel(self), "turning-radius: up and edge")

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Bends to either side; in one row, if it may reverse."""
        return () if self.reverse else ("to the left", "to the right")

    def residual(self, motion: Instant) -> Expression:
        """Speed beyond what bends to the left, and to the right, need (m/s)."""
        velocity = motion.at(self.reference_point).linear_velocity
        forward = ca.dot(body_axis(motion, _travel(self)), velocity)
        turning = ca.dot(body_axis(motion, across(self.up, _travel(self))), motion.angular_velocity)
        if self.reverse:
            return ca.sqrt(forward**2 + _KINK**2) - ca.sqrt((self.radius * turning) ** 2 + _KINK**2)
        return [forward - self.radius * turning, forward + self.radius * turning]


def _travel(limit: Limit) -> Axis:
    assert limit.edge is not None
    return limit.edge.travel
