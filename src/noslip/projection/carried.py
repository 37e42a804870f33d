"""Tools that joints carry: what leading them from their paths costs, and turning them there."""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.quaternions import turned, turns_between
from noslip.space import Space

_STEPS, _LARGEST = 12, 0.5
"""Of a first guess: steps, and the longest of them (rad); half of it turns a tool round."""
_PLACE, _DAMPING = 10.0, 1e-3
"""A tenth of a path's length that a tool is led from it counts as a radian that it lacks; and a
joint that turns by 30 rad does, so that what is redundant stays."""


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
        self._poses, slopes = space.carried(reference)
        self.places, slopes = self._poses[..., :3], slopes[..., :3, :]
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
        poses, slopes = self._space.carried(self._reference + displacements)
        slopes = slopes[..., :3, :] / self._over
        away = (poses[..., :3] - self.places) / self.lengths[:, None, None]
        metric = np.einsum("ckij,ckil->kjl", slopes, slopes)
        there = np.einsum("kij,kj->ki", metric, displacements)
        return metric, np.einsum("ckij,cki->kj", slopes, away) - there

    def turned(self, turns: Floats) -> Floats:
        """Displacements of the joints that turn the tools where they are, shape (N, n).

        The least ones (damped least squares), which nearly do; what no joint can, they leave.

        Parameters
        ----------
        turns : array, shape (c, N, 3)
            Rotation vectors of the tools, world frame (rad).
        """
        wanted = turned(turns, self._poses[..., 3:])
        displacements = np.zeros_like(self._reference)
        for _ in range(_STEPS):
            poses, slopes = self._space.carried(self._reference + displacements)
            away = (self.places - poses[..., :3]) / self.lengths[:, None, None]
            turn = turns_between(poses[..., 3:], wanted)
            slopes[..., :3, :] /= self._over
            rest = np.concatenate([_PLACE * away, turn], axis=-1)
            slopes[..., :3, :] *= _PLACE
            form = np.einsum("ckij,ckil->kjl", slopes, slopes) + _DAMPING * np.eye(slopes.shape[-1])
            pull = np.einsum("ckij,cki->kj", slopes, rest) - _DAMPING * displacements
            step = np.linalg.solve(form, pull[..., None])[..., 0]
            displacements += step * np.minimum(1.0, _LARGEST / np.abs(step).max(initial=_LARGEST))
        return displacements
