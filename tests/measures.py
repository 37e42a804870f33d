"""What tests measure of motions, by NumPy and SciPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import Constraint, PoseTrajectory
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem


class Steps(NamedTuple):
    """The steps of a motion of N samples: N - 1 instants at which constraints are asked."""

    times: Floats
    positions: Floats
    rotations: Rotation
    linear: Floats
    angular: Floats

    def velocities_of(self, point: Sequence[float]) -> Floats:
        """Velocities of a body's point."""
        return self.linear + np.cross(self.angular, self.rotations.apply(point))


def steps(motion: PoseTrajectory) -> Steps:
    """Velocities of each step from the poses alone, and the pose in its middle."""
    h = np.diff(motion.times)[:, None]
    turns = (motion.rotations[1:] * motion.rotations[:-1].inv()).as_rotvec()
    return Steps(
        (motion.times[1:] + motion.times[:-1]) / 2,
        (motion.positions[1:] + motion.positions[:-1]) / 2,
        Rotation.from_rotvec(turns / 2) * motion.rotations[:-1],
        np.diff(motion.positions, axis=0) / h,
        turns / h,
    )


def speed_along(
    motion: PoseTrajectory, axis: Sequence[float], point: Sequence[float] = (0, 0, 0)
) -> Floats:
    """Speed of a body's point along a body's axis in each step, shape (N - 1,)."""
    found = steps(motion)
    ahead = found.rotations.apply(axis)
    return np.asarray(np.einsum("ki,ki->k", ahead, found.velocities_of(point)))


def spin_about(motion: PoseTrajectory, axis: Sequence[float]) -> Floats:
    """Angular speed about a body's axis in each step, shape (N - 1,)."""
    found = steps(motion)
    return np.asarray(np.einsum("ki,ki->k", found.rotations.apply(axis), found.angular))


def slip(motion: PoseTrajectory) -> Floats:
    """Speed of each step along the tool's y axis, shape (N - 1,)."""
    return speed_along(motion, (0, 1, 0))


def forward_speed(motion: PoseTrajectory) -> Floats:
    """Speed of each step along the tool's x axis, shape (N - 1,)."""
    return speed_along(motion, (1, 0, 0))


def residuals(motion: PoseTrajectory, constraints: Sequence[Constraint]) -> Floats:
    """Residuals computed again from poses alone, shape (N - 1, m).

    At the middle of each step, of position level at its end.
    """
    found, system = steps(motion), ConstraintSystem(constraints)
    middle = system.residuals(
        found.times,
        found.positions,
        found.rotations.as_quat(scalar_first=True),
        found.linear,
        found.angular,
    )
    end = system.residuals(
        motion.times[1:],
        motion.positions[1:],
        motion.quaternions[1:],
        found.linear,
        found.angular,
    )
    return np.where(np.array(system.row_levels) == "position", end, middle)


def end_velocities(motion: PoseTrajectory, at: int) -> tuple[Floats, Floats]:
    """Linear and angular velocity at the start (0) or end (-1): cubics through the nearest steps.

    Of equal steps, whose velocities belong to their middles.
    """
    found = steps(motion)
    near = slice(4) if at == 0 else slice(-4, None)
    times = (found.times - motion.times[at])[near]
    linear, angular = (np.polyfit(times, v[near], 3)[-1] for v in (found.linear, found.angular))
    return linear, angular


def degrees(one: Rotation, other: Rotation) -> float:
    """Largest angle between rotations."""
    return float(np.degrees(np.max((one * other.inv()).magnitude())))


def apart(one: PoseTrajectory, other: PoseTrajectory) -> tuple[float, float]:
    """Farthest that two motions are apart at the same sample (m, degrees)."""
    moved = np.linalg.norm(one.positions - other.positions, axis=1).max()
    return float(moved), degrees(one.rotations, other.rotations)


def assert_same_poses(one: PoseTrajectory, other: PoseTrajectory) -> None:
    """Two motions are the same to the bit."""
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.positions, other.positions)
    np.testing.assert_array_equal(one.rotations.as_quat(), other.rotations.as_quat())


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
