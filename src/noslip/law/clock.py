"""The clock of a movement primitive."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError

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

    def at(self, fraction: ArrayLike) -> Floats:
        """Phase at a fraction ``t / duration`` of the motion."""
        return np.exp(-self.alpha_s * np.asarray(fraction, dtype=np.float64))

    def fraction(self, phase: float) -> float:
        """Fraction of the motion at a phase; long after its end it stays a large number."""
        return float(-np.log(max(phase, np.finfo(np.float64).tiny)) / self.alpha_s)

    def decay(self, fraction: float) -> float:
        """Factor by which the phase shrinks over a fraction of the duration; exact."""
        return float(np.exp(-self.alpha_s * fraction))

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
