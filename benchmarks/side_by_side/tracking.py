"""A tool led along a reference at each step: mink and pink with the constraint as an equality.

A point ahead of the tool follows the path that lies as far ahead, as a car is steered (pure
pursuit): a tool that must not slip can be led in no other way, as it cannot go straight back to a
path beside it.  To another goal the reference is the motion of movement-primitives, which knows the
goal and no constraint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import peers
from benchmarks.side_by_side.job import DEMONSTRATED, Job, Row, judged, version_of
from benchmarks.side_by_side.kinematics import Follower, solver
from benchmarks.side_by_side.primitives import CARTESIAN
from noslip import PoseTrajectory
from noslip.merit import figures_of_merit

PACKAGES = {"pink": "pin-pink", "mink": "mink"}
LATERAL = (0.0, 1.0, 0.0)
FORWARD = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
"""In the example's blade, which is pitched by 45 degrees: where it goes that follows its path."""


@dataclass(frozen=True)
class Steering:
    """How the reference is followed.

    Attributes
    ----------
    ahead : float
        Of the tool (m).
    turning : float
        Cost of the orientation over that of the position (m / rad).
    gain : float
        Share of the error that a step makes good.
    """

    ahead: float
    turning: float
    gain: float


BEST = Steering(ahead=0.0003, turning=0.0, gain=1.0)
"""Of :data:`GRID`, for both libraries: see ``python -m benchmarks.side_by_side --tune``."""
GRID = [
    Steering(*each)
    for each in product(
        (1e-4, 2e-4, 3e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2), (0.0, 1e-4), (0.3, 0.7, 1.0)
    )
]
NEAR = 2e-4
"""Rms distance from the path within which the smoothest is the best (m): noslip's is 1.6e-4."""


def follow(library: str, reference: PoseTrajectory, steering: Steering) -> PoseTrajectory:
    """Lead a blade along a reference, from its start, in its own steps."""
    step = reference.duration / (len(reference) - 1)
    offset = steering.ahead * FORWARD
    solve = solver(library, Follower((LATERAL,), (), offset, steering.turning, steering.gain, step))
    targets = points_ahead(reference.positions, steering.ahead)
    pose = reference.positions[0], reference.rotations[0]
    poses = [pose]
    for k in range(1, len(reference)):
        pose = solve(pose, (targets[k], reference.rotations[k]))
        poses.append(pose)
    rotations = Rotation.concatenate([rotation for _, rotation in poses])
    return PoseTrajectory(reference.times, [position for position, _ in poses], rotations)


def points_ahead(positions: np.ndarray, ahead: float) -> np.ndarray:
    """Return the path's points a distance further along it; beyond its end it goes on straight.

    Parameters
    ----------
    positions : array, shape (N, 3)
    ahead : float
        Meters.
    """
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))]
    moving = np.r_[True, np.diff(way) > 0]
    asked = way + ahead
    found = np.column_stack([np.interp(asked, way[moving], x[moving]) for x in positions.T])
    # A chord as long: the last step alone may be all but nothing.
    back = np.searchsorted(way, way[-1] - ahead, side="right") - 1
    chord = positions[-1] - positions[max(back, 0)]
    length = np.linalg.norm(chord)
    if length > 0:
        found += np.maximum(asked - way[-1], 0.0)[:, None] * chord / length
    return found


def rows(library: str, job: Job) -> Iterator[Row]:
    """Follow the demonstration, or what movement-primitives makes of it for another goal."""
    version, way = version_of(PACKAGES[library]), "equality at each step"
    reason = "" if find_spec(library) is not None else f"pip install {PACKAGES[library]}"
    references = {"": job.given}
    if job.name != DEMONSTRATED:
        reason = reason or peers.MISSING
        if not reason:
            references = {f" along {name}": move(job) for name, move in CARTESIAN.items()}
    if reason:
        yield Row(library, version, way, job.name, skipped=reason)
        return
    for source, reference in references.items():
        move = partial(follow, library, reference, BEST)
        yield judged(library, version, way + source, job, move)


def tune(library: str, job: Job) -> tuple[Steering, float]:
    """Return the smoothest steering of those that stay near to the path, and how far off it is."""
    tried = []
    for steering in GRID:
        merit = figures_of_merit(follow(library, job.given, steering), job.given)
        if merit.position_rms < NEAR:
            tried.append((merit.angular_acceleration_peak, steering, merit.position_rms))
    _, steering, off = min(tried, key=lambda each: each[0])
    return steering, off
