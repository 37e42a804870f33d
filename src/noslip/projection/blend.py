"""A displacement known at a few samples, spread smoothly over all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from noslip._typing import Floats


def spread(
    displacements: Mapping[int, ArrayLike] | Mapping[float, ArrayLike],
    places: ArrayLike,
    first_slope: ArrayLike | None = None,
) -> Floats:
    """Interpolate displacements by minimum jerk from each given place to the next.

    Velocity and acceleration of the displacement are zero at the given places (Flash and Hogan
    1985, eq. 3), so those of what is displaced stay as they were there; but for the velocity at the
    first place, if one is given.

    Parameters
    ----------
    displacements : mapping from place to array, shape (d,)
        Where it is known; at the first and the last place it is zero unless told.
    places : array, shape (N,)
        Increasing: sample numbers, times or fractions.
    first_slope : array, shape (d,), optional
        Of the displacement at the first place, per unit of places.

    Returns
    -------
    array, shape (N, d)
    """
    at = np.asarray(places, dtype=np.float64)
    size = len(np.asarray(next(iter(displacements.values()))))
    ends: dict[float, ArrayLike] = {float(at[0]): np.zeros(size), float(at[-1]): np.zeros(size)}
    known = ends | {float(place): value for place, value in displacements.items()}
    knots = np.array(sorted(known))
    values = np.array([known[float(knot)] for knot in knots], dtype=np.float64)
    before = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = (at - knots[before]) / (knots[before + 1] - knots[before])
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    found = values[before] + blend[:, None] * (values[before + 1] - values[before])
    if first_slope is not None:
        # The quintic with slope 1 at 0 and all else zero at 0 and 1.
        slope = share - share**3 * (6 - 8 * share + 3 * share**2)
        width = float(knots[1] - knots[0])
        found += np.where(before == 0, slope * width, 0.0)[:, None] * np.asarray(first_slope)
    return np.asarray(found)
