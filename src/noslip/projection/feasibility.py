"""Poses on the constraints, and constraints that no pose or motion can satisfy together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import ConstraintError
from noslip.projection.pointwise import least_change, project_velocities
from noslip.trajectory import PoseTrajectory

_EVERYTHING = (1.0,) * 6
_MOST_ITERATIONS = 60
_APPROACHING = 8
_ON = 1e-12
"""Residual, in the constraint's own unit, at which a pose is on it."""
_APART = 1e-6
"""Residual that shows a contradiction: far above what converges."""
_LOST = 1e3
"""Residual, over the first, at which the search has run away."""
_PLACES = 3
"""Samples of a demonstration at which constraints are tried together."""


def project_pose(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    *,
    inverse_metric: Sequence[float] = _EVERYTHING,
) -> tuple[Floats, Floats]:
    """Nearest pose, in the metric, on the position-level constraints and within the limits.

    Newton's method on the nearest point; velocity-level constraints allow every pose.

    Returns
    -------
    position : array, shape (3,)
    quaternion : array, shape (4,)
        Scalar first.

    Raises
    ------
    ConstraintError
        If none is found; the message names the constraints.
    """
    system = _at_position(as_system(constraints))
    pose, residual = _nearest_pose(system, time, position, quaternion, inverse_metric)
    if residual > _APART:
        raise ConstraintError(
            f"no pose near the start satisfies {' and '.join(system.names)} (residual "
            f'{residual:.2g}); start closer, or let the rotation give way too: metric="shared"'
        )
    return pose


def require_consistent(system: ConstraintSystem, trajectory: PoseTrajectory) -> None:
    """Refuse hard constraints that contradict each other near a trajectory, and name them.

    Raises
    ------
    ConstraintError
        Naming the fewest constraints that cannot hold together.
    """
    if len(system.constraints) < 2:
        return
    places = np.unique(np.linspace(0, len(trajectory) - 1, _PLACES).astype(int))
    poses = [(trajectory.positions[k], trajectory.quaternions[k]) for k in places]
    for i, place in enumerate(places):
        time = float(trajectory.times[place] - trajectory.times[0])
        motion = (trajectory.linear_velocities[place], trajectory.angular_velocities[place])

        def agree(constraints: Sequence[Constraint]) -> bool:
            # From far off the search may fail where there is a pose; the start is the next guess.
            system = ConstraintSystem(constraints)
            return any(_agree(system, time, *pose, *motion) for pose in (poses[i], poses[0]))  # noqa: B023

        hard = [c for c in system.constraints if c.priority == 0 and c.level != "acceleration"]
        if agree(hard):
            continue
        names = dict(zip(map(id, system.constraints), system.names, strict=True))
        culprits = [names[id(c)] for c in _fewest(hard, agree)]
        if len(culprits) < 2:
            # It alone is not reached from here; the projection says so in its own words.
            continue
        raise ConstraintError(
            f"constraints {' and '.join(map(repr, culprits))} contradict each other: no pose and "
            f"motion near t = {time:.3g} s of {trajectory.name} satisfies them together"
        )


def _fewest(
    constraints: Sequence[Constraint], agree: Callable[[Sequence[Constraint]], bool]
) -> list[Constraint]:
    """Leave out what does not matter to the contradiction."""
    kept = list(constraints)
    for constraint in constraints:
        rest = [c for c in kept if c is not constraint]
        if not agree(rest):
            kept = rest
    return kept


def _agree(
    system: ConstraintSystem,
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    linear: ArrayLike,
    angular: ArrayLike,
) -> bool:
    places = _at_position(system)
    pose, residual = _nearest_pose(places, time, position, quaternion, _EVERYTHING)
    if residual > _APART:
        return False
    equalities = system.equalities
    moved = project_velocities(equalities, time, *pose, linear, angular, inverse_metric=_EVERYTHING)
    _, phi, _ = equalities.instant(time, *pose, *moved[:2])
    return bool(np.abs(phi).max(initial=0.0) <= _APART * max(1.0, np.abs(linear).max()))


def _at_position(system: ConstraintSystem) -> ConstraintSystem:
    chosen = [c for c in system.constraints if c.level == "position"]
    return ConstraintSystem(chosen) if len(chosen) < len(system.constraints) else system


def _nearest_pose(
    system: ConstraintSystem,
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    inverse_metric: Sequence[float],
) -> tuple[tuple[Floats, Floats], float]:
    """Pose, and what is left of the residual there."""
    given = np.array(position, dtype=np.float64)
    turned = Rotation.from_quat(np.asarray(quaternion, dtype=np.float64), scalar_first=True)
    here, rotation = given, turned
    is_limit = system.row_is_limit
    residual = first = 0.0
    for iteration in range(_MOST_ITERATIONS):
        quat = rotation.as_quat(scalar_first=True)
        value, _, rows = system.instant(time, here, quat, np.zeros(3), np.zeros(3))
        missed = np.where(is_limit, np.minimum(value, 0), value)
        residual = float(np.abs(missed).max(initial=0.0))
        first = first or residual
        if residual <= _ON or residual > _LOST * max(1.0, first):
            break
        if iteration < _APPROACHING:
            offset = np.concatenate([here - given, (rotation * turned.inv()).as_rotvec()])
            change = least_change(rows, rows @ offset - value, is_limit, inverse_metric)
            here, rotation = given + change[:3], Rotation.from_rotvec(change[3:]) * turned
        else:
            change = least_change(rows, -value, is_limit, inverse_metric)
            here, rotation = here + change[:3], Rotation.from_rotvec(change[3:]) * rotation
    return (here, rotation.as_quat(scalar_first=True)), residual
