"""A normal distribution of weights: conditioned, drawn from, held against what was seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError

_KNOWN = 1e-10
"""Variance of what is asked for, over the largest there is, below which it is known already: what
two exact conditions leave of the first is rounding."""


@dataclass(frozen=True, eq=False)
class Gaussian(Value):
    """N(mean, covariance).

    Parameters
    ----------
    mean : array, shape (D,)
    covariance : array, shape (D, D)
        Symmetric, positive semi-definite.
    """

    mean: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        mean, covariance = (np.array(x, dtype=np.float64) for x in (self.mean, self.covariance))
        if mean.ndim != 1 or covariance.shape != 2 * mean.shape:
            raise InputError(
                f"a normal distribution's mean of shape {mean.shape} does not fit its covariance "
                f"of shape {covariance.shape}"
            )
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise InputError("a normal distribution's mean or covariance is not finite")
        for name, array in (("mean", mean), ("covariance", (covariance + covariance.T) / 2)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def seen(self, rows: Floats, noise: Floats) -> Gaussian:
        """Return the distribution of ``rows w + e``.

        Parameters
        ----------
        rows : array, shape (r, D)
        noise : array, shape (r,)
            Standard deviation of each e.
        """
        return Gaussian(rows @ self.mean, rows @ self.covariance @ rows.T + np.diag(noise**2))

    def given(self, rows: Floats, values: Floats, noise: Floats) -> Gaussian:
        """Return the distribution of w when ``rows w + e`` is seen to be something.

        ``mean + G (values - H mean)`` and ``covariance - G H covariance`` with
        ``G = covariance H^T (H covariance H^T + noise^2)^-1`` (Paraschos et al. 2013, eqs. 5, 6),
        the covariance in Joseph's form, which rounding cannot make indefinite.

        Raises
        ------
        InputError
            If it contradicts what is known exactly.
        """
        seen = self.seen(rows, noise)
        largest = float(np.diagonal(self.covariance).max(initial=0.0))
        if np.diagonal(seen.covariance).min() <= _KNOWN * largest:
            raise InputError(
                "what is asked for is already known exactly, by an earlier condition; ask for each "
                "once, or with noise"
            )
        gain = scipy.linalg.solve(seen.covariance, rows @ self.covariance, assume_a="pos").T
        left = np.eye(len(self.mean)) - gain @ rows
        more = (gain * noise**2) @ gain.T
        return Gaussian(
            self.mean + gain @ (values - seen.mean), left @ self.covariance @ left.T + more
        )

    def distance(self, values: Floats) -> float:
        """Mahalanobis distance of values from the mean: standard deviations, all together."""
        off = scipy.linalg.solve_triangular(self._factor, values - self.mean, lower=True)
        return float(np.linalg.norm(off))

    @property
    def log_volume(self) -> float:
        """Half of the logarithm of the covariance's determinant."""
        return float(np.log(np.diagonal(self._factor)).sum())

    @cached_property
    def _factor(self) -> Floats:
        try:
            return np.asarray(scipy.linalg.cholesky(self.covariance, lower=True))
        except scipy.linalg.LinAlgError:
            raise InputError(
                "a density is asked of a normal distribution that is flat in some direction; give "
                "noise"
            ) from None

    def draw(self, count: int, random: np.random.Generator) -> Floats:
        """Return so many samples, shape (count, D); the first ones are alike for any count."""
        variances, directions = np.linalg.eigh(self.covariance)
        spread = directions * np.sqrt(np.maximum(variances, 0.0))
        return np.asarray(self.mean + random.standard_normal((count, len(self.mean))) @ spread.T)
