"""Radial basis functions of the phase."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from noslip.primitives.phase import Phase

Floats = NDArray[np.float64]

BLOCK = 2048
"""Steps whose activations are held in memory at once."""
NEGLIGIBLE = -50.0
"""Exponent below which a Gaussian is lost in the rounding of the sum."""
SINGLE_THREADED = 250_000
"""Multiplications up to which OpenBLAS stays in one thread: on a machine that is busy, waking the
others would cost a rollout ten times what the product takes."""


@dataclass(frozen=True)
class Basis:
    """Normalised Gaussians, spaced evenly in time (and so geometrically in phase).

    Each is as wide (one standard deviation) as its distance to the next centre: any smooth force
    is then matched to about 1e-6 of the path with 100 functions.
    """

    count: int = 100
    phase: Phase = Phase()  # noqa: RUF009 - immutable

    @cached_property
    def centers(self) -> Floats:
        """Centres in phase, shape (count,)."""
        return self.phase.at(np.linspace(0.0, 1.0, self.count)) if self.count > 1 else np.ones(1)

    @cached_property
    def widths(self) -> Floats:
        """Standard deviations in phase, shape (count,)."""
        if self.count == 1:
            return np.ones(1)
        return np.abs(np.gradient(self.centers))

    def activations(self, phases: Floats) -> Floats:
        """``psi_i(s) s / sum psi(s)`` of eq. 3, shape (N, count)."""
        scaled = (phases[:, None] - self.centers) / self.widths
        # The smallest exponent is taken out first, so that no phase leaves every Gaussian at zero.
        exponent = -0.5 * scaled * scaled
        exponent -= exponent.max(axis=1, keepdims=True)
        # Far ones are zero: as denormal numbers they would take several times as long.
        far = exponent < NEGLIGIBLE
        psi = np.exp(np.maximum(exponent, NEGLIGIBLE))
        psi[far] = 0.0
        psi *= (phases / psi.sum(axis=1))[:, None]
        return psi

    def stepping_activations(
        self, begin: float, steps: int, step_fraction: float, alpha: float, *, starting: bool
    ) -> Iterator[tuple[slice, Floats]]:
        """Activations as the steps of an :class:`Attractor` want them, in blocks.

        A step treats its target as constant.  What that leaves out is, to fourth order,
        ``h^2 / 12 (x*'' + alpha x*')`` (and ``h / 3 x*'`` in the first half kick from the start),
        added here by central differences.  It makes long steps about twenty times more accurate.

        Parameters
        ----------
        begin : float
            Fraction of the duration at which the first step begins.
        steps : int
        step_fraction : float
            ``dt / tau``.
        alpha : float
            Of the attractor.
        starting : bool
            Whether the first step is the motion's first, with its half kick.

        Yields
        ------
        slice
            The steps of this block.
        array, shape (steps in the block, count)
        """
        for first in range(0, steps, BLOCK):
            size = min(BLOCK, steps - first)
            at = begin + first * step_fraction
            yield (
                slice(first, first + size),
                _stepping_activations(
                    self, at, size, step_fraction, alpha, starting and first == 0
                ),
            )

    def stepping_forces(
        self,
        begin: float,
        steps: int,
        step_fraction: float,
        alpha: float,
        weights: Floats,
        *,
        starting: bool,
    ) -> Floats:
        """Product of :meth:`stepping_activations` with weights, shape (steps, d)."""
        forces = np.empty((steps, weights.shape[1]))
        portion = max(1, SINGLE_THREADED // weights.size)
        for rows, activations in self.stepping_activations(
            begin, steps, step_fraction, alpha, starting=starting
        ):
            out = forces[rows]
            for first in range(0, len(out), portion):
                part = slice(first, first + portion)
                np.matmul(activations[part], weights, out=out[part])
        return forces


# Rollouts of one primitive repeat: most of their time would go into the same exponentials.
@lru_cache(maxsize=4)
def _stepping_activations(
    basis: Basis, begin: float, steps: int, h: float, alpha: float, starting: bool
) -> Floats:
    around = basis.activations(basis.phase.at(begin + np.arange(-1, steps + 1) * h))
    before, now, after = around[:-2], around[1:-1], around[2:]
    activations = now + (after - 2 * now + before + alpha * h / 2 * (after - before)) / 12
    if starting:
        activations[0] = now[0] + (after[0] - now[0]) / 3
    activations.flags.writeable = False
    return np.asarray(activations)
