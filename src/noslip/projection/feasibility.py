"""Poses on the constraints, and constraints that no pose or motion can satisfy together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import ConstraintError, Refusal
from noslip.projection.nearest import nearest
from noslip.projection.pointwise import project_velocities
from noslip.trajectory import PoseTrajectory

_APPROACHING = 8
"""Newton steps to the nearest pose, and then straight onto the constraints."""
_ON = 1e-12
"""Residual, in the constraint's own unit, at which a pose is on it."""
_APART = 1e-6
"""Residual that shows a contradiction: far above what converges."""
_PLACES = 3
"""Samples of a demonstration at which constraints are tried together."""


def project_pose(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    *,
    inverse_metric: Sequence[float] | None = None,
) -> tuple[Floats, Floats]:
    """Nearest pose, in the metric, on the position-level constraints and within the limits.

    Newton's method on the nearest point; velocity-level constraints allow every pose.

    Returns
    -------
    position : array, shape (n,)
    quaternion : array, shape (4 b,)
        Scalar first.

    Raises
    ------
    ConstraintError
        If none is found; the message names the constraints.
    """
    system = as_system(constraints).of_poses
    metric = _everything(system) if inverse_metric is None else inverse_metric
    pose, residual = _nearest_pose(system, time, position, quaternion, metric)
    if residual > _APART:
        free = "" if all(metric) else ', or let the rotation give way too: metric="shared"'
        raise ConstraintError(
            f"no pose found near the one given that satisfies {' and '.join(system.names)} "
            f"(residual {residual:.2g}); give one closer to it{free}",
            code=Refusal.NOT_FOUND,
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
    poses, given = [(trajectory.positions[k], trajectory.quaternions[k]) for k in places], system
    for i, place in enumerate(places):
        time = float(trajectory.times[place] - trajectory.times[0])
        motion = (trajectory.linear_velocities[place], trajectory.angular_velocities[place])

        def agree(constraints: Sequence[Constraint]) -> bool:
            # From far off the search may fail where there is a pose; the start is the next guess.
            system = ConstraintSystem(constraints, given.space)
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
            f"constraints {' and '.join(map(repr, culprits))} seem to contradict each other: no "
            f"pose and motion near t = {time:.3g} s of {trajectory.name} is found that satisfies "
            "them together; leave one out",
            code=Refusal.NOT_FOUND,
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
    places = system.of_poses
    everything = _everything(system)
    pose, residual = _nearest_pose(places, time, position, quaternion, everything)
    if residual > _APART:
        return False
    equalities = system.equalities
    moved = project_velocities(equalities, time, *pose, linear, angular, inverse_metric=everything)
    _, phi, _ = equalities.instant(time, *pose, *moved[:2])
    return bool(np.abs(phi).max(initial=0.0) <= _APART * max(1.0, np.abs(linear).max()))


def _nearest_pose(
    system: ConstraintSystem,
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    inverse_metric: Sequence[float],
) -> tuple[tuple[Floats, Floats], float]:
    """Pose, and what is left of the residual there."""
    space, n = system.space, system.space.linear
    given = np.concatenate([np.ravel(position), np.ravel(quaternion)]).astype(float)
    still = np.zeros(n), np.zeros(space.angular)

    def moved(change: Floats) -> tuple[Floats, Floats]:
        point = space.moved(given, change)
        return point[:n], point[n:]

    def then(change: Floats, more: Floats) -> Floats:
        """One displacement and turn, and then another."""
        return space.difference(space.moved(space.moved(given, change), more), given)

    def conditions(change: Floats) -> tuple[Floats, Floats]:
        value, _, rows = system.instant(time, *moved(change), *still)
        return value, rows

    change, residual = nearest(
        conditions,
        then,
        system.row_is_limit,
        inverse_metric,
        approaching=_APPROACHING,
        tolerance=_ON,
    )
    return moved(change), residual


def _everything(system: ConstraintSystem) -> tuple[float, ...]:
    """M^-1 in which a meter costs as much as a radian."""
    return (1.0,) * system.space.velocity_size
