"""How the learned force follows the goal: three variants, one name each.

Without scaling (the default, as in the paper) a new goal moves the attractor alone and the learned
force stays.  The other variants multiply the force of the position by a matrix S, which maps the
demonstrated way from start to goal onto the new one,

    ``f'(s) = S f(s)``,   ``g' - p_0' = S (g - p_0)``

so that the motion is ``p_0' + S (p - p_0)``: the demonstrated path, stretched or turned.  Where S
turns, the orientation turns along.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from noslip.law.points import Goal

Scaling = Literal["none", "difference", "rotation-dilation"]

_SMALL = 0.05
"""Demonstrated way, over the largest of the three axes', along which no stretch is meaningful."""
_CLOSED = 0.01
"""Demonstrated way, over the reach of the force, of a path that ends where it began."""


def scaled(
    law: Law,
    scaling: Scaling,
    *,
    start_position: ArrayLike | None = None,
    goal_position: ArrayLike | None = None,
) -> Law:
    """Return a law whose path is stretched or turned to a new start and goal.

    Parameters
    ----------
    law : Law
    scaling : "none", "difference" or "rotation-dilation"
        - ``"none"``: S = 1 (the paper; Hoffmann et al. 2009 scale nothing either).
        - ``"difference"``: S is diagonal with the ratios of ``g - p_0``, axis by axis (Ijspeert et
          al. 2013, eq. 2.3).  An axis along which the demonstration ends where it began, or within
          5 % of the largest axis' way, is not scaled.
        - ``"rotation-dilation"``: S is the smallest rotation that turns the demonstrated way into
          the new one, times the ratio of their lengths (Ginesi, Sansonetto and Fiorini 2021,
          section 3.2).  Into the opposite direction it turns about the vertical.  A demonstration
          that ends where it began says nothing about a direction; it is not scaled.  The
          orientation turns along.
    start_position, goal_position : array, shape (3,), optional
        Meters; the learned ones by default.

    Returns
    -------
    Law
        A goal equal to the start lets an axis that is scaled stand still, and with
        ``"rotation-dilation"`` the whole motion.
    """
    if scaling not in get_args(Scaling):
        raise InputError(f"scaling is one of {', '.join(get_args(Scaling))}; got {scaling!r}")
    start, goal = law.start_position, law.goal_position
    if scaling == "rotation-dilation" and law.space.linear != 3:
        raise InputError(
            f"rotation-dilation turns positions in space; of {law.space.linear} coordinates scale "
            'each by "difference"'
        )
    if start_position is not None:
        start = _arguments.vector("start_position", start_position, size=law.space.linear)
    if goal_position is not None:
        goal = _arguments.vector("goal_position", goal_position, size=law.space.linear)
    matrix = _matrix(law, scaling, start, goal)
    ratio = float(np.cbrt(np.linalg.det(matrix)))
    if scaling == "rotation-dilation" and ratio and law.space.rotations:
        law = law.turned(Rotation.from_matrix(matrix / ratio))
    weights, velocity, point = (
        np.array(x) for x in (law.forcing.weights, law.start_velocity, law.start)
    )
    n = law.space.linear
    weights[:, :n] = weights[:, :n] @ matrix.T
    velocity[:n] = matrix @ velocity[:n]
    point[:n] = start
    return replace(
        law,
        forcing=ForcingTerm(law.basis, weights),
        start=point,
        start_velocity=velocity,
        goal=Goal(goal, *law.goal.windings),
    )


def _matrix(law: Law, scaling: Scaling, start: Floats, goal: Floats) -> Floats:
    """S, shape (n, n)."""
    n = law.space.linear
    if scaling == "none":
        return np.eye(n)
    # In meters: how far the force alone would move the attractor.
    reach = np.abs(law.offset_weights[:, :n]).max()
    stretch = _difference if scaling == "difference" else _rotation_dilation
    return stretch(law.goal_position - law.start_position, goal - start, _CLOSED * reach)


def _difference(demonstrated: Floats, wanted: Floats, closed: float) -> Floats:
    ways = np.abs(demonstrated)
    counts = ways > max(_SMALL * ways.max(), closed)
    return np.diag(np.divide(wanted, demonstrated, out=np.ones(len(ways)), where=counts))


def _rotation_dilation(demonstrated: Floats, wanted: Floats, closed: float) -> Floats:
    was, is_now = np.linalg.norm(demonstrated), np.linalg.norm(wanted)
    if was <= closed:
        return np.eye(3)
    if is_now == 0:
        return np.zeros((3, 3))
    a, b = demonstrated / was, wanted / is_now
    axis, cosine = np.cross(a, b), float(a @ b)
    sine = float(np.linalg.norm(axis))
    if sine > 1e-9:
        axis /= sine
    else:
        # Opposite: about what is vertical, as far as that is square to the way.
        upright = np.array([0.0, 0.0, 1.0] if abs(a[2]) < 0.9 else [1.0, 0.0, 0.0])
        axis = upright - (upright @ a) * a
        axis /= np.linalg.norm(axis)
    turn = Rotation.from_rotvec(np.arctan2(sine, cosine) * axis)
    return np.asarray(is_now / was * turn.as_matrix())
