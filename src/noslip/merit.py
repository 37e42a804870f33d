"""Figures of merit of a motion: what it does, how it keeps to its reference and its constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from noslip._typing import Floats
from noslip.constraints.check import checked, step_accelerations
from noslip.constraints.declaration import Constraint
from noslip.constraints.edge_motion import edge_steps
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.runtime.motion import Motion
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory
from noslip.verification import deviations


@dataclass(frozen=True, kw_only=True)
class FiguresOfMerit:
    """What is told of a motion wherever motions are compared; SI units and radians.

    Attributes
    ----------
    position_rms, path_error, end_error : float
        Distance from the reference at the same fraction of the motion: root mean square, largest,
        and at the end (m).
    rotation_rms, rotation_error, end_rotation_error : float
        The same of the angle to the reference's rotation (rad).
    speed_peak, angular_speed_peak : float
        Of the steps (m/s, rad/s).
    acceleration_peak, angular_acceleration_peak : float
        Of the steps (m/s^2, rad/s^2).
    satisfied : bool
        Whether :func:`noslip.check` finds every constraint and limit satisfied.
    residual_peak, residual_rms : float
        Of the equality that is violated most, in its own unit; 0 without equalities.
    slip_distance : float or None
        Way slipped under the worst equality that is in m/s (m); None without one.
    least_margins : dict
        Of each limit over all steps and rows, by name, in the limits' units; negative if violated.
    slowest_edge_speed : float or None
        Least speed of the edge's point along its travel, relative to the work (m/s); negative where
        the tool moves backwards.
    force_peak, torque_peak : float or None
        Largest acceleration that the constraints add, linear and angular (m/s^2, rad/s^2); None of
        a motion that is no rollout under constraints.
    """

    position_rms: float
    path_error: float
    end_error: float
    rotation_rms: float
    rotation_error: float
    end_rotation_error: float
    speed_peak: float
    angular_speed_peak: float
    acceleration_peak: float
    angular_acceleration_peak: float
    satisfied: bool
    residual_peak: float
    residual_rms: float
    slip_distance: float | None
    least_margins: dict[str, float]
    slowest_edge_speed: float | None
    force_peak: float | None
    torque_peak: float | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)


def figures_of_merit(
    motion: PoseTrajectory,
    reference: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint] = (),
) -> FiguresOfMerit:
    """Measure a motion, against a reference over the fraction of their durations.

    All figures but the forces are computed from poses alone, so that they are the same for a motion
    read back from a file.
    """
    space = motion.space
    system = as_system(constraints, space)
    distances, angles = deviations(motion, reference)
    speed, angular_speed = map(_peak, motion.step_velocities())
    acceleration, angular_acceleration = map(_peak, step_accelerations(motion))

    found = checked(motion, system).constraints if system.constraints else ()
    equalities = [each for each in found if each.margin is None]
    slipped = [found.slip_distance for found in equalities if found.slip_distance is not None]
    force = torque = None
    if isinstance(motion, Motion) and motion.row_forces.size:
        force, torque = map(_peak, np.split(motion.constraint_forces, [space.linear], axis=1))
    return FiguresOfMerit(
        position_rms=_rms(distances),
        path_error=float(distances.max()),
        end_error=float(distances[-1]),
        rotation_rms=_rms(angles),
        rotation_error=float(angles.max()),
        end_rotation_error=float(angles[-1]),
        speed_peak=speed,
        angular_speed_peak=angular_speed,
        acceleration_peak=acceleration,
        angular_acceleration_peak=angular_acceleration,
        satisfied=all(each.satisfied for each in found),
        residual_peak=max((found.peak for found in equalities), default=0.0),
        residual_rms=max((found.rms for found in equalities), default=0.0),
        slip_distance=max(slipped, default=None),
        least_margins={each.name: each.margin for each in found if each.margin is not None},
        slowest_edge_speed=slowest_edge_speed(motion, system),
        force_peak=force,
        torque_peak=torque,
    )


def slowest_edge_speed(motion: PoseTrajectory, system: ConstraintSystem) -> float | None:
    """Least speed of a step along the edge that a constraint names (m/s), if one does."""
    edge = system.edged
    if edge is None:
        return None
    posed = motion.tool if isinstance(motion, Trajectory) else motion
    return float(edge_steps(posed, edge).forward_speed.min())


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _peak(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
