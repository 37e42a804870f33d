"""The linear part of a movement primitive, and how it is stepped."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from noslip import _arguments
from noslip._typing import Floats

MOST_RATE = 1e6
"""Of alpha and beta; the least is its inverse.  Beyond, the factors of a step lose all digits."""
LEAST_STEP = 1e-5
"""Of the duration: of shorter steps, what a moving target adds is that of such a step; a thousandth
of it would be the rounding of its terms."""


@dataclass(frozen=True)
class Attractor:
    r"""``tau^2 x'' = alpha (beta (g - x) - tau x') + f`` (the paper's eq. 1 with tau squared).

    A step carries the state by the exact solution of the homogeneous equation,

        ``v+ = P v + G (x* - x)``,  ``x+ = x + dt v+``,  ``x* = g + f / (alpha beta)``

    with the velocity kept half a step back, as in leapfrog integration.  Between equal steps of a
    fraction h of the duration, ``P = exp(-alpha h)`` and ``G = (1 - S + P) / h``, where P and S are
    the product and the sum of ``exp(r h)`` over the two roots r of ``r^2 + alpha r + alpha beta``.
    For h -> 0 this is the equation above; unlike the explicit step it has the equation's own poles
    at any step size, so no step is too long for it.
    """

    alpha: float = 25.0
    beta: float = 6.25

    def __post_init__(self) -> None:
        for name in ("alpha", "beta"):
            value = _arguments.between(name, getattr(self, name), 1 / MOST_RATE, MOST_RATE)
            object.__setattr__(self, name, value)

    @property
    def stiffness(self) -> float:
        """``alpha beta``."""
        return self.alpha * self.beta

    # Most steps are as long as the one before.
    @lru_cache(maxsize=64)  # noqa: B019 - what it keeps alive is two numbers
    def factors(self, before: float, step: float) -> tuple[float, float]:
        """P and G of a step after another one, both as fractions of the duration.

        Of the first step, before which there is none (0), ``v`` is the velocity of the instant.
        """
        root = (self.alpha**2 / 4 - self.stiffness) ** 0.5  # complex where underdamped
        slow, fast = -self.alpha / 2 + root, -self.alpha / 2 - root
        # The two roots' solutions through two points fix how the third goes on; of a double root
        # the share is 1.
        share = _rate(-2 * root, step) / _rate(-2 * root, before) if root else 1.0
        product = np.exp(slow * step + fast * before) * share
        # Without the cancellation of 1 - S + P at short steps.
        lead = _rate(fast, before)
        gain = lead * (np.expm1(slow * step) * share + (share - 1)) + (lead - _rate(fast, step))
        return float(product.real), float(gain.real)

    def led_by(self, before: float, step: float) -> tuple[float, float]:
        """What a target that moves adds to itself in a step, which holds it still.

        Returns
        -------
        change, bend : float
            ``x* + change (x*+ - x*-) / 2 + bend (x*+ - 2 x* + x*-)`` leads a step exactly as a
            target does that is quadratic in time and is x*- a step before and x*+ a step after;
            between equal steps about ``(alpha (x*+ - x*-) h / 2 + x*+ - 2 x* + x*-) / 12``.  At
            the start, where x*- is not known, it falls out.
        """
        longer = max(1.0, LEAST_STEP / step)
        before, step = longer * before, longer * step
        product, gain = self.factors(before, step)
        slope = (1 - product) / gain - 1 / self.beta
        bend = (step + product * before) / gain / 2 - slope / self.beta - 1 / self.stiffness
        return slope / step, bend / step**2 if before else slope / step / 2

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
        product, gain = self.factors(0.0, fraction)
        return np.asarray((first_step - gain * pull) / product)

    def demonstrated_pull(self, before: Floats, after: Floats, fraction: float) -> Floats:
        """Pulls ``x* - x`` under which the steps reproduce samples: the step's exact inverse.

        Parameters
        ----------
        before, after : array, shape (N, d)
            Velocities of the steps that lead to each sample and from it, per duration, all as long.
        fraction : float
            ``dt / tau``.

        Returns
        -------
        array, shape (N, d)
        """
        product, gain = self.factors(fraction, fraction)
        return (after - product * before) / gain


def _rate(root: complex, step: float) -> complex:
    """``(exp(r h) - 1) / h``, which is r for no step at all."""
    return np.expm1(root * step) / step if step else root
