"""The paper's numerical example (its section IV-A)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from noslip.constraints.blade import Blade
from noslip.learning import learn
from noslip.merit import FiguresOfMerit, figures_of_merit
from noslip.primitive import ConstrainedDMP
from noslip.trajectory import PoseTrajectory

SAMPLES = 1000
"""Of the demonstration: the paper's second at its time step."""
TIME_STEP = 1e-3
"""The paper's (s)."""
CONSTRAINT = Blade()
"""The one the example is about."""


def demonstration() -> PoseTrajectory:
    """Return the demonstration: a planar contour, traced with the wrong yaw.

    ``x = sin^2(pi t)``, ``y = sin^3(pi t / 2)``, ``z = 0``; roll 0, pitch pi/4 and yaw
    ``atan2(y, x)`` (extrinsic xyz), 1000 samples of 1 ms.  The paper prints the arguments of atan2
    the other way round, which contradicts its figure.
    """
    t = np.arange(SAMPLES, dtype=np.float64) * TIME_STEP
    x, y = np.sin(np.pi * t) ** 2, np.sin(np.pi * t / 2) ** 3
    angles = np.column_stack([0 * t, np.full_like(t, np.pi / 4), np.arctan2(y, x)])
    return PoseTrajectory(
        times=t,
        positions=np.column_stack([x, y, 0 * t]),
        rotations=Rotation.from_euler("xyz", angles),
        name="demonstration",
    )


@dataclass(frozen=True, eq=False)
class NumericalExample:
    """The learned primitive and the four motions that the paper compares."""

    primitive: ConstrainedDMP
    demonstration: PoseTrajectory

    @classmethod
    def run(cls) -> NumericalExample:
        """Learn from the demonstration; its motion ends where that one does."""
        recorded = demonstration()
        return cls(learn(recorded, [CONSTRAINT], end="position"), recorded)

    @cached_property
    def motions(self) -> dict[str, PoseTrajectory]:
        """Demonstration, regular DMP, constrained DMP, and with optimized orientation."""
        return {
            "demonstration": self.demonstration,
            "regular": self.primitive.regular.rollout(),
            "constrained": self.primitive.constrained.rollout(),
            "optimized": self.primitive.rollout(),
        }

    @cached_property
    def merits(self) -> dict[str, FiguresOfMerit]:
        """Each motion against the demonstration."""
        return {
            name: figures_of_merit(motion, self.demonstration, [CONSTRAINT])
            for name, motion in self.motions.items()
        }
