"""The learned part of a movement primitive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis

RIDGE = 1e-6
"""Regularization, relative to the basis functions' mean square: it keeps those apart that few
samples tell from each other, and costs no precision that is seen."""


@dataclass(frozen=True, eq=False)
class ForcingTerm(Value):
    """``f(s) = sum psi_i(s) theta_i s / sum psi_i(s)`` (the paper's eq. 3).

    Parameters
    ----------
    basis : Basis
    weights : array, shape (basis.count, d)
        theta, one column a dimension; meters or radians (time normalized by the duration).
    """

    basis: Basis
    weights: Floats

    def __post_init__(self) -> None:
        # In C order: sums over another layout differ in their last bits.
        weights = np.array(self.weights, dtype=np.float64, order="C")
        if weights.ndim != 2 or weights.shape[0] != self.basis.count:
            raise InputError(
                f"forcing term: weights have shape {weights.shape}, expected "
                f"({self.basis.count}, dimensions)"
            )
        if not np.all(np.isfinite(weights)):
            raise InputError("forcing term: a weight is not finite")
        weights.flags.writeable = False
        object.__setattr__(self, "weights", weights)

    def at_start(self, fraction: float, attractor: Attractor) -> Floats:
        """Force in the half kick of a first step of a fraction of the duration, shape (d,)."""
        forces = self.basis.stepping_forces(0.0, 1, fraction, attractor, 0.0, self.weights)
        return np.asarray(forces[0])

    def __call__(self, phases: Floats) -> Floats:
        """Force at each phase, shape (N, d)."""
        return self.basis.activations(np.atleast_1d(phases)) @ self.weights

    @classmethod
    def fit(
        cls, basis: Basis, attractor: Attractor, forces: Sequence[Floats], *, ridge: float = RIDGE
    ) -> ForcingTerm:
        """Fit the weights by ridge regression to one or several demonstrations' forces.

        Parameters
        ----------
        attractor : Attractor
        forces : sequence of arrays, shape (N_i, d)
            At those samples of each demonstration, evenly spaced over the motion, that the clock
            knows the force of (:meth:`noslip.law.clock.Phase.sampled`).
        ridge : float
            Relative to the mean diagonal of the normal matrix, so that it means the same for any
            number of samples.
        """
        normal = np.zeros((basis.count, basis.count))
        moment = np.zeros((basis.count, forces[0].shape[1]))
        for force in forces:
            begin, h = _sampled(basis, len(force))
            normal += _normal_matrix(basis, len(force), attractor)
            for rows, columns, activations in basis.stepping_activations(
                begin, len(force), h, attractor, h
            ):
                moment[columns] += activations.T @ force[rows]
        normal.flat[:: basis.count + 1] += ridge * np.trace(normal) / basis.count
        return cls(basis, cho_solve(cho_factor(normal), moment))


def _sampled(basis: Basis, count: int) -> tuple[float, float]:
    """Fraction at the first of so many samples whose force is known, and from each to the next."""
    steps = next(n for n in (count, count + 1) if basis.phase.sampled(n)[1] == count)
    h = 1.0 / steps
    return basis.phase.sampled(steps)[0] * h, h


# Position and orientation, projected or not, are all fitted on the same samples.
@lru_cache(maxsize=32)
def _normal_matrix(basis: Basis, steps: int, attractor: Attractor) -> Floats:
    begin, h = _sampled(basis, steps)
    normal = np.zeros((basis.count, basis.count))
    for _, columns, activations in basis.stepping_activations(begin, steps, h, attractor, h):
        normal[columns, columns] += activations.T @ activations
    normal.flags.writeable = False
    return normal
