"""Chunks of actions, each joined to what was executed of the one before."""

from __future__ import annotations

from typing import Any

from noslip.constraints.system import ConstraintSystem
from noslip.errors import NoslipError
from noslip.runtime.motion import Motion
from noslip.trajectory import PoseTrajectory


class Chunks:
    """Projects chunk after chunk."""

    def __init__(self, system: ConstraintSystem, period: float) -> None:
        self.system, self.period = system, period

    def reset(self, pose: Any) -> None:
        """Begin anew from a pose, at rest."""

    def next(self, poses: PoseTrajectory, executed: int | None = None) -> Motion:
        """Project a chunk."""
        raise NoslipError("not yet")
