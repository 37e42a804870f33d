"""One pose after another, as a stream."""

from __future__ import annotations

from typing import Any

from noslip.constraints.system import ConstraintSystem
from noslip.errors import NoslipError
from noslip.projection.metric import Metric
from noslip.runtime.state import State


class Follower:
    """Follows commands under constraints."""

    def __init__(self, system: ConstraintSystem, period: float, metric: Metric) -> None:
        self.system, self.period, self.metric = system, period, metric

    def reset(self, pose: Any) -> None:
        """Begin anew from a pose, at rest."""

    def step(self, command: Any, measured: Any = None) -> State:
        """Go on by a period."""
        raise NoslipError("not yet")
