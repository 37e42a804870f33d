"""How far a maneuver stays from what it must not touch: a bound, not a sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from noslip._arguments import LARGEST
from noslip._typing import Floats
from noslip.maneuvers.maneuver import Maneuver, composed, exponential, integrated

Clear = Callable[[Floats, Floats], Floats]
"""Margins (m), shape (N,), of poses: positions (N, 3) and quaternions (N, 4).  0 or more is free.
They must be distances: no more changed by a motion than the tool's farthest point moves."""
TOUCHING = 1e-9
"""Margins (m) of which rounding may have taken the sign."""
_HALVINGS = 5
"""Of the spacing, where samples are free and it is not sure what is between them."""


def least_margin(maneuver: Maneuver, clear: Clear, spacing: float, *, reach: float = 0.0) -> float:
    """The margin that surely remains everywhere along a maneuver (m).

    Parameters
    ----------
    maneuver : Maneuver
    clear : callable
        Margins of poses in the edge's frame at the maneuver's start, see :data:`Clear`.
    spacing : float
        Between samples (m); down to 1/32 of it where it is not clear whether the way is.
    reach : float
        From the edge's point to the farthest point of the tool for which there is a margin (m).

    Returns
    -------
    float
        At most the true one, and less by at most half a spacing.
    """
    twists = np.array([each.twist for each in maneuver.stretches]).reshape(-1, 6)
    poses = np.column_stack(integrated(twists))
    if len(poses) == 1:
        return float(clear(poses[:, :3], poses[:, 3:])[0])
    return float(np.min(swept(poses[:-1], twists, clear, spacing, reach)))


def swept(begins: Floats, twists: Floats, clear: Clear, spacing: float, reach: float) -> Floats:
    """Bounds of the margin along stretches, shape (N,), from poses (N, 7) with twists (N, 6).

    Over a way d, between margins a and b, a distance is nowhere below ``(a + b - d) / 2``.
    """
    way = np.abs(twists[:, 0]) + reach * np.linalg.norm(twists[:, 3:], axis=1)
    parts = np.maximum(1, np.ceil(way / spacing)).astype(int)
    owner = np.repeat(np.arange(len(twists)), parts + 1)
    first = np.cumsum(parts + 1) - (parts + 1)
    share = (np.arange(len(owner)) - first[owner]) / parts[owner]

    def margins(owner: NDArray[np.intp], share: Floats) -> Floats:
        poses = composed(
            begins[owner], np.column_stack(exponential(share[:, None] * twists[owner]))
        )
        # What is no number is not clear.
        return np.nan_to_num(clear(poses[:, :3], poses[:, 3:]), nan=-LARGEST)

    found = margins(owner, share)
    sampled = np.minimum.reduceat(found, first)
    inner = owner[:-1] == owner[1:]
    owner, begin, end = owner[:-1][inner], share[:-1][inner], share[1:][inner]
    a, b = found[:-1][inner], found[1:][inner]
    least = np.full(len(twists), np.inf)
    for halving in range(_HALVINGS + 1):
        bound = (a + b - way[owner] * (end - begin)) / 2
        blocked = ~(sampled >= -TOUCHING)
        doubtful = (bound < -TOUCHING) & ~blocked[owner] & (halving < _HALVINGS)
        np.minimum.at(least, owner[~doubtful], bound[~doubtful])
        if not doubtful.any():
            break
        owner, begin, end, a, b = (x[doubtful] for x in (owner, begin, end, a, b))
        middle = (begin + end) / 2
        m = margins(owner, middle)
        np.minimum.at(sampled, owner, m)
        owner, begin, end = np.tile(owner, 2), np.append(begin, middle), np.append(middle, end)
        a, b = np.append(a, m), np.append(m, b)
    return least
