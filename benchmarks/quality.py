"""How good a motion is, recomputed for every method from its positions and rotations alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noslip import PoseTrajectory


@dataclass(frozen=True)
class Quality:
    """What one method's motion does.

    Attributes
    ----------
    residual : float
        Largest ``|c(R_k+1) . (p_k+1 - p_k)| / dt`` (m/s), c the lateral axis.
    position_rms, position_end : float
        Distance to the demonstration (m), rms over the samples and at the last one.
    angular_speed, angular_acceleration : float
        Largest of the steps (rad/s, rad/s^2).
    """

    residual: float
    position_rms: float
    position_end: float
    angular_speed: float
    angular_acceleration: float

    @classmethod
    def of(cls, motion: PoseTrajectory, demonstration: PoseTrajectory) -> Quality:
        """Measure a motion sampled as the demonstration is."""
        if len(motion) != len(demonstration):
            raise ValueError(f"{motion.name}: {len(motion)} samples, not {len(demonstration)}")
        period = motion.duration / (len(motion) - 1)
        angular = angular_velocities(motion)
        distance = np.linalg.norm(motion.positions - demonstration.positions, axis=1)
        return cls(
            residual=largest_slip(motion),
            position_rms=float(np.sqrt(np.mean(distance**2))),
            position_end=float(distance[-1]),
            angular_speed=float(np.linalg.norm(angular, axis=1).max()),
            angular_acceleration=float(
                np.linalg.norm(np.diff(angular, axis=0), axis=1).max() / period
            ),
        )


def largest_slip(motion: PoseTrajectory) -> float:
    """Return the largest ``|c(R_k+1) . (p_k+1 - p_k)| / dt`` (m/s), c the lateral axis."""
    period = motion.duration / (len(motion) - 1)
    lateral = motion.rotations[1:].apply([0.0, 1.0, 0.0])
    slip = np.sum(lateral * np.diff(motion.positions, axis=0), axis=1) / period
    return float(np.abs(slip).max())


def angular_velocities(motion: PoseTrajectory) -> np.ndarray:
    """Angular velocity of each step, shape (N - 1, 3), rad/s."""
    period = motion.duration / (len(motion) - 1)
    return np.asarray((motion.rotations[1:] * motion.rotations[:-1].inv()).as_rotvec() / period)
