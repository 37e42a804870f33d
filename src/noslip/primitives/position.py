"""Position as a movement primitive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from noslip._typing import Floats
from noslip.primitives.attractor import Attractor
from noslip.primitives.basis import Basis
from noslip.primitives.forcing import ForcingTerm


@dataclass(frozen=True, eq=False)
class PositionDMP:
    """``tau^2 p'' = alpha (beta (p_g - p) - tau p') + f_p(s)`` (the paper's eq. 1).

    There is no goal scaling: a new goal shifts the attractor, the learned force stays, so a goal
    equal to the start is like any other.

    Attributes
    ----------
    attractor : Attractor
    forcing : ForcingTerm
        In meters, time normalized by the duration.
    start, goal : array, shape (3,)
        Demonstrated, meters.
    start_velocity : array, shape (3,)
        Meters per duration.
    """

    attractor: Attractor
    forcing: ForcingTerm
    start: Floats
    goal: Floats
    start_velocity: Floats

    @classmethod
    def fit(
        cls,
        attractor: Attractor,
        basis: Basis,
        positions: Sequence[Floats],
        *,
        ridge: float = 1e-6,
    ) -> PositionDMP:
        """Learn from demonstrations sampled uniformly over the motion.

        Parameters
        ----------
        positions : sequence of arrays, shape (N_i, 3)
            From the first sample of a demonstration to its last, meters.
        """
        forces = []
        for path in positions:
            fraction = 1.0 / (len(path) - 1)
            target = attractor.demonstrated_target(path, np.diff(path, axis=0) / fraction, fraction)
            forces.append(attractor.stiffness * (target - path[-1]))
        forcing = ForcingTerm.fit(basis, attractor.alpha, forces, ridge=ridge)
        starts = []
        for path in positions:
            fraction = 1.0 / (len(path) - 1)
            force = forcing.at_start(fraction, attractor.alpha)
            pull = path[-1] + force / attractor.stiffness - path[0]
            first = (path[1] - path[0]) / fraction
            starts.append(attractor.demonstrated_start(pull, first, fraction))
        return cls(
            attractor,
            forcing,
            np.mean([path[0] for path in positions], axis=0),
            np.mean([path[-1] for path in positions], axis=0),
            np.mean(starts, axis=0),
        )
