"""Where a moving frame is, and how fast it carries a point along, as numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.moving_frame import InMovingFrame


class Frame:
    """The frame of a constraint that moves, or of several one in the other.

    ``inner`` is what holds in the frame, itself in none that moves.
    """

    def __init__(self, constraint: InMovingFrame) -> None:
        t = ca.SX.sym("t")
        origin, turn = ca.SX.zeros(3), ca.SX.eye(3)
        inner: Constraint = constraint
        while isinstance(inner, InMovingFrame):
            c, R = inner.pose(t)
            origin, turn, inner = origin + ca.mtimes(turn, c), ca.mtimes(turn, R), inner.inner
        self.inner = inner
        self._pose = ca.Function("pose", [t], [origin, turn])

    def pose(self, time: float) -> tuple[Floats, Rotation]:
        """Origin (m), shape (3,), and rotation, frame to world, at a time (s)."""
        origin, turn = self._pose(time)
        return np.array(origin).ravel(), Rotation.from_matrix(np.array(turn))
