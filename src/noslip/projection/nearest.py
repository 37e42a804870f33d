"""Newton's method to the nearest point that satisfies conditions, and then straight onto them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from noslip._typing import Floats

_MOST_ITERATIONS = 60
"""Six times what a search takes that converges slowly, its conditions dependent."""
_LOST = 1e3
"""Residual, over the first or 1, at which the search has run away."""
_CONTRADICTION = 1e-7
"""What least distance programming leaves of 1 where no change keeps all limits."""


def nearest(
    conditions: Callable[[Floats], tuple[Floats, Floats]],
    compose: Callable[[Floats, Floats], Floats],
    is_limit: NDArray[np.bool_],
    inverse_metric: Sequence[float],
    *,
    approaching: int,
    tolerance: float,
) -> tuple[Floats, float]:
    """Find the least change, in a metric, with which conditions are met.

    The first steps head for the nearest point, which converges linearly; the others straight for
    the conditions, which is quadratic.

    Parameters
    ----------
    conditions : callable
        Their values, shape (m,), and the derivatives of these, shape (m, d), at a change.
    compose : callable
        The change that results from one, shape (d,), and then another.
    is_limit : array of bool, shape (m,)
        Conditions that need only not be negative; the others are zero.
    inverse_metric : d numbers
        Diagonal of M^-1.
    approaching : int
        Steps toward the nearest point.
    tolerance : float
        Residual at which the conditions are met.

    Returns
    -------
    change : array, shape (d,)
    residual : float
        What is left of the conditions there, the largest; above the tolerance if it found none.
    """
    change = np.zeros(len(inverse_metric))
    residual = first = 0.0
    for iteration in range(_MOST_ITERATIONS):
        value, rows = conditions(change)
        missed = np.where(is_limit, np.minimum(value, 0), value)
        residual = float(np.abs(missed).max(initial=0.0))
        first = first or residual
        if residual <= tolerance or residual > _LOST * max(1.0, first):
            break
        if not np.isfinite(rows[~is_limit]).all():
            return change, np.inf
        if iteration < approaching:
            change = least_change(rows, rows @ change - value, is_limit, inverse_metric)
        else:
            change = compose(change, least_change(rows, -value, is_limit, inverse_metric))
    return change, residual


def least_change(
    rows: Floats, reach: Floats, is_limit: NDArray[np.bool_], inverse_metric: ArrayLike
) -> Floats:
    """Least d, in the metric, with ``rows d = reach``, or ``>= reach`` for limits.

    Without limits the pseudo-inverse's, with them by non-negative least squares (Lawson and Hanson
    1974, least distance programming).  Where not all limits can be kept, they are left out.
    """
    weights = np.asarray(inverse_metric, dtype=np.float64)
    if not np.any(is_limit & (reach > 0)):
        A, wanted = rows[~is_limit], reach[~is_limit]
        weighted = weights[:, None] * A.T
        d = weighted @ (np.linalg.pinv(A @ weighted, hermitian=True) @ wanted)
        if np.all((rows @ d)[is_limit] >= reach[is_limit]):
            return np.asarray(d)
    roots = np.sqrt(weights)
    A, wanted = rows * roots, reach
    scale = np.abs(wanted).max() or 1.0
    # An equality is two limits.
    G = np.concatenate([A, -A[~is_limit]])
    h = np.concatenate([wanted, -wanted[~is_limit]]) / scale
    end = np.zeros(len(weights) + 1)
    end[-1] = 1.0
    E = np.vstack([G.T, h])
    push, distance = scipy.optimize.nnls(E, end)
    left = E @ push - end
    if distance < _CONTRADICTION:
        return least_change(rows[~is_limit], reach[~is_limit], is_limit[~is_limit], weights)
    return np.asarray(roots * (-scale * left[:-1] / left[-1]))
