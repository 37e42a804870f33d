"""Recorded periods of a rhythm: that they come back to where they began."""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.constraints.check import with_unit
from noslip.errors import InputError
from noslip.space import Space
from noslip.trajectory import PoseTrajectory

OPEN, OPEN_TURN = 0.05, np.radians(10.0)
"""Share of the path, and turn, by which a period may miss its beginning: a hand does by 0.02."""


def closed(period: PoseTrajectory) -> PoseTrajectory:
    """Return a period whose last sample is its first one again.

    What a hand misses by is spread evenly over the period.  Rotations come back up to whole turns.

    Raises
    ------
    InputError
        If it ends elsewhere than it begins, by more than a twentieth of its path or 10 degrees.
    """
    points, space = period.points, period.space
    gap = space.difference(points[:1], points[-1:])
    away = float(np.linalg.norm(gap[0, : space.linear]))
    turn = float(np.abs(gap[0, space.linear :]).max(initial=0.0))
    if away > OPEN * period.path_length or turn > OPEN_TURN:
        apart = with_unit(f"{away:.3g}", period.unit)
        turned = f" and {np.degrees(turn):.3g} degrees" if space.rotations else ""
        raise InputError(
            f"{period.name}: ends {apart}{turned} from where it begins; "
            "cut it to one period (trajectory[first:last]), or learn a motion that ends, "
            "rhythmic=False"
        )
    if not gap.any():
        return period
    share = (period.times - period.times[0]) / period.duration
    return period.with_points(joined(space, points, share))


def joined(space: Space, points: Floats, share: Floats) -> Floats:
    """Points whose last one is the first again: the gap spread over them by its share at each."""
    gap = space.difference(points[:1], points[-1:])
    moved = space.moved(points, share[:, None] * gap)
    moved[-1, : space.linear] = moved[0, : space.linear]
    return moved
