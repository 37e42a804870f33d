"""A displacement known at a few samples, spread smoothly over all; motions moved by it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary, sample_of
from noslip.trajectory import PoseTrajectory


def spread(
    displacements: Mapping[int, ArrayLike] | Mapping[float, ArrayLike],
    places: ArrayLike,
    first_slope: ArrayLike | None = None,
    last_slope: ArrayLike | None = None,
) -> Floats:
    """Interpolate displacements by minimum jerk from each given place to the next.

    Velocity and acceleration of the displacement are zero at the given places (Flash and Hogan
    1985, eq. 3), so those of what is displaced stay as they were there; but for the velocities at
    the ends, if they are given.

    Parameters
    ----------
    displacements : mapping from place to array, shape (d,)
        Where it is known; at the first and the last place it is zero unless told.
    places : array, shape (N,)
        Increasing: sample numbers, times or fractions.
    first_slope, last_slope : array, shape (d,), optional
        Of the displacement at the first and the last place, per unit of places.

    Returns
    -------
    array, shape (N, d)
    """
    at = np.asarray(places, dtype=np.float64)
    size = len(np.asarray(next(iter(displacements.values()))))
    ends: dict[float, ArrayLike] = {float(at[0]): np.zeros(size), float(at[-1]): np.zeros(size)}
    known = ends | {float(place): value for place, value in displacements.items()}
    knots = np.array(sorted(known))
    values = np.array([known[float(knot)] for knot in knots], dtype=np.float64)
    before = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = (at - knots[before]) / (knots[before + 1] - knots[before])
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    found = values[before] + blend[:, None] * (values[before + 1] - values[before])
    for slope, interval, way, sign in (
        (first_slope, 0, share, 1.0),
        (last_slope, len(knots) - 2, 1 - share, -1.0),
    ):
        if slope is not None:
            # The quintic with slope 1 at 0 and all else zero at 0 and 1; backwards from the end.
            rise = way - way**3 * (6 - 8 * way + 3 * way**2)
            width = sign * float(knots[interval + 1] - knots[interval])
            found += np.where(before == interval, rise * width, 0.0)[:, None] * np.asarray(slope)
    return np.asarray(found)


def through(free: PoseTrajectory, boundaries: Iterable[Boundary]) -> PoseTrajectory:
    """Return a motion displaced by minimum jerk such that it reaches boundaries, exactly.

    Turns are spread in the tool's frame, as a new goal turns the attractor's.

    Parameters
    ----------
    free : PoseTrajectory
    boundaries : Boundary, several
        One with a twist is an end's and names a whole pose.
    """
    wanted = {sample_of(boundary.at, len(free)): boundary for boundary in boundaries}
    # Velocities of the samples: those of a rollout belong to the step before.
    own = PoseTrajectory(free.times, free.positions, free.rotations)
    positions, rotations, times = free.positions, free.rotations, free.times
    shifts = {
        float(times[k]): b.position - positions[k]
        for k, b in wanted.items()
        if b.position is not None
    }
    turns = {
        float(times[k]): (rotations[k].inv() * b.rotation).as_rotvec()
        for k, b in wanted.items()
        if b.rotation is not None
    }
    faster: list[Floats | None] = []
    turning: list[Floats | None] = []
    for k in (0, len(free) - 1):
        linear = wanted[k].linear_velocity if k in wanted else None
        angular = wanted[k].angular_velocity if k in wanted else None
        faster.append(None if linear is None else linear - own.linear_velocities[k])
        turning.append(
            None
            if angular is None
            else _rate_of_turn(
                turns[float(times[k])], rotations[k], angular - own.angular_velocities[k]
            )
        )
    if shifts:
        positions = positions + spread(shifts, times, *faster)
        for k, b in wanted.items():
            if b.position is not None:
                positions[k] = b.position
    if turns:
        rotations = rotations * Rotation.from_rotvec(spread(turns, times, *turning))
    moved = PoseTrajectory(times, positions, rotations, name=free.name)
    velocities = moved.linear_velocities.copy(), moved.angular_velocities.copy()
    for k, b in wanted.items():
        for found, asked in zip(velocities, (b.linear_velocity, b.angular_velocity), strict=True):
            if asked is not None:
                found[k] = asked
    return replace(moved, linear_velocities=velocities[0], angular_velocities=velocities[1])


def _rate_of_turn(turn: Floats, before: Rotation, missing: Floats) -> Floats:
    """Rate of a turn in the tool's frame that adds an angular velocity (rad/s, world frame).

    ``R Exp(turn)`` rotates at ``Exp(-turn) w + J turn'`` in its own frame, with the right Jacobian
    J of SO(3); its inverse to third order.
    """
    after = before * Rotation.from_rotvec(turn)
    rate = after.inv().apply(missing)
    once = np.cross(turn, rate)
    return np.asarray(rate + once / 2 + np.cross(turn, once) / 12)
