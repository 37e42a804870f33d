"""What goes with a motion and follows its phase: a gripper, a wrench, a stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.law.basis import Basis
from noslip.law.forcing import RIDGE
from noslip.series import Series
from noslip.timed import Timed

SAMPLES = 8
"""Of the mean of the demonstrations, a basis function: each function sees its own bend, and jumps
are met where they are to an eighth of what the functions resolve."""


@dataclass(frozen=True, eq=False)
class Channels(Value):
    """Numbers that depend on the phase alone.

    ``c(u) = a + b u + sum psi_i(s) s theta_i / sum psi_i(s)``

    u is the fraction of the motion that is done, s its phase, psi are the law's own basis
    functions (the paper's eq. 3).  They do not move the tool, and no goal moves them.  Those of a
    rhythm have no trend, b = 0, and no s beside the weights; they come again with each period.

    Attributes
    ----------
    basis : Basis
    trend : array, shape (2, k)
        a and b, in the channels' units.
    weights : array, shape (basis.count, k)
        theta.
    least, most : array, shape (k,)
        What the demonstrations' mean ranges over, and c is kept within: functions of some width
        overshoot where a gripper jumps.
    names, units : tuple of str
        One a channel.
    begin : float
        Fraction of the demonstrated motion at which this one begins: 0, or where it was
        re-planned.
    """

    basis: Basis
    trend: Floats
    weights: Floats
    least: Floats
    most: Floats
    names: tuple[str, ...]
    units: tuple[str, ...]
    begin: float = 0.0

    def __post_init__(self) -> None:
        count = len(self.names)
        shapes = {
            "trend": (2, count),
            "weights": (self.basis.count, count),
            "least": (count,),
            "most": (count,),
        }
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.float64, order="C")
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError(
                    f"channels: {name} has shape {array.shape}, expected finite {shape}"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if not count or len(self.units) != count or np.any(self.least > self.most):
            raise InputError(
                "channels: each needs a name, a unit and a least value that is no more than the "
                "most"
            )
        if not 0 <= self.begin <= 1:
            raise InputError(f"channels: begin must be from 0 to 1, got {self.begin}")

    @classmethod
    def fit(cls, basis: Basis, recorded: Sequence[Series], *, ridge: float = RIDGE) -> Channels:
        """Fit the mean of recorded channels over equal fractions of their durations.

        Constants and straight lines are met to rounding; what they leave is fitted by ridge
        regression.

        Parameters
        ----------
        basis : Basis
        recorded : sequence of Series
            Of the same names and units.
        ridge : float
            Relative to the basis functions' mean square.

        Raises
        ------
        InputError
            If names or units differ.
        """
        first = recorded[0]
        for other in recorded[1:]:
            if (other.names, other.units) != (first.names, first.units):
                raise InputError(
                    f"{other.name}: has channels {_told(other)}, but {first.name} has "
                    f"{_told(first)}; read the same of all demonstrations"
                )
        fractions = np.linspace(0.0, 1.0, SAMPLES * basis.count + 1)
        mean = np.mean(
            [c.between(c.times[0] + c.duration * fractions).values for c in recorded], axis=0
        )
        line = np.column_stack([np.ones_like(fractions), fractions])
        trend = np.zeros((2, mean.shape[1]))
        terms = 1 if basis.phase.returns else 2
        trend[:terms] = np.linalg.lstsq(line[:, :terms], mean)[0]
        psi = basis.activations(basis.phase.at(fractions))
        normal = psi.T @ psi
        normal.flat[:: basis.count + 1] += ridge * np.trace(normal) / basis.count
        weights: Floats = cho_solve(cho_factor(normal), psi.T @ (mean - line @ trend))
        return cls(
            basis,
            trend,
            weights,
            mean.min(axis=0),
            mean.max(axis=0),
            first.names,
            first.units,
        )

    def at(self, fractions: ArrayLike) -> Floats:
        """Return the channels at fractions of the motion, shape (N, k).

        Its ends hold beyond it; those of a rhythm come again.
        """
        u = np.atleast_1d(_arguments.numbers("fractions", fractions))
        if not np.isfinite(u).all():
            raise InputError("fractions of a motion must be finite numbers")
        if not self.basis.phase.returns:
            u = self.begin + (1 - self.begin) * np.clip(u, 0.0, 1.0)
        found = self.trend[0] + u[:, None] * self.trend[1]
        found = found + self.basis.activations(self.basis.phase.at(u)) @ self.weights
        clipped: Floats = np.clip(found, self.least, self.most)
        return clipped

    def at_phase(self, phase: float) -> Floats:
        """Return the channels at the phase of a state, shape (k,)."""
        channels: Floats = self.at(self.basis.phase.fraction(phase))[0]
        return channels

    def along(self, motion: Timed, duration: float | None = None) -> Series:
        """Return the channels at the times of a motion.

        Parameters
        ----------
        motion : Timed
            From its beginning.
        duration : float, optional
            Of the whole motion, or of a rhythm its period (s); by default that of the motion given.
        """
        values = self.at((motion.times - motion.times[0]) / (duration or motion.duration))
        return Series(
            motion.times,
            values,
            names=self.names,
            units=self.units,
            name=f"channels of {motion.name}",
        )

    def after(self, fraction: float) -> Channels:
        """Return the channels of what is left of the motion from a fraction of it on."""
        return replace(self, begin=self.begin + (1 - self.begin) * min(max(fraction, 0.0), 1.0))


def _told(channels: Series) -> str:
    return ", ".join(f"{n} ({u})" for n, u in zip(channels.names, channels.units, strict=True))
