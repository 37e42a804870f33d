"""Synthetic recordings in files: short cuts, each another way, none of which the blade allows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory

SAMPLES = 200
DURATION = 2.0


def recording(number: int, samples: int = SAMPLES) -> PoseTrajectory:
    """Return a planar cut of about 0.1 m in 2 s that slips a little; the number is the seed."""
    random = np.random.default_rng(number)
    times = np.linspace(0.0, DURATION, samples)
    bend, turned, slip = random.uniform([0.3, -1.0, 0.05], [0.8, 1.0, 0.2])
    heading = turned + bend * np.sin(np.pi * times / DURATION)
    speed = 0.05 * (1 + 0.3 * np.sin(2 * np.pi * times / DURATION + random.uniform(0, 6)))
    velocities = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading), 0 * times])
    return PoseTrajectory(
        times=times,
        positions=np.cumsum(velocities, axis=0) * (times[1] - times[0]),
        rotations=Rotation.from_euler("z", heading + slip * np.sin(3 * times)),
        name=f"cut_{number:05}",
    )


def write_recordings(folder: Path, count: int, samples: int = SAMPLES) -> list[Path]:
    """Write recordings as CSV, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    return [recording(k, samples).to_csv(folder / f"cut_{k:05}.csv") for k in range(count)]
