"""The demonstration that everything is measured on: the paper's numerical example."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory

SAMPLES = 1000
DURATION = 0.999
"""From 0 s to 0.999 s: 1000 samples are 1 ms apart."""
BASIS_FUNCTIONS = 100
ALPHA, BETA, ALPHA_S = 25.0, 6.25, 1.0
"""The paper's constants, for its method and for noslip; movement-primitives' phase is its own."""
MOVED_GOAL = (-0.2, 1.0, 0.0)
"""The goal 0.2 m aside, along the blade's y axis as demonstrated."""


def demonstration(samples: int = SAMPLES, duration: float = DURATION) -> PoseTrajectory:
    """Return the example up to a time (s), its path the same at any number of samples.

    Its yaw is ``atan2(y, x)``: the argument order printed in the paper contradicts its own figure.
    """
    times = np.linspace(0.0, duration, samples)
    x, y = np.sin(np.pi * times) ** 2, np.sin(np.pi * times / 2) ** 3
    zeros = np.zeros(samples)
    angles = np.column_stack([zeros, zeros + np.pi / 4, np.arctan2(y, x)])
    return PoseTrajectory(
        times=times,
        positions=np.column_stack([x, y, zeros]),
        rotations=Rotation.from_euler("xyz", angles),
        name="numerical example",
    )
