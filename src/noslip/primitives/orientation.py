"""Orientation as a movement primitive on SO(3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.primitives.attractor import Attractor
from noslip.primitives.basis import Basis
from noslip.primitives.forcing import ForcingTerm
from noslip.primitives.winding import Winding
from noslip.trajectory import continuous_quaternions


@dataclass(frozen=True, eq=False)
class OrientationDMP:
    """``tau^2 w' = alpha (beta Log(R_g R^T) - tau w) + f_q(s)`` (the paper's eq. 4).

    Attributes
    ----------
    attractor : Attractor
    forcing : ForcingTerm
        In radians, time normalized by the duration, world frame.
    start_quaternion : array, shape (4,)
        (qw, qx, qy, qz).  Kept as numbers, since SciPy's rotations change their last bits when
        they are written and read.
    winding : Winding
        R_g, or what leads to it where the demonstration turns beyond half a turn.
    start_velocity : array, shape (3,)
        Angular velocity, radians per duration, world frame.
    """

    attractor: Attractor
    forcing: ForcingTerm
    start_quaternion: Floats
    winding: Winding
    start_velocity: Floats

    @classmethod
    def fit(
        cls,
        attractor: Attractor,
        basis: Basis,
        rotations: Sequence[Rotation],
        *,
        ridge: float = 1e-6,
    ) -> OrientationDMP:
        """Learn from demonstrations sampled uniformly over the motion.

        Parameters
        ----------
        rotations : sequence of Rotation, length N_i
        """
        goal = _mean([turning[-1] for turning in rotations])
        farthest = max(rotations, key=lambda r: float((r[-1] * r.inv()).magnitude().max()))
        winding = Winding.around(farthest * (farthest[-1].inv() * goal))
        forces = []
        for turning in rotations:
            count = len(turning)
            fraction = 1.0 / (count - 1)
            steps = (turning[1:] * turning[:-1].inv()).as_rotvec() / fraction
            leading = winding.at(np.arange(1, count - 1) * fraction, turning[-1])
            error = (leading * turning[1:-1].inv()).as_rotvec()
            # The inverse step wants targets; rotations have them relative to the sample itself.
            pull = attractor.demonstrated_target(np.zeros((count, 3)), steps, fraction)
            forces.append(attractor.stiffness * (pull - error))
        forcing = ForcingTerm.fit(basis, attractor.alpha, forces, ridge=ridge)
        starts = []
        for turning in rotations:
            fraction = 1.0 / (len(turning) - 1)
            leading = winding.at(np.zeros(1), turning[-1])[0]
            force = forcing.at_start(fraction, attractor.alpha)
            pull = (leading * turning[0].inv()).as_rotvec() + force / attractor.stiffness
            first = (turning[1] * turning[0].inv()).as_rotvec() / fraction
            starts.append(attractor.demonstrated_start(pull, first, fraction))
        start = _mean([turning[0] for turning in rotations])
        return cls(
            attractor,
            forcing,
            start.as_quat(scalar_first=True),
            winding,
            np.mean(starts, axis=0),
        )

    @cached_property
    def start(self) -> Rotation:
        """Where the demonstrations begin (mean)."""
        return Rotation.from_quat(self.start_quaternion, scalar_first=True)

    @property
    def goal(self) -> Rotation:
        """Where the demonstrations end (mean)."""
        return self.winding.goal

    def turned(self, turn: Rotation) -> OrientationDMP:
        """Return the primitive of the motion ``turn R(t)``, all of it turned in the world frame."""
        knots = turn * Rotation.from_quat(self.winding.quaternions, scalar_first=True)
        matrix = turn.as_matrix()
        return replace(
            self,
            forcing=ForcingTerm(self.forcing.basis, self.forcing.weights @ matrix.T),
            start_quaternion=(turn * self.start).as_quat(scalar_first=True),
            winding=Winding(continuous_quaternions(knots)),
            start_velocity=matrix @ self.start_velocity,
        )

    def moved(self, start: Rotation, goal: Rotation) -> OrientationDMP:
        """Return the primitive with another start and goal; the learned force stays."""
        turn = self.goal.inv() * goal
        knots = Rotation.from_quat(self.winding.quaternions, scalar_first=True) * turn
        return replace(
            self,
            start_quaternion=start.as_quat(scalar_first=True),
            winding=Winding(continuous_quaternions(knots)),
        )


def _mean(rotations: Sequence[Rotation]) -> Rotation:
    """Mean rotation; of one, that one to the last bit."""
    return Rotation.concatenate(rotations).mean() if len(rotations) > 1 else rotations[0]
