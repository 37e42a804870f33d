"""Steering: the turn with which a tool that must not slip comes back onto its path.

Off its path by e, a tool should move with the velocity ``v + k e``.  A constraint on velocities
forbids part of that; turned by delta it would allow it,

    ``phi(p, Exp(delta) R, v + k e) = 0``,   to first order   ``A_R delta + A_v k e = 0``

and the least such turn, damped where the tool is too slow for a turn to help, is

    ``delta = - A_R^T (A_R A_R^T + mu 1)^-1 A_v k e``.

For a blade or a wheel in the plane this is the line-of-sight guidance of a car: steer towards a
point ahead on the path.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from noslip.constraints.system import ConstraintSystem
from noslip.rotations import quaternion_exp, quaternion_product

Floats = NDArray[np.float64]

SLOW = 0.1
"""Speed, over the mean speed of the motion, below which a turn is not relied upon."""
LARGEST_TURN = 0.5
"""rad; the linearisation holds for little more."""


class Steering:
    """Turns that lead a tool back onto its path.

    Parameters
    ----------
    system : ConstraintSystem
        Only its velocity-level equalities steer.
    speed : float
        Mean speed of the motion (m/s).
    """

    def __init__(self, system: ConstraintSystem, speed: float) -> None:
        equalities = system.equalities
        rows = [i for i, is_velocity in enumerate(equalities.row_is_velocity) if is_velocity]
        self._function: ca.Function | None = None
        if not rows or speed <= 0:
            return
        t, p, q = ca.SX.sym("t"), ca.SX.sym("p", 3), ca.SX.sym("q", 4)
        v, w, wish = (ca.SX.sym(name, 3) for name in ("v", "w", "wish"))
        turn = ca.SX.sym("turn", 3)
        turned = quaternion_product(quaternion_exp(turn), q)
        phi = equalities.residual(t, p, turned, v, w)[rows]
        A_R, A_v = (ca.substitute(ca.jacobian(phi, x), turn, ca.SX.zeros(3)) for x in (turn, v))
        damping = (SLOW * speed) ** 2 * ca.SX.eye(len(rows))
        found = -ca.mtimes(A_R.T, ca.solve(ca.mtimes(A_R, A_R.T) + damping, ca.mtimes(A_v, wish)))
        self._function = ca.Function("steering", [t, p, q, v, w, wish], [ca.cse(found)])

    def __call__(
        self,
        time: float,
        position: Floats,
        quaternion: Floats,
        linear_velocity: Floats,
        angular_velocity: Floats,
        wish: Floats,
    ) -> Floats:
        """Turn (rad, world frame), shape (3,), that a velocity ``wish`` (m/s) asks for.

        Pose and velocities are those of the path.
        """
        if self._function is None:
            return np.zeros(3)
        turn = np.array(
            self._function(time, position, quaternion, linear_velocity, angular_velocity, wish)
        ).ravel()
        size = float(np.linalg.norm(turn))
        return turn * min(1.0, LARGEST_TURN / size) if size > 0 else turn
