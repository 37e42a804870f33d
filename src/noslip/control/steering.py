"""Guidance: how far a tool is off its path, and the turn with which it comes back.

Off its path by e, a tool should move with the velocity ``v + k e``.  A constraint on velocities
forbids part of that; turned by delta it would allow it,

    ``phi(p, Exp(delta) R, v + k e) = 0``,   to first order   ``A_R delta + A_v k e = 0``

and the least such turn, damped where the tool is too slow for a turn to help, is

    ``delta = - A_R^T (A_R A_R^T + mu 1)^-1 A_v k e``.

For a blade or a wheel in the plane this is the line-of-sight guidance of a car: steer towards a
point ahead on the path.
"""

from __future__ import annotations

from math import isfinite

import casadi as ca
import numpy as np

from noslip._typing import Expression
from noslip.constraints.system import ConstraintSystem
from noslip.law.layout import STATE, VELOCITY, Layout
from noslip.rotations import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)

SLOW = 0.1
"""Speed, over the mean speed of the motion, below which a turn is not relied upon."""
LARGEST_TURN = 0.5
"""rad; the linearization holds for little more."""
RETURN_RATE = 8.0
"""k of the steering, per duration."""
PATH = Layout(**{name: STATE.width(name) for name in STATE}, passed=1, time=1)
"""A state of the path, seconds since then, time now."""
_FOUND = Layout(distance=1, angle=1, sum=1, steering=3, state=STATE.size)
"""What the comparison returns."""
DEADBAND = 0.1
"""Fraction of the tolerance within which nothing is done."""


def turn_that_allows(
    system: ConstraintSystem,
    speed: Expression,
    time: Expression,
    position: Expression,
    quaternion: Expression,
    linear_velocity: Expression,
    angular_velocity: Expression,
    wish: Expression,
) -> Expression:
    """Turn (rad, world frame), shape (3,), that a velocity ``wish`` (m/s) asks for.

    Parameters
    ----------
    system : ConstraintSystem
        Only its velocity-level equalities steer.
    speed : expression
        Mean speed of the motion (m/s); where there is none, nothing is turned.
    time, position, quaternion, linear_velocity, angular_velocity, wish : expression
        Pose and velocities are those of the path.
    """
    equalities = system.equalities
    rows = [i for i, is_velocity in enumerate(equalities.row_is_velocity) if is_velocity]
    if not rows:
        return ca.SX.zeros(3)
    turn, v = ca.SX.sym("turn", 3), ca.SX.sym("v", 3)
    turned = quaternion_product(quaternion_exp(turn), quaternion)
    phi = equalities.residual(time, position, turned, v, angular_velocity)[rows]
    A_R, A_v = (
        ca.substitute(
            ca.jacobian(phi, x), ca.vertcat(turn, v), ca.vertcat(ca.SX.zeros(3), linear_velocity)
        )
        for x in (turn, v)
    )
    damping = (SLOW * speed) ** 2 * ca.SX.eye(len(rows))
    found = -ca.mtimes(A_R.T, ca.solve(ca.mtimes(A_R, A_R.T) + damping, ca.mtimes(A_v, wish)))
    size = ca.norm_2(found)
    found = found * ca.fmin(1.0, LARGEST_TURN / ca.fmax(size, np.finfo(np.float64).tiny))
    return ca.if_else(speed > 0, found, 0.0)


class Guidance:
    """Compares what was measured with the path; all in one expression graph, one a system.

    Parameters
    ----------
    system : ConstraintSystem
    path_length : float
        Meters.
    duration : float
        Seconds.
    tolerance : float
        Distance over the path's length.
    angle_tolerance : float
        rad.

    Attributes
    ----------
    path : array, shape (15,)
        To be written to before a call; see :data:`PATH`.
    measured : array, shape (13,)
        To be written to before a call: pose and velocities.
    distance, angle : float
        Off the path, over what is tolerated.
    steering : array, shape (3,)
        Turn of the orientation's target (rad).
    state : array, shape (13,)
        What was measured, the quaternion of unit length.
    """

    def __init__(
        self,
        system: ConstraintSystem,
        path_length: float,
        duration: float,
        tolerance: float,
        angle_tolerance: float,
    ) -> None:
        function = system.owned("guidance", lambda: _comparison(system))
        length, speed, rate = path_length or 1.0, path_length / duration, RETURN_RATE / duration
        self._motion = np.array([length, speed, rate, tolerance, angle_tolerance])
        self.path, self.measured = np.zeros(PATH.size), np.zeros(STATE.size)
        self._found = np.zeros(_FOUND.size)
        self.steering, self.state = self._found[_FOUND["steering"]], self._found[_FOUND["state"]]
        self._buffer, self._evaluate = function.buffer()
        for index, given in enumerate((self.path, self.measured, self._motion)):
            self._buffer.set_arg(index, given.data)
        self._buffer.set_res(0, self._found.data)

    def __call__(self) -> None:
        """Compare."""
        self._evaluate()

    @property
    def distance(self) -> float:
        """Off the path, over what is tolerated."""
        return self._found.item(_FOUND.index("distance"))

    @property
    def is_finite(self) -> bool:
        """Whether all that was measured is."""
        return isfinite(self._found.item(_FOUND.index("sum")))

    @property
    def angle(self) -> float:
        """Off the path's orientation, over what is tolerated."""
        return self._found.item(_FOUND.index("angle"))


def _comparison(system: ConstraintSystem) -> ca.Function:
    """(path, measured, what a motion has of its own) -> found."""
    path, measured = ca.SX.sym("path", PATH.size), ca.SX.sym("measured", STATE.size)
    motion = ca.SX.sym("motion", 5)
    length, speed, rate, tolerance, angle_tolerance = ca.vertsplit(motion)
    p, q, v, w, passed, time = (path[PATH[name]] for name in PATH)
    position = p + passed * v
    quaternion = quaternion_product(quaternion_exp(passed * w), q)
    place, turned = measured[STATE["position"]], measured[STATE["quaternion"]]
    off, unit = position - place, turned / ca.norm_2(turned)
    distance = ca.norm_2(off) / length / tolerance
    turn = turn_that_allows(system, speed, time, position, quaternion, v, w, rate * off)
    turn = ca.if_else(distance > DEADBAND, turn, 0.0)
    apart = quaternion_log(quaternion_product(quaternion, quaternion_conjugate(unit)))
    angle = ca.norm_2(apart) / (angle_tolerance + ca.norm_2(turn))
    state = ca.vertcat(place, unit, measured[VELOCITY])
    # One sum instead of thirteen questions: what is not finite stays so.
    found = ca.densify(ca.vertcat(distance, angle, ca.sum1(state), turn, state))
    return ca.Function("guidance", [path, measured, motion], [ca.cse(found)])
