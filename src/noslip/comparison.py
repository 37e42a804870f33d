"""How a motion differs from the demonstration it came from: the figures of merit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from noslip.constraints.check import check, step_residuals
from noslip.constraints.declaration import Constraint
from noslip.constraints.edge_motion import edge_steps
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.trajectory import PoseTrajectory


@dataclass(frozen=True)
class Comparison:
    """Figures of merit of a motion against its demonstration.

    Attributes
    ----------
    residual_peak, residual_rms : float
        Of the equalities, over all steps and rows, in the constraints' units.
    position_rms, position_end : float
        Distance from the demonstration at the same fraction of the motion (m).
    rotation_rms, rotation_peak : float
        Angle to the demonstrated rotation (rad).
    angular_speed_peak : float
        rad/s.
    angular_acceleration_peak : float
        rad/s^2.
    slowest_edge_speed : float or None
        Least speed of the edge's point along its travel, relative to the work (m/s); negative where
        the tool moves backwards.
    least_margins : dict
        Of each limit over all steps and rows, by name, in the limits' units; negative if violated.
    """

    residual_peak: float
    residual_rms: float
    position_rms: float
    position_end: float
    rotation_rms: float
    rotation_peak: float
    angular_speed_peak: float
    angular_acceleration_peak: float
    slowest_edge_speed: float | None
    least_margins: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)


def compare(
    motion: PoseTrajectory,
    demonstration: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
) -> Comparison:
    """Compare a motion with its demonstration, over the fraction of their durations.

    All figures are computed from poses alone, so that they are the same for a motion read back from
    a file.
    """
    system = as_system(constraints)
    fractions = (motion.times - motion.times[0]) / motion.duration
    instants = demonstration.times[0] + fractions * demonstration.duration
    if len(motion) == len(demonstration) and np.allclose(instants, demonstration.times, 1e-9):
        reference = demonstration
    else:
        reference = demonstration.resampled(times=instants)
    distance = np.linalg.norm(motion.positions - reference.positions, axis=1)
    angle = (motion.rotations * reference.rotations.inv()).magnitude()
    _, angular = motion.step_velocities()
    periods = np.diff(motion.times)
    acceleration = np.diff(angular, axis=0) / periods[1:, None]
    residual = np.abs(step_residuals(motion, system.equalities)).max(axis=1, initial=0.0)
    tool, edge_speed = system.edged, None
    if tool is not None:
        edge_speed = float(edge_steps(motion, tool).forward_speed.min())
    return Comparison(
        residual_peak=float(residual.max()),
        residual_rms=_rms(residual),
        position_rms=_rms(distance),
        position_end=float(distance[-1]),
        rotation_rms=_rms(angle),
        rotation_peak=float(angle.max()),
        angular_speed_peak=float(np.linalg.norm(angular, axis=1).max()),
        angular_acceleration_peak=float(np.linalg.norm(acceleration, axis=1).max(initial=0.0)),
        slowest_edge_speed=edge_speed,
        least_margins=_least_margins(motion, system.limits),
    )


def _least_margins(motion: PoseTrajectory, limits: ConstraintSystem) -> dict[str, float]:
    if not limits.size:
        return {}
    return {c.name: c.margin for c in check(motion, limits).constraints if c.margin is not None}


def _rms(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(values**2)))
