"""A banded matrix of stages, in a row or in a ring, and its solution by LAPACK."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbsv

from noslip._typing import Floats


class Band:
    """A banded matrix of stages, in LAPACK's layout.

    Entry (i, j) of stages k and k + s stands at row ``2 w + i - j - s n`` and column
    ``(k + s) n + j``, with n unknowns a stage and w = 2 n diagonals on either side; a few more
    where entries two stages apart are not on a block's diagonal alone.
    """

    def __init__(self, count: int, stage: int, more: int) -> None:
        self.count, self.stage, self.width = count, stage, 2 * stage + more
        self.storage = np.zeros((3 * self.width + 1, count * stage), order="F")
        self.view = self.storage.reshape((-1, stage, count), order="F")

    def add(self, shift: int, i: int, j: int, values: Floats) -> None:
        """Add ``values[k]`` at (stage k, i) x (stage k + shift, j)."""
        first, last = max(0, -shift), self.count - max(0, shift)
        self.entries(shift, i, j)[:] += values[first:last]

    def entries(self, shift: int, i: int, j: int) -> Floats:
        """Entries (stage k, i) x (stage k + shift, j), of the stages k that have such."""
        first, last = max(0, -shift), self.count - max(0, shift)
        row = 2 * self.width + i - j - shift * self.stage
        return self.view[row, j, first + shift : last + shift]

    def add_transposed(self, shift: int, i: int, j: int, values: Floats) -> None:
        """Add ``values[k]`` at (stage k + shift, j) x (stage k, i)."""
        row = 2 * self.width + j - i + shift * self.stage
        first, last = max(0, -shift), self.count - max(0, shift)
        self.view[row, i, first:last] += values[first:last]

    def add_between(self, a: int, i: int, b: int, j: int, values: Floats) -> None:
        """Add ``values[k]`` at (stage k + a, i) x (stage k + b, j), with a and b from -1 to 1."""
        row = 2 * self.width + i - j - (b - a) * self.stage
        first, last = max(0, -a, -b), self.count - max(0, a, b)
        self.view[row, j, first + b : last + b] += values[first:last]

    def add_bending(self, j: int, strength: float) -> None:
        """Add ``strength * D^T D`` of the second differences of unknown j."""
        diagonal, beside = np.full(self.count, 6.0), np.full(self.count, -4.0)
        diagonal[[0, -1]], diagonal[[1, -2]] = 1.0, 5.0
        beside[[0, -2]] = -2.0
        self.add(0, j, j, strength * diagonal)
        self.add(1, j, j, strength * beside)
        self.add_transposed(1, j, j, strength * beside)
        apart = np.full(self.count, strength)
        self.add(2, j, j, apart)
        self.add(-2, j, j, apart)

    def add_slope(self, j: int, strengths: Floats) -> None:
        """Add ``D^T diag(strengths) D`` of the first differences of unknown j, shape (N - 1,)."""
        self.add(0, j, j, np.append(strengths, 0.0) + np.append(0.0, strengths))
        beside = np.append(-strengths, 0.0)
        self.add(1, j, j, beside)
        self.add_transposed(1, j, j, beside)

    def fix(self, k: int, j: int) -> None:
        """Make unknown j of stage k stay as it is."""
        column = k * self.stage + j
        low, high = (
            max(0, column - self.width),
            min(self.count * self.stage, column + self.width + 1),
        )
        others = np.arange(low, high)
        self.storage[2 * self.width + column - others, others] = 0.0
        self.storage[2 * self.width + others - column, column] = 0.0
        self.storage[2 * self.width, column] = 1.0

    def solve(self, right: Floats) -> Floats:
        _, _, solution, info = dgbsv(
            self.width, self.width, self.storage, right, overwrite_ab=True, overwrite_b=True
        )
        return solution if info == 0 else np.full_like(right, np.nan)


class Ring(Band):
    """A matrix of stages of which the last is beside the first.

    The ring is folded, stages 0, N - 1, 1, N - 2, ... in a row: neighbors are two apart at most, so
    the band is twice as wide, and there are no corners.  (A band with two stages set apart as a
    border takes 1.2 to 1.3 times as long: it has as many right sides more as the border is wide.)
    """

    def __init__(self, count: int, stage: int, more: int) -> None:
        super().__init__(count, stage, 2 * stage + more)
        stages = np.arange(count)
        self._folded = np.where(2 * stages < count, 2 * stages, 2 * (count - stages) - 1)

    def _place(self, a: int, i: int, b: int, j: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        rows, columns = (
            np.roll(self._folded, -shift) * self.stage + entry for shift, entry in ((a, i), (b, j))
        )
        return 2 * self.width + rows - columns, columns

    def add(self, shift: int, i: int, j: int, values: Floats) -> None:
        self.storage[self._place(0, i, shift, j)] += values

    def entries(self, shift: int, i: int, j: int) -> Floats:
        return np.asarray(self.storage[self._place(0, i, shift, j)])

    def add_transposed(self, shift: int, i: int, j: int, values: Floats) -> None:
        self.storage[self._place(shift, j, 0, i)] += values

    def add_between(self, a: int, i: int, b: int, j: int, values: Floats) -> None:
        self.storage[self._place(a, i, b, j)] += values

    def add_bending(self, j: int, strength: float) -> None:
        for shift, share in ((-2, 1.0), (-1, -4.0), (0, 6.0), (1, -4.0), (2, 1.0)):
            self.add(shift, j, j, np.full(self.count, strength * share))

    def add_slope(self, j: int, strengths: Floats) -> None:
        """As in a row, shape (N,); the first is that of the step from the last stage."""
        self.add(0, j, j, strengths + np.roll(strengths, -1))
        self.add(-1, j, j, -strengths)
        self.add(1, j, j, -np.roll(strengths, -1))

    def fix(self, k: int, j: int) -> None:
        super().fix(int(self._folded[k]), j)

    def solve(self, right: Floats) -> Floats:
        folded = np.empty((self.count, self.stage))
        folded[self._folded] = right.reshape(folded.shape)
        return super().solve(folded.ravel()).reshape(folded.shape)[self._folded].ravel()
