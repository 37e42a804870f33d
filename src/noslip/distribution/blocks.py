"""A banded matrix, factorized in blocks, for many right-hand sides at once."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from noslip._typing import Floats
from noslip.distribution.kernels import Kernels
from noslip.projection.band import Band

STAGES = 6
"""Samples of a block: fewer are slower for their number, more for their size."""


class Blocks:
    """A banded matrix, factorized in blocks of several stages, for many right-hand sides at once.

    As ``L D U`` of a block-tridiagonal matrix: products of small matrices, which take a quarter of
    the time of LAPACK's triangular solutions with a band.  A block's own pivots are all there are;
    what rounding that costs, the iteration makes up for.

    Parameters
    ----------
    band : Band
    kernels : Kernels, optional
        That solve, instead of NumPy.
    """

    def __init__(self, band: Band, kernels: Kernels | None = None) -> None:
        self._kernels = kernels
        # What is compiled has no price a call: the fewest that reach no further than the next.
        stages = STAGES if kernels is None else -(-band.width // band.stage)
        self._size, self._width = stages * band.stage, band.width
        self._count = band.count * band.stage
        size, width = self._size, self._width
        self._inverses: list[Floats] = []
        self._lower: list[Floats] = []
        self._upper: list[Floats] = []
        for first in range(0, self._count, size):
            last = min(first + size, self._count)
            block = _part(band, first, last, first, last)
            if first:
                reach = min(first + width, last)
                below = _part(band, first, reach, first - width, first)
                above = _part(band, first - width, first, first, reach)
                before = self._inverses[-1]
                block[: reach - first, : reach - first] -= below @ before[-width:, -width:] @ above
                self._lower.append(below)
                self._upper.append(before[:, -width:] @ above)
            self._inverses.append(_inverse(block))

    @property
    def is_finite(self) -> bool:
        """Whether there is a solution."""
        return all(np.isfinite(each).all() for each in self._inverses)

    @cached_property
    def _packed(self) -> tuple[Floats, Floats, Floats]:
        """Inverses, lower and upper blocks, each of one size; what has none is zero."""
        count, size, width = len(self._inverses), self._size, self._width
        found = (
            np.zeros((count, size, size)),
            np.zeros((count, width, width)),
            np.zeros((count, size, width)),
        )
        for array, parts, first in zip(
            found, (self._inverses, self._lower, self._upper), (0, 1, 0), strict=True
        ):
            for k, part in enumerate(parts, start=first):
                array[k, : len(part), : part.shape[1]] = part
        return found

    @property
    def rows(self) -> int:
        """Unknowns, and as many more as fill the last block."""
        return len(self._inverses) * self._size

    def solve(self, right: Floats) -> None:
        """Solve in place, right-hand sides of shape (:attr:`rows`, S); zero where none is."""
        size, width, last = self._size, self._width, len(self._inverses) - 1
        if self._kernels is not None:
            self._kernels.solve(*self._packed, right)
            return
        right = right[: self._count]
        for k, inverse in enumerate(self._inverses):
            first = k * size
            block = right[first : first + size]
            if k:
                lower = self._lower[k - 1]
                block[: len(lower)] -= lower @ right[first - width : first]
            right[first : first + size] = inverse @ block
        for k in range(last - 1, -1, -1):
            first, upper = (k + 1) * size, self._upper[k]
            right[k * size : first] -= upper @ right[first : first + upper.shape[1]]


def _part(band: Band, top: int, bottom: int, left: int, right: int) -> Floats:
    """Entries of a band as a dense matrix."""
    rows, columns = np.arange(top, bottom)[:, None], np.arange(left, right)
    inside = np.abs(rows - columns) <= band.width
    found = np.zeros(inside.shape)
    at = np.broadcast_to(2 * band.width + rows - columns, inside.shape)[inside]
    found[inside] = band.storage[at, np.broadcast_to(columns, inside.shape)[inside]]
    return found


def _inverse(block: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.inv(block), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(block, np.nan)
