"""A displacement known at a few samples, spread smoothly over all; motions moved by it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from noslip._typing import Floats
from noslip.boundary import Boundary, end_twist, sample_of
from noslip.quaternions import inverse, product, turned, turns_between
from noslip.trajectory import PoseTrajectory

_AS_IT_IS = np.array([1.0, 0.0, 0.0, 0.0])


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
        One with a twist is an end's.
    """
    wanted = {sample_of(boundary.at, len(free)): boundary for boundary in boundaries}
    points, times, n = free.points.copy(), free.times, free.space.linear
    own = {0: end_twist(free, 0.0), len(free) - 1: end_twist(free, 1.0)}
    asked = {k: wanted[k].twist_or(*mine) if k in wanted else mine for k, mine in own.items()}
    ends = [float(times[k]) for k in own]
    shifts = dict.fromkeys(ends, np.zeros(n)) | {
        float(times[k]): b.position - points[k, :n]
        for k, b in wanted.items()
        if b.position is not None
    }
    faster = [asked[k][0] - mine[0] for k, mine in own.items()]
    points[:, :n] += spread(shifts, times, *faster)
    for k, b in wanted.items():
        if b.position is not None:
            points[k, :n] = b.position
    for part in range(free.space.rotations):
        at, by = slice(n + 4 * part, n + 4 * part + 4), slice(3 * part, 3 * part + 3)
        quaternions = points[:, at].copy()
        # In the tool's frame.
        turns = dict.fromkeys(ends, np.zeros(3)) | {
            float(times[k]): _turn_in(quaternions[k], b.quaternion[at.start - n : at.stop - n])
            for k, b in wanted.items()
            if b.quaternion is not None
        }
        turning = []
        for k, mine in own.items():
            turn = turns[float(times[k])]
            after = product(quaternions[k], turned(turn, _AS_IT_IS))
            rate = _turned_back(after, asked[k][1][by] - mine[1][by])
            # R Exp(turn) rotates at Exp(-turn) w + J turn' in its own frame, J the right Jacobian.
            turning.append(inverse_left_jacobian(-turn, rate))
        points[:, at] = product(quaternions, turned(spread(turns, times, *turning), _AS_IT_IS))
    return free.with_points(points)


def _turn_in(begin: Floats, end: Floats) -> Floats:
    """Rotation vector in the tool's frame that leads from one quaternion to another."""
    return turns_between(_AS_IT_IS, product(inverse(begin), end))


def _turned_back(quaternion: Floats, vector: Floats) -> Floats:
    """A vector of the world's frame in that of the tool."""
    within = product(product(inverse(quaternion), np.append(0.0, vector)), quaternion)
    return within[1:]


def inverse_left_jacobian(turn: Floats, rate: Floats) -> Floats:
    """Return the rate of a rotation vector from the angular velocity of its rotation.

    ``w = J turn'`` with the left Jacobian J of SO(3), whose inverse is this in closed form.

    Parameters
    ----------
    turn : array, shape (3,)
        Rotation vector, shorter than a whole turn (rad).
    rate : array, shape (3,)
        w (rad/s).
    """
    angle = np.linalg.norm(turn)
    once = np.cross(turn, rate)
    half = angle / 2
    curved = 1 / 12 if angle < _SMALL_TURN else (1 - half / np.tan(half)) / angle**2
    return np.asarray(rate - once / 2 + curved * np.cross(turn, once))


_SMALL_TURN = 1e-3
"""Below it (rad) the closed form loses to rounding what it gains on its limit."""
