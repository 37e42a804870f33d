"""How fast the tool may move, turn and accelerate.

All take ``barrier_rate`` and ``priority`` too, see :class:`noslip.constraints.limit.Limit`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from noslip import _arguments
from noslip._typing import Expression
from noslip.constraints.declaration import UNITS, register
from noslip.constraints.fields import ORIGIN, Triple, point, settle
from noslip.constraints.instant import AcceleratedInstant, Instant
from noslip.constraints.limit import Limit, rounded_length
from noslip.errors import ConstraintError


@register
@dataclass(frozen=True)
class SpeedLimit(Limit):
    """``s - |v| >= 0``: the tool moves no faster than a speed, in whatever direction.

    Parameters
    ----------
    speed : float
        s (m/s).
    reference_point : 3 numbers
        The point of the tool whose speed it is: one away from the frame's origin also moves as the
        tool turns (m, body frame).
    """

    speed: float = 0.1
    reference_point: Triple = ORIGIN

    name = "speed-limit"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(self, self.name, speed=_arguments.positive, reference_point=point)

    @property
    def radii(self) -> tuple[float, ...]:  # type: ignore[override]
        return (self.speed,)

    def residual(self, motion: Instant) -> Expression:
        """How much faster the tool may move (m/s)."""
        velocity = motion.at(self.reference_point).linear_velocity
        return self.speed - rounded_length(velocity, self.speed)


@register
@dataclass(frozen=True)
class AngularRateLimit(Limit):
    """``r - |w| >= 0``: the tool turns no faster than a rate, about whatever axis.

    Parameters
    ----------
    rate : float
        r (rad/s).
    """

    rate: float = 1.0

    name = "angular-rate-limit"
    level = "velocity"
    unit = "rad/s"

    def __post_init__(self) -> None:
        settle(self, self.name, rate=_arguments.positive)

    @property
    def radii(self) -> tuple[float, ...]:  # type: ignore[override]
        return (self.rate,)

    def residual(self, motion: Instant) -> Expression:
        """How much faster the tool may turn (rad/s)."""
        return self.rate - rounded_length(motion.angular_velocity, self.rate)


@register
@dataclass(frozen=True)
class AccelerationLimit(Limit):
    """``l - |a| >= 0`` and ``m - |alpha| >= 0``: bounds on the acceleration of each step.

    Of the tool's frame, not of another point of the tool.

    Parameters
    ----------
    linear : float or None
        l (m/s^2); None leaves that row out.
    angular : float or None
        m (rad/s^2); None leaves that row out.
    """

    linear: float | None = 1.0
    angular: float | None = None

    name = "acceleration-limit"
    level = "acceleration"

    def __post_init__(self) -> None:
        settle(self, self.name, linear=_positive_or_none, angular=_positive_or_none)
        if self.linear is None and self.angular is None:
            raise ConstraintError(
                "acceleration-limit: linear and angular are both None; give at least one"
            )

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Of the rows, in their order."""
        linear = [] if self.linear is None else [UNITS["acceleration"]]
        angular = [] if self.angular is None else ["rad/s²"]
        return ", ".join(linear + angular)

    @property
    def radii(self) -> tuple[float, ...]:  # type: ignore[override]
        return tuple(each for each in (self.linear, self.angular) if each is not None)

    def residual(self, motion: Instant) -> Expression:
        """How much larger the accelerations may be (m/s^2, rad/s^2)."""
        assert isinstance(motion, AcceleratedInstant)  # as its level says
        rows = []
        if self.linear is not None:
            rows.append(self.linear - rounded_length(motion.linear_acceleration, self.linear))
        if self.angular is not None:
            rows.append(self.angular - rounded_length(motion.angular_acceleration, self.angular))
        return rows


def _positive_or_none(name: str, value: Any) -> float | None:
    return None if value is None else _arguments.positive(name, value)
