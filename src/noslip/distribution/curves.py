"""Smooth curves along a motion, by few weights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from noslip._typing import Floats
from noslip._values import Value

SAMPLES = 101
"""Fractions at which curves are fitted and compared: a demonstration bends far less often than
every hundredth of its way."""
FRACTIONS = np.linspace(0.0, 1.0, SAMPLES)
"""These fractions."""
FRACTIONS.flags.writeable = False
RESTING = 0.05
"""Share of the time in what curves follow: all of it where the motion rests, which leaves room for
turning there; the more there is, the more a tool at rest would move aside."""
_DEGREE = 3


@dataclass(frozen=True, eq=False)
class Curves(Value):
    """Cubic splines of how far a motion has come, orthonormal over :data:`FRACTIONS`.

    Of the way that is done, not of the time: what deviates then does so in proportion to the speed,
    and a tool that comes to rest does not move aside while it rests.

    Orthonormal ones leave white noise white: what a curve holds and what it does not are then
    apart, and both are cheap to weigh.

    Parameters
    ----------
    ways : array, shape (N,)
        Share of the way done at evenly spaced fractions of the duration: rises from 0 to 1.
    count : int
        Weights of a curve; 4 or more.
    """

    ways: Floats
    count: int

    @classmethod
    def along(cls, positions: Floats, count: int) -> Curves:
        """Curves along a motion, positions of shape (N, n) at evenly spaced fractions."""
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        way, time = np.concatenate([[0.0], np.cumsum(steps)]), np.linspace(0.0, 1.0, len(positions))
        done = way / way[-1] if way[-1] > 0 else time
        return cls((1 - RESTING) * done + RESTING * time, count)

    def of(self, count: int) -> Curves:
        """Curves of another number of weights."""
        return self if count == self.count else replace(self, count=count)

    @cached_property
    def places(self) -> Floats:
        """How far the motion has come at :data:`FRACTIONS`, shape (SAMPLES,)."""
        return self._come(FRACTIONS)

    @cached_property
    def _mixing(self) -> tuple[Floats, Floats]:
        return np.linalg.qr(_splines(self.count, self.places))

    @property
    def values(self) -> Floats:
        """At :data:`FRACTIONS`, shape (SAMPLES, count)."""
        return self._mixing[0]

    def at(self, fractions: Floats) -> Floats:
        """At any fractions from 0 to 1, shape (N, count)."""
        splines = _splines(self.count, self._come(fractions))
        return np.asarray(scipy.linalg.solve_triangular(self._mixing[1].T, splines.T, lower=True).T)

    def _come(self, fractions: Floats) -> Floats:
        known = np.linspace(0.0, 1.0, len(self.ways))
        found = scipy.interpolate.PchipInterpolator(known, self.ways)(np.clip(fractions, 0.0, 1.0))
        return np.asarray(np.clip(found, 0.0, 1.0))


def _splines(count: int, places: Floats) -> Floats:
    inner = np.linspace(0.0, 1.0, count - _DEGREE + 1)
    knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
    return np.asarray(scipy.interpolate.BSpline.design_matrix(places, knots, _DEGREE).toarray())
