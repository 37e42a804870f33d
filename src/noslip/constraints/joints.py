"""Within which bounds joints, or any other coordinates, stay, move and accelerate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Expression
from noslip.chain import Chain
from noslip.constraints.declaration import Level, register
from noslip.constraints.instant import Coordinates
from noslip.constraints.limit import Limit
from noslip.errors import ConstraintError
from noslip.space import Space

_PER: dict[Level, str] = {"position": "", "velocity": "/s", "acceleration": "/s²"}
_QUANTITY: dict[Level, str] = {
    "position": "values",
    "velocity": "rates",
    "acceleration": "accelerations",
}


@register
@dataclass(frozen=True)
class JointLimits(Limit):
    """``min(x - l, u - x) >= 0``: bounds of coordinates, of their rates or of their accelerations.

    A row for each coordinate that has a bound.  Without any they are those of the robot whose
    joints move; :func:`joint_limits` makes all of a robot.

    Parameters
    ----------
    lower, upper : sequences of n numbers
        l and u of each coordinate, in its unit; None or infinite where there is none.
    level : "position", "velocity" or "acceleration"
        Of what they are bounds: of the coordinates x, of dx/dt or of the acceleration of each step.
    units : sequence of n str
        Of the coordinates themselves; rad by default.
    """

    lower: Sequence[float | None] = ()
    upper: Sequence[float | None] = ()
    level: Level = "position"
    units: Sequence[str] = ()

    known_as = "joint-limits"

    def __post_init__(self) -> None:
        if self.level not in _PER:
            raise ConstraintError(f"joint-limits: level is {', '.join(_PER)}; got {self.level!r}")
        lower, upper = (_bounds(side, getattr(self, side)) for side in ("lower", "upper"))
        units = tuple(self.units) or ("rad",) * len(lower)
        if not len(lower) == len(upper) == len(units):
            raise ConstraintError(
                f"joint-limits: {len(lower)} lower bounds, {len(upper)} upper ones and "
                f"{len(units)} units; give one of each a coordinate"
            )
        for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
            if low is not None and high is not None and low >= high:
                raise ConstraintError(
                    f"joint-limits: lower[{k}] must be less than upper[{k}], got {low:g} and "
                    f"{high:g}"
                )
        for name, value in {"lower": lower, "upper": upper, "units": units}.items():
            object.__setattr__(self, name, value)
        if lower and not self._bounded:
            raise ConstraintError("joint-limits: no bound is finite; give at least one")

    @property
    def name(self) -> str:  # type: ignore[override]
        """What reports call it by."""
        return f"joint {self.level} limits"

    @property
    def coordinates(self) -> int:  # type: ignore[override]
        """How many coordinates they are declared of."""
        return len(self.lower)

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Of the rows, in their order; one, if all are the same."""
        found = [f"{self.units[k]}{_PER[self.level]}" for k in self._bounded]
        return found[0] if len(set(found)) == 1 else ", ".join(found)

    def in_space(self, space: Space) -> JointLimits:
        """Return them with the bounds of a space's robot, if they have none of their own."""
        if self.lower:
            return self
        if space.carrier is None:
            raise ConstraintError(
                "joint-limits: of which robot? read its joints with robot=... (--robot NAME "
                "--values), or give lower=... and upper=..., a number or None a coordinate"
            )
        for limits in joint_limits(space.carrier):
            if limits.level == self.level:
                return replace(limits, barrier_rate=self.barrier_rate, priority=self.priority)
        raise ConstraintError(
            f"joint-limits: {space.carrier.name} has no {self.level} limits; give lower=... and "
            "upper=..."
        )

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Of the coordinates that have a bound, by their place, from 1."""
        return tuple(f"joint {k + 1}" for k in self._bounded)

    @property
    def _bounded(self) -> list[int]:
        """Which coordinates have a bound: a row each."""
        sides = enumerate(zip(self.lower, self.upper, strict=True))
        return [k for k, (low, high) in sides if low is not None or high is not None]

    def residual(self, motion: Coordinates) -> Expression:  # type: ignore[override]
        """What is left to the nearer bound, in the coordinate's unit (over s or s^2)."""
        x, rows = getattr(motion, _QUANTITY[self.level]), []
        for k in self._bounded:
            low, high = self.lower[k], self.upper[k]
            left = [] if low is None else [x[k] - low]
            left += [] if high is None else [high - x[k]]
            # Two rows would take four times as long to build a step of.
            rows.append(ca.fmin(*left) if len(left) == 2 else left[0])
        return rows


def joint_limits(chain: Chain, *, priority: int = 0) -> list[JointLimits]:
    """Return the limits of a chain's joints: positions, velocities and accelerations.

    What the chain does not know is left out.
    """
    velocity, acceleration = chain.velocity_limits, chain.acceleration_limits
    sides: list[tuple[Level, Any, Any]] = [
        ("position", chain.lower, chain.upper),
        ("velocity", -velocity, velocity),
        ("acceleration", -acceleration, acceleration),
    ]
    return [
        JointLimits(lower.tolist(), upper.tolist(), level, chain.units, priority=priority)
        for level, lower, upper in sides
        if np.abs([lower, upper]).min() < _arguments.LARGEST
    ]


def _bounds(side: str, values: Any) -> tuple[float | None, ...]:
    """Return bounds as numbers; None where there is none, or it is beyond all that moves."""
    try:
        found = [None if value is None else _arguments.number(value) for value in values]
    except TypeError:
        found = [float("nan")]
    if any(value != value for value in found):
        raise ConstraintError(
            f"joint-limits: {side} must be a number or None a coordinate, got "
            f"{_arguments.short(values)}"
        )
    return tuple(
        None if value is None or abs(value) >= _arguments.LARGEST else value for value in found
    )
