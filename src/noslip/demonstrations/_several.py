"""Several demonstrations side by side: checked, and sampled at equal fractions of their time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from noslip.errors import InputError
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory


def several(
    demonstrations: Iterable[PoseTrajectory], fewest: int, what: str
) -> list[PoseTrajectory]:
    """Return a list of demonstrations, checked; an error says for what they are needed."""
    # One trajectory cannot be iterated over, and what is no iterable is told as an item is.
    one = isinstance(demonstrations, Timed) or not isinstance(demonstrations, Iterable)
    given: list[PoseTrajectory] = [demonstrations] if one else list(demonstrations)  # type: ignore[list-item]
    for item in given:
        if not isinstance(item, Timed):
            raise InputError(
                f"{what}: demonstrations are PoseTrajectory or Trajectory objects, got "
                f"{type(item).__name__}; read files with load_demonstrations, make arrays "
                "Trajectory(times, values)"
            )
    if len(given) < fewest:
        raise InputError(f"{what} needs {fewest} demonstrations or more, got {len(given)}")
    return given


def at_fractions(demonstration: PoseTrajectory, count: int) -> PoseTrajectory:
    """Return a demonstration at fractions of its duration evenly spaced from 0 to 1."""
    times = np.linspace(demonstration.times[0], demonstration.times[-1], count)
    return demonstration.resampled(times=times)
