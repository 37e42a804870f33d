"""Radial basis functions of the phase."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from noslip._typing import Floats
from noslip.law.attractor import Attractor
from noslip.law.clock import Clock, Phase

CACHED = 2048
"""Steps whose activations are kept together."""
NEARBY = 64
"""Phases for which the functions that matter are chosen together."""


@dataclass(frozen=True)
class Basis:
    """Normalized basis functions of a clock, spaced evenly in time.

    Of one that runs down they are Gaussians of the phase (and so spaced geometrically in it).  Each
    is as wide (one standard deviation) as its distance to the next center: any smooth force is then
    matched to about 1e-6 of the path with 100 functions.
    """

    count: int = 100
    phase: Clock = Phase()  # noqa: RUF009 - immutable

    @cached_property
    def centers(self) -> Floats:
        """Centers in phase, shape (count,)."""
        return self.phase.centers(self.count)

    @cached_property
    def widths(self) -> Floats:
        """Standard deviations in phase, shape (count,)."""
        return self.phase.widths(self.centers)

    def activations(self, phases: Floats) -> Floats:
        """``psi_i(s) s / sum psi(s)`` of eq. 3, shape (N, count)."""
        found = np.zeros((len(phases), self.count))
        for first in range(0, len(phases), NEARBY):
            rows = slice(first, first + NEARBY)
            columns, near = self._near(phases[rows])
            found[rows, columns] = near
        return found

    def _near(self, phases: Floats) -> tuple[slice, Floats]:
        """Activations of the functions that matter at these phases, and which those are."""
        return self.phase.near(phases, self.centers, self.widths)

    def stepping_activations(
        self, begin: float, steps: int, step_fraction: float, attractor: Attractor, before: float
    ) -> Iterator[tuple[slice, slice, Floats]]:
        """Activations as the steps of an attractor want them, in blocks.

        A step treats its target as constant.  What that leaves out
        (:meth:`noslip.law.attractor.Attractor.led_by`) is added here by central differences.
        It makes long steps about twenty times more accurate.

        Parameters
        ----------
        begin : float
            Fraction of the duration at which the first step begins.
        steps : int
        step_fraction : float
            ``dt / tau``.
        attractor : Attractor
        before : float
            The step before the first one; 0 at the start of the motion.

        Yields
        ------
        slice
            The steps of this block.
        slice
            The functions that matter in it.
        array, shape (steps in the block, functions that matter)
        """
        for first in range(0, steps, CACHED):
            size = min(CACHED, steps - first)
            at = begin + first * step_fraction
            blocks = _stepping_activations(
                self, at, size, step_fraction, attractor, step_fraction if first else before
            )
            for rows, columns, activations in blocks:
                yield slice(first + rows.start, first + rows.stop), columns, activations

    def stepping_forces(
        self,
        begin: float,
        steps: int,
        step_fraction: float,
        attractor: Attractor,
        before: float,
        weights: Floats,
    ) -> Floats:
        """Product of :meth:`stepping_activations` with weights, shape (steps, d)."""
        forces = np.empty((steps, weights.shape[1]))
        for rows, columns, activations in self.stepping_activations(
            begin, steps, step_fraction, attractor, before
        ):
            np.matmul(activations, weights[columns], out=forces[rows])
        return forces


# Rollouts of one primitive repeat: most of their time would go into the same exponentials.
@lru_cache(maxsize=16)
def _stepping_activations(
    basis: Basis, begin: float, steps: int, h: float, attractor: Attractor, earlier: float
) -> list[tuple[slice, slice, Floats]]:
    phases = basis.phase.at(begin + np.arange(-1, steps + 1) * h)
    change, bend = attractor.led_by(h, h)
    blocks = []
    for first in range(0, steps, NEARBY):
        rows = slice(first, min(first + NEARBY, steps))
        columns, around = basis._near(phases[rows.start : rows.stop + 2])
        before, now, after = around[:-2], around[1:-1], around[2:]
        changed, bent = (after - before) / 2, after - 2 * now + before
        found = now + change * changed + bend * bent
        if first == 0 and earlier != h:
            other = attractor.led_by(earlier, h)
            found[0] = now[0] + other[0] * changed[0] + other[1] * bent[0]
        found.flags.writeable = False
        blocks.append((rows, columns, found))
    return blocks
