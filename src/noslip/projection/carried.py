"""Paths of tools that joints carry: what leading a tool from its path costs its joints."""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.space import Space


class ToolPaths:
    """``w sum_k |p(x_k) - p_ref,k|^2 / (2 L^2)`` as a quadratic form in the joints' displacements.

    Of each tool's path L is the length.  The form is that about the joints that it was last taken
    at (Gauss-Newton), so that where iterations end, which take it again, it has the sum's slope.

    Parameters
    ----------
    space : Space
    reference : array, shape (N, n)
        Of the joints.

    Attributes
    ----------
    places : array, shape (c, N, 3)
        Of the tools, along the reference (m).
    lengths : array, shape (c,)
        Of their paths (m); 1 of one that stays.
    lever : float
        Mean square of what a tool moves by with a joint, over the square of its path's length.
    """

    def __init__(self, space: Space, reference: Floats) -> None:
        self._space, self._reference = space, reference
        self.places, slopes = space.carried(reference)
        lengths = np.linalg.norm(np.diff(self.places, axis=1), axis=2).sum(axis=1)
        self.lengths = np.where(lengths > 0, lengths, 1.0)
        self.lever = float(np.square(slopes / self._over).mean()) * 3 if len(slopes) else 0.0

    @property
    def _over(self) -> Floats:
        return self.lengths[:, None, None, None]

    def form(self, displacements: Floats) -> tuple[Floats, Floats]:
        """Second derivatives, shape (N, n, n), and the slope at no displacement, shape (N, n).

        Parameters
        ----------
        displacements : array, shape (N, n)
            Of the joints, about which.
        """
        places, slopes = self._space.carried(self._reference + displacements)
        slopes = slopes / self._over
        away = (places - self.places) / self.lengths[:, None, None]
        metric = np.einsum("ckij,ckil->kjl", slopes, slopes)
        there = np.einsum("kij,kj->ki", metric, displacements)
        return metric, np.einsum("ckij,cki->kj", slopes, away) - there
