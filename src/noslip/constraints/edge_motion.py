"""How a tool's edge moves relative to the work: what first guesses, figures and views ask for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.declaration import (
    Constraint,
    Declaration,
    declared,
    from_declared,
    relative_function,
)
from noslip.edge import Edge
from noslip.errors import ConstraintError
from noslip.trajectory import PoseTrajectory


@dataclass(frozen=True, eq=False)
class EdgeMotion:
    """Motion of an edge at N instants, seen from the frame that moves with the work.

    Attributes
    ----------
    edge : Edge
    points, velocities : array, shape (N, 3)
        Of the edge's point (m, m/s), in the work's frame.
    rotations : Rotation, length N
        Of the tool, body to work.
    work : Rotation, length N
        Work to world.
    """

    edge: Edge
    points: Floats
    velocities: Floats
    rotations: Rotation
    work: Rotation

    @property
    def forward_speed(self) -> Floats:
        """Speed along the axis of travel (m/s), negative where the tool backs up, shape (N,)."""
        return _along(self.edge.travel_axes(self.rotations), self.velocities)

    @property
    def lateral_speed(self) -> Floats:
        """Speed along the lateral axis (m/s), shape (N,); that axis must be known."""
        return _along(self.edge.lateral_axes(self.rotations), self.velocities)

    @property
    def slip_angles(self) -> Floats:
        """Angle between the velocity and the blade's plane (rad), 0 at rest, shape (N,)."""
        aside = self.lateral_speed
        speed = np.linalg.norm(self.velocities, axis=1)
        share = np.divide(aside, speed, out=np.zeros_like(aside), where=speed > 0)
        return np.asarray(np.arcsin(np.clip(share, -1.0, 1.0)))

    @property
    def world_velocities(self) -> Floats:
        """The same velocities along the axes of the world, shape (N, 3)."""
        return np.asarray(self.work.apply(self.velocities))

    @property
    def world_lateral_axes(self) -> Floats:
        """The lateral axis in the world, shape (N, 3); that axis must be known."""
        return self.edge.lateral_axes(self.work * self.rotations)


def edge_motion(
    constraint: Constraint,
    times: ArrayLike,
    positions: ArrayLike,
    rotations: Rotation,
    linear_velocities: ArrayLike | None = None,
    angular_velocities: ArrayLike | None = None,
) -> EdgeMotion:
    """Return how the edge that a constraint names moves, relative to its work.

    Parameters
    ----------
    constraint : Constraint
        One with an edge, see :attr:`noslip.constraints.ConstraintSystem.edged`.
    times : array, shape (N,)
        Seconds since the motion began.
    positions, rotations : array, shape (N, 3), and Rotation of length N
        Of the tool, world frame (m).
    linear_velocities, angular_velocities : array, shape (N, 3), optional
        World frame (m/s, rad/s); by default the tool is at rest in the world.

    Raises
    ------
    ConstraintError
        If the constraint names no edge.
    """
    if constraint.edge is None:
        raise ConstraintError(f"constraint {constraint.name!r} names no edge")
    edge, count = constraint.edge, np.size(times)
    still = np.zeros((count, 3))
    p = np.reshape(positions, (count, 3)).astype(np.float64)
    v = still if linear_velocities is None else np.reshape(linear_velocities, (count, 3))
    w = still if angular_velocities is None else np.reshape(angular_velocities, (count, 3))
    rotations = Rotation.from_quat(rotations.as_quat().reshape(count, 4))
    work = Rotation.identity(count)
    if work_moves(constraint):
        matrices = rotations.as_matrix().transpose(1, 0, 2).reshape(3, 3 * count)
        given = [np.reshape(times, (1, count)), p.T, matrices, v.T, w.T]
        seen = np.array(_relative(declared(constraint)).map(count)(*given)).T
        p, v, w = seen[:, :3], seen[:, 12:15], seen[:, 15:]
        relative = Rotation.from_matrix(seen[:, 3:12].reshape(count, 3, 3).transpose(0, 2, 1))
        work, rotations = rotations * relative.inv(), relative
    return EdgeMotion(
        edge, edge.points(p, rotations), edge.velocities(rotations, v, w), rotations, work
    )


def edge_steps(trajectory: PoseTrajectory, constraint: Constraint) -> EdgeMotion:
    """Return the edge's motion in the middle of each of a trajectory's N - 1 steps."""
    times, positions, rotations = trajectory.step_middles()
    return edge_motion(constraint, times, positions, rotations, *trajectory.step_velocities())


def work_moves(constraint: Constraint) -> bool:
    """Whether what a constraint is about moves, in the world."""
    return _relative(declared(constraint)) is not None


@lru_cache(maxsize=64)
def _relative(identity: Constraint | Declaration) -> Any:
    return relative_function(from_declared(identity))


def _along(axes: Floats, velocities: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", axes, velocities))
