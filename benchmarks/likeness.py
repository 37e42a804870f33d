"""How alike two motions are, as the field's papers measure it: warping, Fréchet, swept area."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from noslip._typing import Floats

Join = Callable[[Floats, Floats], Any]


def warping(there: Floats, here: Floats) -> float:
    """Dynamic time warping: the least sum of distances over all ways to pair samples in order.

    Parameters
    ----------
    there, here : array, shape (N, n) and (M, n)
        Samples in order; the result is in their unit.
    """
    return _of_the_best_pairing(cdist(there, here), np.add)


def frechet(there: Floats, here: Floats) -> float:
    """Discrete Fréchet distance: the least over all such ways of the most distant pair.

    T. Eiter and H. Mannila, "Computing discrete Fréchet distance", TU Wien, 1994.
    """
    return _of_the_best_pairing(cdist(there, here), np.maximum)


def swept_area(there: Floats, here: Floats) -> float:
    """Area between planar motions, shape (N, 2), that the line between samples k of both sweeps.

    Sums quadrilaterals, as ``mean_swept_error`` in the code published with Auddy et al., RAS 2023,
    does.  In the samples' unit, squared.
    """
    corners = np.stack([here[:-1], here[1:], there[1:], there[:-1]], axis=1)
    x, y = np.moveaxis(corners, -1, 0)
    crossed = x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)
    return float(np.abs(crossed.sum(axis=1)).sum() / 2)


def _of_the_best_pairing(distances: Floats, join: Join) -> float:
    """The recurrence that both share, over the antidiagonals of all pairs, shape (N, M)."""
    rows, columns = distances.shape
    mirrored = np.fliplr(distances)
    # Before the first sample of both is nothing to pay; row 0 and column 0 stand for it.
    last, this = np.full((2, rows + 1), np.inf)
    last[0] = 0.0
    for diagonal in range(rows + columns - 1):
        i, j = max(0, diagonal + 1 - columns), min(rows, diagonal + 1)
        before = np.minimum(np.minimum(this[i:j], this[i + 1 : j + 1]), last[i:j])
        last, this = this, np.full(rows + 1, np.inf)
        this[i + 1 : j + 1] = join(mirrored.diagonal(columns - 1 - diagonal), before)
    return float(this[rows])
