"""Where a moving frame is, and how fast it carries a point along, as numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.moving_frame import InMovingFrame


class Frame:
    """The frame of a constraint that moves, or of several one in the other.

    Parameters
    ----------
    constraint : InMovingFrame

    Attributes
    ----------
    inner : Constraint
        What holds in the frame; itself in none that moves.
    """

    def __init__(self, constraint: InMovingFrame) -> None:
        t, point = ca.SX.sym("t"), ca.SX.sym("p", 3)
        origin, turn = ca.SX.zeros(3), ca.SX.eye(3)
        inner: Constraint = constraint
        while isinstance(inner, InMovingFrame):
            c, R = inner.pose(t)
            origin, turn, inner = origin + ca.mtimes(turn, c), ca.mtimes(turn, R), inner.inner
        self.inner = inner
        turning = ca.reshape(ca.jacobian(ca.vec(turn), t), 3, 3)
        carried = ca.jacobian(origin, t) + ca.mtimes([turning, turn.T, point - origin])
        self._pose = ca.Function("pose", [t], [origin, turn])
        self._carried = ca.Function("carried", [t, point], [carried])

    def pose(self, time: float) -> tuple[Floats, Rotation]:
        """Origin (m), shape (3,), and rotation, frame to world, at a time (s)."""
        origin, turn = self._pose(time)
        return np.array(origin).ravel(), Rotation.from_matrix(np.array(turn))

    def carried(self, times: ArrayLike, points: ArrayLike) -> Floats:
        """Velocity (m/s) of the frame's own points that are at places in the world.

        Parameters
        ----------
        times : array, shape (N,)
        points : array, shape (N, 3)
            World frame (m).

        Returns
        -------
        array, shape (N, 3)
        """
        instants, places = np.atleast_1d(times), np.atleast_2d(points)
        found = self._carried.map(len(instants))(instants[None], places.T)
        return np.array(found).T
