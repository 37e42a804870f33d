"""Which point of a tool slips least: what a check says where the point it was given slips."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from noslip._typing import Floats
from noslip.constraints.declaration import UNITS, Constraint, row_units
from noslip.constraints.system import ConstraintSystem
from noslip.trajectory import PoseTrajectory

BLOCKS = 8
"""Of a motion's steps, taken in turn to fit a point and to judge it: several bends in each half."""
CLEARLY = 0.5
"""Of the share of its way that the given point slips, what another may slip to be worth saying; two
points of a tool that slips by the hand's error alone differ by less."""
TOLD = 0.1
"""Of the largest singular value, below which a motion does not tell where along its direction the
point is; there, the given point stays."""
DIGITS = 4
"""Of a point in meters: tenths of a millimeter."""


@dataclass(frozen=True)
class BetterPoint:
    """Where another point of the tool is (m, body frame), and the way it slips (m)."""

    point: tuple[float, float, float]
    slip_distance: float


def better_point(trajectory: PoseTrajectory, constraint: Constraint) -> BetterPoint | None:
    """Return the point about which a tool's constraint holds clearly better, if there is one.

    The residual ``a . (v + w x R r)`` of a blade, a wheel or a needle is linear in the point r:
    least squares over all steps.  It is judged on blocks of the motion that it was not fitted to,
    by the share of its own way that it slips: a point that just stands still explains nothing.
    """
    place: Any = getattr(constraint, "reference_point", None)
    if (
        constraint.level != "velocity"
        or not (constraint.edge and constraint.edge.lateral)
        or not place
    ):
        return None
    given = np.array(place)
    sideways = np.array([unit == UNITS["velocity"] for unit in row_units(constraint)])
    times, positions, rotations = trajectory.step_middles()
    linear, angular = trajectory.step_velocities()
    periods = np.diff(trajectory.times)
    quaternions = rotations.as_quat(scalar_first=True)
    system = ConstraintSystem(constraint)

    def velocities(shift: Floats) -> Floats:
        return np.asarray(linear + np.cross(angular, rotations.apply(shift)))

    def residuals(shift: Floats) -> Floats:
        found = system.residuals(times, positions, quaternions, velocities(shift), angular)
        return np.asarray(found[:, sideways])

    base = residuals(np.zeros(3))
    slopes = np.stack([residuals(axis) - base for axis in np.eye(3)], axis=-1)
    weights = np.sqrt(periods)[:, None]

    def fitted(use: Any) -> Floats:
        rows = (weights[use, :, None] * slopes[use]).reshape(-1, 3)
        return np.asarray(-np.linalg.pinv(rows, TOLD) @ (weights[use] * base[use]).ravel())

    def slipped(shift: Floats, use: Any) -> Floats:
        """Way slipped, and way made, over some steps (m)."""
        sizes = (
            np.linalg.norm(base + slopes @ shift, axis=1),
            np.linalg.norm(velocities(given + shift), axis=1),
        )
        return np.array([size[use] @ periods[use] for size in sizes])

    halves = np.arange(len(periods)) * BLOCKS // len(periods) % 2 == 1
    slip, way = slipped(fitted(~halves), halves) + slipped(fitted(halves), ~halves)
    before, before_way = slipped(np.zeros(3), slice(None))
    if not slip * before_way < CLEARLY * before * way:
        return None
    point = np.round(given + fitted(slice(None)), DIGITS) + 0.0
    after, after_way = slipped(point - given, slice(None))
    if not after * before_way < CLEARLY * before * after_way:
        return None
    x, y, z = point.tolist()
    return BetterPoint((x, y, z), float(after))
