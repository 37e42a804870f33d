"""A normal distribution of weights: conditioned, drawn from, held against what was seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError

_KNOWN = 1e-13
"""Variance of what is asked for, over the largest there is, below which it is known already: what
an exact condition leaves is rounding, a thousandth of it."""
_SAME = 1e-7
"""Difference (m, rad) from what is known already that is none: projections leave a tenth of it."""


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

        What is known already, because all have it in common or by an earlier condition, is left
        out.

        Raises
        ------
        InputError
            If what is seen contradicts it.
        """
        seen = self.seen(rows, noise)
        off, variances, directions = self._open(seen, values)
        gain = self.covariance @ rows.T @ (directions / variances) @ directions.T
        left = np.eye(len(self.mean)) - gain @ rows
        more = (gain * noise**2) @ gain.T
        return Gaussian(self.mean + gain @ directions @ off, left @ self.covariance @ left.T + more)

    def surprise(self, rows: Floats, values: Floats, noise: Floats) -> tuple[float, int]:
        """Mahalanobis distance of ``rows w + e`` from what it is expected to be, and dimensions."""
        off, variances, _ = self._open(self.seen(rows, noise), values)
        return float(np.sqrt(np.sum(off**2 / variances))), len(off)

    def _open(self, seen: Gaussian, values: Floats) -> tuple[Floats, Floats, Floats]:
        """How far values are from the mean in directions that are not known, and these."""
        variances, directions = np.linalg.eigh(seen.covariance)
        largest = float(np.diagonal(self.covariance).max(initial=0.0))
        unknown = variances > _KNOWN * largest
        off = directions.T @ (values - seen.mean)
        if np.abs(off[~unknown]).max(initial=0.0) > _SAME:
            raise InputError(
                f"{np.abs(off[~unknown]).max():.2g} (m, rad) from what is known exactly, because "
                "all demonstrations have it in common or by an earlier condition; ask for that, or "
                "for something else"
            )
        return off[unknown], variances[unknown], directions[:, unknown]

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
