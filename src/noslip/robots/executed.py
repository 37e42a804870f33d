"""A tool's motion as an arm executed it: joints, margins, errors and slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from noslip._files import write_beside
from noslip._typing import Floats
from noslip.constraints.check import step_residuals
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.named_columns import numbers_text
from noslip.robots.kinematics import APART
from noslip.robots.model import NEAR, Robot
from noslip.robots.placement import Placement
from noslip.trajectory import PoseTrajectory

Constraints = ConstraintSystem | Constraint | Sequence[Constraint]


@dataclass(frozen=True)
class Margins:
    """What is left of each limit where least is; 1 is in the middle or at rest, 0 at the limit.

    Attributes
    ----------
    position, velocity, acceleration : float
        Infinite limits count as 1.
    position_joint, velocity_joint, acceleration_joint : str
        Whose it is.
    distance : float
        Between the nearest pair of bodies (m), 0.05 at most.
    pair : tuple of str
    manipulability : float
        Yoshikawa's, lengths over 0.2 m; 0 at the edge of reach.
    """

    position: float
    position_joint: str
    velocity: float
    velocity_joint: str
    acceleration: float
    acceleration_joint: str
    distance: float
    pair: tuple[str, str]
    manipulability: float

    @property
    def smallest(self) -> tuple[float, str]:
        """Smallest margin, distances over 0.05 m among them, and what it is of."""
        return min(
            (self.position, f"position of {self.position_joint}"),
            (self.velocity, f"velocity of {self.velocity_joint}"),
            (self.acceleration, f"acceleration of {self.acceleration_joint}"),
            ((self.distance - APART) / (NEAR - APART), "distance of bodies"),
        )


@dataclass(frozen=True, eq=False)
class ToolErrors:
    """Of an executed path against the commanded one, at equal times.

    Attributes
    ----------
    along, lateral, depth : array, shape (N,)
        Along the commanded tool's x, y and z axis (m).
    rotation : array, shape (N,)
        Angle (rad).
    """

    along: Floats
    lateral: Floats
    depth: Floats
    rotation: Floats

    @property
    def position(self) -> Floats:
        """Distance, shape (N,) (m)."""
        return np.sqrt(self.along**2 + self.lateral**2 + self.depth**2)


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """A tool's motion as an arm's joints execute it.

    Attributes
    ----------
    robot : Robot
    system : ConstraintSystem
        Equalities and limits.
    placement : Placement
    commanded, executed : PoseTrajectory
        Of the tool, seen from the base: as asked for, and by the arm's forward kinematics.
    joint_positions, joint_velocities : array, shape (N, n)
        Velocities are those of the step that led to a sample; the arm starts at rest.
    margins : Margins
    seconds_per_step : float
        Median time that a step's inverse kinematics took (s).
    clock : array, shape (N,)
        Time along the motion (s): the times, unless the arm fell behind.
    """

    robot: Robot
    system: ConstraintSystem
    placement: Placement
    commanded: PoseTrajectory
    executed: PoseTrajectory
    joint_positions: Floats
    joint_velocities: Floats
    margins: Margins
    seconds_per_step: float
    clock: Floats

    @property
    def times(self) -> Floats:
        """Seconds, shape (N,)."""
        return self.commanded.times

    @cached_property
    def errors(self) -> ToolErrors:
        """Of the executed tool against the commanded one."""
        return tool_errors(self.commanded, self.executed)

    @cached_property
    def slip(self) -> Floats:
        """Residuals of the executed tool's equalities at each step, shape (N - 1, m)."""
        return slip(self.placement.undo(self.executed), self.system)

    def csv_text(self) -> str:
        """Return ``t,q1..,dq1..`` as text; a float read back is the float written."""
        table = np.column_stack([self.times, self.joint_positions, self.joint_velocities])
        return numbers_text(joint_columns(self.robot), table)

    def to_csv(self, path: str | Path) -> Path:
        """Write :meth:`csv_text` to a file."""
        return write_beside(path, self.csv_text().encode())


def joint_columns(robot: Robot) -> list[str]:
    """Return what a table of an arm's joints has in its header: ``t,q1..,dq1..``."""
    joints = range(1, robot.size + 1)
    return ["t", *(f"q{k}" for k in joints), *(f"dq{k}" for k in joints)]


def slip(motion: PoseTrajectory, constraints: Constraints) -> Floats:
    """Residuals of the equalities at each step of a motion, from its poses alone.

    Returns
    -------
    array, shape (N - 1, m)
        Of a blade the lateral speed (m/s).
    """
    return step_residuals(motion, as_system(constraints).equalities)


def slip_distance(motion: PoseTrajectory, constraints: Constraints) -> Floats:
    """Way that a tool slipped: the integral of each velocity-level residual's size.

    Returns
    -------
    array, shape (m,)
        One number a row (m, of a residual in m/s).
    """
    system = as_system(constraints).equalities
    sizes = np.abs(slip(motion, system))[:, system.row_is_velocity]
    return np.asarray(np.diff(motion.times) @ sizes)


def tool_errors(commanded: PoseTrajectory, executed: PoseTrajectory) -> ToolErrors:
    """Split what an executed path is off the commanded one, in the commanded tool's frame."""
    off = commanded.rotations.inv().apply(executed.positions - commanded.positions)
    angle = (executed.rotations * commanded.rotations.inv()).magnitude()
    return ToolErrors(off[:, 0], off[:, 1], off[:, 2], angle)
