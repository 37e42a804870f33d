"""Where a goal is, and whither it goes, from noisy samples: an alpha-beta filter.

Gains of the steady-state filter with fading memory (Brookner, *Tracking and Kalman Filtering Made
Easy*, 1998, chapter 1.2): ``alpha = 1 - theta^2``, ``beta = (1 - theta)^2``, ``theta =
exp(-h / T)``.  Jumps are no noise: they are taken over at once, as soon as they are confirmed.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np

from noslip._typing import Floats
from noslip._values import is_same

SMOOTH = 0.1
"""s, T: noise of a camera at 60 Hz falls to a half, and a drifting goal is known within 0.3 s."""
CONFIRM = 0.03
"""s for which a jump must last: two samples of a camera at 60 Hz; one may be an outlier."""
HELD = 0.1
"""s after which the same value again is a new sample, not the last one held."""
_AVERAGED = 40
"""Samples over which the noise is averaged."""


class GoalFilter:
    """Filters a goal of three numbers.

    Parameters
    ----------
    goal : array, shape (3,)
        At first.
    jump : float
        What is no noise, whatever the noise.
    slow : float
        A goal that moves more slowly, a second, is taken to rest.
    """

    def __init__(self, goal: Floats, jump: float, slow: float) -> None:
        self._goal, self._rate = np.array(goal, dtype=np.float64), np.zeros(3)
        self._jump, self._slow = jump, slow
        self._noise, self._samples = 0.0, 0
        self._recent = np.zeros((0, 3))
        self._deviation = self._rate_deviation = 0.0
        self._time = self._since = self._far = -1.0
        self._last: list[float] = []

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GoalFilter):
            return NotImplemented
        return all(is_same(value, vars(other)[name]) for name, value in vars(self).items())

    __hash__ = None  # type: ignore[assignment]

    @property
    def is_jumping(self) -> bool:
        """Whether a jump waits to be confirmed."""
        return self._far >= 0

    @property
    def since(self) -> float:
        """When it jumped last, or was told first (s); -1 if it was not."""
        return self._since

    @property
    def last(self) -> list[float]:
        """What was told last; empty if nothing was."""
        return self._last

    def take(self, time: float, sample: list[float]) -> None:
        """Take a sample at a time (s, not negative); or the last one, held."""
        if sample == self._last and self._far < 0 and time - self._time < HELD:
            return
        h = max(time - self._time, 0.0) if self._time >= 0 else 0.0
        self._last = list(sample)
        given = np.array(sample)
        off = given - (self._goal + h * self._rate)
        if np.linalg.norm(off) > self._jump + 8 * sqrt(self._noise):
            if self._far < 0:
                self._far = time
            if time - self._far >= CONFIRM:
                self._goal, self._rate = given, np.zeros(3)
                self._recent, self._far = np.zeros((0, 3)), -1.0
                self._time = self._since = time
            return
        self._far = -1.0
        if self._time < 0:
            self._since = time
        self._time = time
        self._heed_noise(given)
        theta = exp(-h / SMOOTH)
        alpha, beta = 1 - theta**2, (1 - theta) ** 2
        self._goal = self._goal + h * self._rate + alpha * off
        noise = sqrt(self._noise)
        self._deviation = noise * sqrt(alpha)
        if h > 0:
            self._rate = self._rate + beta / h * off
            # Of the filter's rate in the steady state (Brookner, eq. 1.2-26).
            self._rate_deviation = noise * beta / h * sqrt(2 / (alpha * (4 - 2 * alpha - beta)))

    def _heed_noise(self, given: Floats) -> None:
        """From second differences, six times its variance each."""
        self._recent = np.vstack([self._recent[-2:], given])
        if len(self._recent) < 3:
            return
        first, middle, last = self._recent
        seen = float(np.sum((first - 2 * middle + last) ** 2)) / 18
        self._samples = min(self._samples + 1, _AVERAGED)
        if self._samples > 8:
            seen = min(seen, 9 * self._noise + 1e-18)
        self._noise += (seen - self._noise) / (self._samples + 1)

    def ahead(self, seconds: float) -> tuple[Floats, float]:
        """Where it is expected to be, and the standard deviation of that."""
        moves = float(np.linalg.norm(self._rate)) > self._slow + 4.5 * self._rate_deviation
        if moves and self._time - self._since > 3 * SMOOTH:
            deviation = self._deviation + seconds * self._rate_deviation
            return self._goal + seconds * self._rate, deviation
        return self._goal.copy(), self._deviation
