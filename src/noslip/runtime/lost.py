"""Whose fault it is that a motion is lost."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.law.layout import STATE


def require_defined(system: ConstraintSystem, times: Floats, states: Floats) -> None:
    """Of a motion that becomes no number, name the constraint that is undefined where it does.

    Parameters
    ----------
    system : ConstraintSystem
    times : array, shape (N,)
    states : array, shape (N, 13)
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
    p, q, v, w = (states[last, STATE[name]] for name in STATE)
    # Where it is, and where it would be in the middle and at the end of the next step.
    ahead = np.array([0.0, 0.5, 1.0])[:, None] * (times[last + 1] - times[last])
    turned = Rotation.from_rotvec(ahead * w) * Rotation.from_quat(q, scalar_first=True)
    system.require_slopes(
        times[last] + ahead,
        p + ahead * v,
        turned.as_quat(scalar_first=True),
        np.tile(v, (3, 1)),
        np.tile(w, (3, 1)),
    )
