"""Starts, goals and via points: from what a caller names to what a motion can reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.adapting.constants import OFF
from noslip.boundary import Boundary, End, kept_twist, rotations_of, twist
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError, Refusal
from noslip.projection.feasibility import project_pose
from noslip.projection.pointwise import project_velocities
from noslip.rule import Rule
from noslip.space import POSE, Space
from noslip.trajectory import PoseTrajectory

Velocity = ArrayLike | Literal["free"] | None
"""Of an end: at rest (0), as given, whatever suits the motion, or that of the law."""


def asked(
    what: Literal["start", "goal"],
    position: ArrayLike | None,
    rotation: Rotation | None,
    velocity: Velocity = None,
    space: Space = POSE,
) -> Boundary:
    """Return the boundary that arguments ``start_position``, ``start_rotation``, ... ask for.

    Parameters
    ----------
    velocity : 0, array of shape (n,) or (n + 3 b,), or "free", optional
        At rest; linear (m/s); linear, then angular (rad/s).
    space : Space
        What moves.

    Raises
    ------
    InputError
        Naming the argument.
    """
    if position is not None:
        position = _arguments.vector(f"{what}_position", position, space.unit, space.linear)
    if rotation is not None and space.rotations == 1:
        rotation = _arguments.rotation(f"{what}_rotation", rotation)
    linear, angular = None, None
    if velocity is not None and not (isinstance(velocity, str) and velocity == "free"):
        linear, angular = twist(f"{what}_velocity", velocity, space)
    found = Boundary(0.0 if what == "start" else 1.0, position, rotation, linear, angular)
    found.require_of(space)
    return found


def placed(
    boundary: Boundary,
    own: tuple[Floats, Rotation | None],
    system: ConstraintSystem,
    inverse_metric: Sequence[float],
    time: float,
) -> Boundary:
    """Return a start or goal as a whole pose that the constraints allow.

    What is not named is the primitive's own.  A start, and a goal of which nothing is named, is
    moved onto the constraints; velocities are the nearest that they allow.

    Parameters
    ----------
    own : (position, rotation)
        The primitive's.
    inverse_metric : n + 3 b numbers
        In which velocities are nearest.
    time : float
        Of the constraints' clock (s).

    Raises
    ------
    ConstraintError
        If a goal violates a position-level constraint or hard limit.
    """
    position, rotation = boundary.pose_or(*own)
    is_start = boundary.at == 0
    equalities = system.equalities
    stays = not is_start and not (boundary.position is None and boundary.rotation is None)
    if "position" in equalities.row_levels and not stays:
        quaternion = replace(boundary, rotation=rotation).quaternion
        none = np.zeros(0)
        position, quaternion = project_pose(
            equalities, time, position, none if quaternion is None else quaternion
        )
        rotation = rotations_of(quaternion)
    found = replace(boundary, position=position, rotation=rotation)
    if not is_start:
        require_feasible(system, "goal", time, found)
    return allowed(found, system, inverse_metric, time) if found.has_twist else found


def allowed(
    boundary: Boundary, system: ConstraintSystem, inverse_metric: Sequence[float], time: float
) -> Boundary:
    """Return a pose with a twist with the nearest twist that the constraints allow there."""
    space = system.space
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], space.rotations)
    linear, angular, _ = project_velocities(
        system.equalities,
        time,
        np.zeros(space.linear) if boundary.position is None else boundary.position,
        quaternion if boundary.quaternion is None else boundary.quaternion,
        *boundary.twist_or(np.zeros(space.linear), np.zeros(space.angular)),
        inverse_metric=inverse_metric,
    )
    return _twisted(boundary, linear, angular)


def _twisted(boundary: Boundary, linear: Floats, angular: Floats) -> Boundary:
    """Return it with a twist; where nothing turns, with no angular one."""
    turning = angular if len(angular) else None
    return replace(boundary, linear_velocity=linear, angular_velocity=turning)


def moving(boundary: Boundary, own: PoseTrajectory, rule: Rule, time: float, kept: End) -> Boundary:
    """Return what is kept of a start or goal, with the twist that a motion has there.

    Where constraints tie velocities to the tool, the twist turns along with its rotation.  What
    they do not allow of it is taken away; what is at rest but for rounding is at rest.  A pose that
    is not kept whole leaves a twist open that is not at rest.

    Parameters
    ----------
    boundary : Boundary
        A whole pose.
    own : PoseTrajectory
        The motion without constraints.
    """
    assert boundary.position is not None
    linear, angular = kept_twist(own, boundary.at)
    if own.space.is_pose and "velocity" in rule.system.equalities.row_levels:
        assert boundary.rotation is not None
        turn = boundary.rotation * own.rotations[0 if boundary.at == 0 else -1].inv()
        linear, angular = turn.apply(linear), turn.apply(angular)
    found = allowed(
        _twisted(boundary, linear, angular),
        rule.system,
        rule.inverse_metric,
        time,
    )
    return (boundary if found.moves and kept != "pose" else found).part(kept)


def require_feasible(system: ConstraintSystem, what: str, time: float, boundary: Boundary) -> None:
    """Refuse a pose that position-level equalities or hard limits do not allow.

    Where only a position or a rotation is given, what depends on the other is not asked.

    Raises
    ------
    ConstraintError
        Naming the constraint and by how much it is missed.
    """
    # What is open takes any value: rows that change with it are not decided.
    random = np.random.default_rng(0)
    tried = []
    space, still = system.space, (np.zeros(system.space.linear), np.zeros(system.space.angular))
    for _ in range(1 if boundary.is_whole(space) else 2):
        position, quaternion = boundary.position, boundary.quaternion
        if position is None:
            position = random.normal(size=space.linear)
        if quaternion is None:
            turned = random.normal(size=(space.rotations, 4))
            quaternion = np.ravel(turned / np.linalg.norm(turned, axis=1, keepdims=True))
        tried.append(system.residuals(time, position, quaternion, *still)[0])
    values, decided = tried[0], np.ptp(tried, axis=0) <= OFF
    priorities = system.per_row(c.priority for c in system.constraints)
    for name, counts, level, is_limit, unit, priority, value in zip(
        system.row_names,
        decided,
        system.row_levels,
        system.row_is_limit,
        system.row_units,
        priorities,
        values,
        strict=True,
    ):
        off = max(-value, 0.0) if is_limit else abs(value)
        if counts and level == "position" and priority == 0 and off > OFF:
            raise ConstraintError(
                f"{what} violates {name!r} by {off:.3g} {unit}; no motion that satisfies it "
                f"{'ends' if what == 'goal' else 'passes'} there",
                code=Refusal.IMPOSSIBLE,
            )
