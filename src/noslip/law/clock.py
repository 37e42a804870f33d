"""The clock of a movement primitive: one that runs down once, or one that goes round.

What a law, its basis and its run time ask of a clock is the same of both; nobody asks which it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, inf, pi, sqrt
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError

NEGLIGIBLE = -40.0
"""Exponent below which a basis function is lost in the rounding of the sum."""
MOST_RATE = 100.0
"""Of alpha_s; the least is its inverse.  Faster, basis functions end where doubles do; slower,
their centers are apart by rounding alone."""
DONE = 1 - 1e-9
"""Fraction of the duration from which on a motion has come to its end: steps add up to 1 only to
rounding."""
LONGEST_STEP = 0.1
"""Of the duration: a longer step is a late cycle, and made good in shorter ones.  Of those the path
bends, and what is sent slips; a slow loop takes twenty steps for a short plan, and none of it."""
LATEST = 100.0
"""Durations: a step that is longer is refused, so that the work of making it good is bounded."""


@dataclass(frozen=True)
class Phase:
    """``tau ds/dt = -alpha_s s`` with tau the duration (the paper's eq. 2).

    The phase runs from 1 to ``exp(-alpha_s)`` over the motion, whatever its duration, once.
    """

    alpha_s: float = 1.0

    def __post_init__(self) -> None:
        value = _arguments.between("alpha_s", self.alpha_s, 1 / MOST_RATE, MOST_RATE)
        object.__setattr__(self, "alpha_s", value)

    returns: ClassVar[bool] = False
    """Whether it ends where it began, again and again."""

    def at(self, fraction: ArrayLike) -> Floats:
        """Phase at a fraction ``t / duration`` of the motion."""
        return np.exp(-self.alpha_s * np.asarray(fraction, dtype=np.float64))

    def phase(self, fraction: float) -> float:
        """The same of one, for loops."""
        return exp(-self.alpha_s * fraction)

    def fraction(self, phase: float) -> float:
        """Fraction of the motion at a phase; long after its end it stays a large number."""
        return float(-np.log(max(phase, np.finfo(np.float64).tiny)) / self.alpha_s)

    def later(self, phase: float, share: float) -> float:
        """Phase a fraction of the duration later; exact."""
        return phase * float(np.exp(-self.alpha_s * share))

    @staticmethod
    def later_fraction(fraction: float, share: float) -> float:
        """Fraction of the motion a share of the duration later."""
        return fraction + share

    @staticmethod
    def left(fraction: float) -> float:
        """What is left of the motion, over its duration: a step goes no farther."""
        return 1 - fraction

    @staticmethod
    def sampled(steps: int) -> tuple[int, int]:
        """Of a demonstration of so many steps: the first sample whose force is known, how many."""
        return 1, steps - 1

    def centers(self, count: int) -> Floats:
        """Centers of basis functions in phase, evenly spaced in time, shape (count,)."""
        return self.at(np.linspace(0.0, 1.0, count)) if count > 1 else np.ones(1)

    @staticmethod
    def widths(centers: Floats) -> Floats:
        """Their standard deviations in phase, each the distance to the next, shape (count,)."""
        return np.abs(np.gradient(centers)) if len(centers) > 1 else np.ones(1)

    @staticmethod
    def near(phases: Floats, centers: Floats, widths: Floats) -> tuple[slice, Floats]:
        """``psi_i(s) s / sum psi(s)`` of the functions that matter, and which those are.

        The others are lost in the rounding of the sum.  A Gaussian is largest, of a stretch of
        phases, where the stretch comes nearest to its center: within it or at one of its ends.
        """
        low, high = phases.min(), phases.max()
        ends = (np.array([[low], [high]]) - centers) / widths
        exponents = -0.5 * ends * ends
        exponents -= exponents.max(axis=1, keepdims=True)
        inside = (centers >= low) & (centers <= high)
        (matters,) = np.nonzero((exponents >= NEGLIGIBLE).any(axis=0) | inside)
        columns = slice(matters[0], matters[-1] + 1)
        scaled = (phases[:, None] - centers[columns]) / widths[columns]
        # The smallest exponent is taken out first, so that no phase leaves every Gaussian at zero.
        exponent = -0.5 * scaled * scaled
        exponent -= exponent.max(axis=1, keepdims=True)
        # As denormal numbers the far ones would take several times as long.
        psi = np.exp(np.maximum(exponent, 2 * NEGLIGIBLE))
        psi *= (phases / psi.sum(axis=1))[:, None]
        return columns, psi

    @staticmethod
    def slowed(
        fraction: float, time_step: float, duration: float, braking: float
    ) -> tuple[float, float]:
        """Slow down after the end: evenly, to rest within some seconds; 0 is at once.

        Parameters
        ----------
        fraction : float
            Of the duration, 1 or beyond.
        time_step, duration, braking : float
            Seconds.

        Returns
        -------
        share : float
            Of the speed, that a step leaves.
        fraction : float
            After it.
        """
        if not braking > 0:
            return 0.0, fraction
        speed = sqrt(max(0.0, 1 - 2 * (max(1.0, fraction) - 1) * duration / braking))
        slower = max(0.0, speed - time_step / braking)
        share = slower / speed if speed > 0 else 0.0
        return share, 1 + (1 - slower * slower) * braking / (2 * duration)

    def made_good(
        self, fraction: float, time_step: float, duration: float, steps: int
    ) -> tuple[int, float]:
        """In how many steps a step is made, of a motion of so many, and the seconds of each.

        Raises
        ------
        InputError
            If it is longer than :data:`LATEST` durations.
        """
        share = time_step / duration
        if share <= LONGEST_STEP:
            return 1, time_step
        if not share <= LATEST:
            raise InputError(
                f"time_step of {time_step:g} s is more than {LATEST:g} times the motion's "
                f"{duration:g} s; step at the rate of the loop, or set the time of the state"
            )
        left = share if self.is_over(fraction) else min(share, 1 - fraction)
        count = ceil(left * steps)
        return count, left * duration / count

    @staticmethod
    def is_over(fraction: float) -> bool:
        """Whether a motion has come to its end at a fraction of its duration."""
        return fraction >= DONE


@dataclass(frozen=True)
class Cycle:
    """``tau dphi/dt = 1`` with tau the period: the phase is the fraction of the cycle, 0 to 1.

    It goes round for ever, so basis functions are periodic: von Mises functions of the angle
    ``2 pi phi``, ``exp(kappa (cos 2 pi (phi - c_i) - 1))`` (Ijspeert et al. 2013, eq. 2.9), each as
    wide (one standard deviation) as its distance to the next, ``kappa = (count / 2 pi)^2``.
    """

    alpha_s: ClassVar[float] = 0.0
    """The rate at which a phase runs down: this one does not.  So C tells both apart."""
    returns: ClassVar[bool] = True

    @staticmethod
    def at(fraction: ArrayLike) -> Floats:
        """Phase at a fraction ``t / period``."""
        return np.asarray(fraction, dtype=np.float64) % 1.0

    @staticmethod
    def phase(fraction: float) -> float:
        """The same of one, for loops."""
        return fraction % 1.0

    @staticmethod
    def fraction(phase: float) -> float:
        """Fraction of the cycle at a phase."""
        return phase

    @staticmethod
    def later(phase: float, share: float) -> float:
        """Phase a fraction of the period later."""
        return Cycle.later_fraction(phase, share)

    @staticmethod
    def later_fraction(fraction: float, share: float) -> float:
        """Fraction of the cycle a share of the period later, from 0 again after each.

        What rounding leaves before or beyond 1 is 0: so a cycle of equal steps is the same each
        time, however many there were.
        """
        after = fraction + share
        whole = int(after + (1 - DONE))
        return after if not whole else after - whole if after - whole > 1 - DONE else 0.0

    @staticmethod
    def left(fraction: float) -> float:
        """Nothing ends: infinite."""
        return inf

    @staticmethod
    def slowed(
        fraction: float, time_step: float, duration: float, braking: float
    ) -> tuple[float, float]:
        """Never asked: it has no end to slow down after."""
        return 1.0, fraction

    @staticmethod
    def made_good(
        fraction: float, time_step: float, duration: float, steps: int
    ) -> tuple[int, float]:
        """In how many steps a step is made; as :meth:`Phase.made_good`."""
        share = time_step / duration
        if share <= LONGEST_STEP:
            return 1, time_step
        if not share <= LATEST:
            raise InputError(
                f"time_step of {time_step:g} s is more than {LATEST:g} periods of {duration:g} s; "
                "step at the rate of the loop, or set the time of the state"
            )
        count = ceil(share * steps)
        return count, time_step / count

    @staticmethod
    def is_over(fraction: float) -> bool:
        """Never."""
        return False

    @staticmethod
    def sampled(steps: int) -> tuple[int, int]:
        """Of a demonstrated cycle of so many steps the force of each sample is known."""
        return 0, steps

    @staticmethod
    def centers(count: int) -> Floats:
        """Centers of basis functions in phase, evenly spaced, shape (count,)."""
        return np.arange(count) / count

    @staticmethod
    def widths(centers: Floats) -> Floats:
        """Distance to the next center, shape (count,)."""
        return np.full(len(centers), 1 / len(centers))

    @staticmethod
    def near(phases: Floats, centers: Floats, widths: Floats) -> tuple[slice, Floats]:
        """``psi_i / sum psi`` of all functions."""
        apart = np.cos(2 * pi * (phases[:, None] - centers)) - 1
        exponent = apart / (2 * pi * widths) ** 2
        exponent -= exponent.max(axis=1, keepdims=True)
        psi = np.exp(np.maximum(exponent, 2 * NEGLIGIBLE))
        psi /= psi.sum(axis=1)[:, None]
        return slice(0, len(centers)), psi


Clock = Phase | Cycle
"""What drives a law."""
