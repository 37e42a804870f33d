"""Whose fault it is that a motion is lost."""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.law.layout import layouts


def require_defined(system: ConstraintSystem, times: Floats, states: Floats) -> None:
    """Of a motion that becomes no number, name the constraint that is undefined where it does.

    Parameters
    ----------
    system : ConstraintSystem
    times : array, shape (N,)
    states : array, shape (N, ...)
        The first of them is finite.

    Raises
    ------
    ConstraintError
        If there is one; not if start, goal or time are out of what can be computed with.
    """
    finite = np.isfinite(states)
    if finite.all():
        return
    last = int(np.argmin(finite.all(axis=1))) - 1
    space = system.space
    place = layouts(space)
    point, velocity = states[last, place.point], states[last, place.velocity]
    # Where it is, and where it would be in the middle and at the end of the next step.
    ahead = np.array([0.0, 0.5, 1.0])[:, None] * (times[last + 1] - times[last])
    points = space.moved(np.tile(point, (3, 1)), ahead * velocity)
    system.require_slopes(
        times[last] + ahead,
        points[:, : space.linear],
        points[:, space.linear :],
        np.tile(velocity[: space.linear], (3, 1)),
        np.tile(velocity[space.linear :], (3, 1)),
    )
