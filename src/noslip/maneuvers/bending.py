"""Arcs and straights in space, solved for where they lead.

Lengths are in radii: an arc that turns by an angle is as long as that angle.  A tool that moves
along x turns about any axis across it, the bend, a vector in the y-z plane (rad); about x it rolls,
which leaves its path's curvature alone.  A stretch that does both is a helix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noslip._typing import Floats

_SMALL = 1e-3
"""Turns (rad) below which sine and cosine over them are their series."""
_PROBE = 1e-7
"""Difference for derivatives; they only need to lead to the solution, which is exact."""
_LONGEST_STEP = 1.0
"""Of an iteration, radii and rad: beyond, the derivatives say little."""
_EXACT = 1e-13
"""Missed by less (radii, rad), a goal is reached."""
_SETTLING = 4
"""Last iterations, without shortening: enough from anywhere nearby."""
_HALF_TURN = 1e-2
"""1 + trace of a rotation, below which its error stops growing: it is a half turn off."""
_DAMPING = 1e-12
"""Against directions in which a goal cannot be approached, relative to the others."""


def poses(advances: Floats, turns: Floats) -> Floats:
    """Poses after stretches of constant twist along x, shape (N, 4, 4).

    The exponential of SE(3) in closed form (Murray, Li and Sastry 1994, eq. 2.36), as matrices.

    Parameters
    ----------
    advances : array, shape (N,)
        Ways along x.
    turns : array, shape (N, 3)
        Rotation vectors (rad).
    """
    x, y, z = turns.T
    once = np.zeros((len(turns), 3, 3))
    once[:, 0, 1], once[:, 0, 2], once[:, 1, 2] = -z, y, -x
    once[:, 1, 0], once[:, 2, 0], once[:, 2, 1] = z, -y, x
    twice = once @ once
    square = x * x + y * y + z * z
    small = square < _SMALL**2
    angle = np.where(small, 1.0, np.sqrt(square))
    sine = np.where(small, 1 - square / 6, np.sin(angle) / angle)
    versine = np.where(small, 0.5 - square / 24, 2 * (np.sin(angle / 2) / angle) ** 2)
    rest = np.where(small, 1 / 6 - square / 120, (angle - np.sin(angle)) / angle**3)
    found = np.zeros((len(turns), 4, 4))
    found[:, :3, :3] = np.eye(3) + sine[:, None, None] * once + versine[:, None, None] * twice
    found[:, :3, 3] = advances[:, None] * (
        [1.0, 0.0, 0.0] + versine[:, None] * once[:, :, 0] + rest[:, None] * twice[:, :, 0]
    )
    found[:, 3, 3] = 1
    return found


@dataclass(frozen=True)
class Sequence:
    """A sequence of arcs, with one straight or none between them.

    Parameters, shape (K, size), are the bends of the arcs, two each; the roll of the whole; and the
    whole length, where there is a straight.

    Attributes
    ----------
    stretches : str
        Such as "CSC": C for an arc, S for the straight.
    """

    stretches: str

    def arcs(self, parameters: Floats) -> Floats:
        """How far each arc turns (rad), and thus how long it is, shape (K, arcs)."""
        bends = self._bends(parameters)
        return np.hypot(bends[..., 0], bends[..., 1])

    def length(self, parameters: Floats) -> Floats:
        """Of the whole, shape (K,)."""
        if "S" in self.stretches:
            return np.asarray(parameters[:, -1])
        return np.asarray(self.arcs(parameters).sum(axis=1))

    def straight(self, parameters: Floats) -> Floats:
        """Length of the straight, shape (K,)."""
        return np.asarray(self.length(parameters) - self.arcs(parameters).sum(axis=1))

    def roll(self, parameters: Floats) -> Floats:
        """Of the whole (rad), shape (K,)."""
        return parameters[:, 2 * self.stretches.count("C")]

    def twists(self, parameters: Floats, spread: float) -> Floats:
        """Advance and rotation vector of each stretch, shape (K, stretches, 4).

        Parameters
        ----------
        parameters : array, shape (K, size)
        spread : float
            Part of the roll that is spread over the whole length; the rest is the straight's.
        """
        curved = np.array([each == "C" for each in self.stretches])
        arcs, roll, length = (each(parameters) for each in (self.arcs, self.roll, self.length))
        found = np.zeros((len(parameters), len(curved), 4))
        found[:, curved, 0] = arcs
        found[:, curved, 2:] = self._bends(parameters)
        found[:, ~curved, 0] = self.straight(parameters)[:, None]
        found[..., 1] = (spread * roll / np.maximum(length, _SMALL))[:, None] * found[..., 0]
        # All that is left, also where the length is next to none.
        found[:, ~curved, 1] = (roll - found[:, curved, 1].sum(axis=1))[:, None]
        return found

    def _bends(self, parameters: Floats) -> Floats:
        arcs = self.stretches.count("C")
        return parameters[:, : 2 * arcs].reshape(-1, arcs, 2)

    def end(self, parameters: Floats, spread: float) -> Floats:
        """Where it leads, shape (K, 4, 4)."""
        twists = self.twists(parameters, spread)
        each = poses(twists[..., 0].ravel(), twists[..., 1:].reshape(-1, 3))
        each = each.reshape(*twists.shape[:2], 4, 4)
        found = each[:, 0]
        for k in range(1, twists.shape[1]):
            found = found @ each[:, k]
        return found

    def _missed(self, parameters: Floats, spread: float, goal: Floats) -> Floats:
        """What is left to the goal, shape (K, 6): position, and rotation."""
        end = seen_from(goal) @ self.end(parameters, spread)
        trace = 1 + end[:, 0, 0] + end[:, 1, 1] + end[:, 2, 2]
        skew = [
            end[:, 2, 1] - end[:, 1, 2],
            end[:, 0, 2] - end[:, 2, 0],
            end[:, 1, 0] - end[:, 0, 1],
        ]
        turn = 2 * np.stack(skew, axis=1) / np.maximum(trace, _HALF_TURN)[:, None]
        return np.concatenate([end[:, :3, 3], turn], axis=1)

    def solved(
        self,
        parameters: Floats,
        spread: float,
        goal: Floats,
        iterations: int,
        shortening: float = 0.0,
    ) -> tuple[Floats, Floats]:
        """Newton's method, on all starts at once; where there is a choice, the least change.

        Parameters
        ----------
        parameters : array, shape (K, size)
            Starts.
        spread : float
            See :meth:`twists`.
        goal : array, shape (4, 4)
        iterations : int
        shortening : float
            Step along what leaves the end alone and makes the whole shorter, in each but the last 4
            iterations.

        Returns
        -------
        parameters : array, shape (K, size)
        missed : array, shape (K,)
            By how much the goal is missed: the largest of position and the rotation's matrix.
        """
        number, size = parameters.shape
        probes = np.vstack([np.zeros(size), _PROBE * np.eye(size)])
        for left in range(iterations, 0, -1):
            probed = (parameters[:, None] + probes).reshape(-1, size)
            values = self._missed(probed, spread, goal).reshape(number, -1, 6)
            missed = values[:, 0]
            if not shortening and np.abs(missed).max(initial=0) < _EXACT:
                break
            transposed = (values[:, 1:] - missed[:, None]) / _PROBE
            jacobian = np.swapaxes(transposed, 1, 2)
            square = jacobian @ transposed
            damping = _DAMPING * (1 + np.trace(square, axis1=1, axis2=2))
            square += damping[:, None, None] * np.eye(6)
            wanted = missed[..., None]
            downhill = np.zeros_like(parameters)
            if shortening and left > _SETTLING:
                downhill[:] = shortening * self._lengthening(parameters)
                wanted = wanted - jacobian @ downhill[..., None]
            step = -(transposed @ np.linalg.solve(square, wanted))[..., 0] - downhill
            size_of_step = np.sqrt(np.sum(step**2, axis=1, keepdims=True))
            parameters = parameters + step / np.maximum(1, size_of_step / _LONGEST_STEP)
        end = self.end(parameters, spread)
        apart = np.abs(end - goal).max(axis=(1, 2), initial=0)
        return parameters, apart

    def _lengthening(self, parameters: Floats) -> Floats:
        """Derivative of the length, where there is no straight."""
        found = np.zeros_like(parameters)
        arcs = self.arcs(parameters)[..., None]
        unit = self._bends(parameters) / np.maximum(arcs, _SMALL)
        found[:, : 2 * arcs.shape[1]] = unit.reshape(len(parameters), -1)
        return found


def seen_from(pose: Floats) -> Floats:
    """Inverse of a pose, shape (4, 4)."""
    found = np.eye(4)
    found[:3, :3] = pose[:3, :3].T
    found[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return found
