"""Long recordings whose true cuts are known."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from noslip.demonstrations.excision import NOISE_POSITION, NOISE_ROTATION, synthetic_session
from noslip.trajectory import PoseTrajectory


def excision_session(seed: int, noise: float = 1.0) -> tuple[PoseTrajectory, np.ndarray]:
    """Return eight excisions in one recording, and when each truly moves.

    The tracker's noise is multiplied by ``noise``.
    """
    session, rng = synthetic_session(seed=seed), np.random.default_rng([seed, 2])
    recording, more = session.recording, np.sqrt(noise**2 - 1)
    shape = recording.positions.shape
    turn = Rotation.from_rotvec(more * NOISE_ROTATION * rng.standard_normal(shape))
    return (
        PoseTrajectory(
            times=recording.times,
            positions=recording.positions + more * NOISE_POSITION * rng.standard_normal(shape),
            rotations=turn * recording.rotations,
            name=recording.name,
        ),
        session.cuts,
    )
