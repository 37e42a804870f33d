"""Long recordings whose true cuts are known."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from motions import eased
from noslip.demonstrations.excision import (
    NOISE_POSITION,
    NOISE_ROTATION,
    OUTLIER,
    RATE,
    _draw,
    synthetic_excisions,
)
from noslip.trajectory import PoseTrajectory

BEGIN = 5.0


def excision_session(seed: int, noise: float = 1.0) -> tuple[PoseTrajectory, np.ndarray]:
    """Return eight excisions joined by pause, way back and pause, and when each truly moves.

    The tracker's noise is multiplied by ``noise``.
    """
    rng = np.random.default_rng([seed, 1])
    positions: list[np.ndarray] = []
    quaternions: list[np.ndarray] = []
    true: list[tuple[float, float]] = []
    for number, cut in enumerate(synthetic_excisions(seed=seed)):
        if positions:
            ends = Rotation.concatenate([Rotation.from_quat(quaternions[-1][-1]), cut.rotations[0]])
            from_here, to_there = positions[-1][-1], cut.positions[0]
            pause = [np.full(int(rng.uniform(0.3, 1.0) * RATE), value) for value in (0.0, 1.0)]
            u = np.linspace(0, 1, int(rng.uniform(0.8, 1.4) * RATE))
            s = np.concatenate([pause[0], eased(u), pause[1]])
            lift = np.outer(0.12 * s * (1 - s), [0, 0, 1])
            positions.append(from_here + np.outer(s, to_there - from_here) + lift)
            quaternions.append(Slerp([0, 1], ends)(s).as_quat())
            positions[-1] += NOISE_POSITION * rng.standard_normal(positions[-1].shape)
        excision = _draw(np.random.default_rng([seed, number]), outlier=number % 8 == OUTLIER)
        start = BEGIN + sum(map(len, positions)) / RATE + excision.rest_before
        true.append((start, start + excision.duration))
        positions.append(cut.positions)
        quaternions.append(cut.rotations.as_quat())
    path = np.concatenate(positions)
    more = np.sqrt(noise**2 - 1)
    turn = Rotation.from_rotvec(more * NOISE_ROTATION * rng.standard_normal(path.shape))
    session = PoseTrajectory(
        times=BEGIN + np.arange(len(path)) / RATE,
        positions=path + more * NOISE_POSITION * rng.standard_normal(path.shape),
        rotations=turn * Rotation.from_quat(np.concatenate(quaternions)),
        name="session",
    )
    return session, np.array(true)
