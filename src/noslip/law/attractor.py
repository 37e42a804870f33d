"""The linear part of a movement primitive, and how it is stepped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noslip import _arguments
from noslip._typing import Floats


@dataclass(frozen=True)
class Attractor:
    r"""``tau^2 x'' = alpha (beta (g - x) - tau x') + f`` (the paper's eq. 1 with tau squared).

    A step carries the state by the exact solution of the homogeneous equation,

        ``v+ = P v + K / h (x* - x)``,  ``x+ = x + dt v+``,  ``x* = g + f / (alpha beta)``

    with ``P = exp(-alpha h / tau)`` and ``K = 1 - S + P``, where P and S are the product and the
    sum of ``exp(r h / tau)`` over the two roots r of ``r^2 + alpha r + alpha beta``.  For h -> 0
    this is the equation above; unlike the explicit step it has the equation's own poles at any
    step size, so no step is too long for it.  It is of second order with the velocity kept half a
    step back, as in leapfrog integration: ``h`` is the mean of the last step and this one, half a
    step at the start.
    """

    alpha: float = 25.0
    beta: float = 6.25

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", _arguments.positive("alpha", self.alpha))
        object.__setattr__(self, "beta", _arguments.positive("beta", self.beta))

    @property
    def stiffness(self) -> float:
        """``alpha beta``."""
        return self.alpha * self.beta

    def factors(self, fraction: Floats | float) -> tuple[Floats, Floats]:
        """P and K for a kick over a fraction ``h / tau`` of the duration."""
        h = np.asarray(fraction, dtype=np.float64)
        product = np.exp(-self.alpha * h)
        discriminant = self.alpha**2 / 4 - self.stiffness
        root = np.sqrt(abs(discriminant))
        if discriminant >= 0:
            low, high = -self.alpha / 2 - root, -self.alpha / 2 + root
            # (1 - e^low)(1 - e^high), without the cancellation of 1 - S + P at short steps.
            return product, np.expm1(low * h) * np.expm1(high * h)
        half = np.exp(-self.alpha * h / 2)
        return product, np.expm1(-self.alpha * h / 2) ** 2 + 4 * half * np.sin(root * h / 2) ** 2

    def demonstrated_start(self, pull: Floats, first_step: Floats, fraction: float) -> Floats:
        """Velocity at the start from which the half kick makes the first step: its exact inverse.

        Parameters
        ----------
        pull : array, shape (d,)
            ``x* - x`` at the start.
        first_step : array, shape (d,)
            Velocity of the first step, per duration.
        fraction : float
            ``dt / tau``.
        """
        product, gain = self.factors(fraction / 2)
        return np.asarray((first_step - gain / (fraction / 2) * pull) / product)

    def demonstrated_pull(self, velocities: Floats, fraction: float) -> Floats:
        """Pulls ``x* - x`` under which the steps reproduce samples: the step's exact inverse.

        Parameters
        ----------
        velocities : array, shape (N - 1, d)
            Of the steps between samples that are ``fraction`` of the duration apart, per duration.
        fraction : float
            ``dt / tau``.

        Returns
        -------
        array, shape (N - 2, d)
            At the samples 1 to N - 2.
        """
        product, gain = self.factors(fraction)
        return (velocities[1:] - product * velocities[:-1]) * (fraction / gain)
